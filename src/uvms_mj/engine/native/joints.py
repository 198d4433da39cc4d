"""The joints of a run: positions, velocities and torques, in memory that the loop and the stages share."""

import numpy as np

from ...plant.arm import Arm
from ...stages.signals import Signal, joint_signals


class Joints:
    """The joints of a vehicle.

    Attributes:
        q, q_dot: (n,) true position and velocity at t_k [rad or m, and per second].
        q_ddot: (n,) acceleration of the last step.
        tau_q_cmd: (n,) commanded torque or force [N m or N].
        tau_q: (n,) torque or force of the motors.
        reached: the arrays whose addresses are in the LOOP record, by its fields.
        state: the arrays that a reset restores.
    """

    def __init__(self, arm: Arm) -> None:
        links = arm.links
        self.n = len(links)
        self.q, self.q_dot, self.q_ddot, self.tau_q_cmd, self.tau_q, self.q_safe = np.zeros((6, self.n))
        self.state = (self.q, self.q_dot, self.q_ddot, self.tau_q_cmd, self.tau_q)
        self.reached = {
            "q_at": self.q,
            "q_dot_at": self.q_dot,
            "q_ddot_at": self.q_ddot,
            "tau_q_cmd_at": self.tau_q_cmd,
            "tau_q_at": self.tau_q,
            "q_safe_at": self.q_safe,
            "effort_at": np.array([link.effort for link in links]),
            "motor_index_at": np.array([link.actuator_id for link in links], dtype=np.int64),
            "torque_of_ctrl_at": np.array([link.torque_of_ctrl for link in links]),
        }

    def recorded(self) -> list[tuple[Signal, np.ndarray]]:
        """The recorded signals, each with its memory; none for a rigid vehicle."""
        return list(zip(joint_signals(self.n), (self.q, self.q_dot, self.tau_q), strict=True)) if self.n else []
