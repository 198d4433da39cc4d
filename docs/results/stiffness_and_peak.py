"""
The impact, and the stiffness of the wall
=========================================

One wall after another, from 1e3 to 1e6 N/m; nothing is built again between two resets. A free mass m that meets a
spring k with the speed v presses with v sqrt(k m) at most. The line is this formula with the inertia in surge, added
mass included. An impact on a soft wall lasts longer, and the law acts in it: at 1e3 N/m the peak is 0.6 % below the
line, at 1e6 N/m 0.04 %.
"""

import numpy as np
from matplotlib.figure import Figure

from uvms_mj import Scenario, Simulation

stiffness, free, peaks = np.logspace(3, 6, 7), [], []
with Simulation(Scenario.load("push_wall", {"simulation.timestep": 2e-5}), engine="free_body") as sim:
    M = np.linalg.inv(np.linalg.inv(sim.setup.vehicle.M)[:3, :3])  # the vehicle may turn and heave in an impact
    for k_c in stiffness:
        sim.reset({"wall.stiffness": float(k_c)})
        sim.step(250_000)  # 5 s of the way to the wall
        while not sim.signals.touches:
            speed = float(sim.signals.nu[0])
            sim.step(10)
        sim.step(15_000)
        free.append(speed * np.sqrt(k_c / np.linalg.inv(M)[0, 0]))
        peaks.append(float(sim.signals.force_peak))

figure = Figure(figsize=(6.4, 3.6), layout="constrained")
axes = figure.subplots()
axes.loglog(stiffness, peaks, "o", label="largest force in the run")
axes.loglog(stiffness, free, "k--", label=r"$v\sqrt{k m}$")
axes.set(xlabel="stiffness of the wall [N/m]", ylabel="force [N]")
axes.set_yticks([2, 5, 10, 20, 50], ["2", "5", "10", "20", "50"])
axes.yaxis.set_minor_formatter("")
axes.legend()
axes.grid(alpha=0.3)
