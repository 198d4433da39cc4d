"""
Along a wall, with a push that changes
======================================

The vehicle slides along a wall with friction, and the demanded push follows a schedule.
"""

from uvms_mj import Scenario, simulate, still

trace = simulate(Scenario.load("wipe_wall"))
scene = still(trace, 15.0, plots=(), size=(1280, 720))
force_figure = trace.plot("force", width=6.5)
position_figure = trace.plot("position", width=6.5)
