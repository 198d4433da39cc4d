"""The motion of the water at a vehicle, and the wrench of the effects, at one instant."""

import numpy as np

from .buoyancy import set_wet
from .effects import add_effects, add_flows, add_pushes, in_the_way
from .hydrodynamics import relative_velocity
from .kernels import kernel


@kernel
def flow(plant, numbers, t, p_WB, R_WB, nu):
    """Set v_c_W, v_c_dot_W, a_c_W, wave_head and tau_dist of a plant's WATER record, and its WET record: at time t [s],
    for a vehicle at p_WB (3,) [m] with the velocity nu (6,) in B. ``numbers`` has the tables."""
    water = plant.water
    water.t = t
    if water.unsteady != 0:
        flow_along(plant, numbers, t, p_WB, R_WB, nu)
    if plant.wet.shape[0] != 0:
        set_wet(plant.effects, plant.links[0], t, p_WB, R_WB, plant.wet[0])
    water.tau_dist[:] = 0.0
    add_pushes(plant.effects, numbers, t, water.tau_dist)
    if plant.affected.shape[0] != 0:
        relative_velocity(water, R_WB, nu, plant.nu_r)
        if plant.wet.shape[0] != 0:
            part = np.zeros(6)
            add_effects(plant.effects, plant.nu_r, part)
            water.tau_dist += plant.wet[0].fraction * part
        else:
            add_effects(plant.effects, plant.nu_r, water.tau_dist)


@kernel
def flow_along(plant, numbers, t, p_WB, R_WB, nu):
    """Set v_c_W, v_c_dot_W, a_c_W and wave_head of water that is not constant: along the vehicle's path and along that
    of the water its velocity changes by v_dot + (dv/dx) times the velocity of the vehicle, or of the water.

    Where the current meets an obstacle, the added mass is given the water's own acceleration in place of the rate along
    the vehicle's path: the force on a body in a flow that is not uniform is M_A (Dv_c/Dt - dv/dt) with the
    Froude-Krylov force (Auton, Hunt and Prud'homme, J. Fluid Mech. 197, 1988, p. 241; for a sphere)."""
    water = plant.water
    water.v_c_W[:], water.a_c_W[:], water.gradient_W[:] = 0.0, 0.0, 0.0
    water.wave_head = add_flows(plant.effects, numbers, t, p_WB, water.v_c_W, water.a_c_W, water.gradient_W)
    water.v_c_dot_W[:] = water.a_c_W + water.gradient_W @ (R_WB @ nu[:3])
    water.a_c_W += water.gradient_W @ water.v_c_W
    for k in range(plant.effects.obstacle.shape[0]):
        if in_the_way(plant.effects.obstacle[k]):
            water.v_c_dot_W[:] = water.a_c_W
