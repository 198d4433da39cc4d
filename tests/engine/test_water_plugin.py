"""The water as a plugin of MuJoCo: the accelerations of ``attach``, in MuJoCo's own loops and threads."""

import re
import warnings
from pathlib import Path

import mujoco
import mujoco.rollout
import numpy as np
import pytest

from uvms_mj import InputError, attach
from uvms_mj.engine.water_plugin import immersed, name_of, write_plugin
from uvms_mj.plant.mjcf import Mjcf
from vehicles import random_parameters, vehicle_xml


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> dict[str, Path]:
    """The MJCF of vehicles, whose plugins are loaded. MuJoCo keeps a plugin for the life of the process."""
    found = {}
    for model in ("bluerov1", "bluerov2_heavy", "bluerov2_alpha5"):
        library, path, *_ = write_plugin(model, tmp_path_factory.mktemp(model))
        name = name_of(Mjcf.find(model).vehicle)
        if name not in _loaded:
            mujoco.mj_loadPluginLibrary(str(library))
            _loaded.add(name)
        found[model] = path
    return found


_loaded: set[str] = set()


def moved(model: mujoco.MjModel, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    quat = random.normal(size=4)
    qpos = np.concatenate([random.normal(size=3), quat / np.linalg.norm(quat), 0.3 * random.normal(size=model.nq - 7)])
    return qpos, random.normal(size=model.nv)


@pytest.mark.parametrize("name", ["bluerov1", "bluerov2_heavy", "bluerov2_alpha5"])
def test_accelerations_are_those_of_attach(exported, name):
    model, mjcf = mujoco.MjModel.from_xml_path(str(exported[name])), Mjcf.find(name)
    other = mjcf.compiled(mjcf.spec())
    data, attached, random = mujoco.MjData(model), mujoco.MjData(other), np.random.default_rng(0)
    with attach(other, attached):
        for _ in range(100):
            qpos, qvel = moved(model, random)
            for its_model, its_data in ((model, data), (other, attached)):
                its_data.qpos[:], its_data.qvel[:] = qpos, qvel
                mujoco.mj_forward(its_model, its_data)
            np.testing.assert_allclose(data.qacc, attached.qacc, rtol=1e-12, atol=1e-12 * np.abs(data.qacc).max())


def test_the_current_is_an_attribute(exported, tmp_path):
    text = exported["bluerov1"].read_text()
    text = text.replace('key="current" value="0 0 0"', 'key="current" value="0.3 -0.1 0.05"')
    path = exported["bluerov1"].with_name("current.xml")
    path.write_text(text)
    model, mjcf = mujoco.MjModel.from_xml_path(str(path)), Mjcf.find("bluerov1")
    other = mjcf.compiled(mjcf.spec())
    data, attached = mujoco.MjData(model), mujoco.MjData(other)
    with attach(other, attached) as attachment:
        attachment.current_W = (0.3, -0.1, 0.05)
        for its_model, its_data in ((model, data), (other, attached)):
            mujoco.mj_step(its_model, its_data, 500)
        np.testing.assert_array_equal(data.qpos, attached.qpos)


def test_rollout_in_two_threads_is_that_in_one(exported):
    model, random = mujoco.MjModel.from_xml_path(str(exported["bluerov2_alpha5"])), np.random.default_rng(1)
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    starts = []
    for _ in range(8):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = moved(model, random)
        state = np.zeros(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, state, kind)
        starts.append(state)
    results = []
    for threads in (1, 2):
        datas = [mujoco.MjData(model) for _ in range(threads)]
        states, _ = mujoco.rollout.rollout(model, datas, np.array(starts), nstep=200)
        results.append(states)
    np.testing.assert_array_equal(*results)


def pressing(name: Path, body: str) -> mujoco.MjModel:
    """The vehicle, with a ball on its body, in front of a stiff wall."""
    spec = mujoco.MjSpec.from_file(str(name))
    box, ball = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE
    touching = {"contype": 1, "conaffinity": 1}
    spec.worldbody.add_geom(type=box, size=[0.1, 5.0, 5.0], pos=[0.8, 0.0, 0.0], solref=[-2e4, -100.0], **touching)
    spec.body(body).add_geom(type=ball, size=[0.3, 0.0, 0.0], pos=[0.3, 0.0, 0.0], mass=0.0, **touching)
    return spec.compile()


@pytest.mark.parametrize("name", ["bluerov1", "bluerov2_alpha5"])
def test_a_saved_state_and_a_copy_go_on_as_the_run_itself(exported, name):
    """Pressing on a wall, with an arm and without."""
    body = Mjcf.find(name).vehicle.body
    model = pressing(exported[name], body)
    data = mujoco.MjData(model)

    def press(data: mujoco.MjData, steps: int) -> None:
        data.xfrc_applied[model.body(body).id] = [40.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        mujoco.mj_step(model, data, steps)

    steps = 0
    while data.ncon == 0:
        press(data, 50)
        steps += 50
        assert steps < 20_000
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.zeros(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    copied = mujoco.MjData(model)
    mujoco.mj_copyData(copied, model, data)
    other = mujoco.MjData(model)
    mujoco.mj_setState(model, other, state, kind)
    for each in (data, copied, other):
        press(each, 500)
    np.testing.assert_array_equal(copied.qpos, data.qpos)
    np.testing.assert_array_equal(other.qpos, data.qpos)
    mujoco.mj_forward(model, data)
    mujoco.mj_copyData(copied, model, data)
    mujoco.mj_forwardSkip(model, copied, mujoco.mjtStage.mjSTAGE_POS, 0)  # M is not built anew: no added mass twice
    np.testing.assert_array_equal(copied.M, data.M)
    np.testing.assert_array_equal(copied.qacc, data.qacc)


def test_a_push_at_rest_is_that_of_the_wall(exported):
    """What pushes the vehicle pushes the wall, in the end: the added mass adds no force."""
    body = Mjcf.find("bluerov1").vehicle.body
    model = pressing(exported["bluerov1"], body)
    model.opt.gravity[:] = 0.0
    data, force = mujoco.MjData(model), np.zeros(6)
    data.xfrc_applied[model.body(body).id, 0] = 20.0
    mujoco.mj_step(model, data, 150_000)
    mujoco.mj_contactForce(model, data, 0, force)
    np.testing.assert_allclose(force[0], 20.0, rtol=1e-3)


@pytest.mark.slow
def test_random_vehicles_are_those_of_attach(exported):
    """Each with its own records in its own model: one library."""
    random = np.random.default_rng(5)
    for seed in range(25):
        mjcf = Mjcf("rov.xml", {"rov.xml": vehicle_xml(random_parameters(seed)).encode()})
        model = mujoco.MjModel.from_xml_string(immersed(mjcf)["rov.xml"].decode())
        other = mjcf.compiled(mjcf.spec())
        data, attached = mujoco.MjData(model), mujoco.MjData(other)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # random damping
            held = attach(other, attached)
        qpos, qvel = moved(model, random)
        for its_model, its_data in ((model, data), (other, attached)):
            its_data.qpos[:], its_data.qvel[:] = qpos, qvel
            mujoco.mj_forward(its_model, its_data)
        np.testing.assert_allclose(data.qacc, attached.qacc, rtol=1e-12, atol=1e-12 * np.abs(data.qacc).max())
        held.detach()


def test_several_models_in_one_process_do_not_meet(exported):
    models = [mujoco.MjModel.from_xml_path(str(exported[name])) for name in ("bluerov1", "bluerov2_heavy")]
    datas, alone = [mujoco.MjData(model) for model in models], [mujoco.MjData(model) for model in models]
    for _ in range(200):
        for model, data in zip(models, datas, strict=True):
            mujoco.mj_step(model, data)
    for model, data, other in zip(models, datas, alone, strict=True):
        mujoco.mj_step(model, other, 200)
        np.testing.assert_array_equal(data.qpos, other.qpos)


def test_two_vehicles_attached_to_a_scene_move_as_each_alone(exported):
    scene, alone = mujoco.MjSpec(), mujoco.MjModel.from_xml_path(str(exported["bluerov2_alpha5"]))
    scene.option.timestep, scene.option.cone = alone.opt.timestep, alone.opt.cone
    for k in range(2):
        frame = scene.worldbody.add_frame(pos=[0.0, 3.0 * k, 0.0])
        scene.attach(mujoco.MjSpec.from_file(str(exported["bluerov2_alpha5"])), frame=frame, prefix=f"rov{k}_")
    model = scene.compile()
    both, one = mujoco.MjData(model), mujoco.MjData(alone)
    both.qvel[:] = np.tile(0.1 * np.arange(1, alone.nv + 1), 2)
    one.qvel[:] = both.qvel[: alone.nv]
    mujoco.mj_step(model, both, 300)
    mujoco.mj_step(alone, one, 300)
    np.testing.assert_allclose(both.qvel, np.tile(one.qvel, 2), rtol=1e-9, atol=1e-12)


def test_what_does_not_fit_is_one_sentence(exported, tmp_path):
    text = exported["bluerov1"].read_text()
    for change, words in (
        (('key="current" value="0 0 0"', 'key="current" value="1 2"'), "init"),
        (('key="current" value="0 0 0"', 'key="current" value="nan 0 0"'), "init"),
        ((re.search('<config key="record" value="[^"]*" ?/>', text)[0], ""), "init"),
        ((" 5.5 ", " 5.6 "), "init"),
        (('key="current"', 'key="curent"'), "curent"),
        ((name_of(Mjcf.find("bluerov1").vehicle), "uvms_mj.water_99"), "water_99"),
    ):
        path = exported["bluerov1"].with_name("wrong.xml")
        path.write_text(text.replace(*change))
        with pytest.raises((ValueError, mujoco.FatalError)) as raised:
            mujoco.MjData(mujoco.MjModel.from_xml_path(str(path)))
        assert words in str(raised.value)


def test_a_vehicle_that_is_none_is_refused(tmp_path):
    with pytest.raises(InputError, match="neither a file nor a shipped model"):
        write_plugin("no_such_rov", tmp_path)
