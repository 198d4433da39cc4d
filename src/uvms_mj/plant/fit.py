"""A scenario on the vehicle of its file: what does not fit, and the inertia at the frame of the task."""

import functools
from typing import Any

import numpy as np

from ..errors import Fault, InputError, suggestion
from ..physics.frames import BODY
from ..physics.statics import Statics
from .perturbation import perturbed
from .vehicle import Vehicle

BEYOND = 0.01
"""How far beyond its range a joint may start, as its limits give way [rad or m]."""


def check_fit(scenario: Any, nominal: Vehicle) -> None:
    """Raise InputError if the frame of the task is not a site of the vehicle, or the initial joints do not fit it."""
    frame, arm, faults = scenario.task.frame, nominal.arm, []
    if frame != BODY and frame not in arm.sites:
        tools = [BODY, *(name for name in arm.sites if name not in nominal.thrusters)]
        none = f"{frame!r} is no site of {nominal.body}, which has none for a tool; choose {BODY}"
        known = f"{frame!r} is not {BODY!r} or a site; {suggestion(frame, tools)}"
        faults.append(Fault("task.frame", known if tools[1:] else none))
    if not arm.links and scenario.vehicle.coulomb_friction != 1.0:
        faults.append(Fault("vehicle.coulomb_friction", f"has no effect: {nominal.body} has no joints"))
    names = [link.name for link in arm.links]
    for i, link in enumerate(scenario.estimates.links):
        if link.name not in names:
            wrong = f"{link.name!r} is not a link of {nominal.body}; {suggestion(link.name, names)}"
            faults.append(Fault(f"estimates.links[{i}].name", wrong))
    given = scenario.initial.joints
    if given is not None and len(given) != len(arm.links):
        joints = ", ".join(arm.joints) or "none"
        faults.append(
            Fault("initial.joints", f"has {len(given)} positions; {nominal.body} has {len(names)} ({joints})")
        )
    elif given is not None:
        faults += [
            Fault(f"initial.joints[{i}]", wrong)
            for i, (q, link) in enumerate(zip(given, arm.links, strict=True))
            if (wrong := link.out_of_range(q, BEYOND))
        ]
    if faults:
        raise InputError(faults, "scenario")


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
