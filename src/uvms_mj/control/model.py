"""The model of the vehicle: C, D and g as the law estimates them, and the truth for the ideal law.

The estimates use the same equations as the plant, with the true coefficients times the scenario's factors (default 1).
Their errors are terms of the lumped disturbance of the paper's eq. (11).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..physics.fossen import coriolis_added_mass, coriolis_rigid_body, damping, restoring, turn_momentum
from ..physics.frames import to_body
from ..physics.hydrodynamics import relative_velocity
from ..physics.kernels import kernel
from ..stages.base import Room, Stage
from ..stages.signals import CLOCK, TRUE, TRUTH


def coefficients(vehicle: Any, gravity_W: Any, factors: Any = None) -> dict[str, Any]:
    """The fields of the record for :func:`model_wrenches`; ``factors`` of C, D and g are those of the estimates."""
    coriolis, damping, restoring = (factors.coriolis, factors.damping, factors.restoring) if factors else (1.0,) * 3
    return {
        "M_RB": coriolis * vehicle.M_RB,
        "M_A": coriolis * vehicle.M_A,
        "D_linear": damping * vehicle.D_linear,
        "D_quadratic": damping * vehicle.D_quadratic,
        "mass": restoring * vehicle.mass,
        "displaced_mass": restoring * vehicle.displaced_mass,
        "r_g": vehicle.r_g,
        "r_b": vehicle.r_b,
        "gravity_W": np.array(gravity_W),
        "A_diagonal": 0.0,
        "D_diagonal": 0.0,  # nobody looked
    }


@kernel
def model_wrenches(link, gravity, R, nu, C_nu, D_nu, g_eta):
    """Set C(nu) nu, D(nu) nu and g(eta), (6,) each [N, N m], of a link at its origin in its axes, from nu (6,).

    ``link`` is a record with M_RB, M_A, D_linear, D_quadratic, mass, displaced_mass, r_g and r_b, and whether M_A and
    the damping are diagonal; ``gravity`` (3,) [m/s^2] is in the axes in which R (3, 3) is the attitude of the link.
    """
    C_A_nu, M_A, D, Q = np.zeros_like(C_nu), link.M_A, link.D_linear, link.D_quadratic
    coriolis_rigid_body(link.M_RB, nu, C_nu)
    if link.A_diagonal != 0:
        for i in range(6):
            C_A_nu[i] = M_A[i, i] * nu[i]
        turn_momentum(nu, C_A_nu)
    else:
        coriolis_added_mass(M_A, nu, C_A_nu)
    C_nu += C_A_nu
    if link.D_diagonal != 0:
        for i in range(6):
            D_nu[i] = D[i, i] * nu[i] + Q[i, i] * (abs(nu[i]) * nu[i])
    else:
        damping(D, Q, nu, D_nu)
    restoring(link.mass, link.displaced_mass, link.r_g, link.r_b, gravity, R, g_eta)


@kernel
def reveal(coefficients, water, signals, truth, work):
    """Set a :data:`uvms_mj.stages.signals.TRUTH` record, except M, from the true coefficients; work is (6,) scratch.

    It is for eq. (13): velocity in the water and wrenches, which a real vehicle can't measure. In water that
    accelerates, g(eta) has the weight in gravity minus v_c_dot and the buoyancy in gravity minus a_c, both in W: with
    it, eq. (10) has the force of the water's acceleration on every vehicle (:mod:`uvms_mj.physics.hydrodynamics`).
    """
    nu, nu_r, nu_c_dot = signals.nu, truth.nu_r, truth.nu_c_dot
    relative_velocity(water, signals.R_WB, nu, nu_r)
    to_body(signals.R_WB, water.v_c_W, work)
    nu_c_dot[:3] = np.cross(work[:3], nu[3:])  # -omega x v_c
    gravity_W, R_WB = coefficients.gravity_W, signals.R_WB
    model_wrenches(coefficients, gravity_W, R_WB, nu_r, truth.C_nu_r, truth.D_nu_r, truth.g_eta)
    if water.unsteady != 0:
        to_body(signals.R_WB, water.v_c_dot_W, work)
        nu_c_dot[:3] += work[:3]
        accelerated_frame(coefficients, water, signals.R_WB, work, truth.g_eta, truth.tau_dist)
    truth.tau_dist[:] = water.tau_dist


@kernel
def accelerated_frame(coefficients, water, R_WB, work, g_eta, g_buoyancy):
    """Set g_eta (6,) to the restoring wrench in the frame of water that accelerates; work and g_buoyancy are (6,)
    scratch."""
    r_g, r_b = coefficients.r_g, coefficients.r_b
    for i in range(3):
        work[i] = coefficients.gravity_W[i] - water.a_c_W[i]
    restoring(0.0, coefficients.displaced_mass, r_g, r_b, work, R_WB, g_buoyancy)
    for i in range(3):
        work[i] = coefficients.gravity_W[i] - water.v_c_dot_W[i]
    restoring(coefficients.mass, 0.0, r_g, r_b, work, R_WB, g_eta)
    g_eta += g_buoyancy


@dataclass(frozen=True)
class Truth(Stage):
    """The truth for the ideal law. ``state`` is the record of the run."""

    name = "truth"
    room: ClassVar[Room] = Room("navigation", "truth", lambda thrusters: CLOCK + TRUE, TRUTH)

    def constants(self, setup: Any) -> Mapping[str, Any]:
        return {**coefficients(setup.vehicle, setup.gravity_W), "M": setup.design.M}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        out.M[:] = settings.M
        reveal(settings, state.plant.water, given, out, out.g_eta)
