"""Difference between the engines free_body and mujoco over random scenarios.

    python scripts/compare_engines.py                     200 scenarios of 20 s
    python scripts/compare_engines.py --runs 20 --seed 3

Each scenario is drawn with its own law, gains, wall, current, disturbance, friction, errors of the estimates and initial
state. For every run: the largest difference of the position at any sample, of the peak force and of the force at rest,
if both runs settle. The largest ones are printed with the scenario.
"""

import statistics
import warnings
from collections.abc import Mapping
from typing import Any

import click
import numpy as np

from uvms_mj import Scenario, Status, Trace, simulate
from uvms_mj.analysis.metrics import final_force

LAWS = ("gsta", "sta", "fosm", "impedance", "ideal")


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
        "simulation.integrator": ["euler", "implicitfast"][rng.integers(2)],
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
    }
    return Scenario.load("push_wall", overrides, law)


def differences(scenario: Scenario) -> Mapping[str, Any]:
    """Statuses of both runs; position [m] and, relative, peak and force at rest, where there are such."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ours, theirs = (simulate(scenario, engine=engine) for engine in ("free_body", "mujoco"))
    found: dict[str, Any] = {"status": (ours.status, theirs.status)}
    if found["status"] != (Status.completed, Status.completed):
        return found
    found["position_m"] = float(np.abs(ours.p_WB - theirs.p_WB).max())
    found["touches"] = int(ours.touches[-1]), int(theirs.touches[-1])
    if theirs.force_peak[-1] > 0.0:
        found["peak"] = _relative(ours.force_peak[-1], theirs.force_peak[-1])
    (force, settled), (their_force, their_settled) = _rest(ours), _rest(theirs)
    if settled and their_settled and their_force:
        found["rest"] = _relative(force, their_force)
    return found


def _rest(trace: Trace) -> tuple[float, bool]:
    force, settled = final_force(trace)
    return force or 0.0, settled


def _relative(a: float, b: float) -> float:
    return float(abs(a - b) / abs(b))


@click.command(help=__doc__)
@click.option("--runs", default=200, show_default=True)
@click.option("--seed", default=12, show_default=True)
@click.option("--duration", default=20.0, show_default=True, help="Simulated time of each run [s].")
def main(runs: int, seed: int, duration: float) -> None:
    found = []
    for i in range(runs):
        scenario = drawn(np.random.default_rng([seed, i]), duration)
        result = differences(scenario)
        found.append((i, scenario.controller.label(), result))
        click.echo(
            f"{i:4d} {scenario.controller.label():10s} " + "  ".join(f"{k} {_shown(v)}" for k, v in result.items())
        )
    for name in ("position_m", "peak", "rest"):
        values = [(result[name], i, law) for i, law, result in found if name in result]
        if values:
            click.echo(
                f"{name}: {len(values)} runs, median {statistics.median(v for v, *_ in values):.2e}, largest "
                + ", ".join(f"{value:.2e} ({law}, run {i})" for value, i, law in sorted(values)[:-6:-1])
            )


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.1e}"
    return "/".join(str(getattr(each, "name", each)) for each in value)


if __name__ == "__main__":
    main()
