"""Fins moved by an actuator: their deflection is a state of the plant, in both engines, logs, resets and exports."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uvms_mj import Fin, InputError, McapLog, Scenario, Simulation, Trace, attach, simulate
from uvms_mj.control.base import NoClosedForm
from uvms_mj.physics.effects import add_fin, deflected
from uvms_mj.physics.kernels import record_of
from uvms_mj.plant.effects import effect_records
from uvms_mj.plant.settings import Situation

RUDDER = {"area": 0.01, "position": [-0.3, 0.0, 0.0], "mixing_deg": [0.0, 0.0, 0.0, 0.0, 0.0, 2.0], "lag": 0.05}
MOVING = {
    "simulation.timestep": 1e-3,
    "simulation.duration": 0.4,
    "wall.present": False,
    "controller.name": "external",
    "initial.velocity": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
}


def fin_record(fin: Fin):
    return record_of(effect_records({"fins": (fin,)}, Situation())["fins"][0])


def deflections(scenario: Scenario, yaw, engine: str = "free_body") -> np.ndarray:
    """The deflection [deg] before each step in which tau_cmd has the yaw moment yaw(t) [N m]."""
    found = []
    with Simulation(scenario, engine=engine) as sim:
        for _ in range(scenario.steps):
            found.append(math.degrees(sim.signals.fin_deflections[0]))
            sim.tau_cmd[:] = [0.0, 0.0, 0.0, 0.0, 0.0, yaw(sim.t)]
            sim.step(1)
    return np.array(found)


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_deflection_follows_the_mix_with_lag_rate_and_limit(engine):
    scenario, t = Scenario.load("push_wall", MOVING | {"fins": [RUDDER]}), 1e-3 * np.arange(400)
    found = deflections(scenario, lambda t: 3.0, engine)
    assert found == pytest.approx(6.0 * (1.0 - np.exp(-t / 0.05)), abs=1e-12)
    limited = scenario.updated({"fins[0].limit_deg": 5.0, "fins[0].lag": 0.0})
    found = deflections(limited, lambda t: 3.0 if t < 0.2 else -9.0, engine)
    assert found[1:200] == pytest.approx(5.0)
    assert found[202:] == pytest.approx(-5.0)
    slow = scenario.updated({"fins[0].rate_deg": 40.0})
    found = deflections(slow, lambda t: 3.0, engine)
    ramp = 0.1  # the lag asks for 40 deg/s at 2 deg before the end
    assert found[:100] == pytest.approx(40.0 * t[:100], abs=1e-12)
    assert found[101:] == pytest.approx(6.0 - 2.0 * np.exp(-(t[101:] - ramp) / 0.05), abs=1e-3)


FINS = st.builds(
    Fin,
    area=st.floats(0.001, 0.1),
    position=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
    attitude_deg=st.tuples(*[st.floats(-180.0, 180.0)] * 3),
    deflection_deg=st.floats(-45.0, 45.0),
    stall_deg=st.floats(5.0, 60.0),
)
NU = st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6).map(np.array)


@settings(max_examples=200, deadline=None)
@given(FINS, NU, st.floats(-90.0, 90.0))
def test_a_moved_fin_is_a_fixed_one_of_its_deflection_and_takes_energy_out(fin, nu, delta):
    moved, fixed = np.zeros(6), np.zeros(6)
    add_fin(fin_record(fin), math.radians(delta), nu, moved)
    turned = {name: getattr(fin, name) for name in ("area", "position", "attitude_deg", "stall_deg")}
    add_fin(fin_record(Fin(**turned, deflection_deg=fin.deflection_deg + delta)), 0.0, nu, fixed)
    assert moved @ nu <= 1e-12
    assert np.allclose(moved, fixed, rtol=1e-6, atol=1e-6 * (1.0 + abs(fixed).max()))


@settings(max_examples=100, deadline=None)
@given(st.floats(0.0, 1.0), st.floats(0.1, 90.0), st.floats(1e-3, 1e3), st.floats(-1.0, 1.0), NU, st.floats(1e-5, 0.5))
def test_an_actuator_never_passes_its_command_its_limit_or_its_rate(lag, limit, rate, part, tau_cmd, h):
    fin = fin_record(
        Fin(0.01, (0.0, 0.0, 0.0), mixing_deg=(9.0, -5.0, 0.0, 30.0, 2.0, 7.0), lag=lag, limit_deg=limit, rate_deg=rate)
    )
    delta = part * fin.limit
    new, wanted = deflected(fin, delta, tau_cmd, h), np.clip(fin.mixing @ tau_cmd, -fin.limit, fin.limit)
    rounding = 1e-15  # of the sum
    assert abs(new - delta) <= fin.rate * h + rounding
    assert min(delta, wanted) - rounding <= new <= max(delta, wanted) + rounding


SERVO = {"fins": [RUDDER, RUDDER | {"position": [-0.3, 0.0, 0.1]}, {"area": 0.02, "position": [-0.3, 0.1, 0.0]}]}


def test_a_run_is_the_same_in_chunks_after_a_reset_and_in_its_log(tmp_path):
    scenario = Scenario.load("push_wall", SERVO | {"simulation.duration": 0.3, "simulation.timestep": 1e-3}, "pid")
    path = tmp_path / "run.mcap"
    trace = simulate(scenario, engine="free_body", sinks=[McapLog(path)])
    assert trace.fin_deflections.shape == (len(trace.t), 3)
    assert abs(trace.fin_deflections[-1, :2]).max() > 1e-4
    assert not trace.fin_deflections[:, 2].any()
    assert np.array_equal(Trace.load(path).fin_deflections, trace.fin_deflections)
    whole = simulate(scenario, engine="mujoco")
    np.testing.assert_allclose(whole.fin_deflections, trace.fin_deflections, rtol=0.0, atol=1e-8)
    with Simulation(scenario, engine="free_body") as sim:
        for _ in range(2):
            for n in (1, 7, 292):
                sim.step(n)
            assert np.array_equal(sim.signals.p_WB, trace.p_WB[-1])
            assert np.array_equal(sim.signals.fin_deflections, trace.fin_deflections[-1])
            sim.reset()
            assert not sim.signals.fin_deflections.any()
        sim.step(300)
        sim.reset({"fins[0].lag": 0.01})
        sim.step(300)
        other = simulate(scenario.updated({"fins[0].lag": 0.01}), engine="free_body")
        assert np.array_equal(sim.signals.fin_deflections, other.fin_deflections[-1])
        sim.set({"fins[0].lag": 0.2})  # during the run, where the fin stands
        assert np.array_equal(sim.signals.fin_deflections, other.fin_deflections[-1])


def test_where_it_is_not_known_it_is_refused_by_name():
    trace = simulate(Scenario.load("push_wall", SERVO | {"simulation.duration": 0.01}))
    assert isinstance(trace.analytic, NoClosedForm)
    assert "do not know where fins[0] moves" in str(trace.analytic)
    model = mujoco.MjModel.from_xml_path(str(Path(__file__).parents[2] / "models" / "lauv.xml"))
    fins = [Fin(0.01, (0.0, 0.0, 0.0)), Fin(0.01, (0.0, 0.0, 0.0), mixing_deg=(0.0,) * 5 + (1.0,))]
    with pytest.raises(InputError, match=r"fins\[1\]: moves from step to step.*a fin without mixing_deg"):
        attach(model, mujoco.MjData(model), fins=fins)
    with pytest.raises(InputError, match=r"fins\[0\].*lag, rate_deg of an actuator, which a fin has with mixing_deg"):
        Scenario.load("push_wall", {"fins": [{"area": 0.01, "position": [0.0] * 3, "lag": 0.2, "rate_deg": 9.0}]})


def test_the_plant_as_an_fmu_moves_its_fins_by_tau_cmd(tmp_path):
    fmpy = pytest.importorskip("fmpy", reason="needs the extra fmi")
    from uvms_mj.engine.plant_fmu import write_fmu

    scenario = Scenario.load("push_wall", MOVING | {"fins": [RUDDER]})
    path = tmp_path / "plant.fmu"
    write_fmu(scenario, path)
    found = fmpy.simulate_fmu(
        str(path),
        stop_time=0.2,
        output_interval=1e-3,
        start_values={"tau_cmd[6]": 3.0},
        output=["fin_deflections[1]"],
    )
    expected = deflections(scenario, lambda t: 3.0)
    np.testing.assert_allclose(np.degrees(found["fin_deflections[1]"])[:200], expected[:200], rtol=0.0, atol=1e-9)
