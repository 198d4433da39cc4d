"""The closed loop around one free rigid body in machine code, without MuJoCo."""

from ...physics.free_body import free_acceleration, soft_contact, symplectic_step
from ...physics.hydrodynamics import water_wrench
from .loop import begin_step


def free_steps(run, n, moving) -> int:
    """Take n time steps, or evaluate the instant in hand if ``moving`` is 0. Returns the number of steps that were
    taken before the run stopped."""
    plant, body, true, solved = run.plant, run.body, run.true, run.plant.solved
    for k in range(n):
        if not begin_step(run):
            return k
        water_wrench(plant, true.R_WB, true.nu, plant.wrench)
        tau = plant.wrench + true.tau
        if run.pairs.shape[0] != 0:
            tau += plant.tau_applied_B
        free_acceleration(body, true.R_WB, true.nu, tau, plant.qacc)
        if run.pairs.shape[0] != 0:
            pair, contact = run.pairs[0], run.pairs[0].contact
            solved[0] = 0.0
            if pair.solved != 0 and contact.touching != 0:
                f_n = soft_contact(body, contact, pair.depth, true.R_WB, plant.qvel, plant.qacc)
                solved[0], solved[1:] = 1.0, f_n * contact.normal_W
        if moving != 0:
            symplectic_step(plant.qpos, plant.qvel, plant.qacc, run.timestep)
    return n
