"""docs/physics/laws.md: all shipped laws in one task, as a table and a picture.

Each law shall push with 1.5 N on the paper's wall, in the unknown current of ``push_wall``. Parallel control is asked
for this force by F_d, the other laws by a reference 1 cm inside the wall.
"""

import functools
import warnings
from collections.abc import Iterator
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from page_look import written
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.control import BUILT_IN
from uvms_mj.views.colours import hex_of_runs
from uvms_mj.views.figures.style import GREY, PAGE_IN, line, styled

BY_FORCE = {"reference.target": [1.0, 0.0, 0.0], "impedance.F_d": [-1.5, 0.0, 0.0, 0.0, 0.0, 0.0]}
PUSH = 1.5 / (1.0 + 150.0 / 1e5)
"""Force at rest of the desired impedance [N]."""
CASES: dict[str, dict[str, Any]] = {
    "paper's scenario": {},
    "model errors": {
        "estimates.inertia": 1.3,
        "estimates.coriolis": 0.5,
        "estimates.damping": 0.5,
        "estimates.restoring": 1.2,
    },
    "100 Hz": {"controller.period": 0.01},
    "wall of 1e3 N/m": {"wall.stiffness": 1e3},
}


@functools.cache
def run(law: str, case: str = "paper's scenario") -> Trace:
    """A run of a law in the task."""
    task = BY_FORCE if law == "parallel" else {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return simulate(Scenario.load("push_wall", task | CASES[case], law), engine="free_body")


def error(trace: Trace) -> tuple[str, tuple]:
    """The cell of the force at rest: its words, with a hole for its error [N]."""
    if trace.status.name != "completed":
        return "diverges", ()
    force, settled = final_force(trace)
    if force is None or not settled:
        return "oscillates" if trace.notes else "not settled", ()
    if force == 0.0:
        return "no contact", ()
    k_c = trace.scenario.wall.stiffness
    off = force - (1.5 if trace.scenario.controller.label() == "parallel" else 1.5 / (1.0 + 150.0 / k_c))
    return ("0", ()) if abs(off) < 5e-4 else ("{}", (off,))


def numbers() -> Iterator[tuple]:
    for law in BUILT_IN:
        trace = run(law)
        cells = [error(run(law, case)) for case in CASES]
        yield (
            f"| `{law}` | {{}} | {{}} | {{}} | {' | '.join(words for words, _ in cells)} |",
            trace.force_peak[-1],
            trace.touches[-1],
            (trace.tau_variation[-1, 0], 0.01 * trace.tau_variation[-1, 0]),
            *(value for _, values in cells for value in values),
        )
    yield "the desired impedance demands, {} N", PUSH
    impedance = run("impedance")
    yield "the current holds it {} mm off", 1e3 * (impedance.scenario.wall.position - impedance.p_WB[-1, 0])


def main() -> None:
    """Draw the push of each law."""
    columns = 2
    with styled():
        figure, axes = plt.subplots(-(-len(BUILT_IN) // columns), columns, figsize=(PAGE_IN, 5.4), sharex=True)
        for ax, law, colour in zip(axes.flat, BUILT_IN, hex_of_runs(list(BUILT_IN)), strict=True):
            trace = run(law)
            shown = (trace.t > 4.5) & (trace.t < 9.5)
            ax.axhline(PUSH, color=GREY, linewidth=0.8, linestyle="--")
            line(ax, trace.t[shown], trace.push[shown], law, color=colour)
            found, top = np.flatnonzero(trace.push > 0.0), 42.0 if law == "parallel" else 20.0
            peak = f"peak {trace.force_peak[-1]:.1f} N, {trace.push[-1]:.3f} N at 20 s" if len(found) else "no contact"
            ax.text(0.985, 0.9, peak, ha="right", va="top", transform=ax.transAxes)
            ax.set(title=law, xlim=(4.5, 9.5), ylim=(-0.05 * top, top))
        for ax in axes[:, 0]:
            ax.set_ylabel("push [N]")
        for ax in axes[-1]:
            ax.set_xlabel("time [s]")
        written(figure, "laws")
