"""The posture of a vehicle with joints as a stage of the loop: the torques in the motion that the task leaves free.

They include the bias h = C zeta + D zeta + g of this motion, so that the demands of the levels are left. They act
without ``controller.delay``, which delays the law alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ...control.posture import posture_constants
from ...physics.dense import cholesky, inverse, product
from ...physics.kernels import fused, kernel
from ...physics.posture import free_of_base, free_of_tool, posture
from ...stages.base import Room, Stage
from ...stages.signals import CLOCK, MEASURED, Signal


@dataclass(frozen=True)
class PostureBelowTool(Stage):
    """tau_posture = M (P h + a) below a task at a tool. ``given`` has the measurements at B; ``state`` is the
    record of the run. The levels know that the law gives -J_bar J_dot zeta, which keeps the tool's velocity."""

    name = "posture_below_tool"
    room: ClassVar[Room] = Room(
        "control",
        "posture",
        lambda thrusters: CLOCK + MEASURED,
        (Signal("tau_posture", (0,), "N, N m", "B", "wrench on the base and torques of the joints"),),
    )

    def constants(self, setup: Any) -> Mapping[str, Any]:
        return posture_constants(setup)

    @staticmethod
    @fused
    def step(settings, state, given, state_dot, out):
        model, own, q = state.model, state.model.posture, state.joints.q_m
        N, M = model.tau.shape[0], model.M
        measure(model, given, state.joints.q_dot_m)
        inverse(model.L, N, own.M_inv)
        free_of_tool(own.M_inv, model.MJ_T, model.J_bar, N, own.P)
        product(own.P, N, N, own.h, 1, own.free)
        product(model.J_bar, N, 6, model.J_dot_zeta, 1, own.a)
        for i in range(N):
            own.a[i] = -own.a[i]
            own.free[i] -= own.a[i]
        posture(settings, given, own.zeta, q, N, M, own.M_inv, own.P, own)
        for i in range(N):
            own.a[i] += own.free[i]
        product(M, N, N, own.a, 1, out)


@dataclass(frozen=True)
class PostureBesideBase(PostureBelowTool):
    """tau_posture = M a + [0; h_q] of a task at B, whose law compensates the rows of h for the base."""

    name = "posture_beside_base"

    @staticmethod
    @fused
    def step(settings, state, given, state_dot, out):
        model, own, q = state.model, state.model.posture, state.joints.q_m
        N, M, L = model.tau.shape[0], model.M, model.L
        measure(model, given, state.joints.q_dot_m)
        cholesky(M, N, L)
        inverse(L, N, own.M_inv)
        free_of_base(M, N, own.P_qq, own.X, own.P)
        for i in range(N):
            own.a[i] = 0.0
        posture(settings, given, own.zeta, q, N, M, own.M_inv, own.P, own)
        product(M, N, N, own.a, 1, out)
        for i in range(6, N):
            out[i] += own.h[i]


@kernel
def measure(model, given, q_dot):
    """Set zeta and h (N,) of the posture's memory from the measurements at B and the law's model."""
    N, own = model.tau.shape[0], model.posture
    for i in range(6):
        own.zeta[i] = given.nu[i]
    for k in range(q_dot.shape[0]):
        own.zeta[6 + k] = q_dot[k]
    for i in range(N):
        own.h[i] = model.C[i] + model.D[i] + model.g[i]
