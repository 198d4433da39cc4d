"""The closed loop around one free rigid body in machine code, without MuJoCo."""

from ...physics.free_body import free_acceleration, soft_contact, symplectic_step
from ...physics.hydrodynamics import water_wrench
from .loop import begin_step


def free_steps(run, n, moving) -> int:
    """Take n time steps, or evaluate the instant in hand if ``moving`` is 0. Returns the number of steps that were
    taken before the run stopped."""
    plant, body, true, force = run.plant, run.body, run.true, run.body.force
    for k in range(n):
        if not begin_step(run):
            return k
        water_wrench(plant, true.R_WB, true.nu, plant.wrench)
        for i in range(6):
            force[i] = plant.wrench[i] + true.tau[i]
        if run.pairs.shape[0] != 0:
            for i in range(6):
                force[i] += plant.tau_applied_B[i]
        free_acceleration(body, true.R_WB, true.nu, force, body.work, plant.qacc)
        if run.pairs.shape[0] != 0:
            pair, contact, solved = run.pairs[0], run.pairs[0].contact, plant.solved
            solved[0] = 0.0
            if pair.solved != 0 and contact.touching != 0:
                f_n = soft_contact(body, contact, pair.depth, true.R_WB, plant.qvel, body.work, plant.qacc)
                solved[0] = 1.0
                for i in range(3):
                    solved[1 + i] = f_n * contact.normal_W[i]
        if moving != 0:
            symplectic_step(plant.qpos, plant.qvel, plant.qacc, run.timestep)
    return n
