"""Checks of a MuJoCo model before a vehicle of it gets its hydrodynamics."""

from collections.abc import Iterator

import mujoco
import numpy as np

from ...errors import Fault, InputError

_INTEGRATORS = {getattr(mujoco.mjtIntegrator, f"mjINT_{name}") for name in ("EULER", "RK4", "IMPLICIT", "IMPLICITFAST")}


def refuse_unsound(model: mujoco.MjModel, body_id: int) -> None:
    """Refuse settings that would use a stale or doubled inertia, or skip the hydrodynamics.

    Args:
        model: a compiled model.
        body_id: the vehicle's body, on a free joint.

    Raises:
        InputError: with every setting that is not sound.
    """
    checks = (*_solver_checks(model.opt), *_vehicle_checks(model, body_id))
    faults = [Fault(key, reason) for wrong, key, reason in checks if wrong]
    if faults:
        raise InputError(faults, f"body {model.body(body_id).name!r} can't be attached")


def _solver_checks(option: mujoco.MjOption) -> Iterator[tuple[bool, str, str]]:
    """Whether a setting is wrong, its name and the reason."""
    enable, disable = mujoco.mjtEnableBit, mujoco.mjtDisableBit
    yield (
        option.solver == mujoco.mjtSolver.mjSOL_PGS,
        "solver PGS",
        "solves constraints with the inertia without the added mass; use Newton or CG",
    )
    yield (
        option.noslip_iterations > 0,
        "noslip_iterations",
        f"is {option.noslip_iterations}, but noslip uses the inertia without the added mass; set it to 0",
    )
    yield (
        option.integrator not in _INTEGRATORS,
        "integrator",
        f"{option.integrator} may use the inertia without the added mass; use Euler, implicitfast, implicit or RK4",
    )
    yield (
        bool(option.enableflags & enable.mjENBL_SLEEP),
        "enable sleep",
        "a sleeping vehicle keeps its inertia, so the added mass would be added twice; disable it",
    )
    yield (
        bool(option.enableflags & enable.mjENBL_DIAGEXACT),
        "enable diagexact",
        "computes contact softness from the inertia without the added mass; disable it",
    )
    yield (
        bool(option.disableflags & disable.mjDSBL_ACTUATION),
        "disable actuation",
        "skips mjcb_control, and with it the hydrodynamics; enable actuation",
    )
    yield (
        option.density > 0 or option.viscosity > 0,
        "density, viscosity",
        f"are {option.density:g} and {option.viscosity:g}; MuJoCo's own fluid forces would act in addition; "
        "set both to 0",
    )


def _vehicle_checks(model: mujoco.MjModel, body_id: int) -> Iterator[tuple[bool, str, str]]:
    """Whether a property of the vehicle is wrong, its name and the reason."""
    dof = model.body_dofadr[body_id]
    damping = model.dof_damping[dof : dof + 6]
    yield (
        bool(damping.any()),
        "joint damping",
        f"is {damping.max():g} on the free joint and would act in addition to the hydrodynamic damping; set it to 0",
    )
    yield (
        bool(model.dof_armature[dof : dof + 6].any()),
        "joint armature",
        "on the free joint would add to the vehicle's inertia; set it to 0",
    )
    yield (
        bool(model.body_gravcomp[model.body_rootid == body_id].any()),
        "gravcomp",
        "would act in addition to buoyancy, which is displaced_mass times gravity; leave it out of the vehicle",
    )
    yield (
        not (model.M_rownnz[dof : dof + 6] == np.arange(1, 7)).all(),
        "body",
        'has no off-diagonal entries in mjData.M for the added mass; write <body simple="false">',
    )
