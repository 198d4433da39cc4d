"""MuJoCo's warnings become this package's, in the thread that stepped, and leave no file."""

import threading
import warnings

import mujoco
import numpy as np

from uvms_mj import Scenario, simulate
from uvms_mj.plant.mjcf import MujocoWarning, mujoco_warnings

SHORT = {"simulation.duration": 0.005}


def test_mujocos_warnings_are_ours_and_leave_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = mujoco.get_mju_user_warning()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scenario = Scenario.load("push_wall", SHORT | {"wall.stiffness": 1e9, "wall.position": -1e6})
        assert simulate(scenario).status.name == "unstable"
    assert [str(each.message)[:8] for each in said if each.category is MujocoWarning] == ["MuJoCo: "]
    assert mujoco.get_mju_user_warning() is before
    assert not list(tmp_path.iterdir())


def test_warnings_of_mujoco_reach_the_thread_that_stepped(monkeypatch):
    """Two threads collect warnings at the same time. Afterwards the user's handler is installed again."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    said: dict[str, list[str]] = {"0": [], "1": []}
    monkeypatch.setattr(
        warnings, "warn", lambda text, *_, **__: said[threading.current_thread().name].append(str(text))
    )
    inside, first_left = threading.Barrier(2), threading.Event()

    def collect(dof):
        with mujoco_warnings():
            inside.wait(10)
            if dof == 1:
                first_left.wait(10)
            data = mujoco.MjData(model)
            data.qvel[dof] = np.nan
            mujoco.mj_step(model, data)
        first_left.set()

    def mine(text):
        pass

    mujoco.set_mju_user_warning(mine)
    try:
        threads = [threading.Thread(target=collect, args=(dof,), name=str(dof)) for dof in (0, 1)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert mujoco.get_mju_user_warning() is mine
    finally:
        mujoco.set_mju_user_warning(None)
    for dof in ("0", "1"):
        (text,) = said[dof]
        assert f"QVEL at DOF {dof}" in text
