"""The gallery: programs in docs/results and the examples, each with the figures that it leaves in its variables."""

import logging
import re
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from textwrap import indent
from typing import Any

from matplotlib.figure import Figure
from PIL.Image import Image
from sphinx_gallery.scrapers import figure_rst

from uvms_mj import InputError, Scenario, simulate
from uvms_mj.views.video import underwater

ORDER = (
    *(
        "three_laws",
        "stiffness_and_peak",
        "added_mass",
        "tool",
        "slide",
        "wipe",
        "hull",
        "pile",
        "together",
        "path",
        "gusts",
    ),
    "waves",
)
"""Programs that come first; the others follow by name."""
NOT_RUN = {
    "ardusub_sender.py": "needs an autopilot",
    "learn_push.py": "learns for minutes",
    "ppo.py": "learns for a minute",
    "udp_law.py": "answers another program until Ctrl-C",
}
"""Examples that the gallery shows and does not run, each with the reason."""
CARDS = {"ardusub_sender": "how_to/autopilot.png", "learn_push": "evidence/learning.png", "ppo": "how_to/ppo.png"}
"""Pictures, from docs, on the cards of examples that are not run."""
HEADING = """
Examples of the guides
----------------------

Stages of your own, loops of your own, environments. ``uvms-mj new example all`` writes the files.
"""


def copy_sources(docs: Path) -> None:
    """Put the programs of both folders below one, as Sphinx-Gallery wants them, where they are no part of the site.

    Without a driver that renders, their pictures of the scene are left out.
    """
    target = docs / "_build" / "gallery"
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(docs / "results", target)
    examples = target / "examples"
    examples.mkdir()
    (examples / "GALLERY_HEADER.rst").write_text(HEADING)
    for path in sorted((docs.parent / "examples").glob("*.py")):
        text = _titled(path.read_text())
        if path.name in NOT_RUN:
            text += f"# sphinx_gallery_thumbnail_path = {(CARDS.get(path.stem) or _udp_card(docs))!r}\n"
        (examples / path.name).write_text(text)
    if why_not := _undrawable():
        logging.getLogger(__name__).info("the gallery has no pictures of the scene: %s", why_not)
        for path in target.glob("*.py"):
            kept = [line for line in path.read_text().splitlines() if " = still(" not in line]
            path.write_text("\n".join(kept).replace(", still", "") + "\n")


def _udp_card(docs: Path) -> str:
    """Run against udp_law.py and draw its push. Returns the path of the picture from the folder of the pages."""
    picture = docs / "_build" / "udp_law.png"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    law = subprocess.Popen([sys.executable, docs.parent / "examples" / "udp_law.py", str(port)])
    try:
        settings = {"controller.name": "udp", "controller.port": port, "controller.period": 1e-3, "current.speed": 0.0}
        settings["simulation.duration"] = 10.0
        simulate(Scenario.load("push_wall", settings)).plot("force", width=6.5).savefig(picture, dpi=150)
    finally:
        law.terminate()
        law.wait()
    return str(picture.relative_to(docs))


def _undrawable() -> str:
    try:
        underwater.gl_context(16, 16).free()
    except InputError as error:
        return str(error)
    return ""


def _titled(program: str) -> str:
    """A program whose docstring has its first words as a title, sentences as they are, and its commands as blocks."""
    _, docstring, code = program.split('"""', 2)
    summary, *parts = docstring.strip().split("\n\n")
    title, text = re.split(r"[.:]\s*", summary, maxsplit=1)
    blocks = [
        each if each.endswith(".") else ".. code-block:: text\n\n    " + each.replace("\n", "\n    ") for each in parts
    ]
    return (
        '"""\n' + "\n\n".join([f"{title}\n{'=' * len(title)}", text[:1].upper() + text[1:], *blocks]) + f'\n"""{code}'
    )


def figures(block: Any, variables: dict[str, Any], settings: dict[str, Any]) -> str:
    """Save the new figures and pictures of the scene among the variables of a program; pyplot knows none of them."""
    found = [value for value in variables["example_globals"].values() if isinstance(value, Figure | Image)]
    saved = variables.setdefault("saved_figures", [])
    paths, scenes = [], []
    for figure in found:
        if not any(figure is each for each in saved):
            saved.append(figure)
            paths.append(next(variables["image_path_iterator"]))
            if isinstance(figure, Figure):
                figure.savefig(paths[-1], dpi=150)
            else:
                figure.save(paths[-1])
                scenes.append(Path(paths[-1]).name)
    text = figure_rst(paths, settings["src_dir"])
    if len(paths) == 1:  # in a box, which scrolls on a phone
        text = f"\n.. container:: plot\n{indent(text, '   ')}"
    for name in scenes:  # of a class of their own, which is seen whole on a phone
        text = re.sub(rf"({re.escape(name)}\n.*?:class: )\S+", r"\1scene", text, count=1, flags=re.DOTALL)
    return text


RUN = rf"\A(?!.*/({'|'.join(re.escape(name) for name in NOT_RUN)})$)"
"""A pattern of the paths of the programs that the gallery runs."""


class Order:
    """Order of the programs of a section."""

    def __init__(self, folder: str) -> None:
        self.folder = folder

    def __call__(self, name: str) -> tuple[int, str]:
        stem = Path(name).stem
        return (ORDER.index(stem) if stem in ORDER else len(ORDER), stem)
