"""The search: Optuna suggests gains, trials answer, and a journal keeps every trial that is done.

The search goes on in memory, and a trial enters the journal when it is done. The seed, the trial's number and the
trials before it decide a suggestion, so that an interrupted search goes on with the same one.
"""

import hashlib
import json
import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...errors import InputError, needs_extra, shortened
from .problem import Gain, Outcome, Search

JOURNAL = "trials.journal"


def optuna() -> Any:
    """Optuna's module. Raises InputError if it is not installed."""
    with needs_extra("tune"):
        import optuna
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna


class Journal:
    """The trials of a folder, in Optuna's journal storage. This process alone writes to it."""

    def __init__(self, folder: Path, name: str, direction: str) -> None:
        self._optuna, path = optuna(), folder / JOURNAL
        if path.exists():
            _cut(path)
        self._path = path
        try:
            self._study = self._opened(name, direction)
        except OSError:
            raise
        except Exception as error:  # what Optuna raises for other data than its own is not documented
            raise self._damaged(f"{type(error).__name__}: {error}") from error

    def _opened(self, name: str, direction: str) -> Any:
        backend = self._optuna.storages.journal.JournalFileBackend(str(self._path), _NoLock())
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            storage = self._optuna.storages.JournalStorage(backend)
            study = self._optuna.create_study(
                storage=storage, study_name=name, direction=direction, load_if_exists=True
            )
        if len(storage.get_all_studies()) > 1 or study.direction.name.lower() != direction:
            raise ValueError("it has another search")
        return study

    def _damaged(self, why: str) -> InputError:
        return InputError(f"{self._path}: damaged ({shortened(why)}); without it the search begins anew")

    @property
    def trials(self) -> list[Any]:
        """The trials that are done. Raises InputError if one is not what was kept."""
        try:
            found = self._study.get_trials(deepcopy=False)
        except Exception as error:  # as in the constructor
            raise self._damaged(f"{type(error).__name__}: {error}") from error
        for each in found:
            if each.user_attrs.get("checksum") != checksum(each):
                raise self._damaged(f"trial {each.number} does not have its checksum")
        return found

    def add(self, trial: Any) -> None:
        """Keep a trial. Raises OSError, for example if the disk is full."""
        self._study.add_trial(trial)


def checksum(trial: Any) -> str:
    """Checksum of a trial of Optuna: its number, gains, value and outcome."""
    kept = [trial.number, trial.params, trial.value, trial.user_attrs.get("outcome")]
    return hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()[:32]


def _cut(path: Path) -> None:
    """Cut the line that a killed process or a full disk left unfinished."""
    data = path.read_bytes()
    if not data.endswith(b"\n"):
        with path.open("r+b") as file:
            file.truncate(data.rfind(b"\n") + 1)
            os.fsync(file.fileno())


class _NoLock:
    """A lock of the journal that does nothing: the folder is locked."""

    def acquire(self) -> bool:
        return True

    def release(self) -> None:
        pass


def search(
    gains: Sequence[Gain],
    start: Mapping[str, float],
    direction: str,
    settings: Search,
    journal: Journal,
    evaluate: Callable[[Mapping[str, float]], Outcome],
    done: Callable[[int, Outcome], None],
) -> None:
    """Run the trials that the journal lacks, one after the other. Trial 0 has the gains ``start``. ``done`` is called
    with the number and the outcome of each."""
    module = optuna()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # parts of the sampler are marked as experimental
        memory = module.create_study(direction=direction)
        memory.add_trials(journal.trials)
        for number in range(len(memory.trials), settings.trials):
            memory.sampler = _sampler(module, settings, number)
            if number == 0:
                memory.enqueue_trial(start)
            trial = memory.ask()
            values = {each.key: trial.suggest_float(each.key, each.low, each.high, log=each.log) for each in gains}
            found = evaluate(values)
            trial.set_user_attr("outcome", asdict(found))
            worst = math.inf if direction == "minimize" else -math.inf
            memory.tell(trial, worst if found.objective is None else found.objective)
            kept = memory.trials[-1]
            kept.set_user_attr("checksum", checksum(kept))
            journal.add(kept)
            done(number, found)


def _sampler(module: Any, settings: Search, number: int) -> Any:
    """The sampler of one trial, whose random numbers the seed and the trial's number decide."""
    seed = int.from_bytes(hashlib.sha256(f"{settings.seed} {number}".encode()).digest()[:4])
    if settings.sampler == "random":
        return module.samplers.RandomSampler(seed=seed)

    def violations(trial: Any) -> list[float]:
        return list(trial.user_attrs["outcome"]["violations"])

    return module.samplers.TPESampler(seed=seed, multivariate=True, constraints_func=violations)
