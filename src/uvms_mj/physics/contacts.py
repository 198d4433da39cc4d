"""All contacts of a vehicle: the sphere about the origin of the task's frame in front of ``[wall]``, and every contact
body in front of every wall. Their springs give the force at an instant (:mod:`.pairs`).

A record of a run has the surfaces, the pairs of a body and a surface, and the frames that the bodies are fixed to. The
normal force of a pair that is marked ``solved`` is applied by the engine, MuJoCo's contact solver or its closed form;
all other forces act here, on the base or on a link. The force that acted in a step is known when the step is over.

A contact is computed in the frame C that its body is fixed to, as that of a rigid vehicle is in B: B itself, the frame
of a link, or that of a site.
"""

import numpy as np

from .frames import add_wrench_from, compose_poses, motion_at
from .kernels import kernel
from .pairs import pair_force, wrench_at_origin
from .surfaces import move

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
def press_contacts(run):
    """Move the walls to t_k, and set the forces of the springs of all contacts: in total, with their wrench in B, and
    what of them acts without the engine's contact solver. The frames are in their places."""
    true, plant = run.true, run.plant
    true.f_springs_W[:], true.tau_springs_B[:] = 0.0, 0.0
    plant.f_applied_W[:], plant.tau_applied_B[:] = 0.0, 0.0
    for k in range(run.surface_count):
        if run.surfaces[k].moves != 0:
            move(run.surfaces[k], run.numbers, run.t)
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
    true, frames = run.true, run.plant.frames
    for k in range(run.carriers.shape[0]):
        carrier = run.carriers[k]
        if frames.shape[0] > 1 and carrier.link != 0:
            own = frames[carrier.link]
            compose_poses(own.R_BL, own.p_BL, carrier.R_LC, carrier.p_LC, carrier.R_BC, carrier.p_BC)
        ride(carrier, true.p_WB, true.R_WB, true.nu)
        if frames.shape[0] > 1:
            above = carrier.link
            for _ in range(frames[carrier.link].depth):
                carrier.V += frames[above].S * run.encoder.q_dot[above - 1]
                above = frames[above].parent
            run.plant.links[carrier.link].f_ext[:] = 0.0
        arrive(carrier)


@kernel
def add_contact(run, pair, carrier, R_WC):
    """Add the force of a contact to those of its frame, of the vehicle and of what acts without the solver."""
    true, plant, contact = run.true, run.plant, pair.contact
    true.f_springs_W += contact.f_W
    carrier.tau += contact.tau_B
    add_to_vehicle(run, carrier, contact.tau_B, true.tau_springs_B)
    f_W, tau_C = contact.f_W, contact.tau_B.copy()
    if pair.solved != 0:  # what is left is the friction
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


@kernel
def ride(carrier, p_WB, R_WB, nu):
    """Set the pose of a carrier in W from that of B, and start its velocity with that of the base, nu (6,)."""
    compose_poses(R_WB, p_WB, carrier.R_BC, carrier.p_BC, carrier.R_WC, carrier.p_WC)
    carrier.V[:] = nu


@kernel
def arrive(carrier):
    """Finish the velocity of a carrier."""
    motion_at(carrier.R_BC, carrier.p_BC, carrier.V, carrier.nu)
