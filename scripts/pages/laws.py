"""The table and the picture of docs/laws.md: all shipped laws in one task.

    python scripts/pages/laws.py

Each law shall push with 1.5 N on the paper's wall, in the unknown current of ``push_wall``. Parallel control is asked
for this force by F_d, the other laws by a reference 1 cm inside the wall.
"""

import math
import warnings
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import to_hex

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.analysis.metrics import final_force
from uvms_mj.control import BUILT_IN
from uvms_mj.views.colours import LAWS

PICTURE = Path(__file__).parents[2] / "docs" / "laws.png"
BY_FORCE = {"reference.target": [1.0, 0.0, 0.0], "impedance.F_d": [-1.5, 0.0, 0.0, 0.0, 0.0, 0.0]}
PUSH = 1.5 / (1.0 + 150.0 / 1e5)
"""Force at rest of the desired impedance [N]."""
CASES = {
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


def run(law: str, overrides: dict) -> Trace:
    """A run of a law in the task."""
    task = BY_FORCE if law == "parallel" else {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return simulate(Scenario.load("push_wall", task | overrides, law), engine="free_body")


def demanded(trace: Trace) -> float:
    """Force at rest that the task demands [N]."""
    k_c = trace.scenario.wall.stiffness
    return 1.5 if trace.scenario.controller.label() == "parallel" else 1.5 / (1.0 + 150.0 / k_c)


def error(trace: Trace) -> str:
    """Error of the force at rest, for the table."""
    if trace.status.name != "completed":
        return "diverges"
    force, settled = final_force(trace)
    if force is None or not settled:
        return "oscillates" if trace.notes else "not settled"
    if force == 0.0:
        return "no contact"
    off = force - demanded(trace)
    return "0" if abs(off) < 5e-4 else f"{off:+.3f}"


def rows(traces: dict[str, Trace]) -> Iterator[str]:
    """The table."""
    yield f"| law | peak N | touches | variation of surge thrust N | {' | '.join(CASES)} |"
    yield "|---" * (4 + len(CASES)) + "|"
    for law, trace in traces.items():
        others = [error(run(law, overrides)) if overrides else error(trace) for overrides in CASES.values()]
        numbers = f"{trace.force_peak[-1]:.1f} | {int(trace.touches[-1])} | {trace.tau_variation[-1, 0]:.0f}"
        yield f"| `{law}` | {numbers} | {' | '.join(others)} |"


def draw(ax: Axes, traces: dict[str, Trace], laws: list[str], start: float, end: float) -> None:
    """The pushes of some laws in a window of time."""
    ax.axhline(PUSH, color="#999999", linewidth=0.8, linestyle="--")
    for law in laws:
        trace = traces[law]
        shown = (trace.t >= start) & (trace.t <= end)
        red, green, blue = LAWS[law]
        colour = to_hex((red / 255, green / 255, blue / 255))
        ax.plot(trace.t[shown], trace.push[shown], color=colour, linewidth=1.1, label=law)
    ax.set_xlim(start, end)
    ax.grid(alpha=0.25)
    ax.legend(fontsize=7, ncols=2, loc="upper right")
    ax.set_ylabel("push [N]")


def main() -> None:
    """Print the table and write the picture."""
    traces = {law: run(law, {}) for law in BUILT_IN}
    print("\n".join(rows(traces)))
    groups = [
        ["impedance", "fosm", "gsta", "sta", "ideal"],
        ["dob_impedance", "aismc", "admittance"],
        ["parallel", "pid"],
    ]
    assert sorted(law for group in groups for law in group) == sorted(BUILT_IN)
    figure, axes = plt.subplots(len(groups), 2, figsize=(9.0, 6.6), width_ratios=(3, 2), constrained_layout=True)
    for (whole, late), laws in zip(axes, groups, strict=True):
        draw(whole, traces, laws, 4.0, 9.0)
        draw(late, traces, laws, 8.0, 20.0)
        late.set_ylim(0.0, 10.5 if "pid" in laws else 2.0)
        late.get_legend().remove()
        late.set_ylabel("")
    for ax in axes[-1]:
        ax.set_xlabel("t [s]")
    axes[0, 0].set_title("impacts", fontsize=9)
    axes[0, 1].set_title(f"later; dashed: {PUSH:.4f} N, the desired impedance", fontsize=9)
    figure.savefig(PICTURE, dpi=100)
    size = math.ceil(PICTURE.stat().st_size / 1000)
    print(f"\n{PICTURE.name}: {size} kB")


if __name__ == "__main__":
    main()
