"""Checks of a MuJoCo model before a vehicle of it gets its hydrodynamics."""

from collections.abc import Iterator

import mujoco
import numpy as np

from ...errors import Fault, InputError

_INTEGRATORS = {getattr(mujoco.mjtIntegrator, f"mjINT_{name}") for name in ("EULER", "RK4", "IMPLICIT", "IMPLICITFAST")}


def refuse_unsound(model: mujoco.MjModel, body_id: int) -> None:
    """Refuse settings that would use a stale or doubled inertia, or skip the hydrodynamics of a body on a free joint.

    Raises:
        InputError: with every setting that is not sound.
    """
    faults = [*_solver_faults(model.opt), *_vehicle_faults(model, body_id)]
    if faults:
        raise InputError(faults, f"body {model.body(body_id).name!r} can't be attached")


def _solver_faults(option: mujoco.MjOption) -> Iterator[Fault]:
    without = "the inertia without the added mass"
    if option.solver == mujoco.mjtSolver.mjSOL_PGS:
        yield Fault("solver PGS", f"solves constraints with {without}; use Newton or CG")
    if option.noslip_iterations > 0:
        yield Fault("noslip_iterations", f"is {option.noslip_iterations}, but noslip uses {without}; set it to 0")
    if option.integrator not in _INTEGRATORS:
        reason = f"{option.integrator} may use {without}; use Euler, implicitfast, implicit or RK4"
        yield Fault("integrator", reason)
    if option.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP:
        reason = "a sleeping vehicle keeps its inertia, so the added mass would be added twice; disable it"
        yield Fault("enable sleep", reason)
    if option.enableflags & mujoco.mjtEnableBit.mjENBL_DIAGEXACT:
        yield Fault("enable diagexact", f"computes contact softness from {without}; disable it")
    if option.disableflags & mujoco.mjtDisableBit.mjDSBL_ACTUATION:
        yield Fault("disable actuation", "skips mjcb_control, and with it the hydrodynamics; enable actuation")
    if option.density > 0 or option.viscosity > 0:
        are = f"are {option.density:g} and {option.viscosity:g}"
        yield Fault("density, viscosity", f"{are}; MuJoCo's own fluid forces would act in addition; set both to 0")


def _vehicle_faults(model: mujoco.MjModel, body_id: int) -> Iterator[Fault]:
    dof = model.body_dofadr[body_id]
    damping = model.dof_damping[dof : dof + 6]
    if damping.any():
        reason = "on the free joint and would act in addition to the hydrodynamic damping; set it to 0"
        yield Fault("joint damping", f"is {damping.max():g} {reason}")
    if model.dof_armature[dof : dof + 6].any():
        yield Fault("joint armature", "on the free joint would add to the vehicle's inertia; set it to 0")
    if model.body_gravcomp[model.body_rootid == body_id].any():
        reason = "would act in addition to buoyancy, which is displaced_mass times gravity; leave it out of the vehicle"
        yield Fault("gravcomp", reason)
    if not (model.M_rownnz[dof : dof + 6] == np.arange(1, 7)).all():
        yield Fault("body", 'has no off-diagonal entries in mjData.M for the added mass; write <body simple="false">')
