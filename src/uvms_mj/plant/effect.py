r"""Effects of the water of a user's own, each a stage: a force on the true vehicle that no law sees.

An effect is a frozen dataclass of settings that derives from :class:`Effect`. Its static method ``wrench`` sets the
wrench tau (6,) about B's origin in B from what it is given: the time, the pose, the velocity, the velocity relative to
the water, the current and the thrusts::

    @dataclass(frozen=True)
    class Brush(Effect):
        "A brush under the hull, whose drag grows with the push."
        k: float = setting(30.0, "N s/m", "drag over the velocity along x")

        @staticmethod
        def wrench(settings, state, given, state_dot, tau):
            tau[:] = 0.0
            tau[0] = -settings.k * given.nu_r[0]

It acts from its instant t_k on, as all forces of a step do; by default it has an instant at each time step. It may have
states. A scenario lists effects, ``effects = [{name = "my_effect.py:Brush", k = 30.0}]``. Each wrench is a signal of
the log. Shipped effects of the water have tables of their own (:mod:`uvms_mj.physics.effects`).
"""

from __future__ import annotations  # so that help(Effect) shows short type names

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..physics.frames import to_body
from ..stages.base import Room, Stage
from ..stages.signals import EFFECT_WRENCH, effect_given


@dataclass(frozen=True)
class Effect(Stage):
    """Base class of all effects. A setting and a state are declared as in any stage."""

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


class Surroundings(Stage):
    """The record ``given`` of effects."""

    name = "surroundings"
    every_step = True
    room: ClassVar[Room] = Room("effects", "surroundings", effect_given, (EFFECT_WRENCH,))

    @staticmethod
    def step(settings, run, given, state_dot, out):
        true, produced = run.true, run.commands.u_cmd
        given.p_WB[:], given.quat_WB[:], given.nu[:] = true.p_WB, true.quat_WB, true.nu
        given.R_WB[:], given.v_c_W[:] = true.R_WB, true.v_c_W
        to_body(true.R_WB, true.v_c_W, given.nu_r)
        given.nu_r[:3], given.nu_r[3:] = true.nu[:3] - given.nu_r[:3], true.nu[3:]
        if run.ideal == 0:
            produced = run.thrust
        given.u[:] = np.minimum(run.high, np.maximum(run.low, produced))
