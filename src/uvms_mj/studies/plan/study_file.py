"""The tables of a study file, as they are written; :mod:`.plan` makes a :class:`.plan.Plan` of them."""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from ...errors import Fault, faults_of
from ...files import is_file
from ...quantities import STRICT, Number, doc, refusing, within
from ...scenario import STAGES

DISTRIBUTIONS: Mapping[str, tuple[str, ...]] = {
    "uniform": ("low", "high"),
    "loguniform": ("low", "high"),
    "normal": ("mean", "deviation"),
    "truncated_normal": ("mean", "deviation", "low", "high"),
}
"""The distributions with their parameters."""
DEFAULT_METRICS = (
    *("contact.first_s", "contact.touches", "contact.peak_N", "contact.impulse_Ns", "contact.final_N"),
    *("contact.settled", "contact.analytic_N", "contact.relative_error"),
    *("effort_N2s", "saturated_s", "final.position_m"),
)
PATHS = ("vehicle.model", "joints.motion_file", *(f"{table}.name" for table in STAGES))
"""The dotted keys whose value may be the path of a file."""
_SUFFIXES = (".py", ".xml", ".toml", ".csv")


def _number_or_one_a_key(value: Any) -> Any:
    each = value if isinstance(value, list | tuple) else [value]
    if value is not None and not (
        each and all(type(x) in (int, float) and math.isfinite(x) and abs(x) <= 1e12 for x in each)
    ):
        raise ValueError("must be a finite number, or a list with one number a key")
    return [float(x) for x in value] if isinstance(value, list | tuple) else value if value is None else float(value)


Bound = Annotated[Any, BeforeValidator(_number_or_one_a_key)]
"""A number, or one a key for keys that move together."""


def _list_of(what: str) -> Any:
    """A validator of lists; ``what`` is the word for their items in its message."""
    return refusing(lambda x: not isinstance(x, list | tuple | None), f"must be a list of {what}", BeforeValidator)


def _names_no_folder(value: Any) -> bool:
    plain = value.isprintable() and value not in ("", ".", "..") and "/" not in value
    return not plain or len(value.encode()) > 200


_FOLDER = "must be the name of a folder: printable, without /, of 1 to 200 bytes"
_FolderName = refusing(lambda x: isinstance(x, str) and _names_no_folder(x), _FOLDER, BeforeValidator)
_Count = Annotated[int, Field(strict=True, ge=1, le=10_000_000)]


@dataclass(frozen=True, config=STRICT)
class Vary:
    key: str | None = doc("dotted key that varies, or a component of one, initial.position[0]", None)
    keys: Annotated[list[str] | None, _list_of("dotted keys")] = doc(
        "several that move together, in place of key; each parameter is then one number, or a list with one a key", None
    )
    laws: Annotated[list[str] | None, _list_of("labels")] = doc(
        "labels of the laws for which it varies; default: all", None
    )
    values: Annotated[list[Any] | None, _list_of("values")] = doc(
        "values, numbers or texts such as files; of keys that move together, lists with one value a key", None
    )
    low: Bound = doc("least value", None)
    high: Bound = doc("greatest value", None)
    number: Annotated[int, Field(strict=True, ge=2, le=10_000_000)] | None = doc("points of a grid, low to high", None)
    spacing: Literal["linear", "log"] | None = doc('of a grid: "linear", the default, or "log"', None)
    distribution: Literal["uniform", "loguniform", "normal", "truncated_normal"] | None = doc(
        "uniform, loguniform (low, high), normal (mean, deviation), truncated_normal (all four)", None
    )
    mean: Bound = doc("of a normal distribution before it is truncated", None)
    deviation: Bound = doc("standard deviation, likewise", None)


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


@dataclass(frozen=True, config=STRICT)
class Logs:
    """The logs to keep: none; failed, of runs that did not complete; the k worst, with the largest ``metric``; or those
    listed by ``indices``."""

    kind: Literal["none", "failed", "worst", "listed"] = "none"
    k: _Count | None = None
    metric: str | None = None
    indices: Annotated[list[Annotated[int, Field(strict=True, ge=0)]], _list_of("indices of runs")] = dataclasses.field(
        default_factory=list
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
    engine: Literal["auto", "mujoco", "free_body"] = doc("auto: free_body where it can, checked by a sample", "auto")
    time_limit_s: Annotated[Number, within(1e-3, 1e7, "s")] | None = doc("wall time after which a run ends [s]", None)
    tolerance: Annotated[Number, within(0.0, 1e3, "")] = doc(
        "largest relative difference of a metric between free_body and mujoco [1]", 1e-4
    )


@dataclass(frozen=True, config=STRICT)
class StudyFile:
    base: dict[str, Any] = doc(
        "base.scenario is the name or file of a scenario, and other keys, such as wall.damping = 5.0, change it; "
        "without it [base] is the scenario itself"
    )
    name: Annotated[str, _FolderName] = doc("title of the report; default: the file's name", "study")
    description: str = doc("first line of the report", "")
    laws: Annotated[list[Any] | None, _list_of("laws")] = doc(
        'laws to compare, ["gsta", "my_law.py:MyLaw"], or tables [[laws]] with name, label and keys of this law alone, '
        "controller.k_1 = 8.0; default: the law of the base, whose controller.period and .delay stay with each law",
        None,
    )
    vary: Annotated[list[Vary], _list_of("tables, [[vary]]")] = dataclasses.field(default_factory=list)
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


def absolute(value: Any, folder: Path) -> Any:
    """A value with an absolute path in the folder, if it names a file: ``model.xml`` or ``law.py:Class``. Text without
    the ending of such a file is the path of one only if it is there."""
    if not isinstance(value, str) or not value:
        return value
    file = Path(value.split(":")[0])
    return str((folder / value).absolute()) if file.suffix in _SUFFIXES or is_file(folder / file) else value


def with_absolute_values(vary: Vary, folder: Path) -> Vary:
    """An entry of vary whose values are absolute paths, if its key names files."""
    if vary.key not in PATHS or vary.values is None:
        return vary
    return dataclasses.replace(vary, values=[absolute(value, folder) for value in vary.values])


_VALIDATOR = TypeAdapter(StudyFile)
TABLES: Mapping[str, Any] = {"": StudyFile, "vary": Vary, "design": Design, "keep": Keep, "run": Execution}
_CHOICES = {name: [field.name for field in dataclasses.fields(table)] for name, table in TABLES.items()}


def read(tables: Mapping[str, Any], faults: list[Fault]) -> StudyFile:
    """The tables of a study file. Errors are appended to ``faults``. A table with an error has its defaults then, and
    an entry of vary has no key."""
    tables = dict(tables)
    while True:
        try:
            return _VALIDATOR.validate_python(tables)
        except ValidationError as error:
            faults += faults_of(error, choices=_CHOICES)
            places = [item["loc"] for item in error.errors(include_url=False)]
        for table, *inner in places:
            if table == "vary" and inner and isinstance(inner[0], int):
                tables["vary"] = [{} if i == inner[0] else each for i, each in enumerate(tables["vary"])]
            elif table == "base":
                tables["base"] = {}
            else:
                tables.pop(str(table), None)
