"""A metric of a study: how well the demanded force is held during the last second.

uvms-mj study learned_walls.toml
"""

import numpy as np

from uvms_mj.control.design import demanded_force


def held(trace):
    """Mean and largest |F - F_d| / F_d over the last second [1], with the force F_d that the impedance demands."""
    force_d = demanded_force(trace.scenario, trace.scenario.wall.stiffness)
    push = trace.between(trace.t[-1] - 1.0, trace.t[-1]).push
    off = np.abs(push - force_d) / force_d
    return {"mean": off.mean(), "worst": off.max()}
