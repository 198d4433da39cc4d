"""Draws of the keys that vary: designs of points in the unit cube, and the quantile of each key's distribution.

Every design gives each entry of ``[[vary]]`` a number u from 0 to 1 a draw. A distribution has its quantile at u, and
one of n values is that with the index n u. In a random design each entry has a stream of its own, decided by the seed
and its keys: neither other entries nor the number of runs change its draws.
"""

import hashlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import Fault
from .places import parsed
from .study_file import DISTRIBUTIONS, Vary

MOST_DRAWS = 10_000_000


@dataclass(frozen=True)
class Variation:
    """One entry of ``[[vary]]``: keys that move together, with either levels or a distribution.

    Attributes:
        place: of the entry in the study file, ``vary[0]``.
        keys: dotted keys.
        laws: labels of the laws for which it varies; empty for all.
        levels: values or points of a grid, each with one value a key; empty for a distribution.
        grid: whether the levels are points of a grid.
        distribution: name in :data:`.study_file.DISTRIBUTIONS`, or empty.
        parameters: of the distribution, a dictionary for each key.
    """

    place: str
    keys: tuple[str, ...]
    laws: tuple[str, ...] = ()
    levels: tuple[tuple[Any, ...], ...] = ()
    grid: bool = False
    distribution: str = ""
    parameters: tuple[dict[str, float], ...] = ()

    def at(self, u: np.ndarray) -> list[list[Any]]:
        """Values of each key at the numbers u (n,) from 0 to 1."""
        if self.levels:
            chosen = np.minimum((u * len(self.levels)).astype(int), len(self.levels) - 1).tolist()
            return [[self.levels[i][k] for i in chosen] for k in range(len(self.keys))]
        return [quantile(self.distribution, u, **each).tolist() for each in self.parameters]

    def covers(self, law: str) -> bool:
        return not self.laws or law in self.laws

    def range(self) -> str:
        """The values as a short text."""
        if self.levels:
            shown = [each[0] if len(set(map(repr, each))) == 1 else list(each) for each in self.levels]
            texts = [f"{x:g}" if isinstance(x, float) else str(x) for x in shown]
            inner = texts if len(texts) <= 6 else [*texts[:2], "...", texts[-1]]
            return f"{len(texts)} values: {', '.join(inner)}"
        first = {name: [each[name] for each in self.parameters] for name in self.parameters[0]}
        given = {name: x[0] if len(set(x)) == 1 else x for name, x in first.items()}
        return f"{self.distribution} ({', '.join(f'{name} {x}' for name, x in given.items())})"


def quantile(distribution: str, u: np.ndarray, **parameters: float) -> np.ndarray:
    """Quantiles of a distribution at u, by its parameters low, high, mean, deviation."""
    low, high = parameters.get("low", -math.inf), parameters.get("high", math.inf)
    if distribution == "uniform":
        return np.clip(low + u * (high - low), low, high)
    if distribution == "loguniform":
        return np.clip(np.exp(np.log(low) + u * (np.log(high) - np.log(low))), low, high)
    from scipy import stats

    mean, deviation = parameters["mean"], parameters["deviation"]
    inside = np.clip(u, 1e-16, 1.0 - 1e-16)  # a normal distribution has no end
    if distribution == "normal":
        return stats.norm.ppf(inside, mean, deviation)
    a, b = (low - mean) / deviation, (high - mean) / deviation
    return np.clip(stats.truncnorm.ppf(inside, a, b, mean, deviation), low, high)


def variation(vary: Vary, place: str, faults: list[Fault]) -> Variation | None:
    """The variation of an entry of ``[[vary]]``. Every error is appended to ``faults``; then it is None."""
    found: list[Fault] = []
    if (vary.key is None) == (vary.keys is None) or vary.keys == []:
        found.append(Fault(place, 'give key = "wall.stiffness", or keys = [...] that move together'))
    keys = tuple(vary.keys or ()) if vary.key is None else (vary.key,)
    for i, key in enumerate(keys):
        where = f"{place}.key" if vary.keys is None else f"{place}.keys[{i}]"
        try:
            if parsed(key)[0] == "simulation.seed":
                found.append(Fault(where, "the study sets simulation.seed of each run; vary it by design.repeats"))
        except ValueError as error:
            found.append(Fault(where, str(error)))
    if vary.laws == []:
        found.append(Fault(f"{place}.laws", "is empty; leave it out for all laws"))
    n = max(1, len(keys))
    kind = _kind(vary, place, found)
    levels = _given(vary.values or [], n, place, found) if kind == "values" else ()
    parameters = _parameters(vary, n, kind, place, found)
    if found:
        faults += found
        return None
    if kind == "number":
        spaced = np.geomspace if vary.spacing == "log" else np.linspace
        columns = [spaced(each["low"], each["high"], vary.number or 2).tolist() for each in parameters]
        levels, parameters = tuple(zip(*columns, strict=True)), ()
    return Variation(place, keys, tuple(vary.laws or ()), levels, kind == "number", vary.distribution or "", parameters)


def _kind(vary: Vary, place: str, faults: list[Fault]) -> str:
    """Which of "values", "number" (a grid) and "distribution" is given; empty unless it is one."""
    kinds = [name for name in ("values", "number", "distribution") if getattr(vary, name) is not None]
    if len(kinds) != 1:
        what = f"has {' and '.join(kinds)}" if kinds else "says nothing of its values"
        faults.append(
            Fault(place, f"{what}; give values, or a grid (low, high, number), or a distribution (with low, high, ...)")
        )
        return ""
    allowed = {"values": (), "number": ("low", "high", "number", "spacing")}.get(kinds[0], ("distribution",))
    allowed = DISTRIBUTIONS[vary.distribution] if vary.distribution else allowed
    faults += [
        Fault(f"{place}.{name}", f"has no effect beside {kinds[0]}; leave it out")
        for name in ("low", "high", "number", "spacing", "mean", "deviation")
        if name not in allowed and getattr(vary, name) is not None
    ]
    return kinds[0]


def _given(values: list[Any], n: int, place: str, faults: list[Fault]) -> tuple[tuple[Any, ...], ...]:
    """Values, each as a tuple with one value a key. Numbers are floats, unless all are integers."""
    if not values:
        faults.append(Fault(f"{place}.values", "is empty"))
    rows = []
    for i, value in enumerate(values):
        if n == 1 or not isinstance(value, list | tuple):
            rows.append((value,) * n)
        elif len(value) != n:
            faults.append(Fault(f"{place}.values[{i}]", f"has {len(value)} values; {n} are needed, one a key"))
        else:
            rows.append(tuple(value))
    columns = [
        [float(x) for x in column] if {type(x) for x in column} == {int, float} else column
        for column in zip(*rows, strict=True)
    ]
    return tuple(zip(*columns, strict=True))


def _per_key(vary: Vary, name: str, n: int, place: str, faults: list[Fault]) -> list[float]:
    """A parameter of each key."""
    value = getattr(vary, name)
    if value is None:
        faults.append(Fault(f"{place}.{name}", f"{vary.distribution or 'a grid'} needs it"))
    elif not isinstance(value, list):
        return [value] * n
    elif len(value) != n:
        faults.append(
            Fault(f"{place}.{name}", f"has {len(value)} numbers; give one" + (f", or {n}, one a key" if n > 1 else ""))
        )
    else:
        return value
    return [math.nan] * n


def _parameters(vary: Vary, n: int, kind: str, place: str, faults: list[Fault]) -> tuple[dict[str, float], ...]:
    """The parameters of a distribution or a grid for each key; empty for values."""
    names = DISTRIBUTIONS[vary.distribution] if vary.distribution else ("low", "high") if kind == "number" else ()
    given = {name: _per_key(vary, name, n, place, faults) for name in names}
    each = tuple({name: values[k] for name, values in given.items()} for k in range(n))
    for parameters in each:
        low, high = parameters.get("low", 0.0), parameters.get("high", 1.0)
        if low <= 0.0 and (vary.distribution == "loguniform" or (kind == "number" and vary.spacing == "log")):
            faults.append(Fault(f"{place}.low", f"{low:g} must be greater than 0 for a logarithm"))
        elif low >= high:
            faults.append(Fault(f"{place}.low", f"{low:g} must be less than high, {high:g}"))
        if parameters.get("deviation", 1.0) <= 0.0:
            faults.append(Fault(f"{place}.deviation", f"{parameters['deviation']:g} must be greater than 0"))
        elif vary.distribution == "truncated_normal" and not faults and not _likely(**parameters):
            faults.append(Fault(place, "low to high is more than 30 deviations from the mean: no number can be drawn"))
    return each if names else ()


def _likely(mean: float, deviation: float, low: float, high: float) -> bool:
    return low - 30.0 * deviation < mean < high + 30.0 * deviation


def unit_cube(kind: str, variations: Sequence[Variation], runs: int, seed: int) -> np.ndarray:
    """Points (runs, d) of a design in the unit cube, in the order of the variations; ``kind`` is not "grid"."""
    d = len(variations)
    if d == 0:
        return np.zeros((runs, 0))
    if kind == "random":
        return np.column_stack([_stream(seed, " ".join(each.keys)).random(runs) for each in variations])
    generator = _stream(seed, kind)
    if kind == "sobol_indices":
        from SALib.sample import sobol

        problem = {"num_vars": d, "names": [each.place for each in variations], "bounds": [[0.0, 1.0]] * d}
        return sobol.sample(problem, runs // (d + 2), calc_second_order=False, seed=generator)
    from scipy.stats import qmc

    if kind == "latin_hypercube":
        return qmc.LatinHypercube(d, seed=generator).random(runs)
    return qmc.Sobol(d, seed=generator).random_base2(max(0, math.ceil(math.log2(runs))))[:runs]


def _stream(seed: int, name: str) -> np.random.Generator:
    """Random numbers that the seed and a name decide."""
    digest = hashlib.sha256(f"{seed} {name}".encode()).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest)))


def points(kind: str, variations: Sequence[Variation], runs: int, seed: int) -> tuple[tuple[Any, ...], ...]:
    """The values of all keys for each draw. A grid is the product of the levels; the last variation changes fastest."""
    if kind == "grid":
        product = itertools.product(*(each.levels for each in variations))
        return tuple(tuple(itertools.chain(*levels)) for levels in product)
    u = unit_cube(kind, variations, runs, seed)
    columns = [column for each, numbers in zip(variations, u.T, strict=True) for column in each.at(numbers)]
    return tuple(zip(*columns, strict=True)) if columns else ((),) * runs


def design_faults(kind: str, variations: Sequence[Variation], runs: int | None) -> tuple[int, list[Fault], list[str]]:
    """The number of draws of a design, its errors, and notes about it."""
    d, product = len(variations), math.prod(len(each.levels) for each in variations)
    if kind == "grid":
        faults = [
            Fault(f"{each.place}.distribution", "a grid needs values, or low, high and number; or choose another kind")
            for each in variations
            if not each.levels
        ]
        if not faults and runs not in (None, product):
            faults.append(Fault("design.runs", f"{runs} differs from the product of the grid, {product}; leave it out"))
        if not faults and product > MOST_DRAWS:
            faults.append(Fault("design", f"the grid has {product} points; at most {MOST_DRAWS} are allowed"))
        return product, faults, []
    if runs is None:
        return 0, [Fault("design.runs", f"lacks this key: the number of draws of the design {kind}")], []
    if kind == "sobol" and runs & (runs - 1):
        below = 1 << (runs.bit_length() - 1)
        return runs, [], [f"{runs} Sobol points are less even than a power of two, {below} or {2 * below}"]
    if kind == "sobol_indices":
        samples, rest = divmod(runs, d + 2)
        if d == 0:
            return 0, [Fault("design.kind", "Sobol indices need a key that varies")], []
        if rest or not samples or samples & (samples - 1):
            below = (d + 2) << max(0, samples.bit_length() - 1)
            nearest = f"{runs} is not {d + 2} times a power of two; the nearest are {below} and {2 * below}"
            return 0, [Fault("design.runs", f"Sobol indices of {d} keys: {nearest}")], []
    return runs, [], []
