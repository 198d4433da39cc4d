r"""The terms of the static balance, which :mod:`.balance` explains: the wrenches at rest, the thrust behind a commanded
wrench, integrals with a limit, and the static force of the list of contacts at many poses at once, by the
kernel :func:`uvms_mj.physics.contacts.pair_force` without velocity, dampers and friction.

The allocation gives the commands, :math:`u_{cmd} = \hat B^+ \tau_{cmd}`, the thrusters turn each into a thrust by their
static curve, :math:`u = F(u_{cmd})`, and the true thrusters produce :math:`\tau = B u`. Lags, delays and the rate limit
do not matter at rest. For thrusters with a gain each, :math:`u = G u_{cmd}`, the wrench is
:math:`\tau = T \tau_{cmd}` with :math:`T = B G \hat B^+`.

Beyond its limit an integral keeps the limit (clamping, the simplest protection against windup). At rest it therefore
has a rate of zero, or it is at a limit and its rate points outwards. Both cases are one equation,

    xi = min(limit, max(-limit, xi + rate)),

which :func:`at_limit` gives as a residual.
"""

import dataclasses
import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...physics.contacts import AT_REST, PAIR, press_at_rest
from ...physics.fossen import IN_WATER, coriolis_added_mass, coriolis_rigid_body, damping, restoring, water_at_rest
from ...physics.frames import cross_products, quat_error, quat_turned, rotation_matrix
from ...physics.kernels import called_on, plain_on
from ...physics.spanned_axes import pseudoinverse
from ...physics.surfaces import SHAPES, SURFACE
from ...physics.vehicle import VehicleLike
from ...stages.setup import SetupLike
from .own_effects import OwnEffects

START_FORCE = 100.0
"""Force [N] below which a start inside the wall counts as a start in contact."""
DIFFERENCE = 1e-6
"""Change of a coordinate for a derivative [m, rad]."""
_AT_ONCE = 16
"""Poses in one call of machine code."""


class ContactSprings:
    """All contacts of a run, :class:`uvms_mj.plant.contacts.Contacts`, at rest and without friction: ``[wall]`` is the
    first wall, and its contact with the probe is a spring as any other one.

    Attributes:
        carriers: (n,) index of the frame that the body of each contact is fixed to.
        friction: (n,) whether each contact has friction.
        damping: (n,) of the walls, zero behind a bumper [N s/m].
        dissipation: (n,) damping over the normal force of a contact with restitution [s/m].
        convex: whether all walls are planes in front of the origin of C: then the poses without contact are a convex
            set, and the turn of C does not matter.
        size: least radius or half edge of a wall, infinite for planes [m].
        pairs, surfaces: PAIR and SURFACE records, with room behind them.
    """

    def __init__(self, setup: SetupLike) -> None:
        surfaces, pairs = setup.contacts.records(lambda _: 1.0)
        contact, shapes = pairs["contact"], list(SHAPES.values())
        self.carriers, self.friction = pairs["carrier"].copy(), contact["friction"] > 0.0
        self.damping = np.where(pairs["bumper_stiffness"] > 0.0, 0.0, contact["damping"])
        self.dissipation = pairs["dissipation"].copy()
        contact["friction"] = 0.0
        sizes = [(shapes[each["kind"]].size, each["extent"]) for each in surfaces]
        self.size = min((float(size(extent)) for size, extent in sizes if size is not None), default=math.inf)
        self.convex = math.isinf(self.size) and not pairs["ends_C"].any()
        # of a few sizes, each of which is machine code of its own
        n, room = len(pairs), 1 << max(3, (max(len(pairs), len(surfaces)) - 1).bit_length())
        self._n, self._at_rest = n, np.zeros((_AT_ONCE, room), AT_REST)
        self.surfaces, self.pairs = np.zeros(room, SURFACE), np.zeros(room, PAIR)
        self.surfaces[: len(surfaces)], self.pairs[:n] = surfaces, pairs
        self._press: Callable[..., Any] | None = None

    def __len__(self) -> int:
        return self._n

    def wrenches(
        self, p_WC: np.ndarray, R_WC: np.ndarray, nu: np.ndarray | None = None, once: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The forces of all contacts on their bodies, by :func:`uvms_mj.physics.contacts.pair_force`.

        Args:
            p_WC: (..., n, 3) position in W of the frame C that the body of each contact is fixed to [m].
            R_WC: (..., n, 3, 3) its attitude.
            nu: (..., n, 6) its velocity, in its own axes [m/s, rad/s]; default: at rest.
            once: whether nobody asks again, so that machine code is not worth its time.

        Returns:
            The wrench (..., n, 6) of each contact in C at its origin, its normal force (..., n) [N] and depth
            (..., n), zero without contact [m].
        """
        n, shape = self._n, p_WC.shape[:-2]
        if n == 0:
            return np.zeros((*shape, 0, 6)), np.zeros((*shape, 0)), np.zeros((*shape, 0))
        p, R = p_WC.reshape(-1, p_WC.shape[-2], 3), R_WC.reshape(-1, R_WC.shape[-3], 3, 3)
        moving = np.zeros((len(p), n, 6)) if nu is None else np.broadcast_to(nu, (*shape, n, 6)).reshape(-1, n, 6)
        found = np.empty((len(p), n), AT_REST)
        arrays = self.pairs, self.surfaces, self._at_rest
        if once:
            press = plain_on(press_at_rest, *arrays)
        else:
            press = self._press = self._press or called_on(press_at_rest, *arrays)
        for first in range(0, len(p), _AT_ONCE):
            m = min(_AT_ONCE, len(p) - first)
            at = self._at_rest[:m, :n]
            at["p_WC"], at["R_WC"], at["nu"] = (each[first : first + m] for each in (p, R, moving))
            press(n, m)
            found[first : first + m] = at
        f_n, depth = (found[name].reshape(*shape, n) for name in ("f_n", "depth"))
        return found["tau_C"].reshape(*shape, n, 6), f_n, depth

    def slopes(self, position: np.ndarray, R_WB: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The derivatives of :meth:`wrenches`, of bodies on the frame of the task at a position (3,) and an attitude
        (3, 3), by displacement and rotation vector (6,) in its own axes: of the wrenches (n, 6, 6), the normal forces
        (n, 6) and the depths (n, 6)."""
        changes, R = DIFFERENCE * np.concatenate([np.eye(6), -np.eye(6)]), R_WB @ rotation_matrix(_turns())
        p = position + changes[:, :3] @ R_WB.T
        found = self.wrenches(p[:, None], R[:, None])
        by_wrench, *by_numbers = ((each[:6] - each[6:]) / (2.0 * DIFFERENCE) for each in found)
        by_force, by_depth = (each.T for each in by_numbers)
        return by_wrench.transpose(1, 2, 0), by_force, by_depth

    def dampings(self, push: np.ndarray) -> np.ndarray:
        """The damping (n,) along the normal of contacts with the normal forces (n,) [N s/m]."""
        return np.where(push > 0.0, self.damping + self.dissipation * push, 0.0)


@functools.cache
def _turns() -> np.ndarray:
    """Attitudes (12, 4) after :data:`DIFFERENCE` of each coordinate, forward and backward."""
    changes = DIFFERENCE * np.concatenate([np.eye(6), -np.eye(6)])
    return np.array([quat_turned(np.array([1.0, 0.0, 0.0, 0.0]), change[3:]) for change in changes])


_ZERO = 1e-9
"""A smaller thrust at rest is zero [N]."""


@dataclass(frozen=True, eq=False)
class Pose:
    """The frame of the task at rest: position (3,) in W [m], attitude (4,) and (3, 3), and the contact wrench (6,) on
    it in its own axes [N, N m]."""

    position: np.ndarray
    quat: np.ndarray
    R_WB: np.ndarray
    tau_c: np.ndarray


@dataclass(frozen=True, eq=False)
class ThrustMap:
    """The map from tau_cmd to tau at rest, within the thrusters' limits.

    Attributes:
        setup: the run's :class:`uvms_mj.setup.base.Setup`, with its allocation and its thrusters.
        inverse: (n, 6) of the allocation.
        static: :class:`uvms_mj.actuation.thrusters.StaticThrust`.
        T: (6, 6), with gains of one if the static curve is not a gain.
    """

    setup: SetupLike
    inverse: np.ndarray
    static: Any
    T: np.ndarray

    @classmethod
    def of(cls, setup: SetupLike) -> "ThrustMap | str":
        """The map of a run, or the reason why it is not known."""
        static = setup.scenario.thrusters.at_rest(setup)
        if isinstance(static, str):
            return static
        inverse = setup.scenario.actuation.inverse(setup.nominal.B)
        gain = np.ones(len(inverse)) if static.gain is None else static.gain
        same = setup.vehicle.B is setup.nominal.B or np.array_equal(setup.vehicle.B, setup.nominal.B)
        ideal = same and bool((gain == 1.0).all())
        return cls(setup, inverse, static, np.eye(6) if ideal else (setup.vehicle.B * gain) @ inverse)

    def thrusts(self, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The thrusts (n,) that give tau (6,), and the least and the greatest ones (n,) [N]. Thrusters with a curve
        that the control system does not know are taken to share tau with the least thrust."""
        gain, thrust = self.static.gain, self.static.thrust
        low, high = self.setup.scenario.thrusters.command_limits(self.setup)
        if gain is None:
            return self.shares @ tau, thrust(low), thrust(high)
        working = gain > 0.0
        least, most = (np.where(working, np.where(working, gain, 1.0) * each, 0.0) for each in (low, high))
        return self.shares @ tau, least, most

    @functools.cached_property
    def shares(self) -> np.ndarray:
        """The thrusts (n, 6) per wrench."""
        if self.static.gain is None:
            return pseudoinverse(self.setup.vehicle.B)
        shares: np.ndarray = self.static.gain[:, None] * (self.inverse @ np.linalg.inv(self.T))
        return shares

    @property
    def limited(self) -> bool:
        """Whether the thrusters have limits."""
        return bool(np.isfinite(self.setup.scenario.thrusters.command_limits(self.setup)).any())

    def missing(self, tau: np.ndarray) -> np.ndarray:
        """The share of tau (6,) from thrusters at their limits, zero within them."""
        u, least, most = self.thrusts(tau)
        missing: np.ndarray = self.setup.vehicle.B @ (np.clip(u, least, most) - u)
        return missing

    def lost(self, limited: np.ndarray) -> np.ndarray:
        """The part (6, 6) of a change of tau that thrusters (n,) at their limits do not give."""
        found: np.ndarray = self.setup.vehicle.B @ (limited[:, None] * self.shares)
        return found

    def infeasible(self, tau: np.ndarray) -> str:
        """The reason why the thrusters can't hold tau (6,), with their names; empty if they can."""
        u, least, most = self.thrusts(tau)
        weak, starting = [], []
        for k, name in enumerate(self.setup.vehicle.thrusters):
            needs = f"{name or f'thruster {k + 1}'} needs {u[k]:.4g} N at rest"
            start = self.static.start[int(u[k] > 0.0)]
            if not least[k] <= u[k] <= most[k]:
                weak.append(f"{needs} and has {(most if u[k] > 0.0 else least)[k]:.4g} N")
            elif _ZERO < abs(u[k]) < abs(start) - _ZERO:
                starting.append(f"{needs} and starts at {start:.4g} N")
        if weak:
            return f"the thrusters are too weak: {'; '.join(weak)}"
        return f"the dead band of the thrusters: {'; '.join(starting)}" if starting else ""


class Balance:
    """Residual (6,) of the balance [N, N m] and its terms, functions of a :class:`Pose`. The residual is minus the
    wrench that moves the vehicle.

    Attributes:
        p_d, quat_d: position (3,) and attitude (4,) of the reference, first at the end of the run.
        K_f, F_d: (6,) of eq. (7), first at the end of the run.
        body: IN_WATER record (1,) of the vehicle.
        effects: records of the effects of the water.
    """

    def __init__(self, setup: SetupLike, K: float, thrust_map: ThrustMap, own: bool = False) -> None:
        scenario, design = setup.scenario, setup.design
        self.setup, self.K, self.springs = setup, K, ContactSprings(setup)
        self.p_d, self.quat_d = np.array(setup.rest_pose[0]), design.quat_d
        self.tau_dist, self.effects = setup.mean_water.push, setup.effects
        self.body = np.zeros(1, IN_WATER)
        self._in_water: Callable[..., Any] | None = None
        vehicle = setup.vehicle
        for name in ("M_A", "D_linear", "D_quadratic", "mass", "displaced_mass", "r_g", "r_b"):
            self.body[name] = getattr(vehicle, name)
        self.body["gravity_W"] = setup.gravity_W
        self.own_effects = OwnEffects(scenario.effects, setup) if scenario.effects else None
        self.A = np.array(setup.task.A)
        self.M_d_inv = design.M_d_inv
        self.M_hat_inv = np.linalg.inv(design.M_hat)
        self.undelivered = np.eye(6) - np.linalg.inv(thrust_map.T)
        self._delivered = not self.undelivered.any()
        self.K_f, self.F_d = (np.array(each) for each in scenario.impedance.at_end)
        self.factor_inverse = np.ones(6) if K == 0.0 else self.A / (self.A - K)
        self.uses_truth, self.own = scenario.controller.uses_truth, own
        self.errors = scenario.navigation.rest_errors(setup)
        self._seen: tuple[Pose | None, Any] = (None, None)

    def pose(self, position: np.ndarray, quat: np.ndarray) -> Pose:
        """A pose with its contacts."""
        R_WB = rotation_matrix(quat)
        return Pose(position, quat, R_WB, self.contacts(position, R_WB)[0])

    def moved(self, pose: Pose, change: np.ndarray) -> Pose:
        """The pose after a displacement (3,) and a rotation vector (3,) in its own axes."""
        return self.pose(pose.position + pose.R_WB @ change[:3], quat_turned(pose.quat, change[3:]))

    def contacts(self, position: np.ndarray, R_WB: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """tau_c (..., 6) of all contacts, eq. (34), and the normal force (..., n) of each, at positions (..., 3) and
        attitudes (..., 3, 3)."""
        wrench, push, _ = self.springs.wrenches(position[..., None, :], R_WB[..., None, :, :])
        return wrench.sum(axis=-2), push

    def flow(self, x: Pose) -> np.ndarray:
        """The velocity (3,) of the water at a pose, in B."""
        v_c: np.ndarray = x.R_WB.T @ self.setup.mean_water.flow(x.position)
        return v_c

    def contact_damping(self, x: Pose) -> np.ndarray:
        """The damping (6, 6) of the contacts that press at a pose, by nu in B. Bumpers have none."""
        wrench, push, _ = self.springs.wrenches(x.position[None], x.R_WB[None])
        along = wrench / np.where(push > 0.0, push, 1.0)[:, None]
        damping: np.ndarray = np.einsum("n,ni,nj->ij", self.springs.dampings(push), along, along)
        return damping

    def known(self, x: Pose) -> np.ndarray:
        """The change (6, 6) of the law's g_hat by the coordinates from a pose, at the measured attitude."""
        quat, found = self.measurement(x).quat, np.zeros((6, 6))
        for k, e in enumerate(DIFFERENCE * np.eye(3)):
            more, less = (self.restoring(self.setup.nominal, rotation_matrix(quat_turned(quat, x))) for x in (e, -e))
            found[:, 3 + k] = (more - less) / (2.0 * DIFFERENCE)
        return self.setup.scenario.estimates.restoring * found

    def rubs(self, push: np.ndarray) -> bool:
        """Whether friction acts in contacts with the normal forces (..., n)."""
        return bool((self.springs.friction & (push > 0.0)).any())

    def error(self, x: Pose) -> np.ndarray:
        """eta_e (6,) as the law measures it."""
        measured, quat_e = self.measurement(x), np.empty(4)
        quat_error(self.quat_d, measured.quat, quat_e)
        R_WB = x.R_WB if measured.quat is x.quat else rotation_matrix(measured.quat)
        return np.concatenate([R_WB.T @ (measured.position - self.p_d), quat_e[1:]])

    def demanded(self, x: Pose) -> np.ndarray:
        """K_d eta_e + D_d nu_e - K_f (tau_c - F_d) as the law measures them, zero where the desired impedance, eq. (7),
        holds at rest."""
        measured, design = self.measurement(x), self.setup.design
        forces = self.K_f * (measured.tau_c - self.F_d)
        return design.K_d @ self.error(x) + design.D_d @ measured.nu - forces

    def desired_acceleration(self, x: Pose) -> np.ndarray:
        """w = M_d^-1 times :meth:`demanded`."""
        return self.M_d_inv @ self.demanded(x)

    def measurement(self, x: Pose) -> Any:
        """The :class:`uvms_mj.navigation.base.Measurement` at a pose; of the latest pose it is kept."""
        if x is not self._seen[0]:
            measured = self.errors(x.position, x.quat, x.tau_c)
            if self.setup.scenario.observer.runs:
                explained = dataclasses.replace(measured, tau_c=x.tau_c)
                tau_c = x.tau_c + self.setup.design.M_hat @ self.unmodelled(x, explained)
                measured = dataclasses.replace(measured, tau_c=tau_c)
            self._seen = x, measured
        return self._seen[1]

    def drift(self, x: Pose) -> np.ndarray:
        """F_1 times the rate (6,) of the pose error that the law derives from a biased velocity, eq. (18)."""
        measured, quat_e = self.measurement(x), np.empty(4)
        if not measured.nu.any():
            return np.zeros(6)
        quat_error(self.quat_d, measured.quat, quat_e)
        v, omega = measured.nu[:3], measured.nu[3:]
        turning = 0.5 * (quat_e[0] * omega + cross_products(quat_e[1:], omega))
        return np.array(self.setup.task.F_1) * np.concatenate([v, turning])

    def sliding(self, x: Pose, limited: bool = False) -> np.ndarray | None:
        """s (6,) at rest: A s = F_1 eta_e_dot - w. None if s grows, as zeta integrates what the law does not answer to,
        or there is no task. With thrusters at their limits the law does not balance w."""
        if not self.setup.scenario.controller.uses_task:
            return None
        if not (self.uses_truth or self.own or limited) and (self.K > 0.0 or 0.0 not in self.A):
            return (self.unmodelled(x) - self.drift(x)) / (self.K - self.A) + 0.0  # zero has no sign
        left = self.drift(x) - self.desired_acceleration(x)
        if np.abs(left).max() < 1e-12:
            return np.zeros(6)
        return None if 0.0 in self.A else left / self.A

    def thrust(self, x: Pose, nu: np.ndarray | None = None) -> np.ndarray:
        """tau (6,) that holds the vehicle at rest, eq. (10), or at a constant velocity nu (6,)."""
        d, g_eta = self.environment(x, nu)
        return g_eta - d - x.tau_c

    def control_wrench(self, x: Pose) -> np.ndarray:
        """tau_cmd - C_hat nu - D_hat nu - g_hat (6,) that holds the vehicle at rest."""
        return -self.measurement(x).tau_c - self.setup.design.M_hat @ self.unmodelled(x)

    def unmodelled(self, x: Pose, measured: Any = None) -> np.ndarray:
        """The acceleration (6,) that a law without an integral term must balance through s, with the measurements
        ``measured``; default: the measurements at x."""
        d, g_eta = self.environment(x)
        measured = self.measurement(x) if measured is None else measured
        estimates = self.setup.scenario.estimates
        vehicle = self.setup.nominal
        same = measured.quat is x.quat
        nominal = g_eta
        if not (same and vehicle is self.setup.vehicle):
            nominal = self.restoring(vehicle, x.R_WB if same else rotation_matrix(measured.quat))
        unmodelled = (estimates.restoring - 1.0) * nominal + (nominal - g_eta) + (x.tau_c - measured.tau_c)
        if self._delivered:
            return self.M_hat_inv @ (d + unmodelled + self.resistance(measured.nu))
        return self.M_hat_inv @ (
            d + unmodelled + self.resistance(measured.nu) + self.undelivered @ (g_eta - d - x.tau_c)
        )

    def unmodelled_on_the_way(self, x: Pose, nu: np.ndarray) -> np.ndarray:
        """The acceleration (6,) of eq. (11) that current, disturbance and wrong estimates give a rigid vehicle with a
        velocity nu (6,)."""
        vehicle, estimates, term = self.setup.vehicle, self.setup.scenario.estimates, np.empty(6)
        d, g_eta = self.environment(x, nu)
        coriolis_rigid_body(vehicle.M_RB, nu, term)
        known = self.resistance(nu) + estimates.restoring * self.restoring(self.setup.nominal, x.R_WB)
        return self.M_hat_inv @ (d - g_eta - term + known)

    def resistance(self, nu: np.ndarray) -> np.ndarray:
        """C_hat nu + D_hat nu (6,) of a measured velocity."""
        vehicle, estimates = self.setup.nominal, self.setup.scenario.estimates
        total, term = np.zeros(6), np.empty(6)
        if nu.any():
            damping(vehicle.D_linear, vehicle.D_quadratic, nu, term)
            total += estimates.damping * term
            for coriolis, M in ((coriolis_added_mass, vehicle.M_A), (coriolis_rigid_body, vehicle.M_RB)):
                coriolis(M, nu, term)
                total += estimates.coriolis * term
        return total

    def __call__(self, x: Pose) -> np.ndarray:
        if self.uses_truth:
            unmodelled = x.tau_c - self.measurement(x).tau_c + self.undelivered @ self.thrust(x)
            if self.own_effects is not None:  # no law sees them
                nu_r = np.zeros(6)
                nu_r[:3] = -self.flow(x)
                unmodelled += self._own(x, nu_r)
            return self.demanded(x) - self.setup.design.M_d @ np.linalg.solve(self.setup.design.M, unmodelled)
        unmodelled = (1.0 - self.factor_inverse) * self.drift(x)
        if np.isfinite(self.K):
            unmodelled += self.factor_inverse * self.unmodelled(x)
        return self.demanded(x) - self.setup.design.M_d @ unmodelled

    def environment(self, x: Pose, nu: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """d and g(eta), (6,) each, in B, of a vehicle at rest or with a velocity nu (6,)."""
        body, nu_r = self.body, np.zeros(6) if nu is None else nu.copy()
        nu_r[:3] -= self.flow(x)
        body["R_WB"], body["nu_r"] = x.R_WB, nu_r
        body["d"] = self.tau_dist + self.setup.mean_water.pull(x.position, x.R_WB)
        if self.own_effects is not None:
            body["d"] += self._own(x, nu_r)
        if self._in_water is None:
            self._in_water = called_on(water_at_rest, body, self.effects)
        self._in_water()
        return body["d"][0].copy(), body["g"][0].copy()

    def _own(self, x: Pose, nu_r: np.ndarray) -> np.ndarray:
        """The wrench (6,) of a user's effects, in B."""
        assert self.own_effects is not None
        v_c_W, nu = self.setup.mean_water.flow(x.position), nu_r.copy()
        nu[:3] += x.R_WB.T @ v_c_W
        contacts = None if self.setup.not_rigid else lambda: x.tau_c
        return self.own_effects.wrench(x.position, x.quat, x.R_WB, nu, nu_r, v_c_W, contacts)

    def restoring(self, vehicle: VehicleLike, R_WB: np.ndarray) -> np.ndarray:
        """g(eta) (6,) of a vehicle, the true one or the file's."""
        g_eta = np.empty(6)
        restoring(vehicle.mass, vehicle.displaced_mass, vehicle.r_g, vehicle.r_b, self.setup.gravity_W, R_WB, g_eta)
        return g_eta


def at_limit(xi: Any, rate: Any, limit: Any) -> Any:
    """Residual of a limited integral at rest, a number or an array: zero if it stays at xi. The rate may have any
    positive factor."""
    return xi - np.clip(xi + rate, -limit, limit)


class Memory:
    """States of a law on the way to a rest, for a residual of :mod:`.balance`.

    Attributes:
        step: of implicit Euler on the way [s]; infinite at rest, zero where the states keep their values.
        value: the states at the end of the latest step.
        next: the states that the latest residual has found.
        nu_e: the velocity error (6,) of the step that ends at a pose; the motion sets it.
        not_fed_forward: the wrench (6,) of drag and of the reference's acceleration in this step, too.
        moves: whether the residual has the law's answer to the velocity, too.
    """

    moves = True

    def __init__(self, start: Any) -> None:
        self._start, self.step, self.value, self.next = start, math.inf, start, start
        self.nu_e: Callable[[Pose], np.ndarray] = lambda pose: np.zeros(6)
        self.not_fed_forward = self.nu_e

    def advance(self) -> None:
        """Keep the states that the latest residual has found."""
        self.value = self.next

    def begin(self) -> None:
        """Start again."""
        self.value = self._start


class Integral(Memory):
    """A limited integral as the only state.

    Attributes:
        limit: a number or an array.
    """

    moves = False

    def __init__(self, limit: Any) -> None:
        super().__init__(0.0 * limit)
        self.limit = limit

    def left(self, needed: Any, rate: Any) -> Any:
        """The rest of the value that holds the vehicle at a pose, at rest :func:`at_limit`, for the rate there."""
        if math.isinf(self.step):
            return at_limit(needed, rate, self.limit)
        self.next = np.clip(self.value + self.step * rate, -self.limit, self.limit)
        return needed - self.next
