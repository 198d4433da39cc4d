"""The elements of a real vehicle that the benchmark switches on, one after the other and all at once."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from everything import EVERYTHING

IDEAL: Mapping[str, Any] = {
    "vehicle.model": "bluerov2_heavy",
    "initial.position": [1.0, 0.0, 0.0],
    "wall.stiffness": 1e4,
}
CONTROL_PERIODS = {"10 kHz": 1e-4, "100 Hz": 0.01}
_PILE = {"shape": "cylinder", "position": [1.318, 0.1, 0.0], "radius": 0.1, "stiffness": 1e4}
_POSES = [{"time": 1.0, "position": [1.02, 0.05, 0.0], "attitude_deg": [0.0, 5.0, 10.0]}]
_CHANGE = {"time": 0.5, "F_d": [-2.0, 0.0, 0.0, 0.0, 0.0, 0.0], "ramp": 0.5}
_BODY = {"position": [0.2, 0.0, 0.0], "radius": 0.0285}

ELEMENTS: Mapping[str, Mapping[str, Any]] = {
    "ideal": {},
    "ideal again": {},
    "thrusters: t200": {"thrusters.name": "t200"},
    "allocation: constrained": {"actuation.name": "constrained"},
    "computation delay": {"controller.delay": 0.005},
    "sensors: rov": {"navigation.name": "rov"},
    "Kalman filter": {"navigation.name": "ekf"},
    "momentum observer": {"observer.name": "momentum_observer"},
    "current: Gauss-Markov": {"current.deviation": [0.05, 0.05, 0.02]},
    "current: shear": {"current.shear": [[0.0, 1.0], [5.0, 0.5]]},
    "disturbance: Gauss-Markov": {"disturbance.deviation": [0.5, 0.5, 0.5, 0.05, 0.05, 0.05]},
    "tether": {"tether.length": 5.0},
    "friction of the wall": {"wall.friction": 0.3},
    "bumper": {"bumper.stiffness": 2e3, "bumper.damping": 20.0},
    "a pile among the walls": {"walls": [_PILE]},
    "contact body": {"vehicle.contact_bodies": [_BODY]},
    "schedule": {"impedance.schedule": [_CHANGE]},
    "spline": {"reference.name": "spline", "reference.poses": _POSES},
    "everything, sensors": EVERYTHING["sensors"],
    "everything, Kalman filter": EVERYTHING["filter"],
}
"""Keys of each element besides the keys of :data:`IDEAL`."""
