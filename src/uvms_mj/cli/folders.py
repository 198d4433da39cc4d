"""Output folders, without a mixture of two runs."""

import datetime
import itertools
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import label_of, scenarios_of

if TYPE_CHECKING:
    from ..records.header import Header
    from ..scenario import Scenario
    from ..setup.world import World

LOG, SCENARIO = "run.mcap", "scenario.toml"
"""Names of a run's files in its folder."""


def move_aside(folder: Path, paths: Iterable[Path], what: str) -> None:
    """Move earlier results to a subfolder: logs are not overwritten, and old pictures not mixed with new logs."""
    earlier = [path for path in paths if path.exists()]
    if earlier:
        n = 1
        while (aside := folder / f"earlier-{n}").exists():
            n += 1
        aside.mkdir()
        for path in earlier:
            path.rename(aside / path.name)
        click.echo(f"note: {what} in {folder} was moved to {aside}", err=True)


def log_of(vehicle: str) -> str:
    """The name of the log of a vehicle of a world; of one vehicle alone, whose name is empty, run.mcap."""
    return f"{vehicle}.mcap" if vehicle else LOG


class RunFolder:
    """The first sink: moves the files of an earlier run to a subfolder, with the files that were made from its logs,
    and writes scenario.toml."""

    def __init__(self, folder: Path, files: dict[str, Path], scenario: "Scenario | World", made: Iterable[str]) -> None:
        """``files`` gets the paths of the run's files, by kind, when these may be overwritten. The kind of a log is
        mcap; of a vehicle's log in a world its name. ``made`` are the names of files that are made from the logs."""
        self.folder, self.files, self.scenario, self.made = folder, files, scenario, made

    def begin(self, header: "Header") -> None:
        logs = [self.folder / log_of(vehicle) for vehicle in scenarios_of(self.scenario)]
        scenario = self.folder / SCENARIO
        made = [self.folder / name for name in self.made] if any(log.exists() for log in logs) else []
        move_aside(self.folder, (*logs, scenario, *made), "the earlier run")
        self.files |= {"mcap" if log.name == LOG else log.name: log for log in logs} | {"scenario": scenario}
        scenario.write_text(self.scenario.to_toml(), encoding="utf-8")

    def write(self, rows: Any) -> None:
        pass

    def end(self, outcome: Any) -> None:
        pass


def output_folder(out: str | None, scenario: "Scenario | World") -> tuple[Path, list[Path]]:
    """The folder of a run, and the new folders, inner first: a folder without a name of the user's is created at once,
    so that no other run takes its name."""
    from ..files import missing

    if out is not None:
        return Path(out), []
    now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
    words = re.sub(r"[^\w.-]+", "_", f"{scenario.name}-{label_of(scenario)}")[:100]
    stem = folder = Path("runs") / f"{now}-{words}"
    for n in itertools.count(2):
        made = missing(folder)
        try:
            folder.mkdir(parents=True)
        except FileExistsError:  # another run started in the same second
            folder = stem.with_name(f"{stem.name}-{n}")
            continue
        except OSError:  # as the lock of the folder says
            pass
        break
    return folder, made
