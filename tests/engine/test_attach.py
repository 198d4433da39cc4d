"""A vehicle attached to any model obeys the paper's eq. (10); settings that would break it are refused."""

import gc
import threading
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from twin import TwinParameters, matrix_acceleration, rotation
from uvms_mj import InputError, attach
from uvms_mj.physics.hydrodynamics import factor
from vehicles import load, place, random_parameters, state, vehicle_xml, water_of

STILL = TwinParameters(v_c_W=(0.0, 0.0, 0.0))
seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_acceleration_is_the_matrix_equations(seed):
    parameters = random_parameters(seed)
    rng = np.random.default_rng(seed + 1)
    model, data = load(parameters, crowded=True)
    quat = rng.normal(size=4)
    quat /= np.linalg.norm(quat)
    nu, tau, t = rng.normal(size=6) * 2, rng.normal(size=6) * 20, float(rng.uniform(0, 10))
    place(model, data, rng.normal(size=3), quat, nu)
    data.time, data.ctrl[:] = t, tau
    with attach(model, data, "rov", **water_of(parameters)):
        mujoco.mj_forward(model, data)
    a_W, omega_dot = data.qacc[6:9], data.qacc[9:12]
    nu_dot = np.concatenate([rotation(quat).T @ a_W - np.cross(nu[3:], nu[:3]), omega_dot])
    expected = matrix_acceleration(parameters, np.zeros(3), quat, nu, tau, t)
    assert np.linalg.norm(nu_dot - expected) <= 1e-9 * np.linalg.norm(expected)


@given(seeds)
def test_inertia_is_symmetric_positive_definite_and_counts_added_mass_once(seed):
    """This includes mj_forwardSkip, with which MuJoCo evaluates again without rebuilding the inertia."""
    parameters = random_parameters(seed)
    model, data = load(parameters, crowded=True)
    rng = np.random.default_rng(seed)
    quat = rng.normal(size=4)
    quat /= np.linalg.norm(quat)
    place(model, data, nu=rng.normal(size=6), quat=quat)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)
    T = np.eye(6)
    T[:3, :3] = rotation(quat).T
    expected = full[6:, 6:] + T.T @ parameters.M_A @ T
    with attach(model, data, "rov", **water_of(parameters)):
        for evaluate in (
            lambda: mujoco.mj_forward(model, data),
            lambda: mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_POS, 1),
            lambda: mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_VEL, 1),
        ):
            evaluate()
            mujoco.mj_fullM(model, data, full)
            assert np.allclose(full[6:, 6:], expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
            assert np.linalg.eigvalsh(full)[0] > 0.0


def flow(parameters, tau, t_end, position, quat, nu):
    """Exact motion under constant thrust, from a tight integration of the twin's matrix equation."""

    def rhs(t, y):
        q = y[3:7] / np.linalg.norm(y[3:7])
        w, x, yy, z = q
        omega = y[10:13]
        E = np.array([[-x, -yy, -z], [w, -z, yy], [z, w, -x], [-yy, x, w]])
        return np.concatenate(
            [rotation(q) @ y[7:10], 0.5 * E @ omega, matrix_acceleration(parameters, y[:3], q, y[7:], tau, t)]
        )

    y = solve_ivp(rhs, (0, t_end), np.r_[position, quat, nu], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return y[:3], y[3:7] / np.linalg.norm(y[3:7]), y[7:]


@pytest.mark.parametrize(
    ("integrator", "turning", "order"),
    [("Euler", True, 1), ("implicitfast", True, 1), ("RK4", True, 2), ("RK4", False, 4)],
)
def test_order_of_convergence(integrator, turning, order):
    """RK4 keeps order 4 in translation; with rotation MuJoCo 3 integrates quaternions to order 2."""
    seed = 7
    parameters = random_parameters(seed) if turning else replace(STILL, r_g=(0.0, 0.0, 0.0))
    tau = np.array([8.0, -5.0, 6.0, 1.0, -2.0, 1.5]) if turning else np.array([0.0, 0.0, 6.0, 0.0, 0.0, 0.0])
    start = (np.zeros(3), np.array([1.0, 0, 0, 0]), np.array([0.3, 0.2, -0.1, 0.2, -0.3, 0.4]) * (1 if turning else 0))
    exact = flow(parameters, tau, 0.8, *start)
    errors = []
    for n in (20, 40, 80):
        model, data = load(replace(parameters, timestep=0.8 / n), crowded=True, option=f'integrator="{integrator}"')
        place(model, data, start[0], start[1], start[2])
        data.ctrl[:] = tau
        with attach(model, data, "rov", **water_of(parameters)):
            mujoco.mj_step(model, data, n)
        reached = state(model, data)
        reached[1][:] *= np.sign(reached[1] @ exact[1])
        errors.append(np.linalg.norm(np.concatenate(reached) - np.concatenate(exact)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < errors[0]
    assert orders.min() > order - 0.25, (errors, orders)


def test_terminal_speed_under_constant_thrust():
    """Z = d w + q w^2 has one positive root w. In heave, the Munk moment does not turn the vehicle over."""
    model, data = load(replace(STILL, timestep=2e-3))
    data.ctrl[2] = 12.0
    with attach(model, data):
        mujoco.mj_step(model, data, 20_000)
    d, q = STILL.D_linear[2, 2], STILL.D_quadratic[2, 2]
    assert np.isclose(state(model, data)[2][2], (-d + np.sqrt(d * d + 4 * q * 12.0)) / (2 * q), rtol=1e-9)


def test_a_neutral_vehicle_drifts_with_the_current():
    v_c = np.array([0.3, -0.2, 0.1])
    model, data = load(replace(STILL, timestep=5e-3))
    with attach(model, data, current_W=v_c):
        mujoco.mj_step(model, data, 80_000)
    _, quat, nu = state(model, data)
    assert np.allclose(rotation(quat) @ nu[:3], v_c, atol=1e-6)
    assert np.allclose(nu[3:], 0.0, atol=1e-6)


def energy_gained(timestep: float) -> float:
    """Largest rate of rise of the energy (kinetic and potential) of a vehicle in still water without thrust [W]."""
    parameters = replace(random_parameters(3), v_c_W=(0, 0, 0), timestep=timestep)
    parameters = replace(parameters, disturbance_bias=(0,) * 6, disturbance_amplitude=(0,) * 6)
    model, data = load(parameters)
    place(model, data, nu=(0.5, -0.4, 0.3, 1.0, -1.5, 2.0))
    full, total, before = np.zeros((6, 6)), 0.0, None
    with attach(model, data):
        for _ in range(round(2.0 / timestep)):
            mujoco.mj_forward(model, data)
            mujoco.mj_fullM(model, data, full)
            R = rotation(data.qpos[3:7])
            weight, buoyancy = parameters.mass * parameters.gravity, parameters.buoyancy
            z = data.qpos[:3][2]
            potential = weight * (z + (R @ parameters.r_g)[2]) - buoyancy * (z + (R @ parameters.r_b)[2])
            energy = 0.5 * data.qvel @ full @ data.qvel + potential
            if before is not None:
                total = max(total, energy - before)
            before = energy
            mujoco.mj_step(model, data)
    return total / timestep


def test_still_water_gives_no_energy_beyond_the_integration_error():
    """The rate of any gain is proportional to the step."""
    coarse, fine = energy_gained(4e-3), energy_gained(1e-3)
    assert fine <= max(coarse / 3.0, 1e-9)


def run_alone(seed: int, steps: int) -> np.ndarray:
    parameters = random_parameters(seed, timestep=1e-3)
    model, data = load(parameters, crowded=True)
    with attach(model, data, "rov", **water_of(parameters)):
        for _ in range(steps // 50):
            mujoco.mj_step(model, data, 50)
    return np.concatenate([data.qpos, data.qvel])


def test_two_simulations_in_two_threads_are_each_as_alone():
    """Each has a second free body, while the main thread attaches and detaches other vehicles."""
    alone = [run_alone(seed, 20_000) for seed in (1, 2)]
    together: dict[int, np.ndarray] = {}
    threads = [threading.Thread(target=lambda s=s: together.update({s: run_alone(s, 20_000)})) for s in (1, 2)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        run_alone(3, 50)
    for thread in threads:
        thread.join()
    assert np.array_equal(together[1], alone[0])
    assert np.array_equal(together[2], alone[1])


def test_the_other_body_feels_no_water():
    model, data = load(STILL, crowded=True)
    with attach(model, data, "rov", current_W=(1.0, 0.0, 0.0)):
        mujoco.mj_step(model, data, 100)
    assert np.isclose(data.qvel[2], -9.81 * 100 * model.opt.timestep)
    assert np.array_equal(data.qvel[:2], [0.0, 0.0])


def test_detaching_leaves_nothing_behind():
    model, data = load(STILL)
    dry = mujoco.MjData(model)
    attachment = attach(model, data, current_W=(0.5, 0.0, 0.0))
    mujoco.mj_step(model, data, 10)
    assert data.qfrc_passive.any()
    attachment.detach()
    attachment.detach()
    assert not data.xfrc_applied.any()
    assert mujoco.get_mjcb_control() is None
    mujoco.mj_resetData(model, data)
    for each in (data, dry):
        mujoco.mj_step(model, each, 10)
    assert np.array_equal(data.qpos, dry.qpos)


def test_a_vehicle_whose_data_is_gone_is_detached():
    model, data = load(STILL)
    attach(model, data)
    assert mujoco.get_mjcb_control() is not None
    del data
    gc.collect()
    assert mujoco.get_mjcb_control() is None


def wet(seed: int, timestep: float = 1e-3):
    """Model and data of a moving vehicle with full matrices and offset centres, and arguments of attach."""
    parameters = random_parameters(seed, timestep=timestep)
    model, data = load(parameters, crowded=True)
    place(model, data, nu=(0.5, -0.4, 0.3, 0.2, -0.3, 0.4))
    return model, data, water_of(parameters)


def motion(data) -> np.ndarray:
    return np.concatenate([data.qpos, data.qvel])


def undisturbed(seed: int, steps: int) -> np.ndarray:
    model, data, water = wet(seed)
    with attach(model, data, "rov", **water):
        mujoco.mj_step(model, data, steps)
        return motion(data)


@pytest.mark.parametrize("state", ["mjSTATE_FULLPHYSICS", "mjSTATE_INTEGRATION", "mjSTATE_USER"])
def test_a_state_that_was_saved_and_restored_has_the_water_once(state):
    """The motion is the same, bit for bit, whichever part of the state is restored."""
    model, data, water = wet(5)
    whole, part = mujoco.mjtState.mjSTATE_INTEGRATION, getattr(mujoco.mjtState, state)
    with attach(model, data, "rov", **water):
        mujoco.mj_step(model, data, 100)
        saved = np.empty(mujoco.mj_stateSize(model, whole))
        mujoco.mj_getState(model, data, saved, whole)
        values = np.empty(mujoco.mj_stateSize(model, part))
        mujoco.mj_getState(model, data, values, part)
        mujoco.mj_step(model, data, 57)
        mujoco.mj_setState(model, data, saved, whole)
        mujoco.mj_setState(model, data, values, part)
        mujoco.mj_step(model, data, 100)
        assert np.array_equal(motion(data), undisturbed(5, 200))


def test_copies_of_attached_data_have_the_water_once():
    """Data is copied from attached to plain data, back, and between two attached ones."""
    expected = undisturbed(6, 300)
    model, data, water = wet(6)
    store, other = mujoco.MjData(model), mujoco.MjData(model)
    with attach(model, data, "rov", **water), attach(model, other, "rov", **water):
        mujoco.mj_step(model, data, 100)
        mujoco.mj_copyData(store, model, data)
        mujoco.mj_step(model, data, 31)
        mujoco.mj_copyData(data, model, store)
        mujoco.mj_step(model, data, 100)
        mujoco.mj_copyData(other, model, data)
        mujoco.mj_step(model, data, 100)
        mujoco.mj_step(model, other, 100)
    assert np.array_equal(motion(data), expected)
    assert np.array_equal(motion(other), expected)


def test_rollouts_in_threads_have_the_water():
    """mujoco.rollout on attached data agrees with a loop of steps."""
    rollout = pytest.importorskip("mujoco.rollout")
    model, data, water = wet(7)
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    several = [mujoco.MjData(model) for _ in range(2)]
    attached = [attach(model, each, "rov", **water) for each in several]
    states, _ = rollout.rollout(model, several, np.tile(state, (8, 1)), nstep=150)
    for each in attached:
        each.detach()
    expected = undisturbed(7, 150)
    for run in states:
        assert np.array_equal(run[-1, 1 : 1 + len(expected)], expected)


@pytest.mark.parametrize("component", range(6))
def test_a_users_own_force_acts_once_component_by_component(component):
    """A component of xfrc_applied, written once or before every step, acts as the same force in qfrc_applied."""
    results = []
    for way in ("once", "each step", "qfrc_applied"):
        model, data, water = wet(8)
        body, dof = model.body("rov").id, model.body("rov").dofadr[0]
        with attach(model, data, "rov", **water):
            force = np.zeros(6)
            force[component] = 2.0
            data.xfrc_applied[body, component] = 2.0
            for _ in range(200):
                if way == "each step":
                    data.xfrc_applied[body, component] = 2.0
                if way == "qfrc_applied":
                    data.xfrc_applied[body] = 0.0
                    mujoco.mj_kinematics(model, data)
                    R, r_com = data.xmat[body].reshape(3, 3), data.xipos[body] - data.xpos[body]
                    data.qfrc_applied[dof : dof + 3] = force[:3]
                    data.qfrc_applied[dof + 3 : dof + 6] = R.T @ (force[3:] + np.cross(r_com, force[:3]))
                mujoco.mj_step(model, data)
            results.append(motion(data))
            if way != "qfrc_applied":
                assert data.xfrc_applied[body, component] == 2.0
                assert np.count_nonzero(data.xfrc_applied) == 1
    assert np.array_equal(results[0], results[1])
    assert np.allclose(results[0], results[2], rtol=0, atol=1e-10)
    assert not np.allclose(results[0], undisturbed(8, 200), atol=1e-3)


def test_the_water_acts_where_passive_forces_are_disabled_and_where_a_stage_is_skipped():
    """qfrc_passive has the hydrodynamic wrench once, whether MuJoCo has reset it or not."""
    model, data, water = wet(9)
    with attach(model, data, "rov", **water):
        mujoco.mj_forward(model, data)
        expected = data.qacc.copy()
        mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_VEL, 1)
        assert np.array_equal(data.qacc, expected)
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SPRING) | int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
        mujoco.mj_forward(model, data)
        assert np.array_equal(data.qacc, expected)


def test_the_current_can_be_changed_and_nothing_else_is_accepted():
    model, data = load(STILL)
    with attach(model, data) as attachment:
        attachment.current_W = (0.3, -0.2, 0.1)
        other, other_data = load(STILL)
        with attach(other, other_data, current_W=(0.3, -0.2, 0.1)):
            for each_model, each in ((model, data), (other, other_data)):
                mujoco.mj_step(each_model, each, 100)
        assert np.array_equal(data.qpos, other_data.qpos)
        with pytest.raises(InputError, match="current_W"):
            attachment.current_W = (0.3, np.nan, 0.1)
        with pytest.raises(AttributeError):
            attachment.current = (0.3, -0.2, 0.1)
        with pytest.raises(AttributeError):
            attachment.wrench = np.zeros(6)


def test_somebody_elses_callback_is_noticed():
    model, data = load(STILL)
    attachment = attach(model, data)
    mujoco.set_mjcb_control(None)
    try:
        with pytest.raises(RuntimeError, match="no longer applied"):
            _ = attachment.wrench
        mujoco.set_mjcb_control(lambda m, d: None)
        with pytest.warns(RuntimeWarning, match="no longer applied"):
            attachment.detach()
        assert mujoco.get_mjcb_control() is not None
    finally:
        mujoco.set_mjcb_control(None)


def test_dm_control_can_step_the_vehicle():
    mujoco_control = pytest.importorskip("dm_control.mujoco", reason="dm-control is not installed")
    physics = mujoco_control.Physics.from_xml_string(vehicle_xml(STILL))
    model, data = load(STILL)
    current_W = (0.3, 0.1, 0.0)
    with (
        attach(physics.model.ptr, physics.data.ptr, current_W=current_W),
        attach(model, data, current_W=current_W),
    ):
        physics.reset()
        mujoco.mj_forward(physics.model.ptr, physics.data.ptr)  # dm_control resets with actuation disabled
        for each in (physics.data, data):
            each.ctrl[:] = [5.0, 1.0, -2.0, 0.1, 0.0, 0.2]
        physics.step(500)
        mujoco.mj_step(model, data, 500)
    assert np.allclose(physics.data.qpos, data.qpos, atol=1e-12)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda m: setattr(m.opt, "solver", mujoco.mjtSolver.mjSOL_PGS), "PGS"),
        (lambda m: setattr(m.opt, "noslip_iterations", 3), "noslip"),
        (lambda m: setattr(m.opt, "integrator", 4), "integrator"),
        (lambda m: setattr(m.opt, "enableflags", int(mujoco.mjtEnableBit.mjENBL_SLEEP)), "sleep"),
        (lambda m: setattr(m.opt, "enableflags", int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)), "diagexact"),
        (lambda m: setattr(m.opt, "disableflags", int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)), "actuation"),
        (lambda m: m.dof_damping.__setitem__(slice(0, 6), 0.1), "joint damping"),
        (lambda m: setattr(m.opt, "density", 1000.0), "density"),
    ],
)
def test_what_would_lose_the_water_is_refused(spoil, reason):
    model, _ = load(STILL)
    spoil(model)
    with pytest.raises(InputError, match=reason):
        attach(model, mujoco.MjData(model))
    assert mujoco.get_mjcb_control() is None


def test_a_body_without_room_for_the_added_mass_is_refused():
    xml = vehicle_xml(replace(STILL, r_g=(0.0, 0.0, 0.0))).replace('simple="false"', "")
    model = mujoco.MjModel.from_xml_string(xml)
    with pytest.raises(InputError, match='simple="false"'):
        attach(model, mujoco.MjData(model))


def test_attaching_twice_or_over_somebody_elses_callback_is_refused():
    model, data = load(STILL)
    with attach(model, data), pytest.raises(InputError, match="already"):
        attach(model, data)
    mujoco.set_mjcb_control(lambda m, d: None)
    try:
        with pytest.raises(InputError, match="mjcb_control"):
            attach(model, data)
    finally:
        mujoco.set_mjcb_control(None)


@pytest.mark.parametrize(
    ("before", "after", "reason"),
    [
        ('name="X_u"', 'name="X_uu_"', "X_u: no such <numeric>"),
        (
            'name="X_uu" size="1" data="-18.18"',
            'name="X_uu" size="1" data="18.18"',
            "X_uu: 18.18 is not dissipative",
        ),
        ('size="36"', 'size="35"', "M_A"),
        ('name="displaced_mass" size="1" data="', 'name="displaced_mass" size="1" data="-', "displaced_mass"),
    ],
)
def test_unphysical_coefficients_are_named(before, after, reason):
    xml = vehicle_xml(STILL)
    assert before in xml
    if before == 'size="36"':
        xml = xml.replace('size="36" data="5.5 ', 'size="35" data="')
    model = mujoco.MjModel.from_xml_string(xml.replace(before, after))
    with pytest.raises(InputError, match=reason):
        attach(model, mujoco.MjData(model))


def test_a_thruster_that_does_not_turn_with_the_vehicle_is_refused():
    """A motor on the free joint pushes along W, which is right at the reference attitude only."""
    xml = vehicle_xml(STILL).replace('<motor name="m0" site="origin"', '<motor name="m0" joint="free"')
    xml = xml.replace('simple="false"><freejoint/>', 'simple="false"><freejoint name="free"/>')
    model = mujoco.MjModel.from_xml_string(xml)
    with pytest.raises(InputError, match="m0: its wrench in B depends on the pose"):
        attach(model, mujoco.MjData(model))


def test_the_factor_is_mujocos(rng):
    """L^T D L of a random matrix, multiplied out."""
    a = rng.normal(size=(6, 6))
    M, L, D_inverse = a @ a.T + np.eye(6), np.zeros(21), np.zeros(6)
    factor(M[np.tril_indices(6)], L, D_inverse)
    unit = np.zeros((6, 6))
    unit[np.tril_indices(6)] = L
    D = np.diag(np.diag(unit))
    np.fill_diagonal(unit, 1.0)
    assert np.allclose(unit.T @ D @ unit, M)
    assert np.allclose(D_inverse, 1.0 / np.diag(D))


LINK = '<body name="link">{}<geom size="0.01" mass="1e-3"/></body>'


@pytest.mark.parametrize("joint", ["hinge", "slide", "ball"])
def test_a_vehicle_with_a_link_on_a_joint_is_refused(joint):
    """The link would be dry. What is fixed to the vehicle is a part of its rigid body."""
    xml = vehicle_xml(STILL).replace('name="origin"/>', f'name="origin"/>{LINK}')
    model = mujoco.MjModel.from_xml_string(xml.format(f'<joint type="{joint}"/>'))
    with pytest.raises(InputError, match=r"body 'link': moves relative to 'rov'.*would be dry"):
        attach(model, mujoco.MjData(model))
    fixed = mujoco.MjModel.from_xml_string(xml.format(""))
    with attach(fixed, mujoco.MjData(fixed)) as attachment:
        assert attachment.vehicle.mass == pytest.approx(STILL.mass + 1e-3)


def numerics(*names: str) -> mujoco.MjModel:
    xml = vehicle_xml(STILL).replace(
        "</custom>", "".join(f'<numeric name="{n}" data="1"/>' for n in names) + "</custom>"
    )
    return mujoco.MjModel.from_xml_string(xml)


@pytest.mark.parametrize(
    ("name", "meant"),
    [("centre_of_buoyancy", "center_of_buoyancy"), ("Displaced_Mass", "displaced_mass"), ("X_uuu", "X_uu")],
)
def test_a_misspelt_coefficient_is_refused(name, meant):
    """It would have no effect. A model may have numerics for other purposes, as another program's settings."""
    model = numerics("max_contact_points", "K_gain", "another/centre_of_buoyancy")
    attach(model, mujoco.MjData(model)).detach()
    model = numerics(name)
    with pytest.raises(InputError, match=f"{name}: is not a coefficient; did you mean '{meant}'"):
        attach(model, mujoco.MjData(model))


@pytest.mark.parametrize(
    ("motor", "reason"),
    [
        ('<motor delay="0.01" nsample="20" ', "m0: is not a plain <motor>"),
        ('<motor ctrlrange="5 -5" ', "m0: ctrlrange 5 -5: the lower limit must come first"),
        ('<motor ctrlrange="-5 -4" forcerange="1 2" ', "m0: its ctrlrange and forcerange do not overlap"),
        ('<motor forcerange="5 -5" ', "m0: forcerange 5 -5: the lower limit must come first"),
    ],
)
def test_a_thruster_that_is_not_gain_times_ctrl_within_its_limits_is_refused(motor, reason):
    model = mujoco.MjModel.from_xml_string(vehicle_xml(STILL).replace("<motor ", motor, 1))
    with pytest.raises(InputError, match=reason):
        attach(model, mujoco.MjData(model))


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda m: m.actuator_gear.__setitem__((3, 1), np.nan), "m3: its site, gear or gain is not finite"),
        (lambda m: m.body_mass.__setitem__(1, np.inf), "M_RB: mass or inertia is not finite"),
        (lambda m: m.body_gravcomp.__setitem__(1, np.nan), "gravcomp"),
    ],
)
def test_a_model_that_is_not_finite_is_refused(spoil, reason):
    model, _ = load(STILL)
    spoil(model)
    with pytest.raises(InputError, match=reason):
        attach(model, mujoco.MjData(model))
