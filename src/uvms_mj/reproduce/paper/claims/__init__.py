"""Measures and judges the paper's claims in a set of runs."""

from .base import Claim, Measured, Row, Runs, Verdict
from .paper import CLAIMS, judge

__all__ = ["CLAIMS", "Claim", "Measured", "Row", "Runs", "Verdict", "judge"]
