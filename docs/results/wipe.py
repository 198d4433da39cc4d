"""
Along a wall, with a push that changes
======================================

The vehicle slides along a wall with friction, and the demanded push follows a schedule.
"""

from uvms_mj import Scenario, simulate

trace = simulate(Scenario.load("wipe_wall"))
force_figure = trace.plot("force", width=6.5)
position_figure = trace.plot("position", width=6.5)
