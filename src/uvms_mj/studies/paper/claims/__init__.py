"""Measures and judges the paper's claims in a set of runs."""

from .base import Claim, Measured, Row, Runs, Verdict
from .measures import REST_S, TRANSIENT_S, linear_sum
from .paper import CLAIMS, judge

__all__ = [
    "CLAIMS",
    "REST_S",
    "TRANSIENT_S",
    "Claim",
    "Measured",
    "Row",
    "Runs",
    "Verdict",
    "judge",
    "linear_sum",
]
