"""Worlds of two bars, the load of press_bar, without law and without water."""

from pathlib import Path

import uvms_mj
from uvms_mj import World

BAR = str(Path(uvms_mj.__file__).parent / "scenarios" / "bar.xml")
DRY = {"added_mass": 0.0, "linear_damping": 0.0, "quadratic_damping": 0.0}
"""Keys of a vehicle that feels no water."""


def bars(coupling, *positions, duration=1.0, timestep=1e-4, **tables):
    """A world of two bars at two positions, and one coupling of them."""
    vehicles = [
        {"name": name, "initial": {"position": list(p)}, "vehicle": {"model": BAR, **DRY}}
        for name, p in zip("ab", positions, strict=True)
    ]
    given = {
        "simulation": {"duration": duration, "timestep": timestep},
        "wall": {"present": False},
        "current": {"speed": 0.0},
        "controller": {"name": "none"},
        "couplings": [{"vehicles": ["a", "b"], **coupling}],
        "vehicles": vehicles,
    }
    return World.from_dict(given | tables)
