"""
Along a wall, with a push that changes
======================================

The vehicle slides along a wall with friction, and the demanded push follows a schedule.
"""

from uvms_mj import Scenario, simulate

trace = simulate(Scenario.load("wipe_wall"))
figure = trace.plot(["position", "force"])
