"""A run by hand: the same vehicle meets walls of different stiffness. Nothing is compiled again between them.

python examples/step_by_hand.py
"""

from uvms_mj import Scenario, Simulation


def impact(sim: Simulation, stiffness: float) -> tuple[float, float]:
    """Time of the first contact [s], to 1 ms, and the largest force [N] in the 0.1 s after it."""
    sim.reset({"wall.stiffness": stiffness})
    while not sim.signals.touches:
        sim.step(10)
    first = sim.t
    sim.step(1000)
    return first, sim.signals.force_peak


if __name__ == "__main__":
    from matplotlib.figure import Figure

    rows = []
    with Simulation(Scenario.load("push_wall")) as sim:
        for stiffness in (1e4, 2e4, 3e4, 5e4, 1e5):
            first, peak = impact(sim, stiffness)
            rows.append((stiffness, peak))
            print(f"{stiffness:6.0f} N/m: contact at {first:.3f} s, {peak:.2f} N")
    figure = Figure(figsize=(6.4, 3.0), layout="constrained")
    axes = figure.subplots()
    axes.plot(*zip(*rows, strict=True), "o-")
    axes.set(xlabel="stiffness of the wall [N/m]", ylabel="largest force [N]", ylim=(0.0, None))
