"""A run is a function of its scenario and seed alone: one sweep over engines, vehicles and stages.

Log rate, chunks, threads, earlier runs, resets and logs change no bit. Both engines, and machine code and plain Python,
agree to rounding.
"""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from everything import EVERYTHING, everything
from recorded import same
from traces import products_are_plain_sums
from tree_run import AT_TOOL, MOVING, OF_JOINTS
from uvms_mj import McapLog, Scenario, Simulation, Trace, simulate
from uvms_mj.engine.native import pipeline
from uvms_mj.engine.native.compilation import NotCompiled
from uvms_mj.engine.vehicle_run import PlainPythonWarning
from uvms_mj.scenario import STAGES
from uvms_mj.stages.signals import BAND

DURATION = 0.3
pytestmark = [
    pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning"),
    pytest.mark.filterwarnings("ignore:the law sees a jump"),
]
USERS = Path(__file__).parents[1] / "data" / "users_stages.py"
WALL = {"wall.position": -1e-5, "wall.friction": 0.3, "reference.step_time": 0.0, "reference.target": [0.05, 0.02, 0.0]}
SHAKEN = {"disturbance.deviation": [1.0] * 6, "vehicle.mass": 1.05, "vehicle.added_mass": 1.2} | WALL
SHAKEN |= {
    "disturbance.table": [[0.0] * 7, [0.02, 2.0, 0.0, 1.0, 0.0, 0.0, 0.0]],
    "current.table": [[0.0, 0.1, 0.0, 0.0], [0.3, 0.0, 0.1, 0.0]],
    "current.shear": [[0.0, 1.0], [5.0, 0.8]],
    "tether.length": 1.0,  # a reset changes an effect and adds none
}
OF_EACH_ROOM = {
    **{"navigation.name": f"{USERS}:Noisy", "navigation.period": 2e-3},
    **{"reference.name": f"{USERS}:Circle", "reference.period": 1e-3},
    **{"controller.name": f"{USERS}:Pid", "controller.period": 4e-4},
    **{"actuation.name": f"{USERS}:Lag", "actuation.period": 6e-4},
}
FELT = {
    "encoder.name": "encoder",
    "encoder.noise": 1e-3,
    "encoder.resolution": 1e-4,
    "wrist.name": "sensor",
    "wrist.site": "tool",
}
FELT |= {"encoder.velocity": "measured", "encoder.velocity_noise": 1e-2, "wrist.force_noise": 0.1}
ON_TREE = {"controller.name": "impedance", "controller.delay": 2e-3, "controller.period": 1e-3} | MOVING | FELT
ON_TREE |= {"tether.length": 1.0}
RUNS = {
    "sensors": ("free_body", EVERYTHING["sensors"]),
    "filter": ("free_body", EVERYTHING["filter"]),
    "sensors in MuJoCo": ("mujoco", EVERYTHING["sensors"]),
    "a rough wall in MuJoCo": ("mujoco", SHAKEN),
    "users' stages": ("free_body", {k: v for k, v in SHAKEN.items() if "reference" not in k} | OF_EACH_ROOM),
    "joints": ("mujoco", ON_TREE | OF_JOINTS),
    "a tool": ("mujoco", ON_TREE | AT_TOOL | {"impedance.M_d": "natural"}),
}
"""Engine and overrides of push_wall of each run."""
FOR_A_RESET = ("initial", "simulation", "controller.delay")
OTHER = {
    "initial": {"initial.position": [-0.01, 0.02, 0.0], "initial.velocity": [0.1, 0.0, 0.0, 0.0, 0.1, 0.0]},
    "water": {
        "current.table": [[0.0, 0.1, 0.0, 0.0], [0.1, 0.2, 0.0, 0.0], [0.3, 0.0, 0.0, 0.1]],
        "current.shear": [[0.0, 1.0], [5.0, 0.5]],
        "disturbance.deviation": [0.0] * 6,
        "disturbance.table": [[0.0] * 7, [0.01, 1.0, 0.0, 2.0, 0.0, 0.0, 0.0]],
        "tether.length": 3.0,
    },
    "gains": {
        "impedance.K_d": [100.0, 900.0, 900.0, 40.0, 40.0, 40.0],
        "impedance.damping_ratio": 0.6,
        "task.F_1": 2.0,
        "estimates.inertia": 1.2,
        "estimates.damping": 0.5,
    },
    "time": {"simulation.timestep": 2e-4, "simulation.duration": 0.1, "simulation.seed": 3},
    "wall": {"wall.stiffness": 2e4, "wall.damping": 10.0, "wall.friction": 0.1},
}
"""Changes of a reset: what every scenario has."""
FULL = (np.diag([20.0, 25.0, 25.0, 4.0, 4.0, 4.0]) + 0.5).tolist()
OWN = {
    "sensors": {
        **{"navigation.velocity_noise": 0.1, "navigation.velocity_delay": 0.025, "navigation.force_dropout": 0.2},
        **{"thrusters.voltage": 12.0, "thrusters.lag": "first_order", "thrusters.failed": 2, "controller.delay": 0.01},
        "impedance.schedule": [{"time": 0.01, "K_f": [0.5] * 6}],
    },
    "filter": {"navigation.gyro_noise": 5e-3, "navigation.imu_period": 0.01, "observer.threshold": 0.0},
    "a rough wall in MuJoCo": {
        "reference.target": [0.06, 0.0, 0.01],
        "reference.bandwidth": 3.0,
        "reference.attitude_deg": [5.0, 10.0, 3.0],
        "reference.waypoints": [{"time": t, "position": [t, 0.0, 0.0]} for t in (0.01, 0.02, 0.03)],
        "impedance.M_d": FULL,
        "impedance.D_d": FULL,
        "impedance.F_d": [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        "task.integral": True,
        **{"controller.k_1": 7.0, "controller.nominal": False, "controller.period": 1e-3},
        **{"navigation.period": 1e-3, "actuation.period": 6e-4},
        **{"tether.length": 30.0, "tether.diameter": 0.01},
    },
    "users' stages": {"navigation.sigma": 5e-3, "reference.radius": 0.3, "controller.k": 100.0, "actuation.tau": 0.05},
    "joints": {"initial.joints": [0.4, 0.0, 0.2], "joints.target": [0.7, 0.0, 0.1], "encoder.bias": 0.01},
    "a tool": {
        **{
            "initial.joints": [0.4, 0.0, 0.2],
            "posture.joints": [0.2, 0.1, 0.2],
            "posture.order": ["joints", "station"],
        },
        **{"encoder.delay": 2e-3, "wrist.site": "flap", "estimates.links": [{"name": "rod", "inertia": 1.5}]},
    },
}
"""Changes of a reset: what a run has alone."""


def scenario_of(name, **more):
    given = {"simulation.duration": DURATION, "simulation.seed": 1} | more
    return Scenario.load("push_wall", RUNS[name][1] | given)


def run_of(name, seed=1, **options):
    return simulate(scenario_of(name, **{"simulation.seed": seed}), engine=RUNS[name][0], **options)


@pytest.fixture(scope="module", params=RUNS)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def original(name):
    return run_of(name, log_rate="full")


def test_every_element_acts(name, original):
    """Otherwise the other tests would prove little: contact, noise, dropped and late samples, gusts, lag, schedule."""
    assert original.touches[-1] > 0 or np.abs(original.f_contact_W).max() > 0.0
    if name in EVERYTHING:
        assert (np.abs(original["f_contacts_W"]).max(axis=(0, 2)) > 0.1).sum() == 2  # at the wall and at the cylinder
        for signal in ("v_c_W", "v_c_dot_W", "tau_dist"):
            assert np.ptp(original[signal], axis=0).min() > 0.0, signal
        for late, early in (("u", "u_cmd"), ("tau_cmd_delayed", "tau_cmd"), ("p_WB_m", "p_WB"), ("nu_m", "nu")):
            assert not np.array_equal(original[late], original[early]), late
        assert np.ptp(original["K_f"], axis=0).max() == 0.5
        assert not np.array_equal(original["f_contact_m_W"], original["f_contact_W"])
        assert np.abs(original["tau_lost"]).max() > 0.0
    if name in ("joints", "a tool"):
        for late, early in (("q_m", "q"), ("q_dot_m", "q_dot"), ("tau_cmd_delayed", "tau_cmd")):
            assert not np.array_equal(original[late], original[early]), late


def test_the_log_rate_changes_nothing(name, original):
    bands = {edge for band in BAND.values() for edge in band}  # of the steps between rows
    for rate, every in (("1000", 10), ("400", 25), ("10", 1000)):
        trace = run_of(name, log_rate=rate)
        for signal in {*trace} - bands:
            assert np.array_equal(trace[signal], original[signal][::every], equal_nan=True), (signal, rate)


def test_the_chunks_of_steps_change_nothing(name, original):
    with Simulation(scenario_of(name), engine=RUNS[name][0]) as sim:
        for n in (1, 1, 7, 92, 399, 1000, 500, 1, 999):
            sim.step(n)
            for signal in ("p_WB", "quat_WB", "nu", "p_d", "eta_e"):
                assert np.array_equal(sim.signals[signal], original[signal][sim.steps]), (signal, sim.steps)
            for signal in ("tau", "u", "nu_dot", "f_contact_W", "wall_work"):  # of the step before
                assert np.array_equal(sim.signals[signal], original[signal][sim.steps - 1]), (signal, sim.steps)


def test_a_thread_beside_another_seed_changes_nothing(name, original):
    with ThreadPoolExecutor(2) as pool:
        mine, other = pool.map(lambda seed: run_of(name, seed, log_rate="full"), (1, 2))
    same(original, mine)
    assert not np.array_equal(other.p_WB, original.p_WB)
    drawn = {"v_c_W", "tau_dist", "p_WB_m", "f_contact_m_W", "q_m", "q_dot_m"} & {*original}
    assert all(not np.array_equal(other[each], original[each]) for each in drawn if np.ptp(original[each]))


def test_a_reset_is_a_new_simulation_whatever_was_before(name):
    """With another seed and every other kind of number, one after the other and all in one, and back to the start."""
    base, engine = scenario_of(name), RUNS[name][0]
    worlds = [*OTHER.values(), {}, OWN.get(name, {}), {k: v for world in OTHER.values() for k, v in world.items()}, {}]
    with Simulation(base, engine=engine) as used:
        used.step(500)
        for seed, world in enumerate(worlds):
            used.reset(world, seed=seed)
            compare(used, base.updated(world | {"simulation.seed": seed}))
            used.set({key: value for key, value in world.items() if not key.startswith(FOR_A_RESET)})
            used.step(5)
            used.reset()
            compare(used, base)


def compare(used, scenario):
    """Step a Simulation that was reset and a new one."""
    with Simulation(scenario, engine=used.engine) as new:
        for sim in (used, new):
            sim.step(300)
        for signal in used.signals:  # a new one may record the motion of the water, too
            assert np.array_equal(used.signals[signal], new.signals[signal], equal_nan=True), (scenario, signal)


def test_a_log_is_read_back_and_repeats(name, original, tmp_path):
    log = tmp_path / "run.mcap"
    logged = run_of(name, log_rate="full", sinks=[McapLog(log)])
    same(original, logged)
    read = Trace.load(log)
    same(original, read)
    assert read.header.engine == RUNS[name][0]
    given = {f"{table}.name": RUNS[name][1].get(f"{table}.name") for table in STAGES}
    scenario = read.scenario.updated({key: value for key, value in given.items() if ".py:" in str(value)})
    same(original, simulate(scenario, log_rate="full", engine=read.header.engine, mjcf=read.header.mjcf))


def test_plain_python_computes_what_machine_code_does(name, original, monkeypatch):
    """Users' stages bit for bit where NumPy rounds as machine code does, and the shipped ones but for sums whose order
    machine code may choose."""

    def refuse(its):
        raise NotCompiled("for the test")

    monkeypatch.setattr(pipeline.CompiledStage, "_compiled", refuse)
    with pytest.warns(PlainPythonWarning, match="for the test"):
        plain = simulate(scenario_of(name, **{"simulation.duration": 0.005}), engine=RUNS[name][0], log_rate="full")
    assert plain.touches[-1] > 0 or "sensors" in name or name in ("filter", "joints", "a tool")
    for signal in set(plain) - {"final_impulse", "final_high", "final_low"}:
        few = original[signal][: len(plain)]
        rounding = 0.0 if name == "users' stages" and products_are_plain_sums() else 1e-9
        np.testing.assert_allclose(plain[signal], few, rtol=rounding, atol=1e-2 * rounding, err_msg=signal)


@pytest.mark.parametrize("name", EVERYTHING)
def test_both_engines_agree(name):
    """Their equations differ in the order of rounding only."""
    scenario = everything(name, simulation__duration=1.0)
    ours, theirs = (simulate(scenario, engine=engine) for engine in ("free_body", "mujoco"))
    assert np.linalg.norm(ours.f_contact_W[-500:], axis=1).max() > 1.0
    assert np.abs(ours.p_WB - theirs.p_WB).max() < 1e-6
    assert np.abs(ours.quat_WB - theirs.quat_WB).max() < 1e-6
