"""A study whose true answer is known: the rest force over random stiffness, target, desired force and disturbance."""

import numpy as np
import pytest

from uvms_mj import Study

STUDY = """
[base]
scenario = "push_wall"
simulation.timestep = 5e-4
simulation.duration = 5.0
initial.position = [0.98, 0.0, 0.0]
reference.step_time = 0.0
reference.bandwidth = 6.0
[run]
engine = "free_body"
[design]
runs = 80
seed = 12
[keep]
metrics = ["contact.final_N", "contact.settled"]
[[vary]]
key = "wall.stiffness"
distribution = "loguniform"
low = 2e3
high = 2e5
[[vary]]
key = "reference.target[0]"
distribution = "uniform"
low = 1.01
high = 1.03
[[vary]]
key = "impedance.F_d[0]"
distribution = "uniform"
low = -1.0
high = 0.2
[[vary]]
key = "disturbance.bias[0]"
distribution = "normal"
mean = 0.0
deviation = 0.5
"""

DRAWN = ("wall.stiffness", "reference.target[0]", "impedance.F_d[0]")


def rest_force(k_c, x_d, F_d):
    """K_d (x - x_d) = K_f (f - F_d) at rest, eq. (7), with the wall's force f = -k_c (x - x_c) on the vehicle. A law
    that integrates rejects the disturbance."""
    K_d, x_c = 150.0, 1.0
    return (K_d * (x_d - x_c) - F_d) / (1.0 + K_d / k_c)


@pytest.mark.slow
def test_the_rows_have_the_distribution_of_the_closed_form(tmp_path):
    (tmp_path / "s.toml").write_text(STUDY)
    study = Study.load(tmp_path / "s.toml")
    base = study.plan.base
    assert (base.impedance.K_d[0], base.impedance.K_f[0], base.wall.position) == (150.0, 1.0, 1.0)
    frame = study.run(tmp_path / "out").frame
    assert (frame["status"] == "completed").all()
    assert frame["contact.settled"].all()
    force, expected = frame["contact.final_N"].to_numpy(), rest_force(*(frame[key].to_numpy() for key in DRAWN))
    assert np.abs(force / expected - 1.0).max() < 1e-4

    n, chance = 1_000_000, np.random.default_rng(3)
    k_c = np.exp(chance.uniform(np.log(2e3), np.log(2e5), n))
    truth = rest_force(k_c, chance.uniform(1.01, 1.03, n), chance.uniform(-1.0, 0.2, n))
    rows, deviation = len(force), truth.std()
    kurtosis = ((truth - truth.mean()) ** 4).mean() / deviation**4
    assert abs(force.mean() - truth.mean()) < 4.0 * deviation / np.sqrt(rows)
    assert abs(force.std() - deviation) < 4.0 * deviation * np.sqrt((kurtosis - 1.0) / (4.0 * rows))
    for q in (0.05, 0.25, 0.5, 0.75, 0.95):
        assert abs((force < np.quantile(truth, q)).mean() - q) < 4.0 * np.sqrt(q * (1.0 - q) / rows)


def test_the_programs_closed_form_is_that_of_each_row(tmp_path):
    """The program solves for the pose at rest. A run of one step suffices for it."""
    text = STUDY.replace('"contact.final_N"', '"contact.analytic_N"').replace("duration = 5.0", "duration = 5e-4")
    (tmp_path / "s.toml").write_text(text.replace("runs = 80", "runs = 50"))
    frame = Study.load(tmp_path / "s.toml").run(tmp_path / "out").frame
    expected = rest_force(*(frame[key].to_numpy() for key in DRAWN))
    assert len(expected) == 50
    assert np.abs(frame["contact.analytic_N"].to_numpy() / expected - 1.0).max() < 1e-9
