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
    measured_frames,
    move_model,
    place_tool,
)

UP_TO_ESTIMATES = MEASURED + REFERENCE + ERRORS + ESTIMATES
"""What the model's stage may set: at a tool MEASURED and ESTIMATES, otherwise ESTIMATES."""


@dataclass(frozen=True)
class ToolAttitude(Stage):
    """The true attitude of the tool, for the record. ``state`` is the record of the run."""

    name = "tool"
    room: ClassVar[Room] = Room("navigation", "tool", lambda thrusters: CLOCK + TRUE, TOOL[1:2])

    @staticmethod
    def step(settings, state, given, state_dot, out):
        attitude(state.carriers[0].R_WC, out)


@dataclass(frozen=True)
class ModelAtBody(Stage):
    """The estimates at B of a vehicle with joints. ``state`` is the record of the run."""

    name = "model_at_body"
    room: ClassVar[Room] = Room("control", "model", lambda thrusters: CLOCK + MEASURED, UP_TO_ESTIMATES)

    def constants(self, setup: Any) -> Mapping[str, Any]:
        """Number of control instants from one estimate of the inertia to the next."""
        return {"every": max(1, round(setup.scenario.task.inertia_period / setup.scenario.control_period))}

    @staticmethod
    @fused
    def step(settings, state, given, state_dot, out):
        model, q_dot = state.model, state.joints.q_dot_m
        frames = measured_frames(state, model.frames)
        move_model(model, frames, given.R_WB, given.nu, q_dot)
        if given.instant % int(settings.every) == 0:
            estimate_inertia(model, frames)
        estimate_wrenches(model, frames, q_dot)
        estimate_at_body(model, out)


@dataclass(frozen=True)
class ModelAtTool(ModelAtBody):
    """The measurements and the estimates at a tool. ``given`` has the measurements at B; ``state`` is the
    record of the run."""

    name = "model_at_tool"

    @staticmethod
    @fused
    def step(settings, state, given, state_dot, out):
        model, q_dot = state.model, state.joints.q_dot_m
        frames = measured_frames(state, model.frames)
        move_model(model, frames, given.R_WB, given.nu, q_dot)
        place_tool(model, frames)
        if given.instant % int(settings.every) == 0:
            estimate_inertia(model, frames)
            estimate_lambda(model)
        estimate_wrenches(model, frames, q_dot)
        estimate_at_tool(model, out)
        tool = model.tool
        compose_poses(given.R_WB, given.p_WB, tool.R_BT, tool.p_BT, out.R_WB, out.p_WB)
        attitude(out.R_WB, out.quat_WB)
        for i in range(3):
            out.f_contact_m_W[i] = given.f_contact_m_W[i]
        for i in range(6):
            out.nu[i] = model.nu_T[i]
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
    """The command at B for a vehicle with joints: the wrench of the law on the base. ``state`` is the record of the
    run."""

    name = "resolve_at_body"
    room: ClassVar[Room] = Room("control", "resolve", lambda thrusters: (*CLOCK, WRENCH_COMMAND), (WRENCH_COMMAND,))

    @staticmethod
    def step(settings, state, given, state_dot, out):
        tau = state.model.tau
        for i in range(6):
            tau[i] = given.tau_cmd[i]
        for i in range(6, tau.shape[0]):
            tau[i] = 0.0
        deliver(state.model, out, state.joints.tau_q_cmd)


@dataclass(frozen=True)
class ResolveAtTool(ResolveAtBody):
    """tau = J^T F of the law's wrench F at the tool. ``state`` is the record of the run."""

    name = "resolve_at_tool"

    @staticmethod
    @fused
    def step(settings, state, given, state_dot, out):
        model = state.model
        resolve(model.J_T, model.tau.shape[0], given.tau_cmd, model.tau)
        deliver(model, out, state.joints.tau_q_cmd)


@kernel
def deliver(model, tau_B, tau_q_cmd):
    """Add the posture to tau (N,), and give it to the allocation, tau_B (6,), and to the joints."""
    tau = model.tau
    for i in range(tau.shape[0]):
        tau[i] += model.tau_posture[i]
    for i in range(6):
        tau_B[i] = tau[i]
    for k in range(tau_q_cmd.shape[0]):
        tau_q_cmd[k] = tau[6 + k]
