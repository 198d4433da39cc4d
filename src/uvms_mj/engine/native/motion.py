"""The motion of the water that the caller of :func:`.attachment.attach` gives."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import Fault, InputError
from ...plant.water import Current, Disturbance, Tether
from ...setup.checks import water_faults
from .water import Water


@dataclass(frozen=True, eq=False)
class Motion:
    """Valid arguments of :func:`.attachment.attach`. ``vectors`` has current_W, bias, amplitude and frequency_hz, which
    act where ``current`` or ``disturbance`` is None."""

    vectors: Mapping[str, np.ndarray]
    current: Current | None
    disturbance: Disturbance | None
    tether: Tether | None
    seed: int

    @classmethod
    def checked(
        cls,
        vectors: Mapping[str, Any],
        current: Current | None,
        disturbance: Disturbance | None,
        tether: Tether | None,
        seed: int,
        h: float,
    ) -> "Motion":
        """Raises InputError if an argument is of another kind, if one of them is given in two ways, or if a time step h
        [s] does not resolve the motion of the water."""
        kinds = {"current": (current, Current), "disturbance": (disturbance, Disturbance), "tether": (tether, Tether)}
        faults = [
            Fault(name, f"{value!r} is not a uvms_mj.{kind.__name__}")
            for name, (value, kind) in kinds.items()
            if not isinstance(value, kind | None)
        ]
        if not isinstance(seed, int) or not 0 <= seed < 2**63:
            faults.append(Fault("seed", f"{seed!r} is not an integer from 0 to 2^63 - 1"))
        if faults:
            raise InputError(faults, "attach")
        numbers = finite_numbers(vectors, {name: 3 if name == "current_W" else 6 for name in vectors})
        faults = water_faults(current or Current(), disturbance or Disturbance(), h)
        for name, vector in numbers.items():
            table, instead = ("current", current) if name == "current_W" else ("disturbance", disturbance)
            if instead is not None and vector.any():
                faults.append(Fault(name, f"is given by {table} already; leave one of them out"))
        if faults:
            raise InputError(faults, "attach")
        return cls(numbers, current, disturbance, tether, seed)

    def apply(self, water: Water) -> None:
        """Set the motion of the water of a vehicle."""
        water.flow(self.current or Current(speed=0.0))
        water.push(self.disturbance or Disturbance())
        water.pull(self.tether or Tether())
        water.seed(self.seed)
        if self.current is None:
            water.mean_W = self.vectors["current_W"]
        if self.disturbance is None:
            water.disturb(*(self.vectors[name] for name in ("bias", "amplitude", "frequency_hz")))


def finite_numbers(given: Mapping[str, Any], sizes: Mapping[str, int]) -> dict[str, np.ndarray]:
    """Vectors of finite numbers by name. An InputError lists all values that are not such a vector."""
    numbers, faults = {}, []
    for name, value in given.items():
        try:
            numbers[name] = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            numbers[name] = np.array(np.nan)
        if numbers[name].shape != (sizes[name],) or not np.isfinite(numbers[name]).all():
            faults.append(Fault(name, f"{value!r}: must be {sizes[name]} finite numbers"))
    if faults:
        raise InputError(faults, "attach")
    return numbers
