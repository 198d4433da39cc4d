"""
A path in six degrees of freedom
================================

Constant speed along a smooth curve through positions and attitudes, with feed-forward of velocity and acceleration.
"""

from uvms_mj import Scenario, simulate, still

trace = simulate(Scenario.load("follow_path"))
scene = still(trace, 20.0, plots=(), size=(1280, 720))
position_figure = trace.plot("position", width=6.5)
attitude_figure = trace.plot("attitude", width=6.5)
error_figure = trace.plot("eta_e", width=6.5)
