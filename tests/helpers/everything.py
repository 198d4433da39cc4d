"""Scenarios with every element of a real vehicle switched on, in contact from the first tenth of a second."""

from typing import Any

from uvms_mj import Scenario

_WATER_AND_WALLS: dict[str, Any] = {
    "vehicle.model": "bluerov2_heavy",
    "initial.position": [1.0, 0.0, 0.0],
    "initial.attitude_deg": [2.0, -3.0, 4.0],
    "initial.velocity": [0.05, 0.0, 0.01, 0.0, 0.02, 0.0],
    "controller.period": 0.01,
    "controller.delay": 0.005,
    "thrusters.name": "t200",
    "thrusters.voltage": 14.0,
    "thrusters.assumed_voltage": 16.0,
    "thrusters.inflow_loss": 0.5,
    "thrusters.start_delay": 0.02,
    "thrusters.rate_limit": 500.0,
    "thrusters.dead_band": 30.0,
    "actuation.name": "constrained",
    "current.vertical": 0.05,
    "current.deviation": [0.05, 0.05, 0.02],
    "current.correlation_time": 2.0,
    "current.shortest_gust": 0.1,
    "current.shear": [[-1.0, 1.0], [0.0, 0.9], [5.0, 0.5]],
    "disturbance.bias": [0.3, -0.2, 0.1, 0.0, 0.0, 0.02],
    "disturbance.deviation": [0.5, 0.5, 0.5, 0.05, 0.05, 0.05],
    "disturbance.correlation_time": 2.0,
    "tether.length": 5.0,
    "tether.diameter": 0.008,
    "tether.position": [-0.2, 0.0, 0.1],
    "wall.stiffness": 2e4,
    "wall.damping": 50.0,
    "wall.friction": 0.3,
    "walls": [
        {
            "shape": "cylinder",
            "position": [1.318, 0.1, 0.0],
            "radius": 0.1,
            "stiffness": 2e4,
            "damping": 20.0,
            "layer_depth": 0.002,
            "layer_stiffness": 1e5,
            "friction": 0.2,
            "amplitude": [0.01, 0.02, 0.0],
            "frequency_hz": 3.0,
        }
    ],
    "reference.name": "spline",
    "reference.poses": [
        {"time": 0.5, "position": [1.02, 0.05, 0.02], "attitude_deg": [0.0, 5.0, 10.0], "dwell": 0.2},
        {"time": 2.0, "position": [1.01, 0.0, 0.0]},
    ],
    "impedance.schedule": [
        {"time": 0.1, "K_f": [0.5, 1.0, 1.0, 1.0, 1.0, 1.0], "ramp": 0.2},
        {"time": 0.3, "F_d": [-2.0, 0.0, 0.0, 0.0, 0.0, 0.0], "ramp": 0.5},
    ],
}
_BUMPER: dict[str, Any] = {"bumper.stiffness": 2e3, "bumper.damping": 20.0}
_CONTACT_BODIES: dict[str, Any] = {
    "vehicle.contact_bodies": [
        {"position": [0.205, 0.12, 0.0], "radius": 0.0285, "stiffness": 2e3, "damping": 20.0},
        {"position": [0.19, -0.12, 0.0], "end": [0.19, -0.05, 0.1], "radius": 0.0285},
    ],
}


def _sensor(quantity: str, size: float, period: float) -> dict[str, Any]:
    """All errors of one quantity's sensor."""
    given = {"period": period, "delay": 0.01, "jitter": 0.002, "noise": size, "bias": size, "walk": size}
    given |= {"quantum": 0.1 * size, "limit": 1e4 * size, "dropout": 0.05}
    return {f"navigation.{quantity}_{name}": value for name, value in given.items()}


WITH_SENSORS: dict[str, Any] = {
    **_WATER_AND_WALLS,
    **_BUMPER,
    "navigation.name": "rov",
    **_sensor("position", 1e-3, 0.02),
    **_sensor("attitude", 2e-3, 0.01),
    **_sensor("velocity", 2e-3, 0.025),
    **_sensor("angular_velocity", 2e-3, 0.005),
    **_sensor("force", 0.1, 0.005),
    **_sensor("moment", 0.01, 0.005),
    "navigation.force_scale": 0.02,
    "navigation.mass_behind": 0.5,
    "navigation.mass_behind_at": [0.2, 0.0, 0.05],
    "navigation.depth_drift": [0.5, 0.0, 1.0],
}
"""Sensors with all their errors, something behind the force sensor, and a bumper in front of the probe."""
WITH_FILTER: dict[str, Any] = {
    **_WATER_AND_WALLS,
    **_CONTACT_BODIES,
    "navigation.name": "ekf",
    "observer.name": "momentum_observer",
    "observer.calibrate_until": 0.05,
    "observer.threshold": 0.5,
}
"""The Kalman filter and the momentum observer in place of sensors, and contact bodies in place of the probe."""
EVERYTHING = {"sensors": WITH_SENSORS, "filter": WITH_FILTER}


def everything(name: str = "sensors", **more: Any) -> Scenario:
    """One of the scenarios, with further dotted keys in which two underscores stand for a dot."""
    return Scenario.load("push_wall", EVERYTHING[name] | {key.replace("__", "."): value for key, value in more.items()})
