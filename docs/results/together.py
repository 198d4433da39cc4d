"""
Two vehicles, side by side and with a bar
=========================================

Two BlueROV1 press on one wall, each with a law of its own. Then they carry a bar, which a joint holds at the nose of
each, and press it against the wall with 20 N each. The loads are known before the run, in closed form. The bar's first
coupling is the joint at ``left``, its second at ``right``.
"""

from uvms_mj import World, coupled_rest, plot, simulate, still

beside = simulate(World.load("press_together"), engine="free_body")
beside_scene = still(beside, size=(1280, 720))
beside_figure = plot(beside, "force", width=6.5)

# %%
print("at rest, on the bar:", coupled_rest(World.load("press_bar")).on("bar").round(2).tolist())

traces = simulate(World.load("press_bar"), engine="free_body")
scene = still(traces, size=(1280, 720))
force_figure = plot({"bar": traces["bar"]}, "force", width=6.5)
coupling_figure = plot({"bar": traces["bar"]}, "f_couplings_W", width=6.5)
position_figure = plot(traces, "position", width=6.5)
