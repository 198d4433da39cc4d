r"""The wrench of the sea on a vehicle that is held at rest.

Each component of the sea moves the water at a place as a sine of :math:`\omega t`, which two instants a quarter of its
period apart give: :math:`v(t) = v(0) \cos \omega t + v(\pi / 2 \omega) \sin \omega t`, and so for the derivatives by
time and by place. In this water the wrench on the vehicle, with nu = 0 in :mod:`uvms_mj.physics.hydrodynamics`, is

.. math::

    \tau_{sea} = -C_A(\nu_r) \nu_r - D(\nu_r) \nu_r + \tau_{effects}(\nu_r)
        + M_A \begin{bmatrix} R_{WB}^\top \dot v_c \\ 0 \end{bmatrix}
        + \rho V \begin{bmatrix} R_{WB}^\top a_c \\ r_b \times R_{WB}^\top a_c \end{bmatrix}, \qquad
    \nu_r = -\begin{bmatrix} R_{WB}^\top v_c \\ 0 \end{bmatrix}, \quad
    a_c = \dot v_c + (\nabla v_c)\, v_c.

It is not linear: the drag has :math:`|u| u`, which waves of some decimetres ask for.
"""

import math
from collections.abc import Callable

import numpy as np

from ...physics.fossen import IN_WATER, water_at_rest
from ...physics.frames import rotation_matrix
from ...physics.kernels import called_on
from ...physics.waves import add_waves
from ...stages.setup import SetupLike

_SAMPLES = 32
"""Samples of a wrench in the period of the sea, or of its peak: eight in the shortest period of a spectrum."""
_SEGMENT, _SEGMENTS, _RATED = 32, 16, 2
"""Periods of the peak in a segment of a spectrum, and segments that do not overlap; the
segments of a rate."""


def sea_spectrum(
    setup: SetupLike, position: np.ndarray, R_WB: np.ndarray, mean: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """The spectrum of the wrench of the sea about its mean, on a vehicle held at a place [m, W], and of the pressure
    head there.

    ``mean`` is the velocity (3,) of the water without waves at a place (3,). A regular wave has one segment, its
    period; of a spectrum it is Welch's mean of segments with Hann's window.

    Returns:
        Angular frequencies (m,) [rad/s], and the variance (m, 7, 7) at each, complex and Hermitian: of the wrench in B
        [N, N m] and of the head [m]. The real part of their sum is the covariance.
    """
    sea = setup.scenario.sea
    step, regular = sea.period / _SAMPLES, sea.spectrum == "regular"
    n = _SAMPLES * (1 if regular else _SEGMENT)
    t = step * np.arange(n * (1 if regular else _SEGMENTS))
    both = np.column_stack([sea_wrenches(setup, position, R_WB, mean, t), _moved(setup, position, t)[:, -1]])
    both -= both.mean(axis=0)
    starts = range(0, len(both) - n + 1, max(1, n // 2))
    window = np.ones(n) if regular else 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n) / n)
    found = np.fft.rfft(np.array([both[start : start + n] for start in starts]) * window[:, None], axis=1)[:, 1:-1]
    scale = 2.0 / (n * (window @ window) * len(starts))
    return 2.0 * np.pi / (n * step) * np.arange(1, n // 2), scale * np.einsum("smi,smj->mij", found, found.conj())


def sea_rate(setup: SetupLike) -> np.ndarray:
    """Largest rate (6,) of M_hat^-1 tau_sea at the desired pose, over 64 periods [m/s^3, rad/s^3]; zero without waves,
    and for a vehicle that is not rigid at B, where it is not known."""
    scenario = setup.scenario
    if not scenario.sea.moves or setup.not_rigid or float(np.linalg.norm(setup.gravity_W)) == 0.0:
        return np.zeros(6)
    position = np.array(setup.rest_pose[0] or scenario.initial.position)
    step = scenario.sea.period / _SAMPLES
    times = step * np.arange(_SAMPLES * _SEGMENT * _RATED)
    tau = sea_wrenches(setup, position, rotation_matrix(setup.design.quat_d), setup.mean_water.flow, times)
    found: np.ndarray = np.abs(np.diff(np.linalg.solve(setup.design.M_hat, tau.T), axis=1)).max(axis=1) / step
    return found


def sea_wrenches(
    setup: SetupLike, position: np.ndarray, R_WB: np.ndarray, mean: Callable[[np.ndarray], np.ndarray], t: np.ndarray
) -> np.ndarray:
    """tau_sea (n, 6) at times (n,) [s], in B [N, N m]."""
    vehicle, moved = setup.vehicle, _moved(setup, position, t)
    small = 1e-6
    shear = np.array([(mean(position + e) - mean(position - e)) / (2.0 * small) for e in small * np.eye(3)]).T
    v, v_dot = moved[:, :3] + mean(position), moved[:, 3:6]
    a_c = v_dot + np.einsum("nij,nj->ni", moved[:, 6:15].reshape(-1, 3, 3) + shear, v)
    force = vehicle.displaced_mass * a_c @ R_WB
    tau = v_dot @ R_WB @ vehicle.M_A[:, :3].T + np.hstack([force, np.cross(vehicle.r_b, force)])
    body = np.zeros(1, IN_WATER)
    for name in ("M_A", "D_linear", "D_quadratic"):
        body[name] = getattr(vehicle, name)
    in_water = called_on(water_at_rest, body, setup.effects)
    for k, v_B in enumerate(v @ R_WB):
        body["nu_r"][0, :3], body["d"] = -v_B, 0.0
        in_water()
        tau[k] += body["d"][0]
    return tau


def _moved(setup: SetupLike, position: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Velocity, its rate, the gradient and the pressure head (n, 16) of the waves at a place and times (n,)."""
    records, moved = setup.effects["sea"][0], np.zeros((len(t), 16))
    for k in range(len(records)):
        record = records.view(np.recarray)[k : k + 1]
        by_part = []
        for instant in (0.0, 0.5 * math.pi / record.omega[0]):
            v, v_dot, gradient = np.zeros(3), np.zeros(3), np.zeros((3, 3))
            head = add_waves(record, instant, position, v, v_dot, gradient)
            by_part.append(np.concatenate([v, v_dot, gradient.ravel(), [head]]))
        angle = record.omega[0] * t
        moved += np.outer(np.cos(angle), by_part[0]) + np.outer(np.sin(angle), by_part[1])
    return moved
