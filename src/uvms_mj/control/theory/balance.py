r"""Static balance: pose and contact force of a vehicle at rest, from the scenario and one number of the law.

Near rest each shipped law is the nominal control (23) minus :math:`\hat M K s`, up to a term that integrates. At rest
(nu = 0) zeta is constant in eq. (15), so that A s = -w with w = M_d^-1 (K_d eta_e - K_f (tau_c - F_d)). The balance of
eq. (10) is then

.. math::

    (I - A^{-1} K) M_d^{-1} (K_d \tilde\eta - K_f (\tau_c - F_d))
    = \hat M^{-1} (d + \hat g(\eta) - g(\eta) + (I - T^{-1}) \tau), \qquad
    K = \begin{cases} 0 & \text{impedance, eq. (23): the static balance of eq. (5)} \\
                      K_s / \epsilon & \text{first-order law inside its boundary layer, eq. (31)} \\
                      \infty & \text{super-twisting, whose } z \text{ balances disturbances slower than } k_2/2; \\
                             & \text{the ideal law, eq. (13)}
        \end{cases}

For A = 0 and K > 0 the left factor is infinite, which is eq. (6). T = B B_hat^+ gives the wrench of the true thrusters
for a commanded one, and tau = g - d - tau_c holds the vehicle. Here d = tau_dist - C_A(-nu_c)(-nu_c) - D(-nu_c)(-nu_c)
is the wrench of the current and the constant disturbance on the vehicle at rest, at its rest attitude; tau_dist has
the wrench of the effects in it.
Each contact gives the force of its springs with its moment (:class:`.terms.ContactSprings`); of the frictionless wall
``[wall]`` it is tau_c = -k_c (x - x_c) along its normal for x > x_c. For GSTA with the attitude reference
along W this is eq. (12) at rest against the spring of eq. (34), F = K_x (x_d - x_c) / (1 + K_x / k_c); the paper's
1.5 N neglects the compliance of the wall.

The law sees measurements, with the constant errors that :meth:`uvms_mj.navigation.base.Navigation.rest_errors` gives.
Then w follows from the measurements, a biased velocity nu_m adds D_d nu_m to it and makes the pose error seem to move,
so that A s = F_1 eta_e_dot - w, and the estimates follow from the measurements, too:

.. math::

    w - \frac{K}{K - A} F_1 \dot{\tilde\eta} = \frac{A}{A - K} \hat M^{-1}
        (d + \hat n_m - g(\eta) + \tau_c - \tau_{c,m} + (I - T^{-1}) \tau), \qquad
    \hat n_m = \hat C \nu_m + \hat D \nu_m + \hat g(\eta_m).

An observer measures all that the controller's model does not explain: tau_c,m is tau_c plus the rest of the bracket,
which is then zero.
The ideal law knows all wrenches but the contact wrench and the thrust that is missing:
w = M^-1 (tau_c - tau_c,m + (I - T^-1) tau).

The six equations may have several roots. The vehicle rests at the root that its motion from the start reaches
(:mod:`.approach`). In front of planes, and with the origin of the task's frame as the contact, any motion reaches the
same root: it begins at the reference. Otherwise it begins where the vehicle does and follows the reference through its
way, together with motions that begin beside it. If they do not all reach the same stable root, there is no closed form.
"""

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np

from ...physics.frames import quat_from_euler_deg
from ...physics.spanned_axes import axes_spanned
from ...stages.setup import SetupLike
from ..base import SteadyState
from .contacts_about_rest import contacts_about
from .free_motion import tool_rest
from .own_effects import OwnEffects
from .rigid_motion import KEEPING, NOMINAL, Compiled, RigidMotion
from .task_motion import TaskMotion, Track, way_of
from .terms import START_FORCE, Balance, Memory, Pose, ThrustMap

_BESIDE, _BESIDE_TOOL, _NEXT = 0.05, 0.02, 0.001
"""How far from its way the reference of the motions beside the vehicle's motion is, of a tool, whose way is short, and
if the law keeps eq. (7) on the way and only one contact may be hit [m]."""
_LIMITED_S, _LIMITED_OWN_S, _LIMITED_AMONG_S = 2.0, 1.0, 0.5
"""Time with thrusters at their limits after which the motion is not known, under a law that keeps eq. (7) and under
another one, and among shapes under a law whose states wind up: with what is left of them it may pass a pile on the
other side [s]."""
_STEPS_LIMITED = 450
"""Most steps of a motion with the thrusters' limits: one that tumbles comes to no rest."""
_SLOWLY = 0.3
"""Velocity below which a vehicle that a wall throws out comes back as it came from elsewhere [m/s, rad/s]."""
_AT_ONCE = 1e9
"""A first step after which the motion is at rest [s]."""
_SAME, _SAME_TOOL = 1e-6, 1e-4
"""Two rests nearer to each other than this are one; of a tool, one of which comes from a slow motion [m, rad]."""


def static_balance(
    setup: SetupLike,
    K: float,
    residual: "Callable[[Balance, Pose], np.ndarray] | None" = None,
    memory: Memory | None = None,
    kept: Callable[[np.ndarray, np.ndarray], str] | None = None,
    wrench: np.ndarray | None = None,
    compiled: Compiled | None = None,
) -> SteadyState | str:
    """The vehicle at rest under a law that is the nominal control minus M_hat (A + K) s near rest.

    Args:
        setup: the run's :class:`uvms_mj.setup.base.Setup`.
        K: slope of the law over s [1/s]; infinite for a law that integrates, so that s is zero at rest. With a
            residual, only whether it is infinite counts: whether the law balances any constant wrench.
        residual: the six equations of another law, from the balance and a pose (6,), in place of the equations above:
            minus the wrench that moves the vehicle. They need a constant disturbance.
        memory: the law's states in the residual on the way to the rest.
        kept: the reason why the law does not keep eq. (7) under unknown accelerations (n, 6) at times (n,) [s], empty
            if it does. By default it does.
        wrench: the net wrench (6, 6) that a residual of one takes from the vehicle. It is given for a law with a
            residual and without any other memory, whose rest with thrusters at their limits is known.
        compiled: the residual as machine code. A residual without it is followed in Python.

    Returns:
        The state, or the reason why there is none.
    """
    scenario, thrust_map = setup.scenario, ThrustMap.of(setup)
    if reason := unknown(setup, K, residual is not None):
        return reason
    if isinstance(thrust_map, str):
        return thrust_map
    if axes_spanned(thrust_map.T @ setup.nominal.B) < 6:
        return "the thrusters can't produce every wrench"
    errors = scenario.navigation.rest_errors(setup)
    if isinstance(errors, str):
        return errors
    if thrust_map.static.error and (np.isfinite(K) or scenario.controller.uses_truth):
        return f"{thrust_map.static.error}, and the law does not integrate"
    if setup.not_rigid:
        return _with_arm(setup, K, thrust_map)
    balance = Balance(setup, K, thrust_map, residual is not None)
    if residual is None and scenario.controller.uses_truth:
        wrench = setup.design.M @ setup.design.M_d_inv
    elif residual is None and K == 0.0:
        wrench = setup.design.M_hat @ setup.design.M_d_inv
    motion = _motion(balance, residual, memory, thrust_map, wrench, compiled)
    slope, clipped = 0.0 if residual else K, wrench is not None and _clipped(setup, thrust_map)
    pose = _nearest(motion) if balance.springs.convex else _reached(motion, slope, kept, clipped)
    if balance.springs.convex and clipped and isinstance(pose, Pose) and thrust_map.infeasible(balance.thrust(pose)):
        pose = _reached(motion, slope, clipped=True)
    if isinstance(pose, str):
        return pose
    for sensor in (scenario.navigation, scenario.observer):
        if sensor.runs and (reason := sensor.out_of_range(balance.measurement(pose))):
            return reason
    tau, push = balance.thrust(pose), balance.contacts(pose.position, pose.R_WB)[1]
    answering = motion.answering(pose) if motion.limits else np.ones(len(thrust_map.inverse), bool)
    if answering.all() and (weak := thrust_map.infeasible(tau)):
        return weak
    if not answering.all() and residual is not None and np.isinf(K):
        return f"{thrust_map.infeasible(tau)}, and an integral without a limit winds up"
    winds_up = thrust_map.limited and scenario.controller.states  # a law without states forgets its way
    if balance.springs.convex and winds_up and not motion.limits and (reason := _kept_at_limits(motion, slope, kept)):
        return reason
    contacts = None
    if not answering.all() or (push.any() and not balance.springs.convex):
        acts = None if answering.all() else setup.vehicle.B @ (answering[:, None] * thrust_map.inverse)
        contacts = contacts_about(motion, pose, acts)
        if isinstance(contacts, str):
            return contacts
    s = balance.sliding(pose, not answering.all())
    return _rubbed(balance, push) or SteadyState(
        float(push.sum()), pose.position, pose.quat, s, tau, reached=True, contacts=contacts
    )


def _motion(
    balance: Balance,
    residual: "Callable[[Balance, Pose], np.ndarray] | None",
    memory: Memory | None = None,
    thrust_map: ThrustMap | None = None,
    wrench: np.ndarray | None = None,
    compiled: Compiled | None = None,
) -> TaskMotion:
    """The motion of the frame of the task, as machine code if there is some that has all of its terms."""
    if residual is None:
        compiled, residual = NOMINAL, Balance.__call__
    elif residual is Balance.demanded:
        compiled = KEEPING
    if compiled is not None and (motion := RigidMotion(compiled, balance, memory, thrust_map, wrench)).known:
        return motion
    return TaskMotion(balance, residual, memory, thrust_map, wrench)


def _clipped(setup: SetupLike, thrust_map: ThrustMap) -> bool:
    """Whether the thrusts of a run are as allocated, each within its limits, and the law's measurements do
    not take what is missing for a contact."""
    static, actuation = thrust_map.static, setup.scenario.actuation.name
    exact = static.gain is not None and bool((static.gain == 1.0).all()) and not static.error and not any(static.start)
    same = np.array_equal(setup.vehicle.B, setup.nominal.B) and actuation in ("pseudo_inverse", "weighted")
    return exact and same and thrust_map.limited and not setup.scenario.observer.runs


_KNOWN = frozenset(
    (
        *("name", "description", "vehicle", "simulation", "initial", "wall", "effects"),
        *("walls", "bumper", "reference", "impedance", "estimates", "navigation", "encoder", "wrist", "observer"),
        *("task", "posture", "controller", "actuation", "joints", "thrusters"),
    )
)
"""The tables of a scenario that the balance has in it, beside the effects of the water whose records it takes. With any
other one that is in use there is no closed form."""


def unknown(setup: SetupLike, K: float, own: bool) -> str:
    """The reason why a scenario has no static balance, for a law with a residual of its own or with the slope K; empty
    if it may have one."""
    scenario = setup.scenario
    for table in dataclasses.fields(scenario):
        known = table.name in _KNOWN or table.name in scenario.balanced_tables
        if not known and getattr(scenario, table.name) != table.default:
            return f"closed forms do not know {table.name}"
    if scenario.effects and (reason := OwnEffects(scenario.effects, setup).unknown()):
        return reason
    if moved := setup.advancing:
        return f"closed forms do not know where {moved[0]} moves"
    if own and (reason := not_constant(setup)):
        return reason
    if setup.not_rigid and own:
        return f"the closed form of this law is known for a rigid vehicle at B, and {setup.not_rigid}"
    if setup.rest_pose[0] is None:
        return "the reference does not come to rest"
    if reason := scenario.unsteady_flow:
        return reason
    if not (scenario.navigation.is_shipped and scenario.actuation.is_shipped):
        return "closed forms are known for the shipped navigation and actuation only"
    if scenario.observer.runs and not scenario.observer.is_shipped:
        return "closed forms are known for the shipped observers only"
    return "a wall moves" if any(wall.moves for _, wall in setup.contacts.walls) else ""


def _rubbed(balance: Balance, push: np.ndarray) -> str:
    """The reason why a state is not the only one: friction acts in it; empty if none does."""
    return "with friction, the rest position depends on the path" if balance.rubs(push) else ""


def _nearest(motion: TaskMotion) -> Pose | str:
    """The rest next to the reference, or the reason why there is none."""
    balance = motion.balance
    return motion.rest_from(balance.pose(balance.p_d, balance.quat_d), np.zeros(6), _AT_ONCE)


def _reached(
    motion: TaskMotion,
    K: float,
    kept: Callable[[np.ndarray, np.ndarray], str] | None = None,
    clipped: bool = False,
) -> Pose | str:
    """The rest that the frame of the task reaches from its start under a law with the slope K, or the reason why it is
    not known. Of a law whose command is known where the thrusters' limits clip it, the motion has these limits."""
    balance, setup = motion.balance, motion.balance.setup
    way = way_of(setup)
    if isinstance(way, str):
        return way
    motion.follow(way)
    initial = setup.initial
    start = balance.pose(np.array(initial.position), quat_from_euler_deg(*initial.attitude_deg))
    thrown = _thrown(balance, start)
    if isinstance(thrown, str):
        return thrown
    rest = _followed(motion, start)
    if isinstance(rest, str):
        return rest
    weak, saturates = "", motion.saturates
    if motion.thrust_map is not None:
        weak = motion.thrust_map.infeasible(balance.thrust(rest))
    clipped = clipped and (saturates or bool(weak))
    if clipped:
        rest = _followed(motion, start, limits=True)
        if isinstance(rest, str):
            return weak or rest
    elif weak:
        return weak
    if kept is not None and (reason := kept(*motion.unmodelled())):
        return reason
    motion.passed(motion.track.times[-1] + 1.0, rest)
    if clipped or not balance.springs.convex:
        track = motion.track
        passed = [np.array(each) for each in zip(*((pose.position, pose.R_WB) for pose in track.poses), strict=True)]
        if reason := _rubbed(balance, balance.contacts(*passed)[1]):
            return reason
        alone = len(balance.springs) == 1
        beside = _NEXT if np.isinf(K) and alone else _BESIDE_TOOL if setup.not_rigid else _BESIDE
        across = _across(way[1][-1] - start.position)
        others = [_followed(motion, start, beside * e, limits=clipped) for e in across]
        if K == 0.0 and not (motion.memory and motion.memory.moves):
            others.append(_followed(motion, start, led=False, limits=clipped))
        if thrown.any():
            others.append(_followed(motion, start, thrown=thrown, limits=clipped))
        if saturates and not clipped:
            others.append(_followed(motion, start, limits=True))
            if reason := _lost_at_limits(motion, K, kept):
                return reason
            if _slides_off(track):
                return "the thrusters come to their limits on a way on which the vehicle slides off a wall"
        motion.track = track
        if any(isinstance(each, str) or np.abs(each.position - rest.position).max() > _SAME for each in others):
            return "motions close to each other come to different rests"
    return rest


def _kept_at_limits(motion: TaskMotion, K: float, kept: Callable[[np.ndarray, np.ndarray], str] | None) -> str:
    """The reason why a law with the slope K does not come to the one rest in front of planes, since the thrusters come
    to their limits on the way; empty if they do not, or it does."""
    setup, way = motion.balance.setup, way_of(motion.balance.setup)
    if isinstance(way, str):
        return ""
    motion.follow(way)
    initial = setup.initial
    start = motion.balance.pose(np.array(initial.position), quat_from_euler_deg(*initial.attitude_deg))
    if isinstance(_followed(motion, start), str) or not motion.saturates:
        return ""
    _followed(motion, start, limits=True)
    return _lost_at_limits(motion, K, kept)


def _lost_at_limits(motion: TaskMotion, K: float, kept: Callable[[np.ndarray, np.ndarray], str] | None) -> str:
    """The reason why a law with the slope K does not take the motion with the thrusters' limits; empty if it does."""
    longest = _LIMITED_S if K > 0.0 else _LIMITED_OWN_S
    if not motion.balance.springs.convex and motion.balance.setup.scenario.controller.states:
        longest = _LIMITED_AMONG_S
    if motion.limited_s > longest:
        return f"the thrusters are at their limits for more than {longest:g} s on the way"
    if kept is not None and (reason := kept(*motion.unmodelled())):
        return f"the thrusters come to their limits on the way, and {reason}"
    return ""


def _slides_off(track: Track) -> bool:
    """Whether a contact ends on the way."""
    return any(a.tau_c.any() and not b.tau_c.any() for a, b in itertools.pairwise(track.poses))


def _thrown(balance: Balance, start: Pose) -> np.ndarray | str:
    """The velocity (6,) with which walls throw out a rigid vehicle that starts inside them, with all their energy; zero
    if they hardly press. The reason why its motion is not known if that is fast."""
    push = balance.contacts(start.position, start.R_WB)[1]
    if push.max(initial=0.0) <= START_FORCE:
        return np.zeros(6)
    if not balance.setup.not_rigid:
        _, forces, depths = balance.springs.wrenches(start.position[None], start.R_WB[None])
        energy = 0.5 * float(forces @ depths)
        acceleration = np.linalg.solve(balance.setup.design.M, start.tau_c)
        velocity: np.ndarray = acceleration * np.sqrt(2.0 * energy / (acceleration @ start.tau_c))
        if np.abs(velocity).max() < _SLOWLY:
            return velocity
    return "the vehicle starts inside a wall, which throws it out"


def _followed(
    motion: TaskMotion,
    start: Pose,
    beside: np.ndarray | None = None,
    thrown: float | np.ndarray = 0.0,
    **how: bool,
) -> Pose | str:
    """The rest of one motion that begins at a pose or beside it (3,) [m, W], with its own velocity and another one (6,)
    that a wall gives it."""
    beside = np.zeros(3) if beside is None else beside
    motion.begin(beside, **how)
    moved = motion.balance.moved(start, np.concatenate([start.R_WB.T @ beside, np.zeros(3)]))
    most = {"steps": _STEPS_LIMITED} if motion.limits else {}
    return motion.rest_from(moved, motion.velocity() + thrown, **most)


def _across(direction: np.ndarray) -> np.ndarray:
    """Three directions (3, 3) across a direction (3,), 120 deg from each other."""
    across = np.linalg.svd(direction[None])[2][1:]
    angles = 2.0 * np.pi / 3.0 * np.arange(3)
    found: np.ndarray = np.cos(angles)[:, None] * across[0] + np.sin(angles)[:, None] * across[1]
    return found


def unmodelled_acceleration(setup: SetupLike, state: SteadyState) -> np.ndarray:
    """The acceleration (6,) of disturbances and model errors at rest, M_hat^-1 tau_dist of eq. (11), in a state of
    :func:`static_balance`."""
    thrust_map = ThrustMap.of(setup)
    assert not isinstance(thrust_map, str)  # the state was found with it
    balance = Balance(setup, np.inf, thrust_map)
    return balance.unmodelled(balance.pose(np.asarray(state.position), np.asarray(state.quat)))


def _with_arm(setup: SetupLike, K: float, thrust_map: ThrustMap) -> SteadyState | str:
    """The rest of :func:`static_balance` for a vehicle with an arm, or with its task at a tool
    (:mod:`.free_motion`)."""
    if setup.scenario.navigation.name != "perfect" or setup.scenario.encoder.runs:  # navigation is a shipped one
        return "with errors of navigation, the rest of the tool depends on the posture"
    if setup.scenario.wrist.runs:
        return "with a wrist sensor, what its model lacks is taken for a contact force, which depends on the posture"
    if any(pair.carrier != 0 for pair in setup.contacts.pairs):
        return "with contact bodies away from the frame of the task, the rest depends on the posture"
    motion = _motion(Balance(setup, np.inf, thrust_map), Balance.demanded)
    rest = _reached(motion, K)
    if isinstance(rest, str):
        return rest
    track, curved = motion.track, not motion.balance.springs.convex
    if _slides_off(track):
        return "the tool slides off a wall on its way, and the limits of the joints in the hit are not known"

    def reached(tool: Pose, a: np.ndarray) -> str:
        """The way again with the disturbance that the law leaves, as it is at the rest: it may meet another face."""
        if not curved:
            return ""
        left = motion.balance.setup.design.M_d @ (Balance(setup, K, thrust_map).factor_inverse * a)
        disturbed = TaskMotion(Balance(setup, np.inf, thrust_map), lambda balance, x: balance.demanded(x) - left)
        found = _reached(disturbed, K)
        if isinstance(found, str):
            return found
        apart = np.abs(found.position - tool.position).max()
        return "with the disturbance on the way the tool comes to another rest" if apart > _SAME_TOOL else ""

    return tool_rest(setup, K, thrust_map, track, reached)


def disturbance_rate(setup: SetupLike) -> np.ndarray:
    """Bound (6,) on the rate of M_hat^-1 tau_dist, which eq. (28) has to follow [m/s^3, rad/s^3]. Of a Gauss-Markov
    process it is the rate that one in 5e8 of its nodes exceeds. The drag of a tether is not in it."""
    return np.abs(np.linalg.inv(setup.design.M_hat)) @ setup.scenario.push_rate


def not_constant(setup: SetupLike) -> str:
    """The reason why a law without an integral term does not rest under a disturbance; empty if it is constant."""
    return "the disturbance is not constant" if disturbance_rate(setup).any() else ""
