"""
Real thrusters and an estimated state
=====================================

The BlueROV2 Heavy with T200 thrusters on 14 V, whose dead band and lag the law does not know, on a soft wall. The
state comes from an error-state Kalman filter of inertial unit, DVL, pressure and heading.
"""

import uvms_mj
from uvms_mj import Scenario, simulate

HEAVY = {"vehicle.model": "bluerov2_heavy", "wall.stiffness": 2e3, "simulation.duration": 15.0}
T200 = HEAVY | {"thrusters.name": "t200", "thrusters.voltage": 14.0}
traces = {
    "ideal": simulate(Scenario.load("push_wall", HEAVY)),
    "T200": simulate(Scenario.load("push_wall", T200)),
    "T200, Kalman filter": simulate(Scenario.load("push_wall", T200 | {"navigation.name": "ekf"})),
}
force_figure = uvms_mj.plot(traces, "force", width=6.5)
position_figure = uvms_mj.plot(traces, "position", width=6.5)
tau_figure = uvms_mj.plot(traces, "tau", width=6.5)
