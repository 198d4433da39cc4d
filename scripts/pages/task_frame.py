"""docs/physics/task_frame.md: the move of its scenario."""

import re
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from page_numbers import page
from uvms_mj import Scenario, Trace, simulate


def run(**others: object) -> Trace:
    """The scenario of the page, with other settings."""
    (text,) = re.findall(r"```toml\n(.*?)```", page("task_frame").read_text(), re.DOTALL)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        file = Path(folder, "move.toml")
        file.write_text(text)
        scenario = Scenario.load(str(file), {key.replace("__", "."): value for key, value in others.items()})
        return simulate(scenario, log_rate=100)


def numbers() -> Iterator[tuple]:
    trace = run()
    moved = np.abs(trace.p_WT[-1] - trace.p_WT[0])
    yield "The tool is moved by {} m and {} m", moved[0], moved[1]
    target = np.array(getattr(trace.scenario.reference, "target", np.nan))
    yield "ends within {} mm of its target", 1e3 * np.linalg.norm(trace.p_WT[-1] - target)
