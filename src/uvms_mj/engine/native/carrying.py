"""Contacts at the tool and on links: poses and velocities of their carriers, and the links that their forces act on."""

from ...physics.carriers import arrive, ride
from ...physics.contact import wrench_at_origin
from ...physics.frames import add_wrench_from, compose_poses, to_world
from ...physics.kernels import kernel


@kernel
def place_carriers(run):
    """Set the pose and the velocity of each carrier from the state of the instant; the links are in their place."""
    true, frames = run.true, run.plant.frames
    for k in range(run.carriers.shape[0]):
        carrier = run.carriers[k]
        if carrier.link == 0:
            ride(carrier, true.p_WB, true.R_WB, true.nu)
        else:
            own = frames[carrier.link]
            compose_poses(own.R_BL, own.p_BL, carrier.R_LC, carrier.p_LC, carrier.R_BC, carrier.p_BC)
            ride(carrier, true.p_WB, true.R_WB, true.nu)
            above = carrier.link
            for _ in range(own.depth):
                frame = frames[above]
                for i in range(6):
                    carrier.V[i] += frame.S[i] * run.encoder.q_dot[above - 1]
                above = frame.parent
        arrive(carrier)


@kernel
def press_links(run):
    """Add the contact forces of all carriers to the true contact force, and let those that MuJoCo's contact solver does
    not apply act on their links."""
    plant, true, contact, tau_B = run.plant, run.true, run.contact, run.plant.tau_pairs_B
    probe = run.carriers[0]
    for i in range(6):
        probe.tau[i] += contact.tau_B[i]
    if contact.touching != 0 and contact.friction > 0.0:
        wrench_at_origin(probe.R_WC, contact.arm_W, contact.f_tangential_W, contact.work, plant.work)
        for i in range(6):
            probe.applied[i] += plant.work[i]
    for i in range(6):
        true.tau_contact_B[i] = 0.0
        tau_B[i] = 0.0
    for k in range(run.carriers.shape[0]):
        if run.carriers[k].link != 0:
            link = plant.links[run.carriers[k].link]
            for i in range(6):
                link.f_ext[i] = 0.0
    for i in range(3):
        run.f_carried_W[i] = 0.0
    for k in range(run.carriers.shape[0]):
        carrier = run.carriers[k]
        touches = False
        for i in range(6):
            if carrier.tau[i] != 0.0 or carrier.applied[i] != 0.0:
                touches = True
        if not touches:
            continue
        add_wrench_from(carrier.R_BC, carrier.p_BC, carrier.tau, true.tau_contact_B)
        to_world(carrier.R_WC, carrier.applied, plant.work)
        for i in range(3):
            run.f_carried_W[i] += plant.work[i]
        if carrier.link == 0:
            add_wrench_from(carrier.R_BC, carrier.p_BC, carrier.applied, tau_B)
        else:
            link = plant.links[carrier.link]
            add_wrench_from(carrier.R_BC, carrier.p_BC, carrier.applied, link.f_ext)
    to_world(true.R_WB, true.tau_contact_B, true.f_contact_W)
    to_world(true.R_WB, tau_B, plant.f_pairs_W)


@kernel
def work_on_walls(run):
    """Complete the contact force of the row with the normal force that MuJoCo's contact solver applied, and add the
    work on the walls since the last instant, by the trapezoidal rule."""
    contact, row, solved, f_W = run.contact, run.row, run.plant.solved, run.plant.work
    for i in range(3):
        row.f_contact_W[i] = run.f_carried_W[i] + (solved[1 + i] if solved[0] != 0.0 else 0.0)
    for k in range(run.carriers.shape[0]):
        carrier = run.carriers[k]
        to_world(carrier.R_WC, carrier.tau, f_W)
        for i in range(3):
            if k == 0:  # in place of its closed form
                f_W[i] += (solved[1 + i] if solved[0] != 0.0 else 0.0) - (contact.f_W[i] - contact.f_tangential_W[i])
            moment = carrier.tau[3 + i]
            if run.step > 0:
                row.wall_work -= 0.5 * (f_W[i] + carrier.f_before_W[i]) * (carrier.p_WC[i] - carrier.p_before[i])
                row.wall_work -= 0.5 * (moment + carrier.moment_before[i]) * run.timestep * carrier.nu[3 + i]
            carrier.f_before_W[i] = f_W[i]
            carrier.moment_before[i] = moment
            carrier.p_before[i] = carrier.p_WC[i]
