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
from ...stages.signals import CLOCK, GIVEN, KNOWN, RECORDED, TRUE, record_dtype

CLOCKS = record_dtype(CLOCK)
"""The beginning of every record that a stage is given."""
TRUTHS = record_dtype(CLOCK + TRUE)
"""Record given to navigation: the state and the contact force of the instant."""
_OTHERS = {s.name for s in GIVEN + TRUE} - {s.name for s in KNOWN} | {s.name for s in TRUE[:4]}
_OTHERS |= {"tau_cmd", "f_contact_m_W", *(CONTACT.names or ())}
ROW = record_dtype(tuple(s for s in RECORDED if s.name in ("t", "f_contact_W") or s.name not in _OTHERS))
"""The recorded signals that the core computes; all others lie where a stage or the contact has set them."""

TREE = np.dtype([("links", "i8"), ("links_at", "i8"), ("frames_at", "i8"), ("gravity_B", "f8", (3,))], align=True)
"""A tree: LINK records one after the other, base first, FRAME records likewise, and the acceleration of gravity in B
[m/s^2]. A rigid vehicle has no links."""
LINK_SIZE, FRAME_SIZE = LINK.itemsize, FRAME.itemsize

_MODEL = [
    ("tree", TREE),
    ("n", "i8"),  # joints
    ("places", "i8"),  # whether the frames of the tree are its own
    ("tool", TOOL),
    ("gravity_W", "f8", (3,)),
    ("q_at", "i8"),  # (n,) measured position and velocity of the joints
    ("q_dot_at", "i8"),
    ("armature_at", "i8"),  # (n,) inertia of the rotors
    ("gear_at", "i8"),  # (n,) viscous friction of the gears
    ("tau_q_cmd_at", "i8"),  # (n,) commanded torques
    # of one instant; all matrices are flat arrays, row by row
    ("M_at", "i8"),  # (N, N)
    ("C_at", "i8"),  # (N,) C zeta, D zeta and g
    ("D_at", "i8"),
    ("g_at", "i8"),
    ("L_at", "i8"),  # (N, N) Cholesky factor of M
    ("J_T_at", "i8"),  # (N, 6) J^T of the tool
    ("MJ_T_at", "i8"),  # (N, 6) M^-1 J^T
    ("tau_posture_at", "i8"),  # (N,) of them, what the posture adds
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
        ("time_at", "i8"),  # mjData.time
        ("R_at", "i8"),  # xmat of the body
        ("qpos_at", "i8"),  # of the free joint
        ("qvel_at", "i8"),
        ("M_at", "i8"),  # the joint's 21 entries of mjData.M
        ("qLD_at", "i8"),  # the same entries of mjData.qLD, or 0 if mj_factorM has to factor all of M
        ("qLDiagInv_at", "i8"),
        ("passive_at", "i8"),  # the joint's entries of mjData.qfrc_passive
        ("loop_at", "i8"),  # LOOP, or 0 without a closed loop
        ("calls", "i8"),
        ("water", WATER),
        ("current", varying(3)),  # in W [m/s]
        ("disturbance", varying(6)),  # in B [N, N m]
        ("shear_at", "i8"),  # rows of [depth, factor]
        ("shear_rows", "i8"),
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
        ("q_at", "i8"),  # of MuJoCo
        ("q_dot_at", "i8"),
        ("M_size", "i8"),  # entries of mjData.M of the whole tree
        ("M_rows_at", "i8"),  # where the row of each link begins in them
        ("wrench_at", "i8"),  # (6 + n,) generalised wrench of the water, in B
        ("joints_before_at", "i8"),  # (n,) qfrc_passive before the callback
        ("joints_left_at", "i8"),  # and after it
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
        ("weighs", "i8"),  # whether the model has weight, and motion
        ("dynamic", "i8"),
        ("context_at", "i8"),  # CONTEXT
        ("n", "i8"),  # joints
        ("places", "i8"),  # whether the frames of the model are its own
        ("q_dot_at", "i8"),  # (n,) true
        ("q_ddot_at", "i8"),
        ("q_m_at", "i8"),  # (n,) measured
        ("q_dot_m_at", "i8"),
        ("q_ddot_m_at", "i8"),
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
        ("settings_at", "i8"),  # or, of a user's stage, its arena
        ("state_at", "i8"),
        ("given_at", "i8"),  # begins with CLOCKS
        ("state_dot_at", "i8"),
        ("out_at", "i8"),
        ("states", "i8"),  # numbers in state
        ("period_steps", "i8"),
        ("period", "f8"),
        ("instant", "i8"),  # number of its calls
        ("key", "i8"),  # of its random numbers
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
        ("steps", "i8"),  # number of time steps of the run
        ("window_step", "i8"),  # first step of the final window
        ("epsilon", "f8", (6,)),
        ("speed_bound", "f8", (6,)),
        ("position_bound", "f8"),
        ("tau_bound", "f8"),
        # the engine's memory
        ("qacc_at", "i8"),
        ("ctrl_at", "i8"),  # of MuJoCo
        ("contact_at", "i8"),  # the contact sensor: found, normal force (3) in W, of the step
        ("distance_at", "i8"),  # the distance sensor, of the same instant as qpos
        ("fromto_at", "i8"),  # the sensor of the nearest points (6) in W
        ("contact", CONTACT),
        # the list of contacts beside that of the probe and [wall]
        ("surfaces_at", "i8"),  # SURFACE, one after the other
        ("surfaces", "i8"),
        ("pairs_at", "i8"),  # PAIR
        ("f_pairs_at", "i8"),  # (n, 3), force of each pair in W
        ("depths_at", "i8"),  # (n,)
        ("push_of_pairs", "f8"),  # sum of their normal forces
        ("carriers_at", "i8"),  # CARRIER
        ("f_carried_W", "f8", (3,)),  # sum of the contact forces that MuJoCo's contact solver does not apply
        # stages
        ("stages_at", "i8"),  # STAGE, one after the other
        ("stages", "i8"),  # their number
        ("actuation", "i8"),  # index of the first one that is given tau_cmd
        ("next", "i8"),  # the next one to run at this instant
        ("s_at", "i8"),  # the sliding variable, or 0 without the impedance task
        ("tau_cmd_at", "i8"),
        # thrusters
        ("controls", "i8"),  # entries of ctrl
        ("thrusters", "i8"),
        ("columns_at", "i8"),  # (n, 6), the columns of B
        ("columns_hat_at", "i8"),  # of the file's B, or 0 if tau_hat is tau
        ("tau_hat_at", "i8"),
        ("tau_lost_at", "i8"),  # the actuation's tau_cmd - tau_hat, or 0 if it is not recorded
        ("tau_given_at", "i8"),  # tau_cmd as the actuation is given it
        ("u_min_at", "i8"),  # limits of the command
        ("u_max_at", "i8"),
        ("low_at", "i8"),  # limits of the vehicle's file
        ("high_at", "i8"),
        ("ctrl_index_at", "i8"),
        ("thrust_of_ctrl_at", "i8"),
        ("u_cmd_at", "i8"),  # as the actuation sets it
        ("thrust_at", "i8"),  # as the thrusters set it; u_cmd if they are ideal
        ("u_at", "i8"),  # within the limits of the vehicle's file
        ("saturated", "i8"),  # whether a command is at its limit
        # joints
        ("joints", "i8"),  # their number
        ("q_at", "i8"),  # (n,) at t_k
        ("q_dot_at", "i8"),
        ("q_ddot_at", "i8"),  # of the last step
        ("wanted_at", "i8"),  # torque that the interface sets
        ("tau_q_at", "i8"),  # torque of the motors
        ("effort_at", "i8"),  # its limits
        ("speed_limit_at", "i8"),
        ("motor_index_at", "i8"),  # in ctrl, -1 without a motor
        ("torque_of_ctrl_at", "i8"),
        ("saturation_at", "i8"),  # time at the motors' limits until t_k
        ("saturation_next_at", "i8"),  # and until t_(k+1)
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
        ("moment_B", "f8", (3,)),  # of the contact force about B's origin, at t_k and at t_(k-1)
        ("moment_before_B", "f8", (3,)),
        ("qpos_safe", "f8", (7,)),  # initial pose
        # rows
        ("row", ROW),
        ("row_steps", "i8"),  # time steps from row to row
        ("spans_at", "i8"),  # address and size [numbers] of each part of a row
        ("spans", "i8"),
        ("rows_at", "i8"),
        ("row_width", "i8"),
        ("row_capacity", "i8"),
        ("rows", "i8"),  # rows written
        # why the run stops: divergence or an error of a stage
        ("stop", "i8"),
        ("stop_index", "i8"),
        ("stop_value", "f8"),
    ],
    align=True,
)
"""The closed loop of one vehicle: settings, table of stages, current step, rows, divergence and errors."""
