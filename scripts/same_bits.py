"""All signals of default runs, saved before a change and compared after it, bit for bit.

    python scripts/same_bits.py save /tmp/before           about ten seconds
    python scripts/same_bits.py compare /tmp/before        exit status 1 if a signal differs

The runs are the shipped scenarios, every law in both engines, and the stages of a real vehicle. New signals are no
difference.
"""

import sys
from pathlib import Path
from typing import Any

import click
import numpy as np

from uvms_mj import Scenario, Trace, simulate
from uvms_mj.control import BUILT_IN
from uvms_mj.files import shipped
from uvms_mj.setup.world import vehicles_of

SOFT = {"wall.stiffness": 2e3, "simulation.duration": 8.0}
RUNS: dict[str, tuple[str, dict[str, Any], str]] = (
    {
        name: (name, {"simulation.duration": 8.0}, "mujoco")
        for name in sorted(shipped("scenarios"))
        if not vehicles_of(name)
    }
    | {
        f"{law}, mujoco": ("push_wall", {"controller.name": law, "simulation.duration": 8.0}, "mujoco")
        for law in BUILT_IN
    }
    | {f"{law}, free_body": ("push_wall", {"controller.name": law}, "free_body") for law in BUILT_IN}
    | {
        "ekf": ("push_wall", SOFT | {"navigation.name": "ekf"}, "mujoco"),
        "observer": ("push_wall", SOFT | {"observer.name": "momentum_observer", "current.speed": 0.0}, "mujoco"),
        "t200": ("push_wall", SOFT | {"vehicle.model": "bluerov2_heavy", "thrusters.name": "t200"}, "mujoco"),
        "late": ("push_wall", SOFT | {"controller.period": 0.01, "controller.delay": 0.005}, "mujoco"),
    }
)
"""Scenario, overrides and engine of each run by its name."""


def run(name: str) -> Trace:
    scenario, overrides, engine = RUNS[name]
    return simulate(Scenario.load(scenario, overrides), engine=engine)


@click.group(help=__doc__)
def main() -> None:
    pass


@main.command()
@click.argument("folder", type=click.Path(path_type=Path))
def save(folder: Path) -> None:
    """Save the signals of all runs in FOLDER."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in RUNS:
        trace = run(name)
        np.savez(folder / f"{name}.npz", allow_pickle=False, **{signal: trace[signal] for signal in trace})
        click.echo(f"{name}: {len(trace)} rows")


@main.command()
@click.argument("folder", type=click.Path(path_type=Path, exists=True))
def compare(folder: Path) -> None:
    """Compare the signals of all runs with the signals in FOLDER."""
    differs = False
    for name in RUNS:
        if not (saved := folder / f"{name}.npz").exists():
            click.echo(f"{name}: was not saved")  # a scenario that is new
            continue
        trace, before = run(name), np.load(saved)
        apart = [
            signal
            for signal in before
            if signal not in trace.arrays or trace[signal].tobytes() != before[signal].tobytes()
        ]
        differs |= bool(apart)
        click.echo(f"{name}: {f'differs in {chr(44).join(apart)}' if apart else 'equal'}")
    sys.exit(differs)


if __name__ == "__main__":
    import warnings

    warnings.simplefilter("ignore")  # each run says what it says in the tests
    main()
