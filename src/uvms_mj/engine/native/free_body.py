"""The closed loop around one free rigid body in machine code, without MuJoCo."""

from ...physics.contact import wrench_at_origin
from ...physics.free_body import free_acceleration, soft_contact, sphere_and_face, symplectic_step
from ...physics.hydrodynamics import water_wrench
from .loop import begin_step


def free_steps(run, n, moving) -> int:
    """Take n time steps, or evaluate the instant in hand if ``moving`` is 0. Returns the number of steps that were
    taken before the run stopped. With n = 0 it measures the distance to the wall only."""
    plant, body, true, contact, force = run.plant, run.body, run.true, run.contact, run.body.force
    plant.distance = sphere_and_face(body, plant.qpos, plant.fromto)
    for k in range(n):
        if not begin_step(run):
            return k
        water_wrench(plant, true.R_WB, true.nu, plant.wrench)
        for i in range(6):
            force[i] = plant.wrench[i] + true.tau[i]
        if contact.touching != 0 and contact.friction > 0.0:
            wrench_at_origin(true.R_WB, contact.arm_W, contact.f_tangential_W, contact.work, body.work)
            for i in range(6):
                force[i] += body.work[i]
        if run.pairs.shape[0] != 0:
            for i in range(6):
                force[i] += plant.tau_pairs_B[i]
        free_acceleration(body, true.R_WB, true.nu, force, body.work, plant.qacc)
        plant.solved[0] = 0.0
        if contact.touching != 0:
            f_n = soft_contact(body, contact, true.R_WB, plant.qvel, plant.distance, body.work, plant.qacc)
            plant.solved[0] = 1.0
            for i in range(3):
                plant.solved[1 + i] = f_n * contact.normal_W[i]
        if moving != 0:
            symplectic_step(plant.qpos, plant.qvel, plant.qacc, run.timestep)
            plant.distance = sphere_and_face(body, plant.qpos, plant.fromto)
    return n
