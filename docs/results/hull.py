"""
A brush on a hull that heaves
=============================

A BlueROV2 Heavy brushes a bilge that heaves and rolls, with friction. The reference rides on the hull, along two lanes,
and the push stays along the local normal. With a spring of 150 N/m in the law, the brush of 2e3 N/m and the hull of
2e4 N/m in a row, the demanded 10 N become 10/(1 + 150/1818) N = 9.24 N. Friction holds the brush back along the hull,
and the push is 9.30 N. With friction the hull pushes back with 9.7 N.
"""

import matplotlib.pyplot as plt

from uvms_mj import Scenario, simulate, still

hull = {
    "shape": "cylinder",
    "position": [4.29, 0.0, 0.0],
    "attitude_deg": [90.0, 0.0, 0.0],
    "radius": 3.0,
    "stiffness": 2e4,
    "damping": 200.0,
    "friction": 0.3,
    "amplitude": [0.0, 0.0, 0.05],
    "frequency_hz": 0.15,
    "turn_amplitude_deg": [0.0, 1.0, 0.0],
    "turn_frequency_hz": 0.1,
    "pivot": [4.29, 0.0, 1.0],
}
brush = {
    "vehicle.model": "bluerov2_heavy",
    "vehicle.contact_bodies": [{"position": [0.25, 0.0, 0.0], "radius": 0.04, "stiffness": 2e3, "damping": 50.0}],
    "simulation.timestep": 1e-3,
    "simulation.duration": 54.0,
    "wall.present": False,
    "walls": [hull],
    "impedance.F_d": [-10.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    "reference.name": "along_surface",
    "reference.points": [[1.3, -0.4, 0.0], [1.3, 0.4, 0.0], [1.3, 0.4, -0.3], [1.3, -0.4, -0.3]],
    "reference.stop": True,
    "reference.ride": True,
}
trace = simulate(Scenario.load("push_wall", brush), engine="free_body")
scene = still(trace, 30.0, plots=(), size=(1280, 720))
force_figure = trace.plot("force", width=6.5)
way_figure, axes = plt.subplots(figsize=(6.5, 3.2), layout="constrained")
late = trace.t > 23.0  # on the lanes
axes.plot(*trace.p_d[late, 1:].T, color="black", label="reference, riding")
axes.plot(*trace.p_WB[late, 1:].T, label="vehicle", alpha=0.7)
axes.set(xlabel="y [m]", ylabel="z [m]", aspect="equal", title="Two lanes on a hull that heaves and rolls")
axes.legend(loc="center left")
