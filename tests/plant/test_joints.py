"""Friction and stops of joints in MuJoCo, with the constants of a run, against closed forms."""

import math

import mujoco
import pytest

from uvms_mj.plant.arm import STOP_TIME, set_constraints

INERTIA = 0.01
PENDULUM = f"""
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 0"/>
  <worldbody>
    <body>
      <inertial pos="0 0 0" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>
      <joint axis="0 0 1" limited="{{limited}}" range="-0.5 0.2" frictionloss="{{friction}}"/>
    </body>
  </worldbody>
</mujoco>
"""


def joint(timestep: float, friction: float = 0.0, limited: bool = False) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(friction=friction, limited=str(limited).lower()))
    model.opt.timestep, model.opt.tolerance = timestep, 1e-15
    set_constraints(model)
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("timestep", [1e-4, 2e-4, 1e-3])
def test_a_joint_that_sticks_creeps_as_its_closed_form_says(timestep):
    """Two thirds of the Coulomb torque; proportional to load, time step and inverse inertia."""
    model, data = joint(timestep, friction=1.5)
    data.qfrc_applied[0] = 1.0
    mujoco.mj_step(model, data, 100)
    before = data.qpos[0]
    mujoco.mj_step(model, data, 1000)
    speed = (data.qpos[0] - before) / (1000 * timestep)
    assert speed == pytest.approx(1e-6 * timestep / INERTIA, rel=1e-6)


def test_a_joint_that_slips_is_given_exactly_the_coulomb_torque():
    """And one that slides to a stop stands after the time J v / tau_c, to one step."""
    model, data = joint(1e-4, friction=1.5)
    data.qfrc_applied[0] = 2.5
    mujoco.mj_step(model, data, 1000)
    assert data.qfrc_constraint[0] == pytest.approx(-1.5, rel=1e-12)
    assert data.qvel[0] == pytest.approx(0.1 * (2.5 - 1.5) / INERTIA, rel=1e-9)
    data.qfrc_applied[0] = 0.0
    steps = math.ceil(INERTIA * data.qvel[0] / 1.5 / 1e-4 - 1e-6)
    mujoco.mj_step(model, data, steps - 1)
    assert data.qvel[0] > 0.0
    mujoco.mj_step(model, data, 2)
    assert abs(data.qvel[0]) < 1e-3 * 1.5 * 1e-4 / INERTIA


def test_added_mass_changes_neither_the_creep_nor_the_sliding_torque():
    """Added to mjData.M in the callback, ten times the inertia of the joint."""

    def add_mass(model, data):
        data.M[0] += 10.0 * INERTIA
        mujoco.mj_factorM(model, data)

    model, data = joint(1e-4, friction=1.5)
    data.qfrc_applied[0] = 1.0
    mujoco.set_mjcb_control(add_mass)
    try:
        mujoco.mj_step(model, data, 500)
        before = data.qpos[0]
        mujoco.mj_step(model, data, 1000)
        speed = (data.qpos[0] - before) / 0.1
        data.qfrc_applied[0] = 2.5
        mujoco.mj_step(model, data, 500)
        torque, acceleration = data.qfrc_constraint[0], data.qacc[0]
    finally:
        mujoco.set_mjcb_control(None)
    assert speed == pytest.approx(1e-6 * 1e-4 / INERTIA, rel=1e-3)
    assert torque == pytest.approx(-1.5, rel=1e-12)
    assert acceleration == pytest.approx(1.0 / (11.0 * INERTIA), rel=1e-9)


@pytest.mark.parametrize("timestep", [1e-4, 1e-3])
def test_a_stop_is_a_critically_damped_spring_of_its_closed_form(timestep):
    model, data = joint(timestep, limited=True)
    data.qfrc_applied[0] = 2.0
    mujoco.mj_step(model, data, round(3.0 / timestep))
    stiffness = 2.0 / (data.qpos[0] - 0.2)
    assert stiffness == pytest.approx(INERTIA / (STOP_TIME**2 * 0.01 * 0.01), rel=1e-6)
    assert stiffness == pytest.approx(2.5e7, rel=1e-3)


def test_a_joint_that_runs_into_its_stop_goes_v_T_over_e_beyond_and_returns_with_a_ninth():
    """The free response of a critically damped spring, x = v t exp(-t / T): peak v T / e, and at most v / e^2 back."""
    model, data = joint(2e-5, limited=True)
    data.qvel[0] = 3.0
    positions, velocities = [], []
    for _ in range(10_000):
        mujoco.mj_step(model, data)
        positions.append(data.qpos[0])
        velocities.append(data.qvel[0])
    assert max(positions) - 0.2 == pytest.approx(3.0 * STOP_TIME / math.e, rel=0.03)
    assert -min(velocities) <= 3.0 / math.e**2
    assert -min(velocities) == pytest.approx(3.0 / math.e**2, rel=0.1)
