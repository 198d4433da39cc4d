"""The closed loop around one free rigid body in machine code, without MuJoCo."""

from ...physics.contact import wrench_at_origin
from ...physics.free_body import free_acceleration, soft_contact, sphere_and_face, symplectic_step
from ...physics.hydrodynamics import water_wrench
from .loop import begin_step
from .memory import loop_at


def free_steps(context, body, n, moving) -> int:
    """Take n time steps, or evaluate the instant in hand if ``moving`` is 0. Returns the number of steps that were
    taken before the run stopped. With n = 0 it measures the distance to the wall only."""
    loop = loop_at(context.loop_at)
    true, contact, force = loop.true, loop.contact, body.force
    sphere_and_face(body)
    for k in range(n):
        if not begin_step(context, loop):
            return k
        water_wrench(context.water, true.R_WB, true.nu, context.nu_r, body.work, force)
        for i in range(6):
            force[i] += true.tau[i]
        if contact.touching != 0 and contact.friction > 0.0:
            wrench_at_origin(true.R_WB, contact.arm_W, contact.f_tangential_W, contact.work, body.work)
            for i in range(6):
                force[i] += body.work[i]
        if context.pairs != 0:
            for i in range(6):
                force[i] += context.tau_pairs_B[i]
        free_acceleration(body, true.R_WB, true.nu, force, body.work, body.qacc)
        body.contact[0] = 0.0
        if contact.touching != 0:
            f_n = soft_contact(body, contact, true.R_WB, body.work, body.qacc)
            body.contact[0] = 1.0
            for i in range(3):
                body.contact[1 + i] = f_n * contact.normal_W[i]
        if moving != 0:
            symplectic_step(body.qpos, body.qvel, body.qacc, loop.timestep)
            sphere_and_face(body)
    return n
