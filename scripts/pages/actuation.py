"""Draw docs/actuation.png: the curves of the T200 by voltage, and the step responses of the lags.

python scripts/pages/actuation.py
"""

from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

from uvms_mj.actuation.lag import discrete
from uvms_mj.actuation.t200 import VOLTAGES, thrust_curve

matplotlib.use("Agg")
PICTURE = Path(__file__).parents[2] / "docs" / "actuation.png"
PERIOD = 1e-3
STEPS = 120


def step_response(lag: str, time_constant: float = 0.03) -> np.ndarray:
    """The thrust (n,) at each instant after a step of the command."""
    matrices = discrete(lag, time_constant, PERIOD)
    x, found = np.zeros(3), []
    for _ in range(STEPS):
        found.append(float(matrices["C"] @ x))
        x = matrices["Phi"] @ x + matrices["Gamma"]
    return np.array(found)


def main() -> None:
    """Write the picture."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 3.8), layout="constrained")
    colours = plt.get_cmap("viridis")(np.linspace(0.0, 0.85, len(VOLTAGES)))
    for voltage, colour in zip(VOLTAGES, colours, strict=True):
        curve = thrust_curve(voltage)
        left.plot(curve.command, curve.thrust, "o", ms=2.2, color=colour)
        left.plot(curve.command, curve.thrust, lw=1.0, color=colour, label=f"{voltage:g} V")
    between = thrust_curve(15.0)
    left.plot(between.command, between.thrust, "--", lw=1.0, color="0.4", label="15 V, interpolated")
    left.set(xlabel="pulse width [µs]", ylabel="thrust [N]", title="T200: points of the maker's table")
    left.legend(fontsize=8)
    t = 1e3 * PERIOD * np.arange(STEPS)
    right.plot([0.0, 0.0, t[-1]], [0.0, 1.0, 1.0], color="0.4", label="none")
    right.plot(t, step_response("first_order"), color="tab:blue", label="first_order, 30 ms")
    right.plot(t, step_response("third_order"), color="tab:orange", label="third_order, as identified")
    right.plot([20.0, 32.0], [0.63, 0.95], "k+", ms=9, label="63 % at 20 ms, 95 % at 32 ms (source)")
    right.set(xlabel="time after the command [ms]", ylabel="thrust over command", title="Step response of the lags")
    right.legend(fontsize=8)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.savefig(PICTURE, dpi=100)


if __name__ == "__main__":
    main()
