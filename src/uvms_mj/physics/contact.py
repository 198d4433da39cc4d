r"""Force between a wall and one contact point of a vehicle, from the state of the same instant.

The force along the normal n, which points out of the wall, is that of the spring and damper of the paper's eq. (34),

.. math::

    F_n = \max(0, k_c \delta - b_c\, n^\top v)

with the depth :math:`\delta` and the velocity v of the contact point. MuJoCo's contact solver applies this force. This
module also computes the Coulomb friction along the face, with a tangential spring and damper (Cundall and Strack, 1979,
*Geotechnique* 29, 47-65). The stretch :math:`\xi` follows the contact point's motion along the face. The spring force
can't exceed the Coulomb limit, so the stretch is reduced while the contact slips:

.. math::

    \xi \leftarrow \xi \min\left(1, \frac{\mu F_n}{k_t |\xi|}\right), \qquad
    F_t = -(k_t \xi + b_t v_t) \min\left(1, \frac{\mu F_n}{|k_t \xi + b_t v_t|}\right)

While the contact slips, F_t has the size mu F_n and opposes the slip. While it sticks, it yields by F_t/k_t and does
not creep. Spring, damper and slider together never return more energy than they were given.
"""

import math

import numpy as np

from .frames import to_body, to_world
from .kernels import kernel

CONTACT = np.dtype(
    [
        ("stiffness", "f8"),  # k_c [N/m]
        ("damping", "f8"),  # b_c [N s/m]
        ("friction", "f8"),  # mu [1]
        ("tangential_stiffness", "f8"),  # k_t [N/m]
        ("tangential_damping", "f8"),  # b_t [N s/m]
        ("touching", "i8"),  # whether the point is in the wall
        ("normal_W", "f8", (3,)),  # out of the wall
        ("arm_W", "f8", (3,)),  # from B's origin to the contact point [m]
        ("stretch_W", "f8", (3,)),  # of the tangential spring [m]
        ("f_tangential_W", "f8", (3,)),  # friction force on the vehicle [N]
        ("f_W", "f8", (3,)),  # total force of the wall on the vehicle [N]
        ("tau_B", "f8", (6,)),  # f_W as a wrench at B's origin, in B [N, N m]
        ("work", "f8", (3,)),  # scratch
    ],
    align=True,
)
"""One contact point: settings of the wall, stretch of the spring, and force of the latest instant."""


@kernel
def release(contact):
    """Set the force of a contact point that is not in the wall."""
    if contact.touching != 0:
        contact.touching = 0
        for i in range(3):
            contact.stretch_W[i] = 0.0
            contact.f_tangential_W[i] = 0.0
            contact.f_W[i] = 0.0
            contact.tau_B[i] = 0.0
            contact.tau_B[i + 3] = 0.0


@kernel
def point_velocity(R_WB, nu, arm_W, v_W):
    """Set v_W (3,), the velocity in W of the point of the vehicle at arm_W (3,) from B's origin [m/s]."""
    to_body(R_WB, arm_W, v_W)
    a_x = nu[0] + nu[4] * v_W[2] - nu[5] * v_W[1]  # v + omega x arm, in B
    a_y = nu[1] + nu[5] * v_W[0] - nu[3] * v_W[2]
    a_z = nu[2] + nu[3] * v_W[1] - nu[4] * v_W[0]
    v_W[0], v_W[1], v_W[2] = a_x, a_y, a_z
    to_world(R_WB, v_W, v_W)


@kernel
def press(contact, f_n, v_n, R_WB, timestep):
    """Set the force of a contact point in the wall, and advance the stretch of its spring.

    Args:
        contact: a CONTACT record; normal_W and arm_W are set, and work is the velocity relative to the wall in W.
        f_n: normal force [N].
        v_n: velocity relative to the wall along the normal [m/s].
        R_WB: (3, 3) attitude.
        timestep: [s].
    """
    n, v = contact.normal_W, contact.work
    for i in range(3):
        v[i] -= v_n * n[i]
        contact.f_W[i] = f_n * n[i]
    if contact.friction > 0.0:
        friction(contact, f_n, v, timestep)
        for i in range(3):
            contact.f_W[i] += contact.f_tangential_W[i]
    contact.touching = 1
    wrench_at_origin(R_WB, contact.arm_W, contact.f_W, v, contact.tau_B)


@kernel
def friction(contact, f_n, v_t, timestep):
    """Set stretch_W and f_tangential_W from the normal force [N] and the slip velocity (3,) in W [m/s]."""
    xi, f, n = contact.stretch_W, contact.f_tangential_W, contact.normal_W
    limit = contact.friction * f_n
    if contact.touching != 0:
        out = 0.0
        for i in range(3):
            xi[i] += timestep * v_t[i]
            out += n[i] * xi[i]
        for i in range(3):  # the face may have turned
            xi[i] -= out * n[i]
    held = contact.tangential_stiffness * math.sqrt(xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2])
    if held > limit:
        for i in range(3):
            xi[i] *= limit / held
    for i in range(3):
        f[i] = -contact.tangential_stiffness * xi[i] - contact.tangential_damping * v_t[i]
    size = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
    if size > limit:
        for i in range(3):
            f[i] *= limit / size


@kernel
def wrench_at_origin(R_WB, arm_W, f_W, work, tau):
    """Set tau (6,) [N, N m], the wrench in B at its origin of a force f_W (3,) at arm_W (3,); work is (3,) scratch."""
    to_body(R_WB, f_W, tau)
    to_body(R_WB, arm_W, work)
    tau[3] = work[1] * tau[2] - work[2] * tau[1]
    tau[4] = work[2] * tau[0] - work[0] * tau[2]
    tau[5] = work[0] * tau[1] - work[1] * tau[0]
