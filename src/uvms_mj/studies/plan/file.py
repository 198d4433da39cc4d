"""A study file: what may stand in each of its tables. :mod:`.plan` makes the runs of it.

An entry of ``[[vary]]`` is one of three tables: :class:`Values`, a :class:`Grid` or a :class:`Distribution`. Its places
(:mod:`.places`) move together.
"""

import dataclasses
import functools
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic.dataclasses import dataclass
from pydantic_core import PydanticKnownError

from ...errors import Fault, faults_of
from ...files import is_file
from ...quantities import STRICT, Number, doc, refusing, within
from ...scenario import STAGE_LISTS, STAGES
from .places import Place, of_vehicle, parsed

DEFAULT_METRICS = (
    *("contact.first_s", "contact.touches", "contact.peak_N", "contact.impulse_Ns", "contact.final_N"),
    *("contact.settled", "contact.analytic_N", "contact.relative_error"),
    *("effort_N2s", "saturated_s", "final.position_m"),
)
DEFAULT_WORST = 5
"""Number of logs of the worst runs."""
PATHS = ("vehicle.model", "joints.motion_file", *(f"{table}.name" for table in STAGES))
"""The dotted keys whose value may be the path of a file."""
_OF_A_STAGE = re.compile(rf"({'|'.join(STAGE_LISTS)})\[\d+\]\.name")
"""And the names in lists of stages."""
_SUFFIXES = (".py", ".xml", ".toml", ".csv")


def _list_of(what: str) -> Any:
    """A validator of lists; ``what`` is the word for their items in its message."""
    return refusing(lambda x: not isinstance(x, list | tuple | None), f"must be a list of {what}", BeforeValidator)


def _not_empty(hint: str = "") -> Any:
    return refusing(lambda x: x is not None and len(x) == 0, f"is empty{hint}")


def used_with(word: str, uses: Mapping[str, Sequence[str]]) -> AfterValidator:
    """A validator of keys that some kinds of a table need and others lack; ``word`` is the key of the kind, which
    stands before them. None and an empty list are not given."""

    def check(value: Any, info: ValidationInfo) -> Any:
        if word in info.data:
            needed, given = info.field_name in uses.get(info.data[word], ()), value not in (None, [])
            if needed != given:
                raise PydanticKnownError("missing" if needed else "unexpected_keyword_argument")
        return value

    return AfterValidator(check)


def _places(table: Mapping[str, Any]) -> tuple[str, ...]:
    return (table["key"],) if table.get("key") is not None else tuple(table.get("keys") or ())


def _one_a_place(value: Any, info: ValidationInfo) -> tuple[Any, ...]:
    """A value of each place, from one for all of them or a list with one for each. It is empty after an error in the
    places."""
    n = len(_places(info.data))
    if not isinstance(value, list | tuple) or (n == 1 and info.field_name == "values"):
        return (value,) * n
    if n and len(value) != n:
        raise ValueError(f"has {len(value)} values; give one" + (f", or {n}, one a key" if n > 1 else ""))
    return tuple(value)


def _numbers(value: Any, info: ValidationInfo) -> Any:
    each = value if isinstance(value, list | tuple) else [value]
    if value is None:
        return None
    if not (each and all(type(x) in (int, float) and math.isfinite(x) and abs(x) <= 1e12 for x in each)):
        raise ValueError("must be a finite number, or a list with one number a key")
    return tuple(map(float, _one_a_place(value, info)))


def below_high(low: Any, info: ValidationInfo) -> Any:
    """Check that a least value, or one for each place, is less than the greatest, which stands before it, and positive
    for a logarithm."""
    least, greatest = (x if isinstance(x, tuple) else () if x is None else (x,) for x in (low, info.data.get("high")))
    spacing = (info.data.get("spacing"), info.data.get("distribution"), info.data.get("log"))
    if least and min(least) <= 0.0 and {"log", "loguniform", True} & set(spacing):
        raise ValueError("must be greater than 0 for a logarithm")
    for one, other in zip(least, greatest, strict=False):
        if one >= other:
            raise ValueError(f"must be less than high, {other:g}")
    return low


_Numbers = Annotated[Any, BeforeValidator(_numbers)]
"""A number for each place, given as one for all, or as a list."""
_Varied = Annotated[
    Place,
    refusing(
        lambda place: of_vehicle(parsed(place)[0])[1] == "simulation.seed",
        "is set by the study for each run; vary it by design.repeats",
    ),
]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Vary:
    """An entry of ``[[vary]]``: the places that it varies, and the laws for which it does."""

    key: _Varied | None = doc("dotted key that varies, or a component of one, initial.position[0]", None)
    keys: Annotated[list[_Varied] | None, _list_of("dotted keys")] = doc(
        "several that move together, in place of key; each parameter is then one number, or a list with one a key", None
    )
    laws: Annotated[list[str] | None, _list_of("labels"), _not_empty("; leave it out for all laws")] = doc(
        "labels of the laws for which it varies; default: all", None
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> "Vary":
        if (self.key is None) == (not self.keys):
            raise ValueError('give key = "wall.stiffness", or keys = [...] that move together')
        return self

    @property
    def places(self) -> tuple[str, ...]:
        return _places(vars(self))

    @property
    def levels(self) -> tuple[tuple[Any, ...], ...]:
        """Values, or points of a grid, each with one value a place; empty for a distribution."""
        return ()

    def covers(self, law: str) -> bool:
        return self.laws is None or law in self.laws

    def at(self, u: np.ndarray) -> list[list[Any]]:
        """Values of each place at the numbers u (n,) from 0 to 1: of n levels, the level with the index n u."""
        chosen = np.minimum((u * len(self.levels)).astype(int), len(self.levels) - 1).tolist()
        return [[self.levels[i][k] for i in chosen] for k in range(len(self.places))]

    def range(self) -> str:
        """The values as a short text."""
        shown = [each[0] if len(set(map(repr, each))) == 1 else list(each) for each in self.levels]
        texts = [f"{x:g}" if isinstance(x, float) else str(x) for x in shown]
        inner = texts if len(texts) <= 6 else [*texts[:2], "...", texts[-1]]
        return f"{len(texts)} values: {', '.join(inner)}"


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Values(Vary):
    values: Annotated[list[Annotated[Any, BeforeValidator(_one_a_place)]], _list_of("values"), _not_empty()] = doc(
        "values: numbers, texts such as files, or lists for a key that is one, such as impedance.K_f; of keys that "
        "move together, lists with one value a key"
    )

    @functools.cached_property
    def levels(self) -> tuple[tuple[Any, ...], ...]:
        """The values of each level. The numbers of a place are floats, unless all are integers."""
        mixed = [{type(x) for x in column} == {int, float} for column in zip(*self.values, strict=True)]
        return tuple(tuple(float(x) if m else x for x, m in zip(each, mixed, strict=True)) for each in self.values)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Grid(Vary):
    spacing: Literal["linear", "log"] = doc('of the points: "linear" or "log"', "linear")
    high: _Numbers = doc("greatest value")
    low: Annotated[_Numbers, AfterValidator(below_high)] = doc("least value")
    number: Annotated[int, Field(strict=True, ge=2, le=10_000_000)] = doc("number of points, low to high")

    @functools.cached_property
    def levels(self) -> tuple[tuple[Any, ...], ...]:
        spaced = np.geomspace if self.spacing == "log" else np.linspace
        ends = zip(self.low, self.high, strict=True)
        return tuple(zip(*(spaced(low, high, self.number).tolist() for low, high in ends), strict=True))


_PARAMETERS: Mapping[str, Sequence[str]] = {
    "uniform": ("low", "high"),
    "loguniform": ("low", "high"),
    "normal": ("mean", "deviation"),
    "truncated_normal": ("mean", "deviation", "low", "high"),
}
"""The distributions with their parameters."""
_Parameter = Annotated[_Numbers, used_with("distribution", _PARAMETERS), Field(validate_default=True)]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Distribution(Vary):
    distribution: Literal["uniform", "loguniform", "normal", "truncated_normal"] = doc(
        "uniform, loguniform (low, high), normal (mean, deviation), truncated_normal (all four)"
    )
    high: _Parameter = doc("greatest value", None)
    low: Annotated[_Parameter, AfterValidator(below_high)] = doc("least value", None)
    mean: _Parameter = doc("of a normal distribution before it is truncated", None)
    deviation: Annotated[_Parameter, refusing(lambda x: min(x or (1.0,)) <= 0.0, "must be greater than 0")] = doc(
        "standard deviation, likewise", None
    )

    @model_validator(mode="after")
    def _can_be_drawn(self) -> "Distribution":
        if self.distribution == "truncated_normal" and not all(
            low - 30.0 * deviation < mean < high + 30.0 * deviation
            for low, mean, high, deviation in zip(self.low, self.mean, self.high, self.deviation, strict=True)
        ):
            raise ValueError("low to high is more than 30 deviations from the mean: no number can be drawn")
        return self

    @property
    def parameters(self) -> dict[str, tuple[float, ...]]:
        """Each parameter, with one number a place."""
        return {name: getattr(self, name) for name in _PARAMETERS[self.distribution]}

    def at(self, u: np.ndarray) -> list[list[Any]]:
        """The quantile of each place at the numbers u (n,) from 0 to 1."""
        names = self.parameters
        each = (dict(zip(names, numbers, strict=True)) for numbers in zip(*names.values(), strict=True))
        return [quantile(self.distribution, u, **parameters).tolist() for parameters in each]

    def range(self) -> str:
        texts = (f"{name} {x[0] if len(set(x)) == 1 else list(x)}" for name, x in self.parameters.items())
        return f"{self.distribution} ({', '.join(texts)})"


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


def _kind(table: Any) -> str:
    """The tag of an entry. faults_of takes a word with brackets for the branch of a union, not for a key."""
    if not isinstance(table, Mapping):
        return "[values]"  # whose validator wants a table
    given = [kind for kind in ("values", "number", "distribution") if table.get(kind) is not None]
    return f"[{given[0]}]" if len(given) == 1 else ""


Entry = Annotated[
    Annotated[Values, Tag("[values]")]
    | Annotated[Grid, Tag("[number]")]
    | Annotated[Distribution, Tag("[distribution]")],
    Discriminator(
        _kind,
        custom_error_type="value_error",
        custom_error_context={
            "error": "give one of values, a grid (low, high, number), and a distribution (with low, high, ...)"
        },
    ),
]
"""An entry of ``[[vary]]``."""


def _names_no_folder(value: Any) -> bool:
    plain = value.isprintable() and value not in ("", ".", "..") and "/" not in value
    return not plain or len(value.encode()) > 200


_FOLDER = "must be the name of a folder: printable, without /, of 1 to 200 bytes"
_FolderName = refusing(lambda x: isinstance(x, str) and _names_no_folder(x), _FOLDER, BeforeValidator)
_Count = Annotated[int, Field(strict=True, ge=1, le=10_000_000)]
_Index = Annotated[int, Field(strict=True, ge=0)]


@dataclass(frozen=True, config=STRICT)
class Design:
    kind: Literal["grid", "random", "sobol", "latin_hypercube", "sobol_indices"] | None = doc(
        '"grid", "random", "sobol", "latin_hypercube" or "sobol_indices"; default: a grid if every key has values or a '
        "grid, otherwise random",
        None,
    )
    runs: _Count | None = doc(
        "draws, each run with every law; a grid has its product, Sobol indices d + 2 times a power of two for d keys",
        None,
    )
    repeats: _Count = doc("runs of each draw and law, which differ in simulation.seed", 1)
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = doc(
        "of the draws and of the runs' random numbers, which the laws of a draw share", 0
    )


_OfLogs = used_with("kind", {"worst": ("k", "metric"), "listed": ("indices",)})


def _default_of_worst(k: Any, info: ValidationInfo) -> Any:
    return DEFAULT_WORST if k is None and info.data.get("kind") == "worst" else k


@dataclass(frozen=True, config=STRICT)
class Logs:
    """The logs to keep: none; failed, of runs that did not complete; the k worst, with the largest ``metric``; or those
    listed by ``indices``."""

    kind: Literal["none", "failed", "worst", "listed"] = "none"
    k: Annotated[_Count | None, BeforeValidator(_default_of_worst), _OfLogs, Field(validate_default=True)] = None
    metric: Annotated[str | None, _OfLogs, Field(validate_default=True)] = None
    indices: Annotated[list[_Index], _list_of("indices of runs"), _OfLogs, Field(validate_default=True)] = (
        dataclasses.field(default_factory=list)
    )


@dataclass(frozen=True, config=STRICT)
class Keep:
    metrics: Annotated[list[str], _list_of("names")] = dataclasses.field(
        default_factory=lambda: list(DEFAULT_METRICS),
        metadata={"meaning": "metrics by their names, or path/to/file.py:function"},
    )
    logs: Annotated[Logs, BeforeValidator(lambda x: {"kind": x} if isinstance(x, str) else x)] = doc(
        '"none", "failed", {kind = "worst", k, metric} or {kind = "listed", indices}', Logs()
    )


@dataclass(frozen=True, config=STRICT)
class Execution:
    engine: Literal["auto", "mujoco", "free_body", "gpu"] = doc(
        "auto: free_body where it can, checked by a sample; gpu: all runs at once on a GPU, likewise", "auto"
    )
    time_limit_s: Annotated[Number, within(1e-3, 1e7, "s")] | None = doc("wall time after which a run ends [s]", None)
    confined: Annotated[bool, Field(strict=True)] = doc(
        "true: code of users reads the files beside its own alone, and no other of the machine", False
    )
    tolerance: Annotated[Number, within(0.0, 1e3, "")] = doc(
        "largest relative difference of a metric between the two engines of a sample [1]", 1e-4
    )


@dataclass(frozen=True, config=STRICT)
class StudyFile:
    base: dict[str, Any] = doc(
        "base.scenario is the name or file of a scenario, and other keys, such as wall.damping = 5.0, change it; "
        "without it [base] is the scenario itself"
    )
    name: Annotated[str, _FolderName] = doc("title of the report; default: the file's name", "study")
    description: str = doc("first line of the report", "")
    about: dict[str, Any] = dataclasses.field(
        default_factory=dict,
        metadata={"meaning": "what readers should know, such as version, reason and literature; no run depends on it"},
    )
    laws: Annotated[list[Any] | None, _list_of("laws")] = doc(
        'laws to compare, ["gsta", "my_law.py:MyLaw"], or tables [[laws]] with name, label and keys of this law alone, '
        "controller.k_1 = 8.0; default: the law of the base, whose controller.period and .delay stay with each law",
        None,
    )
    vary: Annotated[list[Any], _list_of("tables, [[vary]]")] = dataclasses.field(default_factory=list)
    design: Design = Design()
    keep: Keep = dataclasses.field(default_factory=Keep)
    run: Execution = Execution()
    success: dict[str, Any] = dataclasses.field(
        default_factory=dict,
        metadata={
            "meaning": "what a run must meet besides its completion, by metrics that are kept: contact.settled = true, "
            'contact.final_N = [1.4, 1.6], "my_metrics.py:overshoot" = [0, 0.1] or overshoot = [0, 0.1]; '
            "default: it has settled"
        },
    )


TABLES: Mapping[str, Sequence[Any]] = {
    "": (StudyFile,),
    "vary": (Values, Grid, Distribution),
    "design": (Design,),
    "keep": (Keep,),
    "run": (Execution,),
}
"""The tables of a study file, each with its dataclass, or its possible dataclasses."""


_STUDY, _ENTRY = TypeAdapter(StudyFile), TypeAdapter(Entry)


def valid(kind: TypeAdapter, given: Any, place: str, faults: list[Fault], words: Sequence[str]) -> Any:
    """A table as its dataclass. Errors are appended to ``faults``; then it is None. ``words`` are its keys."""
    try:
        return kind.validate_python(given)
    except ValidationError as error:
        faults += faults_of(error, place, {place.partition("[")[0]: words})
        return None


def words_of(*kinds: Any) -> list[str]:
    """The keys of a table that may be one of several dataclasses."""
    return list(dict.fromkeys(field.name for kind in kinds for field in dataclasses.fields(kind)))


def entries(given: Sequence[Any], faults: list[Fault]) -> dict[str, Any]:
    """The valid entries of ``[[vary]]`` by their place, ``vary[0]``. Errors are appended to ``faults``."""
    each = ((f"vary[{i}]", table) for i, table in enumerate(given))
    found = {place: valid(_ENTRY, table, place, faults, words_of(*TABLES["vary"])) for place, table in each}
    return {place: entry for place, entry in found.items() if entry is not None}


def read(tables: Mapping[str, Any], faults: list[Fault]) -> StudyFile:
    """The tables of a study file. Errors are appended to ``faults``; a key with an error has its default then."""
    choices = {name: words_of(*kinds) for name, kinds in TABLES.items()} | {"keep.logs": words_of(Logs)}
    tables = dict(tables)
    while True:
        try:
            return _STUDY.validate_python(tables)
        except ValidationError as error:
            faults += faults_of(error, choices=choices)
            places = [item["loc"] for item in error.errors(include_url=False)]
        for table, *inner in places:
            held = tables.pop(str(table), None)
            if inner and isinstance(held, dict):
                tables[str(table)] = {key: value for key, value in held.items() if key != inner[0]}
            elif table == "base":
                tables["base"] = {}


def absolute(value: Any, folder: Path) -> Any:
    """A value with an absolute path in the folder, if it names a file: ``model.xml`` or ``law.py:Class``. Text without
    the ending of such a file is the path of one only if it is there."""
    if not isinstance(value, str) or not value:
        return value
    file = Path(value.split(":")[0])
    return str((folder / value).absolute()) if file.suffix in _SUFFIXES or is_file(folder / file) else value


def anchored(key: str, value: Any, folder: Path) -> Any:
    """The value of a dotted key with absolute paths in the folder, if it names files."""
    key = of_vehicle(key)[1]
    if key in PATHS or _OF_A_STAGE.fullmatch(key):
        return absolute(value, folder)
    if key in STAGE_LISTS and isinstance(value, list | tuple):
        return [
            {**each, "name": absolute(each["name"], folder)} if isinstance(each, Mapping) and "name" in each else each
            for each in value
        ]
    return value


def with_absolute_values(table: Any, folder: Path) -> Any:
    """An entry of ``[[vary]]`` whose values are absolute paths, if its key names files."""
    if not isinstance(table, Mapping) or not isinstance(table.get("values"), list):
        return table
    key = str(table.get("key"))
    return {**table, "values": [anchored(key, value, folder) for value in table["values"]]}
