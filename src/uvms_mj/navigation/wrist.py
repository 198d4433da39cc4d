r"""A force and torque sensor between a link of an arm and its parent, and the contact force that is derived from it.

The sensor is rigid, and carries the link with all links behind it. It measures the wrench that the parent exerts on
them, which their inertia, the water and their weight need, less what a wall gives:

.. math::

    W = \sum_{behind} \big( M_{RB} a + C_{RB}(\nu) \nu + M_A a_r + C_A(\nu_r) \nu_r + D(\nu_r) \nu_r + g \big) - \tau_c

in the sensor's frame S, about its origin; :math:`a_r` and :math:`\nu_r` are relative to the water. The accelerations
are taken from the last time step, because the present ones depend on the torque that the measurement decides.

The contact wrench that a law is given is the reading without the share of a model of the links behind the sensor, from
the measured state and the coefficients of ``[estimates]``:

.. math:: \tau_c \approx W_{model} - W_m

The model has no term (``none``), the weight in water (``weight``), or also inertia, Coriolis and drag in still water
(``dynamic``) with the differences of the measured velocities over one period as accelerations.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from ..errors import Fault, InputError
from ..physics.frames import add_wrench_from, compose_poses, to_body, to_world, wrench_at
from ..physics.kernels import kernel
from ..physics.tree import (
    coriolis_wrench,
    damping_wrench,
    hand_down,
    measured_frames,
    move,
    move_frame,
    restoring_wrench,
)
from ..quantities import Lowercase
from ..stages.base import Room, Stage, setting
from ..stages.setup import ScenarioLike, SetupLike
from ..stages.signals import CLOCK, MEASURED, TRUE, WRIST_READING, WRIST_TRUE, wrist_given
from .channel import MEMORY, measure
from .sensors import channel_faults, channel_of, channel_settings


@kernel
def carried_wrench(links, frames, gravity_B, first, moving, q_dot, q_ddot, part):
    """Set F of the link ``first`` to the wrench that keeps it and all that it carries in their motion, or at rest if
    ``moving`` is 0, without contacts. Frames, gravity, and V and A of the base are set; ``part`` is (6,) scratch."""
    for k in range(1, links.shape[0]):
        link, frame = links[k], frames[k]
        move(link, frame.S, links[frame.parent], q_dot[k - 1])
        link.A += frame.S * q_ddot[k - 1]
        move_frame(link, frame)
    for k in range(first, links.shape[0]):
        link, frame = links[k], frames[k]
        restoring_wrench(link, frame, gravity_B, link.F)
        if moving != 0:
            coriolis_wrench(link, part)
            add_wrench_from(frame.R_BL, frame.p_BL, part, link.F)
            damping_wrench(link, link.nu, part)
            add_wrench_from(frame.R_BL, frame.p_BL, part, link.F)
    for k in range(links.shape[0] - 1, first, -1):
        hand_down(links[k], links[frames[k].parent])


@kernel
def place_sensor(sensor, frame):
    """Set the pose of the sensor in B from the pose of the link behind it."""
    compose_poses(frame.R_BL, frame.p_BL, sensor.R_LT, sensor.p_LT, sensor.R_BT, sensor.p_BT)


@kernel
def felt_wrench(run, true, out):
    """Set out (6,) to the true wrench of the parent on the links behind the sensor, in S."""
    wrist, water, frames, q_dot, q_ddot = run.wrist, run.plant.water, run.plant.frames, run.encoder.q_dot, run.q_ddot
    rigid, wet, nu, nu_dot, first = wrist.rigid[0], wrist.wet[0], true.nu, true.nu_dot, wrist.sensor.link
    v_c = true.R_WB.T @ true.v_c_W
    rigid.V[:], rigid.A[:] = nu, nu_dot
    wet.V[:3], wet.V[3:], wet.A[3:] = nu[:3] - v_c, nu[3:], nu_dot[3:]
    wet.A[:3] = nu_dot[:3] + np.cross(nu[3:], v_c) - true.R_WB.T @ water.v_c_dot_W  # v_r_dot
    to_body(true.R_WB, wrist.gravity_W, wrist.rigid_gravity_B)
    to_body(true.R_WB, wrist.gravity_W - water.a_c_W, wrist.wet_gravity_B)  # of the displaced water
    carried_wrench(wrist.rigid, frames, wrist.rigid_gravity_B, first, 1, q_dot, q_ddot, wrist.work)
    carried_wrench(wrist.wet, frames, wrist.wet_gravity_B, first, 1, q_dot, q_ddot, wrist.work)
    solid, around = wrist.rigid[first], wrist.wet[first]
    solid.F += around.F
    if run.carriers.shape[0] != 0:
        release(run, solid)
    place_sensor(wrist.sensor, frames[first])
    wrench_at(wrist.sensor.R_BT, wrist.sensor.p_BT, solid.F, out)


@kernel
def release(run, first):
    """Subtract the contact forces on the links behind the sensor from F of the first of them."""
    frames, wrist, tau_B = run.plant.frames, run.wrist, np.zeros(6)
    for k in range(run.carriers.shape[0]):
        carrier = run.carriers[k]
        above = carrier.link
        for _ in range(frames[carrier.link].depth):
            if above == wrist.sensor.link:
                add_wrench_from(carrier.R_BC, carrier.p_BC, carrier.tau, tau_B)
            above = frames[above].parent
    first.F -= tau_B


@kernel
def modelled_wrench(run, instant, period, R_WB, nu):
    """Set ``modelled`` (6,) to the wrench without contacts by the model, from the measured state."""
    wrist, q_dot = run.wrist, run.joints.q_dot_m
    base, first, before, q_ddot = wrist.model[0], wrist.sensor.link, wrist.nu_before, wrist.q_ddot
    base.V[:], base.A[:], q_ddot[:] = nu, 0.0, 0.0
    if instant > 0:
        base.A[:], q_ddot[:] = (nu - before) / period, (q_dot - wrist.q_dot_before) / period
    before[:], wrist.q_dot_before[:] = nu, q_dot
    to_body(R_WB, wrist.gravity_W, wrist.gravity_B)
    frames = measured_frames(run)
    carried_wrench(wrist.model, frames, wrist.gravity_B, first, wrist.dynamic, q_dot, q_ddot, wrist.work)
    place_sensor(wrist.sensor, frames[first])
    wrench_at(wrist.sensor.R_BT, wrist.sensor.p_BT, wrist.model[first].F, wrist.modelled)


@kernel
def contact_behind(wrist, R_WB, out):
    """Set the measured contact force in W and the wrench at B of ``out`` to the reading without the model's share."""
    contact, tau = np.zeros(6), out.tau_contact_m_B  # contact: in S
    if wrist.weighs != 0:
        contact[:] = wrist.modelled
    contact -= wrist.reading
    tau[:] = 0.0
    add_wrench_from(wrist.sensor.R_BT, wrist.sensor.p_BT, contact, tau)
    to_world(R_WB, tau, out.f_contact_m_W)


@dataclass(frozen=True)
class WristLoad(Stage):
    """The wrench that the wrist sensor is exposed to. ``state`` is the record of the run."""

    name = "felt"
    room: ClassVar[Room] = Room("navigation", "felt", lambda thrusters: CLOCK + TRUE, (WRIST_TRUE,))

    def period_in(self, scenario: ScenarioLike) -> float:
        """The period of the wrist sensor [s]."""
        return scenario.wrist.period_in(scenario)

    @staticmethod
    def step(settings, state, given, state_dot, out):
        felt_wrench(state, given, out)


@dataclass(frozen=True)
class WristCompensation(Stage):
    """The contact force and wrench that are derived from the reading. ``state`` is the record of the run."""

    name = "derived"
    room: ClassVar[Room] = Room("navigation", "derived", lambda thrusters: CLOCK + MEASURED[:4], MEASURED[4:])

    def period_in(self, scenario: ScenarioLike) -> float:
        """The period of navigation [s]."""
        return scenario.navigation.period_in(scenario)

    @staticmethod
    def step(settings, state, given, state_dot, out):
        modelled_wrench(state, given.instant, given.period, given.R_WB, given.nu)
        contact_behind(state.wrist, given.R_WB, out)


QUANTITIES = ("force", "moment")


@dataclasses.dataclass(frozen=True)
class Wrist(Stage):
    """Base class of all force and torque sensors in an arm. ``given`` has CLOCK and ``wrench_S`` (6,), the true wrench,
    and reading (6,) is the sensor's."""

    site: str = setting(
        "", "-", "link behind the sensor, or a site on that link whose frame is S; S is else the link's"
    )
    compensation: Annotated[Literal["none", "weight", "dynamic"], Lowercase] = setting(
        "weight", "-", "model of the links behind the sensor: none, weight or dynamic"
    )

    room: ClassVar[Room] = Room(
        name="navigation",
        table="wrist",
        given=wrist_given,
        out=(WRIST_READING,),
        noun="wrist sensor",
        arguments=("settings", "state", "given", "state_dot", "reading"),
        counts="joints",
    )

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The settings that are numbers."""
        return {name: value for name, value in super().constants(setup).items() if not isinstance(value, str)}

    def carried(self, setup: SetupLike) -> tuple[int, Any]:
        """Index of the link behind the sensor, and the site that is S, or None. Raises InputError if there is none."""
        arm = setup.vehicle.arm
        names = [link.name for link in arm.links]
        if self.site in names:
            return names.index(self.site), None
        site = arm.sites.get(self.site)
        if site is not None and site.link >= 0:
            return site.link, site
        known = [*names, *(name for name, each in arm.sites.items() if each.link >= 0)]
        wanted = f"is neither a link nor a site on one; choose from {', '.join(known)}"
        raise InputError([Fault("wrist.site", f"{self.site!r} {wanted}")], "scenario")

    def faults(self, setup: SetupLike) -> Iterator[Fault]:
        if not setup.vehicle.arm.links:
            yield Fault("wrist.name", f"{self.label()!r} is for a vehicle with joints; {setup.vehicle.body} has none")
            return
        if setup.scenario.observer.runs:
            yield Fault("observer.name", "an observer and a wrist sensor would both set the measured force; choose one")
        try:
            self.carried(setup)
        except InputError as error:
            yield from error.faults

    @staticmethod
    def step(settings, state, given, state_dot, reading):
        """Set reading (6,) and state_dot from settings, state and given."""
        raise NotImplementedError


@dataclasses.dataclass(frozen=True)
class NoWrist(Wrist):
    """No sensor in the arm: navigation sets the measured force."""

    name = "none"
    runs: ClassVar[bool] = False

    def check_settings(self) -> None:
        super().check_settings()
        if self.site or self.period is not None:
            raise InputError([Fault("wrist.name", "none has no site and no period; choose wrist.name = sensor")])


_SETTINGS = list(channel_settings(*QUANTITIES, frame="in S"))
_Channels: Any = dataclasses.make_dataclass("_Channels", _SETTINGS, bases=(Wrist,), frozen=True)


@dataclasses.dataclass(frozen=True)
class WristSensor(_Channels):
    """A sensor of six axes with range, resolution, noise, bias, drift, delay and lost samples; by default without
    errors."""

    name = "sensor"
    memory: ClassVar = dict.fromkeys(QUANTITIES, MEMORY)

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The packed channels by quantity."""
        step = self.period_in(setup.scenario)
        return {quantity: channel_of(self, quantity).pack(step) for quantity in QUANTITIES}

    def faults(self, setup: SetupLike) -> Iterator[Fault]:
        yield from super().faults(setup)
        yield from channel_faults(self, QUANTITIES, self.period_in(setup.scenario))

    @staticmethod
    def step(settings, state, given, state_dot, reading):
        measure(settings.force, state.force, given.wrench_S, 0, given.instant, given.key, 0, reading)
        measure(settings.moment, state.moment, given.wrench_S, 3, given.instant, given.key, 1, reading)


WRISTS: dict[str, type[Wrist]] = {cls.name: cls for cls in (NoWrist, WristSensor)}
