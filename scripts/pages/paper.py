"""docs/evidence/paper.md: the certificate; and, from the folder of `uvms-mj paper --out FOLDER`, the numbers of the
claims and the picture of the figures."""

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from click.testing import CliRunner

from page_look import DOCS
from uvms_mj.cli import main as command


def numbers(folder: str = "") -> Iterator[tuple]:
    found = json.loads(CliRunner().invoke(command, ["certify", "--json"]).output)
    yield (
        "changes at less than ${} + {}\\, \\lvert s \\rvert$ m/s³",
        found["certified"]["rate"],
        found["certified"]["state"],
    )
    yield "current's Munk moment changes at {} rad/s³", max(found["experienced"]["rate"])
    k_1, k_2 = re.findall(r"k_1 = (\S+) and k_2 = (\S+) are certified", found["verdict"])[0]
    yield "$k_1$ = {} and $k_2$ = {} would be certified", float(k_1), float(k_2)
    if folder:
        yield from of_the_paper(Path(folder))


def of_the_paper(folder: Path) -> Iterator[tuple]:
    claims = {each["id"]: each for each in json.loads((folder / "claims.json").read_text())}
    ours = {name: each["ours"] for name, each in claims.items()}

    def within(name: str) -> list[float]:
        return [float(each) for each in re.findall(r"[\d.]+", claims[name]["detail"])]

    yield "| impedance control stops short of the wall | {} mm", ours["impedance-short"]
    yield "GSTA: {} N, impedance error {} N", ours["gsta-force"], ours["gsta-impedance"]
    yield "{} N, $s$ below {} $\\epsilon$ at all times", ours["fosm-force"], ours["fosm-well-inside"]
    yield "| {} and {} N from step to step", ours["fosm-epsilon"], ours["fosm-gain"]
    yield "20 % too small: {} N", ours["gsta-model-errors"]
    yield "within {} s, with a quarter of the time step as well", within("gsta-finite-time")[0]
    yield "holds within {} % of the contact force", ours["gsta-compliant"]
    yield (
        "{} times the effort; largest step of thrust {} times",
        ours["gsta-similar-effort"],
        ours["gsta-smaller-steps"],
    )
    yield "| {} times: a ripple of", ours["gsta-whole-variation"]
    yield "| {} % apart (rms), z {} times as large", ours["alone-actuation"], ours["alone-integral"]
    yield "The report has all {} rows", len(claims)


def main(folder: str = "") -> None:
    if folder:
        shutil.copyfile(Path(folder, "overview.png"), DOCS / "evidence" / "paper.png")
