"""Checks of the wall before the first step: stability of the time step, and accuracy of an impact.

Symplectic Euler with a step h is stable for a mass m on a spring k and a damper b if h^2 k/m + 2 h b/m < 4. Well below
this limit the forces are accurate. With w = sqrt(k/m), the relative error of peak force and rebound is about
(h w)^2/10.
"""

import math
from collections.abc import Iterator

from ..errors import Fault
from ..plant.settings import contact_settings
from .setup import Setup

RESOLVED = 0.3
"""Largest h w for which the error of an impact stays below about 1 %."""


def wall_faults(setup: Setup) -> Iterator[Fault]:
    """Errors for springs and dampers of the wall, normal or tangential, with which the time step is unstable."""
    h, wall = setup.scenario.simulation.timestep, setup.scenario.wall
    for prefix, k, b, m in _directions(setup):
        given = prefix == "" or getattr(wall, f"{prefix}stiffness") is not None
        if h * h * k / m >= 4.0:
            stiffest = 4.0 * m / (h * h)
            source = "" if given else " (by default wall.stiffness)"
            yield Fault(
                f"wall.{prefix}stiffness",
                f"{k:g} N/m{source} is too stiff for a time step of {h:g} s and {m:.4g} kg at the contact: choose less "
                f"than {stiffest:.4g} N/m, or a time step below {math.sqrt(4.0 * m / k):.4g} s",
            )
        elif h * h * k / m + 2.0 * h * b / m >= 4.0:
            most = 2.0 * m / h - 0.5 * h * k
            shortest = (math.sqrt(b * b + 4.0 * k * m) - b) / k
            given = prefix == "" or getattr(wall, f"{prefix}damping") is not None
            source = "" if given else f" (by default critical damping for {k:g} N/m)"
            yield Fault(
                f"wall.{prefix}damping",
                f"{b:g} N s/m{source} is too much for a time step of {h:g} s and {m:.4g} kg at the contact: "
                f"choose less than {most:.4g} N s/m, or a time step below {shortest:.4g} s",
            )


def wall_notes(setup: Setup) -> Iterator[str]:
    """Warnings for a wall that the time step resolves badly, and for a start inside the wall."""
    h, wall = setup.scenario.simulation.timestep, setup.scenario.wall
    for prefix, k, _, m in _directions(setup):
        w = math.sqrt(k / m)
        if h * w > RESOLVED:
            what = "sticking friction" if prefix else "an impact"
            yield (
                f"{what} is badly resolved: at wall.{prefix}stiffness = {k:g} N/m and {m:.4g} kg the contact vibrates "
                f"at {w / (2.0 * math.pi):.3g} Hz, {2.0 * math.pi / (h * w):.1f} time steps per period; with a "
                f"simulation.timestep below {RESOLVED / w:.2g} s its forces are accurate to about 1 %"
            )
    if wall.friction == 0.0 and (wall.tangential_stiffness is not None or wall.tangential_damping is not None):
        yield "wall.tangential_stiffness and wall.tangential_damping have no effect: wall.friction is 0"
    start = setup.scenario.initial.position[0]
    depth = start - wall.position
    if depth > 0.0 and wall.stiffness * depth > START_FORCE:
        yield (
            f"the vehicle starts {depth:.4g} m inside the wall, which pushes it out with "
            f"{wall.stiffness * depth:.4g} N at once: initial.position[0] is {start:g} m, "
            f"wall.position {wall.position:g} m"
        )


START_FORCE = 100.0
"""Force [N] below which a start inside the wall counts as a start in contact."""


def _directions(setup: Setup) -> Iterator[tuple[str, float, float, float]]:
    """Prefix of the keys, spring [N/m], damper [N s/m] and mass at the contact [kg] of each direction in use."""
    settings = contact_settings(setup.scenario.wall, setup.mass_along_face)
    yield "", settings["stiffness"], settings["damping"], setup.mass_along_normal()
    if settings["friction"] > 0.0:
        k_t, b_t = settings["tangential_stiffness"], settings["tangential_damping"]
        yield "tangential_", k_t, b_t, setup.mass_along_face()
