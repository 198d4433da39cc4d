r"""The speed law of a real BlueROV2 Heavy in MANUAL, against a run and against a closed form, with nothing fitted.

A laboratory measured 29 runs at the pilot's gain of 0.5 (SPEED_PER_AXIS, AXIS_AT_REST). ArduSub's linear mixer moves
the pulses of the four horizontal thrusters by 400 us times gain times axis, two of them in reverse. The thrust X
follows from the T200's curve, and the speed from the drag of the vehicle's file,

.. math:: X = d\,v + D\,v^2.

In the run the axis is a constant wrench ahead, and a PD holds height and attitude, as a pilot does. The voltage of the
battery was not given; 15 V is a battery of four cells in the middle of a dive.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...actuation.propeller import T200
from ...engine.simulation import Simulation
from ...physics.frames import rotation_matrix
from ...scenario import Scenario
from ...setup.base import set_up

SPEED_PER_AXIS, AXIS_AT_REST = 0.692, 0.096
"""The measured law: speed = 0.692 (axis - 0.096) m/s."""
AXES = (0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5)
VOLTAGE, GAIN = 15.0, 0.5
BOUND = 0.05
"""Largest rms error of the speed over its mean."""
_DURATION, _TICK = 12.0, 0.01
_SPRING = np.array([0.0, 0.0, 200.0, 20.0, 20.0, 20.0])  # N/m, N m/rad
_DAMPER = np.array([0.0, 0.0, 100.0, 5.0, 5.0, 5.0])  # N s/m, N m s/rad


@dataclass(frozen=True)
class Speed:
    """Speeds ahead at an axis of the pilot [m/s]: by the measured law, in the run and in closed form."""

    axis: float
    measured: float
    run: float
    closed_form: float


def scenario(voltage: float = VOLTAGE) -> Scenario:
    """A Heavy in still water that a linear mixer drives."""
    return Scenario.load(
        "push_wall",
        {
            "vehicle.model": "bluerov2_heavy",
            "wall.present": False,
            "current.speed": 0.0,
            "simulation.timestep": 1e-3,
            "simulation.duration": _DURATION,
            "controller.name": "external",
            "thrusters.name": "t200",
            "thrusters.voltage": voltage,
            "thrusters.mixer": "linear",
            "thrusters.pilot_gain": GAIN,
        },
    )


def speeds(voltage: float = VOLTAGE, progress: Callable[[int], None] = lambda done: None) -> list[Speed]:
    """The speeds at each of :data:`AXES` with a battery of a voltage [V]. ``progress`` is called with the number of
    axes done."""
    made = scenario(voltage)
    setup = set_up(made)
    B, thrusters = setup.vehicle.B, made.thrusters
    assert isinstance(thrusters, T200)
    true, mixed = thrusters.curves()
    assert true is not None
    assert mixed is not None
    signs = np.sign(np.where(np.abs(B[0]) > 0.1, B[0], 0.0))
    ahead = float(np.abs(B[0]) @ np.abs(signs)) * mixed.thrust[-1]
    d, D = float(setup.vehicle.D_linear[0, 0]), float(setup.vehicle.D_quadratic[0, 0])
    found = []
    for axis in AXES:
        X = float(B[0] @ (true.at(mixed.command_for(axis * mixed.thrust[-1] * signs)) * np.abs(signs)))
        v = (math.sqrt(d * d + 4.0 * D * X) - d) / (2.0 * D)
        found.append(Speed(axis, SPEED_PER_AXIS * (axis - AXIS_AT_REST), _run(made, axis * ahead), v))
        progress(len(found))
    return found


def _run(made: Scenario, ahead: float) -> float:
    """The speed at the end of a run with a constant wrench ahead [N]."""
    with Simulation(made, engine="free_body") as sim:
        height = made.initial.position[2]
        for _ in range(round(_DURATION / _TICK)):
            R = rotation_matrix(sim.signals.quat_WB)
            turned = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
            error = np.array([0.0, 0.0, sim.signals.p_WB[2] - height, *turned])
            sim.tau_cmd[:] = -_SPRING * error - _DAMPER * sim.signals.nu
            sim.tau_cmd[0] = ahead
            sim.step(round(_TICK / made.simulation.timestep))
        return float(sim.signals.nu[0])


def rms_error(found: list[Speed], name: str = "run") -> float:
    """Root mean square error of the speeds over their measured mean [1]."""
    measured = np.array([each.measured for each in found])
    errors = np.array([getattr(each, name) for each in found]) - measured
    return float(np.sqrt(np.mean(errors**2)) / measured.mean())
