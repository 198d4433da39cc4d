"""A scenario that its caller steps: the same run whole, in parts and after a reset; users' stages of every room."""

import copy
import gc
import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import numpy as np
import pytest

from uvms_mj import Diverged, InputError, Scenario, Simulation, StageFault, simulate
from uvms_mj.engine.native import pipeline
from uvms_mj.engine.native.compilation import NotCompiled

WALL = {"simulation.duration": 0.2, "wall.position": -1e-5, "wall.friction": 0.3}
MOVING = {**WALL, "reference.step_time": 0.0, "reference.target": [0.05, 0.02, 0.0]}
USERS = Path(__file__).parents[1] / "data" / "users_stages.py"
OF_EACH_ROOM = {
    "navigation.name": f"{USERS}:Noisy",
    "reference.name": f"{USERS}:Circle",
    "controller.name": f"{USERS}:Pid",
    "actuation.name": f"{USERS}:Lag",
}


def state(sim):
    """All that a run has come to: the state, and every signal."""
    return np.concatenate([sim.data.qpos, sim.data.qvel, *(np.ravel(sim.signals[name]) for name in sim.signals)])


def after(scenario, steps):
    """All that a fresh Simulation has come to."""
    with Simulation(scenario) as sim:
        sim.step(steps)
        return state(sim)


@pytest.fixture(scope="module")
def sim():
    with Simulation(Scenario.load("push_wall", MOVING)) as sim:
        yield sim


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"wall.stiffness": 1e9}, "is too much for a time step"),
        ({"impedance.M_d": [-1.0] * 6}, "not positive definite"),
        ({"vehicle.model": "bluerov2_heavy"}, "vehicle.model: reset can't change the vehicle; make a new Simulation"),
        ({"vehicle.mass": 1.1}, "vehicle.mass: reset can't change the vehicle; make a new Simulation"),
        ({"controller.name": "fosm"}, "controller.name: reset can't change a stage"),
    ],
)
def test_after_a_reset_that_is_refused_the_run_goes_on_as_if_nobody_had_asked(sim, overrides, said):
    sim.reset(overrides={"current.speed": 0.1})
    sim.step(50)
    before = state(sim)
    with pytest.raises(InputError, match=said):
        sim.reset(overrides=overrides)
    assert np.array_equal(state(sim), before)
    assert sim.scenario.current.speed == 0.1
    sim.step(50)
    assert np.array_equal(state(sim), after(Scenario.load("push_wall", {**MOVING, "current.speed": 0.1}), 100))


@pytest.mark.parametrize("overrides", [{"vehicle.model": "bluerov2_heavy"}, {"controller.name": "fosm"}])
def test_a_change_that_needs_another_simulation_is_refused_under_the_callers_name(sim, overrides):
    for name, call in (("reset", sim.reset), ("set", sim.set)):
        with pytest.raises(InputError, match=rf"^{name}: \w+\.\w+: {name} can't change .*make a new Simulation"):
            call(overrides)


def test_a_word_for_signals_names_them(sim):
    with pytest.raises(AttributeError, match="no signal 'force'; did you mean 'f_contact_W' or 'force_peak'"):
        _ = sim.signals.force
    trace = simulate(Scenario.load("push_wall", {"simulation.duration": 0.002}))
    with pytest.raises(AttributeError, match="no signal 'force'; did you mean 'push' or 'f_contact_W' or 'force_peak'"):
        _ = trace.force
    with pytest.raises(AttributeError, match="did you mean 'tau_cmd'"):
        _ = trace.tau_cmdd


def test_a_law_by_its_name_is_sent_to_the_scenario():
    with pytest.raises(InputError, match=r"""Scenario\.load\("push_wall", controller='gsta'\)"""):
        simulate(controller="gsta")


def test_a_wrench_and_thrusts_from_outside_do_what_a_law_and_its_allocation_do():
    law = Scenario.load("push_wall", MOVING, "fosm")
    wrench = Scenario.load("push_wall", MOVING, "external")
    thrusts = law.updated({"actuation.name": "external"})
    with Simulation(law) as ours, Simulation(wrench) as theirs, Simulation(thrusts) as direct:
        assert "s" not in theirs.signals
        for _ in range(300):
            ours.step()
            theirs.tau_cmd[:] = ours.signals.tau_cmd
            theirs.step()
            direct.u[:] = ours.u
            direct.step()
            for name in ("p_WB", "nu", "u", "tau", "f_contact_W", "eta_e"):
                assert np.array_equal(ours.signals[name], theirs.signals[name]), name
                assert np.array_equal(ours.signals[name], direct.signals[name]), name
        with pytest.raises(ValueError, match="read-only"):
            ours.tau_cmd[0] = 1.0
        with pytest.raises(ValueError, match="read-only"):
            ours.signals.nu[0] = 1.0
        direct.u[2] = np.nan
        with pytest.raises(Diverged, match=r"t = 0.03 s: u\[2\] = nan N, not a finite number"):
            direct.step()
        theirs.tau_cmd[1] = np.inf
        with pytest.raises(Diverged, match=r"tau_cmd\[1\] = inf N, not a finite number"):
            theirs.step()
    for scenario in (wrench, thrusts):
        with pytest.raises(InputError, match="to the caller of a Simulation"):
            simulate(scenario)


def test_a_diverged_simulation_says_so_at_every_step_until_its_reset(sim):
    sim.reset(overrides={"controller.period": 0.1})
    with pytest.raises(Diverged, match="beyond") as first:
        sim.step(200_000)
    with pytest.raises(Diverged) as again:
        sim.step()
    assert str(first.value) == str(again.value)
    sim.reset()
    sim.step(300)
    assert np.array_equal(state(sim), after(Scenario.load("push_wall", MOVING), 300))


def test_only_the_simulation_steps_its_data(sim):
    """A forward evaluation between two steps changes nothing; a step is noticed."""
    sim.reset()
    for _ in range(10):
        sim.step(10)
        mujoco.mj_forward(sim.model, sim.data)
    assert np.array_equal(sim.data.qpos, after(Scenario.load("push_wall", MOVING), 100)[:7])
    mujoco.mj_step(sim.model, sim.data)
    with pytest.raises(RuntimeError, match=r"somebody else has stepped sim\.data"):
        sim.step()
    sim.reset()
    sim.step()


def in_water(model, data):
    mujoco.mj_forward(model, data)
    return bool(data.qfrc_passive.any())


def test_a_closed_simulation_and_a_forgotten_one_detach():
    sim = Simulation(Scenario.load("push_wall", MOVING))
    sim.close()
    sim.close()
    with pytest.raises(RuntimeError, match="closed"):
        sim.step()
    assert not in_water(sim.model, sim.data)
    forgotten = Simulation(Scenario.load("push_wall", MOVING))
    model, data = forgotten.model, forgotten.data
    assert in_water(model, data)
    del forgotten
    gc.collect()
    assert not in_water(model, data)


def test_a_scalar_is_a_number_and_a_vector_a_live_view(sim):
    sim.reset()
    t, tau, peaks = sim.signals.t, sim.signals.tau, [sim.signals.force_peak]
    sim.step(900)
    peaks.append(sim.signals["force_peak"])
    assert (t, peaks[0]) == (0.0, 0.0)
    assert peaks[1] > 0.0
    assert type(peaks[1]) is float
    assert np.array_equal(tau, sim.signals.tau)
    assert tau.any()
    assert all(name in repr(sim.signals) for name in sim.signals)


def test_the_notes_are_those_of_the_scenario_in_hand(sim):
    sim.reset()
    assert sim.notes == ()
    sim.reset(overrides={"controller.period": 0.1})
    assert any("limit-cycles" in note for note in sim.notes)


@pytest.fixture
def plain_python(monkeypatch):
    """Users' stages run as plain Python."""
    compiled = pipeline.CompiledStage._compiled

    def refuse(its):
        if its.users:
            raise NotCompiled("for the test")
        return compiled(its)

    monkeypatch.setattr(pipeline.CompiledStage, "_compiled", refuse)


PERIODS = {"navigation.period": 2e-3, "reference.period": 1e-3, "controller.period": 4e-4, "actuation.period": 5e-4}


def test_each_stage_keeps_its_own_period():
    """Outputs are held for the period of their stage, and states advance by explicit Euler over it."""
    trace = simulate(Scenario.load("push_wall", {**WALL, **OF_EACH_ROOM, **PERIODS}), log_rate="full")
    for name, n in (("p_WB_m", 20), ("drift", 20), ("p_d", 10), ("phase", 10), ("tau_cmd", 4), ("xi", 4), ("u", 5)):
        values = trace[name][:2000].reshape(2000 // n, n, -1)
        assert np.array_equal(values, np.repeat(values[:, :1], n, axis=1)), name
        assert np.any(np.diff(values[:, 0], axis=0) != 0.0), name
    assert np.allclose(trace.phase[::10, 0], 0.5 * trace.t[::10], rtol=1e-12)
    wanted = trace.u_wanted[:2000:5]  # the state of a lag follows what the pseudoinverse asks for
    assert np.allclose(np.diff(trace.thrust[:2000:5], axis=0), 5e-4 * (wanted - trace.thrust[:2000:5])[:-1] / 0.02)
    assert np.array_equal(trace.u[:2000:5], trace.thrust[:2000:5])
    assert {"s", "zeta", "tau_nom", "boundary_layer_time"}.isdisjoint(trace)  # the law does not use the task


def test_two_stages_with_one_name_of_a_state_are_refused(tmp_path):
    (tmp_path / "same.py").write_text(USERS.read_text().replace('"drift"', '"xi"').replace(".drift", ".xi"))
    same = {"navigation.name": f"{tmp_path / 'same.py'}:Noisy", "controller.name": f"{tmp_path / 'same.py'}:Pid"}
    with pytest.raises(InputError, match=r"states\['xi'\]: is also the name of a state of"):
        simulate(Scenario.load("push_wall", {**MOVING, **same}))


LATE = """
from dataclasses import dataclass
from uvms_mj import Controller, gain

@dataclass(frozen=True)
class Late(Controller):
    when: float = gain(0.005, "s", "time of the mistake")
    count: float = gain(7.0, "-", "entries that it sets")

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.tau_nom
        if signals.t > gains.when:
            for i in range(int(gains.count)):
                tau_cmd[i] = 1.0
"""


@pytest.mark.filterwarnings("ignore::uvms_mj.engine.vehicle_run.PlainPythonWarning")
@pytest.mark.parametrize("plain", [False, True])
def test_a_setting_of_a_users_stage_changes_during_a_run(tmp_path, request, plain):
    """The mistake of Late comes at the time in force, not at that of the start."""
    (tmp_path / "late.py").write_text(LATE)
    if plain:
        request.getfixturevalue("plain_python")
    with Simulation(Scenario.load("push_wall", MOVING, f"{tmp_path / 'late.py'}:Late")) as sim:
        sim.step(20)
        sim.set({"controller.when": 0.01})
        sim.step(60)
        with pytest.raises(StageFault, match="raised IndexError"):
            sim.step(60)
        assert sim.steps == 101


@pytest.mark.filterwarnings("ignore::uvms_mj.engine.vehicle_run.PlainPythonWarning")
@pytest.mark.parametrize("plain", [False, True])
def test_a_stage_that_fails_stops_the_simulation_until_its_reset(tmp_path, request, plain):
    (tmp_path / "late.py").write_text(LATE)
    if plain:
        request.getfixturevalue("plain_python")
    with Simulation(Scenario.load("push_wall", MOVING, f"{tmp_path / 'late.py'}:Late")) as sim:
        for _ in range(2):
            with pytest.raises(StageFault, match=r"your law Late \(late.py\) raised IndexError.*line 15"):
                sim.step(200)
            assert sim.steps == 51
        sim.reset(overrides={"controller.when": 1.0})
        sim.step(200)
        changed = state(sim)
        sim.reset()
        sim.step(50)
    assert np.array_equal(changed, after(sim.scenario.updated({"controller.when": 1.0}), 200))


@pytest.mark.parametrize(
    ("use", "error", "said"),
    [
        (lambda sim: sim.reset(overrides={1: 2.0}), InputError, "overrides: .* is not a mapping from dotted keys"),
        (lambda sim: sim.reset(overrides="wall.position"), InputError, "overrides: 'wall.position' is not a mapping"),
        (lambda sim: sim.set(5), InputError, "overrides: 5 is not a mapping"),
        (lambda sim: sim.reset(seed=-1), InputError, "simulation.seed: -1 must be at least 0"),
        (lambda sim: sim.reset(overrides={"task.F_1": np.ones(5)}), InputError, "task.F_1"),
        (lambda sim: sim.step(-1), InputError, "step: -1 is not a number of steps"),
        (lambda sim: sim.step(2.0), InputError, "step: 2.0 is not a number of steps"),
        (lambda sim: sim.signals[5], KeyError, "no signal 5; choose from"),
        (copy.copy, TypeError, "can't be copied or pickled"),
        (pickle.dumps, TypeError, "can't be copied or pickled"),
    ],
)
def test_a_wrong_call_has_one_message_and_changes_nothing(sim, use, error, said):
    sim.reset()
    sim.step(20)
    before = state(sim)
    with pytest.raises(error, match=said):
        use(sim)
    assert np.array_equal(state(sim), before)


def test_numbers_of_numpy_are_numbers():
    """Scalars and arrays."""
    scenario = Scenario.load("push_wall", MOVING)
    plain = {"wall.position": 0.5, "task.F_1": [2.0] * 6, "initial.position": [0.0, 0.1, 0.0]}
    arrays = {key: np.float32(value) if key == "wall.position" else np.array(value) for key, value in plain.items()}
    assert scenario.updated(arrays) == scenario.updated(plain)
    with Simulation(scenario) as sim:
        sim.reset(seed=np.int64(7), overrides=arrays)
        assert sim.scenario == scenario.updated(plain | {"simulation.seed": 7})


def test_a_closed_simulation_says_so():
    with Simulation(Scenario.load("push_wall", MOVING)) as sim:
        sim.step(3)
    assert sim.signals.nu.shape == (6,)  # what it has come to can be read
    for use in (sim.step, sim.reset, lambda: sim.set({"wall.stiffness": 900.0})):
        with pytest.raises(RuntimeError, match="is closed"):
            use()


def test_a_time_step_changed_by_hand_is_refused_until_the_reset():
    with Simulation(Scenario.load("push_wall", MOVING)) as sim:
        sim.step(3)
        sim.model.opt.timestep = 1e-3
        with pytest.raises(RuntimeError, match="changed its time step"):
            sim.step()
        assert sim.steps == 3


def test_one_thread_at_a_time():
    """Two threads in one Simulation are refused. They would overwrite MuJoCo's memory."""
    scenario = Scenario.load("push_wall", MOVING)
    with Simulation(scenario) as sim, ThreadPoolExecutor(1) as pool:
        steps = pool.submit(sim.step, 20_000)
        while not sim.steps:
            assert not steps.done()
        for use in (sim.reset, sim.step, lambda: sim.set({"wall.stiffness": 900.0})):
            with pytest.raises(RuntimeError, match="another thread uses this Simulation"):
                use()
        steps.result()
        assert np.array_equal(state(sim), after(scenario, 20_000))


def test_an_interrupt_between_two_chunks_loses_no_step(monkeypatch):
    scenario, calls = Scenario.load("push_wall", MOVING), []
    with Simulation(scenario) as sim:
        step = mujoco.mj_step

        def interrupted(*arguments):
            step(*arguments)
            calls.append(arguments)
            if len(calls) == 2:
                raise KeyboardInterrupt

        monkeypatch.setattr(mujoco, "mj_step", interrupted)
        with pytest.raises(KeyboardInterrupt):
            sim.step(2500)
        assert 0 < sim.steps < 2500
        sim.step(2500 - sim.steps)
        assert np.array_equal(state(sim), after(scenario, 2500))


INTERRUPTED = """
from dataclasses import dataclass
from uvms_mj.guidance import Guidance, station_keep

interrupts = [10]

@dataclass(frozen=True)
class Interrupted(Guidance):
    states = {"phase": 1}

    @staticmethod
    def step(settings, state, given, state_dot, out):
        station_keep(settings, given, out)
        state_dot.phase[0] = 1.0
        out.p_d[0], out.p_d[1] = state.phase[0], 1e-3 * given.instant
        if interrupts[:1] == [given.instant]:
            interrupts.clear()
            raise KeyboardInterrupt
"""


@pytest.mark.filterwarnings("ignore::uvms_mj.engine.vehicle_run.PlainPythonWarning")
def test_a_plain_stage_that_was_interrupted_begins_its_instant_again(tmp_path, plain_python):
    """Its states advance once, and its instants are counted once."""
    (tmp_path / "stage.py").write_text(INTERRUPTED)
    (tmp_path / "never.py").write_text(INTERRUPTED.replace("[10]", "[]"))
    interrupted, never = (
        Scenario.load("push_wall", {**WALL, "reference.name": f"{tmp_path / name}.py:Interrupted"})
        for name in ("stage", "never")
    )
    with Simulation(interrupted) as sim:
        with pytest.raises(KeyboardInterrupt):
            sim.step(30)
        assert sim.steps == 10
        sim.step(20)
        assert sim.signals.phase == pytest.approx(30 * 1e-4, rel=1e-12)
        assert np.array_equal(state(sim), after(never, 30))


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300, -1e8])
def test_a_thrust_that_mujoco_would_ignore_stops_the_run(value):
    scenario = Scenario.load("push_wall", {"actuation.name": "external"})
    with Simulation(scenario) as sim:
        sim.u[1] = value
        with pytest.raises(Diverged, match=r"t = 0 s: u\[1\] = .* N, (beyond 1e\+07 N|not a finite number)"):
            sim.step()


def test_a_model_of_another_type_is_refused():
    with pytest.raises(InputError, match="mjcf: expected an Mjcf, got 'bluerov1'"):
        Simulation(mjcf="bluerov1")


ATTITUDES = {
    "zero": ("reference", "out.quat_d[:] = 0.0", "set out.quat_d to length 0: it must be a unit quaternion"),
    "long": ("navigation", "out.quat_WB[1] += 0.1", "set out.quat_WB to length 1.00.*: it must be a unit quaternion"),
    "another": ("navigation", "out.R_WB[0, 1] += 0.1", "set out.R_WB to another attitude than out.quat_WB"),
}


@pytest.mark.filterwarnings("ignore::uvms_mj.engine.vehicle_run.PlainPythonWarning")
@pytest.mark.parametrize("plain", [False, True])
@pytest.mark.parametrize("mistake", ATTITUDES)
def test_an_attitude_that_is_none_is_named(tmp_path, request, mistake, plain):
    table, line, said = ATTITUDES[mistake]
    wrong = USERS.read_text().replace("perfect(given, out)\n", f"perfect(given, out)\n        {line}\n")
    if table == "reference":
        wrong = USERS.read_text().replace(
            "station_keep(settings, given, out)\n", f"station_keep(settings, given, out)\n        {line}\n"
        )
    (tmp_path / "wrong.py").write_text(wrong)
    name = "Noisy" if table == "navigation" else "Circle"
    if plain:
        request.getfixturevalue("plain_python")
    with Simulation(Scenario.load("push_wall", {f"{table}.name": f"{tmp_path / 'wrong.py'}:{name}"})) as sim:
        assert bool(sim.slow_stages) == plain
        with pytest.raises(StageFault, match=said):
            sim.step()


@pytest.mark.parametrize(
    ("scenario", "overrides"),
    [
        ("push_wall_gusts", {}),
        ("push_wall", {"disturbance.amplitude": [5.0] * 6, "disturbance.frequency_hz": [1.0] * 6}),
        ("push_wall", {"impedance.schedule": [{"time": 0.0, "K_f": [1.0] * 6}, {"time": 0.01, "K_f": [0.5] * 6}]}),
        ("tool_push", {"impedance.M_d": "natural"}),
    ],
)
def test_a_set_of_the_same_values_changes_no_signal_and_its_time_is_that_of_the_instant(scenario, overrides):
    def numbers():
        return {name: np.array(sim.signals[name]) for name in sim.signals}

    with Simulation(Scenario.load(scenario, overrides)) as sim:
        sim.step(37)
        assert sim.signals.t == sim.t > 0.0
        held, before = sim.signals, numbers()
        tables = {table: value for table, value in sim.scenario.to_dict().items() if isinstance(value, dict)}
        for table in ("current", "disturbance", "tether", "wall", "impedance", "estimates", "controller"):
            sim.set(
                {f"{table}.{word}": value for word, value in tables[table].items() if word not in ("name", "delay")}
            )
            for name, value in before.items():
                np.testing.assert_array_equal(held[name], value, err_msg=f"{name} after a set of {table}")
