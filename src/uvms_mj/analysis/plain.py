"""The scenarios in which a simple formula along x gives the force at rest."""

import dataclasses
import json
from typing import Any

import numpy as np

from ..stages.base import Stage

_FREE = ("name", "description", "simulation", "initial", "reference", "impedance", "task", "controller")
"""Tables on which such a formula does not depend, or whose values are in it."""
_FREE_KEYS = {
    "vehicle": ("model", "added_mass", "linear_damping", "quadratic_damping", "coulomb_friction"),
    "current": ("speed", "direction_deg", "vertical", "frequency_hz", "correlation_time", "shortest_gust", "shear"),
    "disturbance": ("bias", "frequency_hz", "correlation_time"),
    "wall": ("position", "stiffness", "damping", "tangential_stiffness", "tangential_damping"),
    "estimates": ("inertia", "coriolis", "damping"),
}
"""The same for single keys of a table. Of a stage it is the period alone."""
_ALIGNED = 1e-9


def not_plain(setup: Any) -> str:
    """The first reason why a scenario, of a :class:`.setup.Setup`, is not a plain one; empty if it is.

    In a plain scenario a rigid vehicle whose task is at B touches ``[wall]`` with its probe alone and without friction,
    the measurements are true, the thrusters produce each wrench as commanded within their limits, g_hat = g, the
    current and the disturbance are constant, and the reference comes to rest aligned with the wall. Every key has its
    default but those on which the force at rest does not depend, or which a formula has in it.
    """
    if setup.not_rigid:
        return str(setup.not_rigid)
    for field in dataclasses.fields(setup.scenario):
        if field.name not in _FREE:
            reason = _changed(field.name, getattr(setup.scenario, field.name), field.default)
            if reason:
                return reason
    if np.linalg.matrix_rank(setup.nominal.B) < 6:
        return "the thrusters can't produce every wrench"
    if setup.rest_pose[0] is None:
        return "the reference does not come to rest"
    if np.abs(setup.design.normal - np.eye(6)[0]).max() > _ALIGNED:
        return "the reference is not aligned with the wall"
    return ""


def _changed(name: str, table: Any, default: Any) -> str:
    """A sentence with the first key of a table that has not its default and is not free; empty if there is none."""
    if isinstance(default, Stage) and type(table) is not type(default):
        return _needs(f"{name}.name", default.name)
    if not dataclasses.is_dataclass(table):
        return "" if table == default else _needs(name, default)
    free = ("period",) if isinstance(default, Stage) else _FREE_KEYS.get(name, ())
    for field in dataclasses.fields(table):
        normal = getattr(default, field.name)
        if field.name not in free and getattr(table, field.name) != normal:
            return _needs(f"{name}.{field.name}", normal)
    return ""


def _needs(key: str, default: Any) -> str:
    value = f"with {key}={json.dumps(default)}" if default not in (None, ()) else f"without {key}"
    return f"the formula of this law holds {value} only"
