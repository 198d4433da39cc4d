"""``uvms-mj vehicles NAME --check``: the tables of a vehicle's first sea trial, and its page."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

from .common import Listing, facts, printable

if TYPE_CHECKING:
    from ..plant.sea_trial import Axis, Trial
    from ..plant.vehicle import Vehicle
    from ..studies.pages import Table
    from ..views.figures.style import Figure

_HEADS = ("axis", "alone [N, N m]", "speed [m/s, rad/s]", "halved in [s]", "time constant [s]", "M_A over own")
_COMPARED = ("number", "unit", "here", "shipped", "")


def check(name: str, vehicle: "Vehicle", folder: Path | None) -> "Trial":
    """Print the trial of a vehicle, and write its page into a folder. Raises InputError if it can't be written."""
    from ..plant.sea_trial import trial

    found = trial(vehicle)
    for table in tables(name, found):
        table.show()
    if folder is not None:
        from ..studies.pages import PAGE, write

        write(folder / PAGE, page(name, found))
    return found


def tables(name: str, found: "Trial") -> list[Listing]:
    """The tables of a trial."""
    rows = [
        (each.name, _ends(each.thrust), _ends(each.speed), _text(each.halved), _text(each.time_constant), _share(each))
        for each in found.axes
    ]
    compared = [
        (
            each.name,
            each.unit,
            f"{each.value:.4g}",
            f"{each.low:.4g} .. {each.high:.4g}",
            "look" if each.unusual else "",
        )
        for each in found.compared
    ]
    remarks = [(f"{i}", printable(each)) for i, each in enumerate(found.remarks, 1)] or [("", "nothing")]
    return [
        facts(printable(f"{name}: first sea trial, by formulas, thrusters off"), summary(found)),
        Listing("Each axis alone; halved: from 1 to 0.5 m/s or rad/s", _HEADS, rows, fixed=_HEADS[:1]),
        Listing("Beside the shipped vehicles, scaled to its displaced mass; L: of a cube of it", _COMPARED, compared),
        Listing("Worth a look", ("", "what"), remarks),
    ]


def summary(found: "Trial") -> list[tuple[str, str]]:
    """Names and values of what holds for the whole vehicle."""
    swings = [f"{period:.3g} s (damping ratio {ratio:.2g})" for period, ratio in found.periods]
    growth = [
        f"{u:g} m/s: {'stable' if rate <= 1e-6 else f'doubles in {math.log(2.0) / rate:.3g} s'}"
        for u, rate in found.growth.items()
    ]
    return [
        ("mass, displaced mass", f"{found.mass:.6g} kg, {found.displaced_mass:.6g} kg"),
        ("force at rest", f"{abs(found.buoyancy):.4g} N {'up' if found.buoyancy >= 0.0 else 'down'}"),
        ("righting arm", f"{1e3 * found.righting:.4g} mm"),
        ("attitude at rest", f"roll {found.roll:.4g} deg, pitch {found.pitch:.4g} deg"),
        ("it swings with", ", ".join(swings) or "no oscillation"),
        ("straight ahead", "\n".join(growth)),
        ("energy", "the damping feeds none in" if not found.energy else "see below"),
    ]


def page(name: str, found: "Trial") -> str:
    """The page of a trial."""
    from ..studies.pages import Items, Page, Picture, Section, Text, rendered
    from ..studies.pages import facts as fact_table

    _, axes, compared, _ = tables(name, found)
    remarks = Items(list(found.remarks)) if found.remarks else Text("Nothing.")
    picture = Picture("decays", "Speed without thrust, from 1 m/s or 1 rad/s, each axis alone.", decays(found))
    sections = [
        Section("look", "Worth a look", [remarks]),
        Section("rest", "At rest and straight ahead", [fact_table(summary(found))]),
        Section("axes", axes.title, [_table(axes)]),
        Section("decay", "Decay", [picture]),
        Section("others", compared.title, [_table(compared)]),
    ]
    return rendered(Page(f"{name}: first sea trial", [Text("By formulas; nothing was simulated.", "lead")], sections))


def _table(listing: Listing) -> "Table":
    from ..studies.pages import Table

    return Table(listing.columns[0], listing.columns[1:], [(row[0], row[1:]) for row in listing.rows])


def decays(found: "Trial") -> "Figure":
    """Speed over time of each axis after the thrusters stop: M dv/dt = -(D v + Q v^2) from 1."""
    import numpy as np

    from ..plant.sea_trial import decay
    from ..views.figures.style import PAGE_IN, Figure, styled

    v = np.geomspace(1.0, 0.02, 120)
    with styled():
        figure = Figure(figsize=(PAGE_IN, 2.6))
        for ax, three, unit in zip(
            figure.subplots(1, 2), (found.axes[:3], found.axes[3:]), ("m/s", "rad/s"), strict=True
        ):
            for each in three:
                M = each.inertia + each.added
                t = [decay(M, each.linear, each.quadratic, 1.0, float(x)) for x in v]
                if np.isfinite(t).all():
                    ax.plot(t, v, label=each.name)
            ax.set_xlabel("time [s]")
            ax.set_ylabel(f"speed [{unit}]")
            ax.set_ylim(0.0, 1.0)
            ax.set_xlim(left=0.0)
            if ax.lines:
                ax.legend(frameon=False)
        return figure


def _ends(ends: tuple[float, float] | None) -> str:
    if ends is None:
        return "not alone"
    low, high = (("none" if math.isinf(x) else f"{x:.4g}") for x in ends)
    return "no limit" if low == high == "none" else f"{low} .. {high}"


def _text(value: float) -> str:
    return "never" if math.isinf(value) else f"{value:.3g}"


def _share(axis: "Axis") -> str:
    return f"{axis.added / axis.inertia:.3g}" if axis.inertia > 0.0 else "–"
