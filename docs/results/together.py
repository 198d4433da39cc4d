"""
Two vehicles and a bar
======================

Two BlueROV1 carry a bar, which a joint holds at the nose of each, and press it against a wall with 20 N each.
"""

from uvms_mj import World, plot, simulate, still

traces = simulate(World.load("press_bar"), engine="free_body")
scene = still(traces, size=(1280, 720))
force_figure = traces["bar"].plot("force", width=6.5)
coupling_figure = traces["bar"].plot("f_couplings_W", width=6.5)
position_figure = plot(traces, "position", width=6.5)
