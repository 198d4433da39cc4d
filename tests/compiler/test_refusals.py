"""What is refused before a run, and what ends a function at run time: always with file and line."""

import linecache
import math

import numpy as np
import pytest

from compiled import Compiled
from uvms_mj.compiler.refusals import CONVERSION, DIVISION, INDEX, RAISED, Lacking, Mistake
from uvms_mj.compiler.unit import Unit, translate

GAINS = np.dtype([("k", "f8"), ("three", "f8", (3,))], align=True)
GIVEN = np.dtype([("n", "i8"), ("x", "f8", (6,)), ("zeta", "f8", (6,)), ("A", "f8", (6, 6))], align=True)
OUT = np.dtype(("f8", (6,)))
READONLY = {0: "a gain is constant", 1: "signals can only be read"}
SHARED = np.zeros(3)
NAMES = ["a", "b"]


def unlike_shapes(g, s, out):
    out[:] = s.x[:3] + s.zeta


def unlike_store(g, s, out):
    out[:3] = s.x


def unlike_product(g, s, out):
    out[:] = s.A @ g.three


def unknown_field(g, s, out):
    out[:] = s.zta


def unknown_name(g, s, out):
    out[0] = gainz.k  # noqa: F821  # undefined on purpose


def unknown_function(g, s, out):
    out[:] = np.linalg.nrm(s.x)


def store_in_gain(g, s, out):
    g.k = 1.0


def store_in_signal(g, s, out):
    s.x[0] = 1.0


def store_in_view(g, s, out):
    x = s.x[1:]
    x += 1.0


def store_by_helper(g, s, out):
    change(s.x)


def change(x):
    x[0] = 1.0


def store_by_out(g, s, out):
    np.add(out, 1.0, out=s.x)


def another_type(g, s, out):
    x = s.x
    if g.k > 0.0:
        x = 1.0
    out[:] = x


def unset(g, s, out):
    if g.k > 0.0:
        x = 1.0
    out[0] = x


def unset_after_loop(g, s, out):
    for i in range(s.n):
        x = s.x[i]
    out[0] = x


def beyond(g, s, out):
    out[6] = 1.0


def before(g, s, out):
    out[0] = s.x[-7]


def too_many_indices(g, s, out):
    out[0] = s.x[0, 0]


def truth_of_array(g, s, out):
    if s.x > 0.0:
        out[0] = 1.0


def unlike_unpacking(g, s, out):
    a, b = s.x
    out[0] = a + b


def wrong_call(g, s, out):
    change(s.x, 1.0)


def wrong_reshape(g, s, out):
    out[:] = s.A.reshape(5, 7)[0]


def unlike_returns(g, s, out):
    out[:] = two_shapes(s.x, g.k)


def two_shapes(x, k):
    if k > 0.0:
        return x
    return x[:3]


def not_square(g, s, out):
    out[0] = np.linalg.det(s.A[:3])


MISTAKES = [
    (unlike_shapes, 1, r"arrays of shapes \(3,\) and \(6,\) do not fit together"),
    (unlike_store, 1, r"an array of shape \(6,\) does not fit into one of shape \(3,\)"),
    (unlike_product, 1, r"arrays of shapes \(6, 6\) and \(3,\) do not fit in a matrix product"),
    (unknown_field, 1, "s has no 'zta'; did you mean 'zeta'?"),
    (unknown_name, 1, "gainz is not defined"),
    (unknown_function, 1, "np.linalg has no 'nrm'"),
    (store_in_gain, 1, "a gain is constant"),
    (store_in_signal, 1, "signals can only be read"),
    (store_in_view, 2, "signals can only be read"),
    (store_by_helper, 1, "signals can only be read"),
    (store_by_out, 1, "signals can only be read"),
    (another_type, 3, r"x is a float here, and an array of shape \(6,\) before"),
    (unset, 3, "x may have no value here"),
    (unset_after_loop, 3, "x may have no value here"),
    (beyond, 1, "index 6 is out of bounds for size 6"),
    (before, 1, "index -7 is out of bounds for size 6"),
    (too_many_indices, 1, r"an array of shape \(6,\) has 1 index"),
    (truth_of_array, 1, r"is neither true nor false; use .any\(\) or .all\(\)"),
    (unlike_unpacking, 1, "6 values can't be unpacked into 2 names"),
    (wrong_call, 1, "change: too many positional arguments"),
    (wrong_reshape, 1, r"an array of 36 numbers can't have shape \(5, 7\)"),
    (unlike_returns, 1, "it is an array"),
    (not_square, 1, r"a square matrix is needed here, not shape \(3, 6\)"),
]


@pytest.mark.parametrize(("function", "line", "reason"), MISTAKES, ids=lambda case: getattr(case, "__name__", None))
def test_a_mistake_is_refused_with_its_line_and_its_words(function, line, reason):
    with pytest.raises(Mistake, match=reason) as caught:
        translate(Unit("wrong", checked=True), function, [GAINS, GIVEN, OUT], "wrong", READONLY)
    if function not in (store_by_helper, unlike_returns):  # in the helper's line
        assert caught.value.words == linecache.getline(__file__, caught.value.line).strip()
        assert caught.value.line == function.__code__.co_firstlineno + line
    assert caught.value.file == __file__


def recursive(n):
    return n if n <= 0 else recursive(n - 1)


def calls_itself(g, s, out):
    out[0] = recursive(s.n)


def unknown_length(g, s, out):
    x = np.zeros(s.n)
    out[0] = x.sum()


def unknown_bounds(g, s, out):
    out[0] = s.x[: s.n].sum()


def comprehends(g, s, out):
    out[:] = np.array([x for x in s.x])


def tries(g, s, out):
    try:
        out[0] = 1.0
    except ValueError:
        pass


def prints(g, s, out):
    print(out[0])


def uses_list(g, s, out):
    x = [1.0, 2.0]
    out[0] = x[0]


def uses_names(g, s, out):
    out[0] = len(NAMES)


def keeps_globally(g, s, out):
    SHARED[0] = 1.0


def needs_much(g, s, out):
    x = np.zeros((1000, 1000))
    out[0] = x[0, 0]


def has_lambda(g, s, out):
    f = lambda x: x  # noqa: E731
    out[0] = f(1.0)


def picks(g, s, out):
    out[0] = s.x[[0, 1]].sum()


def floats_index(g, s, out):
    n = 0
    n = n + 0.5
    for i in range(2):
        out[i] = n


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        (calls_itself, "recursive calls itself; write a loop"),
        (unknown_length, "the shape of an array must be known when compiling"),
        (unknown_bounds, "the bounds of a slice must be known when compiling"),
        (comprehends, "the language has no list comprehension; write a loop"),
        (tries, "the language has no try"),
        (prints, "the language has no print"),
        (uses_list, r"a list is not an array; write np.array\(\[...\]\)"),
        (uses_names, "a list is not a number"),
        (keeps_globally, "keep what changes in a state or a memory"),
        (needs_much, "more than 256 kB"),
        (has_lambda, "the language has no lambda; write a function with def"),
    ],
    ids=lambda case: getattr(case, "__name__", None),
)
def test_what_the_language_lacks_is_said_with_what_to_write(function, reason):
    with pytest.raises(Lacking, match=reason) as caught:
        translate(Unit("lacking", checked=True), function, [GAINS, GIVEN, OUT], "lacking", READONLY)
    assert caught.value.file == __file__


def index(g, s, out):
    out[0] = 1.0
    out[s.n] = 2.0


def index_in_helper(g, s, out):
    put(out, s.n)


def put(x, i):
    x[i] = 1.0


def row(g, s, out):
    out[:] = s.A[s.n]


def while_index(g, s, out):
    k = 0
    while k < s.n + 1:
        out[k] = 1.0
        k += 1


def division(g, s, out):
    out[0] = 7 // (s.n - 6)


def conversion(g, s, out):
    out[0] = int(math.inf * s.n)


def raises(g, s, out):
    if s.n == 6:
        raise ValueError(f"too large: {s.n}")


def asserts(g, s, out):
    assert s.n != 6, "six"


def singular(g, s, out):
    out[:] = np.linalg.solve(s.A * 0.0, s.x)


@pytest.mark.parametrize(
    ("function", "line", "why"),
    [
        (index, 2, INDEX),
        (index_in_helper, None, INDEX),
        (row, 1, INDEX),
        (while_index, 3, INDEX),
        (division, 1, DIVISION),
        (conversion, 1, CONVERSION),
        (raises, 2, RAISED),
        (asserts, 1, RAISED),
        (singular, 1, RAISED),
    ],
    ids=lambda case: getattr(case, "__name__", None),
)
def test_a_failed_check_ends_the_function_with_its_place_and_writes_nowhere_else(function, line, why):
    code = Compiled(function, [GAINS, GIVEN, OUT])
    gains, given, memory = np.zeros(1, GAINS), np.zeros(1, GIVEN), np.full(18, -1.0)
    given["n"] = 6
    found = code.place(code(gains, given, memory[6:12]))
    expected = (put if function is index_in_helper else function).__code__.co_firstlineno + (line or 1)
    assert found == (why, __file__, expected)
    assert (memory[:6] == -1.0).all()
    assert (memory[12:] == -1.0).all()


@pytest.mark.parametrize("n", [-6, -1, 0, 5])
def test_an_index_counts_from_either_end(n):
    code, given, out = Compiled(index, [GAINS, GIVEN, OUT]), np.zeros(1, GIVEN), np.zeros(6)
    given["n"] = n
    assert code(np.zeros(1, GAINS), given, out) == 0
    assert out[n] == 2.0


def test_a_trusted_kernel_has_no_checks():
    text = Compiled(index, [GAINS, GIVEN, OUT], checked=False).text
    assert "icmp ult" not in text


def test_a_number_that_changes_from_integer_to_float_is_a_float():
    code, out = Compiled(floats_index, [GAINS, GIVEN, OUT]), np.zeros(6)
    assert code(np.zeros(1, GAINS), np.zeros(1, GIVEN), out) == 0
    assert out[:3].tolist() == [0.5, 0.5, 0.0]
