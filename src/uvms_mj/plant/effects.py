"""The effects of the water of a scenario: the records of the one list, their tables of numbers, and their errors.

Both engines, ``attach``, the plugin, the FMU, fleets, resets, checks and closed forms take the effects from here.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import Fault
from ..physics.effects import EFFECTS, FLOWS, PUSHES, STATES, add_pushes, counted, effects_dtype
from ..physics.flow import flow_along
from ..physics.frames import quat_from_euler_deg, rotation_matrix
from ..physics.hydrodynamics import WATER
from ..physics.kernels import record_of
from ..stages.setup import ScenarioLike
from .buoyancy import Buoyancy
from .contacts import walls_of
from .settings import EffectTable, Situation
from .water import EFFECT_TABLES

Tables = Mapping[str, EffectTable | Sequence[EffectTable]]
"""A table of each effect by its name, or a list of them."""


_FOUND: Mapping[str, Callable[[ScenarioLike, Any], Any]] = {
    "seed": lambda scenario, plant: scenario.simulation.seed,
    "gravity": lambda scenario, plant: float(np.linalg.norm(plant.mjcf.gravity_W)),
    "face": lambda scenario, plant: scenario.wall.position + plant.probe.radius if scenario.wall.present else None,
    "timestep": lambda scenario, plant: scenario.simulation.timestep,
    "links": lambda scenario, plant: plant.vehicle.arm.names,
    "start_p": lambda scenario, plant: scenario.initial.position,
    "start_R": lambda scenario, plant: rotation_matrix(quat_from_euler_deg(*scenario.initial.attitude_deg)),
    "mean_flow_W": lambda scenario, plant: scenario.mean_flow_W,
    "inertia": lambda scenario, plant: plant.vehicle.M_RB + plant.vehicle.M_A,
    "duration": lambda scenario, plant: scenario.simulation.duration,
    "walls": lambda scenario, plant: walls_of(scenario, plant.probe.radius),
    "displaced_mass": lambda scenario, plant: plant.vehicle.displaced_mass,
    "r_b": lambda scenario, plant: plant.vehicle.r_b,
    "surface": lambda scenario, plant: scenario.sea.surface,
    "tilted": lambda scenario, plant: bool(plant.mjcf.gravity_W[:2].any()),
    "surfaces": lambda scenario, plant: bool(scenario.buoyancy.shapes),
    "vehicle": lambda scenario, plant: scenario.vehicle.name,
    "arm": lambda scenario, plant: plant.vehicle.arm,
    "wrist": lambda scenario, plant: bool(scenario.wrist.runs),
}
"""Where each field of a :class:`.settings.Situation` is in a scenario with a plant."""


class _Situation:
    """The :class:`.settings.Situation` of a scenario with a plant. It reads what a table asks for, and no more."""

    def __init__(self, scenario: ScenarioLike, plant: Any) -> None:
        self._scenario, self._plant = scenario, plant

    def __getattr__(self, name: str) -> Any:
        if name not in _FOUND:  # as copies and pickles ask for theirs
            raise AttributeError(name)
        return _FOUND[name](self._scenario, self._plant)


def situation_of(scenario: ScenarioLike, plant: Any) -> Any:
    """The :class:`.settings.Situation` of a scenario with a plant."""
    return _Situation(scenario, plant)


def effect_tables(scenario: ScenarioLike) -> Tables:
    """The tables of the effects of a scenario."""
    return {name: getattr(scenario, name) for name in EFFECT_TABLES}


def each_table(tables: Tables) -> Iterator[tuple[str, str, EffectTable]]:
    """The name of each effect, the key of each of its tables, and the table."""
    for name, given in tables.items():
        if isinstance(given, EffectTable):
            yield name, name, given
        else:
            yield from ((name, f"{name}[{k}]", table) for k, table in enumerate(given))


def effect_records(tables: Tables, situation: Situation, products: Sequence[Any] = ()) -> np.ndarray:
    """The records (1,) of effects in a situation, and of the products of velocities of a vehicle."""
    found: dict[str, list[tuple]] = {"products": [product.record for product in products]}
    for name, _, table in each_table(tables):
        for kind, rows in table.kinds(name, situation).items():
            found.setdefault(kind, []).extend(rows)
    records = np.zeros(1, effects_dtype(tuple((name, len(found.get(name, ()))) for name in EFFECTS)))
    for name, rows in found.items():
        if rows:
            records[name][0] = rows
    return records


def effects_of(scenario: ScenarioLike, plant: Any) -> np.ndarray:
    """The records (1,) of the effects of a scenario with a plant, and of the products of its vehicle."""
    return effect_records(effect_tables(scenario), situation_of(scenario, plant), plant.vehicle.products)


def effect_rows(tables: Tables) -> dict[str, np.ndarray]:
    """The tables of numbers (n, width) of effects, by the keys ``current.shear``."""
    return {
        f"{key}.{field}": np.array(rows, float)
        for _, key, table in each_table(tables)
        for field, rows in table.tables.items()
        if rows
    }


def set_places(records: np.ndarray, rows: Mapping[str, np.ndarray], put: Callable[[str, np.ndarray], int]) -> None:
    """Put the tables of numbers of :func:`effect_rows` into memory, and set their places in the records (1,)."""
    for key, table in rows.items():
        name, _, field = key.partition(".")
        records[name][field] = put(key, table)


def effect_faults(tables: Tables, situation: Situation) -> list[Fault]:
    """The errors of effects in a situation."""
    found = [
        Fault(f"{key}.{fault.key}", fault.message)
        for _, key, table in each_table(tables)
        for fault in table.faults(situation)
    ]
    return [*found, *_surface_faults(tables)]


def _surface_faults(tables: Tables) -> Iterator[Fault]:
    """Errors for effects that do not know that a vehicle may leave the water."""
    given = tables.get("buoyancy")
    if not isinstance(given, Buoyancy):
        if given:
            yield Fault("buoyancy", "is one table, which has all shapes")
        return
    for name, key, table in each_table(tables) if given.shapes else ():
        if name in ("pads", "near_wall") or (name == "tether" and table.advances):
            yield Fault("buoyancy.shapes", f"the water of {key} is that far below the surface; leave one of them out")


def advancing(tables: Tables, situation: Situation) -> list[str]:
    """The keys of the effects in a situation whose states advance from step to step."""
    return [
        key
        for name, key, table in each_table(tables)
        if (name in STATES and bool(table.records(situation)) if table.advances is None else table.advances)
    ]


class MeanWater:
    """The water of a scenario without what varies with time, as a vehicle at rest at the end of a run has it.

    Attributes:
        push: (6,) wrench of the effects of the time alone in B [N, N m].
    """

    def __init__(self, scenario: ScenarioLike, plant: Any, records: np.ndarray) -> None:
        """``records`` (1,) are the records that :func:`effects_of` gives."""
        given = {name: getattr(scenario, name) for name in (*FLOWS, *PUSHES)}
        tables = {
            name: table.at_rest if isinstance(table, EffectTable) else [each.at_rest for each in table]
            for name, table in given.items()
        }
        rows, numbers = effect_rows(tables), [np.zeros(1)]

        def put(key: str, table: np.ndarray) -> int:
            numbers.append(table.reshape(-1))
            return sum(each.size for each in numbers[:-1])

        if rows or any(tables[name] is not table for name, table in given.items()):
            records = effect_records(tables, situation_of(scenario, plant))
            set_places(records, rows, put)
        self.effects, self._numbers = record_of(records), np.concatenate(numbers)
        self._constant, self.push = scenario.mean_flow_W if scenario.constant_flow else None, np.zeros(6)
        self.water, self._vehicle = record_of(np.zeros(1, WATER)), plant.vehicle
        self._accelerates = "obstacle" in dict(counted(records))
        add_pushes(self.effects, self._numbers, 0.0, self.push)

    def flow(self, p_W: np.ndarray) -> np.ndarray:
        """The velocity (3,) of the water at a place (3,) in W [m, m/s]."""
        if self._constant is not None:
            return self._constant.copy()
        flow_along(self, self._numbers, 0.0, p_W, np.eye(3), np.zeros(6))
        return self.water.v_c_W.copy()

    def pull(self, p_W: np.ndarray, R_WB: np.ndarray) -> np.ndarray:
        """The wrench (6,) of the acceleration of the water at an obstacle on a rigid vehicle at rest at a place (3,) in
        W [m] with an attitude (3, 3): in B, on the added mass and as the Froude-Krylov force [N, N m]."""
        tau = np.zeros(6)
        if self._accelerates:
            self.flow(p_W)
            vehicle, f = self._vehicle, self._vehicle.displaced_mass * (R_WB.T @ self.water.a_c_W)
            tau[:3], tau[3:] = f, np.cross(vehicle.r_b, f)
            tau += vehicle.M_A[:, :3] @ (R_WB.T @ self.water.v_c_dot_W)
        return tau
