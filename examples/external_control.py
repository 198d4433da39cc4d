"""Control from outside: a PD controller in Python at 50 Hz sets the wrench, and 200 steps of 0.1 ms follow.

python examples/external_control.py
"""

import numpy as np

from uvms_mj import Scenario, Simulation

SETTINGS = {
    "controller.name": "external",
    "wall.position": 5.0,
    "current.speed": 0.0,
    "reference.target": [1.0, 0.5, 0.0],
}
STIFFNESS = np.array([20.0, 20.0, 20.0, 2.0, 2.0, 2.0])
DAMPING = np.array([40.0, 40.0, 40.0, 2.0, 2.0, 2.0])


def drive(sim: Simulation, duration: float) -> None:
    """Drive the vehicle to the reference."""
    while sim.t < duration:
        sim.tau_cmd[:] = -STIFFNESS * sim.signals.eta_e - DAMPING * sim.signals.nu_e
        sim.step(200)


if __name__ == "__main__":
    from matplotlib.figure import Figure

    rows = []
    with Simulation(Scenario.load("push_wall", SETTINGS)) as sim:
        while sim.t < 20.0:
            drive(sim, sim.t + 0.1)
            rows.append((sim.t, *sim.signals.p_WB))
        print("position [m]:", sim.signals.p_WB.round(6), "error [m]:", sim.signals.eta_e[:3].round(6))
    figure = Figure(figsize=(6.4, 3.0), layout="constrained")
    axes = figure.subplots()
    t, *position = zip(*rows, strict=True)
    for name, values in zip("xyz", position, strict=True):
        axes.plot(t, values, label=name)
    axes.set(xlabel="time [s]", ylabel="position [m]")
    axes.legend()
