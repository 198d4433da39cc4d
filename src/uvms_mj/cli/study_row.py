"""``uvms-mj run --from DIR --row N``: the scenario and the engine of one run of a study."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import warn

if TYPE_CHECKING:
    from ..scenario import Scenario
    from ..studies.plan import Plan


def row_of(folder: str, row: int, overrides: dict[str, Any], controller: str | None) -> "tuple[Scenario, str]":
    """Scenario and engine of a run of a study, by the study's folder and the run's row.

    The engine is that of the row, or of a run that is not done yet the one that the study would choose. Warns if the
    code has changed. Raises InputError if there is no such run, or one of its files has changed, which is a warning if
    a law, another stage or the vehicle is named anew.
    """
    from ..errors import InputError
    from ..studies.rows import chosen_engine
    from ..studies.study import Study

    if not Path(folder).is_dir():
        raise InputError(f"--row is a run of a study: --from {folder} must be the study's folder")
    plan = Study.load(folder).plan
    if not 0 <= row < plan.runs:
        raise InputError(f"--row {row}: the study in {folder} has the rows 0 to {plan.runs - 1}")
    scenario = plan.scenario(row)
    _check_changes(Path(folder), row, replace(plan, tables=scenario.to_dict()), _names_a_file(overrides, controller))
    if overrides or controller:
        scenario = scenario.updated(overrides, controller, place=f"row {row} of {folder}", note=warn)
    engine = _engine_of(Path(folder), row) or plan.engine
    return scenario, chosen_engine(scenario) if engine == "auto" else engine


def _engine_of(folder: Path, row: int) -> str:
    """The engine of a row; empty for a run that is not done yet or could not begin."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        found = pq.read_table(folder / "rows", columns=["engine"], filters=[("index", "==", row)])["engine"].to_pylist()
    except (OSError, pa.ArrowException):
        return ""
    return found[0] if found else ""


def _names_a_file(overrides: dict[str, Any], controller: str | None) -> bool:
    """Whether the settings of a command name a law, another stage or a vehicle."""
    return controller is not None or any(key.endswith(".name") or key == "vehicle.model" for key in overrides)


def _check_changes(folder: Path, row: int, plan: "Plan", named: bool) -> None:
    """Warn of code, and refuse files of a row, that are not those with which the study began. Files are warned of, too,
    if one is ``named``."""
    from ..errors import InputError
    from ..studies.pool.parcel import Parcel
    from ..studies.results import VERSION, about_of, changes

    try:
        then, now = json.loads((folder / VERSION).read_bytes()), about_of(plan, Parcel.of(plan))
        of_row = {name: digest for name, digest in then["files"].items() if name in now["files"]}
        code, files = changes(then | {"files": of_row}, now)
    except (OSError, ValueError) as error:
        raise InputError(f"{folder}: can't be read: {error}") from None
    if files and not named:
        raise InputError(
            f"row {row} of {folder}: since the study began, {', '.join(files)} changed; restore what it was, or name "
            "the file to run it as it is: -c path/to/law.py:Law, or a key, vehicle.model=path"
        )
    if code or files:
        changed = "; ".join([*code, *(f"{name} changed" for name in files)])
        warn(f"the run may differ from the row: {changed}")
