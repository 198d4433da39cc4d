"""Random programs of the language.

They have names that stand for one array, arrays that change in place and are bound again in loops, branches, helpers
that return their arguments or new arrays, slices, and numbers that overflow.
"""

import random

import numpy as np

GIVEN = np.dtype([("k", "f8"), ("n", "i8"), ("x", "f8", (4,)), ("A", "f8", (4, 4))], align=True)
OUT = np.dtype([("a", "f8", (4,)), ("b", "f8", (4,)), ("A", "f8", (4, 4)), ("s", "f8", (4,))], align=True)
HELPERS = """import numpy as np

def larger(x, y):
    if x[0] > y[0]:
        return x
    return y

def same(x):
    return x

def doubled(x, by=2.0):
    return x * by

def raised(x):
    x += 1.0
    return x

def parts(x):
    return x[:2], x[2:] + 1.0, x.sum()

"""


class Writer:
    """Writes a program with choices of a random generator."""

    def __init__(self, choose: random.Random) -> None:
        self.choose, self.lines, self.depth, self.counters = choose, list[str](), 1, 0

    def program(self) -> str:
        self.line("u, v, w = g.x.copy(), g.x * 2.0, o.a")
        self.line("M = g.A * 0.5")
        self.line("s, t, i = g.k, 1.0, 0")
        self.block(self.choose.randint(3, 9))
        self.line("o.b[:] = u + v * 0.5 + w")
        self.line("o.A[:] += M")
        self.line("o.s[:] = np.array([s, t, u[i % 4], v.max()])")
        return HELPERS + "def program(g, o):\n" + "\n".join(self.lines) + "\n"

    def line(self, text: str) -> None:
        self.lines.append("    " * self.depth + text)

    def block(self, n: int) -> None:
        for _ in range(n):
            nested = [self.branch, self.loop, self.while_loop] if self.depth < 4 else []
            self.choose.choice([self.statement] * 5 + nested)()

    def inner(self) -> None:
        self.depth += 1
        self.block(self.choose.randint(1, 3))
        self.depth -= 1

    def number(self) -> str:
        return self.choose.choice(
            ["s", "t", "g.k", "2.5", "-0.5", "u[0]", "v[-1]", "M[1, 2]", "g.x[i % 4]", "u.sum()", "v.min()", "float(i)"]
        )

    def vector(self) -> str:
        one, two = self.choose.choice("uvw"), self.choose.choice(["u", "v", "w", "g.x", "M[0]", "M[:, 1]", "g.A[2]"])
        return self.choose.choice(
            [
                f"{one} + {two}",
                f"{one} * {self.number()}",
                f"{one} - {two} / 3.0",
                f"np.where({one} > {two}, {one}, -{two})",
                f"np.clip({one}, -1.0, {self.number()})",
                f"np.abs({two})",
                f"np.maximum({one}, {two}) // 0.7",
                f"{two}[::-1] % 1.3",
                f"({one} + {two})[::-1]",
                f"same({one} - 1.0)",
                f"np.array([{one}, {two} * 2.0]).T[:, 1]",
                f"doubled({one}, by={self.number()})",
                f"np.concatenate(({one}[2:], {two}[:2]))",
            ]
        )

    def statement(self) -> None:
        one, two = self.choose.choice("uvw"), self.choose.choice("uvw")
        self.line(
            self.choose.choice(
                [
                    f"{one} = {self.vector()}",
                    f"{one} = {self.vector()}",
                    f"{one} = {two}",
                    f"{one} = larger({two}, {one})",
                    f"{one} = larger({two}, {one} + 1.0)",
                    f"{one} = {two}.copy()",
                    f"{one}, {two} = {two}, {one}",
                    f"{one} += {self.number()}",
                    f"{one}[1:3] = {self.number()}",
                    f"{one}[:2] = {two}[2:]",
                    f"{one}[{one} > 1.0] = {self.number()}",
                    f"raised({one})",
                    f"s = {self.number()} + {self.number()} * t",
                    f"t = {self.number()} - s if s < {self.number()} else t + 1",
                    f"M[1] = {self.vector()}",
                    f"M[:, 2] += {two}",
                    f"M = M.T * {self.number()}",
                    f"i = (i * 3 + {self.choose.randint(0, 7)}) % 11",
                    f"head, tail, t = parts({one})\n{'    ' * self.depth}s = head[0] + tail[1]",
                ]
            )
        )

    def branch(self) -> None:
        self.line(f"if {self.number()} > {self.number()} and i % 2 == {self.choose.randint(0, 1)}:")
        self.inner()
        if self.choose.random() < 0.5:
            self.line("else:")
            self.inner()

    def loop(self) -> None:
        self.counters += 1
        name = f"j{self.counters}"
        over = self.choose.choice(
            [
                f"{name} in range({self.choose.randint(0, 4)})",
                f"{name} in range(i % 3)",
                f"{name}, x{name} in enumerate(v)",
            ]
        )
        self.line(f"for {over}:")
        self.inner()
        self.depth += 1
        if self.choose.random() < 0.4:
            self.line(f"if s > {self.number()}:")
            self.line(f"    {self.choose.choice(['break', 'continue'])}")
        self.line(f"t = t + {name}")
        if self.choose.random() < 0.3:
            self.line(f"u[{name} % 4 : {name} % 4 + 1] += 1.0" if "range(i" not in over else "pass")
        self.depth -= 1

    def while_loop(self) -> None:
        self.counters += 1
        name = f"k{self.counters}"
        self.line(f"{name} = 0")
        self.line(f"while {name} < {self.choose.randint(1, 3)}:")
        self.inner()
        self.depth += 1
        self.line(f"{name} += 1")
        self.depth -= 1


__all__ = ["GIVEN", "OUT", "Writer"]
