"""The page of the language names what the compiler has, and nothing else."""

import builtins
import math
import re

import numpy as np

from page_numbers import page
from uvms_mj.compiler.builtin import FUNCTIONS, METHODS, PROPERTIES
from uvms_mj.compiler.expressions import FORMS

PAGE = page("language").read_text()
_TABLE = PAGE[PAGE.index("## Functions") : PAGE.index("`np.empty` is zero")]
_CODE = re.compile(r"`([^`]*)`")
_NAMES = {
    row.split("|")[1].strip(): re.findall(r"[\w.]+", " ".join(_CODE.findall(row.split("|")[2])))
    for row in _TABLE.splitlines()
    if row.startswith("| ") and "`" in row
}
_LOOPS = {"range", "enumerate", "zip", "reversed", "map"}  # of statements
_TAKES = {"out", "axis", "keepdims", "math"}


def test_every_function_on_the_page_is_in_the_language():
    for row, names in _NAMES.items():
        for name in set(names) - _TAKES - _LOOPS:
            if row == "Python":
                assert getattr(builtins, name) in FUNCTIONS | FORMS, name
            elif row == "`math`":
                assert getattr(math, name) in FUNCTIONS, name
            else:
                known = np
                for part in name.split("."):
                    known = getattr(known, part, None)
                assert known in FUNCTIONS or name in METHODS, name


def test_every_function_of_the_language_is_on_the_page():
    words = {name.rpartition(".")[2] for names in _NAMES.values() for name in names}
    for function in FUNCTIONS:
        if getattr(function, "__module__", "") not in ("uvms_mj.compiler.libm", "uvms_mj.compiler.library"):
            assert getattr(function, "__name__", function) in words | {"bool", "absolute"}, function
    assert set(METHODS) <= words
    assert all(f".{name}" in PAGE for name in PROPERTIES)
