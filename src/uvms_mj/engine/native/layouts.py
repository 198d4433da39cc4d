"""Records shared by Python and compiled code. A field that ends in ``_at`` is a memory address."""

import numpy as np

from ...physics.carriers import CARRIER
from ...physics.contact import CONTACT
from ...physics.hydrodynamics import WATER
from ...physics.operational import TOOL
from ...physics.pairs import PAIR
from ...physics.posture import WORK
from ...physics.surfaces import SURFACE
from ...physics.tree import FRAME, LINK
from ...physics.varying import varying
from ...stages.signals import CLOCK, GIVEN, MEASURED, RECORDED, TRUE, record_dtype

CLOCKS = record_dtype(CLOCK)
"""The beginning of every record that a stage is given."""
TRUTHS = record_dtype(CLOCK + TRUE)
"""Record given to navigation: the state and the contact force of the instant."""
_OTHERS = {s.name for s in GIVEN + TRUE} - {s.name for s in MEASURED} | {s.name for s in TRUE[:4]}
_OTHERS |= {"tau_cmd", "f_contact_m_W", *(CONTACT.names or ())}
ROW = record_dtype(tuple(s for s in RECORDED if s.name in ("t", "f_contact_W") or s.name not in _OTHERS))
"""The recorded signals that the core computes; all others lie where a stage or the contact has set them."""

TREE = np.dtype([("links", "i8"), ("links_at", "i8"), ("frames_at", "i8"), ("gravity_B", "f8", (3,))], align=True)
"""A tree: LINK records one after the other, base first, FRAME records likewise, and the acceleration of gravity in B
[m/s^2]. A rigid vehicle has no links."""
LINK_SIZE, FRAME_SIZE = LINK.itemsize, FRAME.itemsize


def _whole(*names: str) -> list[tuple[str, str]]:
    """Fields that are integers, among them addresses."""
    return [(name, "i8") for name in names]


_MODEL = [
    ("tree", TREE),
    ("n", "i8"),  # joints
    ("places", "i8"),  # whether the frames of the tree are its own
    ("tool", TOOL),
    ("gravity_W", "f8", (3,)),
    *_whole("q_at", "q_dot_at"),  # (n,) measured position and velocity of the joints
    *_whole("armature_at", "gear_at"),  # (n,) inertia of the rotors, and viscous friction of the gears
    *_whole("tau_q_cmd_at"),  # (n,) commanded torques
    # of one instant; all matrices are flat arrays, row by row
    *_whole("M_at", "C_at", "D_at", "g_at"),  # (N, N); (N,) C zeta, D zeta and g
    *_whole("L_at"),  # (N, N) Cholesky factor of M
    *_whole("J_T_at", "MJ_T_at", "J_bar_at"),  # (N, 6) J^T of the tool, M^-1 J^T, and J_bar
    *_whole("tau_posture_at"),  # (N,) of the commanded torques, what the posture adds
    ("posture", WORK),
    ("M_BB", "f8", (6, 6)),
    ("L_task", "f8", (36,)),
    ("Lambda", "f8", (36,)),
    ("manipulability", "f8", (1,)),
    ("J_dot_zeta", "f8", (6,)),
    ("nu_T", "f8", (6,)),
    ("work", "f8", (6,)),
]


def model_dtype(n: int) -> np.dtype:
    """The law's model of a vehicle with n joints or a tool: its estimates at the measured state (:mod:`.law_model`).

    The length of ``tau``, N = 6 + n, is known to the machine code, which takes a quarter less time than for any N.
    """
    return np.dtype([*_MODEL, ("tau", "f8", (6 + n,))], align=True)  # commanded wrench and torques


CONTEXT = np.dtype(
    [
        *_whole("time_at", "R_at"),  # mjData.time, and xmat of the body
        *_whole("qpos_at", "qvel_at"),  # of the free joint
        ("M_at", "i8"),  # the joint's 21 entries of mjData.M
        ("qLD_at", "i8"),  # the same entries of mjData.qLD, or 0 if mj_factorM has to factor all of M
        ("qLDiagInv_at", "i8"),
        ("passive_at", "i8"),  # the joint's entries of mjData.qfrc_passive
        ("loop_at", "i8"),  # LOOP, or 0 without a closed loop
        ("calls", "i8"),
        ("water", WATER),
        ("current", varying(3)),  # in W [m/s]
        ("disturbance", varying(6)),  # in B [N, N m]
        *_whole("shear_at", "shear_rows"),  # rows of [depth, factor]
        ("factor", "f8", (1,)),  # of the current at the vehicle's depth
        ("slope", "f8", (1,)),  # its derivative by the depth [1/m]
        ("rate", "f8", (6,)),  # time derivative of the disturbance, not used
        ("nu", "f8", (6,)),
        ("nu_r", "f8", (6,)),
        ("work", "f8", (6,)),
        ("wrench", "f8", (6,)),
        ("added", "f8", (21,)),
        ("M_left", "f8", (21,)),  # mjData.M after the callback
        ("passive_before", "f8", (6,)),  # qfrc_passive before the callback
        ("passive_left", "f8", (6,)),  # qfrc_passive after the callback
        ("no_contact", CONTACT),  # used without a loop, and so without a wall
        ("pairs", "i8"),  # number of contacts in the list of the loop
        ("f_pairs_W", "f8", (3,)),  # their total force on the base
        ("tau_pairs_B", "f8", (6,)),  # and wrench at B's origin
        ("carriers", "i8"),  # frames of contacts, if there are others than B
        # of a vehicle with joints
        ("tree", TREE),  # the water on its links
        ("M_BB", "f8", (6, 6)),  # added mass of all links, about B's origin in B
        ("gravity_W", "f8", (3,)),
        *_whole("q_at", "q_dot_at"),  # of MuJoCo
        *_whole("M_size", "M_rows_at"),  # entries of mjData.M of the whole tree, and where each link's row begins
        ("wrench_at", "i8"),  # (6 + n,) generalised wrench of the water, in B
        *_whole("joints_before_at", "joints_left_at"),  # (n,) qfrc_passive before the callback and after it
    ],
    align=True,
)
"""One vehicle attached to one mjData."""

BODY = np.dtype(
    [
        ("M_RB", "f8", (6, 6)),
        ("M_inv", "f8", (6, 6)),  # inverse of M_RB + M_A
        ("mass", "f8"),
        ("r_g", "f8", (3,)),
        ("gravity_W", "f8", (3,)),
        ("face", "f8"),  # x of the wall's face in W
        ("reach", "f8"),  # radius of the probe
        ("softness", "f8"),  # of MuJoCo's contact [1/kg]
        ("qpos", "f8", (7,)),  # as MuJoCo's free joint has them
        ("qvel", "f8", (6,)),
        ("qacc", "f8", (6,)),
        ("distance", "f8"),  # from the wall's face to the probe
        ("fromto", "f8", (6,)),  # nearest points of both in W
        ("contact", "f8", (4,)),  # whether they touch, and the wall's normal force in W
        ("force", "f8", (6,)),
        ("work", "f8", (6,)),
    ],
    align=True,
)
"""The vehicle of the free_body engine: constants, state, and distance to the wall."""

WRIST = np.dtype(
    [
        ("rigid", TREE),  # true inertia of the links
        ("wet", TREE),  # true water on them
        ("model", TREE),  # estimates of both
        ("sensor", TOOL),  # its frame S on the link behind it
        ("gravity_W", "f8", (3,)),
        *_whole("weighs", "dynamic"),  # whether the model has weight, and motion
        ("context_at", "i8"),  # CONTEXT
        ("n", "i8"),  # joints
        ("places", "i8"),  # whether the frames of the model are its own
        *_whole("q_dot_at", "q_ddot_at"),  # (n,) true
        *_whole("q_m_at", "q_dot_m_at", "q_ddot_m_at"),  # (n,) measured
        ("q_dot_before_at", "i8"),  # (n,) of the instant before
        ("nu_before", "f8", (6,)),
        ("reading_at", "i8"),  # (6,)
        ("modelled", "f8", (6,)),
        ("work", "f8", (6,)),
        ("moment", "f8", (3,)),
    ],
    align=True,
)
"""The wrist sensor of a run."""

STAGE = np.dtype(
    [
        ("code_at", "i8"),  # machine code, or 0 if the stage runs as plain Python
        ("settings_at", "i8"),  # or, of a user's stage, its own memory
        *_whole("state_at", "given_at", "state_dot_at", "out_at"),  # the one that is given begins with CLOCKS
        *_whole("states", "period_steps"),  # numbers in state; time steps from one call to the next
        ("period", "f8"),
        *_whole("instant", "key"),  # number of its calls, and key of its random numbers
    ],
    align=True,
)
"""One stage of the loop."""
STAGE_SIZE, PAIR_SIZE, SURFACE_SIZE, CARRIER_SIZE = (each.itemsize for each in (STAGE, PAIR, SURFACE, CARRIER))

STOP_NONE, STOP_STATE, STOP_COMMAND, STOP_THRUST, STOP_STAGE, STOP_WAITING, STOP_JOINT = range(7)
JOINT_BOUND = 1e3
"""Largest |q| and |q_dot| of a joint in a run [rad or m, and per second]."""

LOOP = np.dtype(
    [
        # settings
        ("timestep", "f8"),
        *_whole("steps", "window_step"),  # number of time steps of the run, and the first one of the final window
        ("epsilon", "f8", (6,)),
        ("speed_bound", "f8", (6,)),
        ("position_bound", "f8"),
        ("tau_bound", "f8"),
        # the engine's memory
        *_whole("qacc_at", "ctrl_at"),  # of MuJoCo
        ("contact_at", "i8"),  # the contact sensor: found, normal force (3) in W, of the step
        ("distance_at", "i8"),  # the distance sensor, of the same instant as qpos
        ("fromto_at", "i8"),  # the sensor of the nearest points (6) in W
        ("contact", CONTACT),
        # the list of contacts beside that of the probe and [wall]
        *_whole("surfaces_at", "surfaces", "pairs_at"),  # SURFACE, one after the other; PAIR
        *_whole("f_pairs_at", "depths_at"),  # (n, 3) force of each pair in W, and (n,)
        ("push_of_pairs", "f8"),  # sum of their normal forces
        ("carriers_at", "i8"),  # CARRIER
        ("f_carried_W", "f8", (3,)),  # sum of the contact forces that MuJoCo's contact solver does not apply
        # stages
        *_whole("stages_at", "stages"),  # STAGE, one after the other
        *_whole("actuation", "next"),  # index of the first one that is given tau_cmd, and of the next one to run
        *_whole("s_at", "tau_cmd_at"),  # the sliding variable, or 0 without the impedance task
        # thrusters
        *_whole("controls", "thrusters"),  # entries of ctrl, and how many thrusters
        *_whole("columns_at", "columns_hat_at"),  # (n, 6), the columns of B, and of the file's, or 0 if tau_hat is tau
        *_whole("tau_hat_at", "tau_lost_at"),  # the latter the actuation's tau_cmd - tau_hat, or 0 if not recorded
        ("tau_given_at", "i8"),  # tau_cmd as the actuation is given it
        *_whole("u_min_at", "u_max_at"),  # limits of the command
        *_whole("low_at", "high_at"),  # limits of the vehicle's file
        *_whole("ctrl_index_at", "thrust_of_ctrl_at"),
        ("u_cmd_at", "i8"),  # as the actuation sets it
        ("thrust_at", "i8"),  # as the thrusters set it; u_cmd if they are ideal
        ("u_at", "i8"),  # within the limits of the vehicle's file
        ("saturated", "i8"),  # whether a command is at its limit
        # joints
        ("joints", "i8"),  # their number
        *_whole("q_at", "q_dot_at", "q_ddot_at"),  # (n,) at t_k, the acceleration of the last step
        *_whole("wanted_at", "tau_q_at"),  # torque that the interface sets, and that of the motors
        *_whole("effort_at", "speed_limit_at"),  # limits of the motors
        *_whole("motor_index_at", "torque_of_ctrl_at"),  # index in ctrl, -1 without a motor
        *_whole("saturation_at", "saturation_next_at"),  # time at the motors' limits until t_k, and until t_(k+1)
        ("q_safe_at", "i8"),  # initial positions
        ("tau_before", "f8", (6,)),
        # the current step
        ("remaining", "i8"),  # evaluations that are steps, before Simulation has the next word
        ("step", "i8"),  # number of steps begun
        ("observed", "i8"),  # the step for which state and contact were read, plus one
        ("pending", "i8"),  # whether the last step still lacks its contact force and acceleration
        ("t", "f8"),
        ("true", TRUTHS),
        ("p_before", "f8", (3,)),
        ("f_before_W", "f8", (3,)),
        ("push", "f8", (1,)),  # sum of all normal forces
        ("push_shown", "f8", (1,)),  # the same without the sign of a zero, as a trace shows it
        ("moment_B", "f8", (3,)),  # of the contact force about B's origin, at t_k and at t_(k-1)
        ("moment_before_B", "f8", (3,)),
        ("qpos_safe", "f8", (7,)),  # initial pose
        # rows
        ("row", ROW),
        ("row_steps", "i8"),  # time steps from row to row
        *_whole("spans_at", "spans"),  # address and size [numbers] of each part of a row
        *_whole("banded_at", "banded"),  # address and size [numbers] of each signal with a band
        *_whole("bands_at", "band_steps"),  # least and largest values of each of them; steps since the last row
        *_whole("rows_at", "row_width", "row_capacity", "rows"),  # the last one counts those that are written
        # why the run stops: divergence or an error of a stage
        *_whole("stop", "stop_index"),
        ("stop_value", "f8"),
    ],
    align=True,
)
"""The closed loop of one vehicle: settings, table of stages, current step, rows, divergence and errors."""
