"""Vehicles in programs of PythonVehicleSimulator's and MSS's structure: the vehicle of the table, and not executed."""

import re

import numpy as np
import pytest

from descriptions import (
    D_LINEAR,
    D_QUADRATIC,
    DENSITY,
    DISPLACED,
    INERTIA,
    M_A,
    MASS,
    NED,
    R_B,
    R_G,
    read,
    same,
    table,
)
from uvms_mj.errors import InputError
from uvms_mj.plant.coefficients import DERIVATIVES

G = 9.81
A = NED[:, None] * M_A * NED
I_G = NED[:3, None] * INERTIA * NED[:3]


def numbers(values):
    return ", ".join(repr(float(each)) for each in values)


def rows(matrix, separator="; "):
    return separator.join(" ".join(repr(float(each)) for each in row) for row in matrix)


def derivatives(name, matrix, prefix="", end="\n"):
    """Xudot = -6.0 and so on, of the entries that are not zero."""
    found = (-(NED[:, None] * matrix * NED)).round(15)
    return "".join(
        f"{prefix}{bare.replace('_', '')} = {float(found[i, j])!r}{end}"
        for (i, j), bare in np.ndenumerate(DERIVATIVES[name])
        if found[i, j] or (i == j and name == "M_A")
    )


def python(extra=""):
    """A class whose constructor has expressions, names and NumPy, in the way of the published ones."""
    off = ", ".join(f"[{numbers(row)}]" for row in I_G - np.diag(np.diag(I_G)))
    body = f"""
rho = {DENSITY}
g = {G}
self.half = 0.6 / 2
if self.half > 0.0:
    controls = "step"
else:
    controls = "none"
m = {MASS!r}
self.W = m * g
self.B = rho * g * (2 * self.half * 0.4 * 10**-1)
self.r_bg = np.array([{numbers(NED[:3] * R_G)}], float)
self.r_bb = np.array([{numbers(NED[:3] * R_B)}], dtype=float)
self.Ig = np.diag([{numbers(np.diag(I_G))}]) + np.array([{off}])
{derivatives("M_A", M_A)}{derivatives("D_linear", D_LINEAR, "self.")}{derivatives("D_quadratic", D_QUADRATIC)}
self.ratio = math.sqrt(2) * math.pi
self.Minv = np.linalg.inv(np.zeros((6, 6)))
{extra}"""
    lines = "\n".join(f"        {line}" for line in body.splitlines())
    return f"""import math
import numpy as np

class fish:
    def __init__(self, r=0, V_c=0):
{lines}

    def dynamics(self, nu):
        m = 99
        self.W = 3.0
"""


def matlab(extra=""):
    """A function with matrices, continued lines, comments and branches, in the way of the published ones."""
    damping = derivatives("D_linear", D_LINEAR, end="; ") + derivatives("D_quadratic", D_QUADRATIC, end=";\n")
    return f"""function [xdot,U] = fish(x,ui)
% m = 5; a comment with an = sign, and it's quoted
if nargin == 0, x = zeros(12,1); end
if (length(ui) ~= 3), error('ui = 3; must have dimension 3!'); end
u = x(1); v = x(2);
g = {G};  rho = {DENSITY};
W = {MASS!r} * g;  mass = W / g;    % mass = 7 here
volume = 0.6 * 0.4 ...   m = 3
    * 0.1;
r_bg = [{rows([NED[:3] * R_G])}]';
xB = {float(NED[0] * R_B[0])!r}; yB = {float(NED[1] * R_B[1])!r}; zB = {float(NED[2] * R_B[2])!r};
Ix = {float(I_G[0, 0])!r}; Iy = {float(I_G[1, 1])!r}; Iz = {float(I_G[2, 2])!r};
Ixy = {float(-I_G[0, 1])!r}; Ixz = {float(-I_G[0, 2])!r}; Iyz = {float(-I_G[1, 2])!r};
I_g = [ Ix -Ixy -Ixz   % a row by its line
       -Ixy  Iy -Iyz
       -Ixz -Iyz  Iz ];
A11 = [{rows(A[:3, :3])}]; A12 = [{rows(A[:3, 3:])}];
T = diag( [1 1 1 2 2 2] );
MA = [A11 A12; A12' [{rows(A[3:, 3:])}]];
Ti = diag([1 1 1 .5 .5 .5]); MA = -(-2^2/4) * Ti*T * MA * T*Ti;
{damping}
for i = 1:3
    tau(i) = u + v;
end
{extra}
xdot = [ cos(u); sin(v) ];
function m = other(x)
mass = 4;
"""


@pytest.fixture
def by_table(tmp_path):
    return read(tmp_path, ".toml", table("ned", "derivatives", {}))


@pytest.mark.parametrize(
    ("suffix", "text"), [(".py", python()), (".m", matlab()), (".m", matlab().replace("I_g = [", "moments = ["))]
)
def test_a_program_is_the_vehicle_of_the_table(tmp_path, by_table, suffix, text):
    record, vehicle = read(tmp_path, suffix, text, thrusters=by_table[0].thrusters)
    same(by_table[1], vehicle)
    assert vehicle.displaced_mass == pytest.approx(DISPLACED, rel=1e-12)
    assert any("forward, right, down about CO" in each for each in record.left_out)


def test_what_is_not_read_is_said(tmp_path, by_table):
    said = read(tmp_path, ".py", python(), thrusters=by_table[0].thrusters)[0].left_out
    unread = next(each for each in said if each.endswith("no plain number or matrix"))
    unplaced = next(each for each in said if each.endswith("no place here"))
    assert {"self.Minv", "controls", "r", "V_c"} <= {*re.split(r"[,:] ", unread)}
    assert {"self.ratio"} == {*re.split(r"[,:] ", unplaced)} - {"a number for which there is no place here"}
    assert any(re.match(r"line \d+: not executed", each) for each in said)


@pytest.mark.parametrize("value", ["np.diag([0, 0, 1e4, 20, 30, 0])", "restoring(self)"])
def test_the_restoring_of_a_surface_vessel_is_said(tmp_path, by_table, value):
    text = python(f"self.G = {value}\nG33 = 1e4")
    said = read(tmp_path, ".py", text, thrusters=by_table[0].thrusters)[0].left_out
    (restoring,) = (each for each in said if "the restoring G of a surface vessel" in each)
    assert {"self.G", "G33"} <= {*re.split(r"[,:] ", restoring)}


def test_derivatives_in_other_units_than_the_matrix_are_not_read(tmp_path, by_table):
    text = matlab(derivatives("M_A", M_A / 500.0))
    record = read(tmp_path, ".m", text, thrusters=by_table[0].thrusters)[0]
    np.testing.assert_allclose(record.base.M_A, M_A, rtol=0, atol=1e-12)
    assert not record.base.D_linear.any()
    assert any("other units than MA" in each for each in record.left_out)


HOSTILE = {
    "a call": "m = os.system('touch executed')",
    "an import": "m = __import__('os').getpid()",
    "eval": "m = eval('7')",
    "a huge power": "m = 9**9**9**9",
    "a negative root": "m = math.sqrt(-1)",
    "a loop": "for k in range(3):\n    m = m + 1",
    "a loop without an end": "while True:\n    m = 1",
    "a branch": "if g > 9: m = 2.0",
    "an addition": "m += 1",
    "two names": "m, n = 3.0, 4.0",
    "a walrus": "print(m := 3.0)",
    "a deletion": "del m",
    "a comprehension": "m = sum([1 for k in range(10**9)])",
    "another type": "m = np.array(3.5, dtype=int)",
    "an import of the name": "from other import m",
    "a long list": "m = [0] * 10**9",
    "many zeros": "m = np.eye(100000)",
    "nan": "m = 1e999 - 1e999",
    "an attribute": "m = np.__builtins__",
    "a conditional": "m = 3.0 if g else 4.0",
    "a long sum": "m = " + "+".join(["1"] * 20_000),
}
HOSTILE_MATLAB = {
    "a call": "mass = system('touch executed');",
    "eval": "mass = eval('7');",
    "a huge power": "mass = 9^9^9^9;",
    "a loop": "for k = 1:3, mass = mass + 1; end",
    "a branch": "if g > 9\n mass = 2;\nend",
    "a branch of one line": "if (g > 9) mass = 2; end",
    "several": "[mass, n] = deal(3, 4);",
    "an entry": "mass(2) = 3;",
    "a power of a matrix": "mass = [1 2; 3 4]^2;",
    "text": "mass = '3';",
    "no end": "mass = ((((",
    "entries without end": "mass(1)" + "=mass(1)" * 10_000 + ";",
    "rows without end": "mass = [1" + "\n" * 90_000,
    "remarks without end": "mass = x;\n" + "%{\n" * 30_000,
    "deep": "mass = " + "(" * 20_000 + "1" + ")" * 20_000 + ";",
}


@pytest.mark.parametrize(
    ("suffix", "text"),
    [(".py", python(each)) for each in HOSTILE.values()] + [(".m", matlab(each)) for each in HOSTILE_MATLAB.values()],
    ids=[*HOSTILE, *(f"{each}, MATLAB" for each in HOSTILE_MATLAB)],
)
def test_nothing_of_a_program_is_executed_or_guessed(tmp_path, monkeypatch, by_table, suffix, text):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"\b(m|mass): is no plain number|is not Python"):
        read(tmp_path, suffix, text, thrusters=by_table[0].thrusters)
    assert not (tmp_path / "executed").exists()


def test_an_entry_that_is_changed_by_another_name_is_lost(tmp_path):
    with pytest.raises(InputError, match=r"self\.r_bg: is no plain number"):
        read(tmp_path, ".py", python("other = self.r_bg\nother[0] = 5.0"))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (f" m = {MASS!r}", " k = 1", "the mass"),
        ("self.r_bb", "self.other", "lacks the centre of buoyancy"),
        ("self.Ig", "self.other", "lacks the inertia"),
        ("Zwdot", "Zother", "lacks Zwdot"),
        (
            " self.W = m * g",
            " self.W = m * g + 1.0; self.mass = 22.0",
            "mass and m and m_total: differ in the file, 22 and 21",
        ),
        ("self.B = rho * g", "self.B = rho * 0.01", "B is no buoyancy"),
    ],
)
def test_missing_and_contradicting_numbers_are_listed(tmp_path, old, new, said):
    assert old in python()
    with pytest.raises(InputError) as error:
        read(tmp_path, ".py", python().replace(old, new))
    assert said in str(error.value)
    assert "copy its numbers into a table" in str(error.value)


def test_dimensionless_derivatives_are_refused(tmp_path):
    small = python().replace(derivatives("M_A", M_A).splitlines()[0], "")
    text = small + "\n"
    for line in derivatives("M_A", M_A).splitlines():
        text = text.replace(line, line.replace("= ", "= 1e-4 * "))
    text = text.replace("Yvdot", "Xudot = -1e-3; Yvdot", 1)
    with pytest.raises(InputError, match="are they dimensionless"):
        read(tmp_path, ".py", text)


@pytest.mark.parametrize("name", ["Python", "MATLAB"])
def test_a_program_that_is_too_long_is_refused(tmp_path, name):
    suffix, text = {"Python": (".py", "m = 1\n"), "MATLAB": (".m", "m = 1;\n")}[name]
    with pytest.raises(InputError, match="is longer than"):
        read(tmp_path, suffix, text * 60_000)


def test_a_script_has_no_number_of_a_function_in_it_and_a_function_none_of_the_script(tmp_path, by_table):
    """MATLAB's functions in a script have names of their own: neither half is a vehicle."""
    text = matlab()
    head = text.index("\n") + 1
    middle = text.index("\n", len(text) // 2) + 1
    for name, parts in {"after": (text[head:middle], text[middle:]), "all": ("", text[head:])}.items():
        script = parts[0] + "function tau = other(nu)\n" + parts[1]
        if name == "all":  # a function alone is a vehicle, whatever it is called
            read(tmp_path, ".m", script, thrusters=by_table[0].thrusters)
            script = "t_end = 10;\n" + script
        with pytest.raises(InputError, match="lacks"):
            read(tmp_path, ".m", script, thrusters=by_table[0].thrusters)
