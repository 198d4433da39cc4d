"""The contract of guidance: a stage that sets the reference."""

from __future__ import annotations  # so that help(Guidance) shows short type names

import contextlib
import dataclasses
import functools
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from ..errors import Fault, InputError, shortened
from ..physics.frames import quat_from_euler_deg, rotation_matrix
from ..physics.kernels import called_on, kernel, record_of
from ..quantities import Angles
from ..stages.base import Room, Stage, random_key, shared
from ..stages.setup import ScenarioLike, SetupLike
from ..stages.signals import CLOCK, MEASURED, REFERENCE, record_dtype

_REFERENCES = record_dtype(REFERENCE)
_FAR, _TURNED = 0.01, 1.0
"""A reference that begins farther from the vehicle than this is a jump [m, deg]."""
_TRIALS, _SLOW, _ROUGH = 7, 1e-4, 0.1
"""Number of comparisons of p_d_dot with differences of p_d, and the absolute [m/s] and relative error that passes."""
_MANY = 100
"""So many samples of a shipped stage are taken as plain Python, without its machine code."""


@dataclasses.dataclass(frozen=True)
class Guidance(Stage):
    """Base class of all guidance. ``given`` has the signals CLOCK and MEASURED of :mod:`uvms_mj.stages.signals`, and
    ``out`` has REFERENCE. Besides its fields, ``settings`` has quat_d (4,), the quaternion of attitude_deg.
    """

    attitude_deg: Angles = shared((0.0, 0.0, 0.0), "deg", "constant desired roll, pitch, yaw")

    ending: ClassVar[tuple[str, ...]] = ()
    """Names of constants that are tables with a row for each time, the times first, of which those at infinity never
    come: a law that leaves takes along the rows that do."""
    room: ClassVar[Room] = Room(
        name="guidance",
        table="reference",
        given=lambda thrusters: CLOCK + MEASURED,
        out=REFERENCE,
        optional=("omega_d", "omega_d_dot"),
        noun="guidance stage",
        constants=("quat_d",),
        theory=("rests_at", "notes"),
    )

    def check_settings(self) -> None:
        super().check_settings()
        position = self.rests_at()
        if position is None:
            return
        three = len(position) == 3 if isinstance(position, tuple) else np.shape(position) == (3,)
        if not (three and all(map(math.isfinite, position))):
            what = f"rests_at returned {shortened(position)}: it must return three numbers [m] or None"
            raise InputError([Fault("reference", f"{self.label()}.{what}")])

    @staticmethod
    def step(settings, state, given, state_dot, out):
        """Set p_d, p_d_dot, p_d_ddot, quat_d, and for a moving attitude omega_d and omega_d_dot of out, and state_dot,
        from settings, state and given."""
        raise NotImplementedError

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        quat_d = quat_from_euler_deg(*self.attitude_deg)
        return {**super().constants(setup), "attitude_deg": None, "quat_d": quat_d}

    def rests_at(self) -> tuple[float, ...] | None:
        """Theory of the reference: its position at the end of the run, in W [m], or None if it does not come to rest. A
        stage may override it."""
        return None

    def rest_pose(self, scenario: ScenarioLike) -> tuple[tuple[float, ...] | None, tuple[float, ...]]:
        """The position of :meth:`rests_at` and the attitude [deg] at the end of a run, from its scenario."""
        return self.rests_at(), self.attitude_deg

    def force_at_rest(self) -> tuple[float, ...] | None:
        """The force of the wall (3,) in the frame of the task that the reference demands at rest by its depth [N];
        None if the law's F_d decides it."""
        return None

    def way(self, setup: SetupLike, times: np.ndarray) -> tuple[np.ndarray, np.ndarray] | str:
        """Theory of the reference: its positions (n, 3) [m] and attitudes (n, 4) in W at times (n,) [s], or the reason
        why they are not known before the run."""
        if self.states or self.memory:
            return "the reference has states, so that its way is not known before the run"
        period = self.period_in(setup.scenario)
        try:
            with np.errstate(all="ignore"), contextlib.redirect_stdout(io.StringIO()):
                found = samples(self, setup, [round(t / period) for t in times.tolist()])
        except KeyboardInterrupt:
            raise
        except BaseException:  # a user's function may raise anything
            return "the way of the reference is not known before the run"
        if not (np.isfinite(found["p_d"]).all() and np.isfinite(found["quat_d"]).all()):
            return "the way of the reference is not known before the run"
        return found["p_d"], found["quat_d"]

    def notes(self, setup: SetupLike) -> Iterable[str]:
        """Theory of the reference: warnings for a run, from its :class:`uvms_mj.setup.base.Setup`. A stage may
        override it. By default a user's stage without states is tried out: its beginning, and p_d_dot."""
        return () if self.is_shipped or self.states or self.memory else _trial_notes(self, setup)


def start_notes(stage: Guidance, setup: SetupLike) -> Iterator[str]:
    """A warning if a stage without states begins far from the vehicle, which the law sees as a jump."""
    initial, (out,) = setup.initial, samples(stage, setup, [0])
    away = float(np.linalg.norm(out["p_d"] - initial.position))
    cosine = min(1.0, abs(float(out["quat_d"] @ quat_from_euler_deg(*initial.attitude_deg))))
    turned = math.degrees(2.0 * math.acos(cosine))
    if away > _FAR or turned > _TURNED:
        frame, its = setup.scenario.task.frame, ", ".join(f"{angle:.4g}" for angle in initial.attitude_deg)
        whose = "the vehicle's initial pose" if frame == "body" else f"the initial pose of {frame}, at [{its}] deg"
        yield (
            f"the law sees a jump at the start: {stage.label()} begins {away:.3g} m and {turned:.3g} deg from {whose}"
        )


def _trial_notes(stage: Guidance, setup: SetupLike) -> list[str]:
    """The warnings about a user's stage without states. One that raises has none: the run reports it."""
    try:
        with np.errstate(all="ignore"), contextlib.redirect_stdout(io.StringIO()):
            return [*start_notes(stage, setup), *_rate_notes(stage, setup)]
    except KeyboardInterrupt:
        raise
    except BaseException:  # a user's function may raise anything
        return []


def _rate_notes(stage: Guidance, setup: SetupLike) -> Iterator[str]:
    """A warning if p_d_dot is clearly not the derivative of p_d, from the differences over one period at the beginnings
    of :data:`_TRIALS` equal parts of the run."""
    period = stage.period_in(setup.scenario)
    instants = [round(k * setup.scenario.simulation.duration / (_TRIALS * period)) for k in range(_TRIALS)]
    found = samples(stage, setup, [instant + late for instant in instants for late in (0, 1)])
    change = (found["p_d"][1::2] - found["p_d"][::2]) / period
    mean = 0.5 * (found["p_d_dot"][1::2] + found["p_d_dot"][::2])
    wrong = np.abs(change - mean) > _SLOW + _ROUGH * np.maximum(np.abs(change), np.abs(mean))
    for k, axis in np.argwhere(wrong)[:1]:
        yield (
            f"{stage.label()}: p_d_dot[{axis}] is not the derivative of p_d: at {instants[k] * period:.4g} s it is "
            f"{mean[k, axis]:.3g} m/s, and p_d[{axis}] changes by {change[k, axis]:.3g} m/s"
        )


def samples(stage: Guidance, setup: SetupLike, instants: Sequence[int]) -> np.ndarray:
    """The references (k,) that a stage without states sets at instants, while the vehicle stays at its initial pose. A
    shipped stage is machine code for many instants, any other one plain Python. A signal that the stage leaves unset is
    nan."""
    initial, period = setup.initial, stage.period_in(setup.scenario)
    settings, given = stage.record(setup), np.zeros(1, record_dtype(CLOCK + MEASURED))
    given["p_WB"], given["quat_WB"] = initial.position, quat_from_euler_deg(*initial.attitude_deg)
    given["R_WB"], given["period"] = rotation_matrix(given["quat_WB"][0]), period
    given["key"] = random_key(setup.scenario.simulation.seed, stage, setup.scenario.vehicle.name)
    out = np.zeros(1, _REFERENCES)
    for name in ("p_d", "p_d_dot", "quat_d"):
        out[name] = np.nan
    function, found = stage.function(), np.zeros(len(instants), _REFERENCES)
    call = functools.partial(function, record_of(settings), None, record_of(given), None, record_of(out))
    if stage.is_shipped and len(instants) > _MANY:
        no_state = type(stage).start_record()
        call = called_on(function, settings, no_state, given, no_state, out)
    t, number = given["t"], given["instant"]
    for k, instant in enumerate(instants):
        t[0], number[0] = instant * period, instant
        call()
        found[k] = out[0]
    return found


@kernel
def station_keep(settings, given, out):
    """Rest at the position of the first instant with the attitude attitude_deg. A stage that calls it first sets only
    the rest of its reference."""
    if given.instant == 0:
        out.p_d[:] = given.p_WB
    out.p_d_dot[:], out.p_d_ddot[:] = 0.0, 0.0
    out.quat_d[:], out.omega_d[:], out.omega_d_dot[:] = settings.quat_d, 0.0, 0.0
