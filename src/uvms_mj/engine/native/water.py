"""The current, the disturbance and the tether of a scenario in the record of a plant. :mod:`.flow` evaluates them."""

from collections.abc import Sequence

import numpy as np

from ...physics.random import key_of
from ...plant.vehicle import Vehicle
from ...plant.water import Current, Disturbance, Tether
from .bodies import frame_records, water_links
from .record import Image

Numbers = Sequence[float] | np.ndarray


class Water:
    """The links of a vehicle, the current, the disturbance and the tether in the record ``plant`` (1,) of an image, and
    their tables in its rooms."""

    def __init__(self, image: Image, plant: np.ndarray, vehicle: Vehicle, gravity_W: np.ndarray) -> None:
        self._image, self._plant, self._water = image, plant, plant["water"]
        self._series = {name: plant[name] for name in ("current", "disturbance")}
        plant["links"], plant["frames"], plant["gravity_W"] = water_links(vehicle), frame_records(vehicle), gravity_W

    def flow(self, current: Current) -> None:
        """Set the current. A call of :meth:`seed` must follow."""
        water, series = self._water, self._series["current"]
        series["mean"] = water["v_c_W"] = current.velocity_W
        series["amplitude"], series["frequency"] = current.amplitude, current.frequency_hz
        self._vary("current", current)
        self._plant["shear"], self._plant["shear_rows"] = self._table("current.shear", current.shear)
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

    def drawn(self) -> list[tuple[str, tuple[int, float, bytes], int]]:
        """The Gauss-Markov processes with what decides their nodes, and the block of nodes in memory."""
        found = []
        for name, series in self._series.items():
            if series["noisy"][0]:
                decided = int(series["key"][0]), float(series["kept"][0]), series["deviation"].tobytes()
                found.append((name, decided, int(series["block"][0])))
        return found

    def keep(self, drawn: list[tuple[str, tuple[int, float, bytes], int]]) -> None:
        """Keep the blocks of :meth:`drawn`, which the rooms still have, for the processes that are the same."""
        now = {name: decided for name, decided, _ in self.drawn()}
        for name, decided, block in drawn:
            if now.get(name) == decided:
                self._series[name]["block"] = block

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
        series["table"], series["rows"] = self._table(f"{name}.table", motion.table)
        series["noisy"], series["deviation"] = any(motion.deviation), motion.deviation
        if series["noisy"][0]:
            series["spacing"], kept = motion.spacing, np.exp(-motion.spacing / motion.correlation_time)
            series["kept"], series["kick"] = kept, np.sqrt(1.0 - kept**2)
            series["nodes"], _ = self._image.room(f"{name}.nodes")

    def _table(self, name: str, rows: tuple[tuple[float, ...], ...] | None) -> tuple[int, int]:
        """The place of a table and its number of rows."""
        return self._image.put(name, np.array(rows, dtype=float)) if rows else (0, 0)
