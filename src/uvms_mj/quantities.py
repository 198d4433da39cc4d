"""Types of the quantities in scenarios and gains: finite numbers, vectors, with the ranges that make sense."""

from typing import Annotated, Any

from annotated_types import Ge, Gt
from pydantic import AfterValidator, Field

Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A finite number."""
Positive = Annotated[Real, Gt(0)]
NonNegative = Annotated[Real, Ge(0)]


def _of_length(n: int) -> AfterValidator:
    def check(value: tuple[Any, ...]) -> tuple[Any, ...]:
        if len(value) != n:
            raise ValueError(f"has {len(value)} values; {n} are needed")
        return value

    return AfterValidator(check)


Vector3 = Annotated[tuple[Real, ...], _of_length(3)]
Vector6 = Annotated[tuple[Real, ...], _of_length(6)]
Matrix6 = Annotated[tuple[Vector6, ...], _of_length(6)]
"""Six rows of six numbers."""
