"""
A path in six degrees of freedom
================================

Constant speed along a smooth curve through positions and attitudes, with feed-forward of velocity and acceleration.
"""

from uvms_mj import Scenario, simulate

trace = simulate(Scenario.load("follow_path"))
figure = trace.plot(["position", "attitude", "eta_e"])
