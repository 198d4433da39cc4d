r"""The motion to a rest as machine code: the equations of :mod:`.approach`, :mod:`.task_motion` and :mod:`.balance`.

The kernels take the steps (:mod:`.motion_steps`) under the force of the law (:mod:`.motion_force`) with the terms of
the balance (:mod:`.motion_terms`), on one record (:mod:`.motion_record`). A law gives its residual as a kernel, with a
record of its gains. Three things have no kernel and are
followed in Python: an effect of a user's own, a sheared current and a residual in Python; tests compare both ways.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...physics.kernels import kernel, machine_code
from .approach import ENDLESS, FIRST_STEP, LOST, MOST_STEPS, NO_ROOT, polished
from .motion_record import ERRORS, MOST_THRUSTERS, MOTION, ROW, WAY
from .motion_steps import DERIVATIVES, FOLLOW, FORCE, HAS_NO_ROOT, IS_ENDLESS, IS_LOST, IS_SINGULAR, asked
from .motion_terms import balanced, desired
from .task_motion import MOST_SAMPLES, TaskMotion, Track, Way
from .terms import Balance, Memory, Pose, ThrustMap

_REASONS = {IS_LOST: LOST, IS_ENDLESS: ENDLESS, HAS_NO_ROOT: NO_ROOT}


@dataclass(frozen=True)
class Compiled:
    """The residual of a law as machine code.

    Attributes:
        entry: :func:`asked` with the residual in its world, a function of all arrays and of what is asked.
        gains: (1,) record of the law's settings in the residual.
    """

    entry: Callable[..., int]
    gains: np.ndarray


_NONE = np.zeros(1, np.dtype([("none", "f8")]))


@kernel
def _keeping(motion, gains, body, effects, pairs, surfaces, way, track, what):
    return asked(motion, (gains, body, effects, pairs, surfaces, desired), way, track, what)


@kernel
def _nominal(motion, gains, body, effects, pairs, surfaces, way, track, what):
    return asked(motion, (gains, body, effects, pairs, surfaces, balanced), way, track, what)


KEEPING, NOMINAL = Compiled(_keeping, _NONE), Compiled(_nominal, _NONE)
"""Of :meth:`.terms.Balance.demanded` and of :class:`.terms.Balance`."""


class RigidMotion(TaskMotion):
    """A :class:`.task_motion.TaskMotion` that machine code follows.

    Args:
        compiled: the residual of the law.
        balance, memory, thrust_map, wrench: as of :class:`.task_motion.TaskMotion`.
    """

    def __init__(
        self,
        compiled: Compiled,
        balance: Balance,
        memory: Memory | None = None,
        thrust_map: ThrustMap | None = None,
        wrench: np.ndarray | None = None,
    ) -> None:
        super().__init__(balance, lambda _, pose: -self._asked(FORCE, pose), memory, thrust_map, wrench)
        self._record = np.zeros(1, MOTION)
        self._way_rows, self._track_rows = np.zeros(MOST_SAMPLES + 1, WAY), np.zeros(MOST_STEPS + 1, ROW)
        springs = balance.springs
        arrays = (self._record, compiled.gains, balance.body, balance.effects, springs.pairs, springs.surfaces)
        self._code = machine_code(compiled.entry, *arrays, self._way_rows, self._track_rows)
        if self.known:
            self._set()

    @property
    def known(self) -> bool:
        """Whether there is machine code, and it has all terms of the balance."""
        few = self.thrust_map is None or len(self.thrust_map.inverse) <= MOST_THRUSTERS
        plain = self.balance.own_effects is None and self.balance.setup.scenario.constant_flow
        return few and plain and self._code is not None

    def _set(self) -> None:
        """Write the settings to the record."""
        record, balance, setup = self._record[0], self.balance, self.balance.setup
        design, vehicle, nominal, scenario = setup.design, setup.vehicle, setup.nominal, setup.scenario
        for name in ("K_d", "D_d", "M_d", "M", "M_hat", "M_d_inv"):
            record[name] = getattr(design, name)
        record["M_hat_inv"], record["undelivered"] = balance.M_hat_inv, balance.undelivered
        record["delivered"], record["M_d_by_M"] = not balance.undelivered.any(), design.M_d @ np.linalg.inv(design.M)
        record["wrench"], record["inertia"], record["M_RB"] = self.wrench, self.inertia, vehicle.M_RB
        record["factor_inverse"], record["F_1"] = balance.factor_inverse, setup.task.F_1
        record["tau_dist"], record["v_c_W"] = balance.tau_dist, scenario.mean_flow_W
        record["uses_truth"], record["integrates"] = balance.uses_truth, np.isinf(balance.K)
        record["largest"], record["sharp"] = self.largest, self.sharp
        record["p_end"], record["quat_end"] = self._end
        record["memory"], record["pairs"] = self.memory is not None, len(balance.springs)
        own = record["nominal"]
        for name in ("M_A", "M_RB", "D_linear", "D_quadratic", "mass", "displaced_mass", "r_g", "r_b"):
            own[name] = getattr(nominal, name)
        for name in ("inertia", "damping", "coriolis", "restoring"):
            own[name] = getattr(scenario.estimates, name)
        own["gravity_W"] = setup.gravity_W
        self._sense()
        if self.thrust_map is not None:
            n = len(self.thrust_map.inverse)
            _, record["least"][:n], record["most"][:n] = self.thrust_map.thrusts(np.zeros(6))
            record["B"][:, :n], record["shares"][:n] = vehicle.B, self.thrust_map.shares

    def _sense(self) -> None:
        """Write the errors of the measurements."""
        sensed, errors = self._record[0]["sensed"], self.balance.errors
        sensed["observed"] = self.balance.setup.scenario.observer.runs
        sensed["perfect"] = not dataclasses.is_dataclass(errors)  # shipped navigation has constant errors, or none
        for name in () if sensed["perfect"] else ERRORS:
            sensed[name] = getattr(errors, name)

    def _asked(self, what: int, pose: Pose) -> np.ndarray:
        """The force (6,) at a pose, and for DERIVATIVES the derivatives in the record."""
        record, balance = self._record[0], self.balance
        asked = record["asked"]
        asked["position"], asked["quat"], asked["R_WB"], asked["tau_c"] = (
            pose.position,
            pose.quat,
            pose.R_WB,
            pose.tau_c,
        )
        record["p_d"], record["quat_d"], record["K_f"], record["F_d"] = (
            balance.p_d,
            balance.quat_d,
            balance.K_f,
            balance.F_d,
        )
        record["nu_at_rest"], record["h"] = self._at_rest, math.inf if self.memory is None else self.memory.step
        assert self._code is not None
        self._code(what)
        return np.array(record["free"])

    def _derivatives(self, pose: Pose, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self._asked(DERIVATIVES, pose)
        return np.array(self._record[0]["by_pose"]), np.array(self._record[0]["by_wrench"])

    def follow(self, way: Way) -> None:
        super().follow(way)
        times, positions, quats = way
        n, record, rows = len(times), self._record[0], self._way_rows
        rows["t"][:n], rows["position"][:n], rows["quat"][:n] = times, positions, quats
        record["follows"], record["samples"], record["scheduled"] = 1, n, self._schedule is not None
        if self._schedule is not None:
            for name in ("times", "ramps", "values"):
                record[name] = getattr(self._schedule, name)

    def rest_from(
        self, pose: Pose, velocity: np.ndarray, step: float = FIRST_STEP, steps: int = MOST_STEPS
    ) -> Pose | str:
        record, balance = self._record[0], self.balance
        for name in ("nu_d", "nu_d_before", "led", "nu_at_rest", "value", "next", "rows", "limited_s", "known"):
            record[name] = 0
        y = record["y"]
        y["position"], y["quat"], y["R_WB"], y["tau_c"] = pose.position, pose.quat, pose.R_WB, pose.tau_c
        record["velocity"], record["first"], record["steps"] = velocity, step, steps
        record["beside"], record["led_on"], record["limits"] = self.beside, self.led, self.limits
        record["ends"], record["h"] = self.ends, math.inf
        record["K_f"], record["F_d"] = balance.K_f, balance.F_d
        assert self._code is not None
        status = self._code(FOLLOW)
        rows = self._track_rows[: record["rows"]].copy()
        poses = [_pose(each) for each in rows["pose"]]
        self.track, self._lacked = Track(rows["t"].tolist(), poses), list(rows["lacked"])
        self.limited_s, self._seen = float(record["limited_s"]), rows
        balance.p_d, balance.quat_d, balance.K_f, balance.F_d = (
            np.array(record[name]) for name in ("p_d", "quat_d", "K_f", "F_d")
        )
        self._from, self._step = _pose(record["origin"]), float(record["step"])
        self._nu_d = np.array(record["nu_d_before"]), np.array(record["nu_d"])
        self._led, self._latest, self._law, self._by_water = np.array(record["led"]), (None, None), None, None
        self._before = None
        if self.memory is not None:
            self.memory.step = float(record["h"])
        if status in _REASONS:
            return _REASONS[status]
        found = _pose(record["y"])
        if status == IS_SINGULAR:
            return polished(self, found)
        return self.leaves(found) or found

    @property
    def saturates(self) -> bool:
        return self.thrust_map is not None and bool(self._seen["saturates"].any())

    def unmodelled(self) -> tuple[np.ndarray, np.ndarray]:
        return self._seen["t"][1:], self._seen["unmodelled"][1:]


def _pose(record: Any) -> Pose:
    return Pose(*(np.array(record[name]) for name in ("position", "quat", "R_WB", "tau_c")))
