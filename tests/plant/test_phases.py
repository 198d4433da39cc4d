"""Phases of sines: of a current, of a disturbance and of a wall, by the recorded signals of a run and in a study."""

import numpy as np
import pytest

from short_study import HERE
from uvms_mj import InputError, Scenario, simulate
from uvms_mj.physics.kernels import record_of
from uvms_mj.physics.varying import add_sines, sine_rates, varying
from uvms_mj.studies.study import Study

OPEN = {"wall.present": False, "simulation.duration": 1.5, "simulation.timestep": 1e-3, "current.speed": 0.0}


def test_a_phase_shifts_a_sine_in_time_and_its_rate_is_its_derivative():
    record, value, rate, h = np.zeros(1, varying(3)), np.zeros(3), np.zeros(3), 1e-5
    record["amplitude"], record["frequency"], record["phase"] = (0.3, 0.2, 0.0), (0.7, 1.1, 2.0), (0.4, -2.0, 1.0)
    series = record_of(record)

    def at(t: float) -> np.ndarray:
        add_sines(series, t, value)
        return value.copy()

    for t in (0.0, 0.37, 2.2):
        sine_rates(series, t, rate)
        np.testing.assert_allclose(rate, (at(t + h) - at(t - h)) / (2.0 * h), atol=1e-8)
        late = [0.3 * np.sin(2.0 * np.pi * 0.7 * (t + 0.4 / (2.0 * np.pi * 0.7)))]
        late.append(0.2 * np.sin(2.0 * np.pi * 1.1 * (t - 2.0 / (2.0 * np.pi * 1.1))))
        np.testing.assert_allclose(at(t), [*late, 0.0], atol=1e-15)


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_quarter_of_a_period_makes_a_cosine(engine):
    current = {"current.amplitude": [0.2, 0.1, 0.05], "current.frequency_hz": [0.5, 1.0, 2.0]}
    push = {"disturbance.amplitude": [3.0, 2.0, 1.0, 0.1, 0.2, 0.3], "disturbance.frequency_hz": [1.5] * 6}
    phases = {"current.phase_deg": 90.0, "disturbance.phase_deg": [90.0, 90.0, 0.0, 90.0, -90.0, 180.0]}
    trace = simulate(Scenario.load("push_wall", OPEN | current | push | phases), engine=engine, log_rate="full")
    t = trace.t[:, None]
    cosines = [0.2, 0.1, 0.05] * np.cos(2.0 * np.pi * np.array([0.5, 1.0, 2.0]) * t)
    np.testing.assert_allclose(trace.v_c_W, cosines, atol=1e-14)
    sine, cosine = np.sin(2.0 * np.pi * 1.5 * t), np.cos(2.0 * np.pi * 1.5 * t)
    wrench = np.hstack([3.0 * cosine, 2.0 * cosine, sine, 0.1 * cosine, -0.2 * cosine, -0.3 * sine])
    np.testing.assert_allclose(trace.tau_dist, wrench, atol=1e-13)


def test_the_closed_form_and_the_announced_push_do_not_depend_on_a_phase():
    """A sine has no mean; the bound on its rate is that of its amplitude."""
    base = {"disturbance.amplitude": [0.5, 0, 0, 0, 0, 0], "disturbance.frequency_hz": [0.1] * 6}
    found = []
    for phase in (0.0, 77.0):
        scenario = Scenario.load("push_wall", base | {"disturbance.phase_deg": phase, "simulation.duration": 12.0})
        found.append(simulate(scenario, engine="free_body"))
    assert found[0].analytic.force == found[1].analytic.force
    for trace in found:
        assert trace.push[-1] == pytest.approx(trace.analytic.force, rel=1e-4)
    assert np.abs(found[0].tau_dist - found[1].tau_dist).max() > 0.1


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"current.phase_deg": 90.0}, "belongs to a sine, and its amplitude is 0"),
        (
            {"disturbance.phase_deg": [0, 90, 0, 0, 0, 0], "disturbance.amplitude": [1.0, 0, 0, 0, 0, 0]},
            "amplitude is 0",
        ),
        ({"disturbance.phase_deg": 90, "disturbance.amplitude": [1.0, 0, 0, 0, 0, 0]}, r"frequency_hz\[0\] is 0"),
        ({"current.phase_deg": [90.0, 0.0]}, "has 2 values; 3 are needed"),
    ],
)
def test_a_phase_of_no_sine_is_refused(overrides, said):
    with pytest.raises(InputError, match=said):
        simulate(Scenario.load("push_wall", OPEN | overrides))


def test_a_study_draws_phases(tmp_path):
    tables = {
        "name": "phases",
        "base": {
            "scenario": "push_wall",
            "simulation": {"duration": 0.02, "timestep": 1e-3},
            "wall": {"present": False},
            "disturbance": {"amplitude": [1.0, 0, 0, 0, 0, 0], "frequency_hz": [0.5, 0, 0, 0, 0, 0]},
            "walls": [
                {"shape": "plane", "position": [1.5, 0, 0], "turn_amplitude_deg": [0, 1.0, 0], "turn_frequency_hz": 0.4}
            ],
        },
        "design": {"kind": "random", "runs": 3},
        "vary": [
            {"key": key, "distribution": "uniform", "low": 0.0, "high": 360.0}
            for key in ("disturbance.phase_deg", "walls[0].turn_phase_deg")
        ],
    }
    rows = Study.from_dict(tables).run(tmp_path / "phases", executor=HERE).frame
    assert (rows["status"] == "completed").all()
    assert rows["walls[0].turn_phase_deg"].nunique() == rows["disturbance.phase_deg"].nunique() == 3
