"""Super-twisting off its rest: s on the way under a disturbance, and vibrations against a wall."""

import itertools
import math
from typing import Any

import numpy as np

_AMPLITUDES = np.geomspace(1e-5, 2e-2, 30)
"""Amplitudes of s [m/s]. The largest is that of an impact at a few decimetres per second."""
_LARGEST_S = 0.15
"""Largest s on the way with which eq. (7) still says where the vehicle goes [m/s or rad/s]."""
_STEP_S, _LONGEST_S = 5e-3, 60.0
"""Step and duration of the computation of s on the way [s]."""


def kept_near_zero(law: Any, times: np.ndarray, unknown: np.ndarray) -> str:
    """The reason why s does not stay near zero under unknown accelerations phi (n, 6) at times (n,) [s]: eqs. (24b)
    and (28), each axis by itself, from s = z = 0; empty if it stays."""
    t = np.arange(0.0, min(times[-1], _LONGEST_S), _STEP_S)
    s, z, largest = np.zeros(6), np.zeros(6), 0.0
    p, q = _STEP_S * law.k_1, 1.0 + _STEP_S * law.k_1 * law.beta
    for d in np.array([np.interp(t, times, each) for each in unknown.T]).T:  # implicit Euler: q root^2 + p root = ahead
        ahead = s + _STEP_S * (z + d)
        sgn, root = np.sign(ahead), (np.sqrt(p * p + 4.0 * q * np.abs(ahead)) - p) / (2.0 * q)
        s = sgn * root * root
        z = z - _STEP_S * law.k_2 * (sgn * (0.5 + 1.5 * law.beta * root) + law.beta**2 * s)
        largest = max(largest, float(np.abs(s).max()))
    if largest < _LARGEST_S:
        return ""
    return f"super-twisting does not follow the disturbance on the way: s comes to {largest:.2g} m/s or rad/s"


def bouncing_growth(law: Any, setup: Any) -> float:
    """Largest growth rate, over the amplitude of s, of a vibration against the wall under super-twisting [1/s].

    With the nominal control, the vehicle's response to a contact force is g = M^-1 M_hat times the one that M_d
    prescribes; without it, M_d/M times. If this is too small, super-twisting has to supply the rest at the contact's
    frequency. For an amplitude S, phi_1 and phi_2 have the slopes a = k_1 (S^(-1/2) + beta) and
    b = k_2 (1/(2 S) + 3/2 beta S^(-1/2) + beta^2). With K_c = k_c n n^T along the wall's normal, linearized at rest
    and for translation only,

        v_des_dot = -M_d^-1 ((K_f K_c + K_d) x + D_d v),    s_dot = A s + v_dot - v_des_dot,    z_dot = -b s,
        v_dot = g (v_des_dot - A s - a s + z), or without nominal control  -M^-1 (K_c x + D v) + g (z - a s).

    A positive value means that a vibration grows if it begins large enough; a small one always decays.
    """
    scenario, design = setup.scenario, setup.design
    M, M_d, D_d, K_d = (each[:3, :3] for each in (design.M, design.M_d, design.D_d, design.K_d))
    g = scenario.estimates.inertia * np.eye(3)
    if setup.vehicle is not setup.nominal:
        g = np.linalg.solve(M, design.M_hat[:3, :3])
    K_f = np.diag(scenario.impedance.at_end[0][:3])
    A, zero, one = np.diag(setup.task.A[:3]), np.zeros((3, 3)), np.eye(3)
    growing = np.hstack([zero, zero, A, zero])  # A s
    growth = [-math.inf]
    for contact, S in itertools.product(setup.contacts_at_rest, _AMPLITUDES):
        K_c = contact.stiffness * np.outer(contact.normal[:3], contact.normal[:3])
        desired = np.hstack([-np.linalg.solve(M_d, np.hstack([K_f @ K_c + K_d, D_d])), zero, zero])
        free = np.hstack([-np.linalg.solve(M, np.hstack([K_c, setup.vehicle.D_linear[:3, :3]])), zero, zero])
        a, b = law.slopes(S)
        u = g @ np.hstack([zero, zero, -a * one, one])
        v_dot = g @ (desired - growing) + u if law.nominal else free + u
        x_dot, z_dot = np.hstack([zero, one, zero, zero]), np.hstack([zero, zero, -b * one, zero])
        growth.append(np.linalg.eigvals(np.vstack([x_dot, v_dot, growing + v_dot - desired, z_dot])).real.max())
    return float(max(growth))
