r"""Motion of one rigid vehicle with added mass: its acceleration, and a step of semi-implicit Euler.

The state belongs to MuJoCo's free joint: position and attitude, velocity v in W and omega in B. With
:math:`\dot\nu = [R^\top a_W - \omega \times v;\, \dot\omega]`, the rigid-body terms of the paper's eq. (10) become

.. math::

    M_{RB} \dot\nu + C_{RB}(\nu)\nu = M_{RB} \begin{bmatrix} R_{WB}^\top a_W \\ \dot\omega \end{bmatrix}
        + C_{RB}(\omega) \begin{bmatrix} 0 \\ \omega \end{bmatrix}.

The added mass belongs to the same acceleration (:mod:`.hydrodynamics`), so that the inertia is M = M_RB + M_A, constant
in B.

The wall's normal force is the force of MuJoCo's soft contact. With the acceleration a_0 along the normal n that all
other forces cause, the spring and damper force :math:`F_s = k_c \delta - b_c\, n^\top v` and the contact's softness R
[1/kg], MuJoCo solves

.. math::

    F_n = \max\left(0, \frac{R F_s - a_0}{R + n^\top M^{-1} n}\right).

For large R it is F_s. A contact with the constant impedance d of solimp has R = (1 - d)/d times the inverse rigid mass.
"""

import math

import numpy as np

from .fossen import coriolis_rigid_body, restoring
from .frames import multiply
from .kernels import kernel


@kernel
def free_acceleration(body, R_WB, nu, tau, qacc):
    """Set the free joint's acceleration qacc (6,) = [a_W; omega_dot] from the wrench tau (6,) at B's origin in B.

    Args:
        body: a record with M_RB, M_inv (6, 6), mass, r_g, gravity_W; the weight is added to tau.
        R_WB: (3, 3).
        nu: (6,) velocity in B [m/s, rad/s].
        tau: (6,) all other forces without rigid-body Coriolis forces [N, N m].
        qacc: (6,) output [m/s^2 in W, rad/s^2 in B].
    """
    turning, g_eta, C_nu = np.zeros(6), np.zeros(6), np.zeros(6)
    turning[3:] = nu[3:]
    restoring(body.mass, 0.0, body.r_g, body.r_g, body.gravity_W, R_WB, g_eta)
    coriolis_rigid_body(body.M_RB, turning, C_nu)
    nu_dot = body.M_inv @ (tau - g_eta - C_nu)
    qacc[:3], qacc[3:] = R_WB @ nu_dot[:3], nu_dot[3:]


@kernel
def soft_contact(body, contact, depth, R_WB, qvel, qacc) -> float:
    """Add the wall's normal force at B's origin to the free joint's acceleration qacc (6,), and return it [N].

    Args:
        body: a record with M_inv (6, 6) and softness R [1/kg].
        contact: a CONTACT record that touches, with the normal of the instant.
        depth: of the contact [m].
        R_WB: (3, 3).
        qvel: (6,) velocity of the free joint.
        qacc: (6,) acceleration by all other forces, [m/s^2 in W, rad/s^2 in B].
    """
    n = contact.normal_W
    n_B = R_WB.T @ n
    per_force = body.M_inv[:, :3] @ n_B  # acceleration by a unit force, in B
    yielding, a_0 = n_B @ per_force[:3], n @ qacc[:3]
    spring = contact.stiffness * depth - contact.damping * (n @ qvel[:3])
    f_n = max(0.0, (body.softness * spring - a_0) / (body.softness + yielding))
    qacc[:3] += f_n * (R_WB @ per_force[:3])
    qacc[3:] += f_n * per_force[3:]
    return f_n


@kernel
def symplectic_step(qpos, qvel, qacc, timestep):
    """Advance the velocity qvel (6,), and with the new velocity the pose qpos (7,), as MuJoCo's Euler integrator."""
    qvel += timestep * qacc
    qpos[:3] += timestep * qvel[:3]
    omega = qvel[3:]
    rate = math.sqrt(omega @ omega)
    if rate == 0.0:
        return
    half = 0.5 * timestep * rate
    scale = math.sin(half) / rate
    x, y, z = scale * omega
    multiply(qpos[3:], np.array([math.cos(half), x, y, z]), qpos[3:])
