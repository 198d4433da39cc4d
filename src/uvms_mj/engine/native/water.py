"""The current, the disturbance and the tether of a scenario in a CONTEXT record. :mod:`.flow` evaluates them."""

from collections.abc import Sequence

import numpy as np

from ...physics.random import key_of
from ...physics.varying import ROWS
from ...plant.vehicle import Vehicle
from ...plant.water import Current, Disturbance, Tether

Numbers = Sequence[float] | np.ndarray


class Water:
    """The coefficients of a vehicle, the current, the disturbance and the tether in a CONTEXT record (1,).

    It keeps the arrays alive whose addresses are in the record, also those of the start, to which a reset returns.
    """

    def __init__(self, context: np.ndarray, vehicle: Vehicle, gravity_W: np.ndarray) -> None:
        self._context, self._arrays = context, dict[str, list[np.ndarray]]()
        self._water, self._series = context["water"], {name: context[name] for name in ("current", "disturbance")}
        water = self._water
        water["M_A"], water["D_linear"], water["D_quadratic"] = vehicle.M_A, vehicle.D_linear, vehicle.D_quadratic
        water["displaced_mass"], water["buoyancy_W"] = vehicle.displaced_mass, -vehicle.displaced_mass * gravity_W
        water["r_b"] = vehicle.r_b

    def flow(self, current: Current) -> None:
        """Set the current. A call of :meth:`seed` must follow."""
        water, series = self._water, self._series["current"]
        series["mean"] = water["v_c_W"] = current.velocity_W
        series["amplitude"], series["frequency"] = current.amplitude, current.frequency_hz
        self._vary("current", current)
        self._context["shear_at"], self._context["shear_rows"] = self._table("shear", current.shear)
        water["unsteady"], water["v_c_dot_W"], water["a_c_W"] = not current.constant, 0.0, 0.0
        water["fresh"] = False

    def push(self, disturbance: Disturbance) -> None:
        """Set the disturbance. A call of :meth:`seed` must follow."""
        self.disturb(disturbance.bias, disturbance.amplitude, disturbance.frequency_hz)
        self._vary("disturbance", disturbance)
        self._water["fresh"] = False

    def pull(self, tether: Tether) -> None:
        """Set the tether."""
        water = self._water
        water["tether"], water["r_t"], water["fresh"] = tether.factor, tether.position, False

    def disturb(self, bias: Numbers, amplitude: Numbers, frequency_hz: Numbers) -> None:
        """Set the constant and the sinusoidal part of the disturbance, (6,) each, in B [N, N m, Hz]."""
        series = self._series["disturbance"]
        series["mean"], series["amplitude"], series["frequency"] = bias, amplitude, frequency_hz

    def seed(self, seed: int) -> None:
        """Set the seed of the Gauss-Markov processes."""
        for name, series in self._series.items():
            if series["noisy"][0]:
                series["key"], series["block"] = key_of(seed, name), -1

    @property
    def mean_W(self) -> np.ndarray:
        """(3,) constant part of the current in W [m/s]. Setting it takes effect at the next step."""
        return self._series["current"]["mean"][0].copy()

    @mean_W.setter
    def mean_W(self, value: np.ndarray) -> None:
        self._series["current"]["mean"] = value
        if not self._water["unsteady"][0]:
            self._water["v_c_W"] = value

    def _vary(self, name: str, motion: Current | Disturbance) -> None:
        """Set the table and the Gauss-Markov process of a series."""
        series = self._series[name]
        series["table_at"], series["rows"] = self._table(f"{name}.table", motion.table)
        series["noisy"], series["deviation"] = any(motion.deviation), motion.deviation
        if series["noisy"][0]:
            series["spacing"], kept = motion.spacing, np.exp(-motion.spacing / motion.correlation_time)
            series["kept"], series["kick"] = kept, np.sqrt(1.0 - kept**2)
            nodes = self._arrays.setdefault(f"{name}.nodes", [np.zeros(ROWS * len(motion.deviation))])
            series["nodes_at"] = nodes[0].ctypes.data

    def _table(self, name: str, rows: tuple[tuple[float, ...], ...] | None) -> tuple[int, int]:
        """The address of a table and its number of rows. Its memory is kept until the next one; that of the start is
        kept for good."""
        kept = self._arrays.setdefault(name, [])
        kept[1:] = [np.array(rows or (), dtype=float)] if rows or not kept else []
        return (kept[-1].ctypes.data, len(rows)) if rows else (0, 0)
