"""``Study``: many runs of a plan, in one folder, on all cores or on a cluster."""

import contextlib
import dataclasses
import functools
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..files import is_folder, locked
from ..views.notebook import block
from ..views.progress import following
from .bundle import StudyBundle
from .plan import Plan
from .plan.metrics import in_words, is_settled, successes
from .pool.execution import Execution, Progress
from .pool.executors import executor_of
from .results import STUDY, StudyFolder, frame, refuse_changed, units_of, version_of
from .rows import checked, largest, pair_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from .pages import Table

NARROW_IN = 5.0
"""Least width of a figure with panels that must stay side by side [in]."""


class Study:
    """A plan of runs and, once they ran, their folder. Of a study that is loaded by its folder, the results are read
    without its users' files; :attr:`plan` and :meth:`run` import them.

    A study of a file::

        study = Study.load("study.toml").run("results")
        print(study.frame.groupby("law")["contact.peak_N"].describe())

    Attributes:
        folder: the folder of the results; None before :meth:`run`.
        damaged: parts of the folder that the last :meth:`run` found damaged and computed again.
    """

    def __init__(
        self, plan: Plan | None, folder: Path | None = None, overrides: Mapping[str, Any] | None = None
    ) -> None:
        """``plan`` is None for the folder's own, with the ``overrides``."""
        self._plan, self.folder, self._overrides = plan, folder, overrides
        self.damaged: tuple[str, ...] = ()

    @classmethod
    def load(cls, study: str | os.PathLike, overrides: Mapping[str, Any] | None = None) -> "Study":
        """Load a study from a TOML file, a shipped one by its name, or one that ran by its folder.

        Args:
            overrides: dotted keys with values, of the study file or of its base scenario.

        Raises:
            InputError: the study is invalid; lists every error.
        """
        folder = Path(study)
        if not is_folder(folder):
            return cls(Plan.load(study, overrides))
        found = cls(None, folder, overrides)
        assert found.plan_of_results
        return found

    @classmethod
    def from_dict(cls, tables: Mapping[str, Any], overrides: Mapping[str, Any] | None = None) -> "Study":
        """Make a study from nested tables, as a study file has them. An entry of ``laws`` may also be a controller, or
        its class, such as one of a notebook's cell. It raises the errors of :meth:`load`."""
        return cls(Plan.from_dict(tables, None, overrides))

    @property
    def plan(self) -> Plan:
        """The runs. Raises InputError if the study of a folder can't be run any more, as its files have gone or
        changed; a changed one is not imported."""
        if self._plan is None:
            assert self.folder is not None
            refuse_changed(_file_in(self.folder))
            self._plan = Plan.load(_file_in(self.folder), self._overrides)
        return self._plan

    @functools.cached_property
    def plan_of_results(self) -> Plan:
        """The runs, for their results alone: nothing is imported for it, and the files of laws may be gone."""
        if self._plan is not None:
            return self._plan
        assert self.folder is not None
        plan = Plan.that_ran(_file_in(self.folder))
        return dataclasses.replace(plan, units=plan.units | units_of(self.folder, plan.varied))

    def run(
        self,
        out: str | os.PathLike | None = None,
        *,
        workers: int | None = None,
        executor: Executor | None = None,
        progress: Progress | bool | None = None,
        until: int | None = None,
    ) -> "Study":
        """Run what the folder lacks, and return this study. Called again after an interruption, it goes on.

        Args:
            out: the folder; default: the study's.
            workers: processes on this machine; default: one per core.
            executor: in place of them, any object of the shape of ``concurrent.futures``: ``submit(f, *args)`` returns
                a future. :func:`.pool.executors.Cluster` is one.
            progress: True for a progress bar, or a function that is called with a word for the phase and the numbers of
                finished runs, incomplete runs and all runs. An exception that it raises ends the study.
            until: run the first runs alone, by index; the engines are compared, and logs written, when all are done.

        Raises:
            InputError: the folder has another study, or is in use, or the workers can't go on.
            OSError: a file can't be written, e.g. because the disk is full. Finished runs are kept.
        """
        if out is None and self.folder is None:
            raise InputError("out: give the folder of the results")
        folder = self.folder if out is None else Path(out)
        assert folder is not None
        with locked(folder):
            bundle = StudyBundle.of(self.plan)
            bundle.plan()  # as a worker will, so that a file that does not travel is missed before the first run
            results = StudyFolder(folder, self.plan, bundle)
            with (
                following(progress, "starting", "{done} of {total} runs, {failed} failed", _shown) as advance,
                executor_of(executor, workers) as pool,
            ):
                Execution(self.plan, bundle, results, pool, advance).run(until)
        self.folder, self.damaged = folder, tuple(results.damaged)
        return self

    @property
    def frame(self) -> "pd.DataFrame":
        """The rows of the folder, one a run, sorted by index."""
        if self.folder is None:
            raise InputError("the study has no folder yet: run it, or load one by its folder")
        return frame(self.folder)

    def dataset(self) -> "xr.Dataset":
        """The rows as an xarray Dataset over the varied keys of a grid, or over the draws, law and repeat."""
        from .results import dataset

        return dataset(self.plan_of_results, self.frame)

    @property
    def title(self) -> str:
        """Its name, and the numbers of its runs: done, and all."""
        plan, done = self.plan_of_results, len(self.frame)
        return f"{plan.name}: {done} runs" if done == plan.runs else f"{plan.name}: {done} of {plan.runs} runs"

    def table(self) -> list[tuple[str, ...]]:
        """The table of the results, its heads first: of each law its runs, by how they ended, and its successes."""
        plan, rows = self.plan_of_results, self.frame
        success = successes(rows, plan.success)
        statuses = list(dict.fromkeys(["completed", *rows["status"]]))
        found: list[tuple[str, ...]] = [("law", "runs", *statuses, "success")]
        for law in plan.laws:
            mine = rows["law"] == law.label
            own = rows.loc[mine, "status"].tolist()
            ended = (str(own.count(each)) for each in statuses)
            found.append((law.label, str(len(own)), *ended, str(success[mine].sum())))
        return found

    def plot(
        self,
        what: str = "overview",
        *,
        over: Sequence[str] = (),
        metrics: Sequence[str] = (),
        width: str | float | None = None,
        height: str | float | None = None,
        fonts: str = "sans",
        labels: Mapping[str, str] | None = None,
    ) -> "Figure":
        """Draw one figure of the report as a matplotlib Figure, which a notebook shows; pyplot does not know it.

        Args:
            what: overview (success rates, the first distributions), distributions, map, or sensitivity.
            over: of a map, one or two varied keys; default: the keys with the greatest effect.
            metrics: of distributions and maps, names of kept metrics; default: all that vary, or the most telling.
            width, height, fonts: as in :meth:`uvms_mj.Trace.plot`; default: page, sans.
            labels: words in place of names of laws, metrics and varied keys: ``{"contact.peak_N": "largest push"}``.

        Raises InputError if the study has not run, or has no such figure.
        """
        from ..views.figures.style import PAGE_IN, height_of, typeset, width_of
        from .report import figure

        wide = width_of(width, PAGE_IN)
        if what in ("overview", "map") and wide < NARROW_IN:
            raise InputError(f"width: a figure of {what} needs at least {NARROW_IN:g} inches")
        with typeset(fonts, wide):
            drawn = figure(self.plan_of_results, self.frame, what, over, metrics, labels)
        drawn.set_size_inches(wide, height_of(height, drawn.get_figheight()))
        return drawn

    def statistics(
        self, metrics: Sequence[str] = (), *, pairs: bool = False, labels: Mapping[str, str] | None = None
    ) -> "pd.DataFrame":
        """One row a law: its runs, the share that succeeds [%] with its 95 % interval, and of each metric the median
        and the quantiles of 5 and 95 %, with units in the heads; with ``pairs`` one row a pair of laws: the differences
        in the same draws with their 95 % intervals, and whether each is resolved if all intervals shall hold at once.
        ``attrs["meanings"]`` says what each metric is, and over which time. ``metrics`` are names of kept metrics;
        default: the first three that vary. ``labels`` are words in place of names of laws and metrics. Raises
        InputError if the study has not run, or lacks a metric."""
        from .report import tables

        made = tables.comparison if pairs else tables.statistics
        return made(self.plan_of_results, self.frame, metrics, labels)

    def save_table(
        self,
        path: str | os.PathLike,
        metrics: Sequence[str] = (),
        *,
        pairs: bool = False,
        labels: Mapping[str, str] | None = None,
    ) -> None:
        """Write :meth:`statistics` as LaTeX, .tex, with the digits that the ranges support, or as .csv, with all. An
        existing file is replaced. Raises InputError for another ending."""
        from .report import tables

        tables.write(self.statistics(metrics, pairs=pairs, labels=labels), Path(path), f"study {self.title}")

    def report(self, path: str | os.PathLike | None = None) -> Path:
        """Write the page about the results that ``uvms-mj study report`` writes, and return its path; default:
        report.html in the folder, replaced. Raises InputError if the study has not run."""
        from . import pages
        from .report import page

        rows = self.frame
        assert self.folder is not None
        file = self.folder / pages.PAGE if path is None else Path(path)
        code = {}
        with contextlib.suppress(InputError):
            code = dict(version_of(self.folder)["code"])
        pages.write(file, page(self.plan_of_results, rows, str(self.folder), code, self._checked()))
        return file

    def _checked(self) -> "list[Table]":
        """The largest difference of each number between the engines."""
        from .pages import Table

        found = self.check
        if found is None:
            return []
        engines = pair_of(self.plan_of_results)
        heads = [*engines, "difference", "tolerance", "row", "within"]
        rows = [
            (each["number"], [*(each[head] for head in heads[:4]), each["index"], "yes" if each["within"] else "no"])
            for each in largest(found).to_dict("records")
        ]
        runs = found["index"].nunique()
        return [Table(f"{' against '.join(engines)} in {runs} runs, largest differences", heads, rows)]

    def __repr__(self) -> str:
        where = f" in {self.folder}" if self.folder is not None else ", which have not run"
        return f"<Study {self.plan_of_results.name!r}: {self.plan_of_results.runs} runs{where}>"

    def _repr_html_(self) -> str:
        """The page in a notebook: the plan, and of a study that ran its table and the overview."""
        plan = self.plan_of_results
        rows = [(name, rest) for name, _, rest in (line.partition(": ") for line in plan.text().splitlines())]
        ran = self.folder is not None and any((self.folder / "rows").glob("part-*.parquet"))
        if not ran:
            return block(f"study {plan.name}", rows, text=plan.description)
        success = in_words(plan.success, any(map(is_settled, self.frame)))
        below = block("", self.table(), [self.plot()], text=success)
        return block(f"study {plan.name}, in {self.folder}", rows, text=plan.description) + below

    @property
    def check(self) -> "pd.DataFrame | None":
        """The differences between the engines in the sample of :mod:`.rows`; None if no run needed it."""
        return None if self.folder is None else checked(self.folder)


def _shown(what: str, done: int, failed: int, total: int) -> dict[str, Any]:
    return {"what": what, "done": done, "failed": failed, "total": total}


def _file_in(folder: Path) -> Path:
    if not (folder / STUDY).is_file():
        raise InputError(f"{folder}: not the folder of a study: it has no {STUDY}")
    return folder / STUDY
