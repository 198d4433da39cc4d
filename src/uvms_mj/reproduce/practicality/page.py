"""The page: claims, boundaries of each law along each axis, maps, and the steps from ideal to a pool."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from ...studies.pages import Picture, Table, rendered
from ..claims import Row, counted
from . import figures
from .plans import AXES, DEMANDED, PART, RETUNED, STEPS
from .results import LABELS, Results, why

_PROFILES = (
    "Push of the last 0.5 s along each axis, ideal on the left: mean, and its range as a line. A cross: the law does "
    "not work. Grey band: the demanded force within a tenth. Dotted: a value as in a pool."
)
_MAPS = (
    "Range of the push over the last 0.5 s, from least to greatest. Hatched: the law does not work. Grey: the push "
    "hardly varies and is wrong, or the vehicle is off the wall. Dashed: the contact force is as old as D_d/(K_f k_c) "
    "lets it be."
)


def page(results: Results, rows: Sequence[Row], versions: Mapping[str, str]) -> str:
    """The page as HTML."""
    return rendered(
        Path(__file__).with_name("practicality.html"),
        title="From ideal to real: where each law stops working",
        runs=sum(len(frame) for frame in results.frames.values()),
        demanded=DEMANDED,
        part=PART,
        rows=rows,
        counts=counted(rows),
        boundaries=boundaries(results),
        profiles=Picture("profiles", _PROFILES, figures.profiles(results)),
        maps=Picture("maps-figure", _MAPS, figures.maps(results)),
        steps=steps(results),
        sources=[(axis.title, axis.text(axis.real), axis.source) for axis in AXES.values()],
        versions=sorted(versions.items()),
    )


def boundaries(results: Results) -> Table:
    """Where each law stops working along each axis, and what it does there."""
    rows = []
    for axis in AXES.values():
        cells = []
        for law in LABELS:
            found = results.boundaries[axis.name, law]
            then = "; then it" if found.last is not None else ": it"
            cells.append(f"{found.text}{then} {found.why}" if found.why else found.text)
        rows.append((f"{axis.title} (in a pool {axis.text(axis.real)})", cells))
    return Table("axis", list(LABELS), rows)


def steps(results: Results) -> Table:
    """What GSTA does after each step, with both sets of gains, without and with the bumper."""
    columns = [(law, bumper) for law in ("gsta", RETUNED) for bumper in (False, True)]
    rows = []
    for number, (title, _) in enumerate(STEPS):
        found = [results.step(law, bumper, number) for law, bumper in columns]
        cells = [
            f"works: {row['force_error_N']:+.2g} N, varies by {row['force_range_N']:.2g} N"
            if row["works"]
            else why(row)
            for row in found
        ]
        rows.append((title if number == 0 else f"+ {title}", cells))
    return Table("step", [f"{law}{' with bumper' if bumper else ''}" for law, bumper in columns], rows)
