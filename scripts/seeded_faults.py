"""Which tests catch the faults of seeded_faults.toml: each is put into a copy of the checkout, and the tests are run.

    python scripts/seeded_faults.py                              every fault, the whole suite, up to the first failure
    python scripts/seeded_faults.py --only froude_krylov_sign    some of them
    python scripts/seeded_faults.py --near                       first the tests of the fault's room, then the rest
    python scripts/seeded_faults.py tests/physics -m bits        some tests; what follows is given to pytest

It prints a table with the test that failed first, and the seconds until then. A fault that no test catches asks for a
law that would.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

import click

ROOT = Path(__file__).parents[1]
_OF_THE_CHECKOUT = (
    "--deselect=tests/test_house.py::test_every_seeded_fault_can_be_put_into_the_sources",
    "--deselect=tests/test_site.py::test_the_site",
)
"""Tests that fail in any copy with a fault: one looks for the sound text, the other one asks git."""
_FAILED = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", re.MULTILINE)


@dataclass(frozen=True)
class SeededFault:
    """A fault: in a file, the text ``old``, which occurs once, becomes ``new``."""

    name: str
    kind: str
    file: str
    old: str
    new: str

    def place(self, root: Path = ROOT) -> Path:
        """The file. Raises ValueError unless it is there and has the text exactly once."""
        path = root / self.file
        if not path.is_file():
            found = [
                str(each.relative_to(root))
                for each in (root / "src").rglob("*.py")
                if self.old in each.read_text("utf-8")
            ]
            raise ValueError(f"{self.name}: {self.file} has gone; its text is in {', '.join(found) or 'no file'}")
        if (n := path.read_text("utf-8").count(self.old)) != 1:
            raise ValueError(f"{self.name}: {self.file} has its text {n} times")
        return path


def seeded_faults() -> list[SeededFault]:
    """All faults of the list."""
    return [SeededFault(**each) for each in tomllib.loads(Path(__file__).with_suffix(".toml").read_text())["fault"]]


def near(path: Path, root: Path) -> list[str]:
    """The tests of a file's room, and the tests that name its module."""
    room = path.relative_to(root / "src" / "uvms_mj").parts[0].removesuffix(".py")
    dotted = ".".join(path.relative_to(root / "src").with_suffix("").parts)
    own = [f"tests/{room}"] if (root / "tests" / room).is_dir() else []
    named = [
        str(each.relative_to(root)) for each in sorted((root / "tests").rglob("test_*.py"))
        if each.parent.name != room and dotted in each.read_text("utf-8")
    ]  # fmt: skip
    return [*own, *named]


def outcome(root: Path, arguments: list[str]) -> str:
    """The first test that fails in a checkout; empty if none does."""
    environment = os.environ | {"PYTHONPATH": str(root / "src"), "PYTHONDONTWRITEBYTECODE": "1"}
    environment |= {"UVMS_MJ_CACHE_DIR": str(root / ".machine-code")}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *_OF_THE_CHECKOUT, *arguments]
    run = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    if run.returncode in (0, 5):
        return ""
    found = _FAILED.search(run.stdout)
    return found[1] if found else f"pytest ended with {run.returncode}: {(run.stdout + run.stderr)[-200:]!r}"


@click.command(help=__doc__, context_settings={"ignore_unknown_options": True})
@click.option("--only", multiple=True, help="Names of faults; default: all.")
@click.option("--near", "nearest_first", is_flag=True, help="First the tests of the fault's room, then the others.")
@click.option("--of", "root", default=ROOT, type=click.Path(path_type=Path), help="Checkout; default: this one.")
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def main(only: tuple[str, ...], nearest_first: bool, root: Path, arguments: tuple[str, ...]) -> None:
    faults = [fault for fault in seeded_faults() if not only or fault.name in only]
    missed = 0
    with tempfile.TemporaryDirectory(prefix="uvms-mj-faults-") as folder:
        copy = Path(folder, "checkout")
        left_out = shutil.ignore_patterns(".git", ".venv", "_build", "__pycache__", "runs")
        shutil.copytree(root.resolve(), copy, ignore=left_out)
        for fault in faults:
            path = fault.place(copy)
            sound = path.read_text("utf-8")
            path.write_text(sound.replace(fault.old, fault.new), "utf-8")
            start, caught = time.monotonic(), ""
            if nearest_first and (first := near(path, copy)):
                caught = outcome(copy, [*first, *arguments])
            caught = caught or outcome(copy, list(arguments))
            path.write_text(sound, "utf-8")
            missed += not caught
            click.echo(f"{fault.name:36} {fault.kind:18} {time.monotonic() - start:6.0f} s  {caught or 'NOT CAUGHT'}")
    click.echo(f"{len(faults) - missed} of {len(faults)} faults caught")


if __name__ == "__main__":
    main()
