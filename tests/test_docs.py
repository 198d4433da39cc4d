"""The guides show the examples as they are, and agree with the program."""

import re
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

from draw_rooms import AFTER, BEFORE, BETWEEN, CHAIN, SUBJECTS, floors
from page_numbers import page
from uvms_mj.engine.native.pipeline import INSTANT
from uvms_mj.scenario import STAGE_LISTS, STAGES

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
GUIDES = "".join(path.read_text() for path in sorted((ROOT / "docs" / "how_to").glob("*.md")))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
GENERATED = {"bench_tasks", "commands", "environment", "keys", "metrics", "signals", "stages", "study_keys", "topics"}
"""Pages of docs/reference that are written from the tables of the program when the site is built."""


LINKED = {"ardusub_sender.py", "learn_push.py", "learned_push.py", "ppo.py"}
"""Examples that are too long to be shown."""


@pytest.mark.parametrize(
    "path", sorted(path for path in EXAMPLES.glob("*.py") if path.name not in LINKED), ids=lambda path: path.name
)
def test_examples_are_shown_as_they_are(path):
    """From the imports to the command line: the docstring of the file is text of the guide."""
    code = path.read_text().split('"""\n\n', 1)[1].partition("\n\nif __name__")[0].strip()
    assert code in GUIDES


def test_every_example_is_in_a_guide():
    assert [path.name for path in EXAMPLES.iterdir() if path.is_file() and path.name not in GUIDES] == []


def test_the_drawing_has_the_rooms_of_the_import_contract():
    rooms = [room for floor in floors() for room in floor]
    assert sorted(rooms) == sorted(SUBJECTS)
    package = {path.stem for path in (ROOT / "src" / "uvms_mj").iterdir() if path.suffix in ("", ".py")}
    assert set(rooms) == package - {"__init__", "__main__", "scenarios", "__pycache__", "py.typed"}


@pytest.mark.parametrize("picture", sorted((ROOT / "docs").rglob("*.svg")), ids=lambda path: path.name)
def test_a_drawing_is_small(picture):
    assert picture.stat().st_size <= 100_000


def test_the_drawing_of_an_instant_has_the_stages_of_the_table_in_their_order():
    table = page("architecture").read_text().split("| stage | table | in a run |")[1].split("\n\n")[0]
    drawn = [BEFORE[0]]
    for stage, *_ in CHAIN:
        drawn += [stage, *(name for name, *_ in reversed(BETWEEN.get(stage, [])))]
    drawn.append(AFTER[0])
    assert re.findall(r"^\| ([a-z]+) \|", table, re.MULTILINE) == [name for box in drawn for name in box.split(", ")]
    picture = page("architecture").with_name("instant.svg").read_text()
    assert all(f">{name}</text>" in picture for name in drawn)


def test_the_table_of_stages_on_the_page_is_that_of_the_loop():
    table = page("architecture").read_text().split("| stage | table | in a run |")[1].split("\n\n")[0]
    shown = [tuple(cell.strip() for cell in row.split("|")[1:4]) for row in table.splitlines()[2:]]
    written = {name: f"`[{name}]`" for name in (*STAGES, "task")} | {name: f"`{name}`" for name in STAGE_LISTS}
    assert shown == [(each.term or each.name, written.get(each.name, ""), each.when) for each in INSTANT]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    written = {ROOT / "docs" / "reference" / f"{name}.md" for name in GENERATED}
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", path.read_text()):
        place = (path.parent / target).resolve()
        assert place.exists() or place in written, target
    for target, name in re.findall(r"\]\((?!https?:)([^)#]+\.py)#(?!L\d)([^)]+)\)", path.read_text()):
        last, text = name.rpartition(".")[2], (path.parent / target).read_text()
        assert re.search(rf"^\s*(def|class) {last}\b|^{last}\b.* = ", text, re.M), f"{target} defines no {name}"


@pytest.mark.parametrize("path", sorted((ROOT / "docs" / "physics").glob("*.md")), ids=lambda path: path.name)
def test_an_equation_is_no_block_of_code(path):
    """Each block says its language; an equation stands between dollars."""
    tokens = MarkdownIt().parse(path.read_text())
    assert [token.content for token in tokens if token.type == "code_block"] == []
    assert [token.content for token in tokens if token.type == "fence" and not token.info] == []


@pytest.mark.parametrize("path", sorted((ROOT / "docs" / "how_to").glob("*.md")), ids=lambda path: path.name)
def test_a_task_fits_on_a_page(path):
    assert len(path.read_text().splitlines()) <= 120


@pytest.mark.parametrize(
    "path",
    [*sorted(ROOT.glob("*.md")), *(path for path in PAGES[1:] if path.stem not in GENERATED)],
    ids=lambda path: path.name,
)
def test_a_line_has_at_most_140_characters(path):
    """But for tables, blocks of code and addresses."""
    lines = path.read_text().splitlines()
    for token in MarkdownIt().enable("table").parse(path.read_text()):
        if token.type in ("fence", "code_block", "table_open"):
            lines[slice(*token.map)] = [""] * (token.map[1] - token.map[0])
    assert [line for line in lines if len(re.sub(r"https?://\S+", "", line)) > 140] == []
