"""Checks of numbers in combination: frequencies against the time step, and overflow in the design equations."""

import contextlib
import dataclasses
from collections.abc import Iterator

import numpy as np

from ..errors import Fault, InputError
from ..quantities import leaves
from ..scenario import Scenario

_SMALL, _LARGE = 1e-6, 1e8
"""If an equation overflows, the message names the keys with numbers outside this range."""


def aliased(scenario: Scenario) -> list[Fault]:
    """Errors for disturbance frequencies that the time step would alias to lower ones."""
    h = scenario.simulation.timestep
    return [
        Fault(
            f"disturbance.frequency_hz[{i}]",
            f"{f:.12g} Hz must be below half the step rate, {0.5 / h:.6g} Hz: sampled every {h:g} s it would act as "
            f"{abs(f - round(f * h) / h):.6g} Hz",
        )
        for i, f in enumerate(scenario.disturbance.frequency_hz)
        if f * h >= 0.5 * (1.0 - 1e-9)
    ]


@contextlib.contextmanager
def no_overflow(scenario: Scenario) -> Iterator[None]:
    """Name the keys with extreme values if an equation of the design has no finite result.

    Raises:
        InputError: in place of NumPy's exception.
    """
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        extreme = [
            Fault(key, f"{value:g} is too {'large' if abs(value) > 1.0 else 'small'} relative to the other numbers")
            for key, value in leaves(dataclasses.asdict(scenario))
            if isinstance(value, int | float) and value and not _SMALL <= abs(value) <= _LARGE
        ]
        what = f"an equation of the design has no finite result: {error}"
        raise InputError(extreme or [Fault("", what)], what if extreme else "scenario") from None
