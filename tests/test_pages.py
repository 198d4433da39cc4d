"""Each block of Start, How to and README runs, in the order of its page, in an empty folder.

Lines of ``sh`` are commands and must succeed; ``python`` runs in one namespace a page; a block whose first line is a
comment with the name of a file is written as that file, too. Blocks without a language, or of ``text``, are output. A
comment above a block that a reader doesn't see, ``<!-- not run: REASON -->``, leaves it out, and
``<!-- refused: REASON -->`` says that its commands end with exit status 2. Commands of :data:`NOT_RUN` are left out,
and :func:`shortened` shortens runs.
"""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner
from markdown_it import MarkdownIt

from uvms_mj.cli import main
from uvms_mj.engine.simulation import ENGINES

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *(page for part in ("start", "how_to") for page in sorted(ROOT.glob(f"docs/{part}/*.md")))]
_LEARNING = ("gymnasium", "dm_control")
EXTRAS = {
    "learn": _LEARNING,
    "learn_and_judge": (*_LEARNING, "moviepy"),
    "learn_by_hand": _LEARNING,
    "tune": ("optuna",),
    "video": ("imageio_ffmpeg",),
}
"""Modules of the extras that a page needs."""
FILE = re.compile(r"(?:#|<!--) ([\w.]+\.(?:py|toml|xml|sdf|csv))\b")
MARK = re.compile(r"<!-- (not run|refused): ")
NOT_RUN = {
    r"(make|pip|git|dask|apt-get)\b": "sets up a computer or a cluster",
    r"uvms-mj .*--(viewer|live|web|scheduler)\b": "opens a window, or needs a cluster",
    r"uvms-mj replay (?!.*--save)": "opens a window",
    r"uvms-mj (paper|practicality)\b": "takes minutes; tests/reproduce",
    r"(uvms-mj sitl|ardusub)\b": "waits for an autopilot; tests/engine",
    r"uvms-mj validate\b": "needs the records of the pool; tests/reproduce",
}


def shortened(words: list[str]) -> list[str]:
    """The arguments of a command, with what makes it short unless the page says otherwise: few steps, or those up to a
    contact where the page uses the log; few draws and trials with the fast engine. A benchmark has two trials, even if
    the page asks for more."""
    match words:
        case [_, "--from", name, *_] if name.endswith(".zip"):
            more = []  # it is repeated as it was
        case ["run", *_]:
            used = "--out" in words and "--log-rate" not in words
            more = ["simulation.duration=6.1"] if used else ["simulation.duration=0.02"]
            more += ["--log-rate=100"] if used and "--from" not in words else []
        case ["converge" | "certify", *_]:
            more = ["simulation.duration=0.02"]
        case ["study", name, *_] if name not in ("report", "list", "plot", "table"):
            more = ["design.runs=3", "simulation.duration=6.1", "--engine=free_body", "--workers=1"]
        case ["tune", *_]:
            more = ["design.runs=2", "--trials=2", "--workers=1"]
        case ["bench", first, *_] if first not in ("compare", "tasks", "plot", "table"):
            more = ["--at-most=1", "--tasks=two_bumpers", "--workers=1"]
            words = [("2" if before == "--tune" else word) for before, word in zip(["", *words], words, strict=False)]
        case ["video", *_]:
            more = ["--size=320x180"]
        case _:
            more = []
    return [*words, *(each for each in more if not any(word.startswith(each.partition("=")[0]) for word in words))]


def blocks(page: Path) -> Iterator[tuple[str, str, str]]:
    """Mark, language and text of each block."""
    mark = ""
    for token in MarkdownIt().parse(page.read_text()):
        if token.type == "fence":
            yield mark, token.info, token.content
        found = MARK.match(token.content) if token.type == "html_block" else None
        mark = found[1] if found else ""


def run(line: str, status: int) -> None:
    """Run a command, by the shell if it needs one."""
    line = re.split(r"\s+#\s", line)[0]
    if any(re.match(pattern, line) for pattern in NOT_RUN):
        return
    if line.startswith("uvms-mj ") and not re.search("[|<>$&;]", line):
        with pytest.MonkeyPatch.context() as patch:
            patch.setitem(ENGINES, "mujoco", ENGINES["fast"])  # see conftest.py
            done = CliRunner().invoke(main, shortened(shlex.split(line)[1:]))
        ended, output = done.exit_code, done.output
        assert "plain Python" not in output, f"{line}: a page's own code must compile"
    else:
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        shell = subprocess.run(["bash", "-c", line], env=os.environ | {"PATH": path}, capture_output=True, text=True)
        ended, output = shell.returncode, shell.stdout + shell.stderr
    assert ended == status, f"{line}\n{output}"


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("page", PAGES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_each_block_of_a_page_runs(page, tmp_path, monkeypatch):
    for module in EXTRAS.get(page.stem, ()):
        pytest.importorskip(module, reason="needs an extra")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    names = {"__name__": "__main__"}
    for mark, language, text in blocks(page):
        if mark == "not run" or language.startswith("{"):
            continue
        if language == "sh":
            for line in text.replace("\\\n", " ").splitlines():
                if line and not line.startswith("#"):
                    run(line, 2 if mark == "refused" else 0)
            continue
        if name := FILE.match(text):
            Path(name[1]).write_text(text)
        if language == "python":
            exec(compile(text, page.name, "exec"), names)
        else:
            assert name or language in ("", "text"), f"is not run, is no file and has no mark:\n{text}"
