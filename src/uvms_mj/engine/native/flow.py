"""The motion of the water at a vehicle and the disturbance, at one instant, from the series in a CONTEXT record."""

from ...physics.hydrodynamics import relative_velocity
from ...physics.kernels import kernel
from ...physics.tether import add_tether
from ...physics.varying import ROWS, add_gauss_markov, add_interpolated, add_sines, sine_rates
from .memory import floats


@kernel
def flow(context, t, p_WB, R_WB, nu):
    """Set v_c_W, v_c_dot_W, a_c_W and tau_dist of a CONTEXT's WATER record: at time t [s], for a vehicle at p_WB (3,)
    [m] with the velocity nu (6,) in B."""
    water = context.water
    if water.unsteady != 0:
        current_at(context, t, p_WB, R_WB, nu)
    add_sines(context.disturbance, t, water.tau_dist)
    add_table_and_noise(context.disturbance, t, water.tau_dist, context.rate)
    if water.tether > 0.0:
        relative_velocity(water, R_WB, nu, context.nu_r)
        add_tether(water.tether, water.r_t, context.nu_r, water.tau_dist)


@kernel
def add_table_and_noise(series, t, value, rate):
    """Add the table and the Gauss-Markov process of a record of :func:`.varying` to value (n,) and rate (n,)."""
    n = value.shape[0]
    if series.rows > 0:
        add_interpolated(floats(series.table_at, series.rows * (n + 1)), t, value, rate)
    if series.noisy != 0:
        add_gauss_markov(series, floats(series.nodes_at, ROWS * n), t, value, rate)


@kernel
def current_at(context, t, p_WB, R_WB, nu):
    """Set v_c_W, v_c_dot_W and a_c_W of a current that is not constant.

    With the factor f(depth) and the velocity (u, w) at f = 1, u horizontal, v_c is (f u, w). Along the vehicle's path
    and along that of the water it changes by f u_dot - v_z df/d(depth) u, with the vertical velocity v_z of the vehicle
    or of the water.
    """
    v_c, along_path, of_water = context.water.v_c_W, context.water.v_c_dot_W, context.water.a_c_W
    add_sines(context.current, t, v_c)
    sine_rates(context.current, t, along_path)
    add_table_and_noise(context.current, t, v_c, along_path)
    for i in range(3):
        of_water[i] = along_path[i]
    if context.shear_rows > 0:
        factor, slope = context.factor, context.slope
        factor[0], slope[0] = 0.0, 0.0
        add_interpolated(floats(context.shear_at, 2 * context.shear_rows), -p_WB[2], factor, slope)
        v_z = R_WB[2, 0] * nu[0] + R_WB[2, 1] * nu[1] + R_WB[2, 2] * nu[2]
        for i in range(2):
            upwards = -slope[0] * v_c[i]  # derivative by z
            v_c[i] *= factor[0]
            along_path[i] = factor[0] * along_path[i] + v_z * upwards
            of_water[i] = factor[0] * of_water[i] + v_c[2] * upwards
