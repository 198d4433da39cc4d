"""The list of contacts in the loop: the walls at this instant, and the forces of all pairs."""

from ...physics.kernels import kernel
from ...physics.pairs import pair_force
from ...physics.surfaces import move


@kernel
def touch(run):
    """Move the walls to t_k, compute the force of each pair, and add all of them to the true contact force, or to those
    of the carriers."""
    for k in range(run.surface_count):
        surface = run.surfaces[k]
        if surface.moves != 0:
            move(surface, run.numbers, run.t)
    true, f_W, tau_B = run.true, run.plant.f_pairs_W, run.plant.tau_pairs_B
    for i in range(3):
        f_W[i] = 0.0
        tau_B[i] = 0.0
        tau_B[i + 3] = 0.0
    run.push_of_pairs = 0.0
    for k in range(run.pair_count):
        pair = run.pairs[k]
        surface = run.surfaces[pair.surface]
        if run.carriers.shape[0] == 0:
            pair_force(pair, surface, true.p_WB, true.R_WB, true.nu, run.timestep)
        else:
            carrier = run.carriers[pair.carrier]
            pair_force(pair, surface, carrier.p_WC, carrier.R_WC, carrier.nu, run.timestep)
            for i in range(6):
                carrier.tau[i] += pair.contact.tau_B[i]
                carrier.applied[i] += pair.contact.tau_B[i]
        run.push_of_pairs += pair.f_n
        run.depths[k] = pair.depth
        for i in range(3):
            run.f_pairs[k, i] = pair.contact.f_W[i]
            f_W[i] += pair.contact.f_W[i]
        for i in range(6):
            tau_B[i] += pair.contact.tau_B[i]
    for i in range(3):
        true.f_contact_W[i] += f_W[i]
    for i in range(6):
        true.tau_contact_B[i] += tau_B[i]
