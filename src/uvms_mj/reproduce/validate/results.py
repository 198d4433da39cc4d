"""All runs against the records of a pool: the numbers of each trial, the time between clocks, and the fitted height."""

import functools
import itertools
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from ...errors import InputError
from ...studies.pool.executors import WorkerLost, each_call, gave_up
from .data import Attitude, Motion, Record
from .vehicle import HEIGHT, STATIC, VARIANTS, Variant, at_rest, floating, righting, swing, vehicle

LAGS = np.arange(-1.0, 1.001, 0.02)
"""Times between two clocks that are tried [s]."""


@dataclass(frozen=True)
class Error:
    """The error of a simulated angle: root mean square, greatest and mean, simulated minus measured [rad]."""

    rms: float
    peak: float
    mean: float


def lag(t: np.ndarray, value: np.ndarray, of: np.ndarray, other: np.ndarray) -> float:
    """The time by which ``value``(t) is later than ``other``(of), one of :data:`LAGS` [s].

    It is the lag with the greatest correlation. Correlation does not see an offset or a scale, so that the lag takes up
    neither a wrong trim nor a wrong stiffness.
    """
    return float(max(LAGS, key=lambda late: _correlation(t, value, of + late, other)))


def _correlation(t: np.ndarray, value: np.ndarray, of: np.ndarray, other: np.ndarray) -> float:
    both = (t >= of[0]) & (t <= of[-1])
    return float(np.corrcoef(value[both], np.interp(t[both], of, other))[0, 1])


def error(t: np.ndarray, measured: np.ndarray, of: np.ndarray, simulated: np.ndarray, since: float = -np.inf) -> Error:
    """The error at the samples of the measurement which both have, from a time on [s]; nothing is taken off."""
    both = (t >= max(of[0], since)) & (t <= of[-1])
    difference = np.interp(t[both], of, simulated) - measured[both]
    rms = float(np.sqrt(np.mean(difference**2)))
    return Error(rms, float(np.abs(difference).max()), float(difference.mean()))


HEIGHTS = tuple(round(0.012 + 0.004 * k, 3) for k in range(7))
"""Grid of heights [m]."""
FITTED_ON = 3
"""The height is fitted on this many trials, the first by name, and judged on the others."""
_FINE = np.arange(HEIGHTS[0], HEIGHTS[-1] + 1e-9, 1e-4)


def fitted_height(errors: np.ndarray, fitted_on: tuple[int, ...]) -> float:
    """The height [m], to 0.1 mm, with the least mean rms error of the trials ``fitted_on``.

    ``errors`` (trials, heights) are the errors of each trial at :data:`HEIGHTS`; a cubic spline joins their squares.
    Raises InputError if the least error is at the end of the grid.
    """
    best = int(np.argmin(_between(errors)[list(fitted_on)].mean(axis=0)))
    if best in (0, len(_FINE) - 1):
        reach = f"{HEIGHTS[0]:g} to {HEIGHTS[-1]:g} m"
        raise InputError(f"no height of the centre of buoyancy from {reach} fits the first {FITTED_ON} trials best")
    return float(_FINE[best].round(4))


def every_choice(errors: np.ndarray) -> np.ndarray:
    """Mean rms error of the trials that are left, for every choice of trials to fit on."""
    fine = _between(errors)
    trials = range(len(fine))
    found = []
    for chosen in itertools.combinations(trials, FITTED_ON):
        best = int(np.argmin(fine[list(chosen)].mean(axis=0)))
        found.append(fine[[k for k in trials if k not in chosen], best].mean())
    return np.array(found)


def _between(errors: np.ndarray) -> np.ndarray:
    """(trials, heights) errors on the fine grid."""
    return np.sqrt(np.maximum(CubicSpline(HEIGHTS, errors**2, axis=1)(_FINE), 0.0))


ROLL, PITCH, YAW = 0, 1, 2
AGREE = np.radians(2.0)
"""Up to this rms difference in pitch the two instruments agree [rad]. In the published trials they differ by less than
half of it, or by more than twice of it, where the motion capture has lost the vehicle."""
BEFORE = 1.0
"""Time before the arm's motion from which a trial counts as "in motion" [s]."""
_SWING = -1
"""Number of the swing among the motions."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """The records of a pool and the responses of the models: ``responses[k, variant]`` is that to trial k."""

    trials: Sequence[Record]
    resting: Sequence[Record]
    responses: dict[tuple[int, Variant], Attitude] = field(default_factory=dict)

    def pitch(self, k: int, variant: Variant, late: float = 0.0, since: float = -np.inf) -> Error:
        """Error of the pitch of trial k against the motion capture [rad]; the arm's clock ``late`` by a time [s]."""
        return self.angle(k, variant, PITCH, "mocap", late, since)

    def angle(
        self, k: int, variant: Variant, which: int, instrument: str, late: float = 0.0, since: float = -np.inf
    ) -> Error:
        """Error of an angle of trial k against an instrument [rad]. Yaw counts from the beginning of the trial."""
        measured, found = getattr(self.trials[k], instrument), self.responses[k, variant]
        values = measured.angles[:, which]
        if which == YAW:
            values = values - np.interp(found.t[0], measured.t, values)
        return error(measured.t, values, found.t + late, found.angles[:, which], since)

    def lag(self, k: int, variant: Variant) -> float:
        """Time by which the measured pitch of trial k is later than the simulated one [s]."""
        measured, found = self.trials[k].mocap, self.responses[k, variant]
        return lag(measured.t, measured.angles[:, PITCH], found.t, found.angles[:, PITCH])

    def instruments(self, k: int) -> tuple[float, float]:
        """Time by which the motion capture is later than the inertial unit [s], and their rms difference in pitch
        [rad]."""
        one, other = self.trials[k].mocap, self.trials[k].imu
        pair = one.t, one.angles[:, PITCH], other.t, other.angles[:, PITCH]
        return lag(*pair), error(*pair).rms

    @functools.cached_property
    def agreeing(self) -> list[int]:
        """The trials whose two instruments agree. The others are shown, and are in no mean and no fit."""
        return [k for k in range(len(self.trials)) if self.instruments(k)[1] <= AGREE]

    def constant(self, k: int) -> float:
        """Rms error of the best constant pitch, the mean of the measured one [rad]: no constant has a smaller one."""
        return self.spread(k, Variant())[0]

    def spread(self, k: int, variant: Variant) -> tuple[float, float]:
        """Standard deviation of the measured and of the simulated pitch of trial k [rad]."""
        return float(self.trials[k].mocap.angles[:, PITCH].std()), float(
            self.responses[k, variant].angles[:, PITCH].std()
        )

    def over_heights(self, links: str) -> np.ndarray:
        """(agreeing trials, heights) rms error of the pitch [rad]."""
        return np.array([[self.pitch(k, Variant(links, h)).rms for h in HEIGHTS] for k in self.agreeing])

    @functools.cached_property
    def fitted(self) -> Variant:
        """The model whose height is fitted on the first trials."""
        return self._fit("as is")

    @functools.cached_property
    def fitted_static(self) -> Variant:
        """Hydrostatics alone, with the height fitted on the same trials."""
        return self._fit(STATIC)

    def _fit(self, links: str) -> Variant:
        return Variant(links, fitted_height(self.over_heights(links), tuple(range(FITTED_ON))))

    @property
    def fitted_on(self) -> list[int]:
        """The trials that the height is fitted on: the first ones whose instruments agree."""
        return self.agreeing[:FITTED_ON]

    @property
    def left(self) -> list[int]:
        """The trials whose instruments agree and that nothing was fitted on."""
        return self.agreeing[FITTED_ON:]

    @functools.cached_property
    def choices(self) -> np.ndarray:
        """Mean rms error of the trials that are left, for every choice of trials to fit on [rad]."""
        return every_choice(self.over_heights("as is"))

    def errors(self, variant: Variant, trials: Sequence[int] | None = None) -> np.ndarray:
        """Rms errors of the pitch of trials (n,) [rad], by default of the trials whose instruments agree."""
        return np.array([self.pitch(k, variant).rms for k in (self.agreeing if trials is None else trials)])

    def swings(self) -> dict[str, Attitude]:
        """The response of each model to the fast swing."""
        return {name: self.responses[_SWING, Variant(name)] for name in VARIANTS}

    def at_rest(self, record: Record, variant: Variant) -> tuple[float, float]:
        """Predicted roll and pitch of a record at rest [rad]."""
        q = record.q.mean(axis=0)
        return at_rest(righting(vehicle(variant, q), q))


def compute(
    trials: Sequence[Record], resting: Sequence[Record], executor: Executor, progress: Callable[[int, int], None]
) -> Comparison:
    """Make all runs on an executor. ``progress`` is called with the number of runs done and in total.

    Raises:
        InputError: there are too few trials to fit and to judge, or the workers can't go on.
    """
    results = Comparison(trials, resting)
    agreeing = [trials[k].name for k in results.agreeing]
    if len(agreeing) <= FITTED_ON:
        few = f"{len(agreeing)} trial{'s' if len(agreeing) != 1 else ''} ({', '.join(agreeing)})"
        whose = f"has {few} whose instruments agree within {np.degrees(AGREE):g} deg"
        raise InputError(f"--data: {whose}; at least {FITTED_ON + 1} are needed, since {FITTED_ON} are fitted on")
    models = [Variant(name) for name in VARIANTS] + [Variant(height=h) for h in HEIGHTS if h != HEIGHT]
    models += [Variant(STATIC, h) for h in HEIGHTS]
    calls = [(k, model, trial.motion) for k, trial in enumerate(trials) for model in models]
    calls += [(_SWING, Variant(name), swing()) for name in VARIANTS]
    total = len(calls) + 2 * len(trials)

    def take(call: tuple[int, Variant, Motion], answer: Attitude) -> None:
        if isinstance(answer, WorkerLost):
            raise gave_up(answer)
        results.responses[call[:2]] = answer

    def tick() -> None:
        progress(len(results.responses), total)

    each_call(executor, _run, calls, take, tick)
    found = (results.fitted, results.fitted_static)
    each_call(executor, _run, [(k, v, trial.motion) for k, trial in enumerate(trials) for v in found], take, tick)
    return results


def _run(_: int, variant: Variant, motion: Motion) -> Attitude:
    return floating(motion, variant)
