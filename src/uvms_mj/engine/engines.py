"""The engines that run a scenario: ``mujoco`` runs every one, ``free_body`` those that :func:`refusals` accepts."""

import dataclasses
from collections.abc import Callable

from ..errors import Fault, InputError, suggestion
from ..physics.frames import BODY
from ..scenario import STAGES
from ..setup.base import Setup
from .base import Engine
from .free_engine import FreeEngine
from .mujoco_engine import MujocoEngine

ENGINES: dict[str, Callable[[Setup], Engine]] = {each.name: each for each in (MujocoEngine, FreeEngine)}
"""The engines by name."""

_KNOWN = {
    "simulation": ("timestep", "duration", "integrator", "seed"),
    "initial": ("position", "attitude_deg", "velocity"),
    "wall": ("present", "position", "stiffness", "damping", "friction", "tangential_stiffness", "tangential_damping"),
    "bumper": ("stiffness", "damping"),
}
"""The keys of the plant and of the stepping that free_body computes."""
_SHARED = ("vehicle", "current", "disturbance", "tether", "impedance", "estimates", "task", *STAGES)
"""The tables that both engines read from the same records."""


def refusals(setup: Setup) -> list[str]:
    """The reasons why the engine free_body can't run a scenario, one sentence for each key; empty if it can.

    It takes one rigid vehicle among walls, and steps it as MuJoCo's integrator euler. A table or key that it
    does not know is refused unless it has its default.
    """
    scenario, unknown = setup.scenario, list[str]()
    if setup.vehicle.arm.links:
        return [f"vehicle.model = {scenario.vehicle.model!r} has joints, which the engine free_body does not compute"]
    if scenario.task.frame != BODY:
        unknown.append(f"task.frame = {scenario.task.frame!r}")
    if scenario.vehicle.payloads:
        unknown.append("vehicle.payloads")
    if scenario.simulation.integrator != "euler":
        unknown.append(f"simulation.integrator = {scenario.simulation.integrator!r}")
    for table in dataclasses.fields(scenario):
        value = getattr(scenario, table.name)
        if table.name not in _SHARED and dataclasses.is_dataclass(value):
            fields = [field for field in dataclasses.fields(value) if getattr(value, field.name) != field.default]
            known = _KNOWN.get(table.name, ())
            unknown += [f"{table.name}.{field.name}" for field in fields if field.name not in known]
    return [f"{key} is not computed by the engine free_body; use the engine mujoco" for key in unknown]


def engine_of(name: str, setup: Setup) -> Engine:
    """A new engine. Raises InputError if there is none of this name, or it can't run the scenario."""
    if name not in ENGINES:
        raise InputError(f"engine {name!r}: is not an engine; {suggestion(str(name), ENGINES)}")
    reasons = refusals(setup) if name == FreeEngine.name else []
    if reasons:
        raise InputError([Fault("engine", reason) for reason in reasons], "scenario")
    return ENGINES[name](setup)
