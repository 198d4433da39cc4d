"""
Real thrusters and an estimated state
=====================================

The BlueROV2 Heavy with T200 thrusters, whose dead band and lag the law does not know, on a soft wall. On 14 V they
saturate during the approach: GSTA's integral winds up, and the vehicle hits the wall with 0.4 m/s and some 80 N,
before it settles. On 16 V it arrives as the ideal one does. The last run has the state of an error-state Kalman filter
of inertial unit, DVL, pressure and heading. It touches as softly, and then presses less: with 0.9 N on average from 7
to 10 s, and 1.3 N in the last two seconds, in place of 1.4 N. The thrusters' lag makes the push vibrate by some 0.07 N;
each run with these thrusters warns of it before its first step.
"""

import uvms_mj
from uvms_mj import Scenario, simulate

HEAVY = {"vehicle.model": "bluerov2_heavy", "wall.stiffness": 2e3, "simulation.duration": 15.0}
T200 = HEAVY | {"thrusters.name": "t200"}
runs = {
    "ideal": HEAVY,
    "14 V": T200 | {"thrusters.voltage": 14.0},
    "16 V": T200 | {"thrusters.voltage": 16.0},
    "16 V, filter": T200 | {"thrusters.voltage": 16.0, "navigation.name": "ekf"},
}
traces = {name: simulate(Scenario.load("push_wall", run), engine="free_body") for name, run in runs.items()}
for name, trace in traces.items():
    print(f"{name:13s} largest force {trace.force_peak[-1]:5.1f} N, saturated for {trace.saturation_time[-1]:.1f} s")
force_figure = uvms_mj.plot(traces, "force", width=6.5)
position_figure = uvms_mj.plot(traces, "position", width=6.5)
tau_figure = uvms_mj.plot(traces, "tau.x", width=6.5)
