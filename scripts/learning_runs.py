"""The runs of docs/evidence/learning.md: five seeds of examples/learn_push.py, and their policies beside GSTA and PD.

python scripts/learning_runs.py FOLDER    learns for minutes a seed, and writes docs/evidence/learning/*.csv

A policy that is in FOLDER already is not learned again.
"""

import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import pandas as pd

from uvms_mj import Study
from uvms_mj.files import tables_of

ROOT = Path(__file__).parents[1]
EXAMPLES, DATA = ROOT / "examples", ROOT / "docs/evidence/learning"
SEEDS = range(5)
FAMILIES: dict[str, dict[str, Any]] = {
    "as it learned": {},
    "another force": {"reference.target": [1.05, 0.0, 0.0]},
    "all laws at 100 Hz": {"controller.period": 0.01},
}
"""What differs from learned_walls.toml."""
KEPT = {
    "wall.stiffness": "stiffness_N_per_m",
    "current.speed": "current_m_per_s",
    "status": "status",
    "force_range_N": "range_N",
    "force_error_N": "error_N",
    "contact.final_N": "final_N",
    "contact.peak_N": "peak_N",
    "contact.touches": "touches",
    "saturated_s": "saturated_s",
}


def policies(folder: Path) -> list[Path]:
    """The five policies, which are learned one after another on all cores."""
    made = []
    for seed in SEEDS:
        file, curve = folder / f"learned_{seed}.py", folder / f"curve_{seed}.csv"
        made.append(file)
        if not (file.exists() and curve.exists()):
            command = [sys.executable, str(EXAMPLES / "learn_push.py"), "--seed", str(seed), "--out", str(file)]
            subprocess.run([*command, "--curve", str(curve)], check=True)
    return made


def compared(folder: Path, files: list[Path]) -> pd.DataFrame:
    """The runs of all laws on the same draws."""
    tables, found = tables_of(EXAMPLES / "learned_walls.toml", "study"), []
    laws = [{"name": "gsta"}, {"name": f"{EXAMPLES / 'pd.py'}:Pd", "label": "PD"}]
    laws += [{"name": f"{file}:LearnedPush", "label": f"policy {k}"} for k, file in zip(SEEDS, files, strict=True)]
    for family, overrides in FAMILIES.items():
        base = {**tables["base"], **overrides}
        runs = 200 if family == "as it learned" else 60
        given = {**tables, "laws": laws, "base": base, "design": {**tables["design"], "runs": runs}}
        study = Study.from_dict(given).run(folder / family.replace(" ", "_"))
        found.append(study.frame.assign(family=family)[["family", "law", "draw", *KEPT]])
    return pd.concat(found).rename(columns=KEPT)


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
def main(folder: Path) -> None:
    """Learn, run and keep the numbers."""
    folder.mkdir(parents=True, exist_ok=True)
    files = policies(folder)
    DATA.mkdir(exist_ok=True)
    curves = pd.concat([pd.read_csv(folder / f"curve_{seed}.csv") for seed in SEEDS])
    curves.to_csv(DATA / "curves.csv", index=False)
    compared(folder, files).to_csv(DATA / "runs.csv", index=False, float_format="%.5g")


if __name__ == "__main__":
    main()
