"""Checks of the current and the disturbance against the time step."""

import itertools

from ..errors import Fault
from ..physics.varying import FINEST
from ..plant.water import Current, Disturbance


def water_faults(current: Current, disturbance: Disturbance, h: float) -> list[Fault]:
    """Errors for a motion of the water that a time step h [s] does not resolve, or that has no effect."""
    faults = []
    for name, motion in (("current", current), ("disturbance", disturbance)):
        for i, f in enumerate(motion.frequency_hz):
            if f * h >= 0.5 * (1.0 - 1e-9):
                wrong = (
                    f"{f:.12g} Hz must be below half the step rate, {0.5 / h:.6g} Hz: sampled every {h:g} s it would "
                    f"act as {abs(f - round(f * h) / h):.6g} Hz"
                )
                faults.append(Fault(f"{name}.frequency_hz[{i}]", wrong))
        if any(motion.deviation) and motion.spacing < h * (1.0 - 1e-9):
            wrong = f"{motion.correlation_time:g} s must be at least {FINEST * h:g} s, {FINEST:g} time steps"
            faults.append(Fault(f"{name}.correlation_time", wrong))
    gust, whole = current.shortest_gust, current.correlation_time
    if gust is not None and not whole / FINEST * (1.0 - 1e-9) <= gust <= whole * (1.0 + 1e-9):
        wrong = f"{gust:g} s must be from {whole / FINEST:g} to {whole:g} s at current.correlation_time {whole:g} s"
        faults.append(Fault("current.shortest_gust", wrong))
    for i, (amplitude, f) in enumerate(zip(current.amplitude, current.frequency_hz, strict=True)):
        if amplitude != 0.0 and f == 0.0:
            faults.append(Fault(f"current.amplitude[{i}]", f"{amplitude:g} m/s has no effect at the frequency 0 Hz"))
    times = [row[0] for row in current.table or ()]
    for i, (before, after) in enumerate(itertools.pairwise(times)):
        if after - before < h * (1.0 - 1e-9):
            wrong = (
                f"{after:g} s is less than a time step, {h:g} s, after the row before it: the acceleration of the "
                "water would act for a whole step or not at all"
            )
            faults.append(Fault(f"current.table[{i + 1}]", wrong))
    return faults
