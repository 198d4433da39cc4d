"""Nonlinear least squares by SciPy, weighted by the noise of each channel, and the uncertainty of its result.

With residuals r over their standard deviation and their derivatives J, the information about the unknowns is J^T J. Its
eigenvectors are the directions in which the data tell the unknowns apart, and one over the square root of an eigenvalue
is the standard deviation along its direction, in units of the scales. In a direction in which 1.96 times it is
greater than one, unknowns are not told apart. An unknown is given if 1.96 times its own standard deviation, by the
inverse of the information, is below one: it may be known while others are not. Residuals that are correlated in time
count as fewer: J of a channel is divided by the square root of its correlation time in samples.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import correlate
from scipy.stats import norm

from ..pool.executors import each_call
from .plant import FAR
from .problem import Problem

STEP = 1e-5
"""Step of the derivatives, in units of the scales."""
Z_95 = float(norm.ppf(0.975))
UNRESOLVED = 1.0 / Z_95
"""Standard deviation from which on an unknown is not given, and the unknowns of a direction are not told apart, in
units of the scales: the 95 % interval then reaches as far as the scale, which is the value at the start."""
_EMPTY = 1e-9
"""Eigenvalue of the information of columns of length one from which on a direction is known at all: the derivatives,
from differences, are wrong by some 1e-5 of themselves."""
_MOVES = 0.05
"""Part of an unknown in an empty direction, in units of the scales, from which on it is not given."""
_NO_NEWS = 0.95
"""Deviation over the prior's deviation from which on the data say nothing of an unknown."""
_PASSES = 4
"""Estimates of the noise, each followed by a fit."""
_SETTLED = 0.01
_MOST_ITERATIONS = 60

Progress = Callable[[int, float], None]
"""Called with the number of iterations and the weighted rms of the residuals."""


@dataclass
class Weighted:
    """Residuals of the fitted samples of a problem, over the standard deviation of their channels, and of the priors.

    ``free`` are the places of the unknowns that are fitted; the others stay as in ``at``."""

    problem: Problem
    sigmas: list[list[float]]
    free: np.ndarray
    at: np.ndarray
    kept: Sequence[int]
    executor: Executor | None = None

    def __post_init__(self) -> None:
        self._of = {i: self.problem.fitted(i) for i in self.kept}
        every = self.problem.all
        self._scales = np.array([each.scale for each in every])
        priors = [(k, each.prior) for k, each in enumerate(every) if each.prior is not None and k in self.free]
        self._priors = [(k, *prior) for k, prior in priors if prior is not None]

    def x(self, z: np.ndarray) -> np.ndarray:
        """The whole vector of scaled free unknowns."""
        x = self.at.copy()
        x[self.free] = self.problem.start[self.free] + self._scales[self.free] * z
        return x

    def part(self, i: int, x: np.ndarray) -> np.ndarray:
        """The residuals of experiment i."""
        errors = self.problem.errors(i, x)
        parts = [
            np.clip(error[there], -FAR, FAR) / sigma
            for error, there, sigma in zip(errors, self._of[i], self.sigmas[i], strict=True)
        ]
        return np.concatenate(parts)

    def priors(self, x: np.ndarray) -> np.ndarray:
        """The residuals of the priors."""
        return np.array([(x[k] - mean) / sigma for k, mean, sigma in self._priors])

    def __call__(self, z: np.ndarray) -> np.ndarray:
        x = self.x(z)
        return np.concatenate([*(self.part(i, x) for i in self.kept), self.priors(x)])

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """Derivatives by the scaled free unknowns; an unknown of one experiment moves no other."""
        x = self.x(z)
        sizes = [sum(int(there.sum()) for there in self._of[i]) for i in self.kept]
        edges = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
        J = np.zeros((edges[-1] + len(self._priors), len(self.free)))
        bases, calls = {i: self.part(i, x) for i in self.kept}, []
        for column, k in enumerate(self.free.tolist()):
            own = self.problem.all[k]
            step = STEP if z[column] + STEP <= (own.high - own.start) / own.scale else -STEP
            for block, i in enumerate(self.kept):
                if own.of is None or own.of == i:
                    calls.append((self, column, k, step, block, i, x, bases[i]))

        def take(call: tuple[Any, ...], found: Any) -> None:
            if isinstance(found, Exception):
                raise found
            _, column, _, _, block, *_ = call
            J[edges[block] : edges[block + 1], column] = found

        if self.executor is None:
            for call in calls:
                take(call, _column(*call))
        else:
            each_call(self.executor, _column, calls, take, lambda: None)
        for row, (k, _, sigma) in enumerate(self._priors):
            J[edges[-1] + row, int(np.flatnonzero(self.free == k)[0])] = self._scales[k] / sigma
        return J

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "executor": None}


def _column(
    weighted: Weighted, column: int, k: int, step: float, block: int, i: int, x: np.ndarray, base: np.ndarray
) -> np.ndarray:
    """The derivative of the residuals of experiment i by unknown k, from a step ahead of x, where they are ``base``."""
    ahead = x.copy()
    ahead[k] += step * weighted.problem.all[k].scale
    return (weighted.part(i, ahead) - base) / step


@dataclass(frozen=True)
class Fit:
    """The result of a fit.

    Attributes:
        x: coefficients and unknowns.
        sigmas: the standard deviation of the noise of each channel, by experiment.
        covariance: of the free unknowns, in units of their scales, without directions of which the data say nothing.
        eigenvalues: of the information, with
        directions: its eigenvectors, a column each, by the free unknowns.
        given, at_bound, from_prior: whether each free unknown is given, is at a bound, and has what its prior says.
        tau: correlation time of the residuals of each channel, in samples, by experiment.
        iterations, success: as SciPy counts them, over all estimates of the noise.
    """

    x: np.ndarray
    free: np.ndarray
    sigmas: list[list[float]]
    covariance: np.ndarray
    eigenvalues: np.ndarray
    directions: np.ndarray
    given: np.ndarray
    at_bound: np.ndarray
    from_prior: np.ndarray
    tau: list[list[float]]
    iterations: int
    success: bool

    def deviation(self, problem: Problem) -> np.ndarray:
        """(n,) standard deviation of each free unknown in its unit; NaN where none is given."""
        scales = np.array([problem.all[k].scale for k in self.free])
        return np.where(self.given, np.sqrt(np.maximum(np.diag(self.covariance), 0.0)) * scales, np.nan)


def fit(
    problem: Problem,
    free: np.ndarray | None = None,
    at: np.ndarray | None = None,
    sigmas: list[list[float]] | None = None,
    kept: Sequence[int] | None = None,
    executor: Executor | None = None,
    progress: Progress = lambda iterations, rms: None,
    keep: Callable[[int, np.ndarray, list[list[float]]], None] = lambda done, x, sigmas: None,
) -> Fit:
    """Fit the free unknowns of a problem, all by default, to some of its experiments, by default those not held out.

    Args:
        at: the vector with which the fit begins, and the values of what is not free.
        sigmas: the noise with which it begins; by default an estimate.
        progress, keep: called after each iteration, ``keep`` with their number, the vector and the noise.
    """
    n = len(problem.all)
    kept = [i for i, each in enumerate(problem.data) if not each.experiment.held_out] if kept is None else kept
    if free is None:
        free = np.array([k for k in range(n) if problem.all[k].of is None or problem.all[k].of in kept])
    at = problem.start.copy() if at is None else at.copy()
    sigmas = problem.weights() if sigmas is None else sigmas
    every = [problem.all[k] for k in free]
    low, high = (np.array([(getattr(e, w) - e.start) / e.scale for e in every]) for w in ("low", "high"))
    z = np.array([(at[k] - e.start) / e.scale for k, e in zip(free, every, strict=True)])
    counted, success = [0], True
    for _ in range(_PASSES):
        weighted = Weighted(problem, sigmas, free, at, kept, executor)
        inner = np.minimum(1e-3, 0.1 * (high - low))  # SciPy begins inside of the bounds
        z = np.clip(z, np.where(np.isfinite(low), low + inner, low), np.where(np.isfinite(high), high - inner, high))

        found = least_squares(
            weighted,
            z,
            jac=weighted.jacobian,  # type: ignore[arg-type]
            bounds=(low, high),
            xtol=1e-8,
            ftol=1e-8,
            gtol=1e-8,
            max_nfev=_MOST_ITERATIONS,
            callback=_callback(weighted, counted, keep, progress),
        )
        z, success = found.x, success and found.status > 0
        new = _noise(problem, weighted.x(z), kept, sigmas, len(free))
        moved = max(abs(a / b - 1.0) for i in kept for a, b in zip(new[i], sigmas[i], strict=True))
        sigmas = new
        if moved < _SETTLED:
            break
    x = weighted.x(z)
    return _judged(problem, x, z, free, sigmas, kept, low, high, counted[0], success, executor)


def _callback(
    weighted: Weighted,
    counted: list[int],
    keep: Callable[[int, np.ndarray, list[list[float]]], None],
    progress: Progress,
) -> Callable[..., None]:
    """The function that SciPy calls after each iteration; it looks for the name of the argument."""

    def after(intermediate_result: Any) -> None:
        counted[0] += 1
        keep(counted[0], weighted.x(intermediate_result.x), weighted.sigmas)
        rms = np.sqrt(2.0 * intermediate_result.cost / max(1, len(intermediate_result.fun)))
        progress(counted[0], float(rms))

    return after


def _noise(
    problem: Problem, x: np.ndarray, kept: Sequence[int], before: list[list[float]], unknowns: int
) -> list[list[float]]:
    """The standard deviation of each channel by its residuals; a given one stays."""
    found = [list(each) for each in before]
    samples = sum(int(there.sum()) for i in kept for there in problem.fitted(i))
    freedom = max(1e-3, 1.0 - unknowns / max(samples, 1))
    for i in kept:
        for k, (channel, error, there) in enumerate(
            zip(problem.data[i].channels, problem.errors(i, x), problem.fitted(i), strict=True)
        ):
            if channel.sigma is None:
                rms = float(np.sqrt(np.mean(np.minimum(np.abs(error[there]), FAR) ** 2) / freedom))
                found[i][k] = max(rms, 1e-12)
    return found


def correlation_time(r: np.ndarray) -> float:
    """Samples of a residual (n,) that count as one: 1 + 2 times the sum of its correlations up to the first one that is
    not significant; 1 at least."""
    r = r - r.mean()
    power = float(r @ r)
    if power <= 0.0:
        return 1.0
    rho = correlate(r, r, method="fft")[len(r) : len(r) + max(len(r) // 2 - 1, 0)] / power
    end = np.flatnonzero(rho < Z_95 / np.sqrt(len(r)))
    return 1.0 + 2.0 * float(rho[: end[0] if len(end) else None].sum())


def _judged(
    problem: Problem,
    x: np.ndarray,
    z: np.ndarray,
    free: np.ndarray,
    sigmas: list[list[float]],
    kept: Sequence[int],
    low: np.ndarray,
    high: np.ndarray,
    iterations: int,
    success: bool,
    executor: Executor | None,
) -> Fit:
    """The uncertainty of a result, by the data."""
    weighted = Weighted(problem, sigmas, free, x, kept, executor)
    J = weighted.jacobian(z)
    tau, factors = [[1.0] * len(each.channels) for each in problem.data], list[np.ndarray]()
    for i in kept:
        parts = zip(problem.errors(i, x), problem.fitted(i), sigmas[i], strict=True)
        for k, (error, there, sigma) in enumerate(parts):
            r = error[there] / sigma
            tau[i][k] = correlation_time(r) * max(1.0, float(np.mean(r**2)))
            factors.append(np.full(len(r), 1.0 / np.sqrt(tau[i][k])))
    factor = np.concatenate([*factors, np.ones(len(J) - sum(map(len, factors)))])
    J = J * factor[:, None]
    eigenvalues, directions = np.linalg.eigh(J.T @ J)
    covariance, lost = _inverse(J)
    spread = np.sqrt(np.diag(covariance))
    priors = np.array([1.0 if (p := problem.all[k].prior) is None else p[1] / problem.all[k].scale for k in free])
    there = np.array([problem.all[k].prior is not None for k in free])
    from_prior = there & (spread > _NO_NEWS * priors)
    given = ~lost & (spread < UNRESOLVED * np.where(there, np.maximum(Z_95 * priors, 1.0), 1.0) * (1.0 + 1e-6))
    at_bound = (z - low < 2e-3) | (high - z < 2e-3)
    kinds = given, at_bound, from_prior
    return Fit(x, free, sigmas, covariance, np.maximum(eigenvalues, 0.0), directions, *kinds, tau, iterations, success)


def _inverse(J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The inverse of J^T J without the directions in which J has no more than the error of its differences, and
    whether each unknown moves along such a direction."""
    norms = np.linalg.norm(J, axis=0)
    lost = norms == 0.0
    norms = np.where(lost, 1.0, norms)
    values, V = np.linalg.eigh((J / norms).T @ (J / norms))
    empty = values < _EMPTY
    along = V / norms[:, None]
    along = along / np.linalg.norm(along, axis=0)
    lost = lost | (np.abs(along[:, empty]) > _MOVES).any(axis=1)
    kept = V[:, ~empty] / norms[:, None]
    return (kept / values[~empty]) @ kept.T, lost
