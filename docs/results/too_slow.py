"""
A control rate that is too low, and a bumper that helps
=======================================================

At 100 Hz the contact force is older than D_d/(K_f k_c) on the paper's wall, and the vehicle bounces. A softer wall
and smaller gains hold. A run says so before its first step.
"""

import uvms_mj
from uvms_mj import Scenario, simulate

traces = {
    "100 Hz, 1e5 N/m": simulate(Scenario.load("push_wall", {"controller.period": 0.01})),
    "100 Hz, soft wall": simulate(Scenario.load("push_soft_wall_100hz")),
}
force_figure = uvms_mj.plot(traces, "force", width=6.5)
position_figure = uvms_mj.plot(traces, "position", width=6.5)
