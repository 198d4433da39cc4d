r"""Walls that are hulls: they follow the sea by response amplitude operators in heave, roll and pitch.

A wave of the amplitude a runs past the pivot of a hull at :math:`x_p`, along the horizontal unit vector e. The hull
answers in heave, roll and pitch, each by its own complex operator :math:`R_j(\omega)` (Newman, "Marine Hydrodynamics",
1977, sec. 6.16; Faltinsen, "Sea Loads", 1990, ch. 3):

.. math::

    \xi_j = \mathrm{Re}\, a R_j(\omega)\, e^{i(\omega t - k e^\top x_p - \varphi)}, \qquad
    R_j = |R_j| e^{i \varepsilon_j},

where :math:`\varepsilon_j` is the phase by which the motion leads the crest at the pivot. To first order in the angles
the hull moves a wall at x by

.. math::

    \xi_3 z + (\xi_4 x_h + \xi_5 y_h) \times (x - x_p),

with :math:`x_h` and :math:`y_h` forward and to the left of the hull. Between its rows an operator is linear in its real
and imaginary part. The variance of a motion is :math:`\int |R_j|^2 S\, d\omega`. The wall does not turn. With ``turns``
the angles, as a rotation vector, turn it about the pivot (:mod:`uvms_mj.physics.surfaces`), which moves it as above to
first order.

A wall may have waves of its own, a spectrum that no water moves by. Without operators it heaves as they do.
"""

import math
from collections.abc import Iterator

import numpy as np

from ..errors import Fault
from .sea import Sea, least_period
from .settings import Situation, Surface

MODES = ("heave", "roll", "pitch")
"""The operators of a wall: heave in m/m, the others in deg/m."""
WIDTH = 7
"""Numbers in a row of a swell."""


def response(rows: tuple[tuple[float, float, float], ...], omega: np.ndarray) -> np.ndarray:
    """The complex operator at angular frequencies (n,) [rad/s], from rows of a frequency [rad/s], an amplitude and a
    phase [deg]; zero without rows."""
    if not rows:
        return np.zeros(len(omega), complex)
    at, amplitude, phase = np.array(rows).T
    value = amplitude * np.exp(1j * np.radians(phase))
    return np.interp(omega, at, value.real) + 1j * np.interp(omega, at, value.imag)


def waves_at(wall: Surface, sea: Sea) -> Sea:
    """The waves that move a wall: its own, or the sea."""
    if not wall.swell_height:
        return sea
    return Sea(wall.swell_height, wall.swell_period, spectrum=wall.swell_spectrum, seed=wall.swell_seed)


def swell(wall: Surface, sea: Sea, situation: Situation) -> tuple[np.ndarray, np.ndarray]:
    """The displacement [m] and the turn [rad] of a wall in waves, as rows (n, 7) each of
    :func:`uvms_mj.physics.surfaces.add_waves`; none of a wall that follows none."""
    sea, none = waves_at(wall, sea), np.zeros((0, WIDTH))
    if not wall.follows_sea or not sea.moves:
        return none, none
    waves = sea.waves(situation)
    a, omega, k, e_x, e_y, phase = (np.array(part) for part in zip(*waves, strict=True))
    pivot = np.array(wall.position if wall.pivot is None else wall.pivot)
    crest = a * np.exp(-1j * (k * (e_x * pivot[0] + e_y * pivot[1]) + phase))
    heave, roll, pitch = (response(getattr(wall, mode), omega) for mode in MODES)
    if not (wall.heave or wall.roll or wall.pitch):
        heave = np.ones(len(omega), complex)
    heading, arm = math.radians(wall.heading_deg), np.array(wall.position) - pivot
    forward = np.array([math.cos(heading), math.sin(heading), 0.0])
    left = np.array([-forward[1], forward[0], 0.0])
    risen = heave[:, None] * np.array([0.0, 0.0, 1.0])

    def rows(Z: np.ndarray) -> np.ndarray:
        return np.hstack([omega[:, None], Z.real, -Z.imag])

    if wall.turns:
        angles = np.radians(1.0) * (roll[:, None] * forward + pitch[:, None] * left)
        return rows(crest[:, None] * risen), rows(crest[:, None] * angles)
    turned = np.radians(1.0) * (roll[:, None] * np.cross(forward, arm) + pitch[:, None] * np.cross(left, arm))
    return rows(crest[:, None] * (risen + turned)), none


def hull_faults(walls: tuple[Surface, ...], sea: Sea, situation: Situation) -> Iterator[Fault]:
    """Errors of walls that follow the sea."""
    for i, wall in enumerate(walls):
        waves = waves_at(wall, sea)
        if not wall.follows_sea or not waves.moves:
            continue
        if wall.swell_height and situation.gravity == 0.0:
            yield Fault(f"walls[{i}].swell_height", "there are no waves in a world without gravity")
        if wall.swell_height and wall.swell_period < (least := least_period(waves, situation.timestep)) * (1.0 - 1e-9):
            wrong = f"{wall.swell_period:g} s must be at least {least:g} s at a time step of {situation.timestep:g} s"
            yield Fault(f"walls[{i}].swell_period", wrong)
        if situation.gravity == 0.0:
            continue
        if waves.reflecting:
            wrong = "the response of a hull is that to waves that run, and [wall] throws them back"
            yield Fault("sea.reflecting", f"{wrong}; take false, or no heave, roll and pitch of walls[{i}]")
            return
        omega = [wave[1] for wave in waves.waves(situation)]
        low, high = min(omega), max(omega)
        for mode in MODES:
            rows = getattr(wall, mode)
            if rows and not rows[0][0] * (1.0 - 1e-9) <= low <= high <= rows[-1][0] * (1.0 + 1e-9):
                wrong = f"the rows are from {rows[0][0]:g} to {rows[-1][0]:g} rad/s"
                whose = "the wall" if wall.swell_height else "[sea]"
                yield Fault(f"walls[{i}].{mode}", f"{wrong}, and {whose} has waves from {low:.4g} to {high:.4g} rad/s")


def hull_notes(walls: tuple[Surface, ...], sea: Sea) -> Iterator[str]:
    """A warning for walls that would follow a sea without waves."""
    still = [f"walls[{i}]" for i, wall in enumerate(walls) if wall.follows_sea and not waves_at(wall, sea).moves]
    if still:
        yield f"{', '.join(still)}: heave, roll and pitch have no effect: [sea] has no waves"
