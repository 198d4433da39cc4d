r"""The model of a law for a vehicle with joints or a tool: the equations of the plant with the estimated coefficients,
at the measured state.

M, C, D and g of the tree are in :math:`\zeta = [\nu; \dot q]`. At a tool, Lambda and the task's bias take their place
(:mod:`uvms_mj.physics.operational`).
"""

from ...physics.composite import joint_column, whole
from ...physics.dense import product, transposed_product
from ...physics.frames import compose_poses, motion_at, to_body
from ...physics.kernels import kernel
from ...physics.operational import base_rows, task_inertia
from ...physics.tree import add_to_base, along_joint, coriolis_wrench, damping_wrench, restoring_wrench
from .layouts import FRAME_SIZE, LINK_SIZE
from .memory import floats, frame_at, link_at
from .tree import compose_links, move_links, place_links


@kernel
def move_model(model, R_WB, nu):
    """Set poses, velocities and accelerations of all links from the measured state."""
    base = link_at(model.tree.links_at)
    for i in range(6):
        base.V[i] = nu[i]
        base.A[i] = 0.0
    to_body(R_WB, model.gravity_W, model.tree.gravity_B)
    if model.places != 0:
        place_links(model.tree, floats(model.q_at, model.n))
    move_links(model.tree, floats(model.q_dot_at, model.n))


@kernel
def estimate_wrenches(model):
    """Set C zeta, D zeta and g (N,), whose wrenches on the links are summed towards the base."""
    tree, n, N, work = model.tree, model.n, model.tau.shape[0], model.work
    C, D, g = floats(model.C_at, N), floats(model.D_at, N), floats(model.g_at, N)
    gear, q_dot = floats(model.gear_at, n), floats(model.q_dot_at, n)
    for k in range(tree.links):
        link, frame = link_at(tree.links_at + LINK_SIZE * k), frame_at(tree.frames_at + FRAME_SIZE * k)
        for i in range(6):
            link.F_C[i], link.F_D[i] = 0.0, 0.0
        coriolis_wrench(link, work)
        add_to_base(frame, work, link.F_C)
        damping_wrench(link, work)
        add_to_base(frame, work, link.F_D)
        restoring_wrench(link, frame, tree.gravity_B, link.F)
    for k in range(n, 0, -1):
        link, frame = link_at(tree.links_at + LINK_SIZE * k), frame_at(tree.frames_at + FRAME_SIZE * k)
        parent = link_at(tree.links_at + LINK_SIZE * frame.parent)
        C[5 + k] = along_joint(frame.S, link.F_C)
        D[5 + k] = along_joint(frame.S, link.F_D) + gear[k - 1] * q_dot[k - 1]
        g[5 + k] = along_joint(frame.S, link.F)
        for i in range(6):
            parent.F_C[i] += link.F_C[i]
            parent.F_D[i] += link.F_D[i]
            parent.F[i] += link.F[i]
    base = link_at(tree.links_at)
    for i in range(6):
        C[i], D[i], g[i] = base.F_C[i], base.F_D[i], base.F[i]


@kernel
def estimate_inertia(model):
    """Set M (N, N)."""
    tree, N = model.tree, model.tau.shape[0]
    M = floats(model.M_at, N * N)
    armature = floats(model.armature_at, model.n)
    compose_links(tree)
    whole(link_at(tree.links_at).composite, model.M_BB)
    for i in range(6):
        for j in range(6):
            M[N * i + j] = model.M_BB[i, j]
    for k in range(1, tree.links):
        link, frame = link_at(tree.links_at + LINK_SIZE * k), frame_at(tree.frames_at + FRAME_SIZE * k)
        row, above = 5 + k, k
        for j in range(6, row):
            M[N * row + j] = 0.0
            M[N * j + row] = 0.0
        joint_column(link, frame.S)
        F = link.F
        for _ in range(frame.depth):
            joint = frame_at(tree.frames_at + FRAME_SIZE * above)
            entry = along_joint(joint.S, F)
            M[N * row + 5 + above] = entry
            M[N * (5 + above) + row] = entry
            above = joint.parent
        M[N * row + row] += armature[k - 1]
        for j in range(6):
            M[N * row + j] = F[j]
            M[N * j + row] = F[j]


@kernel
def place_tool(model):
    """Set the pose of the tool in B, and J^T (N, 6)."""
    tree, tool, J_T = model.tree, model.tool, floats(model.J_T_at, 6 * model.tau.shape[0])
    frame = frame_at(tree.frames_at + FRAME_SIZE * tool.link)
    compose_poses(frame.R_BL, frame.p_BL, tool.R_LT, tool.p_LT, tool.R_BT, tool.p_BT)
    base_rows(tool, J_T)
    above = tool.link
    for _ in range(frame.depth):  # the rows of all other joints are zero
        joint = frame_at(tree.frames_at + FRAME_SIZE * above)
        motion_at(tool.R_BT, tool.p_BT, joint.S, floats(model.J_T_at + 48 * (5 + above), 6))
        above = joint.parent


@kernel
def estimate_at_body(model, out):
    """Set the estimates at B: the rows of the base."""
    N = model.tau.shape[0]
    M, C, D, g = floats(model.M_at, N * N), floats(model.C_at, N), floats(model.D_at, N), floats(model.g_at, N)
    for i in range(6):
        out.C_hat_nu[i], out.D_hat_nu[i], out.g_hat[i] = C[i], D[i], g[i]
        for j in range(6):
            out.M_hat[i, j] = M[N * i + j]


@kernel
def estimate_lambda(model):
    """Set Lambda and M^-1 J^T from M and J."""
    N = model.tau.shape[0]
    J_T, MJ_T, J_bar = floats(model.J_T_at, 6 * N), floats(model.MJ_T_at, 6 * N), floats(model.J_bar_at, 6 * N)
    M, L = floats(model.M_at, N * N), floats(model.L_at, N * N)
    task_inertia(M, N, J_T, L, MJ_T, model.L_task, model.Lambda, J_bar, model.manipulability)


@kernel
def estimate_at_tool(model, out):
    """Set the estimates at the tool: Lambda, and J_bar^T h - Lambda J_dot zeta, whose last term is that of C."""
    N = model.tau.shape[0]
    Lambda, work, J_bar = model.Lambda, model.work, floats(model.J_bar_at, 6 * N)
    tool, link = model.tool, link_at(model.tree.links_at + LINK_SIZE * model.tool.link)
    motion_at(tool.R_BT, tool.p_BT, link.V, model.nu_T)
    motion_at(tool.R_BT, tool.p_BT, link.A, model.J_dot_zeta)
    transposed_product(J_bar, N, 6, floats(model.C_at, N), out.C_hat_nu)
    transposed_product(J_bar, N, 6, floats(model.D_at, N), out.D_hat_nu)
    transposed_product(J_bar, N, 6, floats(model.g_at, N), out.g_hat)
    product(Lambda, 6, 6, model.J_dot_zeta, 1, work)
    for i in range(6):
        out.C_hat_nu[i] -= work[i]
        for j in range(6):
            out.M_hat[i, j] = Lambda[6 * i + j]
