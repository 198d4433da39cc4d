"""docs/how_to/identify.md: the coefficients of the example, and its error on held-out data."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

from uvms_mj.cli.new import write_new
from uvms_mj.studies.identify import Identification
from uvms_mj.studies.identify.fit import fit
from uvms_mj.studies.identify.result import judge


def numbers() -> Iterator[tuple]:
    with tempfile.TemporaryDirectory() as folder:
        write_new("identify", "my_rov", folder)
        problem = Identification.load(Path(folder, "my_rov.toml")).problem
        result = judge(problem, fit(problem))
    X_uu, X_u = result.coefficients
    yield "finds -X_uu = {} ±", -X_uu.value
    yield "± {} N s²/m² and -X_u", X_uu.half_width
    yield "and -X_u = {} ±", -X_u.value
    yield "± {} N s/m", X_u.half_width
    (held,) = result.held_out
    yield "an rms error of {} m/s on", held.fitted
    yield "the vehicle before has {} m/s", held.before
    yield "the mean of the fitted data {} m/s", held.mean
