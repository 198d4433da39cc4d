"""``Identification``: a fit with its folder, which goes on after an interruption."""

import hashlib
import json
import os
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ...errors import InputError
from ...files import atomic_write, is_file, is_folder, locked, shipped, tables_of
from ...plant.renumbered import renumbered
from ...views.progress import following
from ..pool.executors import Workers, size_of
from .file import File, read
from .fit import Fit, Progress, fit
from .problem import Problem
from .result import Result, judge

JOURNAL, FOUND = "journal.json", "identified.toml"


@dataclass(frozen=True, eq=False)
class Identification:
    """Coefficients of a vehicle from measurements::

        identification = Identification.load("identify.toml")
        result = identification.run("found")
        for each in result.coefficients:
            print(each.name, each.value, each.half_width)

    Attributes:
        file: the task.
        problem: the measurements, the plant and the unknowns.
        path: the file.
    """

    file: File
    problem: Problem
    path: Path

    @classmethod
    def load(cls, path: str | os.PathLike) -> "Identification":
        """Load a file, the vehicle and all data that it names. Raises InputError that names the key, or the file, the
        column and the row."""
        path = Path(path)
        if is_folder(path) or not is_file(path):
            raise InputError(f"identification {str(path)!r}: no such file")
        file = read(tables_of(path, "identification"), str(path))
        return cls(file, Problem.load(file, path.parent, str(path)), path)

    def run(
        self,
        out: str | os.PathLike,
        *,
        workers: int | None = None,
        executor: Executor | None = None,
        progress: Progress | bool | None = None,
    ) -> Result:
        """Fit, and write the vehicle NAME.xml, identified.toml and report.html to a folder. Called again after an
        interruption, it goes on from the last iteration.

        Args:
            out: the folder.
            workers: processes on this machine for the derivatives; default: one, which starts no process.
            executor: in place of them, as in :meth:`uvms_mj.Study.run`.
            progress: True for a progress bar, or a function of the number of iterations and the weighted rms of the
                residuals. An exception that it raises ends the fit.

        Raises:
            InputError: the folder has another identification, or the vehicle can't be written.
        """
        folder = Path(out)
        own = Workers(workers) if executor is None and (workers or 1) > 1 else None
        pool = executor or own
        try:
            with locked(folder), following(progress, "fitting", "iteration {done}, rms {rms}", _shown) as advance:
                found = self._fit(folder, None if pool is not None and size_of(pool) == 1 else pool, advance)
                result = judge(self.problem, found)
                self._write(folder, result)
        finally:
            if own is not None:
                own.shutdown(wait=False, cancel_futures=True)
        return result

    def refuse_another(self, folder: Path) -> None:
        """Raise InputError if a folder has another identification, or a vehicle of this name that none wrote."""
        self._journal(folder)

    @property
    def _about(self) -> str:
        """A digest of all that the numbers of a folder depend on: the file, the data, the vehicle and the code."""
        sources = b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py")))
        return f"{self.problem.digest}-{hashlib.sha256(sources).hexdigest()[:8]}"

    def _journal(self, folder: Path) -> dict[str, Any] | None:
        path, vehicle = folder / JOURNAL, folder / f"{self.file.name}.xml"
        if not path.exists():
            if vehicle.exists() and not (folder / FOUND).exists():
                raise InputError(f"--out {folder}: has a vehicle {vehicle.name} already; choose another folder")
            return None
        try:
            kept = json.loads(path.read_text(encoding="utf-8"))
            same = kept["about"] == self._about
            x, sigmas = np.array(kept["x"], float), [[float(s) for s in each] for each in kept["sigmas"]]
        except (ValueError, KeyError, TypeError, OSError) as error:
            raise InputError(f"{path}: is damaged: {error}; delete it to begin anew") from None
        if not same:
            wrong = "has another identification: the file, its data or the program have changed"
            raise InputError(f"--out {folder}: {wrong}; choose another folder, or delete {JOURNAL} to begin anew")
        return {"x": x, "sigmas": sigmas, "done": int(kept["done"])}

    def _fit(self, folder: Path, executor: Executor | None, advance: Callable[..., None]) -> Fit:
        kept, about = self._journal(folder), self._about
        before = kept["done"] if kept else 0

        def keep(done: int, x: np.ndarray, sigmas: list[list[float]]) -> None:
            text = json.dumps({"about": about, "done": before + done, "x": x.tolist(), "sigmas": sigmas})
            with atomic_write(folder / JOURNAL) as part:
                part.write_text(text, encoding="utf-8")

        return fit(
            self.problem,
            at=kept["x"] if kept else None,
            sigmas=kept["sigmas"] if kept else None,
            executor=executor,
            progress=lambda done, rms: advance(before + done, rms),
            keep=keep,
        )

    def _write(self, folder: Path, result: Result) -> None:
        """Write the vehicle, the numbers and the page."""
        from .. import pages
        from .page import page

        name = self.file.name
        local = self.path.parent / self.file.vehicle
        origin = local if local.is_file() else shipped("models").get(self.file.vehicle, local)
        values = {each.name: each.value for each in result.coefficients}
        said = f"identified by {self.path.name}, experiments {', '.join(each.name for each in self.problem.data)}"
        texts = {
            "trust": f"{name}: {said}. {result.sentence()} All else: as {Path(self.file.vehicle).stem}",
            "identified": " ".join(each.text() for each in result.coefficients),
        }
        files = renumbered(Path(self.file.vehicle).stem, origin.absolute(), name, values, texts)
        files[FOUND] = tomli_w.dumps(result.tables()).encode()
        for each, data in files.items():
            with atomic_write(folder / each) as part:
                part.write_bytes(data)
        pages.write(folder / pages.PAGE, page(self.file, self.problem, result))


def _shown(done: int, rms: float) -> dict[str, Any]:
    return {"done": done, "total": None, "rms": f"{rms:.4g}"}
