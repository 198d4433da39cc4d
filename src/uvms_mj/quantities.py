"""Types of the quantities in scenarios and gains: finite numbers, vectors, with the ranges that make sense."""

from typing import Annotated, Any

from annotated_types import Ge, Gt, Le
from pydantic import AfterValidator, BeforeValidator, Field

Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A finite number."""
Positive = Annotated[Real, Gt(0)]
NonNegative = Annotated[Real, Ge(0)]
Step = Annotated[Real, Ge(1e-7), Le(1.0)]
"""A time step or a sampling period [s]."""
Duration = Annotated[Real, Gt(0), Le(1e7)]
"""A simulated time [s]."""


def _of_length(n: int) -> AfterValidator:
    def check(value: tuple[Any, ...]) -> tuple[Any, ...]:
        if len(value) != n:
            raise ValueError(f"has {len(value)} values; {n} are needed")
        return value

    return AfterValidator(check)


Moderate = Annotated[Real, Ge(-1e6), Le(1e6)]
"""A position [m] or an angle [deg] that a double still resolves to better than a nanometre."""
Vector3 = Annotated[tuple[Moderate, ...], _of_length(3)]
Vector6 = Annotated[tuple[Real, ...], _of_length(6)]
NonNegative6 = Annotated[tuple[NonNegative, ...], _of_length(6)]


def _diagonal_or_square(value: Any) -> Any:
    def numbers(row: Any) -> bool:
        return isinstance(row, list | tuple) and len(row) == 6 and all(type(x) in (int, float) for x in row)

    square = isinstance(value, list | tuple) and len(value) == 6 and all(numbers(row) for row in value)
    if value is not None and not numbers(value) and not square:
        raise ValueError("must be six numbers, a diagonal, or six rows of six numbers")
    return value


Matrix6 = Annotated[tuple[Real, ...] | tuple[tuple[Real, ...], ...] | None, BeforeValidator(_diagonal_or_square)]
"""A matrix by its diagonal of six numbers, or by six rows of six."""
