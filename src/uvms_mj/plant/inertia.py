"""The inertia at the frame of the task, which the law and its design meet."""

import functools
from typing import Any

import numpy as np

from ..physics.frames import BODY
from ..physics.statics import Statics
from .perturbation import perturbed
from .vehicle import Vehicle

Inertias = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Inertias (6, 6) of the true vehicle, of its file, and of the estimates."""


def task_inertias(scenario: Any, nominal: Vehicle) -> Inertias:
    """The inertias at the frame of the task in the initial posture. At a tool they are Lambda."""
    true, estimates = perturbed(nominal, scenario.vehicle), scenario.estimates
    if scenario.task.frame == BODY and not nominal.arm.links:
        return true.M, nominal.M, estimates.inertia * nominal.M
    factors = (estimates.inertia, *(estimates.of(link.name).inertia for link in nominal.arm.links))
    place = scenario.initial.joints, scenario.task.frame
    M, M_file, M_hat = (_inertia(v, *place, f) for v, f in ((true, None), (nominal, None), (nominal, factors)))
    return M, M_file, M_hat


@functools.lru_cache(maxsize=8)
def _inertia(
    vehicle: Vehicle, joints: tuple[float, ...] | None, frame: str, factors: tuple[float, ...] | None
) -> np.ndarray:
    statics = Statics(vehicle, vehicle.arm.start(joints))
    M = statics.inertia(factors)
    if frame == BODY:
        found = np.ascontiguousarray(M[:6, :6])
    else:
        J = statics.jacobian(vehicle.arm.sites[frame])
        Lambda = np.linalg.inv(J @ np.linalg.solve(M, J.T))
        found = 0.5 * (Lambda + Lambda.T)
    found.setflags(write=False)
    return found
