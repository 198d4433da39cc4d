"""
Three laws push on a wall
=========================

The paper's scenario: a BlueROV1 in an unknown current of 0.5 m/s, a wall of 1e5 N/m, a reference 1 cm inside it.
Impedance control stops short of the wall, the first-order sliding mode and generalised super-twisting (GSTA) press.
The dotted line is the closed form.
"""

import uvms_mj
from uvms_mj import Fosm, Gsta, Impedance, simulate

traces = {law.label(): simulate(controller=law()) for law in (Impedance, Fosm, Gsta)}
for name, trace in traces.items():
    print(f"{name:10s} {trace.push[-1]:.6f} N, closed form {trace.analytic.force:.6f} N")

force_figure = uvms_mj.plot(traces, "force", width=6.5)
position_figure = uvms_mj.plot(traces, "position", width=6.5)
sliding_figure = uvms_mj.plot(traces, "sliding", width=6.5)
tau_figure = uvms_mj.plot(traces, "tau", width=6.5)
