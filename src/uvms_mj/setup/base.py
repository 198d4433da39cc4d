"""A scenario with its plant and design: the basis of a run, and of everything that is computed about it."""

import dataclasses
import functools
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..actuation import Joints
from ..control import ImpedanceTask
from ..control.design import Design
from ..control.theory import predictions
from ..control.theory.own_effects import shipped_slopes
from ..physics.frames import BODY, quat_from_euler_deg, rotation_matrix
from ..physics.spanned_axes import axes_spanned
from ..physics.statics import Statics
from ..plant.build import Plant, build
from ..plant.contacts import ContactAtRest, Contacts, Pair
from ..plant.effects import MeanWater, advancing, effect_rows, effect_tables, effects_of, situation_of
from ..plant.hull import swell
from ..plant.mjcf import Mjcf
from ..plant.settings import EffectTable, Initial, lightest_along_face, lightest_at
from ..plant.vehicle import Vehicle
from ..scenario import Scenario
from ..stages.base import Stage
from .task_frame import task_start

_FREE = ("name", "description", "simulation", "initial", "reference", "impedance", "task", "controller")
"""Tables on which a formula along x for the force at rest does not depend, or whose values are in it."""
_FREE_KEYS = {
    "vehicle": ("model", "added_mass", "linear_damping", "quadratic_damping", "coulomb_friction"),
    "wall": ("position", "stiffness", "damping", "tangential_stiffness", "tangential_damping"),
    "estimates": ("inertia", "coriolis", "damping"),
}
"""The same for single keys of a table. Of a stage it is the period alone; a table of an effect has its own."""
_ALIGNED = 1e-9


@dataclass(frozen=True, eq=False)
class Setup:
    """A scenario, the plant, the design matrices of both, and the contacts."""

    scenario: Scenario
    plant: Plant
    design: Design
    contacts: Contacts

    @property
    def vehicle(self) -> Vehicle:
        """The true vehicle."""
        return self.plant.vehicle

    @property
    def nominal(self) -> Vehicle:
        """The vehicle of the file, which the laws and the allocation are given."""
        return self.plant.mjcf.vehicle

    @property
    def task(self) -> ImpedanceTask:
        """The impedance task with its gains F_1, F_2, A, integral."""
        return self.scenario.task

    @property
    def gravity_W(self) -> np.ndarray:
        """(3,) acceleration of gravity [m/s^2]."""
        return self.plant.mjcf.gravity_W

    @functools.cached_property
    def effects(self) -> np.ndarray:
        """The records (1,) of the effects of the water, of the scenario and of the true vehicle."""
        return effects_of(self.scenario, self.plant)

    @functools.cached_property
    def effect_rows(self) -> dict[str, np.ndarray]:
        """The tables of numbers (n, width) of these effects, by their keys."""
        return effect_rows(effect_tables(self.scenario))

    @functools.cached_property
    def swells(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """Of each wall the rows (n, 7) of its displacement and its turn with the sea."""
        sea, situation = self.scenario.sea, situation_of(self.scenario, self.plant)
        return tuple(swell(wall, sea, situation) for _, wall in self.contacts.walls)

    @functools.cached_property
    def effect_slopes(self) -> np.ndarray:
        """The slopes (6, 12) of the wrench of these effects by pose and velocity at rest."""
        return shipped_slopes(self)

    @property
    def advancing(self) -> list[str]:
        """The keys of the effects of the water whose states advance from step to step."""
        return advancing(effect_tables(self.scenario), situation_of(self.scenario, self.plant))

    @functools.cached_property
    def mean_water(self) -> MeanWater:
        """The water without what varies with time."""
        return MeanWater(self.scenario, self.plant, self.effects)

    @property
    def initial_joints(self) -> np.ndarray:
        """(n,) positions of the joints at the start [rad or m]."""
        return self.vehicle.arm.start(self.scenario.initial.joints)

    @property
    def joint_inertia(self) -> np.ndarray:
        """(n,) inertia that each motor feels at the start while all else is free, by the vehicle's file: the inverses
        of the diagonal of M(q)^-1 [kg m^2 or kg]."""
        M = Statics(self.nominal, self.initial_joints).inertia()
        return 1.0 / np.diag(np.linalg.inv(M))[6:]

    @functools.cached_property
    def initial(self) -> Initial:
        """The initial pose of the frame of the task."""
        return task_start(self.scenario, self.nominal)

    @functools.cached_property
    def interface(self) -> Joints:
        """The joint interface of the run."""
        return self.scenario.joints.resolved(self)

    @functools.cached_property
    def rest_pose(self) -> tuple[tuple[float, ...] | None, tuple[float, ...]]:
        """Position [m] and attitude [deg] of the reference at the end of the run; no position if it does not rest."""
        scenario = self.scenario
        if self.initial is not scenario.initial:
            scenario = dataclasses.replace(scenario, initial=self.initial)
        return scenario.reference.rest_pose(scenario)

    @property
    def at_tool(self) -> bool:
        """Whether the frame of the task is a site."""
        return self.scenario.task.frame != BODY

    @property
    def not_rigid(self) -> str:
        """The reason why the run does not follow the equations of a rigid vehicle at B; empty if it does."""
        if self.nominal.arm.links:
            return f"{self.vehicle.body} has joints"
        return "" if self.scenario.task.frame == BODY else f"task.frame is {self.scenario.task.frame!r}"

    @property
    def no_simple_form(self) -> str:
        """The first reason why a simple formula along x does not give the force at rest; empty if one does.

        It needs a rigid vehicle whose task is at B, and which touches ``[wall]`` with its probe alone and without
        friction, true measurements, thrusters that produce each wrench as commanded within their limits, g_hat = g, a
        constant current and disturbance, and a reference that comes to rest aligned with the wall. Every key has its
        default but those on which the force at rest does not depend, or which a formula has in it.
        """
        if self.not_rigid:
            return self.not_rigid
        for field in dataclasses.fields(self.scenario):
            if field.name not in _FREE:
                reason = _changed(field.name, getattr(self.scenario, field.name), field.default)
                if reason:
                    return reason
        if axes_spanned(self.nominal.B) < 6:
            return "the thrusters can't produce every wrench"
        if self.vehicle.products:
            return f"{self.vehicle.body} has products of velocities"
        if self.rest_pose[0] is None:
            return "the reference does not come to rest"
        if np.abs(self.design.normal - np.eye(6)[0]).max() > _ALIGNED:
            return "the reference is not aligned with the wall"
        return ""

    @functools.cached_property
    def contacts_at_rest(self) -> tuple[ContactAtRest, ...]:
        """All contacts, as the law meets them at the desired pose."""
        target = np.array(self.rest_pose[0] or self.initial.position)
        return tuple(self.contacts.at_rest(target, rotation_matrix(self.design.quat_d)))

    @property
    def certificate(self) -> Any:
        """The :class:`uvms_mj.control.theory.certificate.Certificate` of the law, or None if it has none. Raises
        InputError if a gain is too large or too small to compute with, or the method of a user's law fails."""
        return predictions.certificate(self)

    @functools.cached_property
    def start(self) -> Statics:
        """The true vehicle in its initial posture."""
        return Statics(self.vehicle, self.vehicle.arm.start(self.scenario.initial.joints))

    def initial_poses(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Positions (3,) and attitudes (3, 3) in W of the frames that contact bodies are fixed to, at the start."""
        initial = self.scenario.initial
        p_WB, R_WB = np.array(initial.position), rotation_matrix(quat_from_euler_deg(*initial.attitude_deg))
        poses = (self.start.pose(carrier) for carrier in self.contacts.carriers)
        return [(p_WB + R_WB @ p, R_WB @ R) for p, R in poses]

    def lightest(self, pair: Pair) -> float:
        """Least effective mass at a contact in any direction, in the initial posture; at one that the engine solves,
        along the wall's face [kg]."""
        if pair.solved:
            return self.mass_along_face()
        carrier = self.contacts.carriers[pair.carrier]
        rigid = carrier.is_B and not self.vehicle.arm.links
        M = self.design.M if rigid else np.linalg.inv(self.start.mobility(carrier))
        return lightest_at(M, pair.ends_C, pair.radius)

    def mass_along_normal(self) -> float:
        """Effective mass at the contact point along the wall's normal [kg]."""
        return self.design.along_normal(self.design.M)

    def mass_along_face(self) -> float:
        """Least effective mass at the contact point along the wall's face [kg]."""
        return lightest_along_face(self.design.M, rotation_matrix(self.design.quat_d), self.plant.probe.radius)


def set_up(scenario: Scenario, mjcf: Mjcf | None = None) -> Setup:
    """Build the plant of a scenario and compute its design. The arguments are as for
    :func:`uvms_mj.plant.build.build`. Raises InputError as it does, or if the desired impedance is not physical."""
    plant, contacts, inertias = build(scenario, mjcf)
    return Setup(scenario, plant, Design.of(scenario, *inertias), contacts)


def _changed(name: str, table: Any, default: Any) -> str:
    """A sentence with the first key of a table that has not its default and is not free; empty if there is none."""
    if isinstance(default, Stage) and type(table) is not type(default):
        return _needs(f"{name}.name", default.name)
    if not dataclasses.is_dataclass(table):
        return "" if table == default else _needs(name, default)
    free = ("period",) if isinstance(default, Stage) else _FREE_KEYS.get(name, ())
    if isinstance(default, EffectTable):
        free = default.free
    for field in dataclasses.fields(table):
        normal = getattr(default, field.name)
        if field.name not in free and getattr(table, field.name) != normal:
            return _needs(f"{name}.{field.name}", normal)
    return ""


def _needs(key: str, default: Any) -> str:
    value = f"with {key}={json.dumps(default)}" if default not in (None, ()) else f"without {key}"
    return f"the formula of this law holds {value} only"
