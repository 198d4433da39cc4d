"""Vehicles with joints in any model: beside each other, with gear friction and each integrator, in copies."""

import dataclasses

import mujoco
import numpy as np
import pytest

from random_trees import (
    load_tree,
    of_bodies,
    place_tree,
    random_state,
    random_tree,
    tree_acceleration,
    tree_xml,
    water_of_tree,
)
from tree_twin import acceleration, inertia, resistance
from twin import rotation
from uvms_mj import attach


def together(trees) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """One model with all trees, each behind a free ball, with the prefixes v0/, v1/, ..."""
    spec = mujoco.MjSpec()
    spec.option.gravity = [0.0, 0.0, -trees[0].gravity]
    spec.option.timestep = 1e-3
    for i, tree in enumerate(trees):
        ball = spec.worldbody.add_body(pos=[0.0, 9.0 + i, 0.0])
        ball.add_freejoint()
        ball.add_geom(size=[0.1, 0.0, 0.0])
        child = mujoco.MjSpec.from_string(tree_xml(tree))
        spec.attach(child, prefix=f"v{i}/", frame=spec.worldbody.add_frame())
    model = spec.compile()
    return model, mujoco.MjData(model)


def test_several_vehicles_in_one_model_are_each_the_twins():
    """Each has coefficients, joints, current and disturbance of its own, and motors between those of the others."""
    trees = [random_tree(seed, joints) for seed, joints in ((1, 3), (2, 0), (3, 6))]
    model, data = together(trees)
    attached, cases, control = [], [], 0
    for i, tree in enumerate(trees):
        joint = model.body(f"v{i}/rov").jntadr[0]
        where = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        state = random_state(tree, i)
        place_tree(data, state, *where)
        tau = np.random.default_rng(i).normal(size=6 + tree.n) * 5.0
        data.ctrl[control : control + len(tau)] = tau
        control += len(tau)
        cases.append((tree, state, tau, where))
        attached.append(attach(model, data, f"v{i}/rov", **water_of_tree(tree)))
    data.time = 0.7
    mujoco.mj_forward(model, data)
    for each in attached:
        each.detach()
    for tree, (_, quat, q, zeta), tau, where in cases:
        expected = acceleration(tree, rotation(quat), q, zeta, tau, 0.7)
        found = tree_acceleration(data, tree.n, *where)
        assert np.linalg.norm(found - expected) <= 1e-9 * np.linalg.norm(expected)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_gear_friction_is_taken_at_the_end_of_the_step(integrator):
    """Viscous friction B: (M + M_A + h B) (zeta' - zeta)/h = tau - b in one dense solve, in MuJoCo's coordinates."""
    h, tree = 2e-3, random_tree(21, 5)
    rng = np.random.default_rng(21)
    frictions = iter([0.0, *rng.uniform(0.5, 20.0, 5)])
    tree = of_bodies(tree, lambda body: dataclasses.replace(body, damping=float(next(frictions))))
    model, data = load_tree(tree, timestep=h, integrator=integrator)
    _, quat, q, zeta = state = random_state(tree, 21)
    place_tree(data, state)
    tau = rng.normal(size=11) * 5.0
    data.ctrl[:] = tau
    before = data.qvel.copy()
    with attach(model, data, "rov", **water_of_tree(tree)):
        mujoco.mj_step(model, data)
    R, T = rotation(quat), np.eye(11)
    T[:3, :3] = R.T
    load = tau - resistance(tree, R, q, zeta)
    load[:6] += tree.disturbance_bias  # at t = 0
    M = inertia(tree, q)
    turning = np.r_[np.cross(zeta[3:6], zeta[:3]), np.zeros(8)]  # T_dot qvel = -omega x v
    B = np.diag([0.0] * 6 + [body.damping for body in tree.bodies[1:]])
    change = np.linalg.solve(T.T @ (M + h * B) @ T, h * T.T @ (load + M @ turning))
    assert np.abs(data.qvel - before - change).max() < 1e-12 * np.abs(before).max()


def swinging(seed: int):
    """Model and data of a moving tree, and arguments of attach."""
    tree = random_tree(seed, 4)
    model, data = load_tree(tree)
    place_tree(data, random_state(tree, seed, rate=1.0))
    data.ctrl[:] = np.random.default_rng(seed).normal(size=10) * 2.0
    return model, data, water_of_tree(tree)


def motion(data) -> np.ndarray:
    return np.concatenate([data.qpos, data.qvel])


def undisturbed(seed: int, steps: int) -> np.ndarray:
    model, data, water = swinging(seed)
    with attach(model, data, "rov", **water):
        mujoco.mj_step(model, data, steps)
        return motion(data)


def test_a_state_that_was_saved_and_restored_has_the_water_once():
    model, data, water = swinging(5)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    saved = np.empty(mujoco.mj_stateSize(model, kind))
    with attach(model, data, "rov", **water):
        mujoco.mj_step(model, data, 60)
        mujoco.mj_getState(model, data, saved, kind)
        mujoco.mj_step(model, data, 57)
        mujoco.mj_setState(model, data, saved, kind)
        mujoco.mj_step(model, data, 60)
        assert np.array_equal(motion(data), undisturbed(5, 120))


def test_copies_of_attached_data_have_the_water_once():
    model, data, water = swinging(6)
    store, other = mujoco.MjData(model), mujoco.MjData(model)
    with attach(model, data, "rov", **water), attach(model, other, "rov", **water):
        mujoco.mj_step(model, data, 60)
        mujoco.mj_copyData(store, model, data)
        mujoco.mj_step(model, data, 31)
        mujoco.mj_copyData(data, model, store)
        mujoco.mj_copyData(other, model, data)
        mujoco.mj_step(model, data, 60)
        mujoco.mj_step(model, other, 60)
    assert np.array_equal(motion(data), undisturbed(6, 120))
    assert np.array_equal(motion(other), undisturbed(6, 120))


def test_a_torque_of_the_users_own_on_a_joint_acts_once():
    """In qfrc_applied or as the motor's: the same motion. MuJoCo's stages may be skipped."""
    reached = []
    for way in ("motor", "applied"):
        model, data, water = swinging(7)
        (data.ctrl if way == "motor" else data.qfrc_applied)[8] += 3.0
        with attach(model, data, "rov", **water):
            mujoco.mj_step(model, data, 100)
            mujoco.mj_forward(model, data)
            acceleration_ = data.qacc.copy()
            mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_VEL, 1)
            assert np.array_equal(data.qacc, acceleration_)
        reached.append(motion(data))
    assert np.allclose(*reached, rtol=0.0, atol=1e-10)
    assert not np.allclose(reached[0], undisturbed(7, 100), atol=1e-3)
