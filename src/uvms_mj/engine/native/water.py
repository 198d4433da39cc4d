"""The motion of the water at a vehicle, and the disturbance: settings in a CONTEXT record, and their kernel."""

from collections.abc import Sequence

import numpy as np

from ...physics.hydrodynamics import relative_velocity
from ...physics.kernels import kernel
from ...physics.random import key_of
from ...physics.tether import add_tether
from ...physics.varying import (
    NODES,
    NODES_PER_CORRELATION_TIME,
    add_gauss_markov,
    add_interpolated,
    add_sines,
    sine_rates,
)
from ...plant.vehicle import Vehicle
from ...plant.water import Current, Disturbance, Tether
from ...scenario import Scenario
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
        add_gauss_markov(series, floats(series.nodes_at, (NODES + 1) * n), t, value, rate)


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


Numbers = Sequence[float] | np.ndarray


class Water:
    """The coefficients of a vehicle, the current, the disturbance and the tether in a CONTEXT record (1,).

    It keeps the arrays alive whose addresses are in the record, also those of the start, to which a reset returns.
    """

    def __init__(self, context: np.ndarray, vehicle: Vehicle, gravity_W: np.ndarray) -> None:
        self._context, self._arrays = context, dict[str, list[np.ndarray]]()
        water = context["water"]
        water["M_A"], water["D_linear"], water["D_quadratic"] = vehicle.M_A, vehicle.D_linear, vehicle.D_quadratic
        water["displaced_mass"], water["buoyancy_W"] = vehicle.displaced_mass, -vehicle.displaced_mass * gravity_W
        water["r_b"] = vehicle.r_b

    def move(self, current: Current, disturbance: Disturbance, tether: Tether, seed: int) -> None:
        """Set the motion of the water."""
        water, series = self._context["water"], self._context["current"]
        series["mean"] = water["v_c_W"] = current.velocity_W
        series["amplitude"], series["frequency"] = current.amplitude, current.frequency_hz
        self._vary("current", current)
        shear = np.array(current.shear or (), dtype=float)
        self._context["shear_at"], self._context["shear_rows"] = self._address("shear", shear), len(shear)
        water["unsteady"], water["v_c_dot_W"], water["a_c_W"] = not current.constant, 0.0, 0.0
        self.disturb(disturbance.bias, disturbance.amplitude, disturbance.frequency_hz)
        self._vary("disturbance", disturbance)
        water["tether"], water["r_t"] = tether.factor, tether.position
        self.seed(seed)
        water["fresh"] = False

    def disturb(self, bias: Numbers, amplitude: Numbers, frequency_hz: Numbers) -> None:
        """Set the constant and the sinusoidal part of the disturbance, (6,) each, in B [N, N m, Hz]."""
        series = self._context["disturbance"]
        series["mean"], series["amplitude"], series["frequency"] = bias, amplitude, frequency_hz

    def move_as(self, scenario: Scenario) -> None:
        """Set the motion of the water of a scenario."""
        self.move(scenario.current, scenario.disturbance, scenario.tether, scenario.simulation.seed)

    def seed(self, seed: int) -> None:
        """Set the seed of the Gauss-Markov processes."""
        for name in ("current", "disturbance"):
            series = self._context[name]
            if series["noisy"][0]:
                series["key"], series["block"] = key_of(seed, name), -1

    @property
    def mean_W(self) -> np.ndarray:
        """(3,) constant part of the current in W [m/s]. Setting it takes effect at the next step."""
        return self._context["current"]["mean"][0].copy()

    @mean_W.setter
    def mean_W(self, value: np.ndarray) -> None:
        self._context["current"]["mean"] = value
        if not self._context["water"]["unsteady"][0]:
            self._context["water"]["v_c_W"] = value

    def _vary(self, name: str, motion: Current | Disturbance) -> None:
        """Set the table and the Gauss-Markov process of a series."""
        series = self._context[name]
        table = np.array(motion.table or (), dtype=float)
        series["table_at"], series["rows"] = self._address(f"{name}.table", table), len(table)
        series["noisy"], series["deviation"] = any(motion.deviation), motion.deviation
        if series["noisy"][0]:
            kept = np.exp(-1.0 / NODES_PER_CORRELATION_TIME)
            series["spacing"] = motion.correlation_time / NODES_PER_CORRELATION_TIME
            series["kept"], series["kick"] = kept, np.sqrt(1.0 - kept**2)
            nodes = self._arrays.setdefault(f"{name}.nodes", [np.zeros((NODES + 1) * len(motion.deviation))])
            series["nodes_at"] = nodes[0].ctypes.data

    def _address(self, name: str, array: np.ndarray) -> int:
        """The address of an array that is kept until the next one; the first one is kept for good."""
        kept = self._arrays.setdefault(name, [])
        kept[1:] = [array]
        return array.ctypes.data
