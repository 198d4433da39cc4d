"""Desired impedance, estimates and desired attitude of a run. The loop and the closed forms share them."""

import dataclasses
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import AfterValidator
from pydantic.dataclasses import dataclass as table

from ..errors import Fault, InputError
from ..physics.frames import quat_from_euler_deg, rotation_matrix
from ..quantities import (
    STRICT,
    Damping,
    Factor,
    Factors,
    Inertia,
    Number,
    PositiveFactor,
    Step,
    Stiffnesses,
    Wrench,
    doc,
    within,
)
from ..stages.setup import ScenarioLike
from .task import Change, in_order


@table(frozen=True, config=STRICT)
class Impedance:
    of_world: ClassVar[bool] = False
    K_d: Stiffnesses = doc("desired stiffness, diagonal [N/m, N m]", (150.0, 1500.0, 1500.0, 50.0, 50.0, 50.0))
    M_d: Inertia = doc(
        'desired inertia, diagonal or 6x6, or "natural": M_hat of each instant; default: M of the vehicle\'s file', None
    )
    D_d: Damping = doc("desired damping, diagonal or 6x6; default: Ott's design", None)
    K_f: Factors = doc("force gain, diagonal, eq. (7) [1]", (1.0,) * 6)
    F_d: Wrench = doc("wrench that the wall should exert on the vehicle, in B, eq. (7) [N, N m]", (0.0,) * 6)
    schedule: Annotated[tuple[Change, ...], AfterValidator(in_order)] = doc(
        "K_f and F_d over time: [{time = 10.0, K_f = [...], F_d = [...], ramp = 2.0}, ...], from time to time + ramp; "
        "at most 100 [s, 1, N, N m]",
        (),
    )
    damping_ratio: Annotated[Number, within(0.0, 1e3, "")] = doc(
        "damping ratio of Ott's design, used if D_d is not given [1]", 1.0
    )
    damping_period: Step = doc("time from one D_d of Ott's design to the next, used if M_d is natural [s]", 1e-3)

    @property
    def natural(self) -> bool:
        """Whether M_d is M_hat of each instant."""
        return isinstance(self.M_d, str)

    @property
    def at_end(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """K_f and F_d after the last entry of the schedule."""
        K_f = next((change.K_f for change in reversed(self.schedule) if change.K_f is not None), self.K_f)
        F_d = next((change.F_d for change in reversed(self.schedule) if change.F_d is not None), self.F_d)
        return K_f, F_d


def _named_once(links: "tuple[LinkEstimates, ...]") -> "tuple[LinkEstimates, ...]":
    names = [link.name for link in links]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"has two tables of {', '.join(map(repr, twice))}; give one")
    return links


@table(frozen=True, config=STRICT)
class LinkEstimates:
    """One table of ``[[estimates.links]]``: the factors of one link in place of the factors of ``[estimates]``."""

    name: str
    inertia: PositiveFactor | None = None
    coriolis: Factor | None = None
    damping: Factor | None = None
    restoring: Factor | None = None


@table(frozen=True, config=STRICT)
class Estimates:
    of_world: ClassVar[bool] = False
    inertia: PositiveFactor = doc("M_hat = f M of the vehicle's file; f is this key [1]", 1.0)
    coriolis: Factor = doc("C_hat(nu) nu = f C(nu) nu of the vehicle's file; f is this key [1]", 1.0)
    damping: Factor = doc("D_hat(nu) nu = f D(nu) nu of the vehicle's file; f is this key [1]", 1.0)
    restoring: Factor = doc("g_hat(eta) = f g(eta) of the vehicle's file; f is this key [1]", 1.0)
    links: Annotated[tuple[LinkEstimates, ...], AfterValidator(_named_once)] = doc(
        "factors of single links in place of the factors above: [{name = ..., inertia = ..., coriolis = ..., "
        "damping = ..., restoring = ...}, ...] [1]",
        (),
    )

    def of(self, link: str) -> "Estimates":
        """The factors of a link by its name."""
        own = next((each for each in self.links if each.name == link), None)
        if own is None:
            return self
        given = {key: value for key, value in vars(own).items() if value is not None}
        return dataclasses.replace(self, **{key: value for key, value in given.items() if key != "name"})


INNER_TABLES = {"impedance.schedule": Change, "estimates.links": LinkEstimates}
"""The tables within a table, by their key."""


@dataclass(frozen=True, eq=False)
class Design:
    """Constant matrices of a run, (6, 6) in the frame of the task unless another shape is given. Of a vehicle with
    joints, the inertias belong to the initial posture."""

    M: np.ndarray
    """True inertia, added mass included; at a tool Lambda."""
    M_hat: np.ndarray
    M_d: np.ndarray
    M_d_inv: np.ndarray
    D_d: np.ndarray
    K_d: np.ndarray
    quat_d: np.ndarray
    """(4,) desired attitude."""
    normal: np.ndarray
    """(6,) the wall's normal (x of W) in B at the desired attitude, as a wrench."""

    @classmethod
    def of(cls, scenario: ScenarioLike, M: np.ndarray, nominal: np.ndarray, M_hat: np.ndarray) -> "Design":
        """Matrices of a run, from its :class:`uvms_mj.scenario.Scenario` and the inertias (6, 6) of the true vehicle,
        of its file and of the estimates. Raises InputError if M_d is not symmetric positive definite, or D_d is not
        dissipative."""
        impedance: Impedance = scenario.impedance
        faults = []
        inertia = (
            nominal.tobytes() if impedance.M_d is None else M_hat.tobytes() if impedance.natural else impedance.M_d
        )
        try:
            M_d, M_d_inv = _inertia(inertia)
        except ValueError as error:
            faults.append(Fault("impedance.M_d", str(error)))
        try:
            if impedance.D_d is not None or not faults:
                D_d, K_d = _damping(inertia, impedance.D_d, impedance.K_d, impedance.damping_ratio)
        except ValueError as error:
            faults.append(Fault("impedance.D_d", str(error)))
        if faults:
            raise InputError(faults, "scenario")
        quat_d, normal = _attitude(*scenario.reference.rest_pose(scenario)[1])
        return cls(M, M_hat, M_d, M_d_inv, D_d, K_d, quat_d, normal)

    def along_normal(self, inertia: np.ndarray, normal: np.ndarray | None = None) -> float:
        """Effective mass of an inertia (6, 6) along a normal (6,), with all other directions free [kg]; by default
        along the wall's."""
        inverse, n = _inertia(inertia.tobytes())[1], self.normal if normal is None else normal
        return 1.0 / float(n.dot(inverse).dot(n))


def ott_damping(M_d: np.ndarray, K_d: np.ndarray, damping_ratio: float) -> np.ndarray:
    """Desired damping D_d (6, 6) [N s/m, N s, N m s] from the generalised eigenvalue problem of K_d and M_d.

    With M_d = Q^T Q and K_d = Q^T diag(k) Q, D_d = Q^T diag(2 zeta sqrt(k)) Q gives every mode of M_d x'' + D_d x' +
    K_d x = 0 the damping ratio zeta. Source: Ott (2008), sec. 3.3.
    M_d is (6, 6) symmetric positive definite [kg, kg m, kg m^2], K_d (6, 6) symmetric positive semi-definite [N/m, N,
    N m], and damping_ratio is zeta [1].
    """
    L, L_inv, _ = _factor(M_d.tobytes())
    return _damped(*_modes_of(L, L_inv.dot(K_d).dot(L_inv.T)), damping_ratio)


def wall_normal(quat_d: np.ndarray) -> np.ndarray:
    """(6,) the wall's normal (x of W) in B at an attitude (4,), as a wrench."""
    normal = np.zeros(6)
    normal[:3] = rotation_matrix(quat_d)[0]
    return normal


_remembered = functools.lru_cache(maxsize=8)
"""A reset of a Simulation computes only the matrices that no reset before has computed."""


@_remembered
def _inertia(given: Any) -> tuple[np.ndarray, ...]:
    """M_d and its inverse; M_d is a tuple, or the vehicle's M as bytes. Raises ValueError if it is not symmetric
    positive definite."""
    if _is_diagonal(given):
        if min(given) <= 0.0:
            raise ValueError("is not positive definite")
        return _frozen(_diagonal(given), _diagonal(1.0 / np.array(given)))
    M_d = _matrix(given)
    if (M_d != M_d.T).any() and np.abs(M_d - M_d.T).max() > 1e-9 * np.abs(M_d).max():
        raise ValueError("is not symmetric")
    return _frozen(M_d, _factor(given)[2])


@_remembered
def _factor(M_d: Any) -> np.ndarray:
    """The Cholesky factor L of M_d = L L^T, its inverse, and the inverse of M_d, which is rows of numbers or bytes.
    Raises ValueError if there is none."""
    found = np.empty((3, 6, 6))
    found[2] = _matrix(M_d)
    try:
        found[0] = found[1] = np.linalg.cholesky(found[2])
    except np.linalg.LinAlgError:
        raise ValueError("is not positive definite") from None
    found[1:] = np.linalg.inv(found[1:])  # one call is quicker than two
    return found


@_remembered
def _modes(M_d: Any, K_d: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """:func:`_modes_of` M_d as :func:`_factor` takes it and a diagonal K_d."""
    L, L_inv, _ = _factor(M_d)
    return _modes_of(L, (L_inv * K_d).dot(L_inv.T))


def _modes_of(L: np.ndarray, K: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Q^T (6, 6) with Q^T Q = M_d and Q^T diag(k) Q = K_d, and the square roots of k (6,), for M_d = L L^T and
    K = L^-1 K_d L^-T."""
    k, V = np.linalg.eigh(K)
    return L.dot(V), np.sqrt(np.maximum(k, 0.0))


def _damped(Q_T: np.ndarray, root: np.ndarray, damping_ratio: float) -> np.ndarray:
    return (Q_T * (2.0 * damping_ratio * root)).dot(Q_T.T)  # np.dot is three times as fast as @ for matrices this small


@_remembered
def _damping(M_d: Any, D_d: Any, K_d: tuple[float, ...], damping_ratio: float) -> tuple[np.ndarray, ...]:
    """D_d, or if it is None, :func:`ott_damping` of M_d as :func:`_inertia` takes it; and K_d. Raises ValueError if the
    symmetric part of D_d is not positive semi-definite."""
    stiffness = _diagonal(K_d)
    if D_d is None and _is_diagonal(M_d):
        D = _diagonal([2.0 * damping_ratio * math.sqrt(m * k) for m, k in zip(M_d, K_d, strict=True)])
    elif D_d is None:
        D = _damped(*_modes(M_d, K_d), damping_ratio)
    else:
        D = _diagonal(D_d) if _is_diagonal(D_d) else np.array(D_d)
        if (min(D_d) if _is_diagonal(D_d) else np.linalg.eigvalsh(D + D.T)[0]) < 0.0:
            raise ValueError("is not dissipative: its symmetric part is not positive semi-definite")
    return _frozen(D, stiffness)


@_remembered
def _attitude(roll: float, pitch: float, yaw: float) -> tuple[np.ndarray, ...]:
    """The desired attitude (4,) and the wall's normal (6,)."""
    quat_d = quat_from_euler_deg(roll, pitch, yaw)
    return _frozen(quat_d, wall_normal(quat_d))


def _diagonal(values: Sequence[float] | np.ndarray) -> np.ndarray:
    matrix = np.zeros((6, 6))
    matrix.flat[::7] = values
    return matrix


def _matrix(given: Any) -> np.ndarray:
    return np.frombuffer(given).reshape(6, 6) if isinstance(given, bytes) else np.array(given)


def _is_diagonal(given: Any) -> bool:
    return isinstance(given[0], float)


def _frozen(*arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    for array in arrays:
        array.setflags(write=False)
    return arrays


def demanded_force(scenario: ScenarioLike, k_c: float | None = None) -> float:
    r"""The pushing force on a wall at rest that the desired impedance demands, for any disturbance [N].

    With eq. (7) at rest, K_d eta_e = K_f (tau_c - F_d), and the wall's spring (34) along its normal n in B,

    .. math:: F = \max\left(0, \frac{x_d - x_c - n^\top K_d^{-1} K_f F_d}{n^\top K_d^{-1} K_f n + 1/k_c}\right)

    For the paper's K_f = I, F_d = 0 this is K_x (x_d - x_c) / (1 + K_x / k_c), and K_x (x_d - x_c) for a rigid wall. If
    K_d is zero along n, it is the force demanded by F_d. F_d must be without moments. A bumper is in series with the
    wall, 1/k_c + 1/k_b. The result is infinite for a rigid wall and K_f = 0, and NaN for a reference that does not come
    to rest, or if the probe and ``[wall]`` are not the only contact.

    Args:
        scenario: with reference, wall and impedance.
        k_c: stiffness of the wall [N/m], infinite for a rigid one; default: the scenario's.
    """
    impedance, wall = scenario.impedance, scenario.wall
    if not wall.present or scenario.walls or scenario.vehicle.contact_bodies:
        return math.nan
    target, attitude_deg = scenario.reference.rest_pose(scenario)
    normal = wall_normal(quat_from_euler_deg(*attitude_deg))
    K_f, K_d, F_d = (np.array(values) for values in (impedance.at_end[0], impedance.K_d, impedance.at_end[1]))
    pushed = np.abs(normal) > 1e-12
    n, K_d, K_f, F_d = normal[pushed], K_d[pushed], K_f[pushed], F_d[pushed]
    limp = K_d == 0.0
    if limp.any():  # without a spring, eq. (7) is K_f (F n + F_d) = 0
        forces = -F_d[limp] / n[limp]
        return max(0.0, float(forces[0])) if K_f[limp].all() and np.ptp(forces) < 1e-9 else 0.0
    give = K_f / K_d
    if target is None:
        return math.nan
    distance = target[0] - wall.position - float(n @ (give * F_d))
    yielding = float(n @ (give * n)) + 1.0 / (wall.stiffness if k_c is None else k_c)
    yielding += 1.0 / (scenario.bumper.stiffness or math.inf)
    return max(0.0, distance / yielding) if yielding > 0.0 else math.inf if distance > 0.0 else 0.0
