"""The stages of a run with joints or a tool: the law's model before the law, and behind it the resolution of its
command into the wrench on the base and the torques of the joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ...control.task import tracking_errors
from ...physics.frames import attitude, compose_poses, wrench_at
from ...physics.kernels import fused, kernel
from ...physics.operational import resolve
from ...stages.base import Room, Stage
from ...stages.signals import CLOCK, ERRORS, ESTIMATES, MEASURED, REFERENCE, TOOL, TRUE, WRENCH_COMMAND
from .law_model import (
    estimate_at_body,
    estimate_at_tool,
    estimate_inertia,
    estimate_lambda,
    estimate_wrenches,
    move_model,
    place_tool,
)
from .memory import floats

UP_TO_ESTIMATES = MEASURED + REFERENCE + ERRORS + ESTIMATES
"""What the model's stage may set: at a tool MEASURED and ESTIMATES, otherwise ESTIMATES."""


@dataclass(frozen=True)
class ToolAttitude(Stage):
    """The true attitude of the tool, for the record. ``state`` is its CARRIER record."""

    name = "tool"
    room: ClassVar[Room] = Room("navigation", "tool", lambda thrusters: CLOCK + TRUE, TOOL[1:2])

    @staticmethod
    def step(settings, state, given, state_dot, out):
        attitude(state.R_WC, out)


@dataclass(frozen=True)
class ModelAtBody(Stage):
    """The estimates at B of a vehicle with joints. ``state`` is a MODEL record."""

    name = "model_at_body"
    needs: ClassVar = ("task", "controller.period", "simulation.timestep")
    room: ClassVar[Room] = Room("control", "model", lambda thrusters: CLOCK + MEASURED, UP_TO_ESTIMATES)

    def constants(self, setup: Any) -> Mapping[str, Any]:
        """Number of control instants from one estimate of the inertia to the next."""
        return {"every": max(1, round(setup.scenario.task.inertia_period / setup.scenario.control_period))}

    @staticmethod
    @fused
    def step(settings, state, given, state_dot, out):
        move_model(state, given.R_WB, given.nu)
        if given.instant % int(settings.every) == 0:
            estimate_inertia(state)
        estimate_wrenches(state)
        estimate_at_body(state, out)


@dataclass(frozen=True)
class ModelAtTool(ModelAtBody):
    """The measurements and the estimates at a tool. ``given`` has the measurements at B; ``state`` is a MODEL
    record."""

    name = "model_at_tool"

    @staticmethod
    @fused
    def step(settings, state, given, state_dot, out):
        move_model(state, given.R_WB, given.nu)
        place_tool(state)
        if given.instant % int(settings.every) == 0:
            estimate_inertia(state)
            estimate_lambda(state)
        estimate_wrenches(state)
        estimate_at_tool(state, out)
        tool = state.tool
        compose_poses(given.R_WB, given.p_WB, tool.R_BT, tool.p_BT, out.R_WB, out.p_WB)
        attitude(out.R_WB, out.quat_WB)
        for i in range(3):
            out.f_contact_m_W[i] = given.f_contact_m_W[i]
        for i in range(6):
            out.nu[i] = state.nu_T[i]
        wrench_at(tool.R_BT, tool.p_BT, given.tau_contact_m_B, out.tau_contact_m_B)


@dataclass(frozen=True)
class Errors(Stage):
    """Tracking errors alone: the estimates are those of the model's stage."""

    name = "errors"
    room: ClassVar[Room] = Room(
        "control", "tracking", lambda thrusters: CLOCK + MEASURED + REFERENCE, ERRORS + ESTIMATES
    )

    @staticmethod
    def step(settings, state, given, state_dot, out):
        tracking_errors(given, out)


@dataclass(frozen=True)
class ResolveAtBody(Stage):
    """The command at B for a vehicle with joints: the wrench of the law on the base. ``state`` is a MODEL record."""

    name = "resolve_at_body"
    room: ClassVar[Room] = Room("control", "resolve", lambda thrusters: (*CLOCK, WRENCH_COMMAND), (WRENCH_COMMAND,))

    @staticmethod
    def step(settings, state, given, state_dot, out):
        tau = state.tau
        for i in range(6):
            tau[i] = given.tau_cmd[i]
        for i in range(6, state.tau.shape[0]):
            tau[i] = 0.0
        deliver(state, tau, out)


@dataclass(frozen=True)
class ResolveAtTool(ResolveAtBody):
    """tau = J^T F of the law's wrench F at the tool. ``state`` is a MODEL record."""

    name = "resolve_at_tool"

    @staticmethod
    @fused
    def step(settings, state, given, state_dot, out):
        tau = state.tau
        resolve(floats(state.J_T_at, 6 * state.tau.shape[0]), state.tau.shape[0], given.tau_cmd, tau)
        deliver(state, tau, out)


@kernel
def deliver(model, tau, tau_B):
    """Add the posture to tau (N,), and give it to the allocation, tau_B (6,), and to the joints."""
    tau_q_cmd, tau_posture = floats(model.tau_q_cmd_at, model.n), floats(model.tau_posture_at, model.tau.shape[0])
    for i in range(model.tau.shape[0]):
        tau[i] += tau_posture[i]
    for i in range(6):
        tau_B[i] = tau[i]
    for k in range(model.n):
        tau_q_cmd[k] = tau[6 + k]
