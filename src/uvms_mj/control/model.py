r"""The surroundings of a law: its model of the vehicle before it, C, D and g as the law estimates them, and behind it
the resolution of its command into the wrench on the base and the torques of the joints. The ideal law is given the
truth.

The estimates use the same equations as the plant, with the true coefficients times the scenario's factors (default 1).
Their errors are terms of the lumped disturbance of the paper's eq. (11).

M, C, D and g of the tree are in :math:`\zeta = [\nu; \dot q]`. At a tool, Lambda and the task's bias take their place
(:mod:`uvms_mj.physics.operational`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..physics import operational
from ..physics.fossen import coriolis_rigid_body, restoring, turned_momentum
from ..physics.frames import add_wrench_from, attitude, compose_poses, cross, motion_at, to_body, wrench_at
from ..physics.hydrodynamics import relative_velocity
from ..physics.kernels import fused, kernel
from ..physics.operational import base_rows, task_inertia
from ..physics.tree import (
    LINK,
    along_joint,
    compose_links,
    damping_wrench,
    find_diagonals,
    full_inertia,
    joint_column,
    measured_frames,
    move_links,
    multiply,
)
from ..physics.vehicle import VehicleLike
from ..stages.base import Room, Stage
from ..stages.setup import ScenarioLike, SetupLike
from ..stages.signals import CLOCK, ERRORS, ESTIMATES, MEASURED, REFERENCE, TOOL, TRUE, TRUTH, WRENCH_COMMAND
from .base import Delay
from .design import Estimates
from .task import tracking_errors


def coefficients(vehicle: VehicleLike, gravity_W: Any, factors: Any = None) -> dict[str, Any]:
    """The fields of the record for :func:`model_wrenches`; ``factors`` are the factors of the estimated C, D and g."""
    coriolis, damping, restoring = (factors.coriolis, factors.damping, factors.restoring) if factors else (1.0,) * 3
    return {
        "M_RB": coriolis * vehicle.M_RB,
        "M_A": coriolis * vehicle.M_A,
        "D_linear": damping * vehicle.D_linear,
        "D_quadratic": damping * vehicle.D_quadratic,
        "mass": restoring * vehicle.mass,
        "displaced_mass": restoring * vehicle.displaced_mass,
        "r_g": vehicle.r_g,
        "r_b": vehicle.r_b,
        "gravity_W": np.array(gravity_W),
        "A_diagonal": 0.0,
        "D_diagonal": 0.0,  # nobody looked
    }


def model_dtype(n: int) -> np.dtype:
    """The law's model of a vehicle with n joints or a tool: its estimates at the measured state
    (:mod:`uvms_mj.control.model`), with N = 6 + n."""
    N = 6 + n
    return np.dtype(
        [
            ("links", LINK, (1 + n,)),
            ("gravity_W", "f8", (3,)),
            ("gravity_B", "f8", (3,)),
            ("tool", operational.TOOL),
            ("armature", "f8", (n,)),  # inertia of the rotors
            ("gear", "f8", (n,)),  # viscous friction of the gears
            # of one instant
            ("M", "f8", (N, N)),
            *((name, "f8", (N,)) for name in "CDg"),  # C zeta, D zeta and g
            ("L", "f8", (N, N)),  # Cholesky factor of M
            *((name, "f8", (N, 6)) for name in ("J_T", "MJ_T", "J_bar")),  # J^T of the tool, M^-1 J^T, and J_bar
            ("tau_posture", "f8", (N,)),  # of the commanded torques, what the posture adds
            ("tau", "f8", (N,)),  # commanded wrench and torques
            ("M_BB", "f8", (6, 6)),
            ("Lambda", "f8", (6, 6)),
            ("manipulability", "f8", (1,)),
            ("J_dot_zeta", "f8", (6,)),
            ("nu_T", "f8", (6,)),
        ],
        align=True,
    )


def estimate_links(links: np.ndarray, vehicle: Any, estimates: Estimates) -> None:
    """Set the coefficients of LINK records (1 + n,) to the coefficients of a vehicle's file with the factors of the
    estimates."""
    bodies: list[tuple[Any, Estimates]] = [(vehicle, estimates)]
    bodies += [(link, estimates.of(link.name)) for link in vehicle.arm.links]
    for record, (body, factors) in zip(links, bodies, strict=True):
        record["M"] = factors.inertia * (body.M_RB + body.M_A)
        record["coriolis"] = factors.coriolis / factors.inertia
        record["M_RB"], record["M_A"] = factors.coriolis * body.M_RB, factors.coriolis * body.M_A
        record["D_linear"] = factors.damping * body.D_linear
        record["D_quadratic"] = factors.damping * body.D_quadratic
        record["mass"], record["r_g"] = factors.restoring * body.mass, body.r_g
        record["displaced_mass"], record["r_b"] = factors.restoring * body.displaced_mass, body.r_b


def estimate(model: np.ndarray, vehicle: Any, estimates: Estimates) -> None:
    """Set the coefficients of a law's model (1,) to the coefficients of a vehicle's file with the factors of the
    estimates."""
    links = model["links"][0]
    estimate_links(links, vehicle, estimates)
    find_diagonals(links)
    for k, link in enumerate(vehicle.arm.links):
        factors = estimates.of(link.name)
        model["armature"][0, k] = factors.inertia * link.armature
        model["gear"][0, k] = factors.damping * link.damping


@kernel
def model_wrenches(link, gravity, R, nu, C_nu, D_nu, g_eta):
    """Set C(nu) nu, D(nu) nu and g(eta), (6,) each [N, N m], of a link at its origin in its axes, from nu (6,).

    ``link`` is a record with M_RB, M_A, D_linear, D_quadratic, mass, displaced_mass, r_g and r_b, and whether M_A and
    the damping are diagonal; ``gravity`` (3,) [m/s^2] is in the axes in which R (3, 3) is the attitude of the link.
    """
    momentum, C_A_nu = np.zeros(6), np.zeros(6)
    multiply(link.M_A, link.A_diagonal, nu, momentum)
    turned_momentum(momentum, nu, C_A_nu)
    coriolis_rigid_body(link.M_RB, nu, C_nu)
    C_nu += C_A_nu
    damping_wrench(link, nu, D_nu)
    restoring(link.mass, link.displaced_mass, link.r_g, link.r_b, gravity, R, g_eta)


@kernel
def reveal(coefficients, water, signals, truth):
    """Set a :data:`uvms_mj.stages.signals.TRUTH` record, except M, from the true coefficients.

    It is for eq. (13): velocity in the water and wrenches, which a real vehicle can't measure. In water that
    accelerates, g(eta) has the weight in gravity minus v_c_dot and the buoyancy in gravity minus a_c, both in W: with
    it, eq. (10) has the force of the water's acceleration on every vehicle (:mod:`uvms_mj.physics.hydrodynamics`).
    """
    nu, nu_r, nu_c_dot = signals.nu, truth.nu_r, truth.nu_c_dot
    gravity_W, R_WB = coefficients.gravity_W, signals.R_WB
    relative_velocity(water, R_WB, nu, nu_r)
    nu_c_dot[:3] = -cross(nu[3:], R_WB.T @ water.v_c_W)
    model_wrenches(coefficients, gravity_W, R_WB, nu_r, truth.C_nu_r, truth.D_nu_r, truth.g_eta)
    if water.unsteady != 0:
        nu_c_dot[:3] += R_WB.T @ water.v_c_dot_W
        accelerated_frame(coefficients, water, R_WB, truth.g_eta)
    truth.tau_dist[:] = water.tau_dist


@kernel
def accelerated_frame(coefficients, water, R_WB, g_eta):
    """Set g_eta (6,) to the restoring wrench in the frame of water that accelerates."""
    gravity_W, r_g, r_b, g_buoyancy = coefficients.gravity_W, coefficients.r_g, coefficients.r_b, np.zeros(6)
    restoring(0.0, coefficients.displaced_mass, r_g, r_b, gravity_W - water.a_c_W, R_WB, g_buoyancy)
    restoring(coefficients.mass, 0.0, r_g, r_b, gravity_W - water.v_c_dot_W, R_WB, g_eta)
    g_eta += g_buoyancy


OF_ROW = ("C_hat_nu", "D_hat_nu", "g_hat", "C_nu_r", "D_nu_r", "g_eta")
ROW = np.dtype(
    [
        *((name, "f8", (6,)) for name in ("nu", "nu_r")),
        ("R_WB", "f8", (3, 3)),
        *((name, "f8", (3,)) for name in ("a_c_W", "v_c_dot_W")),
        *((name, "f8", (6,)) for name in OF_ROW),
    ],
    align=True,
)
"""Motion and water of one row of a log, the wrenches that the law believes, and the wrenches that act."""


@kernel
def row_wrenches(known, true, rows, n, unsteady):
    """Set the wrenches of the first n of rows (k,), by the coefficients of the vehicle that is known and of the true
    one."""
    for k in range(n):
        row = rows[k]
        model_wrenches(known, known.gravity_W, row.R_WB, row.nu, row.C_hat_nu, row.D_hat_nu, row.g_hat)
        model_wrenches(true, true.gravity_W, row.R_WB, row.nu_r, row.C_nu_r, row.D_nu_r, row.g_eta)
        if unsteady != 0:
            accelerated_frame(true, row, row.R_WB, row.g_eta)


@dataclass(frozen=True)
class Truth(Stage):
    """The truth for the ideal law. ``state`` is the record of the run."""

    name = "truth"
    room: ClassVar[Room] = Room("navigation", "truth", lambda thrusters: CLOCK + TRUE, TRUTH)

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        return {**coefficients(setup.vehicle, setup.gravity_W), "M": setup.design.M}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        out.M[:] = settings.M
        reveal(settings, state.plant.water, given, out)


UP_TO_ESTIMATES = MEASURED + REFERENCE + ERRORS + ESTIMATES
"""Signals that the model's stage may set: at a tool MEASURED and ESTIMATES, otherwise ESTIMATES."""


@dataclass(frozen=True)
class ToolAttitude(Stage):
    """The true attitude of the tool, for the record. ``state`` is the record of the run."""

    name = "tool"
    every_step: ClassVar[bool] = True
    room: ClassVar[Room] = Room("navigation", "tool", lambda thrusters: CLOCK + TRUE, TOOL[1:2])

    @staticmethod
    def step(settings, state, given, state_dot, out):
        attitude(state.carriers[0].R_WC, out)


@dataclass(frozen=True)
class ModelAtBody(Stage):
    """The estimates at B. ``state`` is the record of the run."""

    name = "model_at_body"
    room: ClassVar[Room] = Room("control", "model", lambda thrusters: CLOCK + MEASURED, UP_TO_ESTIMATES)

    def constants(self, setup: SetupLike) -> Mapping[str, Any]:
        """Number of control instants from one estimate of the inertia to the next."""
        return {"every": max(1, round(setup.scenario.task.inertia_period / setup.scenario.control_period))}

    @staticmethod
    @fused
    def step(settings, state, given, state_dot, out):
        model, q_dot = state.model, state.joints.q_dot_m
        frames = measured_frames(state)
        move_model(model, frames, given.R_WB, given.nu, q_dot)
        estimate_wrenches(model, frames, given.R_WB, q_dot)
        out.C_hat_nu[:], out.D_hat_nu[:], out.g_hat[:] = model.C[:6], model.D[:6], model.g[:6]
        N = model.tau.shape[0]
        if N > 6:  # noqa: SIM102  # known when compiling: the inertia of a rigid vehicle is constant
            if given.instant % int(settings.every) == 0:
                estimate_inertia(model, frames)
        out.M_hat[:] = model.M[:6, :6]


@dataclass(frozen=True)
class ModelAtTool(ModelAtBody):
    """The measurements and the estimates at a tool. ``given`` has the measurements at B; ``state`` is the
    record of the run."""

    name = "model_at_tool"

    @staticmethod
    @fused
    def step(settings, state, given, state_dot, out):
        model, q_dot = state.model, state.joints.q_dot_m
        frames = measured_frames(state)
        move_model(model, frames, given.R_WB, given.nu, q_dot)
        place_tool(model, frames)
        if given.instant % int(settings.every) == 0:
            estimate_inertia(model, frames)
            estimate_lambda(model)
        estimate_wrenches(model, frames, given.R_WB, q_dot)
        estimate_at_tool(model, out)
        tool = model.tool
        compose_poses(given.R_WB, given.p_WB, tool.R_BT, tool.p_BT, out.R_WB, out.p_WB)
        attitude(out.R_WB, out.quat_WB)
        out.f_contact_m_W[:], out.nu[:] = given.f_contact_m_W, model.nu_T
        wrench_at(tool.R_BT, tool.p_BT, given.tau_contact_m_B, out.tau_contact_m_B)


@dataclass(frozen=True)
class Tracking(Stage):
    """Tracking errors: measurement minus reference."""

    name = "tracking"
    room: ClassVar[Room] = Room("control", "tracking", lambda thrusters: CLOCK + MEASURED + REFERENCE, ERRORS)

    @staticmethod
    def step(settings, state, given, state_dot, out):
        tracking_errors(given, out)


@dataclass(frozen=True)
class ResolveAtBody(Stage):
    """The command at B for a vehicle with joints: the wrench of the law on the base. ``state`` is the record of the
    run."""

    name = "resolve_at_body"
    room: ClassVar[Room] = Room("control", "resolution", lambda thrusters: (*CLOCK, WRENCH_COMMAND), (WRENCH_COMMAND,))

    def period_in(self, scenario: ScenarioLike) -> float:
        """The period at which a command arrives [s]."""
        return scenario.control_period if scenario.controller.delay is None else Delay().period_in(scenario)

    @staticmethod
    def step(settings, state, given, state_dot, out):
        tau = state.model.tau
        tau[:6], tau[6:] = given.tau_cmd, 0.0
        deliver(state.model, out, state.joints.tau_q_cmd)


@dataclass(frozen=True)
class ResolveAtTool(ResolveAtBody):
    """tau = J^T F of the law's wrench F at the tool. ``state`` is the record of the run."""

    name = "resolve_at_tool"

    @staticmethod
    @fused
    def step(settings, state, given, state_dot, out):
        model = state.model
        model.tau[:] = model.J_T @ given.tau_cmd
        deliver(model, out, state.joints.tau_q_cmd)


@kernel
def deliver(model, tau_B, tau_q_cmd):
    """Add the posture to tau (N,), and give it to the allocation, tau_B (6,), and to the joints."""
    model.tau += model.tau_posture
    tau_B[:], tau_q_cmd[:] = model.tau[:6], model.tau[6:]


@kernel
def move_model(model, frames, R_WB, nu, q_dot):
    """Set velocities and accelerations of all links from the measured state."""
    base = model.links[0]
    base.V[:], base.A[:] = nu, 0.0
    to_body(R_WB, model.gravity_W, model.gravity_B)
    move_links(model.links, frames, q_dot, 0)


@kernel
def estimate_wrenches(model, frames, R_WB, q_dot):
    """Set C zeta, D zeta and g (N,), whose wrenches on the links are summed towards the base."""
    links, C, D, g = model.links, model.C, model.D, model.g
    base = links[0]
    model_wrenches(base, model.gravity_W, R_WB, base.nu, base.F_C, base.F_D, base.F)
    for k in range(1, links.shape[0]):
        link, R, p = links[k], frames[k].R_BL, frames[k].p_BL
        C_nu, D_nu, g_eta = np.zeros(6), np.zeros(6), np.zeros(6)
        model_wrenches(link, model.gravity_B, R, link.nu, C_nu, D_nu, g_eta)
        C_nu += link.coriolis * (link.M @ link.a)
        link.F_C[:], link.F_D[:], link.F[:] = 0.0, 0.0, 0.0
        add_wrench_from(R, p, C_nu, link.F_C)
        add_wrench_from(R, p, D_nu, link.F_D)
        add_wrench_from(R, p, g_eta, link.F)
    for k in range(q_dot.shape[0], 0, -1):
        link, frame = links[k], frames[k]
        parent = links[frame.parent]
        C[5 + k] = along_joint(frame.S, link.F_C)
        D[5 + k] = along_joint(frame.S, link.F_D) + model.gear[k - 1] * q_dot[k - 1]
        g[5 + k] = along_joint(frame.S, link.F)
        parent.F_C += link.F_C
        parent.F_D += link.F_D
        parent.F += link.F
    C[:6], D[:6], g[:6] = base.F_C, base.F_D, base.F


@kernel
def estimate_inertia(model, frames):
    """Set M (N, N)."""
    links, M = model.links, model.M
    compose_links(links, frames)
    full_inertia(links[0].composite, model.M_BB)
    M[:6, :6] = model.M_BB
    for k in range(1, links.shape[0]):
        link, frame = links[k], frames[k]
        row, above = 5 + k, k
        for j in range(6, row):
            M[row, j], M[j, row] = 0.0, 0.0
        joint_column(link, frame.S)
        for _ in range(frame.depth):
            joint = frames[above]
            entry = along_joint(joint.S, link.F)
            M[row, 5 + above], M[5 + above, row] = entry, entry
            above = joint.parent
        M[row, row] += model.armature[k - 1]
        M[row, :6], M[:6, row] = link.F, link.F


@kernel
def place_tool(model, frames):
    """Set the pose of the tool in B, and J^T (N, 6)."""
    tool, rows, frame = model.tool, model.J_T, frames[model.tool.link]
    compose_poses(frame.R_BL, frame.p_BL, tool.R_LT, tool.p_LT, tool.R_BT, tool.p_BT)
    base_rows(tool, rows)
    above = tool.link
    for _ in range(frame.depth):  # the rows of all other joints are zero
        joint = frames[above]
        motion_at(tool.R_BT, tool.p_BT, joint.S, rows[5 + above])
        above = joint.parent


@kernel
def estimate_lambda(model):
    """Set Lambda and M^-1 J^T from M and J."""
    task_inertia(model.M, model.J_T, model.L, model.MJ_T, model.Lambda, model.J_bar, model.manipulability)


@kernel
def estimate_at_tool(model, out):
    """Set the estimates at the tool: Lambda, and J_bar^T h - Lambda J_dot zeta, whose last term stands for C."""
    tool, link, J_bar = model.tool, model.links[model.tool.link], model.J_bar
    motion_at(tool.R_BT, tool.p_BT, link.V, model.nu_T)
    motion_at(tool.R_BT, tool.p_BT, link.A, model.J_dot_zeta)
    out.C_hat_nu[:] = J_bar.T @ model.C - model.Lambda @ model.J_dot_zeta
    out.D_hat_nu[:], out.g_hat[:] = J_bar.T @ model.D, J_bar.T @ model.g
    out.M_hat[:] = model.Lambda
