"""The water on a vehicle with joints: the passes of :mod:`uvms_mj.physics.tree` over all links, and their results in
MuJoCo's coordinates, in which the base's linear velocity is in W."""

from ...physics.composite import add_composite, joint_column, own_inertia, whole
from ...physics.frames import to_body, to_world
from ...physics.hydrodynamics import added_inertia, relative_velocity
from ...physics.kernels import fused, kernel
from ...physics.tree import (
    add_to_base,
    along_joint,
    coriolis_wrench,
    damping_wrench,
    hand_down,
    move,
    move_frame,
    place,
    restoring_wrench,
)
from .layouts import FRAME_SIZE, LINK_SIZE
from .memory import floats, frame_at, integers, link_at, mj_factorM


@fused
def place_links(tree, q):
    """Set the frames of all links at the joint positions q (n,)."""
    for k in range(1, tree.links):
        frame = frame_at(tree.frames_at + FRAME_SIZE * k)
        place(frame, frame_at(tree.frames_at + FRAME_SIZE * frame.parent), q[k - 1])


@kernel
def move_links(tree, q_dot):
    """Set velocities and accelerations of all links from those of the base, and the joint velocities (n,)."""
    move_frame(link_at(tree.links_at), frame_at(tree.frames_at))
    for k in range(1, tree.links):
        link, frame = link_at(tree.links_at + LINK_SIZE * k), frame_at(tree.frames_at + FRAME_SIZE * k)
        move(link, frame.S, link_at(tree.links_at + LINK_SIZE * frame.parent), q_dot[k - 1])
        move_frame(link, frame)


@kernel
def compose_links(tree):
    """Set the composite inertias of all links."""
    for k in range(tree.links):
        own_inertia(link_at(tree.links_at + LINK_SIZE * k), frame_at(tree.frames_at + FRAME_SIZE * k))
    for k in range(tree.links - 1, 0, -1):
        frame = frame_at(tree.frames_at + FRAME_SIZE * k)
        add_composite(link_at(tree.links_at + LINK_SIZE * k), link_at(tree.links_at + LINK_SIZE * frame.parent))


@kernel
def gather_wrenches(tree, out):
    """Set out (6 + n,) to the generalised wrench of the wrenches F of all links, which are summed towards the base."""
    for k in range(tree.links - 1, 0, -1):
        link, frame = link_at(tree.links_at + LINK_SIZE * k), frame_at(tree.frames_at + FRAME_SIZE * k)
        out[5 + k] = along_joint(frame.S, link.F)
        hand_down(link, link_at(tree.links_at + LINK_SIZE * frame.parent))
    base = link_at(tree.links_at)
    for i in range(6):
        out[i] = base.F[i]


@fused
def add_tree_inertia(context, R_WB, model, data):
    """Add the links' added mass to mjData.M and factor it, unless M already contains it.

    A row of M has the entries of the base, of the joints from the base to the link, and of the link's own joint.
    """
    tree, M, left = context.tree, floats(context.M_at, context.M_size), context.M_left
    same = True
    for i in range(21):  # added mass of any link is added mass of the base
        if M[i] != left[i]:
            same = False
    if same:
        return
    compose_links(tree)
    whole(link_at(tree.links_at).composite, context.M_BB)
    added_inertia(context.M_BB, R_WB, context.added)
    for i in range(21):
        M[i] += context.added[i]
        left[i] = M[i]
    rows = integers(context.M_rows_at, tree.links)
    for k in range(1, tree.links):
        link, frame = link_at(tree.links_at + LINK_SIZE * k), frame_at(tree.frames_at + FRAME_SIZE * k)
        joint_column(link, frame.S)
        F, above, place_of = link.F, k, rows[k] + 5 + frame.depth
        for _ in range(frame.depth):
            joint = frame_at(tree.frames_at + FRAME_SIZE * above)
            M[place_of] += along_joint(joint.S, F)
            above = joint.parent
            place_of -= 1
        to_world(R_WB, F, context.work)
        for i in range(3):
            M[rows[k] + i] += context.work[i]
            M[rows[k] + 3 + i] += F[3 + i]
    mj_factorM(model, data)


@fused
def water_on_links(context, R_WB, out):
    """Set out (6 + n,) to the generalised wrench of the water in B, with the disturbance and the contacts of the
    links."""
    tree, water = context.tree, context.water
    base = link_at(tree.links_at)
    nu, a, gravity_W = base.V, base.A, context.work
    relative_velocity(water, R_WB, context.nu, nu)
    for i in range(6):
        context.nu_r[i] = nu[i]
        a[i] = 0.0
    if water.unsteady != 0:
        to_body(R_WB, water.v_c_dot_W, a)
    a[0] = -(nu[4] * nu[2] - nu[5] * nu[1] + a[0])  # omega x v_r + R^T v_c_dot
    a[1] = -(nu[5] * nu[0] - nu[3] * nu[2] + a[1])
    a[2] = -(nu[3] * nu[1] - nu[4] * nu[0] + a[2])
    for i in range(3):
        gravity_W[i] = context.gravity_W[i] - water.a_c_W[i]  # of the displaced water
    to_body(R_WB, gravity_W, tree.gravity_B)
    move_links(tree, floats(context.q_dot_at, tree.links - 1))
    for k in range(tree.links):
        link, frame = link_at(tree.links_at + LINK_SIZE * k), frame_at(tree.frames_at + FRAME_SIZE * k)
        F, part, other = link.F, context.work, link.work
        restoring_wrench(link, frame, tree.gravity_B, F)
        coriolis_wrench(link, part)
        damping_wrench(link, other)
        for i in range(6):
            part[i] += other[i]
        add_to_base(frame, part, F)
        for i in range(6):
            F[i] = link.f_ext[i] - F[i]
    for i in range(6):
        base.F[i] += water.tau_dist[i]
    gather_wrenches(tree, out)


@kernel
def apply_to_joints(context):
    """Add the generalised wrench of the joints to mjData.qfrc_passive, as :func:`.callback.apply_wrench` does."""
    n = context.tree.links - 1
    passive, wrench = floats(context.passive_at + 48, n), floats(context.wrench_at + 48, n)
    before, left = floats(context.joints_before_at, n), floats(context.joints_left_at, n)
    same = True
    for k in range(n):
        if passive[k] != left[k]:
            same = False
    for k in range(n):
        if not same:
            before[k] = passive[k]
        left[k] = before[k] + wrench[k]
        passive[k] = left[k]
