"""What is refused before a run, and what ends a function at run time: always with file and line."""

import linecache

import numpy as np
import pytest

from compiled import Compiled, function_of
from uvms_mj.compiler.refusals import CONVERSION, DIVISION, INDEX, RAISED, Lacking, Mistake
from uvms_mj.compiler.unit import Unit, translate

GAINS = np.dtype([("k", "f8"), ("three", "f8", (3,))], align=True)
GIVEN = np.dtype([("n", "i8"), ("x", "f8", (6,)), ("zeta", "f8", (6,)), ("A", "f8", (6, 6))], align=True)
KINDS = [GAINS, GIVEN, np.dtype(("f8", (6,)))]
READONLY = {0: "a gain is constant", 1: "signals can only be read"}
SHARED = np.zeros(3)
NAMES = ["a", "b"]
GROWN = [1.0]
TABLE = {"a": 1.0}


def change(x):
    x[0] = 1.0


def grow():
    GROWN.append(2.0)


def fill(key):
    TABLE[key] = 2.0


def kept(x):
    return x[0]


def put(x, i):
    x[i] = 1.0


def two_shapes(x, k):
    if k > 0.0:
        return x
    return x[:3]


def larger(x, y):
    if x[0] > y[0]:
        return x
    return y * 1.0


def picked(x, y):
    return x if x[0] > y[0] else y


def recursive(n):
    return n if n <= 0 else recursive(n - 1)


def law(body):
    return function_of("g, s, out", body, globals())


def refused(body):
    with pytest.raises((Mistake, Lacking)) as caught:
        translate(Unit("wrong", checked=True), law(body), KINDS, "wrong", READONLY)
    return caught.value


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("out[:] = s.x[:3] + s.zeta", "arrays of shapes (3,) and (6,) do not fit together"),
        ("out[:3] = s.x", "an array of shape (6,) does not fit into one of shape (3,)"),
        ("out[:] = s.A @ g.three", "arrays of shapes (6, 6) and (3,) do not fit in a matrix product"),
        ("out[:] = s.zta", "s has no 'zta'; did you mean 'zeta'?"),
        ("out[0] = gainz.k", "gainz is not defined"),
        ("out[:] = np.linalg.nrm(s.x)", "np.linalg has no 'nrm'"),
        ("g.k = 1.0", "a gain is constant"),
        ("s.x[0] = 1.0", "signals can only be read"),
        ("x = s.x[1:]\nx += 1.0", "signals can only be read"),
        ("np.add(out, 1.0, out=s.x)", "signals can only be read"),
        ("if g.k > 0.0:\n    x = 1.0\nout[0] = x", "x may have no value here"),
        ("for i in range(s.n):\n    x = s.x[i]\nout[0] = x", "x may have no value here"),
        ("out[6] = 1.0", "index 6 is out of bounds for size 6"),
        ("out[0] = s.x[-7]", "index -7 is out of bounds for size 6"),
        ("out[0] = s.x[0, 0]", "an array of shape (6,) has 1 index"),
        ("if s.x > 0.0: out[0] = 1.0", "is neither true nor false; use .any() or .all()"),
        ("a, b = s.x", "6 values can't be unpacked into 2 names"),
        ("change(s.x, 1.0)", "change: too many positional arguments"),
        ("out[:] = np.sum(s.A, 0, axis=1)", "argument axis is given twice"),
        ("out[:] = s.A.reshape(5, 7)[0]", "cannot reshape array of size 36 into shape (5,7)"),
        ("out[0] = np.linalg.det(s.A[:3])", "a square matrix is needed here, not shape (3, 6)"),
        ("out[0] = np.concatenate((s.A, s.A[:, :3])).sum()", "can't be joined along axis 0"),
    ],
)
def test_a_mistake_is_refused_with_its_line_and_its_words(body, reason):
    found = refused(body)
    assert isinstance(found, Mistake)
    assert reason in found.reason
    assert found.words == body.splitlines()[-1].strip()
    assert found.words == linecache.getline(found.file, found.line).strip()


@pytest.mark.parametrize(
    ("body", "reason", "words"),
    [
        ("change(s.x)", "signals can only be read", "x[0] = 1.0"),
        ("out[:] = two_shapes(s.x, g.k)", "it is an array", None),
        ("out[0] = recursive(s.n)", "recursive calls itself; write a loop", None),
    ],
)
def test_what_a_helper_does_wrong_is_in_the_helpers_line(body, reason, words):
    found = refused(body)
    assert found.file == __file__
    assert reason in found.reason
    assert words in (None, found.words)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("x = np.zeros(s.n)", "the shape of an array must be known when compiling"),
        ("out[0] = s.x[: s.n].sum()", "the bounds of a slice must be known when compiling"),
        ("x = [a for a in s.x if a > 0.0]", "how many values a comprehension has must be known when compiling"),
        ("out[0] = GROWN[0]", "GROWN changes in line"),
        ("out[0] = TABLE['a']", "TABLE changes in line"),
        ("x = [1.0, 2.0]\ny = x\nx[0] = 3.0", "something else holds it, too, in 'y = x'"),
        ("x = [1.0]\nout[0] = kept(x)\nx.append(2.0)", "something else holds it, too, in 'kept(x)'"),
        ("x = NAMES\nx.append(2.0)", "x is changed in place here, and is no list of this function"),
        ("a = 1.0\nf = lambda x: a * x\na = 2.0\nout[0] = f(1.0)", "a is bound more than once"),
        ("n = 0.0\ndef add():\n    nonlocal n\n    n += 1.0\nadd()\nout[0] = n", "a function does not bind a name of"),
        ("m = 'go' if g.k > 0.0 else 'stop'", "it is the text 'go' or the text 'stop'"),
        ("out[0] = {'a': 1.0, 'b': 2.0}['a' if g.k > 0.0 else 'b']", "it is the text 'a' or the text 'b'"),
        ("out[0] = isinstance(s.n, int)", "a number of Python or of NumPy is not known"),
        ("try:\n    out[0] = 1.0\nfinally:\n    pass", "the language has no finally, and no try within another one"),
        ("SHARED[0] = 1.0", "keep it in a state or a memory"),
        ("x = out[:3]\nif g.k > 0.0:\n    x = out[::2]\nx[0] = 1.0", "x has its numbers in another order here"),
        ("x = s.x\nif g.k > 0.0:\n    x = 1.0", "x is a float here, and an array of shape (6,) before"),
        ("out[:] = np.sqrt()", "argument x is missing"),
        ("out[:] = np.where(s.x, s.x)", "write np.where(condition, x, y)"),
        ("out[:] = np.sin(s.x, out, 3)", "it takes at most 2 arguments here, not 3"),
        ("x = np.zeros((1000, 1000))", "more than 256 kB"),
        ("out[0] = np.sum(s.x, where=s.x)", "the language has no argument where here"),
    ],
)
def test_what_the_language_lacks_is_said_with_what_to_write(body, reason):
    found = refused(body)
    assert isinstance(found, Lacking)
    assert reason in found.reason
    assert linecache.getline(found.file, found.line).strip() in body


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("out[0] = 1.0\nout[s.n] = 2.0", INDEX),
        ("put(out, s.n)", INDEX),
        ("out[:] = s.A[s.n]", INDEX),
        ("k = -1\nwhile k < s.n:\n    k += 1\n    out[k] = 1.0", INDEX),
        ("out[0] = 7 // (s.n - 6)", DIVISION),
        ("out[0] = int(np.inf * s.n)", CONVERSION),
        ("if s.n == 6:\n    raise ValueError(f'too large: {s.n}')", RAISED),
        ("assert s.n != 6, 'six'", RAISED),
        ("out[:] = np.linalg.solve(s.A * 0.0, s.x)", RAISED),
        ("out[:1] = np.linalg.cholesky(s.A[:1, :1] - 1.0)[0]", RAISED),
    ],
)
def test_a_failed_check_ends_the_function_with_its_place_and_writes_nowhere_else(body, why):
    code = Compiled(law(body), KINDS)
    gains, given, memory = np.zeros(1, GAINS), np.zeros(1, GIVEN), np.full(18, -1.0)
    given["n"] = 6
    found, file, line = code.place(code(gains, given, memory[6:12]))
    assert found == why
    assert linecache.getline(file, line).strip() == ("x[i] = 1.0" if "put" in body else body.splitlines()[-1].strip())
    assert (memory[:6] == -1.0).all()
    assert (memory[12:] == -1.0).all()


@pytest.mark.parametrize("n", [-6, -1, 0, 5])
def test_an_index_counts_from_either_end(n):
    code, given, out = Compiled(law("out[s.n] = 2.0"), KINDS), np.zeros(1, GIVEN), np.zeros(6)
    given["n"] = n
    assert code(np.zeros(1, GAINS), given, out) == 0
    assert out[n] == 2.0


def test_a_trusted_kernel_has_no_checks():
    assert "icmp ult" in Compiled(law("out[s.n] = 2.0"), KINDS).text
    assert "icmp ult" not in Compiled(law("out[s.n] = 2.0"), KINDS, checked=False).text


@pytest.mark.parametrize("n", [1, 2, 3, 6])
@pytest.mark.parametrize(
    ("body", "wrong"),
    [
        ("out[:] = np.linalg.solve(A, b)", np.ones),
        ("out[:] = np.linalg.inv(A) @ b", np.ones),
        ("out[:] = np.linalg.solve(np.linalg.cholesky(A), b)", lambda shape: np.diag([1.0] * (shape[0] - 1) + [-1.0])),
    ],
)
def test_a_kernel_solves_equations_and_has_nan_where_a_users_stage_raises(body, wrong, n, rng):
    """Where the matrix is singular, or not positive definite, all of a kernel's result is NaN; else it is NumPy's."""
    function = function_of("A, b, out", body, globals())
    kinds = [np.dtype(("f8", (n, n))), *[np.dtype(("f8", (n,)))] * 2]
    kernel, checked = Compiled(function, kinds, checked=False), Compiled(function, kinds)
    X, b, out, exact = rng.normal(size=(n, n)), rng.normal(size=n), np.zeros(n), np.zeros(n)
    A = X @ X.T + np.eye(n)
    kernel(A, b, out)
    function(A, b, exact)
    np.testing.assert_allclose(out, exact, rtol=1e-12)
    A = wrong((n, n)) if n > 1 else wrong((1, 1)) - np.ones((1, 1))
    assert checked.place(checked(A, b, out))[0] == RAISED
    with pytest.raises(np.linalg.LinAlgError):
        function(A, b, out)
    kernel(A, b, out)
    assert np.isnan(out).all()


def test_a_kernel_of_a_raise_is_refused():
    with pytest.raises(Lacking, match=r"kernels do not raise; np.linalg has solve, inv and cholesky"):
        Compiled(law("raise ValueError"), KINDS, checked=False)


def test_a_number_that_changes_from_integer_to_float_is_a_float():
    body = "n = 0\nn = n + 0.5\nfor i in range(2):\n    out[i] = n"
    code, out = Compiled(law(body), KINDS), np.zeros(6)
    assert code(np.zeros(1, GAINS), np.zeros(1, GIVEN), out) == 0
    assert out[:3].tolist() == [0.5, 0.5, 0.0]
