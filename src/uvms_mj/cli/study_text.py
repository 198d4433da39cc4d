"""Text of ``uvms-mj study``: what a study will do, and what came out."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import EXIT_ENGINES_DIFFER, printable
from .console import print_table, table_of

if TYPE_CHECKING:
    import pandas as pd

    from ..studies.pool.estimate import Estimate
    from ..studies.study import Study


def head(study: "Study", executor: Any, folder: Path, dry_run: bool, as_json: bool, quiet: bool) -> "Estimate | None":
    """Print runs, steps, keys, time and size before the study starts. Returns the estimate. Raises InputError if the
    folder has another study."""
    if not dry_run and (as_json or quiet):
        return None
    from ..studies.pool.estimate import estimate
    from ..studies.pool.parcel import Parcel
    from ..studies.results import refuse_another, share_done

    parcel = Parcel.of(study.plan)
    if not dry_run:
        refuse_another(folder, study.plan, parcel)
    parcel.plan()  # as a worker will
    plan, size, done = study.plan, max(1, executor.size), share_done(folder, study.plan)
    expected = estimate(plan, size)
    if as_json:
        return expected
    rest = f" for the last {1.0 - done:.0%}, the others are done" if done else ""
    workers = f"{size} worker{'s' if size > 1 else ''}"
    lines = [
        plan.text(),
        f"time: about {duration(expected.seconds * (1.0 - done))} on {workers}{rest}",
        f"disk: {expected.rows_bytes / 1e6:.2g} MB of rows in {folder}{_logs_size(plan.logs, expected.log_bytes)}",
    ]
    click.echo(printable("\n".join(lines)), err=not dry_run)
    return expected


def _logs_size(logs: Any, each: int) -> str:
    if logs.kind == "none":
        return ""
    number = {"failed": "", "worst": f"{logs.k} x ", "listed": f"{len(set(logs.indices))} x "}[logs.kind]
    return f", and logs of {number}{each / 1e6:.2g} MB" + (" for each run that fails" if logs.kind == "failed" else "")


def duration(seconds: float) -> str:
    if seconds < 100.0:
        return f"{seconds:.2g} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def plan_report(study: "Study", expected: Any, workers: int) -> dict[str, Any]:
    """The object that ``--dry-run --json`` prints."""
    plan = study.plan
    return {
        "study": plan.name,
        "runs": plan.runs,
        "steps": plan.steps,
        "laws": [law.label for law in plan.laws],
        "varied": list(plan.varied),
        "workers": workers,
        "seconds": expected.seconds,
        "rows_bytes": expected.rows_bytes,
        "log_bytes": expected.log_bytes,
        "notes": list(plan.notes),
    }


def print_result(study: "Study", as_json: bool, quiet: bool) -> int:
    """Print what came out; return the exit status."""
    from ..studies.check import largest

    rows, found = study.frame, study.check
    failed = [] if found is None else found[~found["within"]].to_dict("records")
    assert study.folder is not None
    if as_json:
        differences = [] if found is None else largest(found).drop(columns="index").to_dict("records")
        numbers = {
            "study": study.plan.name,
            "runs": len(rows),
            "status": rows["status"].value_counts().to_dict(),
            "engine": rows["engine"].value_counts().to_dict(),
            "check": {"within": not failed, "largest": differences},
            "folder": str(study.folder),
        }
        click.echo(json.dumps(finite(numbers), allow_nan=False))
    elif not quiet:
        _table(study, rows)
        if found is not None:
            click.echo(f"free_body against mujoco, {found['index'].nunique()} runs, largest differences:")
            for each in largest(found).to_dict("records"):
                click.echo(f"  {each['number']}: {each['difference']:.1e} (row {each['index']}, {each['law']})")
        click.echo(f"{study.folder}{os.sep}rows")
    for each in failed:
        click.echo(f"note: row {each['index']}, {each['law']}: {engines_differ(each)}", err=True)
    return EXIT_ENGINES_DIFFER if failed else 0


def engines_differ(found: dict[str, Any]) -> str:
    """A difference between the engines above the tolerance, in words."""
    return (
        f"{found['number']} differs by {found['difference']:.2g} between free_body and mujoco; run.tolerance is "
        f"{found['tolerance']:g}"
    )


def kept(shown: dict[str, int], noun: str) -> str:
    """How to go on after an interruption; ``shown`` has the number done and the total, if it had begun."""
    if not shown:
        return ""
    return f"; {shown['done']} of {shown['total']} {noun} are done and kept: the same command goes on"


def finite(value: Any) -> Any:
    """The same value with None for numbers that JSON lacks."""
    if isinstance(value, dict):
        return {key: finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [finite(each) for each in value]
    return None if value != value or value in (float("inf"), -float("inf")) else value


def _table(study: "Study", rows: "pd.DataFrame") -> None:
    """Runs by law and status, and their successes."""
    from ..studies.plan.metrics import in_words, successes

    success = successes(rows, study.plan.success)
    statuses = dict.fromkeys(["completed", *rows["status"]])
    columns = ("law", "runs", *statuses, "success")
    table = table_of(study.plan.name, *columns, fixed=columns, min_width=60)
    for column in table.columns[1:]:
        column.justify = "right"
    for law in study.plan.laws:
        mine = rows["law"] == law.label
        own = rows.loc[mine, "status"].tolist()
        table.add_row(law.label, str(len(own)), *(str(own.count(each)) for each in statuses), str(success[mine].sum()))
    print_table(table)
    click.echo(f"{in_words(study.plan.success, 'contact.settled' in rows)}")
