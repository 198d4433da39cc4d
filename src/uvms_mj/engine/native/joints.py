"""The joints in the record of a run: positions, velocities and torques."""

import numpy as np

from ...setup.base import Setup
from ...stages.joint_signals import (
    encoder_signals,
    joint_command_signal,
    joint_saturation_signal,
    joint_signals,
    joint_torque_signal,
)
from ...stages.signals import Signal


def fill_joints(run: np.ndarray, setup: Setup) -> None:
    """Set the motors and the limits of the joints in the record of a run (1,)."""
    links, given = setup.vehicle.arm.links, run["joints"]
    for name in ("effort", "speed_limit"):
        given[name] = [getattr(link, name) for link in links]
    for i, name in enumerate(("q_min", "q_max")):
        given[name] = [link.range[i] for link in links]
    run["motor_index"] = [link.actuator_id for link in links]
    run["torque_of_ctrl"] = [link.torque_of_ctrl for link in links]
    run["encoded"] = setup.scenario.encoder.runs


def recorded_joints(run: np.ndarray, setup: Setup) -> list[tuple[Signal, np.ndarray]]:
    """The recorded signals, each with its memory; none for a rigid vehicle."""
    n, true, given = len(setup.vehicle.arm.links), run["encoder"], run["joints"]
    if n == 0:
        return []
    found = [*zip(joint_signals(n), (true["q"], true["q_dot"]), strict=True), (joint_torque_signal(n), run["tau_q"])]
    found.append((joint_saturation_signal(n), run["saturation"]))
    if setup.scenario.encoder.runs:
        found += zip(encoder_signals(n), (given["q_m"], given["q_dot_m"]), strict=True)
    if type(setup.interface).torque_controlled:
        found.append((joint_command_signal(n), given["tau_q_cmd"]))
    return found
