"""Numbers of the guides are those of the runs: each page's script computes them, and the page has them."""

import os

import pytest

from page_numbers import PAGES, corrected, faults, needs_folder, page, script

FOLDERS = {"validation": "UVMS_MJ_POOL_DATA"}
"""Environment variables with the folders of pages whose numbers come from data that are not in the repository."""


@pytest.mark.parametrize("name", sorted(path.stem for path in PAGES.glob("*.py")))
def test_numbers_of_a_page_are_those_of_its_runs(name):
    numbers, given = script(name).numbers, []
    if needs_folder(numbers):
        given = [os.environ.get(FOLDERS.get(name, ""), "")]
        if not given[0]:
            pytest.skip("its numbers come from a folder of long runs, and are written by draw_docs.py")
    assert faults(page(name).read_text(), numbers(*given)) == []


PAGE = "It pushes\nwith 1.49 N,\nwithin 2e-3 N; after 12 touches | 1.1e-5 |"


@pytest.mark.parametrize(
    ("sentence", "wrong"),
    [
        (("pushes with {} N", 1.494), None),
        (("pushes with {} N", 1.496), "It pushes\nwith 1.50 N"),
        (("within {} N;", 1e-3), None),
        (("within {} N;", -2.1e-3), "within 3e-3 N"),
        (("after {} touches", 12.4), None),
        (("after {} touches", (15, 3)), None),
        (("after {} touches", (16, 3)), "after 16 touches"),
        (("| {} |", 1.14e-5), None),
        (("| {} |", 2.26e-4), "| 2.3e-4 |"),
    ],
)
def test_a_number_is_right_to_its_last_digit_or_to_its_tolerance(sentence, wrong):
    assert bool(faults(PAGE, [sentence])) == bool(wrong)
    mended = corrected(PAGE, [sentence])
    assert (wrong or PAGE) in mended
    assert not faults(mended, [sentence])


@pytest.mark.parametrize("words", ["pulls with {} N", "{} N", "pushes with {} and {}"])
def test_a_sentence_that_is_not_once_in_the_page_is_an_error(words):
    with pytest.raises(ValueError, match=r"in the page|holes"):
        faults(PAGE, [(words, 1.0)])
