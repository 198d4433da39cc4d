"""Attaching a vehicle to any model: copies, threads, other forces, other callbacks, and refusals."""

import gc
import threading

import mujoco
import numpy as np
import pytest

from twin import TwinParameters
from uvms_mj import Current, InputError, Scenario, attach
from uvms_mj.engine.simulation import Simulation
from vehicles import load, place, random_parameters, vehicle_xml, water_of

STILL = TwinParameters(v_c_W=(0.0, 0.0, 0.0))


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
    with attach(model, data, "rov", current=Current.of((1.0, 0.0, 0.0))):
        mujoco.mj_step(model, data, 100)
    assert np.isclose(data.qvel[2], -9.81 * 100 * model.opt.timestep)
    assert np.array_equal(data.qvel[:2], [0.0, 0.0])


def test_detaching_leaves_nothing_behind():
    model, data = load(STILL)
    dry = mujoco.MjData(model)
    attachment = attach(model, data, current=Current.of((0.5, 0.0, 0.0)))
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
        current = Current.of((0.3, -0.2, 0.1))
        attachment.current_W = current.velocity_W
        other, other_data = load(STILL)
        with attach(other, other_data, current=current):
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
        attach(physics.model.ptr, physics.data.ptr, current=Current.of(current_W)),
        attach(model, data, current=Current.of(current_W)),
    ):
        physics.reset()
        mujoco.mj_forward(physics.model.ptr, physics.data.ptr)  # dm_control resets with actuation disabled
        for each in (physics.data, data):
            each.ctrl[:] = [5.0, 1.0, -2.0, 0.1, 0.0, 0.2]
        physics.step(500)
        mujoco.mj_step(model, data, 500)
    assert np.allclose(physics.data.qpos, data.qpos, atol=1e-12)


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


def test_each_flag_of_a_model_leaves_the_hydrodynamics_or_is_refused():
    """A flag that MuJoCo adds is refused until this test has shown that it changes nothing. No constraint acts here."""
    accepted = set()
    moved = drift(0, 0)
    for kind in (mujoco.mjtDisableBit, mujoco.mjtEnableBit):
        for name, bit in kind.__members__.items():
            if "_" not in name:
                continue
            flags = (int(bit), 0) if "DSBL" in name else (0, int(bit))
            try:
                found = drift(*flags)
            except InputError:
                continue
            assert np.allclose(found, moved, rtol=0.0, atol=1e-12), name
            accepted.add(name)
    assert {"mjDSBL_CONTACT", "mjDSBL_SPRING", "mjENBL_ENERGY"} <= accepted
    assert not accepted & {"mjDSBL_GRAVITY", "mjDSBL_ACTUATION", "mjENBL_SLEEP"}


def drift(disabled: int, enabled: int) -> np.ndarray:
    parameters = random_parameters(5, timestep=1e-3)
    model, data = load(parameters)
    model.opt.disableflags |= disabled
    model.opt.enableflags |= enabled
    with attach(model, data, **water_of(parameters)):
        mujoco.mj_step(model, data, 50)
    return np.concatenate([data.qpos, data.qvel])


def test_a_small_vehicle_is_attached_without_a_warning_of_mujoco():
    """1 kg and 1e-4 kg m^2: the check of MuJoCo's factor takes a matrix that is positive definite in any units."""
    model, data = load(STILL)
    model.body_mass[1], model.body_inertia[1], model.body_ipos[1] = 1.0, [1e-4] * 3, 0.0
    mujoco.mj_setConst(model, data)
    warned, before = list[str](), mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(warned.append)
    try:
        with attach(model, data):
            mujoco.mj_forward(model, data)
    finally:
        mujoco.set_mju_user_warning(before)
    assert not warned


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda option: setattr(option, "disableflags", int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)), "disable gravity"),
        (lambda option: option.gravity.__setitem__(2, -3.7), "buoyancy has"),
        (lambda option: setattr(option, "noslip_iterations", 3), "noslip"),
        (lambda option: setattr(option, "density", 1000.0), "density"),
    ],
    ids=["flag", "gravity", "noslip", "density"],
)
def test_a_setting_that_is_changed_while_a_vehicle_is_attached_is_named(change, words):
    """The weight and the buoyancy would be of two worlds."""
    model, data = load(random_parameters(4))
    attached = attach(model, data)
    mujoco.mj_step(model, data)
    assert np.isfinite(attached.wrench).all()
    change(model.opt)
    mujoco.mj_step(model, data)
    with pytest.raises(RuntimeError, match=words):
        attached.wrench  # noqa: B018
    with pytest.warns(RuntimeWarning, match=words):
        attached.detach()


def test_a_setting_of_the_model_that_is_changed_within_a_simulation_ends_it():
    with Simulation(Scenario.load("push_wall", {"simulation.duration": 1.0}), engine="mujoco") as sim:
        sim.step(10)
        sim.model.opt.disableflags = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
        with pytest.raises(RuntimeError, match="disable gravity"):
            sim.step(10)
