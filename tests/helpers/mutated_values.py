"""Random numbers, values and bytes, either new or mutated from valid ones."""

import random
from dataclasses import dataclass, field
from typing import Any

Random = random.Random


@dataclass(frozen=True)
class Case:
    """An input: files to write, and the arguments of ``uvms-mj``.

    Attributes:
        kind: key of the mutator in :data:`mutations.KINDS`, or forged for a forged log.
        arguments: of ``uvms-mj``.
        files: contents by name.
        original: the log before mutation; the rows read from the mutated log must agree with it.
    """

    kind: str
    arguments: tuple[str, ...]
    files: dict[str, bytes] = field(default_factory=dict)
    original: bytes | None = None


NUMBERS = (0.0, -0.0, 1.0, -1.0, 0.5, 1e-7, 1e-12, 1e-300, 5e-324, 1e3, 1e6, 1e9, 1e12, 1e13, 1e100, 1e200, 1e308)
SPECIAL = (float("nan"), float("inf"), float("-inf"), 2**53, 10**30, 10**400, True, False)
TEXTS = ("", "abc", "nan", "1e5", "gsta", "a" * 5000, "ß☃\u202e\u0000", "../../etc/passwd", "x.py:Law", "\x1b[31m", "/")


def number(rng: Random) -> Any:
    if rng.random() < 0.4:
        return rng.choice((-1.0, 1.0)) * 10.0 ** rng.uniform(-14.0, 14.0)
    if rng.random() < 0.3:
        return rng.choice(SPECIAL)
    return rng.choice((-1.0, 1.0)) * rng.choice(NUMBERS)


def value(rng: Random, depth: int = 0) -> Any:
    kind = rng.random()
    if kind < 0.5 or depth > 3:
        return number(rng)
    if kind < 0.65:
        return rng.choice(TEXTS)
    if kind < 0.7:
        return {rng.choice(("time", "position", "a", "")): value(rng, depth + 1) for _ in range(rng.randrange(3))}
    n = rng.choice((0, 1, 2, 3, 3, 4, 6, 6, 6, 7, 36, 500))
    if rng.random() < 0.5:
        return [number(rng)] * n
    return [value(rng, depth + 1) if rng.random() < 0.1 else number(rng) for _ in range(min(n, 40))]


def mild(rng: Random, original: Any) -> Any:
    """The original with small changes, which is often still valid."""
    if isinstance(original, bool):
        return not original
    if isinstance(original, int) and abs(original) > 10**300:  # beyond any float
        return -original
    if isinstance(original, int | float):
        return original * 10.0 ** rng.uniform(-3.0, 3.0) * rng.choice((1.0, 1.0, -1.0))
    if isinstance(original, list | tuple):
        return [mild(rng, each) if rng.random() < 0.5 else each for each in original]
    return original


_PLAIN = b'= [ ] [[ { } " """ \' # . , nan inf 1e999 - 0x 1979-05-27 true wall.'
TOKENS = (*_PLAIN.split(), b"\n", b"9" * 5000, b"[" * 2000, b"\xff", b"\x00", b"\xef\xbb\xbf", b"a." * 99)


def mutated_bytes(rng: Random, data: bytes, tokens: tuple[bytes, ...] = (b"\x00", b"\xff")) -> bytes:
    """Data with pieces deleted, repeated, swapped, inserted or flipped."""
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        i = rng.randrange(len(data) + 1)
        n = rng.choice((1, 1, 2, 4, 10, 40, 300))
        action = rng.randrange(6)
        if action == 0:
            data = data[:i] + data[i + n :]
        elif action == 1:
            data = data[:i] + data[i : i + n] + data[i:]
        elif action == 2:
            j = rng.randrange(len(data) + 1)
            data = data[:i] + data[j : j + n] + data[i:]
        elif action == 3:
            data = data[:i] + rng.choice(tokens) + data[i:]
        elif action == 4 and i < len(data):
            data = data[:i] + bytes([data[i] ^ (1 << rng.randrange(8))]) + data[i + 1 :]
        elif action == 5 and rng.random() < 0.3:
            data = data[:i]
    return data
