"""
Gusts, shear and a tether
=========================

The current has Gauss-Markov gusts, falls off with depth, and drags a tether. GSTA keeps the wall, impedance control
loses it.
"""

import uvms_mj
from uvms_mj import Gsta, Impedance, Scenario, simulate

scenario = Scenario.load("push_wall_gusts")
traces = {law.label(): simulate(scenario, controller=law(), engine="free_body") for law in (Impedance, Gsta)}
force_figure = uvms_mj.plot(traces, "force", width=6.5)
position_figure = uvms_mj.plot(traces, "position", width=6.5)
