"""Pages of results as data: links to all sections, texts escaped, numbers as numbers."""

from pages import HOSTILE, complete_by_itself
from uvms_mj.studies.pages import Cell, Group, Items, Page, Section, Table, Text, facts, keyed, marked, number, rendered

PARTS = [
    Text(HOSTILE, "soft"),
    Items([HOSTILE, Cell(HOSTILE, "holds")]),
    Table(HOSTILE, [HOSTILE], [(HOSTILE, [HOSTILE])], label=HOSTILE, caption=HOSTILE),
    facts([(HOSTILE, HOSTILE)]),
    Group([Text(marked("<b>{}</b>", HOSTILE)), Text(keyed("#000000", HOSTILE))], "keep"),
]


def texts(page: Page) -> list[str]:
    """The texts of a page, one by one."""
    return [text for text in map(str.strip, complete_by_itself(rendered(page)).text) if text]


def test_each_section_is_linked_by_its_title_or_its_shorter_name():
    sections = [Section("one", "First", [Text("a")]), Section("two", "A long second", [Text("b")], link="Second")]
    page = Page("A title", [Text("c", "lead")], sections)
    assert texts(page)[1:] == ["A title", "c", "First", "Second", "First", "a", "A long second", "b"]
    assert [link["href"] for link in complete_by_itself(rendered(page)).of("a")] == ["#one", "#two"]


def test_a_text_stands_on_the_page_as_it_is_in_any_part():
    for part in PARTS:
        text = rendered(Page("t", [], [Section("s", "s", [part])]))
        assert HOSTILE not in text
        assert HOSTILE in " ".join(complete_by_itself(text).text), part


def test_a_cell_that_is_a_number_has_its_digits_and_a_text_is_left_alone():
    table = Table("", ["n", "none", "text"], [("row", [12345.678, None, Cell("12000", "n")])])
    assert texts(Page("t", [], [Section("s", "s", [table])]))[-3:] == [number(12345.678), "–", "12000"]
    assert number(12345.678) == "1.235·10⁴"
