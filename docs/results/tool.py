"""
A push with the tool of an arm
==============================

The vehicle floats in a current that the law does not know, and the paper's law runs at the tool, with the tool's
inertia in place of the vehicle's. From 12 s on the push is within 2 µN of its closed form, while the joints still move
by 0.2 mrad.
"""

from uvms_mj import Scenario, simulate, still

trace = simulate(Scenario.load("tool_push"))
print(f"push {trace.push[-1]:.6f} N, closed form {trace.analytic.force:.6f} N")
scene = still(trace, plots=(), size=(1280, 720))
force_figure = trace.plot("force", width=6.5)
joints_figure = trace.plot("joints", width=6.5)
position_figure = trace.plot("position", width=6.5)
