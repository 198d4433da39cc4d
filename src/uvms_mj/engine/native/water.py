"""The current, the disturbance and the tether of a scenario in a CONTEXT record. :mod:`.flow` evaluates them."""

from collections.abc import Sequence

import numpy as np

from ...physics.random import key_of
from ...physics.varying import ROWS
from ...plant.vehicle import Vehicle
from ...plant.water import Current, Disturbance, Tether
from ...scenario import Scenario

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
        self.flow(current, seed)
        self.push(disturbance, seed)
        self.pull(tether)

    def flow(self, current: Current, seed: int) -> None:
        """Set the current."""
        water, series = self._context["water"], self._context["current"]
        series["mean"] = water["v_c_W"] = current.velocity_W
        series["amplitude"], series["frequency"] = current.amplitude, current.frequency_hz
        self._vary("current", current)
        shear = np.array(current.shear or (), dtype=float)
        self._context["shear_at"], self._context["shear_rows"] = self._address("shear", shear), len(shear)
        water["unsteady"], water["v_c_dot_W"], water["a_c_W"] = not current.constant, 0.0, 0.0
        water["fresh"] = False
        self._seed("current", seed)

    def push(self, disturbance: Disturbance, seed: int) -> None:
        """Set the disturbance."""
        self.disturb(disturbance.bias, disturbance.amplitude, disturbance.frequency_hz)
        self._vary("disturbance", disturbance)
        self._context["water"]["fresh"] = False
        self._seed("disturbance", seed)

    def pull(self, tether: Tether) -> None:
        """Set the tether."""
        water = self._context["water"]
        water["tether"], water["r_t"], water["fresh"] = tether.factor, tether.position, False

    def disturb(self, bias: Numbers, amplitude: Numbers, frequency_hz: Numbers) -> None:
        """Set the constant and the sinusoidal part of the disturbance, (6,) each, in B [N, N m, Hz]."""
        series = self._context["disturbance"]
        series["mean"], series["amplitude"], series["frequency"] = bias, amplitude, frequency_hz

    def move_as(self, scenario: Scenario) -> None:
        """Set the motion of the water of a scenario."""
        self.move(scenario.current, scenario.disturbance, scenario.tether, scenario.simulation.seed)

    def seed(self, seed: int) -> None:
        """Set the seed of the Gauss-Markov processes."""
        self._seed("current", seed)
        self._seed("disturbance", seed)

    def _seed(self, name: str, seed: int) -> None:
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
            series["spacing"], kept = motion.spacing, np.exp(-motion.spacing / motion.correlation_time)
            series["kept"], series["kick"] = kept, np.sqrt(1.0 - kept**2)
            nodes = self._arrays.setdefault(f"{name}.nodes", [np.zeros(ROWS * len(motion.deviation))])
            series["nodes_at"] = nodes[0].ctypes.data

    def _address(self, name: str, array: np.ndarray) -> int:
        """The address of an array that is kept until the next one; the first one is kept for good."""
        kept = self._arrays.setdefault(name, [])
        kept[1:] = [array]
        return array.ctypes.data
