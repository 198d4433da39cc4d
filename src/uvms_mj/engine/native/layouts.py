"""Records shared by Python and compiled code. A field that ends in ``_at`` is a memory address."""

import numpy as np

from ...physics.contact import CONTACT
from ...physics.hydrodynamics import WATER
from ...physics.model import COEFFICIENTS
from ...stages.signals import GIVEN, RUNNING, STATE, TRUTH, record_dtype

SIGNALS = record_dtype(GIVEN)
TRUE_SIGNALS = record_dtype(TRUTH)
SIGNALS_AND_TRUTH = record_dtype(GIVEN + TRUTH)
"""Record given to the ideal law: signals and truth of LOOP, one directly after the other."""
TASK = np.dtype(
    [("F_1", "f8", (6,)), ("F_2", "f8", (6,)), ("A", "f8", (6,)), ("integral", "?"), ("M_d_inv", "f8", (6, 6))],
    align=True,
)
"""Settings of the impedance task."""
ROW = record_dtype(STATE + RUNNING)
ROW_SIZE = ROW.itemsize // 8

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
        ("nu", "f8", (6,)),
        ("nu_r", "f8", (6,)),
        ("work", "f8", (6,)),
        ("wrench", "f8", (6,)),
        ("added", "f8", (21,)),
        ("M_left", "f8", (21,)),  # mjData.M after the callback
        ("passive_before", "f8", (6,)),  # qfrc_passive before the callback
        ("passive_left", "f8", (6,)),  # qfrc_passive after the callback
        ("no_contact", CONTACT),  # used without a loop, and so without a wall
    ],
    align=True,
)
"""One vehicle attached to one mjData."""

STOP_NONE, STOP_STATE, STOP_COMMAND, STOP_LAW = 0, 1, 2, 3

LOOP = np.dtype(
    [
        # settings
        ("timestep", "f8"),
        ("period_steps", "i8"),
        ("row_steps", "i8"),  # time steps from row to row
        ("steps", "i8"),  # number of time steps of the run
        ("window_step", "i8"),  # first step of the final window
        ("law_at", "i8"),  # the compiled law, or 0 if tau_cmd is set from outside before the step
        ("bandwidth", "f8"),
        ("start", "f8", (3,)),
        ("times_at", "i8"),
        ("positions_at", "i8"),
        ("waypoints", "i8"),
        ("epsilon", "f8", (6,)),
        ("speed_bound", "f8", (6,)),
        ("position_bound", "f8"),
        ("tau_bound", "f8"),
        ("task", TASK),
        ("estimates", COEFFICIENTS),
        # MuJoCo's memory
        ("qacc_at", "i8"),
        ("ctrl_at", "i8"),
        ("contact_at", "i8"),  # the contact sensor: found, force (3) in W, of MuJoCo's solver
        ("distance_at", "i8"),  # the distance sensor, of the same instant as qpos
        ("fromto_at", "i8"),  # the sensor of the nearest points (6) in W
        ("contact", CONTACT),
        # thrusters
        ("controls", "i8"),  # entries of ctrl
        ("thrusters", "i8"),
        ("B_at", "i8"),  # B^T and B^+: a row for each thruster
        ("B_pinv_at", "i8"),
        ("u_min_at", "i8"),
        ("u_max_at", "i8"),
        ("ctrl_index_at", "i8"),
        ("thrust_of_ctrl_at", "i8"),
        ("u_at", "i8"),
        ("saturated", "i8"),  # whether a thruster is at its limit
        # the law
        ("gains_at", "i8"),  # or, of a user's law, its arena
        ("state_at", "i8"),
        ("state_dot_at", "i8"),
        ("states", "i8"),
        ("signals_at", "i8"),
        ("tau_cmd_at", "i8"),
        ("signals", SIGNALS),
        ("truth", TRUE_SIGNALS),  # directly after signals
        ("true_coefficients", COEFFICIENTS),
        ("reveals", "i8"),  # whether the law is given the truth
        ("zeta_dot", "f8", (6,)),
        ("work", "f8", (6,)),  # scratch memory
        ("tau_cmd", "f8", (6,)),
        ("tau", "f8", (6,)),
        ("tau_before", "f8", (6,)),
        # the current step
        ("step", "i8"),  # number of steps begun
        ("observed", "i8"),  # the step for which state and contact were read, plus one
        ("sensed", "i8"),  # the step for which signals were sensed, plus one
        ("pending", "i8"),  # whether the last step still lacks its contact force and acceleration
        ("t", "f8"),
        ("p", "f8", (3,)),
        ("quat", "f8", (4,)),
        ("p_before", "f8", (3,)),
        ("nu", "f8", (6,)),
        ("nu_dot", "f8", (6,)),
        ("R_WB", "f8", (3, 3)),
        ("f_contact_W", "f8", (3,)),
        ("f_before_W", "f8", (3,)),
        ("moment_B", "f8", (3,)),  # of the contact force about B's origin, at t_k and at t_(k-1)
        ("moment_before_B", "f8", (3,)),
        ("qpos_safe", "f8", (7,)),  # initial pose
        # rows
        ("rows_at", "i8"),
        ("row_width", "i8"),
        ("row_capacity", "i8"),
        ("rows", "i8"),  # rows written
        ("row_at", "i8"),
        ("row", ROW),
        # why the run stops: divergence or an error of the law
        ("stop", "i8"),
        ("stop_index", "i8"),
        ("stop_value", "f8"),
    ],
    align=True,
)
"""The closed loop of one vehicle: settings, memory of the law, current step, rows, divergence and errors."""
