"""
Added mass, exact and stable
============================

A constant thrust from rest. The surge equation (m + A_11) u_dot = X - (d + q abs(u)) u has a solution in closed form,
and the run is on it. A simulator that computes the force of the added mass from the last acceleration diverges where
the added mass exceeds the mass; here it is part of the inertia. The grey line is the same thrust without added mass.
Later than shown, the Munk moment turns a vehicle that nobody steers.
"""

import numpy as np
from matplotlib.figure import Figure

from uvms_mj import Scenario, Simulation

FREE = {"controller.name": "external", "current.speed": 0.0, "wall.position": 100.0, "simulation.timestep": 1e-3}
THRUST = 20.0  # N


def surge(added_mass: float) -> tuple[np.ndarray, np.ndarray]:
    """Time and surge velocity, with a factor on the added mass."""
    rows = []
    with Simulation(Scenario.load("push_wall", FREE | {"vehicle.added_mass": added_mass}), engine="free_body") as sim:
        sim.tau_cmd[0] = THRUST
        while sim.t < 1.6:
            rows.append((sim.t, float(sim.signals.nu[0])))
            sim.step(20)
    t, u = np.array(rows).T
    return t, u


figure = Figure(figsize=(6.4, 3.6), layout="constrained")
axes = figure.subplots()
axes.plot(*surge(1e-3), color="0.6", label="without added mass")
t, u = surge(1.0)
axes.plot(t, u, "o", markersize=3, label="run")
with Simulation(Scenario.load("push_wall"), engine="free_body") as sim:
    vehicle = sim.setup.vehicle
m, d, q = vehicle.M[0, 0], vehicle.D_linear[0, 0], vehicle.D_quadratic[0, 0]
# of m u_dot = X - d u - q u^2
root = np.sqrt(d * d + 4.0 * q * THRUST)
shift = np.arctanh(d / root)
axes.plot(t, (root * np.tanh(root * t / (2.0 * m) + shift) - d) / (2.0 * q), "k--", label="closed form")
axes.set(xlabel="time [s]", ylabel="surge velocity [m/s]")
axes.legend()
axes.grid(alpha=0.3)
