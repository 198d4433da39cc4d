r"""Composite inertias of the links of a tree: the inertia of a link and all that it carries, about B's origin in B.

They are the I_k of :mod:`.tree`, as the blocks A, G, D (9, 3) of :math:`I = \begin{bmatrix} A & G \\ G^\top & D
\end{bmatrix}`.
"""

from .kernels import kernel


@kernel
def base_inertia(base):
    """Set the composite inertia of the base to its own."""
    M, J = base.M, base.composite
    for i in range(3):
        for j in range(3):
            J[i, j], J[3 + i, j], J[6 + i, j] = M[i, j], M[i, 3 + j], M[3 + i, 3 + j]


@kernel
def own_inertia(link, frame):
    r"""Set the composite inertia of a link behind a joint to its own, about B's origin in B.

    With the blocks A, B, D of the inertia in B's axes and S = S(p), X^T M X has the blocks A, G = B - A S and
    D - B^T S + S G.
    """
    M, R, p, J = link.M, frame.R_BL, frame.p_BL, link.composite
    if link.M_diagonal != 0:
        turn_diagonal(M, R, p, J)
        return
    turn_blocks(M, R, J)
    x, y, z = p[0], p[1], p[2]
    for i in range(3):
        a, b, c = J[3, i], J[4, i], J[5, i]
        J[6 + i, 0] -= b * z - c * y
        J[6 + i, 1] -= c * x - a * z
        J[6 + i, 2] -= a * y - b * x
    for i in range(3):
        a, b, c = J[i, 0], J[i, 1], J[i, 2]
        J[3 + i, 0] -= b * z - c * y
        J[3 + i, 1] -= c * x - a * z
        J[3 + i, 2] -= a * y - b * x
    for j in range(3):
        a, b, c = J[3, j], J[4, j], J[5, j]
        J[6, j] += y * c - z * b
        J[7, j] += z * a - x * c
        J[8, j] += x * b - y * a


@kernel
def turn_diagonal(M, R, p, J):
    """Set J (9, 3) as :func:`own_inertia` does, for a diagonal inertia M (6, 6), whose block B is zero."""
    x, y, z = p[0], p[1], p[2]
    a, b, c, d, e, f, g, h, k = R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2], R[2, 0], R[2, 1], R[2, 2]
    m_0, m_1, m_2, m_3, m_4, m_5 = M[0, 0], M[1, 1], M[2, 2], M[3, 3], M[4, 4], M[5, 5]
    u, v, w = m_0 * a, m_1 * b, m_2 * c
    A_xx, A_xy, A_xz = u * a + v * b + w * c, u * d + v * e + w * f, u * g + v * h + w * k
    u, v, w = m_0 * d, m_1 * e, m_2 * f
    A_yy, A_yz, A_zz = u * d + v * e + w * f, u * g + v * h + w * k, m_0 * g * g + m_1 * h * h + m_2 * k * k
    u, v, w = m_3 * a, m_4 * b, m_5 * c
    D_xx, D_xy, D_xz = u * a + v * b + w * c, u * d + v * e + w * f, u * g + v * h + w * k
    u, v, w = m_3 * d, m_4 * e, m_5 * f
    D_yy, D_yz, D_zz = u * d + v * e + w * f, u * g + v * h + w * k, m_3 * g * g + m_4 * h * h + m_5 * k * k
    G_xx, G_xy, G_xz = A_xz * y - A_xy * z, A_xx * z - A_xz * x, A_xy * x - A_xx * y
    G_yx, G_yy, G_yz = A_yz * y - A_yy * z, A_xy * z - A_yz * x, A_yy * x - A_xy * y
    G_zx, G_zy, G_zz = A_zz * y - A_yz * z, A_xz * z - A_zz * x, A_yz * x - A_xz * y
    D_xx, D_xy, D_xz = D_xx + (y * G_zx - z * G_yx), D_xy + (y * G_zy - z * G_yy), D_xz + (y * G_zz - z * G_yz)
    D_yy, D_yz = D_yy + (z * G_xy - x * G_zy), D_yz + (z * G_xz - x * G_zz)
    D_zz = D_zz + (x * G_yz - y * G_xz)
    J[0, 0], J[0, 1], J[0, 2], J[1, 0], J[1, 1], J[1, 2] = A_xx, A_xy, A_xz, A_xy, A_yy, A_yz
    J[2, 0], J[2, 1], J[2, 2], J[3, 0], J[3, 1], J[3, 2] = A_xz, A_yz, A_zz, G_xx, G_xy, G_xz
    J[4, 0], J[4, 1], J[4, 2], J[5, 0], J[5, 1], J[5, 2] = G_yx, G_yy, G_yz, G_zx, G_zy, G_zz
    J[6, 0], J[6, 1], J[6, 2], J[7, 0], J[7, 1], J[7, 2] = D_xx, D_xy, D_xz, D_xy, D_yy, D_yz
    J[8, 0], J[8, 1], J[8, 2] = D_xz, D_yz, D_zz


@kernel
def turn_blocks(M, R, out):
    """Set out (9, 3) to R (block) R^T of the blocks A, B and D of an inertia M (6, 6)."""
    for block in range(3):
        first, second = 3 * (block // 2), 3 * ((block + 1) // 2)
        for i in range(3):
            for j in range(3):
                a, b, c = M[first, second + j], M[first + 1, second + j], M[first + 2, second + j]
                out[3 * block + i, j] = R[i, 0] * a + R[i, 1] * b + R[i, 2] * c
        for i in range(3):
            a, b, c = out[3 * block + i, 0], out[3 * block + i, 1], out[3 * block + i, 2]
            for j in range(3):
                out[3 * block + i, j] = a * R[j, 0] + b * R[j, 1] + c * R[j, 2]


@kernel
def add_composite(link, parent):
    """Add the composite inertia of a link to that of its parent."""
    own, out = link.composite, parent.composite
    for i in range(9):
        for j in range(3):
            out[i, j] += own[i, j]


@kernel
def whole(blocks, M):
    """Set M (6, 6) to the inertia with the blocks (9, 3) of a composite inertia."""
    for i in range(3):
        for j in range(3):
            M[i, j], M[3 + i, 3 + j] = blocks[i, j], blocks[6 + i, j]
            M[i, 3 + j], M[3 + j, i] = blocks[3 + i, j], blocks[3 + i, j]


@kernel
def joint_column(link, S):
    """Set F of a link to its composite inertia times the motion S (6,) of its joint: the wrench that accelerates the
    joint alone."""
    J, F, x, y, z, a, b, c = link.composite, link.F, S[0], S[1], S[2], S[3], S[4], S[5]
    for i in range(3):
        F[i] = (J[i, 0] * x + J[i, 1] * y + J[i, 2] * z) + (J[3 + i, 0] * a + J[3 + i, 1] * b + J[3 + i, 2] * c)
        turned = J[3, i] * x + J[4, i] * y + J[5, i] * z
        F[3 + i] = turned + (J[6 + i, 0] * a + J[6 + i, 1] * b + J[6 + i, 2] * c)


@kernel
def compose_links(links, frames):
    """Set the composite inertias of all links (1 + n,), base first."""
    base_inertia(links[0])
    for k in range(1, links.shape[0]):
        own_inertia(links[k], frames[k])
    for k in range(links.shape[0] - 1, 0, -1):
        add_composite(links[k], links[frames[k].parent])
