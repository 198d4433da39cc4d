"""``Tuning``: gains for a stated objective and constraints over a study's runs."""

import contextlib
import hashlib
import os
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import Fault, InputError
from ...files import atomic_write, is_file, is_folder, locked, shortened, tables_of
from ...views.progress import following
from ..bundle import StudyBundle
from ..plan import Plan
from ..pool.executors import executor_of
from ..results import TUNING, about_of, begin, put, refuse_another, refuse_changed
from ..study import Study
from .problem import Outcome, Problem, Trial, fields_of, outcome, refused, rows, with_gains
from .search import JOURNAL, Journal, optuna, search

if TYPE_CHECKING:
    import pandas as pd

TRIALS, FOUND = "trials.parquet", "found.toml"
_FREE = "tune.trials"
"""Key that may change: more trials go on with the same search."""
Progress = Callable[[int, int, "float | None"], None]
"""Called with the number of trials done, their total, and the best feasible value so far."""


@dataclass(frozen=True, eq=False)
class Tuning(Problem):
    """A search for gains::

        tuning = Tuning.load("tune.toml")
        tuning.run("results")
        print(tuning.best("results").gains)

    Every trial runs all runs of the plan, with the same values and random numbers. Suggestions are made one trial at a
    time, and the runs of a trial in parallel, so that the result is the same for any number of workers.

    It has the attributes of :class:`.problem.Problem`.
    """

    @classmethod
    def load(cls, tuning: str | os.PathLike, overrides: Mapping[str, Any] | None = None) -> "Tuning":
        """Load a tuning from a TOML file, or from the folder where it ran.

        Args:
            overrides: dotted keys with values: of the tables objective and tune, or as for a study.

        Raises:
            InputError: the file or an override is invalid; lists every error. Or a file of the tuning in a folder has
                changed; it is not imported then.
        """
        path = Path(tuning, TUNING) if is_folder(tuning) else Path(tuning)
        if not is_file(path):
            raise InputError(f"tuning {str(tuning)!r}: no such file, and not the folder of a tuning")
        if is_folder(tuning):
            refuse_changed(path)
        return cls.from_dict(tables_of(path, "tuning"), path.parent, overrides, place=str(tuning))

    @classmethod
    def from_dict(
        cls,
        tables: Mapping[str, Any],
        folder: Path | None = None,
        overrides: Mapping[str, Any] | None = None,
        place: str = "tuning",
    ) -> "Tuning":
        """Make a tuning from nested tables, as TOML has them; otherwise as :meth:`load`."""
        if not isinstance(tables, Mapping):
            raise InputError(f"{place}: {shortened(tables)} is not a mapping of tables")
        return cls(**fields_of(tables, folder or Path.cwd(), overrides, place))

    def run(
        self,
        out: str | os.PathLike,
        *,
        workers: int | None = None,
        executor: Executor | None = None,
        progress: Progress | bool | None = None,
    ) -> None:
        """Run the trials that a folder lacks, and write the results. Called again after an interruption, it goes on.

        The folder gets trials.parquet and, if a trial is feasible, found.toml and the study of its runs, in which the
        engines are compared.

        Args:
            out: the folder.
            workers: processes on this machine; default: one per core.
            executor: in place of them, as in :meth:`uvms_mj.Study.run`.
            progress: True for a progress bar, or :data:`Progress`. An exception that it raises ends the search.

        Raises:
            InputError: optuna is missing, the folder has another tuning, or the workers can't go on.
            OSError: a file can't be written. Trials that were done are kept.
        """
        if self.plan.engine == "gpu":
            raise InputError([Fault("run.engine", '"gpu" compiles anew for the gains of each trial; use "auto"')])
        folder = Path(out)
        text = "{done} of {total} trials, best {best}"
        with (
            locked(folder),
            following(progress, "tuning", text, _shown) as advance,
            executor_of(executor, workers) as pool,
        ):
            bundle = StudyBundle.of(self.plan)
            self.refuse_another(folder)
            begin(folder / TUNING, self.tables, self._about(bundle))
            journal = self._journal(folder)
            self._search(journal, bundle, pool, advance)
            self._write(folder, [_trial(each) for each in journal.trials], pool)

    def refuse_another(self, folder: Path) -> None:
        """Raise InputError if a folder has another tuning, a study, or more trials than are asked for."""
        refuse_another(folder / TUNING, self.tables, self._about(StudyBundle.of(self.plan)), _FREE)
        done = len(self.trials(folder)) if (folder / JOURNAL).exists() else 0
        if done > self.search.trials:
            raise InputError(f"tune.trials: {self.search.trials}, and {folder} has {done} already; give as many")

    def _about(self, bundle: StudyBundle) -> dict[str, Any]:
        """The contents of version.json. Trials also depend on the search, which rows don't."""
        about = about_of(self.plan, bundle)
        sources = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py"))))
        about["code"] |= {"search": sources.hexdigest()[:12], "optuna": optuna().__version__}
        return about

    def _journal(self, folder: Path) -> Journal:
        return Journal(folder, self.plan.name, self.objective.direction)

    def _search(self, journal: Journal, bundle: StudyBundle, pool: Executor, progress: Progress) -> None:
        best = self._best([_trial(each) for each in journal.trials])
        shown: list[Any] = [len(journal.trials), None if best is None else best.outcome.objective]

        def tick() -> None:
            progress(shown[0], max(shown[0], self.search.trials), shown[1])

        def evaluate(values: Mapping[str, float]) -> Outcome:
            try:
                plan = with_gains(self.plan, values)
            except InputError as error:
                return refused(self.constraints, error)
            return outcome(self.objective, self.constraints, rows(plan, bundle, values, pool, tick))

        def done(number: int, found: Outcome) -> None:
            shown[0] = number + 1
            if found.state == "feasible" and (shown[1] is None or self._better(found.objective, shown[1])):
                shown[1] = found.objective
            tick()

        tick()
        search(self.gains, self.start, self.objective.direction, self.search, journal, evaluate, done)

    def _better(self, one: Any, other: Any) -> bool:
        return one < other if self.objective.direction == "minimize" else one > other

    def _best(self, trials: list[Trial]) -> Trial | None:
        feasible = [each for each in trials if each.outcome.state == "feasible"]
        best: Any = min if self.objective.direction == "minimize" else max
        return best(feasible, key=lambda each: each.outcome.objective, default=None)

    def trials(self, folder: str | os.PathLike) -> list[Trial]:
        """The trials of a folder, in order."""
        return [_trial(each) for each in self._journal(Path(folder)).trials]

    def best(self, folder: str | os.PathLike) -> Trial | None:
        """The best feasible trial of a folder, the first of equal ones; None without a feasible one."""
        return self._best(self.trials(folder))

    def study_of(self, folder: str | os.PathLike, trial: Trial) -> Study:
        """The study of a trial's runs, in its own folder."""
        tables = {**with_gains(self.plan, trial.gains).tables, "name": f"{self.name}, trial {trial.number}"}
        return Study(Plan.from_dict(tables), Path(folder, f"trial-{trial.number:05d}"))

    def report(self, folder: str | os.PathLike) -> Path:
        """Write report.html, the page about the trials of a folder, and return its path. Raises InputError as
        :meth:`trials` does."""
        from .. import pages
        from .page import page

        file, trials = Path(folder, pages.PAGE), self.trials(folder)
        pages.write(file, page(self, trials, self._best(trials), str(folder)))
        return file

    def _write(self, folder: Path, trials: list[Trial], pool: Executor) -> None:
        """Write the table of trials, the scenario with the found gains, and its study."""
        put(folder / TRIALS, lambda file: self.frame(trials).to_parquet(file, index=False))
        best = self._best(trials)
        if best is None:
            with contextlib.suppress(FileNotFoundError):
                (folder / FOUND).unlink()
            return
        scenario = with_gains(self.plan, best.gains).laws[0].scenario
        head = f"# Found by {self.name}: trial {best.number}, {self.objective.label} {best.outcome.objective!r}"
        with atomic_write(folder / FOUND) as part:
            part.write_text(f"{head}\n{scenario.to_toml()}", encoding="utf-8")
        self.study_of(folder, best).run(executor=pool)

    def frame(self, trials: list[Trial]) -> "pd.DataFrame":
        """One row a trial: its number, gains, state, message, objective, constraints, completed runs."""
        import pandas as pd

        labels = [each.label for each in self.constraints]
        table = [
            {"trial": each.number, **each.gains, "state": each.outcome.state, "message": each.outcome.message}
            | {self.objective.label: each.outcome.objective}
            | dict(zip(labels, each.outcome.constraints, strict=True))
            | {"completed": each.outcome.completed, "runs": self.plan.runs}
            for each in trials
        ]
        numbers = dict.fromkeys([self.objective.label, *labels], float)
        return pd.DataFrame(table).astype(numbers if table else {})


def _shown(done: int, total: int, best: float | None) -> dict[str, Any]:
    return {"done": done, "total": total, "best": "-" if best is None else f"{best:.4g}"}


def _trial(each: Any) -> Trial:
    """A trial of Optuna as ours."""
    found = each.user_attrs["outcome"]
    tuples: dict[str, Any] = {name: tuple(found[name]) for name in ("constraints", "violations")}
    return Trial(each.number, each.params, Outcome(**{**found, **tuples}))
