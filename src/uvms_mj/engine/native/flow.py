"""The motion of the water at a vehicle and the disturbance, at one instant, from the series in its record."""

from ...physics.hydrodynamics import relative_velocity
from ...physics.kernels import kernel
from ...physics.tether import add_tether
from ...physics.varying import add_gauss_markov, add_interpolated, add_sines, sine_rates


@kernel
def flow(plant, numbers, t, p_WB, R_WB, nu):
    """Set v_c_W, v_c_dot_W, a_c_W and tau_dist of a plant's WATER record: at time t [s], for a vehicle at p_WB (3,)
    [m] with the velocity nu (6,) in B. ``numbers`` has the tables."""
    water = plant.water
    if water.unsteady != 0:
        current_at(plant, numbers, t, p_WB, R_WB, nu)
    add_sines(plant.disturbance, t, water.tau_dist)
    add_table_and_noise(plant.disturbance, numbers, t, water.tau_dist, plant.rate)
    if water.tether > 0.0:
        relative_velocity(water, R_WB, nu, plant.nu_r)
        add_tether(water.tether, water.r_t, plant.nu_r, water.tau_dist)


@kernel
def add_table_and_noise(series, numbers, t, value, rate):
    """Add the table and the Gauss-Markov process of a record of :func:`.varying` to value (n,) and rate (n,)."""
    if series.rows > 0:
        add_interpolated(numbers, series.table, series.rows, t, value, rate)
    if series.noisy != 0:
        add_gauss_markov(series, numbers, t, value, rate)


@kernel
def current_at(plant, numbers, t, p_WB, R_WB, nu):
    """Set v_c_W, v_c_dot_W and a_c_W of a current that is not constant.

    With the factor f(depth) and the velocity (u, w) at f = 1, u horizontal, v_c is (f u, w). Along the vehicle's path
    and along that of the water it changes by f u_dot - v_z df/d(depth) u, with the vertical velocity v_z of the vehicle
    or of the water.
    """
    v_c, along_path, of_water = plant.water.v_c_W, plant.water.v_c_dot_W, plant.water.a_c_W
    add_sines(plant.current, t, v_c)
    sine_rates(plant.current, t, along_path)
    add_table_and_noise(plant.current, numbers, t, v_c, along_path)
    for i in range(3):
        of_water[i] = along_path[i]
    if plant.shear_rows > 0:
        factor, slope = plant.factor, plant.slope
        factor[0], slope[0] = 0.0, 0.0
        add_interpolated(numbers, plant.shear, plant.shear_rows, -p_WB[2], factor, slope)
        v_z = R_WB[2, 0] * nu[0] + R_WB[2, 1] * nu[1] + R_WB[2, 2] * nu[2]
        for i in range(2):
            upwards = -slope[0] * v_c[i]  # derivative by z
            v_c[i] *= factor[0]
            along_path[i] = factor[0] * along_path[i] + v_z * upwards
            of_water[i] = factor[0] * of_water[i] + v_c[2] * upwards
