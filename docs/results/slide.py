"""
Sliding on a pile, 10 N, with friction
======================================

The tool presses on a round pile and slides along it. Coulomb friction acts at the contact point, with a tangential
spring while it sticks.
"""

from uvms_mj import Scenario, simulate, still

trace = simulate(Scenario.load("tool_slide"))
scene = still(trace, 20.0, plots=(), size=(1280, 720))
force_figure = trace.plot("force", width=6.5)
components_figure = trace.plot("f_contact_W", width=6.5)
