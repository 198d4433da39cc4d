"""
Two bumpers on a pile
=====================

A BlueROV2 Heavy with two bumpers presses on a round pile. Each contact has its own force and its moment.
"""

from uvms_mj import Scenario, simulate

trace = simulate(Scenario.load("press_pile"))
figure = trace.plot(["force", "f_normal", "position"])
