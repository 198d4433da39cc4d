"""
Two bumpers on a pile
=====================

A BlueROV2 Heavy with two bumpers presses on a round pile. Each contact has its own force and its moment.
"""

from uvms_mj import Scenario, simulate, still

trace = simulate(Scenario.load("press_pile"))
scene = still(trace, plots=(), size=(1280, 720))
force_figure = trace.plot("force", width=6.5)
f_normal_figure = trace.plot("f_normal", width=6.5)
position_figure = trace.plot("position", width=6.5)
