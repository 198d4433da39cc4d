"""README.md: the table of its run, the certificate, the push at the tool; and, from the folder of `uvms-mj paper --out
FOLDER`, what the paper's claims come to, with the picture of its figures."""

import functools
import json
import re
import shutil
import warnings
from collections.abc import Iterator
from pathlib import Path

from click.testing import CliRunner

from page_look import DOCS
from uvms_mj import Scenario, Trace, simulate
from uvms_mj.cli import main as command


@functools.cache
def run(name: str, law: str, engine: str = "mujoco") -> Trace:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return simulate(Scenario.load(name, controller=law), engine=engine)


def numbers(folder: str = "") -> Iterator[tuple]:
    trace = run("push_wall", "gsta", "free_body")
    yield "│ {} s ({} touches)", trace.first_contact[-1], trace.touches[-1]
    yield "│ peak force │ {} N", (trace.force_peak[-1], 0.02)
    yield "│ final force │ {} N (settled)", trace.final_impulse[-1] / 0.5
    yield "│ analytic force │ {} N", trace.analytic.force
    yield "│ largest tau │ {} {} {}", *((value, 1e-3 * value) for value in trace.tau_max[-1, :3])
    found = json.loads(CliRunner().invoke(command, ["certify", "--json"]).output)
    yield "changes at less than {} + {} |s| m/s³", found["certified"]["rate"], found["certified"]["state"]
    yield "current's Munk moment changes at {} rad/s³", max(found["experienced"]["rate"])
    k_1, k_2 = re.findall(r"k_1 = (\S+) and k_2 = (\S+) are certified", found["verdict"])[0]
    yield "k_1 = {} and k_2 = {} would be certified", float(k_1), float(k_2)
    for words, law in (("| GSTA, `tool_push` |", "gsta"), ("| first-order sliding mode |", "fosm")):
        tool = run("tool_push", law)
        middle = " | (x_d - x_c)/(n^T K_d^-1 n + 1/k_c) = {} N |" if law == "gsta" else " | {} N |"
        yield f"{words} {{}} N{middle}", tool.push[-1], tool.analytic.force
    tool = run("tool_push", "impedance")
    yield "| impedance control | {} N after 20 s | {} N |", tool.push[-1], tool.analytic.force
    if folder:
        yield from of_the_paper(Path(folder))


def of_the_paper(folder: Path) -> Iterator[tuple]:
    claims = {each["id"]: each for each in json.loads((folder / "claims.json").read_text())}
    ours = {name: each["ours"] for name, each in claims.items()}

    def within(name: str) -> list[float]:
        return [float(each) for each in re.findall(r"[\d.]+", claims[name]["detail"])]

    yield "| impedance control stops short of the wall | {} mm", ours["impedance-short"]
    yield "GSTA: {} N, impedance error {} N", ours["gsta-force"], ours["gsta-impedance"]
    yield "{} N, s below {} epsilon at all times", ours["fosm-force"], ours["fosm-well-inside"]
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
