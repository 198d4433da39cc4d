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
from .memory import floats, mj_factorM


@fused
def place_links(frames, q, first):
    """Set the frames (1 + n,) of all links at the joint positions, which are in q from the index ``first`` on."""
    for k in range(1, frames.shape[0]):
        place(frames[k], frames[frames[k].parent], q[first + k - 1])


@kernel
def move_links(links, frames, q_dot, first):
    """Set velocities and accelerations of all links from those of the base and the joint velocities, which are in q_dot
    from the index ``first`` on."""
    move_frame(links[0], frames[0])
    for k in range(1, links.shape[0]):
        link, frame = links[k], frames[k]
        move(link, frame.S, links[frame.parent], q_dot[first + k - 1])
        move_frame(link, frame)


@kernel
def compose_links(links, frames):
    """Set the composite inertias of all links."""
    for k in range(links.shape[0]):
        own_inertia(links[k], frames[k])
    for k in range(links.shape[0] - 1, 0, -1):
        add_composite(links[k], links[frames[k].parent])


@kernel
def gather_wrenches(links, frames, out):
    """Set out (6 + n,) to the generalised wrench of the wrenches F of all links, which are summed towards the base."""
    for k in range(links.shape[0] - 1, 0, -1):
        link, frame = links[k], frames[k]
        out[5 + k] = along_joint(frame.S, link.F)
        hand_down(link, links[frame.parent])
    for i in range(6):
        out[i] = links[0].F[i]


@fused
def add_tree_inertia(plant, model, data):
    """Add the links' added mass to mjData.M and factor it, unless M already contains it.

    A row of M has the entries of the base, of the joints from the base to the link, and of the link's own joint.
    """
    links, frames, R_WB, left, n = plant.links, plant.frames, plant.R_WB, plant.M_left, plant.links.shape[0] - 1
    M = floats(plant.mujoco.M_at, plant.M_rows[n] + 6 + n)
    same = True
    for i in range(21):  # added mass of any link is added mass of the base
        if M[i] != left[i]:
            same = False
    if same:
        return
    compose_links(links, frames)
    whole(links[0].composite, plant.M_BB)
    added_inertia(plant.M_BB, R_WB, plant.added)
    for i in range(21):
        M[i] += plant.added[i]
        left[i] = M[i]
    for k in range(1, n + 1):
        link, frame, row = links[k], frames[k], plant.M_rows[k]
        joint_column(link, frame.S)
        F, above, place_of = link.F, k, row + 5 + frame.depth
        for _ in range(frame.depth):
            joint = frames[above]
            M[place_of] += along_joint(joint.S, F)
            above = joint.parent
            place_of -= 1
        to_world(R_WB, F, plant.work)
        for i in range(3):
            M[row + i] += plant.work[i]
            M[row + 3 + i] += F[3 + i]
    mj_factorM(model, data)


@fused
def water_on_links(plant, out):
    """Set out (6 + n,) to the generalised wrench of the water in B, with the disturbance and the contacts of the
    links."""
    links, frames, R_WB, water = plant.links, plant.frames, plant.R_WB, plant.water
    base = links[0]
    nu, a, gravity_W = base.V, base.A, plant.work
    relative_velocity(water, R_WB, plant.nu, nu)
    for i in range(6):
        plant.nu_r[i] = nu[i]
        a[i] = 0.0
    if water.unsteady != 0:
        to_body(R_WB, water.v_c_dot_W, a)
    a[0] = -(nu[4] * nu[2] - nu[5] * nu[1] + a[0])  # omega x v_r + R^T v_c_dot
    a[1] = -(nu[5] * nu[0] - nu[3] * nu[2] + a[1])
    a[2] = -(nu[3] * nu[1] - nu[4] * nu[0] + a[2])
    for i in range(3):
        gravity_W[i] = plant.gravity_W[i] - water.a_c_W[i]  # of the displaced water
    to_body(R_WB, gravity_W, plant.gravity_B)
    move_links(links, frames, plant.qvel, 6)
    for k in range(links.shape[0]):
        link, frame = links[k], frames[k]
        F, part, other = link.F, plant.work, link.work
        restoring_wrench(link, frame, plant.gravity_B, F)
        coriolis_wrench(link, part)
        damping_wrench(link, other)
        for i in range(6):
            part[i] += other[i]
        add_to_base(frame, part, F)
        for i in range(6):
            F[i] = link.f_ext[i] - F[i]
    for i in range(6):
        base.F[i] += water.tau_dist[i]
    gather_wrenches(links, frames, out)
