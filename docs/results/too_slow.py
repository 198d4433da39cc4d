"""
A control rate that is too low
==============================

At 100 Hz the contact force is older than D_d/(K_f k_c) on the paper's wall, and the vehicle bounces between 0 and 8 N
until the end. The run warns of it before its first step. On a wall of 2e3 N/m and with smaller gains the same vehicle
touches once and rests at the closed form, 1.395 N.
"""

import uvms_mj
from uvms_mj import Scenario, simulate

hard = simulate(Scenario.load("push_wall", {"controller.period": 0.01}))
soft = simulate(Scenario.load("push_soft_wall_100hz", {"simulation.duration": 20.0}))
hard_figure = uvms_mj.plot({"1e5 N/m": hard}, "force", width=6.5)
soft_figure = uvms_mj.plot({"2e3 N/m, smaller gains": soft}, "force", width=6.5)
for name, trace in {"1e5 N/m": hard, "2e3 N/m": soft}.items():
    last = trace.between(15.0, 20.0)
    least, most = last.push.min(), last.push.max()
    print(f"{name}: touched {trace.touches[-1]:.0f} times, push from {least:.3f} to {most:.3f} N in the last 5 s")
