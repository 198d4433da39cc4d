r"""All contacts of a vehicle: the force between one surface and one contact body, and the pairs of a run.

**Force of one contact.** It follows from the state of the same instant. A contact body is a sphere, or a capsule: all
points within a radius of a segment. It is fixed to a frame C, which is B for a rigid vehicle. The depth is
:math:`\delta = r - d`, with the distance d of the sphere's centre, or of the nearest point of the segment, from the
surface (:mod:`.surfaces`). The contact point is halfway between the two surfaces, and its velocity v is relative to the
wall, which may move. The wall yields by w, and the bumper of the contact body, in series with it, by x:

.. math::

    \delta = w + x, \qquad F_n = \max(0, F_c(w) + b_c \dot w) = \max(0, k_b x + b_b \dot x), \qquad
    F_c(w) = \begin{cases} k_c w & w \le w_1 \\ k_c w_1 + k_1 (w - w_1) & w > w_1 \end{cases}

In place of spring and damper a wall without a bumper may have Hunt and Crossley's contact,
:math:`F_n = \max(0, k\, \delta^n (1 + a\, \dot\delta))`, with n = 1, or 3/2 of Hertz.
A wall of one layer has :math:`w_1 = \infty`. A body without a bumper has x = 0. Otherwise x is a state. It follows from
the balance of both forces by one step of implicit Euler, which is stable for any step, exact without dampers and for a
motion of constant speed:

.. math::

    \frac{b_b + b_c}{h} (x_k - x_{k-1}) + k_b x_k = F_c(\delta_k - x_k) + b_c \dot\delta_k

Without contact the bumper returns by itself, :math:`k_b x + b_b \dot x = 0`, and the wall at once.

**Friction** is Coulomb's law with a tangential spring and damper (Cundall and Strack, 1979, *Geotechnique* 29, 47-65).
The stretch :math:`\xi` follows the contact point's motion along the face. The spring force can't exceed the Coulomb
limit, so the stretch is reduced while the contact slips:

.. math::

    \xi \leftarrow \xi \min\left(1, \frac{\mu F_n}{k_t |\xi|}\right), \qquad
    F_t = -(k_t \xi + b_t v_t) \min\left(1, \frac{\mu F_n}{|k_t \xi + b_t v_t|}\right)

A contact that sticks begins to slip at its coefficient of breakaway, mu unless it is given. While the contact slips,
F_t has the size mu F_n and opposes the slip. While it sticks, it yields by F_t/k_t and does
not creep. Spring, damper and slider together never return more energy than they were given.

**Contacts of a run.** They are the sphere about the origin of the task's frame in front of ``[wall]``, and every
contact body in front of every wall. A record of a run has the surfaces, the pairs of a body and a surface, and the
frames that the bodies are fixed to. The normal force of a pair that is marked ``solved`` is applied by the engine,
MuJoCo's contact solver or its closed form; all other forces act here, on the base or on a link. The force that acted in
a step is known when the step is over.

A contact is computed in the frame C that its body is fixed to, as a rigid vehicle is in B: B itself, the frame of a
link, or the frame of a site.
"""

import math

import numpy as np

from .frames import add_wrench_from, compose_poses, cross, motion_at, to_world, velocity_at
from .kernels import kernel
from .surfaces import move, nearest_on_segment, signed_distance, surface_velocity

CONTACT = np.dtype(
    [
        ("stiffness", "f8"),  # k_c [N/m]
        ("damping", "f8"),  # b_c [N s/m]
        ("friction", "f8"),  # mu [1]
        ("breakaway", "f8"),  # by how much more it sticks than it slips [1]
        ("tangential_stiffness", "f8"),  # k_t [N/m]
        ("tangential_damping", "f8"),  # b_t [N s/m]
        ("touching", "i8"),  # whether the point is in the wall
        ("slipping", "i8"),  # whether it slips along the wall
        ("normal_W", "f8", (3,)),  # out of the wall
        ("arm_W", "f8", (3,)),  # from B's origin to the contact point [m]
        ("stretch_W", "f8", (3,)),  # of the tangential spring [m]
        ("f_tangential_W", "f8", (3,)),  # friction force on the vehicle [N]
        ("f_W", "f8", (3,)),  # total force of the wall on the vehicle [N]
        ("tau_B", "f8", (6,)),  # f_W as a wrench at B's origin, in B [N, N m]
    ],
    align=True,
)
"""One contact point: settings of the wall, stretch of the spring, and force of the latest instant."""


PAIR = np.dtype(
    [
        ("contact", CONTACT),
        ("surface", "i8"),  # index of the SURFACE
        ("capsule", "i8"),  # whether the body has two ends
        ("carrier", "i8"),  # index of the frame C that the body is fixed to
        ("solved", "i8"),  # whether the engine's contact solver applies the normal force
        ("ends_C", "f8", (2, 3)),  # of the segment, or the centre, in C [m]
        ("radius", "f8"),  # [m]
        ("power", "f8"),  # n of a contact with restitution, 1 or 3/2; 0 of a spring and a damper
        ("dissipation", "f8"),  # a [s/m]
        ("layer_depth", "f8"),  # w_1 [m]
        ("layer_stiffness", "f8"),  # k_1 [N/m]
        ("bumper_stiffness", "f8"),  # k_b [N/m], or 0 without a bumper
        ("bumper_damping", "f8"),  # b_b [N s/m]
        ("compression", "f8"),  # x, of the bumper [m]
        ("depth", "f8"),  # delta, or 0 [m]
        ("f_n", "f8"),  # normal force [N]
        ("centre_W", "f8", (3,)),
    ],
    align=True,
)
"""One contact body in front of one surface: settings, state, and force of the latest instant."""


@kernel
def pair_force(pair, surface, p_WC, R_WC, nu, timestep):
    """Set the force of a contact body at this instant, and advance the states of the contact. Call it once per step.

    Args:
        pair: a PAIR record.
        surface: its SURFACE record, at this instant.
        p_WC: (3,) position of C's origin [m].
        R_WC: (3, 3) attitude of C.
        nu: (6,) velocity of C, in C [m/s, rad/s].
        timestep: [s].
    """
    contact, c = pair.contact, pair.centre_W
    n, arm, v, v_wall = contact.normal_W, contact.arm_W, np.zeros(3), np.zeros(3)
    to_world(R_WC, pair.ends_C[0], c)
    c += p_WC
    if pair.capsule != 0:
        nearest_of_capsule(pair, surface, p_WC, R_WC)
    distance = signed_distance(surface, c, n) - pair.radius
    pair.depth = max(0.0, -distance)
    pair.f_n = 0.0
    if distance >= 0.0 or -distance <= recovered(pair, timestep):
        pair.compression = recovered(pair, timestep)
        release(contact)
        return
    arm[:] = c - p_WC - (pair.radius + 0.5 * distance) * n
    point_velocity(R_WC, nu, arm, v)
    surface_velocity(surface, p_WC + arm, v_wall)
    v -= v_wall
    v_n = n @ v
    pair.f_n = series_force(pair, -distance, -v_n, timestep)
    if surface.turns != 0 and contact.touching != 0:
        turn_stretch(contact.stretch_W, timestep * surface.omega_W)
    press(contact, pair.f_n, v - v_n * n, R_WC, timestep)


AT_REST = np.dtype(
    [
        ("p_WC", "f8", (3,)),
        ("R_WC", "f8", (3, 3)),
        ("nu", "f8", (6,)),  # velocity of C, in C [m/s, rad/s]
        ("tau_C", "f8", (6,)),  # of the contact on its body, at C's origin in C [N, N m]
        ("f_n", "f8"),  # [N]
        ("depth", "f8"),  # [m]
    ],
    align=True,
)
"""A contact body at a pose and a velocity of its frame C, and the force on it."""


@kernel
def press_at_rest(pairs, surfaces, at_rest, pair_count, pose_count):
    """Set the forces of contacts without friction in ``at_rest`` (m, n): of each pair at each pose and velocity. After
    an infinite time a bumper has settled."""
    for i in range(pose_count):
        for k in range(pair_count):
            pair, found = pairs[k], at_rest[i, k]
            pair_force(pair, surfaces[pair.surface], found.p_WC, found.R_WC, found.nu, np.inf)
            found.f_n, found.depth, found.tau_C[:] = pair.f_n, pair.depth, 0.0
            if pair.contact.touching != 0:
                found.tau_C[:] = pair.contact.tau_B


@kernel
def turn_stretch(xi, angle):
    """Turn a stretch xi (3,), which is fixed to the wall, by a small rotation vector (3,), without a change of its
    length: by Cayley's transform."""
    half = 0.5 * angle
    moved = cross(half, xi)
    xi += 2.0 / (1.0 + half @ half) * (moved + cross(half, moved))


@kernel
def nearest_of_capsule(pair, surface, p_WC, R_WC):
    """Move the centre from the first end to the point of the segment that is nearest to the surface."""
    c, end = pair.centre_W, np.zeros(3)
    to_world(R_WC, pair.ends_C[1], end)
    end += p_WC
    c += nearest_on_segment(surface, c, end) * (end - c)


@kernel
def recovered(pair, timestep) -> float:
    """The bumper's compression after one more step without contact [m]."""
    if pair.bumper_damping == 0.0:
        return 0.0
    return pair.compression / (1.0 + timestep * pair.bumper_stiffness / pair.bumper_damping)


@kernel
def series_force(pair, depth, rate, timestep) -> float:
    """The normal force [N] of wall and bumper at a depth [m] that grows with a rate [m/s]; advances the bumper."""
    k, b, f_0 = pair.contact.stiffness, pair.contact.damping, 0.0
    k_b, b_b, x_0 = pair.bumper_stiffness, pair.bumper_damping, pair.compression
    if pair.power > 0.0:
        if pair.power > 1.0:
            k *= math.sqrt(depth)
        return max(0.0, k * depth * (1.0 + pair.dissipation * rate))
    if k_b == 0.0:
        if depth > pair.layer_depth:
            f_0 = (k - pair.layer_stiffness) * pair.layer_depth
            k = pair.layer_stiffness
        return max(0.0, f_0 + k * depth + b * rate)
    held = (b + b_b) / timestep
    x = (held * x_0 + k * depth + b * rate) / (held + k_b + k)
    if depth - x > pair.layer_depth:
        f_0 = (k - pair.layer_stiffness) * pair.layer_depth
        k = pair.layer_stiffness
        x = (held * x_0 + f_0 + k * depth + b * rate) / (held + k_b + k)
    f_n = k_b * x + b_b * (x - x_0) / timestep
    if f_n <= 0.0:
        pair.compression = recovered(pair, timestep)
        return 0.0
    pair.compression = x
    return f_n


@kernel
def release(contact):
    """Set the force of a contact point that is not in the wall."""
    if contact.touching != 0:
        contact.touching, contact.slipping = 0, 0
        contact.stretch_W[:], contact.f_tangential_W[:] = 0.0, 0.0
        contact.f_W[:], contact.tau_B[:] = 0.0, 0.0


@kernel
def point_velocity(R_WB, nu, arm_W, v_W):
    """Set v_W (3,), the velocity in W of the point of the vehicle at arm_W (3,) from B's origin [m/s]."""
    v_W[:] = R_WB @ velocity_at(nu, R_WB.T @ arm_W)


@kernel
def press(contact, f_n, v_t, R_WB, timestep):
    """Set the force of a contact point in the wall, and advance the stretch of its spring.

    Args:
        contact: a CONTACT record; normal_W and arm_W are set.
        f_n: normal force [N].
        v_t: (3,) velocity along the wall, relative to it, in W [m/s].
        R_WB: (3, 3) attitude.
        timestep: [s].
    """
    contact.f_W[:] = f_n * contact.normal_W
    if contact.friction > 0.0:
        friction(contact, f_n, v_t, timestep)
        contact.f_W += contact.f_tangential_W
    else:  # also where it was switched off during the contact
        contact.stretch_W[:], contact.f_tangential_W[:] = 0.0, 0.0
    contact.touching = 1
    wrench_at_origin(R_WB, contact.arm_W, contact.f_W, contact.tau_B)


@kernel
def friction(contact, f_n, v_t, timestep):
    """Set stretch_W and f_tangential_W from the normal force [N] and the slip velocity (3,) in W [m/s]."""
    xi, f, n = contact.stretch_W, contact.f_tangential_W, contact.normal_W
    limit = contact.friction * f_n
    if contact.slipping == 0:
        limit = (contact.friction + contact.breakaway) * f_n
    if contact.touching != 0:
        xi += timestep * v_t
        xi -= (n @ xi) * n  # the face may have turned
    held = contact.tangential_stiffness * math.sqrt(xi @ xi)
    contact.slipping = 1 if held > limit else 0
    if held > limit:
        limit = contact.friction * f_n
        xi *= limit / held
    f[:] = -contact.tangential_stiffness * xi - contact.tangential_damping * v_t
    size = math.sqrt(f @ f)
    if size > limit:
        f *= limit / size


@kernel
def wrench_at_origin(R_WB, arm_W, f_W, tau):
    """Set tau (6,) [N, N m], the wrench in B at its origin of a force f_W (3,) at arm_W (3,)."""
    f = R_WB.T @ f_W
    tau[:3], tau[3:] = f, cross(R_WB.T @ arm_W, f)


CARRIER = np.dtype(
    [
        ("link", "i8"),  # index of the link that it is fixed to; the base is link 0
        ("p_LC", "f8", (3,)),  # pose in the link's frame [m]
        ("R_LC", "f8", (3, 3)),
        # of one instant
        ("p_BC", "f8", (3,)),  # pose in B [m]
        ("R_BC", "f8", (3, 3)),
        ("p_WC", "f8", (3,)),  # pose in W [m]
        ("R_WC", "f8", (3, 3)),
        ("V", "f8", (6,)),  # velocity about B's origin in B
        ("nu", "f8", (6,)),  # velocity, in C [m/s, rad/s]
        ("tau", "f8", (6,)),  # forces of the springs of all contacts as a wrench at C's origin, in C [N, N m]
        ("f_W", "f8", (3,)),  # contact force that acted in the step [N]
        # of the instant before, for the work on the walls
        ("p_before", "f8", (3,)),  # position in W
        ("f_before_W", "f8", (3,)),
        ("moment_before", "f8", (3,)),  # in C
    ],
    align=True,
)
"""One carrier: its place on a link, its pose and velocity, and the contact forces on it."""


@kernel
def move_walls(run):
    """Move the walls to t_k."""
    for k in range(run.surface_count):
        if run.surfaces[k].moves != 0:
            move(run.surfaces[k], run.numbers, run.t)


@kernel
def press_contacts(run):
    """Set the forces of the springs of all contacts: in total, with their wrench in B, and what of them acts without
    the engine's contact solver. Walls and frames are in their places."""
    true, plant = run.true, run.plant
    true.f_springs_W[:], true.tau_springs_B[:] = 0.0, 0.0
    plant.f_applied_W[:], plant.tau_applied_B[:] = 0.0, 0.0
    for k in range(run.carriers.shape[0]):
        run.carriers[k].tau[:] = 0.0
    for k in range(run.pair_count):
        pair, contact = run.pairs[k], run.pairs[k].contact
        carrier = run.carriers[pair.carrier]
        p_WC, R_WC, nu = true.p_WB, true.R_WB, true.nu
        if run.carried.shape[0] != 0:
            p_WC, R_WC, nu = carrier.p_WC, carrier.R_WC, carrier.nu
        pair_force(pair, run.surfaces[pair.surface], p_WC, R_WC, nu, run.timestep)
        run.depths[k] = pair.depth
        run.f_pairs[k] = contact.f_W
        if contact.touching != 0:
            add_contact(run, pair, carrier, R_WC)


@kernel
def place_carriers(run):
    """Set the pose and the velocity of each frame of contacts."""
    for k in range(run.carriers.shape[0]):
        place_carrier(run, run.carriers[k])
        if run.plant.frames.shape[0] > 1:
            run.plant.links[run.carriers[k].link].f_ext[:] = 0.0


@kernel
def place_carrier(run, carrier):
    """Set the pose and the velocity of a frame on a link."""
    true, frames = run.true, run.plant.frames
    if frames.shape[0] > 1 and carrier.link != 0:
        own = frames[carrier.link]
        compose_poses(own.R_BL, own.p_BL, carrier.R_LC, carrier.p_LC, carrier.R_BC, carrier.p_BC)
    compose_poses(true.R_WB, true.p_WB, carrier.R_BC, carrier.p_BC, carrier.R_WC, carrier.p_WC)
    carrier.V[:] = true.nu
    if frames.shape[0] > 1:
        above = carrier.link
        for _ in range(frames[carrier.link].depth):
            carrier.V += frames[above].S * run.encoder.q_dot[above - 1]
            above = frames[above].parent
    motion_at(carrier.R_BC, carrier.p_BC, carrier.V, carrier.nu)


@kernel
def add_contact(run, pair, carrier, R_WC):
    """Add the force of a contact to the forces of its frame and of the vehicle, and to the force that acts without the
    solver."""
    true, plant, contact = run.true, run.plant, pair.contact
    true.f_springs_W += contact.f_W
    carrier.tau += contact.tau_B
    add_to_vehicle(run, carrier, contact.tau_B, true.tau_springs_B)
    f_W, tau_C = contact.f_W, contact.tau_B.copy()
    if pair.solved != 0:  # the friction remains
        f_W = contact.f_tangential_W
        wrench_at_origin(R_WC, contact.arm_W, f_W, tau_C)
    if carrier.link == 0:
        plant.f_applied_W += f_W
        add_to_vehicle(run, carrier, tau_C, plant.tau_applied_B)
    elif plant.links.shape[0] > 1:
        add_wrench_from(carrier.R_BC, carrier.p_BC, tau_C, plant.links[carrier.link].f_ext)


@kernel
def add_to_vehicle(run, carrier, tau_C, tau_B):
    """Add a wrench (6,) at the origin of a frame of contacts to one at B's origin in B."""
    if run.carried.shape[0] == 0:
        tau_B += tau_C
    else:
        add_wrench_from(carrier.R_BC, carrier.p_BC, tau_C, tau_B)


@kernel
def force_of_step(run):
    """Set the contact force of step k that acted, in total and on each frame, with the normal force that the engine's
    solver applied; the push, which is the sum of the normal forces; and add the work on the walls since the last
    instant, by the trapezoidal rule, by which a linear spring does no work over a rebound."""
    true, row, solved, h = run.true, run.row, run.plant.solved, run.timestep
    run.push[0] = 0.0
    row.f_contact_W[:] = 0.0
    for k in range(run.carriers.shape[0]):
        run.carriers[k].f_W[:] = 0.0
    for k in range(run.pair_count):
        pair, contact = run.pairs[k], run.pairs[k].contact
        f_W, f_n = contact.f_W.copy(), pair.f_n
        if pair.solved != 0:
            found = 1.0 if solved[0] != 0.0 else 0.0
            f_W[:] = contact.f_tangential_W + found * solved[1:]
            f_n = found * np.linalg.norm(solved[1:])
        run.push[0] += f_n
        row.f_contact_W += f_W
        run.carriers[pair.carrier].f_W += f_W
    for k in range(run.carriers.shape[0]):
        carrier, p, nu = run.carriers[k], true.p_WB, true.nu
        if run.carried.shape[0] != 0:
            p, nu = carrier.p_WC, carrier.nu
        moment = carrier.tau[3:]
        if run.step > 0:
            for i in range(3):
                row.wall_work -= 0.5 * (carrier.f_W[i] + carrier.f_before_W[i]) * (p[i] - carrier.p_before[i])
                row.wall_work -= 0.5 * (moment[i] + carrier.moment_before[i]) * h * nu[i + 3]
        carrier.f_before_W[:], carrier.moment_before[:], carrier.p_before[:] = carrier.f_W, moment, p
