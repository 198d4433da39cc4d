"""The list of contacts in the loop: the walls at this instant, and the forces of all pairs."""

from ...physics.kernels import kernel
from ...physics.pairs import pair_force
from ...physics.surfaces import move
from .layouts import CARRIER_SIZE, PAIR_SIZE, SURFACE_SIZE
from .memory import carrier_at, floats, pair_at, surface_at


@kernel
def touch(context, loop):
    """Move the walls to t_k, compute the force of each pair, and add all of them to the true contact force, or to those
    of the carriers."""
    for k in range(loop.surfaces):
        surface = surface_at(loop.surfaces_at + SURFACE_SIZE * k)
        if surface.moves != 0:
            move(surface, floats(surface.table_at, 4 * surface.rows), loop.t)
    true, f_W, tau_B = loop.true, context.f_pairs_W, context.tau_pairs_B
    for i in range(3):
        f_W[i] = 0.0
        tau_B[i] = 0.0
        tau_B[i + 3] = 0.0
    forces, depths = floats(loop.f_pairs_at, 3 * context.pairs), floats(loop.depths_at, context.pairs)
    loop.push_of_pairs = 0.0
    for k in range(context.pairs):
        pair = pair_at(loop.pairs_at + PAIR_SIZE * k)
        surface = surface_at(loop.surfaces_at + SURFACE_SIZE * pair.surface)
        if context.carriers == 0:
            pair_force(pair, surface, true.p_WB, true.R_WB, true.nu, loop.timestep)
        else:
            carrier = carrier_at(loop.carriers_at + CARRIER_SIZE * pair.carrier)
            pair_force(pair, surface, carrier.p_WC, carrier.R_WC, carrier.nu, loop.timestep)
            for i in range(6):
                carrier.tau[i] += pair.contact.tau_B[i]
                carrier.applied[i] += pair.contact.tau_B[i]
        loop.push_of_pairs += pair.f_n
        depths[k] = pair.depth
        for i in range(3):
            forces[3 * k + i] = pair.contact.f_W[i]
            f_W[i] += pair.contact.f_W[i]
        for i in range(6):
            tau_B[i] += pair.contact.tau_B[i]
    for i in range(3):
        true.f_contact_W[i] += f_W[i]
    for i in range(6):
        true.tau_contact_B[i] += tau_B[i]
