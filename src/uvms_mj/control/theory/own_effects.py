"""Effects of a user's own at rest: the closed forms call their functions as plain Python.

An effect is known at rest if it has no states and no memory, and its wrench depends on pose, velocity, current and, of
a rigid vehicle at B, the normal forces of its contacts alone.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...errors import error_text
from ...physics.effects import WRENCHES, add_effects, counted
from ...physics.frames import add_wrench_from, attitude, motion_at, quat_turned, rotation_matrix, to_body
from ...physics.kernels import record_of
from ...stages.base import ForeignCode, Stage
from ...stages.setup import SetupLike
from ...stages.signals import NORMAL_FORCE

_SMALL = 1e-6
"""Differences of pose and velocity for slopes [SI]."""
_OTHER = "the wrench of an effect depends on more than it is given"
_UNKNOWN = {"u": "the thrusts", "t": "the time", "instant": "the time", "key": "random numbers", "period": "its period"}


_OF_CONTACTS = tuple(signal.name for signal in NORMAL_FORCE)
Contacts = Callable[[], np.ndarray]
"""Gives the normal forces of all contacts at a pose as a wrench (6,) at B's origin in B [N, N m]."""


def no_contact() -> np.ndarray:
    """The :data:`Contacts` of a vehicle that touches nothing."""
    return np.zeros(6)


class NotKnownAtRest(Exception):
    """A closed form needs an effect where it is not known. The message is the reason."""


class _Given:
    """The record of a function at rest, in a frame on the base. The contacts are computed where it asks for them."""

    def __init__(self, frame: Any, contacts: Contacts | None, **known: np.ndarray) -> None:
        self._frame, self._contacts, self._known = frame, contacts, known

    def _pressed(self) -> dict[str, np.ndarray]:
        """The normal forces of the contacts in W, and their wrench in the frame."""
        if self._contacts is None:
            raise NotKnownAtRest("the wrench of an effect depends on contacts, which are known of a rigid vehicle at B")
        (f, m), p, R = np.split(self._contacts(), 2), self._frame.p, self._frame.R
        R_WB = self._known["R_WB"] @ R.T
        tau = np.concatenate([R.T @ f, R.T @ (m - np.cross(p, f))])
        return dict(zip(_OF_CONTACTS, (R_WB @ f, tau), strict=True))

    def __getitem__(self, name: str) -> Any:
        if name in _OF_CONTACTS and name not in self._known:
            self._known |= self._pressed()
        if name in _UNKNOWN:
            raise NotKnownAtRest(f"the wrench of an effect depends on {_UNKNOWN[name]}")
        return self._known[name]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in (*self._known, *_OF_CONTACTS, *_UNKNOWN):
            raise AttributeError(f"an effect is given no {name!r}")
        return self[name]


def _at(frame: Any, at_B: dict[str, Any]) -> dict[str, Any]:
    """The inputs of an effect in a frame on the base, from the inputs at B."""
    found = at_B | {"p_WB": at_B["p_WB"] + at_B["R_WB"] @ frame.p, "R_WB": at_B["R_WB"] @ frame.R}
    for name in ("nu", "nu_r"):
        found[name] = np.empty(6)
        motion_at(frame.R, frame.p, np.asarray(at_B[name]), found[name])
    found["quat_WB"] = np.array([1.0, 0.0, 0.0, 0.0])
    attitude(found["R_WB"], found["quat_WB"])
    return found


def longest_step(setup: SetupLike, slopes: np.ndarray) -> float:
    """The time step of the run, or the longest of its halves, that resolves effects with these slopes (6, 12) of
    :meth:`OwnEffects.slopes` [s].

    A semi-implicit Euler step of M nu_dot = K x + D nu has eigenvalues with a negative real part beyond the unit circle
    where a motion changes its sign in each step and grows."""
    K, D = np.hsplit(np.linalg.solve(setup.vehicle.M, slopes), 2)
    h = setup.scenario.simulation.timestep
    while True:
        by_nu = np.eye(6) + h * D
        values = np.linalg.eigvals(np.block([[np.eye(6) + h * h * K, h * by_nu], [h * K, by_nu]]))
        if not ((np.abs(values) > 1.0 + _SMALL) & (values.real < 0.0)).any():
            return h
        h /= 2.0


def shipped_slopes(setup: SetupLike) -> np.ndarray:
    """The slopes (6, 12) of the wrench of the shipped effects, as :meth:`OwnEffects.slopes`, about the desired attitude
    at rest in the mean current nu_c. By a rotation vector theta the velocity in the water changes by theta x nu_c."""
    if not any(name in WRENCHES for name, _ in counted(setup.effects)):
        return np.zeros((6, 12))
    effects, nu_c, slopes = record_of(setup.effects), np.zeros(6), np.zeros((6, 12))
    v_c_W = setup.mean_water.flow(np.array(setup.rest_pose[0] or setup.initial.position))
    to_body(rotation_matrix(setup.design.quat_d), v_c_W, nu_c)
    for k, step in enumerate(_SMALL * np.eye(6)):
        for sign in (1.0, -1.0):
            tau = np.zeros(6)
            add_effects(effects, sign * step - nu_c, tau)
            slopes[:, 6 + k] += sign * tau / (2.0 * _SMALL)
    slopes[:, 3:6] = slopes[:, 6:9] @ np.cross(np.eye(3), nu_c[:3]).T
    return slopes


class OwnEffects:
    """The effects of a scenario that a user has written."""

    def __init__(self, effects: Sequence[Any], setup: SetupLike) -> None:
        self._calls: list[tuple[Any, Any, Any, Stage, Any]] = []
        self._untouched = None if setup.not_rigid else no_contact
        for effect in effects:
            kind = type(effect)
            state = record_of(kind.start_record(len(setup.vehicle.thrusters)))
            call = kind.function(), record_of(effect.record(setup)), state, effect, effect.carrier(setup.vehicle)
            self._calls.append(call)

    def unknown(self) -> str:
        """The reason why they are not known at rest; empty if they are."""
        for _, _, _, effect, frame in self._calls:
            if type(effect).states or type(effect).memory:
                return f"the effect {effect.label()} has states"
            if frame.link >= 0:
                return f"the effect {effect.label()} acts on a link"
        q = np.array([1.0, 0.0, 0.0, 0.0])
        at = np.zeros(3), q, np.eye(3), np.zeros(6), np.full(6, 0.1), np.zeros(3), self._untouched
        try:
            first, again = self.wrench(*at), self.wrench(*at)
        except NotKnownAtRest as reason:
            return str(reason)
        return "" if np.array_equal(first, again) else f"{_OTHER}: at one pose it differs from call to call"

    def slopes(self, setup: SetupLike, tau_c: np.ndarray | None = None) -> np.ndarray:
        """The slopes of the wrench in B by displacement and rotation vector in B and by nu, (6, 12), about the desired
        pose at rest in the mean current; under the normal forces tau_c (6,) of contacts also by these, (6, 18).
        Raises NotKnownAtRest."""
        p, quat = np.array(setup.rest_pose[0] or setup.initial.position), setup.design.quat_d
        v_c_W, R_0 = setup.mean_water.flow(p), rotation_matrix(quat)
        n, pressed = (12, np.zeros(6)) if tau_c is None else (18, tau_c)

        def wrench(x: np.ndarray) -> np.ndarray:
            turned = quat_turned(quat, x[3:6])
            R, nu, now = rotation_matrix(turned), x[6:12], pressed.copy()
            if n > 12:
                now += x[12:]
            nu_r = nu.copy()
            nu_r[:3] -= R.T @ v_c_W
            contacts = self._untouched and (lambda: now)
            return self.wrench(p + R_0 @ x[:3], turned, R, nu, nu_r, v_c_W, contacts)

        steps = _SMALL * np.eye(n)
        return np.column_stack([(wrench(x) - wrench(-x)) / (2.0 * _SMALL) for x in steps])

    @property
    def names(self) -> str:
        return ", ".join(effect.label() for _, _, _, effect, _ in self._calls)

    def longest_step(self, setup: SetupLike) -> float:
        """:func:`longest_step` for them alone [s]."""
        return longest_step(setup, self.slopes(setup))

    def feed(self, setup: SetupLike, tau_c: np.ndarray | None = None) -> bool:
        """Whether a motion of the vehicle with them grows about rest without a law, by their slopes over nu, free or
        under the normal forces tau_c (6,) of contacts."""
        D = self.slopes(setup, tau_c)[:, 6:12] - setup.vehicle.D_linear
        return bool((np.linalg.eigvals(np.linalg.solve(setup.vehicle.M, D)).real > _SMALL).any())

    def not_in_the_loop(self, setup: SetupLike) -> str:
        """The reason why the loop about rest of a rigid vehicle does not know them; empty if it does."""
        if reason := self.unknown():
            return reason
        try:
            self.slopes(setup)
        except NotKnownAtRest as reason:
            return str(reason)
        return ""

    def wrench(
        self, p: np.ndarray, quat: np.ndarray, R: np.ndarray, nu: Any, nu_r: Any, v_c_W: Any,
        contacts: Contacts | None = None,
    ) -> np.ndarray:  # fmt: skip
        """The sum (6,) of their wrenches about B's origin in B, at a pose and a velocity under the forces of contacts.
        Raises NotKnownAtRest, also at one pose alone: a branch may ask for the time."""
        total = np.zeros(6)
        at_B = {"p_WB": p, "quat_WB": quat, "R_WB": R, "nu": nu, "nu_r": nu_r, "v_c_W": v_c_W}
        for function, settings, state, effect, frame in self._calls:
            given = at_B if frame.is_B else _at(frame, at_B)
            tau, dot = np.zeros(6), np.zeros(0)
            try:
                with np.errstate(all="ignore"):  # as in a run
                    known = {name: np.array(each) for name, each in given.items()}
                    function(settings, state, _Given(frame, contacts, **known), dot, tau)
            except NotKnownAtRest:
                raise
            except ForeignCode:
                wrong = f"the effect {effect.label()} is machine code, which closed forms do not call"
                raise NotKnownAtRest(wrong) from None
            except Exception as error:  # a user's function may raise anything
                wrong = f"the effect {effect.label()} can't be called at rest: {error_text(error)}"
                raise NotKnownAtRest(wrong) from None
            if frame.is_B:
                total += tau
            else:
                add_wrench_from(frame.R, frame.p, tau, total)
        if not np.isfinite(total).all():
            raise NotKnownAtRest("an effect is not finite at rest")
        return total
