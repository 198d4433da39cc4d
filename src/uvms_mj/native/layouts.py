"""Records that Python fills and compiled code works on. A field that ends in ``_at`` is a memory address."""

import numpy as np

from ..control.task import TASK
from ..estimates import COEFFICIENTS
from ..hydrodynamics import WATER
from ..signals import GIVEN, RUNNING, STATE, TRUTH, record_dtype

SIGNALS = record_dtype(GIVEN)
TRUE_SIGNALS = record_dtype(TRUTH)
SIGNALS_AND_TRUTH = record_dtype(GIVEN + TRUTH)
"""What the yardstick is given: both records as they stand in LOOP, one after the other."""
ROW = record_dtype(STATE + RUNNING)
ROW_SIZE = ROW.itemsize // 8

CONTEXT = np.dtype(
    [
        ("time_at", "i8"),  # mjData.time
        ("R_at", "i8"),  # xmat of the body
        ("qpos_at", "i8"),  # of the free joint
        ("qvel_at", "i8"),
        ("M_at", "i8"),  # the joint's 21 entries of mjData.M
        ("qLD_at", "i8"),  # the same entries of mjData.qLD, or 0 where mj_factorM has to factor the whole
        ("qLDiagInv_at", "i8"),
        ("xfrc_at", "i8"),  # of the body
        ("loop_at", "i8"),  # LOOP, or 0 where nobody controls the vehicle
        ("calls", "i8"),
        ("r_com", "f8", (3,)),  # where xfrc_applied acts, in B [m]
        ("water", WATER),
        ("nu", "f8", (6,)),
        ("nu_r", "f8", (6,)),
        ("work", "f8", (6,)),
        ("wrench", "f8", (6,)),
        ("added", "f8", (21,)),
        ("M_left", "f8", (21,)),  # mjData.M as the callback left it
        ("xfrc_left", "f8", (6,)),  # xfrc_applied as the callback left it
        ("xfrc_other", "f8", (6,)),  # somebody else's part of it
    ],
    align=True,
)
"""One vehicle attached to one mjData."""

FAULT_NONE, FAULT_STATE, FAULT_COMMAND, FAULT_LAW = 0, 1, 2, 3

LOOP = np.dtype(
    [
        # settings
        ("timestep", "f8"),
        ("period_steps", "i8"),
        ("row_steps", "i8"),  # time steps from row to row
        ("steps", "i8"),  # of the whole run
        ("window_step", "i8"),  # where the final window begins
        ("law_at", "i8"),  # the compiled law, or 0: tau_cmd is set from outside before the step
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
        ("contact_at", "i8"),  # the contact sensor: found, force (3), position (3), in W
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
        ("truth", TRUE_SIGNALS),  # right behind signals
        ("truths", COEFFICIENTS),
        ("reveals", "i8"),  # whether the law is given the truth
        ("integral", "i8"),  # whether s begins at zero, as an integral does
        ("zeta_dot", "f8", (6,)),
        ("tau_cmd", "f8", (6,)),
        ("tau", "f8", (6,)),
        ("tau_before", "f8", (6,)),
        # the step in hand
        ("step", "i8"),  # number of steps begun
        ("sensed", "i8"),  # the step that signals were sensed for, plus one
        ("pending", "i8"),  # whether the last step waits for its contact force and acceleration
        ("t", "f8"),
        ("p", "f8", (3,)),
        ("quat", "f8", (4,)),
        ("p_before", "f8", (3,)),
        ("nu", "f8", (6,)),
        ("nu_dot", "f8", (6,)),
        ("R_WB", "f8", (3, 3)),
        ("f_contact_W", "f8", (3,)),
        ("f_before_W", "f8", (3,)),
        ("qpos_safe", "f8", (7,)),  # where the run began
        # rows
        ("rows_at", "i8"),
        ("row_width", "i8"),
        ("row_capacity", "i8"),
        ("rows", "i8"),  # rows written
        ("row_at", "i8"),
        ("row", ROW),
        # health
        ("fault", "i8"),
        ("fault_index", "i8"),
        ("fault_value", "f8"),
    ],
    align=True,
)
"""The closed loop of one vehicle: settings, the law's memory, the step in hand, rows of samples, health."""
