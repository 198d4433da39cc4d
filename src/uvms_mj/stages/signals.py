"""All signals, given to a law or recorded, with their units, frames and shapes.

To add a signal, add a line to a table here and a line where it is computed.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from ..errors import suggestion

BANDED = ("tau", "s", "u", "push", "tau_q", "wet_fraction")
"""Signals whose values between rows count, as they may alternate from one step to the next or pass a limit. Where rows
are further apart than steps, each has a band."""
BAND = {name: (f"{name}_low", f"{name}_high") for name in BANDED}
"""Names of the signals of a band: least and largest value since the row before."""
OF_JOINTS = ("q", "q_dot", "tau_q", "q_m", "q_dot_m", "tau_q_cmd", "joint_saturation_time", *BAND["tau_q"])
"""Signals with one number a joint."""
OF_THRUSTERS = ("u", "u_cmd", "pwm", "pwm_cmd", "inflow", "thruster_saturation_time", *BAND["u"])
"""Signals with one number a thruster."""
OWN_UNIT = "law's own"
"""Unit shown for a state or gain of a law that declares none."""


@dataclass(frozen=True)
class Signal:
    """One named signal: its shape for one instant, unit, frame (W, B, or - without a frame), meaning and kind (f8 for
    float64, i8 for int64)."""

    name: str
    shape: tuple[int, ...]
    unit: str
    frame: str
    meaning: str
    kind: str = "f8"

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    @property
    def components(self) -> tuple[str, ...]:
        """Name of each component: x y z, w x y z, x y z roll pitch yaw, or 1 2 3 ...; an empty name for a scalar. Two
        vectors of three are no twist, and numbers of one unit without a frame are one of each thruster, joint, fin."""
        counted = self.frame == "-" and bool(self.shape) and ", " not in self.unit
        if counted or self.size not in COMPONENTS or self.shape == (2, 3):
            return tuple(str(i + 1) for i in range(self.size))
        return COMPONENTS[self.size]

    @property
    def vectors(self) -> int:
        """Number of its vectors of three in W or B; 0 for numbers of another kind."""
        return self.shape[0] if len(self.shape) == 2 and self.shape[1] == 3 and self.frame != "-" else 0

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each component. Of two units, the first is for the linear and the second for the angular half."""
        linear, _, angular = self.unit.partition(", ")
        half = self.size // 2
        return (linear,) * half + (angular,) * (self.size - half) if angular else (self.unit,) * self.size


AXES = ("x", "y", "z", "roll", "pitch", "yaw")
"""Components of a signal of six numbers."""
COMPONENTS = {1: ("",), 3: AXES[:3], 4: ("w", *AXES[:3]), 6: AXES}
_WRENCH = "N, N m"
_TWIST = "m/s, rad/s"

CLOCK = (
    Signal("t", (), "s", "-", "time of the instant"),
    Signal("period", (), "s", "-", "period of the stage; of a law, the control period"),
    Signal("instant", (), "1", "-", "number of the stage's instant: 0, 1, 2, ...", "i8"),
    Signal("key", (), "1", "-", "key of the stage's random numbers, from the seed", "i8"),
)
"""Given to every stage."""

MEASURED = (
    Signal("p_WB", (3,), "m", "W", "position of B's origin"),
    Signal("quat_WB", (4,), "1", "W", "attitude, unit quaternion w x y z"),
    Signal("R_WB", (3, 3), "1", "W", "attitude, rotation matrix: a_W = R_WB a_B"),
    Signal("nu", (6,), _TWIST, "B", "velocity [v; omega]"),
    Signal("f_contact_m_W", (3,), "N", "W", "measured force of the wall, of the same instant: k_c depth + b_c v"),
    Signal("tau_contact_m_B", (6,), _WRENCH, "B", "f_contact_m_W as a wrench at B's origin"),
)
"""Set by navigation: the measurements."""

TRUE = (
    *MEASURED[:4],
    Signal("f_springs_W", (3,), "N", "W", "force of the walls' springs at the instant: k_c depth + b_c v"),
    Signal("tau_springs_B", (6,), _WRENCH, "B", "f_springs_W as a wrench at B's origin"),
    Signal("v_c_W", (3,), "m/s", "W", "velocity of the current at the vehicle"),
    Signal("wave_head", (), "m", "W", "pressure of the waves at B's origin, over rho g: a pressure sensor's z is less"),
    Signal("nu_dot", (6,), "m/s^2, rad/s^2", "B", "acceleration, time derivative of nu"),
    Signal("tau", (6,), _WRENCH, "B", "wrench produced by the thrusters, B u"),
)
"""Given to navigation: the truth that its sensors measure. nu_dot and tau belong to the last step."""

TOOL = (
    Signal("p_WT", (3,), "m", "W", "position of the tool's frame T, the frame of the task"),
    Signal("quat_WT", (4,), "1", "W", "attitude of T, w x y z"),
    Signal("nu_T", (6,), _TWIST, "T", "velocity of T"),
)
"""Recorded with a tool: its true motion."""

MANIPULABILITY = Signal(
    "manipulability", (), "1", "-", "volume of the tool's accelerations over the volume with locked joints"
)
"""Recorded with a tool: sqrt(det(M_BB) det(J M^-1 J^T)) >= 1 of the law's model, :mod:`uvms_mj.physics.operational`."""

REFERENCE = (
    Signal("p_d", (3,), "m", "W", "desired position"),
    Signal("p_d_dot", (3,), "m/s", "W", "desired velocity"),
    Signal("p_d_ddot", (3,), "m/s^2", "W", "desired acceleration"),
    Signal("quat_d", (4,), "1", "W", "desired attitude, w x y z"),
    Signal("omega_d", (3,), "rad/s", "W", "desired angular velocity"),
    Signal("omega_d_dot", (3,), "rad/s^2", "W", "desired angular acceleration"),
)
"""Set by guidance."""

ERRORS = (
    Signal("quat_e", (4,), "1", "B", "error quaternion conj(quat_d) quat_WB with w >= 0"),
    Signal("eta_e", (6,), "m, 1", "B", "pose error [R_WB^T (p_WB - p_d); vector part of quat_e]"),
    Signal("nu_e", (6,), _TWIST, "B", "velocity error nu - nu_d"),
    Signal("nu_d_dot", (6,), "m/s^2, rad/s^2", "B", "desired acceleration"),
)
"""Tracking errors: measurement minus reference."""

ESTIMATES = (
    Signal("M_hat", (6, 6), "kg, kg m, kg m^2", "B", "estimated inertia, added mass included"),
    Signal("C_hat_nu", (6,), _WRENCH, "B", "estimated Coriolis and centripetal wrench C_hat(nu) nu"),
    Signal("D_hat_nu", (6,), _WRENCH, "B", "estimated damping wrench D_hat(nu) nu"),
    Signal("g_hat", (6,), _WRENCH, "B", "estimated restoring wrench"),
)
"""The controller's model of the vehicle."""

APPLIED = (
    Signal("tau_hat", (6,), _WRENCH, "B", "wrench of the last step's commanded thrusts: B u_cmd with the file's B"),
)
"""Thrust that the controller believes to have acted since the last step; zero before the first one."""

IMPEDANCE = (
    Signal("M_d", (6, 6), "kg, kg m, kg m^2", "B", "desired inertia"),
    Signal("D_d", (6, 6), "N s/m, N s, N m s", "B", "desired damping"),
    Signal("K_d", (6,), "N/m, N m", "B", "desired stiffness, a diagonal"),
    Signal("K_f", (6,), "1", "B", "desired force gain, a diagonal, eq. (7)"),
    Signal("F_d", (6,), _WRENCH, "B", "desired wrench of the wall on the vehicle, eq. (7)"),
)
"""The desired impedance of the scenario."""

SCHEDULED = IMPEDANCE[3:]
"""Set by the schedule of the impedance, if there is one, and then recorded."""

TASK = (
    Signal("F_1", (6,), "1/s", "B", "gain of the pose error in s, eq. (14), a diagonal"),
    Signal("F_2", (6,), "1", "B", "gain of zeta in s, eq. (14), a diagonal"),
    Signal("A", (6,), "1/s", "B", "pole of zeta, eq. (15), a diagonal"),
    Signal("w", (6,), "m/s^2, rad/s^2", "B", "M_d^-1 (K_d eta_e + D_d nu_e - K_f (tau_c - F_d)), eq. (7)"),
    Signal("tau_nom", (6,), _WRENCH, "B", "nominal control, eq. (23)"),
    Signal("s", (6,), _TWIST, "B", "sliding variable, eq. (14)"),
    Signal("zeta", (6,), _TWIST, "B", "state of the dynamic compensator, eq. (15)"),
)
"""Set by the impedance task."""

WRENCH_COMMAND = Signal("tau_cmd", (6,), _WRENCH, "B", "wrench commanded by the law")
"""Set by the law."""

OBSERVER_GIVEN = CLOCK + MEASURED + REFERENCE + ERRORS + ESTIMATES + APPLIED
"""Given to the observer of the contact force."""

TASK_GIVEN = OBSERVER_GIVEN + IMPEDANCE
"""Given to the impedance task, and to a law that does not use it."""

GIVEN = TASK_GIVEN + TASK
"""Fields of the record ``signals`` that a law is given: measurements, reference, estimates and task, without the
truth. The stages before the law are given the beginning of this record, and fill a later part."""

TRUTH = (
    Signal("M", (6, 6), "kg, kg m, kg m^2", "B", "inertia, added mass included"),
    Signal("nu_r", (6,), _TWIST, "B", "velocity relative to the water"),
    Signal("nu_c_dot", (6,), "m/s^2, rad/s^2", "B", "time derivative of the current's velocity in B, which rotates"),
    Signal("C_nu_r", (6,), _WRENCH, "B", "Coriolis and centripetal wrench C(nu_r) nu_r"),
    Signal("D_nu_r", (6,), _WRENCH, "B", "damping wrench D(nu_r) nu_r"),
    Signal("g_eta", (6,), _WRENCH, "B", "restoring wrench"),
    Signal("tau_dist", (6,), _WRENCH, "B", "disturbance wrench, eq. (10), with the drag of the tether"),
)
"""True values, given to the ideal law, eq. (13), only."""

_SET = {signal.name: signal for signal in (*GIVEN, WRENCH_COMMAND, *TRUTH, *TRUE)}

STATE = (
    Signal("t", (), "s", "-", "time"),
    *(_SET[name] for name in ("p_WB", "quat_WB", "nu", "nu_dot", "p_d", "p_d_dot", "p_d_ddot", "quat_d")),
    *(_SET[name] for name in ("eta_e", "nu_e", "s", "zeta", "tau_nom", "tau_cmd", "tau", "tau_dist")),
    Signal("f_contact_W", (3,), "N", "W", "force of the wall on the vehicle"),
    Signal("f_contact_m_W", (3,), "N", "W", "measured contact force, given to the law"),
    Signal("stretch_W", (3,), "m", "W", "stretch of the wall's tangential spring"),
)
"""Recorded at t_k: the state, the values that the law computed from it, and the true contact force."""

RUNNING = (
    Signal("tau_variation", (6,), _WRENCH, "B", "total variation of tau: sum of |tau_j - tau_(j-1)| for j <= k"),
    Signal("tau_step_max", (6,), _WRENCH, "B", "largest |tau_j - tau_(j-1)| for j <= k"),
    Signal("tau_max", (6,), _WRENCH, "B", "largest |tau_j| for j <= k"),
    Signal("effort", (6,), "N^2 s, N^2 m^2 s", "B", "control effort: integral of tau^2"),
    Signal("force_peak", (), "N", "W", "largest pushing force so far"),
    Signal("impulse", (), "N s", "W", "integral of the pushing force"),
    Signal("wall_work", (), "J", "W", "work done on the wall"),
    Signal("touches", (), "1", "-", "number of contacts made so far"),
    Signal("first_contact", (), "s", "-", "time of the first contact, -1 before it"),
    Signal("final_impulse", (), "N s", "W", "integral of the pushing force over the last 0.5 s of the run's duration"),
    Signal("final_low", (), "N", "W", "least pushing force over the last 0.5 s of the run's duration"),
    Signal("final_high", (), "N", "W", "greatest pushing force over the last 0.5 s of the run's duration"),
    Signal("saturation_time", (), "s", "-", "time with a thruster at u_min or u_max, where tau differs from tau_cmd"),
    Signal("boundary_layer_time", (6,), "s", "B", "time with |s_i| < epsilon (1e-3 if the law has no epsilon)"),
)
"""Accumulated at every step, at any log rate, and recorded as running signals."""

MEASURED_MOTION = (
    Signal("p_WB_m", (3,), "m", "W", "measured position of B's origin"),
    Signal("quat_WB_m", (4,), "1", "W", "measured attitude, w x y z"),
    Signal("nu_m", (6,), _TWIST, "B", "measured velocity"),
)
"""Recorded unless navigation is perfect."""

DELAYED = (Signal("tau_cmd_delayed", (6,), _WRENCH, "B", "tau_cmd after controller.delay, given to the actuation"),)
"""Recorded if the law has a computation delay."""

IN_TASK_FRAME = (
    *(s.name for s in ERRORS + IMPEDANCE + TASK),
    *("tau_cmd", "tau_cmd_delayed", "boundary_layer_time", *BAND["s"]),
)
"""Signals in the frame of the task. With a tool, their recorded frame is T in place of B."""

UNSTEADY = (
    _SET["v_c_W"],
    Signal(
        *("v_c_dot_W", (3,), "m/s^2", "W"),
        "rate of v_c_W that acts on the added mass: along the vehicle's path, and with [obstacle] a_c_W",
    ),
    Signal("a_c_W", (3,), "m/s^2", "W", "acceleration of the water at the vehicle"),
)
"""Recorded unless the current is constant."""

AT_SURFACE = (
    Signal("wet_fraction", (), "1", "-", "share of the displaced mass that is below the surface"),
    Signal("dry_time", (), "s", "-", "time with nothing of the vehicle below the surface"),
)
"""Recorded of a vehicle with ``buoyancy.shapes``."""

WAVES = (_SET["wave_head"],)
"""Recorded with a sea."""

FINAL_WINDOW_S = 0.5
"""Length of the window at the end of a run that gives its final values [s]."""

RECORDED = STATE + RUNNING

PUSH = Signal("push", (), "N", "W", "pushing force of the vehicle on the walls, zero or positive")
"""The sum of the normal forces. A trace computes it from the recorded forces; its band is recorded."""


def band_signals(signal: Signal) -> tuple[Signal, Signal]:
    """The band of a signal, recorded at row k where rows are further apart than steps: the least and the largest value
    of each component over all steps j after the row before, t_(k-1) < t_j <= t_k. The first row has its own step."""
    low, high = BAND[signal.name]
    of = f"{signal.name} since the row before, at every step"
    return replace(signal, name=low, meaning=f"least {of}"), replace(signal, name=high, meaning=f"largest {of}")


def actuation_given(n: int) -> tuple[Signal, ...]:
    """Given to the actuation of a vehicle with n thrusters."""
    return (
        *CLOCK,
        WRENCH_COMMAND,
        Signal("B", (6, n), "1, m", "B", "allocation matrix: tau = B u"),
        Signal("B_pinv", (n, 6), "1, 1/m", "B", "pseudoinverse of B"),
        Signal("u_min", (n,), "N", "-", "least thrust of each thruster"),
        Signal("u_max", (n,), "N", "-", "greatest thrust of each thruster"),
    )


def thruster_signal(n: int) -> Signal:
    """The signal of the thrust u = B^+ tau_cmd (n,) within its limits, eq. (25)."""
    return Signal("u", (n,), "N", "-", "thrust of each thruster")


def thruster_saturation_signal(n: int) -> Signal:
    """The running signal of the limits of n thrusters."""
    meaning = "time with the command of each thruster at u_min or u_max"
    return Signal("thruster_saturation_time", (n,), "s", "-", meaning)


def deflection_signal(n: int) -> Signal:
    """Recorded if one of n fins has an actuator."""
    return Signal("fin_deflections", (n,), "rad", "-", "deflection of each fin by its actuator, beyond deflection_deg")


def tether_signals(n: int) -> tuple[Signal, Signal]:
    """Recorded if a tether has n nodes, which move."""
    return (
        Signal("tether_nodes", (n, 3), "m", "W", "nodes of the tether, from its anchor to the vehicle"),
        Signal(
            "tether_tension", (max(n - 1, 0),), "N", "-", "tension of each element of the tether, from its anchor on"
        ),
    )


def coupling_signal(n: int) -> Signal:
    """Recorded of a vehicle with n couplings to others."""
    return Signal(
        "f_couplings_W", (n, 3), "N", "W", "force of each coupling on the vehicle, in the order of the world's"
    )


def wall_signals(k: int) -> tuple[Signal, Signal]:
    """Recorded of ``walls[k]`` if it moves: the pose of its frame S, whose origin is its position."""
    return (
        Signal(f"p_WS{k}", (3,), "m", "W", f"position of walls[{k}], which moves"),
        Signal(f"quat_WS{k}", (4,), "1", "W", f"attitude of walls[{k}], w x y z"),
    )


def contact_signals(n: int) -> tuple[Signal, ...]:
    """Recorded if there are n contacts beside the probe's with [wall]."""
    return (
        Signal("f_normal", (), "N", "-", "pushing force: sum of the normal forces of all contacts"),
        Signal("f_contacts_W", (n, 3), "N", "W", "force of each contact of the list on the vehicle"),
        Signal("contact_depths", (n,), "m", "-", "depth of each contact of the list"),
        Signal("tau_contacts_B", (6,), _WRENCH, "B", "total contact force as a wrench at B's origin"),
    )


def thrusters_given(n: int) -> tuple[Signal, ...]:
    """Given to the thrusters of a vehicle with n of them."""
    return (
        *CLOCK,
        commanded_signal(n),
        Signal("inflow", (n,), "m/s", "-", "speed of advance, the velocity of each thruster in water along its axis"),
    )


EFFECT_WRENCH = Signal("tau", (6,), _WRENCH, "B", "wrench of the effect on the vehicle, at B's origin")
"""Set by an effect of a user's own."""


NORMAL_FORCE = (
    Signal("f_normal_W", (3,), "N", "W", "normal force of the walls' springs on the body, of the same instant"),
    Signal("tau_normal_B", (6,), _WRENCH, "B", "f_normal_W as a wrench at B's origin"),
)
"""Given to effects: the contacts of the body that the effect acts on, without their friction."""


def effect_given(n: int) -> tuple[Signal, ...]:
    """Given to the effects on a vehicle with n thrusters: the truth."""
    return (
        *CLOCK,
        *TRUE[:4],
        Signal("nu_r", (6,), _TWIST, "B", "velocity relative to the water"),
        _SET["v_c_W"],
        *NORMAL_FORCE,
        thruster_signal(n),
    )


def commanded_signal(n: int) -> Signal:
    """The signal of the commanded thrusts (n,)."""
    return Signal("u_cmd", (n,), "N", "-", "thrust commanded of each thruster")


def pulse_signal(n: int) -> Signal:
    """The signal of the pulse widths (n,) that thrusters with a speed controller take."""
    return Signal("pwm", (n,), "us", "-", "pulse width of each thruster's speed controller; 1500 us is neutral")


TAU_LOST = Signal("tau_lost", (6,), _WRENCH, "B", "part of tau_cmd that is not allocated, tau_cmd - B u_cmd")


def record_dtype(signals: tuple[Signal, ...]) -> np.dtype:
    """Structured dtype with one field per signal, of 8 bytes a number."""
    return np.dtype([(s.name, s.kind, s.shape) for s in signals], align=True)


_COORDINATE, _RATE, _EFFORT = "rad or m", "rad/s or m/s", "N m or N"  # of a hinge or of a slide


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


def recordable() -> tuple[Signal, ...]:
    """All signals that a run can record, but for bands, the states of stages and the wrenches of effects of a user's
    own; in place of ``walls[k]`` there is the first wall, and a length that depends on the vehicle is zero."""
    of_thrusters = (thruster_signal(0), thruster_saturation_signal(0), commanded_signal(0), pulse_signal(0), TAU_LOST)
    return (
        *(*RECORDED, *MEASURED_MOTION, *SCHEDULED, *DELAYED, *UNSTEADY, *WAVES, *AT_SURFACE),
        *(*contact_signals(0), *wall_signals(0), *of_thrusters, *JOINT_SIGNALS, *TOOL, MANIPULABILITY),
        *(deflection_signal(0), *tether_signals(0), coupling_signal(0)),
    )


def names_taken() -> set[str]:
    """The names of recorded signals that a state may not have: all but u_cmd, since an allocation with thrusters of its
    own records the command to them as its state."""
    return {signal.name for signal in recordable()} - {commanded_signal(0).name}


_WORDS = {"force": ("push", "f_contact_W", "force_peak"), "position": ("p_WB",), "time": ("t",), "thrust": ("u",)}
"""The signals of words for them."""


def no_signal(name: object, known: Collection[str]) -> str:
    """The error of a signal that is not among the known ones."""
    meant = [repr(each) for each in _WORDS.get(str(name), ()) if each in known]
    hint = f"did you mean {' or '.join(meant)}?"
    return f"no signal {name!r}; {hint if meant else suggestion(str(name), known)}"
