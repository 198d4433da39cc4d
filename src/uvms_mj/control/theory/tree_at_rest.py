r"""Loads on a vehicle with joints at rest, and its law's command there, as machine code.

The kernels belong to the plant and to the law's model: :mod:`uvms_mj.physics.tree`, :mod:`.model` and
:func:`uvms_mj.physics.operational.posture`, at zero velocity. :mod:`.free_motion` has the equations.

Three trees are in the same posture: the true one, with all its inertia and weight; the water on it, which has added
mass and drag, and moves with nu_r; and the law's model.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from ...physics.effects import add_effects
from ...physics.frames import attitude
from ...physics.kernels import called_on, kernel
from ...physics.linear_algebra import backward, cholesky, forward, inverse
from ...physics.operational import free_of_base, posture, task_inertia
from ...physics.tree import link_records, place_links
from ...stages.setup import SetupLike
from ..design import Estimates
from ..model import estimate, estimate_inertia, estimate_wrenches, model_dtype, move_model, place_tool
from ..posture import posture_constants
from .own_effects import OwnEffects
from .terms import ThrustMap

PLACE, PUSH, BALANCE = range(3)
TRUE, WET, MODEL = range(3)
"""The trees."""


def rest_dtype(n: int) -> np.dtype:
    """The rest of a vehicle with n joints, N = 6 + n."""
    N = 6 + n
    return np.dtype(
        [
            ("q", "f8", (n,)),
            ("position", "f8", (3,)),  # pose of the frame of the task in W
            ("attitude", "f8", (3, 3)),
            ("tau_c", "f8", (6,)),  # contact wrench on it, in its axes
            ("F", "f8", (6,)),  # wrench of the law in these axes
            ("delivered", "f8", (6, 6)),  # T, the thrusters' wrench by the commanded one
            ("at_tool", "i8"),
            ("v_c_W", "f8", (3,)),
            ("own", "f8", (6,)),  # disturbance and effects of a user's own, in B
            ("p_WB", "f8", (3,)),
            ("quat_WB", "f8", (4,)),
            ("R_WB", "f8", (3, 3)),
            ("r", "f8", (n,)),  # acceleration of the joints while the frame is held
            ("tau", "f8", (N,)),  # commanded wrench in B and torques of the joints
            ("left", "f8", (N,)),  # generalised force that moves the tree
            ("a", "f8", (6,)),  # acceleration that the law takes from what it leaves
        ],
        align=True,
    )


@kernel
def asked(rest, frames, trees, levels, effects, what):
    """Set the pose of B for the held frame of the task (PLACE), what acts on the free motion (PUSH), or the balance of
    the tree under the wrench F of the law (BALANCE)."""
    if what == PLACE:
        placed(rest, frames, trees[MODEL])
        return
    model, N = trees[MODEL], len(rest.tau)
    J_T, M, M_inv, P, mobility = model.J_T, model.M, np.zeros((N, N)), np.zeros((N, N)), np.zeros((6, 6))
    others = surroundings(rest, frames, trees, effects)
    task_inertia(M, J_T, model.L, model.MJ_T, model.Lambda, model.J_bar, model.manipulability)
    inverse(model.L, M_inv)
    if what == PUSH or rest.at_tool != 0:
        mobility[:], P[:] = J_T.T @ model.MJ_T, M_inv - model.J_bar @ model.MJ_T.T
    else:  # the law at B has the rows of the base
        L = M[:6, :6].copy()
        cholesky(L, L)
        inverse(L, mobility)
        free_of_base(M, P)
    rising, a = P @ model.g, np.zeros(N)
    posture(levels, rest, np.zeros(N), rest.q, M, M_inv, P, a)
    rest.tau[:] = M @ a
    if what == PUSH:
        rest.tau += M @ rising
        push(rest, J_T, trees[TRUE], others)
    else:
        balance(rest, model, mobility, others)


@kernel
def placed(rest, frames, model):
    """Set the pose of B at the joint positions q, from the pose of the frame of the task."""
    place_links(frames, rest.q, 0)
    place_tool(model, frames)
    rest.R_WB[:] = rest.attitude @ model.tool.R_BT.T
    rest.p_WB[:] = rest.position - rest.R_WB @ model.tool.p_BT
    attitude(rest.R_WB, rest.quat_WB)


@kernel
def surroundings(rest, frames, trees, effects):
    """The generalised force (N,) of current, weight, buoyancy, disturbance, effects and contact on the true tree. Set
    M, and C nu, D nu and g, of each tree."""
    nu_r, still = np.zeros(6), np.zeros(len(rest.q))
    nu_r[:3] = -(rest.R_WB.T @ rest.v_c_W)
    for k in range(3):
        tree, moving = trees[k], 1.0 if k == WET else 0.0
        estimate_inertia(tree, frames)
        move_model(tree, frames, rest.R_WB, moving * nu_r, still)
        estimate_wrenches(tree, frames, rest.R_WB, still)
    wet = trees[WET]
    total = trees[MODEL].J_T @ rest.tau_c - (wet.C + wet.D) - trees[TRUE].g
    total[:6] += rest.own
    add_effects(effects, nu_r, total[:6])
    return total


@kernel
def push(rest, J_T, true, others):
    """Set r and tau while the law holds the frame of the task, from what the posture commands."""
    X = np.zeros((len(rest.tau), 7))
    X[:, :6], X[:, 6] = J_T, rest.tau
    X[:6] = rest.delivered @ X[:6]
    X[:, 6] += others
    cholesky(true.M, true.L)
    forward(true.L, X)
    backward(true.L, X)
    F = -np.linalg.solve(J_T.T @ X[:, :6], J_T.T @ X[:, 6])
    rest.r[:] = X[6:, :6] @ F + X[6:, 6]
    rest.tau += J_T @ F


@kernel
def balance(rest, model, mobility, others):
    """Set tau, a, and the generalised force that is left under the wrench F of the law, from what the posture
    commands."""
    g_hat = model.g[:6].copy()
    if rest.at_tool != 0:
        g_hat[:] = model.J_bar.T @ model.g
    rest.a[:] = -(mobility @ (rest.F + rest.tau_c - g_hat))
    rest.tau += model.J_T @ (rest.F - g_hat) + model.g
    rest.left[:] = rest.tau + others
    rest.left[:6] += rest.delivered @ rest.tau[:6] - rest.tau[:6]


class TreeAtRest:
    """The trees of a run in one posture.

    Args:
        setup: the run's :class:`uvms_mj.setup.base.Setup`, of a vehicle with joints or with its task at a tool.
        thrust_map: what the thrusters make of a commanded wrench.

    Attributes:
        rest: a record of :func:`rest_dtype`.
        tool: pose of the frame of the task in B in the latest posture, with p_BT (3,) [m] and R_BT (3, 3).
        J_bar: (6 + n, 6) of the law's model, for the latest push.
    """

    def __init__(self, setup: SetupLike, thrust_map: ThrustMap) -> None:
        n, carrier = len(setup.vehicle.arm.links), setup.plant.probe.carrier
        self.setup, self._rest = setup, np.zeros(1, rest_dtype(n))
        self.rest = self._rest[0]
        self._trees = np.zeros(3, model_dtype(n))
        for k in (TRUE, WET, MODEL):
            vehicle, factors = (setup.nominal, setup.scenario.estimates) if k == MODEL else (setup.vehicle, Estimates())
            tree = self._trees[k : k + 1]
            tree["links"], tree["gravity_W"] = link_records(vehicle), setup.gravity_W
            tool = tree["tool"]
            tool["link"], tool["p_LT"], tool["R_LT"] = carrier.link + 1, carrier.p, carrier.R
            estimate(tree, vehicle, factors)
        for name in ("M_RB", "mass", "displaced_mass"):
            self._trees["links"][WET][name] = 0.0
        given = posture_constants(setup)
        levels = np.zeros(1, np.dtype([(name, "f8", np.shape(value)) for name, value in given.items()]))
        for name, value in given.items():
            levels[name] = value
        self.rest["delivered"], self.rest["at_tool"] = thrust_map.T, setup.at_tool
        self.tool = self._trees[MODEL]["tool"]
        self._own = OwnEffects(setup.scenario.effects, setup) if setup.scenario.effects else None
        arrays = self._rest, setup.nominal.arm.frames.copy(), self._trees, levels, setup.effects
        self._asked: Callable[[int], Any] = called_on(asked, *arrays)

    @property
    def J_bar(self) -> np.ndarray:
        return np.array(self._trees[MODEL]["J_bar"])

    def place(self, q: np.ndarray, position: np.ndarray, R: np.ndarray) -> None:
        """Hold the frame of the task in a pose in W at joint positions q (n,), and set the pose of B."""
        rest = self.rest
        rest["q"], rest["position"], rest["attitude"] = q, position, R
        self._asked(PLACE)
        self._surround()

    def stand(self, q: np.ndarray, p_WB: np.ndarray, R_WB: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Set the pose of B and the joint positions q (n,). Returns position (3,) and attitude (3, 3) of the frame of
        the task in W."""
        self.place(q, np.zeros(3), np.eye(3))
        p_BT, R_BT = np.array(self.tool["p_BT"]), np.array(self.tool["R_BT"])
        position, R = p_WB + R_WB @ p_BT, R_WB @ R_BT
        self.place(q, position, R)
        return position, R

    def _surround(self) -> None:
        """Set the current and the wrenches that the kernels do not have at the pose of B."""
        rest, water = self.rest, self.setup.mean_water
        v_c_W = rest["v_c_W"] = water.flow(np.array(rest["p_WB"]))
        rest["own"] = water.push
        if self._own is not None:
            nu_r = np.concatenate([-rest["R_WB"].T @ v_c_W, np.zeros(3)])
            p_WB, quat_WB, R_WB = (np.array(rest[name]) for name in ("p_WB", "quat_WB", "R_WB"))
            rest["own"] += self._own.wrench(p_WB, quat_WB, R_WB, np.zeros(6), nu_r, v_c_W)

    def push(self, tau_c: np.ndarray) -> None:
        """Set r, tau and J_bar of the rest while the frame of the task is held against a contact wrench (6,)."""
        self.rest["tau_c"] = tau_c
        self._asked(PUSH)

    def balance(self, F: np.ndarray, tau_c: np.ndarray) -> None:
        """Set tau, left and a of the rest under the wrench F (6,) of the law and a contact wrench (6,)."""
        self.rest["F"], self.rest["tau_c"] = F, tau_c
        self._asked(BALANCE)
