r"""Settings of the sea: regular waves or a spectrum of them, as components of linear theory (:mod:`..physics.waves`).

The spectra have the significant height :math:`H_s = 4 \sqrt{m_0}` and the peak frequency :math:`\omega_p` (DNV-RP-C205,
2014, sec. 3.5.5; Hasselmann et al., "Measurements of wind-wave growth", 1973):

.. math::

    S(\omega) = A_\gamma \tfrac{5}{16} H_s^2 \omega_p^4 \omega^{-5}
        e^{-\frac54 (\omega/\omega_p)^{-4}}\, \gamma^{\exp(-\frac12 (\frac{\omega - \omega_p}{\sigma \omega_p})^2)},
    \qquad A_\gamma = 1 - 0.287 \ln \gamma,

with :math:`\sigma` = 0.07 below the peak and 0.09 above. With :math:`\gamma = 1` it is the spectrum of Pierson and
Moskowitz.

Between :math:`\omega_p/2` and :math:`4 \omega_p` there are bins of equal width. Each has one component, whose frequency
is drawn in it, so that the sum does not repeat, and whose amplitude has the energy of its bin. Phases are uniform.
Directions have the density :math:`\cos^n` about the mean one.
"""

import functools
import math
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic.dataclasses import dataclass

from ..errors import Fault
from ..physics.effects import RHO
from ..physics.random import key_of
from ..quantities import STRICT, Angle, Number, Switch, Whole, doc, within
from .settings import EffectTable, Situation

BREAKING = 0.142
"""Largest steepness of a wave, height over length, in deep water (Michell 1893, Miche 1944)."""
LINEAR = 0.08
"""Steepness up to which linear loads hold (Sayer 2008)."""
SHALLOW = 40.0
"""Ursell number, height times the square of the length over the cube of the depth, up to which waves are linear or of
Stokes' kind (Hedges, "Regions of validity of analytical wave theories", 1995)."""
SLENDER = 0.2
"""Largest size of a body, over the length of a wave, that does not scatter it (DNV-RP-C205, sec. 6.2)."""
STEPS = 20
"""Least number of time steps in the period of the shortest wave."""
_LOW, _HIGH = 0.5, 4.0  # of the components, over the peak frequency
MOST_WAVES = 200
"""Largest number of components of a spectrum."""
_FINE = 64  # parts of a bin in its integral


@dataclass(frozen=True, config=STRICT)
class Sea(EffectTable):
    """Waves: velocity, acceleration and pressure gradient of the water below the surface."""

    of_world: ClassVar[bool] = True
    height: Annotated[Number, within(0.0, 40.0, "m")] = doc(
        "height from trough to crest, or the significant height of a spectrum; 0: no waves [m]", 0.0
    )
    period: Annotated[Number, within(0.1, 100.0, "s")] = doc("period, or the period of the spectrum's peak [s]", 4.0)
    direction_deg: Angle = doc("heading that the waves run to in W, 0 towards the wall, 90 to the left [deg]", 0.0)
    spectrum: Literal["regular", "jonswap", "pierson_moskowitz"] = doc("one wave, or many", "regular")
    gamma: Annotated[Number, within(1.0, 10.0, "")] = doc("peakedness of jonswap [1]", 3.3)
    spreading: Annotated[Number, within(0.0, 200.0, "")] | None = doc(
        "exponent n of the directions' cos^n of a spectrum; null: all waves run in one direction [1]", None
    )
    components: Annotated[Whole, within(1, MOST_WAVES, "")] = doc("components of a spectrum [1]", 30)
    depth: Annotated[Number, within(0.1, 1e5, "m")] | None = doc("depth of the water; null: deep [m]", None)
    surface: Annotated[Number, within(-1e5, 1e5, "m")] = doc("z of the still surface in W [m]", 2.0)
    seed: Annotated[Whole, within(0, 2**62, "")] | None = doc(
        "seed of a spectrum's frequencies, phases and directions; null: simulation.seed [1]", None
    )
    reflecting: Switch = doc("true: [wall] throws the waves back, and they stand in front of it", False)

    sizes: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "height": (
            *("period", "direction_deg", "spectrum", "gamma", "spreading", "components", "depth", "seed"),
            "reflecting",
        )
    }

    @property
    def moves(self) -> bool:
        """Whether there are waves."""
        return self.height > 0.0

    @property
    def unsteady(self) -> str:
        """The reason why the water changes with time; empty without waves."""
        return "waves move the water" if self.moves else ""

    @property
    def constant(self) -> bool:
        """Whether there are no waves."""
        return not self.moves

    @property
    def velocity_W(self) -> tuple[float, float, float]:
        """(3,) mean velocity of the water in W, zero [m/s]."""
        return 0.0, 0.0, 0.0

    @property
    def at_rest(self) -> "Sea":
        """Without waves."""
        return Sea()

    @property
    def follows_seed(self) -> bool:
        """Whether ``simulation.seed`` decides it."""
        return self.moves and self.spectrum != "regular" and self.seed is None

    @property
    def bottom(self) -> float:
        """z of the bottom in W [m]."""
        return -math.inf if self.depth is None else self.surface - self.depth

    @property
    def trough(self) -> float:
        """z of the trough in W [m]."""
        return self.surface - 0.5 * self.height

    def length(self, gravity: float) -> float:
        """Length of the wave, or of the wave at the spectrum's peak, at a gravity [m/s^2]: [m]."""
        return 2.0 * math.pi / wave_number(2.0 * math.pi / self.period, gravity, self.depth)

    def breaks_at(self, gravity: float) -> float:
        """Height at which it breaks [m], by Miche: 0.142 of its length, times tanh k d."""
        length = self.length(gravity)
        return BREAKING * length * (1.0 if self.depth is None else math.tanh(2.0 * math.pi * self.depth / length))

    def records(self, situation: Situation) -> list[tuple]:
        """The numbers of :data:`uvms_mj.physics.waves.WAVE` of all components."""
        if not self.moves:
            return []
        face, found = situation.face if self.reflecting else None, []
        for amplitude, omega, k, e_x, e_y, phase in self.waves(situation):
            bottom = 0.0 if self.depth is None else math.exp(-2.0 * k * self.depth)
            rate, head = amplitude * omega / (1.0 - bottom), omega / (situation.gravity * k)
            found.append((rate, k, (e_x, e_y), omega, phase, self.surface, bottom, head))
            if face is not None:  # the wave from the mirror image: no water crosses x = face
                back = (-e_x, e_y), omega, phase + 2.0 * k * e_x * face
                found.append((rate, k, *back, self.surface, bottom, head))
        return found

    def waves(self, situation: Situation) -> list[tuple[float, float, float, float, float, float]]:
        """The components that run in, of waves that there are: amplitude [m], angular frequency [rad/s], wave number
        [1/m], the two entries of e, and phase [rad]."""
        return _waves(self, situation.seed if self.seed is None else self.seed, situation.gravity)

    def faults(self, situation: Situation) -> Iterator[Fault]:
        if not self.moves:
            return
        gravity, start_z = situation.gravity, situation.start_p[2]
        if gravity == 0.0:
            yield Fault("height", "there are no waves in a world without gravity")
            return
        if self.reflecting and situation.face is None:
            yield Fault("reflecting", "there is no [wall] that throws the waves back")
        least = least_period(self, situation.timestep)
        if self.period < least * (1.0 - 1e-9):
            wrong = f"{self.period:g} s must be at least {least:g} s at a time step of {situation.timestep:g} s"
            yield Fault("period", wrong)
        most = self.breaks_at(gravity)
        if self.height > most:
            wave = "a wave" if self.spectrum == "regular" else "at the spectrum's peak a wave"
            length = self.length(gravity)
            yield Fault("height", f"{wave} of {length:.4g} m breaks at {most:.4g} m; {self.height:g} m is more")
        if self.depth is not None and self.height >= 2.0 * self.depth:
            yield Fault("depth", f"{self.depth:g} m is not below the trough of a wave of {self.height:g} m")
        if start_z > self.trough and not situation.surfaces:
            where = f"the trough is at z = {self.trough:g} m"
            yield Fault("surface", f"{where}, and the vehicle begins above it, at {start_z:g} m")
        elif start_z < self.bottom:
            wrong = f"the bottom is at z = {self.bottom:g} m, and the vehicle begins below, at {start_z:g} m"
            yield Fault("depth", wrong)


def sea_notes(sea: Sea, gravity: float, displaced_mass: float, start_z: float, surfaces: bool) -> Iterator[str]:
    """Warnings where linear waves end, for a vehicle that begins at ``start_z`` [m] and displaces so much water [kg];
    ``surfaces`` is whether its volume is known."""
    if not sea.moves:
        return
    length, size = sea.length(gravity), 2.0 * (displaced_mass / RHO) ** (1.0 / 3.0)
    many = "" if sea.spectrum == "regular" else " of the spectrum's peak"
    if sea.height > LINEAR * length:
        yield (
            f"the steepness{many}, height over length, is {sea.height / length:.3g}; the loads of linear waves hold to "
            f"{LINEAR:g}"
        )
    if sea.depth is not None and (ursell := sea.height * length**2 / sea.depth**3) > SHALLOW:
        yield (
            f"the wave{many}, of {length:.3g} m, is long for a depth of {sea.depth:g} m: its Ursell number is "
            f"{ursell:.3g}, and linear waves hold to {SHALLOW:g}"
        )
    if (below := sea.trough - start_z) < size:
        leaves = "" if surfaces else ", and a vehicle that leaves the water keeps its buoyancy and drag"
        where = f"{abs(below):.3g} m {'above' if below < 0.0 else 'below'} the trough"
        yield (
            f"the vehicle begins {where}; linear waves hold from about one body length below it, here {size:.2g} m"
            f"{leaves}"
        )
    if size > SLENDER * length:
        yield (
            f"the vehicle, of about {size:.2g} m, is longer than {SLENDER:g} of the wave{many}, {length:.3g} m: it "
            "would scatter the waves, which is not computed"
        )
    many_only = ("gamma", "components", "spreading", "seed") if sea.spectrum == "regular" else ("gamma",)
    if sea.spectrum != "jonswap" and (idle := [key for key in many_only if getattr(sea, key) != getattr(Sea(), key)]):
        yield f"sea: {', '.join(idle)}: without effect with spectrum = {sea.spectrum!r}"


def least_period(sea: Sea, timestep: float) -> float:
    """The least period whose shortest wave a time step [s] resolves [s]."""
    return STEPS * timestep * (1.0 if sea.spectrum == "regular" else _HIGH)


def elevation(waves: np.ndarray, t: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The height of the surface over the still one at a time [s] and at places x, y of one shape in W [m], from the
    records (n,) of :data:`uvms_mj.physics.waves.WAVE`: [m]."""
    found = np.zeros(np.shape(x))
    for wave in waves:
        amplitude = wave["head"] * wave["rate"] * (1.0 + wave["bottom"])
        along = wave["e"][0] * x + wave["e"][1] * y
        found += amplitude * np.cos(wave["k"] * along - wave["omega"] * t + wave["phase"])
    return found


def wave_number(omega: float, gravity: float, depth: float | None) -> float:
    """The k [1/m] of omega^2 = g k tanh(k d), by Newton's method; ``depth`` None is deep water."""
    k_deep = omega * omega / gravity
    if depth is None:
        return k_deep
    x_deep = k_deep * depth  # x tanh x = x_deep
    x = x_deep / math.sqrt(math.tanh(x_deep))  # Eckart, within a few percent
    for _ in range(50):
        tanh = math.tanh(x)
        step = (x * tanh - x_deep) / (tanh + x * (1.0 - tanh * tanh))
        x -= step
        if abs(step) <= 1e-15 * x:
            break
    return x / depth


def spectral_density(omega: np.ndarray, height: float, period: float, gamma: float) -> np.ndarray:
    """The JONSWAP spectrum S(omega) [m^2 s] at angular frequencies (n,) [rad/s]."""
    peak = 2.0 * math.pi / period
    r = omega / peak
    sigma = np.where(r <= 1.0, 0.07, 0.09)
    shape = 5.0 / 16.0 * height**2 / peak * r**-5.0 * np.exp(-1.25 * r**-4.0)
    return (1.0 - 0.287 * math.log(gamma)) * shape * gamma ** np.exp(-0.5 * ((r - 1.0) / sigma) ** 2)


@functools.lru_cache(maxsize=64)
def _waves(sea: Sea, seed: int, gravity: float) -> list[tuple[float, float, float, float, float, float]]:
    heading = math.radians(sea.direction_deg)
    if sea.spectrum == "regular":
        waves = [(0.5 * sea.height, 2.0 * math.pi / sea.period, heading, 0.0)]
    else:
        waves = _components(sea, heading, np.random.Generator(np.random.PCG64(key_of(seed, "sea"))))
    found = []
    for amplitude, omega, direction, phase in waves:
        k = wave_number(omega, gravity, sea.depth)
        found.append((amplitude, omega, k, math.cos(direction), math.sin(direction), phase))
    return found


def _components(sea: Sea, heading: float, random: np.random.Generator) -> list[tuple[float, float, float, float]]:
    """Amplitude [m], angular frequency [rad/s], direction [rad] and phase [rad] of the components of a spectrum."""
    n, peak = sea.components, 2.0 * math.pi / sea.period
    edges = peak * np.linspace(_LOW, _HIGH, n + 1)
    width = edges[1] - edges[0]
    middles = edges[:-1, None] + width * (np.arange(_FINE) + 0.5) / _FINE
    gamma = sea.gamma if sea.spectrum == "jonswap" else 1.0
    energy = spectral_density(middles, sea.height, sea.period, gamma).mean(axis=1) * width
    energy *= sea.height**2 / 16.0 / energy.sum()  # of what lies outside of the bins, too
    omega = edges[:-1] + width * random.random(n)
    phase, turn = 2.0 * math.pi * random.random(n), random.random(n)
    direction = np.full(n, heading)
    if sea.spreading is not None:
        angles = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 721)
        density = np.cos(angles).clip(0.0) ** sea.spreading
        whole = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
        direction += np.interp(turn, whole / whole[-1], angles)
    return list(zip(*(x.tolist() for x in (np.sqrt(2.0 * energy), omega, direction, phase)), strict=True))
