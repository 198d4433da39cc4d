"""
Two bumpers on a pile
=====================

A BlueROV1 with two bumpers presses on a round pile. Each contact has its own force and its moment. The push of 9.5 N
is the sum of the two normal forces. They point away from the axis of the pile: their components along y cancel, and the
vehicle feels 8.2 N along x.
"""

from uvms_mj import Scenario, simulate, still

trace = simulate(Scenario.load("press_pile"))
scene = still(trace, plots=(), size=(1280, 720))
force_figure = trace.plot("force", width=6.5)
contacts_figure = trace.plot("f_contacts_W", width=6.5)
position_figure = trace.plot("position", width=6.5)
