"""The joints of a run: positions, velocities and torques, in memory that the loop and the stages share."""

import numpy as np

from ...setup.base import Setup
from ...stages.joint_signals import (
    encoder_given,
    encoder_signals,
    joint_command_signal,
    joint_saturation_signal,
    joint_signals,
    joint_torque_signal,
    joints_given,
)
from ...stages.signals import Signal, record_dtype


class Joints:
    """The joints of a vehicle.

    Attributes:
        true: the record that the encoder is given (1,).
        given: the record that the joint interface is given (1,); it begins with the measurements.
        q, q_dot: (n,) true position and velocity at t_k [rad or m, and per second].
        q_m, q_dot_m: (n,) measured ones; the true ones themselves if the encoder is perfect.
        q_ddot: (n,) acceleration of the last step.
        tau_q_cmd: (n,) torque or force that the law commands [N m or N].
        wanted: (n,) torque or force that the interface sets.
        tau_q: (n,) torque or force of the motors.
        saturation: (n,) time at their limits until t_k [s].
        interface: the joint interface, or None for a rigid vehicle.
        frames_at: address of the FRAME records (1 + n,) of the links at the true positions.
        reached: the arrays whose addresses are in the LOOP record, by its fields.
        state: the arrays that a reset restores.
    """

    def __init__(self, setup: Setup, context: np.ndarray) -> None:
        scenario, links = setup.scenario, setup.vehicle.arm.links
        self.n, self.encoded = len(links), scenario.encoder.runs
        self.interface = setup.interface if links else None
        self.frames_at = int(context["tree"]["frames_at"][0])
        self.true, self.given = (np.zeros(1, record_dtype(each(self.n))) for each in (encoder_given, joints_given))
        self.q_m, self.q_dot_m = self.given["q_m"][0], self.given["q_dot_m"][0]
        self.q, self.q_dot = self.q_m, self.q_dot_m
        if self.encoded:
            self.q, self.q_dot = self.true["q"][0], self.true["q_dot"][0]
        self.tau_q_cmd = self.given["tau_q_cmd"][0]
        self.q_ddot, self.wanted, self.tau_q, self.q_safe = np.zeros((4, self.n))
        self.saturation, saturation_next = np.zeros((2, self.n))
        for name in ("effort", "speed_limit"):
            self.given[name] = [getattr(link, name) for link in links]
        for i, name in enumerate(("q_min", "q_max")):
            self.given[name] = [link.range[i] for link in links]
        self.state = (self.true, self.given, self.q_ddot, self.wanted, self.tau_q, self.saturation, saturation_next)
        self.reached = {
            "q_at": self.q,
            "q_dot_at": self.q_dot,
            "q_ddot_at": self.q_ddot,
            "wanted_at": self.wanted,
            "tau_q_at": self.tau_q,
            "q_safe_at": self.q_safe,
            "effort_at": self.given["effort"],
            "speed_limit_at": self.given["speed_limit"],
            "motor_index_at": np.array([link.actuator_id for link in links], dtype=np.int64),
            "saturation_at": self.saturation,
            "saturation_next_at": saturation_next,
            "torque_of_ctrl_at": np.array([link.torque_of_ctrl for link in links]),
        }

    def recorded(self) -> list[tuple[Signal, np.ndarray]]:
        """The recorded signals, each with its memory; none for a rigid vehicle."""
        if self.interface is None:
            return []
        n = self.n
        found = [*zip(joint_signals(n), (self.q, self.q_dot), strict=True), (joint_torque_signal(n), self.tau_q)]
        found.append((joint_saturation_signal(n), self.saturation))
        if self.encoded:
            found += zip(encoder_signals(n), (self.q_m, self.q_dot_m), strict=True)
        if type(self.interface).torque_controlled:
            found.append((joint_command_signal(n), self.tau_q_cmd))
        return found
