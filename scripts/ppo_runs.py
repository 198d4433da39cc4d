"""The runs of docs/how_to/learn_and_judge.md: three seeds of examples/ppo.py, and their success on blind episodes.

python scripts/ppo_runs.py FOLDER    learns for a minute a seed, and writes docs/evidence/learning/ppo*.csv

A policy that is in FOLDER already is not learned again.
"""

import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pandas as pd

ROOT = Path(__file__).parents[1]
EXAMPLES, DATA = ROOT / "examples", ROOT / "docs/evidence/learning"
SEEDS = range(3)


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
def main(folder: Path) -> None:
    """Learn, judge and keep the numbers: of each seed the curve, and how many blind episodes the last policy holds."""
    sys.path.insert(0, str(EXAMPLES))
    import ppo

    curves, rows = [], []
    for seed in SEEDS:
        out = folder / f"p{seed}"
        if not (out / "policy.npz").exists():
            command = [sys.executable, str(EXAMPLES / "ppo.py"), "--seed", str(seed), "--out", str(out)]
            subprocess.run(command, check=True)
        curves.append(pd.read_csv(out / "curve.csv").assign(seed=seed))
        share, *_ = ppo.judged(list(np.load(out / "policy.npz").values()), ppo.JUDGED)
        held = round(share * len(ppo.JUDGED))
        click.echo(f"seed {seed}: {held} of {len(ppo.JUDGED)} blind episodes end with success")
        rows.append({"seed": seed, "held": held, "judged": len(ppo.JUDGED), "looked": len(ppo.LOOKED)})
    pd.concat(curves).to_csv(DATA / "ppo_curves.csv", index=False, float_format="%.5g")
    pd.DataFrame(rows).to_csv(DATA / "ppo.csv", index=False)


if __name__ == "__main__":
    main()
