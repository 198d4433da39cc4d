"""Tuning: gains by Optuna for an objective and constraints over the runs of a study."""

from .tuning import Tuning as Tuning
