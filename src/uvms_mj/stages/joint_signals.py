"""The signals of a vehicle's joints. Units are those of hinges or of slides."""

from .signals import CLOCK, Signal

_COORDINATE, _RATE, _EFFORT = "rad or m", "rad/s or m/s", "N m or N"


def joint_signals(n: int) -> tuple[Signal, ...]:
    """The true positions and velocities of n joints."""
    return (
        Signal("q", (n,), _COORDINATE, "-", "position of each joint"),
        Signal("q_dot", (n,), _RATE, "-", "velocity of each joint"),
    )


def encoder_signals(n: int) -> tuple[Signal, ...]:
    """Set by the encoder of n joints. Recorded unless it is perfect."""
    return (
        Signal("q_m", (n,), _COORDINATE, "-", "measured position of each joint"),
        Signal("q_dot_m", (n,), _RATE, "-", "measured velocity of each joint"),
    )


def encoder_given(n: int) -> tuple[Signal, ...]:
    """Given to the encoder of n joints."""
    return CLOCK + joint_signals(n)


def joint_command_signal(n: int) -> Signal:
    """The signal of the commanded torques (n,)."""
    return Signal("tau_q_cmd", (n,), _EFFORT, "-", "torque commanded of each joint")


def joint_torque_signal(n: int) -> Signal:
    """The signal of the torques (n,) that the joints' motors give."""
    return Signal("tau_q", (n,), _EFFORT, "-", "torque of each joint's motor")


def joint_saturation_signal(n: int) -> Signal:
    """The running signal of the motors' limits."""
    return Signal(
        "joint_saturation_time", (n,), "s", "-", "time with each joint's motor at its limit of torque or speed"
    )


def joints_given(n: int) -> tuple[Signal, ...]:
    """Given to the interface of n joints."""
    return (
        *CLOCK,
        *encoder_signals(n),
        joint_command_signal(n),
        Signal("effort", (n,), _EFFORT, "-", "greatest torque of each motor"),
        Signal("speed_limit", (n,), _RATE, "-", "speed at which each motor gives no torque; infinite: none"),
        Signal("q_min", (n,), _COORDINATE, "-", "least position of each joint; infinite: none"),
        Signal("q_max", (n,), _COORDINATE, "-", "greatest position of each joint; infinite: none"),
    )


WRIST_TRUE = Signal("wrench_S", (6,), "N, N m", "S", "wrench of the parent on the links behind the wrist sensor")
WRIST_READING = Signal("wrench_m_S", (6,), "N, N m", "S", "reading of the wrist sensor")
"""Recorded with a wrist sensor, about its origin in its frame."""


def wrist_given(n: int) -> tuple[Signal, ...]:
    """Given to the wrist sensor."""
    return (*CLOCK, WRIST_TRUE)


JOINT_SIGNALS = (
    *joint_signals(0),
    joint_torque_signal(0),
    *encoder_signals(0),
    joint_command_signal(0),
    joint_saturation_signal(0),
    WRIST_TRUE,
    WRIST_READING,
)
"""Recorded of a vehicle with joints: always q, q_dot, tau_q and joint_saturation_time; the
others where they may differ from these."""
