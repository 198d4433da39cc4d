"""Checks of the wall before the first step: stability of the time step, and accuracy of an impact.

Symplectic Euler with a step h is stable for a mass m on a spring k and a damper b if h^2 k/m + 2 h b/m < 4. Well below
this limit the forces are accurate. With w = sqrt(k/m), the relative error of peak force and rebound is about
(h w)^2/10.
"""

import functools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..control.theory.contacts import ContactSprings
from ..errors import Fault
from ..physics.frames import BODY
from ..plant.contacts import impossible
from ..plant.settings import Surface, Wall, contact_settings, in_series_fast, without_effect
from .base import Setup

RESOLVED = 0.3
"""Largest h w for which the error of an impact stays below about 1 %."""


class _Direction(NamedTuple):
    """Spring [N/m], damper [N s/m] and mass at the contact [kg] of a wall along its normal, or along its face if
    ``prefix`` is "tangential_"; ``table`` is the wall's in the scenario. ``contacts`` is how many contacts of the list
    press on the wall together; 0 for MuJoCo's pair."""

    table: str
    wall: Wall | Surface
    prefix: str
    k: float
    b: float
    m: float
    contacts: int = 0

    def source(self, word: str, default: str) -> str:
        """Where the number comes from, if it is not that of the key."""
        given = self.prefix == "" or getattr(self.wall, self.prefix + word) is not None
        together = " with all contacts and bumpers" if self.contacts else ""
        return f"{together}{'' if given else f' (by default {default})'}"


def wall_faults(setup: Setup) -> Iterator[Fault]:
    """Errors for springs and dampers of the walls, normal or tangential, with which the time step is unstable, and for
    contacts that are not computed."""
    yield from impossible(setup.scenario, setup.nominal)
    h = setup.scenario.simulation.timestep
    for each in _directions(setup):
        k, b, m = each.k, each.b, each.m
        if h * h * k / m >= 4.0:
            stiffest = 4.0 * m / (h * h)
            yield Fault(
                f"{each.table}.{each.prefix}stiffness",
                f"{k:g} N/m{each.source('stiffness', f'{each.table}.stiffness')} is too stiff for a time step of {h:g} "
                f"s and {m:.4g} kg at the contact: choose less "
                f"than {stiffest:.4g} N/m, or a time step below {math.sqrt(4.0 * m / k):.4g} s",
            )
        elif h * h * k / m + 2.0 * h * b / m >= 4.0:
            most = 2.0 * m / h - 0.5 * h * k
            shortest = (math.sqrt(b * b + 4.0 * k * m) - b) / k
            yield Fault(
                f"{each.table}.{each.prefix}damping",
                f"{b:g} N s/m{each.source('damping', f'critical damping for {k:g} N/m')} is too much for a time step "
                f"of {h:g} s and {m:.4g} kg at the contact: "
                f"choose less than {most:.4g} N s/m, or a time step below {shortest:.4g} s",
            )


def wall_notes(setup: Setup) -> Iterator[str]:
    """Warnings for a wall that the time step resolves badly, and for a start inside a wall."""
    h, wall = setup.scenario.simulation.timestep, setup.scenario.wall
    for each in _directions(setup):
        w = math.sqrt(each.k / each.m)
        if h * w > RESOLVED:
            what = "sticking friction" if each.prefix else "an impact"
            yield (
                f"{what} is badly resolved: at {each.table}.{each.prefix}stiffness = {each.k:g} N/m and {each.m:.4g} "
                f"kg the contact vibrates "
                f"at {w / (2.0 * math.pi):.3g} Hz, {2.0 * math.pi / (h * w):.1f} time steps per period; with a "
                f"simulation.timestep below {RESOLVED / w:.2g} s its forces are accurate to about 1 %"
            )
    yield from without_effect(setup.scenario)
    walls: list[tuple[str, Wall | Surface]] = [("wall", wall)] if wall.present else []
    walls += [(f"walls[{i}]", other) for i, other in enumerate(setup.scenario.walls)]
    for table, one in walls:
        given = one.tangential_stiffness is not None or one.tangential_damping is not None
        if one.friction == 0.0 and given:
            yield f"{table}.tangential_stiffness and {table}.tangential_damping have no effect: {table}.friction is 0"
    frame = setup.scenario.task.frame
    start = setup.scenario.initial.position[0] if frame == BODY else float(setup.initial_poses()[0][0][0])
    depth = start - wall.position if setup.contacts.paper else 0.0
    if depth > 0.0 and wall.stiffness * depth > START_FORCE:
        what, where = ("the vehicle", "initial.position[0]") if frame == BODY else (f"the {frame}", f"x of the {frame}")
        yield (
            f"{what} starts {depth:.4g} m inside the wall, which pushes it out with "
            f"{wall.stiffness * depth:.4g} N at once: {where} is {start:g} m, "
            f"wall.position {wall.position:g} m"
        )
    yield from _starts_inside(setup)


START_FORCE = 100.0
"""Force [N] below which a start inside the wall counts as a start in contact."""


def _starts_inside(setup: Setup) -> Iterator[str]:
    """Warnings for contacts of the list that start deep inside their wall."""
    pairs, springs = setup.contacts.pairs, ContactSprings(setup)
    if not pairs:
        return
    poses = setup.initial_poses()
    p, R = (np.array([poses[pair.carrier][k] for pair in pairs]) for k in (0, 1))
    _, normal, depths = springs.wrenches(p, R)
    for pair, force, depth in zip(pairs, normal, depths, strict=True):
        if force > START_FORCE:
            yield (
                f"{pair.body_key} starts {depth:.4g} m inside {pair.wall_key}, which pushes it out with {force:.4g} N "
                "at once: change initial.position or the wall's position"
            )


def _directions(setup: Setup) -> Iterator[_Direction]:
    """Each direction in use, of all contacts of a wall together."""
    wall = setup.scenario.wall
    if setup.contacts.paper:
        settings = contact_settings(wall, setup.mass_along_face)
        yield _Direction("wall", wall, "", settings["stiffness"], settings["damping"], setup.mass_along_normal())
        if settings["friction"] > 0.0:
            k_t, b_t = settings["tangential_stiffness"], settings["tangential_damping"]
            yield _Direction("wall", wall, "tangential_", k_t, b_t, setup.mass_along_face())
    for index, (table, each) in enumerate(setup.contacts.surfaces):
        pairs = [pair for pair in setup.contacts.pairs if pair.surface == index]
        stiffest = max(each.stiffness, each.layer_stiffness or 0.0)
        fast = [in_series_fast(stiffest, each.damping, *pair.bumper) for pair in pairs]
        m, n = min(map(setup.lightest, pairs)), len(pairs)
        yield _Direction(table, each, "", sum(k for k, _ in fast), sum(b for _, b in fast), m, n)
        if each.friction > 0.0:
            along = [contact_settings(each, functools.partial(setup.lightest, pair)) for pair in pairs]
            k_t, b_t = (sum(one[f"tangential_{word}"] for one in along) for word in ("stiffness", "damping"))
            yield _Direction(table, each, "tangential_", k_t, b_t, m, n)
