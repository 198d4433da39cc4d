r"""Effects of the water of a user's own, each a stage: a force on the true vehicle that no law sees.

An effect is a frozen dataclass of settings that derives from :class:`Effect`. Its static method ``wrench`` sets the
wrench tau (6,) about B's origin in B from its arguments: the time, the pose, the velocity, the velocity relative to
the water, the current and the thrusts::

    @dataclass(frozen=True)
    class Brush(Effect):
        "A brush under the hull, which resists motion along x."
        k: float = setting(30.0, "N s/m", "drag over the velocity along x")

        @staticmethod
        def wrench(settings, state, given, state_dot, tau):
            tau[:] = 0.0
            tau[0] = -settings.k * given.nu_r[0]

It acts at B, or with ``at`` in the frame of a link or of a site of the vehicle: then pose, velocities and wrench are
in this frame, about its origin and in its axes, and the joints carry their part of it.

It acts from its instant t_k on, as all forces of a step do; by default it has an instant at each time step. It may have
states. A scenario lists effects, ``effects = [{name = "my_effect.py:Brush", k = 30.0}]``. Each wrench is a signal of
the log. Shipped effects of the water have tables of their own (:mod:`uvms_mj.physics.effects`).
"""

from __future__ import annotations  # so that help(Effect) shows short type names

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..errors import Fault, InputError
from ..physics.contacts import place_carrier, wrench_at_origin
from ..physics.frames import BODY, attitude, to_body
from ..physics.kernels import kernel
from ..physics.vehicle import VehicleLike
from ..stages.base import Room, Stage, shared
from ..stages.contract import signals_read
from ..stages.setup import SetupLike
from ..stages.signals import EFFECT_WRENCH, effect_given
from .contacts import Carrier, carrier_at, no_carrier


@dataclass(frozen=True)
class Effect(Stage):
    """Base class of all effects. A setting and a state are declared as in any stage."""

    at: str = shared(
        BODY, "-", "link or site in whose frame it acts, for example a tool; default: the vehicle's frame B"
    )

    every_step: ClassVar[bool] = True
    room: ClassVar[Room] = Room(
        name="effects",
        table="effects",
        given=effect_given,
        out=(EFFECT_WRENCH,),
        noun="effect",
        method="wrench",
        arguments=("settings", "state", "given", "state_dot", "tau"),
        several=True,
    )

    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        """Set tau (6,) and state_dot from settings, state and given."""
        raise NotImplementedError

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """The settings without the frame, which is no number."""
        return {name: value for name, value in super().constants(setup).items() if name != "at"}

    def carrier(self, vehicle: VehicleLike) -> Carrier:
        """The frame in which it acts. Raises InputError if the vehicle has no link and no site of this name."""
        if (found := carrier_at(self.at, vehicle.arm)) is None:
            raise InputError([Fault(f"{self.room.table}.at", no_carrier(self.at, vehicle.arm))])
        return found

    def faults(self, setup: SetupLike) -> Iterator[Fault]:
        try:
            carrier = self.carrier(setup.vehicle)
        except InputError as error:
            yield from error.faults
            return
        if carrier.link >= 0 and setup.scenario.wrist.runs:
            yield Fault(
                f"{self.room.table}.at", f"{self.at!r} is on a link, and the wrist sensor knows no effect there"
            )


def numbers_of(effects: Sequence[Stage]) -> list[str]:
    """The suffixes of the names of signals of effects, so that several of one class differ: ``_0``, ``_1`` by their
    places in the list, none for the only one of a class."""
    names = [type(effect).__name__ for effect in effects]
    return [f"_{i}" if names.count(each) > 1 else "" for i, each in enumerate(names)]


@kernel
def at_frame(run, frame, given):
    """Set pose and velocity in an effect's record, which are B's, to a CARRIER record's."""
    place_carrier(run, frame)
    given.p_WB[:], given.R_WB[:], given.nu[:] = frame.p_WC, frame.R_WC, frame.nu
    attitude(frame.R_WC, given.quat_WB)


@kernel
def set_normal_forces(run, link, given):
    """Set the normal forces of the springs of all contacts on a link: their sum in W, and their wrench at the origin of
    the effect's frame, in its axes. They follow from the state of the instant, whatever applies them."""
    given.f_normal_W[:], given.tau_normal_B[:] = 0.0, 0.0
    for k in range(run.pair_count):
        pair = run.pairs[k]
        carrier, contact, p_WC = run.carriers[pair.carrier], pair.contact, run.true.p_WB
        if contact.touching != 0 and carrier.link == link:
            tau = np.zeros(6)
            if run.carried.shape[0] != 0:
                p_WC = carrier.p_WC
            f_W = pair.f_n * contact.normal_W
            wrench_at_origin(given.R_WB, p_WC + contact.arm_W - given.p_WB, f_W, tau)
            given.f_normal_W += f_W
            given.tau_normal_B += tau


class Surroundings(Stage):
    """The records ``given`` of effects, without those signals that take time and that no effect reads."""

    name = "surroundings"
    every_step = True
    room: ClassVar[Room] = Room("effects", "surroundings", effect_given, (EFFECT_WRENCH,))

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """Whether some effect of the run may read a signal, by its name."""
        read = frozenset[str]().union(*(signals_read(type(effect)) for effect in setup.scenario.effects))
        return {signal.name: signal.name in read for signal in self.given()}

    @staticmethod
    def step(settings, run, given, state_dot, out):
        true = run.true
        pressed = settings.f_normal_W or settings.tau_normal_B
        posed = pressed or settings.p_WB or settings.quat_WB or settings.R_WB
        for k in range(run.around.shape[0]):
            around, R_WB, produced, link = run.around[k], true.R_WB, run.commands.u_cmd, 0
            if run.plant.effect_frames.shape[0] != 0:
                at_frame(run, run.plant.effect_frames[k], around)
                R_WB, link = around.R_WB, run.plant.effect_frames[k].link
            else:
                around.nu[:] = true.nu
                if posed:
                    around.p_WB[:], around.quat_WB[:], around.R_WB[:] = true.p_WB, true.quat_WB, true.R_WB
            around.v_c_W[:] = true.v_c_W
            to_body(R_WB, true.v_c_W, around.nu_r)
            around.nu_r[:3], around.nu_r[3:] = around.nu[:3] - around.nu_r[:3], around.nu[3:]
            if run.pairs.shape[0] != 0 and pressed:
                set_normal_forces(run, link, around)
            if settings.u:
                if run.ideal == 0:
                    produced = run.thrust
                around.u[:] = np.minimum(run.high, np.maximum(run.low, produced))
