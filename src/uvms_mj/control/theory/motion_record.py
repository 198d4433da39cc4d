"""The record of a motion to a rest, which the kernels of :mod:`.motion_terms`, :mod:`.motion_force` and
:mod:`.motion_steps` read and write, in the names of :class:`.task_motion.TaskMotion` and :class:`.terms.Balance`.

Beside it a kernel is given a world: the gains of the law, the vehicle in the water, its effects, the pairs, the
surfaces, and the residual of the law, which sets out (6,) from motion, world and a pose.
"""

import numpy as np

from ..task import MOST_ENTRIES

GAINS, BODY, EFFECTS, PAIRS, SURFACES, RESIDUAL = range(6)
"""Places in a world."""
MOST_THRUSTERS = 16
"""Most thrusters."""
MOST_STATES = 18
"""Most states of a law in its residual."""

POSE = np.dtype(
    [("position", "f8", (3,)), ("quat", "f8", (4,)), ("R_WB", "f8", (3, 3)), ("tau_c", "f8", (6,))], align=True
)
"""A :class:`.terms.Pose`."""

_MATRICES = ("K_d", "D_d", "M_d", "M", "M_hat", "M_hat_inv", "M_d_inv", "M_d_by_M", "M_RB", "undelivered")
NOMINAL_VEHICLE = np.dtype(
    [
        *((name, "f8", (6, 6)) for name in ("M_A", "M_RB", "D_linear", "D_quadratic")),
        *((name, "f8") for name in ("mass", "displaced_mass", "inertia", "damping", "coriolis", "restoring")),
        *((name, "f8", (3,)) for name in ("r_g", "r_b", "gravity_W")),
    ],
    align=True,
)
"""The vehicle of the control system, with the factors of its estimates."""
ERRORS = {"position_scale": 3, "position_bias": 3, "turn": 4, "nu": 6, "scale": 6, "bias": 6, "drift": 3, "z_0": 1}
_SENSED = np.dtype(
    [*((name, "f8", (n,) if n > 1 else ()) for name, n in ERRORS.items()), ("perfect", "i8"), ("observed", "i8")],
    align=True,
)
"""The constant errors of the measurements: :class:`uvms_mj.navigation.base.ConstantErrors`."""
_SEEN = np.dtype([("position", "f8", (3,)), ("quat", "f8", (4,)), ("nu", "f8", (6,)), ("tau_c", "f8", (6,))])
ROW = np.dtype(
    [
        *(("t", "f8"), ("pose", POSE), ("lacked", "f8", (6,)), ("unmodelled", "f8", (6,)), ("saturates", "i8")),
    ],
    align=True,
)
"""One step of a motion."""
WAY = np.dtype([("t", "f8"), ("position", "f8", (3,)), ("quat", "f8", (4,))], align=True)
"""A sample of a reference."""
MOTION = np.dtype(
    [
        *(
            (name, "f8", (6, 6))
            for name in (*_MATRICES, "inertia", "wrench", "by_pose", "by_wrench", "stiffness", "by_water", "J")
        ),
        *((name, "f8", (6,)) for name in ("K_f", "F_d", "F_1", "factor_inverse", "tau_dist", "left")),
        *((name, "f8", (6,)) for name in ("nu_d", "nu_d_before", "led", "lead", "nu_at_rest", "velocity")),
        *((name, "f8", (6,)) for name in ("free", "force", "before", "change", "seen_error")),
        *((name, "f8", (3,)) for name in ("p_d", "p_end", "v_c_W", "beside")),
        *((name, "f8", (4,)) for name in ("quat_d", "quat_end")),
        *((name, "f8") for name in ("t", "step", "ends", "largest", "sharp", "h", "limited_s", "first")),
        *((name, "i8") for name in ("uses_truth", "integrates", "follows", "scheduled", "led_on", "limits", "memory")),
        *((name, "i8") for name in ("pairs", "samples", "steps", "rows", "delivered")),
        *((name, "i8") for name in ("known", "known_before", "known_water")),
        *((name, "f8", (MOST_STATES,)) for name in ("value", "next")),
        *(("B", "f8", (6, MOST_THRUSTERS)), ("shares", "f8", (MOST_THRUSTERS, 6))),
        *((name, "f8", (MOST_THRUSTERS,)) for name in ("least", "most")),
        *(("times", "f8", (MOST_ENTRIES,)), ("ramps", "f8", (MOST_ENTRIES,)), ("values", "f8", (MOST_ENTRIES + 1, 12))),
        *((name, POSE) for name in ("y", "at", "origin", "there", "turned", "asked")),
        *(("nominal", NOMINAL_VEHICLE), ("sensed", _SENSED), ("seen", _SEEN)),
    ],
    align=True,
)
"""Settings and state of a motion, in the names of :class:`.task_motion.TaskMotion` and :class:`.terms.Balance`."""
