"""Differences between the engines free_body and mujoco over random scenarios.

    python scripts/compare_engines.py                     200 scenarios of 20 s
    python scripts/compare_engines.py --runs 20 --seed 3

Each scenario has its own vehicle, law, wall, current, disturbance, friction, errors of the estimates and initial state.
The differences of a run are the largest one of the position at any sample, one of the peak force, and one of the force
at rest, if free_body's has come to rest within 1e-9 of itself. ``unrest`` is the variation of the force in MuJoCo
meanwhile. A law that chatters, with steps of the thrust above 50 N, is chaotic at the touch. Its runs are listed
separately, with the differences of MuJoCo from itself, ``its_position_m`` and ``its_peak``, when the start moves by
1e-15 m.
"""

import statistics
import warnings
from collections.abc import Mapping
from typing import Any

import click
import numpy as np

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.stages.signals import FINAL_WINDOW_S

LAWS = ("gsta", "sta", "fosm", "impedance", "ideal")
CHATTERS = 50.0
"""Largest step of the thrust of a law that does not chatter [N]."""
AT_REST = 1e-9
"""Largest relative variation of a force at rest over the final window."""


def drawn(rng: np.random.Generator, duration: float) -> Scenario:
    """A random scenario that free_body takes: an approach to a wall, or a start on it."""

    def between(low: float, high: float, n: int = 3) -> list[float]:
        return rng.uniform(low, high, n).tolist()

    x = float(rng.uniform(0.0, 0.15)) * float(rng.integers(2))
    law = LAWS[rng.integers(len(LAWS))]
    h = float(rng.choice([5e-5, 1e-4, 2e-4]))
    rough = bool(rng.integers(2))
    overrides: dict[str, Any] = {
        "simulation.timestep": h,
        "simulation.duration": duration,
        "initial.position": [0.0, *between(-0.05, 0.05, 2)],
        "initial.attitude_deg": between(-12.0, 12.0),
        "initial.velocity": [0.0, *between(-0.05, 0.05, 2), *between(-0.1, 0.1)],
        "current.speed": float(rng.uniform(0.0, 0.6)),
        "current.direction_deg": float(rng.uniform(-180.0, 180.0)),
        "disturbance.bias": between(-3.0, 3.0, 3) + between(-0.1, 0.1, 3),
        "wall.position": x,
        "wall.stiffness": float(np.exp(rng.uniform(np.log(1e4), np.log(1.5e5)))),
        "wall.damping": float(rng.uniform(0.0, 30.0)),
        "wall.friction": float(rng.uniform(0.05, 0.5)) if rough else 0.0,
        "reference.target": [x + float(rng.uniform(0.005, 0.03)), *between(-0.05, 0.05, 2)],
        "reference.step_time": float(rng.uniform(0.0, 0.5)),
        "reference.bandwidth": float(rng.uniform(1.0, 4.0)),
        "estimates.inertia": float(rng.uniform(0.9, 1.2)),
        "estimates.damping": float(rng.uniform(0.7, 1.3)),
        "controller.period": h * int(rng.choice([1, 1, 5])),
        "vehicle.mass": float(rng.uniform(0.9, 1.1)),
        "vehicle.added_mass": float(rng.uniform(0.8, 1.2)),
        "vehicle.linear_damping": float(rng.uniform(0.5, 1.5)),
        "vehicle.quadratic_damping": float(rng.uniform(0.5, 1.5)),
        "vehicle.displaced_mass": float(rng.uniform(0.95, 1.05)),
        "vehicle.thruster_offset": [between(-0.01, 0.01) for _ in range(6)],
    }
    return Scenario.load("push_wall", overrides, law)


MOVED = 1e-15
"""Displacement of the start for the differences of MuJoCo from itself [m]."""


def differences(scenario: Scenario) -> Mapping[str, Any]:
    """Of a run with each engine: the statuses, whether the law chatters, and the differences.

    Of a law that chatters, also the differences of a run in MuJoCo from a start that is :data:`MOVED`.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ours, theirs = (simulate(scenario, engine=engine) for engine in ("free_body", "mujoco"))
    found: dict[str, Any] = {"status": f"{ours.status.name}/{theirs.status.name}"}
    if found["status"] != "completed/completed":
        return found
    found["chatters"] = bool(theirs.tau_step_max[-1, :3].max() > CHATTERS)
    found["position_m"] = float(np.abs(ours.p_WB - theirs.p_WB).max())
    if found["chatters"]:
        found |= _from_itself(scenario, theirs)
    found["touches"] = f"{ours.touches[-1]:g}/{theirs.touches[-1]:g}"
    peak, their_peak = ours.force_peak[-1], theirs.force_peak[-1]
    if their_peak > 0.0:
        found["peak"] = float(abs(peak - their_peak) / their_peak)
    force, their_force = ours.final_impulse[-1] / FINAL_WINDOW_S, theirs.final_impulse[-1] / FINAL_WINDOW_S
    if ours.final_high[-1] - ours.final_low[-1] <= AT_REST * force and their_force > 0.0:
        found["rest"] = float(abs(force - their_force) / force)
        found["unrest"] = float((theirs.final_high[-1] - theirs.final_low[-1]) / force)
    return found


def _from_itself(scenario: Scenario, trace: Trace) -> Mapping[str, float]:
    x, y, z = scenario.initial.position
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        moved = simulate(scenario.updated({"initial.position": [x, y + MOVED, z]}))
    found = {"its_position_m": float(np.abs(moved.p_WB - trace.p_WB).max())}
    peak = trace.force_peak[-1]
    return found | ({"its_peak": float(abs(moved.force_peak[-1] - peak) / peak)} if peak else {})


@click.command(help=__doc__)
@click.option("--runs", default=200, show_default=True)
@click.option("--seed", default=12, show_default=True)
@click.option("--duration", default=20.0, show_default=True, help="Simulated time of each run [s].")
def main(runs: int, seed: int, duration: float) -> None:
    found = []
    for i in range(runs):
        scenario = drawn(np.random.default_rng([seed, i]), duration)
        result, law = differences(scenario), scenario.controller.label()
        found.append((i, law, result))
        click.echo(f"{i:4d} {law:10s} " + "  ".join(f"{name} {_shown(value)}" for name, value in result.items()))
    for chatters in (False, True):
        those = [each for each in found if each[2].get("chatters") == chatters]
        click.echo(f"{len(those)} runs of laws that {'chatter' if chatters else 'do not chatter'}")
        for name in ("position_m", "its_position_m", "peak", "its_peak", "rest", "unrest"):
            values = [(result[name], i, law) for i, law, result in those if name in result]
            if values:
                largest = ", ".join(f"{value:.2e} ({law}, run {i})" for value, i, law in sorted(values)[:-6:-1])
                median = statistics.median(value for value, *_ in values)
                click.echo(f"  {name}: {len(values)} runs, median {median:.2e}, largest {largest}")


def _shown(value: Any) -> str:
    return f"{value:.1e}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
