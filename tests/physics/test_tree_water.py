"""A vehicle with joints in the water moves as the independent twin says, at the integrator's order."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from random_trees import (
    drag_free,
    load_tree,
    neutral,
    of_bodies,
    place_tree,
    random_state,
    random_tree,
    still,
    tree_acceleration,
    tree_state,
    water_of_tree,
)
from tree_twin import Rigid, TwinBody, acceleration, inertia, momentum_W, motion
from twin import rotation
from uvms_mj import Current, attach

seeds = st.integers(0, 2**32 - 1)


def agrees(seed: int, joints: int, tolerance: float = 1e-9) -> None:
    tree = random_tree(seed, joints)
    state, rng = random_state(tree, seed), np.random.default_rng(seed)
    tau, t = rng.normal(size=6 + joints) * 10.0, float(rng.uniform(0, 10))
    model, data = load_tree(tree)
    place_tree(data, state)
    data.time, data.ctrl[:] = t, tau
    with attach(model, data, "rov", **water_of_tree(tree)):
        mujoco.mj_forward(model, data)
    _, quat, q, zeta = state
    expected = acceleration(tree, rotation(quat), q, zeta, tau, t)
    found = tree_acceleration(data, joints)
    assert np.linalg.norm(found - expected) <= tolerance * np.linalg.norm(expected)


@given(seeds, st.sampled_from([1, 3, 9]))
def test_the_acceleration_of_a_random_tree_is_the_twins(seed, joints):
    """Full added mass and damping on every body, weight and buoyancy apart, a current, a disturbance."""
    agrees(seed, joints)


@pytest.mark.parametrize("joints", [15, 30])
def test_a_large_tree_is_the_twins_too(joints):
    for seed in range(3):
        agrees(seed, joints)


@given(seeds)
def test_the_inertia_is_the_twins_and_counts_added_mass_once(seed):
    tree = random_tree(seed, 6)
    model, data = load_tree(tree)
    _, quat, q, _ = state = random_state(tree, seed)
    place_tree(data, state)
    T, M = np.eye(12), np.zeros((12, 12))
    T[:3, :3] = rotation(quat).T
    expected = T.T @ inertia(tree, q) @ T
    with attach(model, data, "rov", **water_of_tree(tree)):
        for evaluate in (
            lambda: mujoco.mj_forward(model, data),
            lambda: mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_POS, 1),
            lambda: mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_VEL, 1),
        ):
            evaluate()
            mujoco.mj_fullM(model, data, M)
            assert np.allclose(M, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())


TREES = {"spatial": 1, "planar": 2}


def tumbling(kind: str):
    """A neutral tree without drag in still water, in motion. In the planar one all turns are about one axis."""
    tree = neutral(drag_free(still(random_tree(TREES[kind], 4))))
    state = random_state(tree, 5, rate=1.0)
    if kind == "spatial":
        return tree, state
    sway_heave = np.diag([1.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    out = np.diag([0.0, 0.0, 1.0, 1.0, 1.0, 0.0])

    def flat(body: TwinBody) -> TwinBody:
        part = Rigid(body.mass, np.r_[body.parts[0].r_g[:2], 0.0], np.eye(3) * 0.1)
        M_A = sway_heave @ body.M_A @ sway_heave + out
        return replace(
            body,
            parts=(part,),
            M_A=M_A,
            r_b=part.r_g,
            p_0=np.r_[body.p_0[:2], 0.0],
            R_0=np.eye(3),
            slide=False,
            axis=np.array([0.0, 0.0, 1.0]),
            anchor=np.r_[body.anchor[:2], 0.0],
        )

    p, _, q, zeta = state
    zeta[[2, 3, 4]] = 0.0
    return of_bodies(tree, flat), (p, np.array([1.0, 0.0, 0.0, 0.0]), q, zeta)


def drift(kind: str, integrator: str, timestep: float, duration: float = 0.4) -> np.ndarray:
    """Changes of energy and of momentum, relative to their sizes."""
    tree, state = tumbling(kind)
    model, data = load_tree(tree, timestep=timestep, integrator=integrator)
    place_tree(data, state)

    def kept():
        p, quat, q, zeta = tree_state(data, tree.n)
        h = momentum_W(tree, p, rotation(quat), q, zeta)
        return np.r_[0.5 * zeta @ inertia(tree, q) @ zeta, h]

    before = kept()
    with attach(model, data, "rov"):
        mujoco.mj_step(model, data, round(duration / timestep))
    change = kept() - before
    sizes = before[0], np.linalg.norm(before[1:4]), np.linalg.norm(before[4:])
    return np.array([abs(change[0]), np.linalg.norm(change[1:4]), np.linalg.norm(change[4:])]) / sizes


@pytest.mark.parametrize(
    ("kind", "integrator", "steps", "order"),
    [("planar", "RK4", 20, 4), ("spatial", "RK4", 80, 2), ("spatial", "Euler", 80, 1)],
)
def test_a_tumble_keeps_energy_and_momentum_to_the_integrators_order(kind, integrator, steps, order):
    """The momentum is that of bodies and water. MuJoCo 3 turns the base to order 2 if its axis changes."""
    errors = np.array([drift(kind, integrator, 0.4 / n) for n in (steps, 2 * steps, 4 * steps)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert orders.min() > order - 0.25, (errors, orders)


def test_isotropic_added_mass_is_a_point_mass_welded_to_the_link():
    """m_A I about a point of the link, whose weight is that of the water it displaces: the same motion to 1e-9."""
    tree = still(random_tree(3, 5))
    masses = np.random.default_rng(3).uniform(0.5, 3.0, 6)

    def added(body: TwinBody, m: float) -> TwinBody:
        return replace(body, M_A=np.diag([m, m, m, 0.0, 0.0, 0.0]))

    def welded(body: TwinBody, m: float) -> TwinBody:
        point = Rigid(m, np.zeros(3), 1e-13 * np.eye(3))
        d = body.displaced_mass
        return replace(
            body,
            M_A=np.zeros((6, 6)),
            parts=(*body.parts, point),
            displaced_mass=d + m,
            r_b=body.r_b * d / (d + m),  # the point is where the link's frame is
        )

    reached = []
    for change in (added, welded):
        bodies = tuple(change(body, float(m)) for body, m in zip(tree.bodies, masses, strict=True))
        model, data = load_tree(replace(tree, bodies=bodies))
        place_tree(data, random_state(tree, 4, rate=1.0))
        data.ctrl[:] = np.random.default_rng(5).normal(size=11) * 3.0
        with attach(model, data, "rov", current=Current.of((0.3, -0.2, 0.1))):
            mujoco.mj_step(model, data, 400)
        reached.append(np.r_[data.qpos, data.qvel])
    assert np.abs(reached[0] - reached[1]).max() < 1e-9 * np.abs(reached[0]).max()


def test_a_neutral_arm_drifts_with_the_current():
    """It comes to rest in the water: its base and its links move with the current, and its joints stand still."""
    tree = neutral(still(random_tree(6, 4)))
    model, data = load_tree(of_bodies(tree, lambda body: replace(body, damping=0.5)), timestep=5e-3)
    v_c = np.array([0.3, -0.2, 0.1])
    place_tree(data, random_state(tree, 6, rate=0.5))
    with attach(model, data, "rov", current=Current.of(v_c)):
        mujoco.mj_step(model, data, 40_000)
    assert np.allclose(data.qvel, [*v_c, *np.zeros(7)], rtol=0.0, atol=1e-6)


def test_motion_in_a_current_is_motion_in_still_water_seen_from_the_water():
    """For a neutral tree, whatever its shape and its motors do: a change of frame."""
    tree = neutral(still(random_tree(8, 5)))
    v_c, (p, quat, q, zeta) = np.array([0.4, -0.3, 0.2]), random_state(tree, 8, rate=1.0)
    carried = zeta + np.r_[rotation(quat).T @ v_c, np.zeros(8)]
    reached = []
    for velocity, current in ((zeta, np.zeros(3)), (carried, v_c)):
        model, data = load_tree(tree)
        place_tree(data, (p, quat, q, velocity))
        data.ctrl[:] = np.random.default_rng(8).normal(size=11) * 2.0
        with attach(model, data, "rov", current=Current.of(current)):
            mujoco.mj_step(model, data, 500)
        data.qpos[:3] -= current * data.time
        data.qvel[:3] -= current
        reached.append(np.r_[data.qpos, data.qvel])
    assert np.allclose(*reached, rtol=0.0, atol=1e-10)


@pytest.mark.slow
def test_a_fast_swing_of_the_joints_moves_the_base_as_the_twin_says():
    """Torques swing a joint by over half a radian within 0.3 s, the thrusters are off: 1e-6 over the run. The base gets
    its momentum from the arm and from the water."""
    tree = neutral(random_tree(9, 3, chain=1.0))
    tree = replace(tree, disturbance_bias=np.zeros(6), disturbance_amplitude=np.zeros(6))
    bodies = [replace(body, slide=False, damping=0.1 if k else 0.0) for k, body in enumerate(tree.bodies)]
    tree, start = replace(tree, bodies=tuple(bodies)), random_state(tree, 9, rate=0.0)

    def tau(t):
        return np.r_[np.zeros(6), 250.0 * np.cos(2.0 * np.pi * t * np.array([1.0, 1.5, 2.0]))]

    h, n = 5e-5, 6000
    model, data = load_tree(tree, timestep=h, integrator="RK4")
    place_tree(data, start)
    with attach(model, data, "rov", **water_of_tree(tree)):
        for k in range(n):
            data.ctrl[:] = tau((k + 0.5) * h)  # held over a step: of second order
            mujoco.mj_step(model, data)
    expected = [each[-1] for each in motion(tree, start, np.array([n * h]), tau)]
    reached = tree_state(data, tree.n)
    assert np.abs(reached[2] - start[2]).max() > 0.5
    assert np.abs(reached[0] - start[0]).max() > 0.05
    assert all(np.abs(a - b).max() < 1e-6 for a, b in zip(reached, expected, strict=True))
