"""Identification: coefficients are found again, intervals have them as often as they say, what can't be told apart is
not given, and broken data are refused by their place."""

import dataclasses
import json
import pickle
import re
from concurrent.futures import Executor, Future
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from uvms_mj import Identification, InputError, Scenario, Simulation
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.plant.changed_coefficients import changed, names, places, twin_of, value_of
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.plant.renumbered import renumbered
from uvms_mj.plant.water import MOST_ROWS
from uvms_mj.studies.identify.data import Channel, Data, Inputs
from uvms_mj.studies.identify.file import Experiment, File, Free, Prior, Start, read
from uvms_mj.studies.identify.fit import Z_95, Weighted, correlation_time, fit
from uvms_mj.studies.identify.plant import Postures, towing, trim
from uvms_mj.studies.identify.problem import Problem
from uvms_mj.studies.identify.result import judge

HEAVY = "bluerov2_heavy"
DEEP = (0.0, 0.0, -5.0)


def motion(channels, span=8.0, spacing=0.1, inputs=None, start=None, **settings) -> Data:
    """A motion whose channels have no values yet."""
    t = np.arange(0.0, span, spacing)
    found = tuple(Channel(name, "", t, np.zeros(len(t))) for name in channels)
    driven = None if inputs is None else {inputs.name: {}}
    begin = start or Start(position=DEEP, velocity=(0.9, 0.3, -0.3, 0.2, 0.2, 0.4))
    experiment = Experiment(data="m.csv", signals={"nu": {}}, inputs=driven, start=begin, **settings)
    return Data(experiment, "m", Path("m.csv"), found, None, {}, inputs, 0.0, float(t[-1]))


def problem_of(free, *data, mjcf: Mjcf | None = None) -> Problem:
    every = tuple(each if isinstance(each, Free) else Free(each) for each in free)
    file = File("own", HEAVY, every, tuple(d.experiment for d in data))
    return Problem.of(file, mjcf or Mjcf.find(HEAVY), data)


def copy_with(values: dict[str, float]) -> Mjcf:
    """A copy of the Heavy with other coefficients."""
    path = Path(__file__).parents[2] / "models" / f"{HEAVY}.xml"
    return Mjcf("other.xml", renumbered(HEAVY, path, "other", values, {"trust": "mine"}))


def measured(problem: Problem, true: np.ndarray, noise: float, seed: int) -> Problem:
    """The problem with the plant's own values for a true vector, and white noise."""
    random, data = np.random.default_rng(seed), []
    for i, each in enumerate(problem.data):
        channels = [
            dataclasses.replace(c, y=y + noise * random.normal(size=len(y)))
            for c, y in zip(each.channels, problem.predicted(i, true), strict=True)
        ]
        data.append(dataclasses.replace(each, channels=tuple(channels)))
    return Problem.of(problem.file, problem.mjcf, data)


def truth(problem: Problem, **values: float) -> np.ndarray:
    """A vector with the starts of the file, and other values by name."""
    found = []
    for each in problem.all:
        start = each.start
        if each.name.startswith("start."):
            start = problem.data[each.of].experiment.start.velocity["uvwpqr".index(each.name[-1])]
        found.append(values.get(each.name, start))
    return np.array(found)


PUSHES = np.random.default_rng(7).normal(size=(30, 6)) * [25.0, 25.0, 30.0, 2.5, 2.5, 4.0]


def pushed(delay: float = 0.0, linear: bool = False) -> Inputs:
    return Inputs("tau", 0.4 * np.arange(30) + delay, PUSHES, linear)


def test_a_changed_vehicle_is_the_one_that_its_written_copy_has():
    """Three ways to a vehicle: changed in memory, written and read again, and begun in a Simulation of the old one."""
    mjcf = Mjcf.find(HEAVY)
    values = {"X_udot": -9.0, "Y_rdot": -0.3, "X_uu": -99.0, "M_q": -1.1, "displaced_mass": 13.6}
    values |= {"center_of_buoyancy.x": 0.004, "center_of_buoyancy.z": 0.023}
    ours = changed(mjcf.vehicle, values)
    assert all(value_of(ours, name) == value for name, value in values.items())
    assert value_of(ours, "N_vdot") == value_of(ours, twin_of("N_vdot")) == -0.3
    written = copy_with(values)
    for each in ("M_A", "D_linear", "D_quadratic", "r_b", "M_RB"):
        np.testing.assert_array_equal(getattr(written.vehicle, each), getattr(ours, each))
    assert (written.vehicle.displaced_mass, written.remarks["trust"]) == (13.6, "mine")
    overrides = {"wall.present": False, "controller.name": "external", "initial.velocity": [1, 0.2, 0, 0, 0.3, 0.5]}
    scenario = Scenario.load("push_wall", overrides)
    with Simulation(scenario, engine="free_body", mjcf=written) as fresh:
        fresh.step(500)
        wanted = fresh.signals.nu.copy()
    with Simulation(scenario, engine="free_body", mjcf=mjcf) as sim:
        sim.step(10)
        plant = dataclasses.replace(sim.setup.plant, vehicle=ours)
        sim.begin(dataclasses.replace(sim.setup, plant=plant))
        sim.step(500)
        np.testing.assert_array_equal(sim.signals.nu, wanted)
        sim.reset()
        sim.step(500)
        assert np.abs(sim.signals.nu - wanted).max() > 1e-3
    with Simulation(scenario, mjcf=mjcf) as sim, pytest.raises(InputError, match="can't change its vehicle"):
        sim.begin(sim.setup)


@pytest.mark.parametrize("values", [{"X_u": 1.0}, {"X_udot": 5.0}, {"displaced_mass": -1.0}, {"Y_rdot": -50.0}])
def test_no_vehicle_is_unphysical(values):
    with pytest.raises(InputError, match=r"dissipative|definite|negative"):
        changed(Mjcf.find(HEAVY).vehicle, values)


def test_every_name_reads_what_it_sets():
    vehicle = Mjcf.find(HEAVY).vehicle
    assert len(names()) == 4 + 3 * 36 == len({*names()})
    for name in names():
        delta = -1e-3 if name in places() else 1e-3
        assert value_of(changed(vehicle, {name: value_of(vehicle, name) + delta}), name) == pytest.approx(
            value_of(vehicle, name) + delta, abs=1e-15
        )


def test_the_force_of_a_towing_holds_the_velocity_in_the_plant():
    """NumPy's steady motion against the kernels: under this wrench a neutral vehicle does not accelerate."""
    mjcf = Mjcf.find(HEAVY)
    vehicle = mjcf.vehicle
    neutral = changed(vehicle, {"displaced_mass": vehicle.mass, "Y_rdot": -0.2, "N_v": -0.7, "Z_qq": -0.4})
    neutral = dataclasses.replace(neutral, r_b=vehicle.r_g)
    overrides = {"wall.present": False, "controller.name": "external", "current.speed": 0.0}
    with Simulation(Scenario.load("push_wall", overrides), engine="free_body", mjcf=mjcf) as sim:
        for nu in np.random.default_rng(3).normal(size=(20, 6)):
            (tau,) = towing(neutral, nu[None])
            sim.reset({"initial.velocity": nu.tolist(), "disturbance.bias": tau.tolist()})
            plant = dataclasses.replace(sim.setup.plant, vehicle=neutral)
            sim.begin(dataclasses.replace(sim.setup, plant=plant))
            before = sim.signals.nu.copy()
            sim.step(1)
            rate = (sim.signals.nu - before) / sim.scenario.simulation.timestep
            turning = np.concatenate([np.cross(nu[3:], nu[:3]), np.zeros(3)])  # B turns during the step
            assert np.abs(rate).max() < 2e-3 * (1.0 + np.abs(turning).max())


def test_a_trim_is_an_attitude_at_rest_of_the_plant():
    mjcf = Mjcf.find(HEAVY)
    vehicle = changed(mjcf.vehicle, {"displaced_mass": 13.5, "center_of_buoyancy.x": 0.003})
    vehicle = changed(vehicle, {"center_of_buoyancy.y": 0.002})
    gravity = float(np.linalg.norm(mjcf.gravity_W))
    tilted = rotation_matrix(quat_from_euler_deg(6.0, -4.0, 30.0))[2]  # upwards, in B
    K = gravity * np.cross(tilted, 13.5 * vehicle.r_b)
    tau = np.array([[0.0] * 6, [0, 0, 0, *K]])
    angles = np.degrees(trim(vehicle, Postures(vehicle, np.zeros((2, 0)), gravity), tau))
    np.testing.assert_allclose(angles[1], [6.0, -4.0], atol=1e-6)
    overrides = {"wall.present": False, "controller.name": "external", "current.speed": 0.0}
    for (roll, pitch), wrench in zip(angles, tau, strict=True):
        start = {"initial.attitude_deg": [roll, pitch, 30.0], "disturbance.bias": wrench.tolist()}
        with Simulation(Scenario.load("push_wall", overrides | start), engine="free_body", mjcf=mjcf) as sim:
            plant = dataclasses.replace(sim.setup.plant, vehicle=vehicle)
            sim.begin(dataclasses.replace(sim.setup, plant=plant))
            sim.step(200)
            assert np.abs(sim.signals.nu[3:5]).max() < 1e-6


TANK = (
    '[[experiment]]\nkind = "towing"\ndata = "tank.csv"\n'
    '[experiment.signals]\nnu = {columns = ["u", "", "", "", "", ""], unit = "UNIT, rad/s"}\n'
    'tau = {columns = ["F", "", "", "", "", ""], unit = "N, N m"}\n'
)


def towed(folder: Path, vehicle: str, free: str, points: dict[float, float], unit: str = "m/s") -> tuple:
    """What the command finds in a table of a speed and a force in surge [N]."""
    (folder / "tank.csv").write_text("u,F\n" + "".join(f"{u},{F}\n" for u, F in points.items()))
    head = f'name = "tank"\nvehicle = "{vehicle}"\n' + "".join(f'[[free]]\nname = "{name}"\n' for name in free.split())
    (folder / "tank.toml").write_text(head + TANK.replace("UNIT", unit))
    return Identification.load(folder / "tank.toml").run(folder / "out").coefficients


def test_a_published_towing_sweep_gives_its_published_coefficients(tmp_path):
    """A BlueROV2 Heavy in a numerical towing tank (k-omega SST), five steady speeds in surge, and the fit that was
    published with them: 0.3878 N s/m and 36.249 N s^2/m^2 with standard errors of 0.0281 and 0.0333 (Juhyunn0,
    BlueROV2-CFD-analysis, 2026, sweep_results.json)."""
    points = {0.2: 1.52027, 0.4: 5.94857, 0.6: 13.28531, 0.8: 23.52181, 1.0: 36.62905}
    linear, quadratic = towed(tmp_path, HEAVY, "X_u X_uu", points)
    assert -linear.value == pytest.approx(0.387812, abs=2e-4)
    assert -quadratic.value == pytest.approx(36.24888, abs=2e-4)
    assert linear.half_width == pytest.approx(Z_95 * 0.028095, rel=1e-2)
    assert quadratic.half_width == pytest.approx(Z_95 * 0.033295, rel=1e-2)


SUBOFF = {
    "bare": {5.92: 87.40, 10.00: 242.2, 11.84: 332.9, 13.92: 451.5, 16.00: 576.9},
    "appended": {5.93: 102.3, 10.00: 283.8, 11.85: 389.2, 13.92: 526.6, 16.00: 675.6},
}
"""Resistance [N] of the DARPA SUBOFF model 5470 (4.356 m) at speeds [kn] in a towing tank, as a bare hull and with sail
and four stern planes: Liu and Huang (1998), Summary of DARPA Suboff experimental program data, CRDKNSWC/HD-1298-11,
Table 14. Left out is its last row, whose two speeds differ (17.99 and 17.79 kn in the copy at hand)."""


def test_a_measured_towing_table_gives_its_published_ratio_of_resistances(tmp_path):
    """Table 14 gives 1.169 for the resistance with appendages over that of the bare hull. Drag of a smooth hull grows
    more slowly than the square of the speed, here by a tenth of it, and an interval says so; both hulls share it, and
    the ratio does not have it."""
    source = Path(__file__).parents[2] / "models" / f"{HEAVY}.xml"
    found = {}
    for hull, points in SUBOFF.items():
        folder = tmp_path / hull
        folder.mkdir()
        for name, content in renumbered(HEAVY, source, "hull", {"X_u": 0.0, "X_uu": -10.0}, {"trust": "mine"}).items():
            (folder / name).write_bytes(content)
        (found[hull],) = towed(folder, "hull.xml", "X_uu", points, "kn")
    ratio = found["appended"].value / found["bare"].value
    spread = np.hypot(*(each.half_width / each.value for each in found.values()))
    assert abs(ratio / 1.169 - 1.0) < 2e-3 < spread < 0.05
    for hull, each in found.items():
        u, force = 0.5144444 * np.array([*SUBOFF[hull]]), np.array([*SUBOFF[hull].values()])
        assert (force / u**2).min() < -each.value < (force / u**2).max()


def with_products(folder: Path, text: str = "Yuv -30 Nuv 0") -> Path:
    """The file of a Heavy with products of velocities."""
    path = folder / "turning.xml"
    heavy = (Path(__file__).parents[2] / "models" / f"{HEAVY}.xml").read_text()
    path.write_text(heavy.replace("</custom>", f'<text name="products" data="{text}"/></custom>'))
    return path


def test_a_product_of_velocities_is_found_again_and_written(tmp_path):
    """A push while it drifts tells Nuv; under its other name it is the same coefficient."""
    path = with_products(tmp_path)
    mjcf = Mjcf.find(str(path))
    problem = problem_of(["Yuv", "Nuv"], motion(["nu.v", "nu.r"], inputs=pushed()), mjcf=mjcf)
    assert [(each.start, each.unit) for each in problem.coefficients] == [(-30.0, "N s^2/m^2"), (0.0, "N s^2/m")]
    true = truth(problem, Yuv=-55.0, Nuv=7.0)
    problem = measured(problem, true, 0.003, 0)
    result = judge(problem, fit(problem))
    for each, value in zip(result.coefficients, true, strict=False):
        assert each.given
        assert abs(each.value - value) < 2.0 * each.half_width
    values = {"Yvu": -55.0, "Nuv": 7.0, "X_u": -9.0}
    written = Mjcf("mine.xml", renumbered("turning", path, "mine", values, {"trust": "mine"})).vehicle
    assert [(each.name, each.coefficient) for each in written.products] == [("Yuv", -55.0), ("Nuv", 7.0)]
    assert changed(mjcf.vehicle, values).products == written.products
    for name, value in values.items():
        assert value_of(written, name) == value


def test_a_product_that_the_file_lacks_is_refused():
    with pytest.raises(InputError, match=r"no such product of velocities; it has none\. Write it there, with 0"):
        problem_of(["Yuv"], motion(["nu.v"]))


@pytest.mark.parametrize("name", ["mass", "vehicle.mass", "inertia.xx", "Ixx", "I_z", "center_of_gravity.z"])
def test_the_rigid_body_is_refused_by_name(name, tmp_path):
    tables = {"name": "a", "vehicle": HEAVY, "free": [{"name": name}], "experiment": [{"data": "m.csv", "signals": {}}]}
    with pytest.raises(InputError, match=r"free\[0\]\.name: .* is not fitted: motions show mass and inertia"):
        read(tables, "f.toml")


def test_a_wrench_of_more_rows_than_a_run_takes_is_refused_by_its_place():
    n = MOST_ROWS + 1
    inputs = Inputs("tau", 0.01 * np.arange(n), np.zeros((n, 6)), True)
    problem = problem_of(["X_u"], motion(["nu.u"], span=0.01 * n, inputs=inputs))
    with pytest.raises(InputError, match=rf"experiment 'm': inputs\.tau: {n} samples are {n} rows of a wrench"):
        problem.predicted(0, problem.start)


NOISE, SAMPLES, TABLES = 0.4, 25, 200


def table(seed: int, prior: Prior | None = None) -> tuple[Problem, np.ndarray]:
    """A towing table of surge with white noise, and its true coefficients."""
    random = np.random.default_rng(seed)
    nu = np.zeros((SAMPLES, 6))
    nu[:, 0] = np.linspace(-1.2, 1.2, SAMPLES)
    true = {"X_u": random.uniform(-20, -8), "X_uu": random.uniform(-200, -80)}
    force = towing(changed(Mjcf.find(HEAVY).vehicle, true), nu)[:, 0] + NOISE * random.normal(size=SAMPLES)
    experiment = Experiment(data="t.csv", signals={"nu": {}, "tau": {}}, kind="towing")
    channel = Channel("tau.X", "N", np.arange(float(SAMPLES)), force)
    data = Data(experiment, "t", Path("t.csv"), (channel,), None, {"nu": nu})
    return problem_of([Free("X_u", prior=prior), "X_uu"], data), np.array([*true.values()])


def test_intervals_of_95_percent_have_the_true_value_in_95_percent_of_tables():
    """Seeds 0 to 199. The bound is three standard deviations of a count of independent tables, whose two intervals are
    taken as one."""
    inside = 0
    for seed in range(TABLES):
        problem, true = table(seed)
        found = fit(problem)
        inside += int((np.abs(found.x - true) <= Z_95 * found.deviation(problem)).sum())
    share = inside / (2 * TABLES)
    assert abs(share - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / TABLES)


def test_a_linear_fit_is_the_closed_form_with_its_prior():
    """Weighted least squares and a normal prior: the posterior mean and covariance, for a given noise."""
    problem, _ = table(5, Prior(-12.0, 0.8))
    data = problem.data[0]
    channel = dataclasses.replace(data.channels[0], sigma=NOISE)
    problem = Problem.of(problem.file, problem.mjcf, [dataclasses.replace(data, channels=(channel,))])
    found = fit(problem)
    u = data.given["nu"][:, 0]
    A = np.stack([-u, -np.abs(u) * u], axis=1)
    precision = A.T @ A / NOISE**2 + np.diag([1.0 / 0.8**2, 0.0])
    mean = np.linalg.solve(precision, A.T @ channel.y / NOISE**2 + [-12.0 / 0.8**2, 0.0])
    np.testing.assert_allclose(found.x, mean, rtol=1e-6)
    least = np.sqrt(np.diag(np.linalg.inv(precision)))
    widened = found.deviation(problem) / least
    assert np.all(widened > 0.999)
    assert np.all(widened < np.sqrt(2.0))  # by residuals that happen to be correlated, or larger than said


COAST = ("X_udot", "X_u", "X_uu")


def test_a_coast_tells_ratios_and_a_known_push_tells_all():
    """M nu_dot + D nu = 0: a decay shows D/M alone. What it can't tell apart is named, and not given."""
    start, neutral = Start(position=DEEP, velocity=(1.0, 0, 0, 0, 0, 0)), copy_with({"displaced_mass": 13.5})
    coast = problem_of(COAST, motion(["nu.u"], start=start), mjcf=neutral)
    coast = measured(coast, truth(coast, X_udot=-8.0, X_u=-10.0, X_uu=-150.0), 0.003, 0)
    result = judge(coast, fit(coast))
    assert [each.given for each in result.coefficients] == [False] * 3
    ((together, deviation),) = result.apart
    assert {*together} == {*COAST}
    assert deviation > 1.0
    assert all("can't tell it from" in each.why_not for each in result.coefficients)
    both = problem_of(
        COAST, motion(["nu.u"], start=start), motion(["nu.u"], inputs=pushed(), start=start), mjcf=neutral
    )
    true = truth(both, X_udot=-8.0, X_u=-10.0, X_uu=-150.0)
    both = measured(both, true, 0.003, 0)
    result = judge(both, fit(both))
    assert all(each.given for each in result.coefficients)
    assert result.apart == ()
    for each, value in zip(result.coefficients, true, strict=False):
        assert abs(each.value - value) < 2.0 * each.half_width


def test_a_prior_gives_what_it_says_and_no_more():
    start = Start(position=DEEP, velocity=(1.0, 0, 0, 0, 0, 0))
    free = [Free("X_udot", prior=Prior(-8.0, 0.4)), "X_u", "X_uu"]
    problem = problem_of(free, motion(["nu.u"], start=start), mjcf=copy_with({"displaced_mass": 13.5}))
    problem = measured(problem, truth(problem, X_udot=-8.0, X_u=-10.0, X_uu=-150.0), 0.003, 1)
    by_name = {each.name: each for each in judge(problem, fit(problem)).coefficients}
    assert by_name["X_uu"].given
    assert by_name["X_udot"].why_not == "only its prior says it, and the data do not show it"
    assert by_name["X_uu"].half_width / 150.0 >= 0.9 * Z_95 * 0.4 / (Mjcf.find(HEAVY).vehicle.mass + 8.0)


@pytest.mark.parametrize("linear", [False, True])
def test_a_delay_and_a_clock_move_the_data_in_time(linear):
    """An input that acts later is an input whose times are later, also between two steps; a slow clock stretches."""
    late = problem_of(["X_u"], motion(["nu.u", "nu.r"], inputs=pushed(0.0337, linear), fit=("delay", "clock")))
    soon = problem_of(["X_u"], motion(["nu.u", "nu.r"], inputs=pushed(0.0, linear), fit=("delay", "clock")))
    wanted = late.predicted(0, truth(late, delay=0.0))
    found = soon.predicted(0, truth(soon, delay=0.0337))
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    slow = soon.predicted(0, truth(soon, clock=0.02))
    fine = problem_of(["X_u"], motion(["nu.u", "nu.r"], span=8.2, spacing=0.102, inputs=pushed(0.0, linear)))
    np.testing.assert_allclose(
        [each[:79] for each in slow], [e[:79] for e in fine.predicted(0, truth(fine))], atol=2e-5
    )


def test_thrusts_and_pulses_push_as_their_wrench():
    """The same push as a wrench, as thrusts and as pulses of a T200: two ways through the plant."""
    vehicle = Mjcf.find(HEAVY).vehicle
    u = np.random.default_rng(2).uniform(-5.0, 5.0, size=(30, 8))
    t = 0.4 * np.arange(30)
    by_thrust = problem_of(["X_u"], motion(["nu.u", "nu.q"], inputs=Inputs("u", t, u, False)))
    by_wrench = problem_of(["X_u"], motion(["nu.u", "nu.q"], inputs=Inputs("tau", t, u @ vehicle.B.T, False)))
    x = truth(by_thrust)
    np.testing.assert_allclose(by_thrust.predicted(0, x), by_wrench.predicted(0, x), atol=1e-9)
    neutral = Inputs("pwm", t, np.full((30, 8), 1500.0), False)
    still = Inputs("tau", t, np.zeros((30, 6)), False)
    pulses, none = (problem_of(["X_u"], motion(["nu.u", "nu.q"], inputs=each)) for each in (neutral, still))
    np.testing.assert_allclose(pulses.predicted(0, x), none.predicted(0, x), atol=1e-12)
    ahead = Inputs("pwm", t, np.tile([1500.0] * 4 + [1650.0] * 4, (30, 1)), False)
    up = problem_of(["Z_w", "Z_ww"], motion(["nu.w"], inputs=ahead, fit=("delay",)))
    true = truth(up, Z_w=-25.0, Z_ww=-220.0, delay=0.06)
    up = measured(up, true, 0.003, 0)
    result = judge(up, fit(up))
    for each, value in zip(result.coefficients, true, strict=False):
        assert each.given
        assert abs(each.value - value) < 2.0 * each.half_width


def test_motions_with_noise_delay_clock_and_current_give_the_true_coefficients():
    """Seeds 0 to 3: of 12 intervals at least 10 have the true value, which chance denies once in a thousand."""
    inside = 0
    for seed in range(4):
        asked = motion(["nu.u", "nu.v", "nu.r"], 11.0, inputs=pushed(), fit=("delay", "clock", "current"))
        problem = problem_of(["X_u", "Y_vdot", "X_uu"], asked)
        random = np.random.default_rng(100 + seed)
        values = {
            name: value_of(problem.mjcf.vehicle, name) * random.uniform(0.7, 1.3) for name in ("X_u", "Y_vdot", "X_uu")
        }
        values |= {"delay": 0.05, "clock": 0.01, "current.x": 0.1, "current.y": -0.1}
        true = truth(problem, **values)
        problem = measured(problem, true, 0.005, seed)
        found = fit(problem)
        assert found.given.all()
        inside += int((np.abs(found.x - true) <= Z_95 * found.deviation(problem))[:3].sum())
    assert inside >= 10


def test_samples_that_are_correlated_count_as_fewer():
    """An autoregressive residual has the correlation time (1 + a)/(1 - a); white noise has one sample."""
    random, n, a = np.random.default_rng(0), 200_000, 0.8
    white = random.normal(size=n)
    slow = lfilter([1.0], [1.0, -a], white)
    assert correlation_time(white) < 1.1
    assert correlation_time(slow) == pytest.approx((1 + a) / (1 - a), rel=0.1)


class Elsewhere(Executor):
    """An executor that calls on a copy, as another process would."""

    size = 2

    def submit(self, function, /, *args, **kwargs):
        future = Future()
        future.set_result(pickle.loads(pickle.dumps(function(*pickle.loads(pickle.dumps(args))))))
        return future


def test_the_derivatives_are_the_same_on_workers():
    driven = motion(["nu.u"], 2.0, inputs=pushed(), fit=("delay",))
    problem = problem_of(["X_u", "X_uu"], motion(["nu.u"], 2.0), driven)
    free = np.arange(len(problem.all))
    here, there = (
        Weighted(problem, problem.weights(), free, problem.start, [0, 1], each) for each in (None, Elsewhere())
    )
    z = np.full(len(free), 0.01)
    np.testing.assert_array_equal(here.jacobian(z), there.jacobian(z))
    every = here.jacobian(z)
    for column in range(len(free)):
        step = np.eye(len(free))[column] * 1e-4
        central = (here(z + step) - here(z - step)) / 2e-4
        np.testing.assert_allclose(every[:, column], central, atol=1e-3 * np.abs(central).max())


FILE = """
name = "mine"
vehicle = "bluerov2_heavy"
[[free]]
name = "X_uu"
[[free]]
name = "X_u"
[[experiment]]
data = "log.csv"
time = {column = "t", unit = "s"}
held_out_from = 5.0
[experiment.signals.nu]
columns = ["u", "", "", "", "", ""]
[experiment.inputs.tau]
columns = ["force", "", "", "", "", ""]
"""


def rows() -> list[tuple[float, float, float]]:
    """Times, speeds and forces of a log, from the plant."""
    force = np.where(np.arange(80) // 20 % 2, 10.0, 35.0)
    inputs = Inputs("tau", 0.1 * np.arange(80), np.eye(6)[0] * force[:, None], False)
    problem = problem_of(["X_u", "X_uu"], motion(["nu.u"], 8.0, inputs=inputs, start=Start(position=DEEP)))
    problem = measured(problem, truth(problem, X_u=-10.0, X_uu=-150.0), 0.004, 0)
    channel = problem.data[0].channels[0]
    return [*zip(channel.t.tolist(), channel.y.tolist(), force.tolist(), strict=True)]


def csv(table) -> str:
    return "t,u,force\n" + "".join(f"{t:.3f},{u:.6f},{f:.2f}\n" for t, u, f in table)


@pytest.fixture(scope="module")
def log():
    return rows()


def test_csv_parquet_and_mcap_are_one_log(log, tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq
    from mcap.writer import Writer

    (tmp_path / "log.csv").write_text("t,u,force\n" + "".join(f"{t!r},{u!r},{f!r}\n" for t, u, f in log))
    columns = dict(zip(("t", "u", "force"), np.array(log).T, strict=True))
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    with open(tmp_path / "log.mcap", "wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("s", "jsonschema", b"{}")
        channel = writer.register_channel("/rov", "json", schema)
        for t, u, f in log:
            stamp = round(t * 1e9)
            writer.add_message(channel, stamp, json.dumps({"u": u, "force": f}).encode(), stamp)
        writer.finish()
    texts = {
        "csv": FILE,
        "parquet": FILE.replace("log.csv", "log.parquet"),
        "mcap": FILE.replace("log.csv", "log.mcap").replace('"u"', '"/rov.u"').replace('"force"', '"/rov.force"'),
    }
    found = []
    for kind, text in texts.items():
        (tmp_path / f"{kind}.toml").write_text(text)
        found.append(fit(Identification.load(tmp_path / f"{kind}.toml").problem).x)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9)
    np.testing.assert_allclose(found[2], found[0], rtol=1e-6)


def test_an_interrupted_fit_goes_on_and_writes_a_vehicle(log, tmp_path):
    (tmp_path / "log.csv").write_text(csv(log))
    (tmp_path / "i.toml").write_text(FILE)
    whole = Identification.load(tmp_path / "i.toml").run(tmp_path / "whole")

    def stop(done: int, rms: float) -> None:
        if done == 2:
            raise KeyboardInterrupt

    asked, out = Identification.load(tmp_path / "i.toml"), tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        asked.run(out, progress=stop)
    assert [path.name for path in out.iterdir()] == ["journal.json"]
    counts = list[int]()
    again = asked.run(out, progress=lambda done, rms: counts.append(done))
    assert counts[0] == 3
    np.testing.assert_allclose(again.x, whole.x, rtol=1e-5)
    vehicle = Mjcf.find(str(out / "mine.xml")).vehicle
    for each in again.coefficients:
        assert value_of(vehicle, each.name) == each.value
    (held,) = again.held_out
    assert held.fitted < 0.5 * held.mean
    assert held.fitted == pytest.approx(0.004, rel=0.4)
    (tmp_path / "log.csv").write_text(csv(log).replace("35.00", "36.00", 1))
    with pytest.raises(InputError, match="another identification"):
        Identification.load(tmp_path / "i.toml").run(out)
    (out / "journal.json").write_text("{")
    with pytest.raises(InputError, match=r"journal\.json: is damaged"):
        asked.run(out)


def at(row: int, column: int, cell: str):
    """A change of one cell of the CSV."""

    def change(text: str) -> str:
        lines = [line.split(",") for line in text.splitlines()]
        lines[row - 1][column] = cell
        return "\n".join(map(",".join, lines))

    return change


def scaled(column: int, factor: float):
    def change(text: str) -> str:
        head, *lines = text.splitlines()
        cells = [line.split(",") for line in lines]
        for each in cells:
            each[column] = repr(float(each[column]) * factor)
        return "\n".join([head, *map(",".join, cells)])

    return change


def without(first: int, last: int):
    return lambda text: "\n".join(line for i, line in enumerate(text.splitlines(), 1) if not first <= i <= last)


PULSES = FILE.replace("inputs.tau", "inputs.pwm").replace(
    '["force", "", "", "", "", ""]', '["force", "", "", "", "", "", "", ""]'
)
BROKEN = {
    "no time": (lambda text: text.replace("t,u", "seconds,u", 1), FILE, r"log\.csv: has no column 't' of the time"),
    "wrong header": (lambda text: text.replace(",u,", ",surge,", 1), FILE, r"log\.csv: has no column 'u'"),
    "two headers": (lambda text: text.replace("t,u,force", "t,u,u", 1), FILE, r"2 columns are called 'u'"),
    "no header": (lambda text: text.split("\n", 1)[1], FILE, r"has no column 't'"),
    "semicolons": (lambda text: text.replace(",", ";"), FILE, r"separated by ';'"),
    "commas in numbers": (lambda text: text.replace(".", ","), FILE, r"row 2: has \d cells"),
    "a word": (at(10, 1, "fast"), FILE, r"column 'u', row 10: 'fast' is not a number"),
    "NaN": (at(10, 1, "nan"), FILE, r"column 'u', row 10: nan is not finite"),
    "infinite": (at(12, 2, "inf"), FILE, r"column 'force', row 12: inf is not finite"),
    "an underscore": (at(12, 1, "1_0"), FILE, r"column 'u', row 12: '1_0' is not a number"),
    "time goes back": (at(20, 0, "0.5"), FILE, r"column 't', row 20: the time goes back"),
    "time stands still": (at(20, 0, "1.7"), FILE, r"column 't', row 20: the time goes back or stands still"),
    "a time is missing": (at(20, 0, ""), FILE, r"column 't', row 20: the time is missing"),
    "a short row": (lambda text: text + "8.0,0.1\n", FILE, r"row 82: has 2 cells"),
    "constant speed": (scaled(1, 0.0), FILE, r"column 'u' is 0 in all its samples"),
    "speed in mm/s": (scaled(1, 1e3), FILE, r"column 'u', sample \d+: .* beyond 50 m/s; check its unit"),
    "force in mN": (scaled(2, 1e4), FILE, r"column 'force', sample 1: 350000 is beyond 100000"),
    "time in ms": (scaled(0, 1e3), FILE, r"samples are 100 s apart; check time\.unit"),
    "time in days": (scaled(0, 1.0 / 86400.0), FILE, r"apart; check time\.unit"),
    "a gap of the input": (without(30, 45), FILE, r"column 'force': has a gap of 1\.7 s after 2\.7 s"),
    "an input is missing": (at(5, 2, ""), FILE, None),
    "no pulses": (lambda text: text, PULSES, r"column 'force', sample 1: 35 us is no pulse width"),
    "empty": (lambda text: "", FILE, r"log\.csv: has fewer than two rows"),
    "one row": (without(3, 99), FILE, r"log\.csv: has fewer than two rows"),
    "three rows": (without(5, 99), FILE, r"column 'u' has 3 samples in the part that is used; 4 are needed"),
    "not text": (lambda text: text.encode("utf-16").decode("latin-1"), FILE, r"log\.csv"),
    "a unit": (lambda text: text, FILE + 'unit = "lb"\n', r"inputs|signals\.tau\.unit: 'lb' is no unit"),
    "no file": (lambda text: text, FILE.replace("log.csv", "log2.csv"), r"log2\.csv: there is no such file"),
    "another kind": (lambda text: text, FILE.replace("log.csv", "log.xlsx"), r"log\.xlsx"),
    "no such signal": (
        lambda text: text,
        FILE.replace("signals.nu", "signals.speed"),
        r"signals\.speed: is not taken",
    ),
    "five columns": (
        lambda text: text,
        FILE.replace('["u", "", "", "", "", ""]', '["u", "", "", "", ""]'),
        r"needs 6 names",
    ),
    "nothing is used": (
        lambda text: text,
        FILE.replace("held_out_from = 5.0", "between = [90.0, 99.0]"),
        r"has 0 samples",
    ),
    "nothing is held out": (lambda text: text, FILE.replace("= 5.0", "= 500.0"), r"nothing is held out: the data end"),
    "all is held out": (lambda text: text, FILE.replace("= 5.0", "= 0.1"), r"less than a tenth"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_data_are_refused_by_one_message_that_names_the_place(name, log, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    change, text, said = BROKEN[name]
    Path("log.csv").write_text(change(csv(log)))
    Path("i.toml").write_text(text)
    if said is None:  # a missing sample is a gap of one, over which the input is held
        Identification.load("i.toml")
        return
    with pytest.raises(InputError) as caught:
        Identification.load("i.toml")
    assert re.search(said, str(caught.value)), str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("X_uu", "X_uuu"), r"free\[0\]\.name: 'X_uuu' is no coefficient"),
        (('name = "X_u"', 'name = "X_uu"'), r"free\[1\]\.name: X_uu is the same coefficient"),
        (("data =", "date ="), "experiment"),
        (('name = "mine"', 'name = "my rov"'), "letters, digits and _ only"),
        (('name = "X_u"', 'name = "X_u"\nbounds = [0.0, -1.0]'), "the lower one must come first"),
        (('name = "X_u"', 'name = "X_u"\nbounds = [-5.0, 0.0]'), "not within its bounds"),
        (('name = "X_u"', 'name = "X_u"\nprior = {mean = 1.0, sigma = 0.0}'), "must be greater than 0"),
        (("held_out_from = 5.0", "held_out = true"), "all are held out"),
    ],
)
def test_a_file_that_asks_for_nonsense_is_refused_by_its_key(change, said, log, tmp_path):
    (tmp_path / "log.csv").write_text(csv(log))
    (tmp_path / "i.toml").write_text(FILE.replace(*change, 1))
    with pytest.raises(InputError, match=said):
        Identification.load(tmp_path / "i.toml")


def test_an_arm_at_rest_gives_the_centre_of_buoyancy(tmp_path):
    """Postures of an arm and the attitudes that they trim: the height by which the attitudes were made is found."""
    mjcf = Mjcf.find("bluerov2_alpha5")
    q = np.random.default_rng(4).uniform(0.3, 1.2, size=(40, len(mjcf.vehicle.arm.links)))
    true = changed(mjcf.vehicle, {"center_of_buoyancy.z": 0.031})
    angles = trim(true, Postures(true, q, float(np.linalg.norm(mjcf.gravity_W))), np.zeros((40, 6)))
    noisy = np.degrees(angles + 0.003 * np.random.default_rng(5).normal(size=angles.shape))
    heads = [f"q{k}" for k in range(q.shape[1])]
    lines = [",".join(["roll", "pitch", "yaw", *heads])]
    lines += [",".join(map(repr, [*a, 10.0, *b])) for a, b in zip(noisy.tolist(), q.tolist(), strict=True)]
    (tmp_path / "rest.csv").write_text("\n".join(lines))
    (tmp_path / "i.toml").write_text(
        'name = "mine"\nvehicle = "bluerov2_alpha5"\n[[free]]\nname = "center_of_buoyancy.z"\n[[experiment]]\n'
        'data = "rest.csv"\nkind = "trim"\n[experiment.signals.quat_WB]\ncolumns = ["roll", "pitch", "yaw"]\n'
        f'unit = "deg"\n[experiment.signals.q]\ncolumns = {heads}\n'
    )
    problem = Identification.load(tmp_path / "i.toml").problem
    (each,) = judge(problem, fit(problem)).coefficients
    assert each.given
    assert abs(each.value - 0.031) < 2.0 * each.half_width < 0.004


def test_a_towing_table_is_read_with_its_units(tmp_path):
    nu = np.linspace(0.1, 1.0, 12)
    force = 12.0 * nu + 130.0 * nu**2
    lines = ["knots,kilos", *(f"{a / 0.514444444444:.8f},{b / 9.80665:.8f}" for a, b in zip(nu, force, strict=True))]
    (tmp_path / "tow.csv").write_text("\n".join(lines))
    (tmp_path / "i.toml").write_text(
        'name = "mine"\nvehicle = "bluerov2_heavy"\n[[free]]\nname = "X_u"\n[[free]]\nname = "X_uu"\n[[experiment]]\n'
        'data = "tow.csv"\nkind = "towing"\n[experiment.signals.nu]\ncolumns = ["knots", "", "", "", "", ""]\n'
        'unit = "kn, rad/s"\n[experiment.signals.tau]\ncolumns = ["kilos", "", "", "", "", ""]\nunit = "kgf, N m"\n'
    )
    np.testing.assert_allclose(fit(Identification.load(tmp_path / "i.toml").problem).x, [-12.0, -130.0], rtol=1e-5)


def test_an_attitude_is_compared_by_its_turn():
    """A pendulum in roll, seen by its attitude alone: what is measured is the plant's own."""
    start = Start(position=DEEP, attitude_deg=(25.0, 0.0, 40.0))
    blank = motion(["attitude.roll", "attitude.pitch", "attitude.yaw"], 10.0, start=start)
    n = len(blank.channels[0].t)
    quat = np.tile(quat_from_euler_deg(25.0, 0.0, 40.0), (n, 1))
    problem = problem_of(["center_of_buoyancy.z", "K_p"], dataclasses.replace(blank, quat=quat))
    true = problem.start.copy()
    true[:2] = 0.018, -0.4
    vehicle = problem.vehicle(true)
    from uvms_mj.studies.identify.problem import _plants, _start

    swing = _plants(problem)[0].rows(vehicle, _start(problem.data[0]), np.zeros(3), 0.0)
    every = round(blank.channels[0].t[1] / (swing["t"][1, 0] - swing["t"][0, 0]))
    seen = dataclasses.replace(problem.data[0], quat=swing["quat_WB"][::every][:n].copy())
    found = fit(Problem.of(problem.file, problem.mjcf, [seen]))
    np.testing.assert_allclose(found.x[:2], true[:2], rtol=2e-3)


def test_a_file_has_its_keys_in_one_table():
    with pytest.raises(InputError, match="fre: no such key; did you mean 'free'"):
        read({"name": "a", "vehicle": HEAVY, "fre": []}, "f.toml")


def test_a_log_too_long_for_a_fit_is_refused_with_the_way_and_the_way_leads_on(log, tmp_path, monkeypatch):
    monkeypatch.setattr("uvms_mj.studies.identify.data.MOST", 50)
    (tmp_path / "log.csv").write_text(csv(log))
    (tmp_path / "i.toml").write_text(FILE)
    with pytest.raises(InputError, match=r"log\.csv: has 80 samples .* a fit takes 50: cut it with between"):
        Identification.load(tmp_path / "i.toml")
    (tmp_path / "i.toml").write_text(FILE.replace("held_out_from = 5.0", "between = [2.0, 4.0]"))
    assert len(Identification.load(tmp_path / "i.toml").problem.data[0].channels[0].t) == 21


def test_an_input_is_that_of_the_part_that_is_used(log, tmp_path):
    """A gap beyond the part is no fault, and the part gives the residuals that a file of it alone gives."""
    lines = without(70, 79)(csv(log)).splitlines()
    part = [lines[0], *(each for each in lines[1:] if 2.0 <= float(each.split(",")[0]) <= 4.0)]
    text, found = FILE.replace("held_out_from = 5.0", "between = [2.0, 4.0]"), []
    for name, rows in (("whole", lines), ("alone", part)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "log.csv").write_text("\n".join(rows))
        (tmp_path / name / "i.toml").write_text(text)
        problem = Identification.load(tmp_path / name / "i.toml").problem
        found.append((problem.data[0].inputs, problem.errors(0, problem.start)[0]))
    (whole, errors), (_, alone) = found
    assert len(whole.t) <= len(part) + 1
    np.testing.assert_array_equal(errors, alone)
