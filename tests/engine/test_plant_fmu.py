"""The plant as an FMU: in the tools of others it gives the numbers of a Simulation, bit for bit."""

from itertools import groupby
from pathlib import Path

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, Simulation
from uvms_mj.engine.plant_fmu import RANGES, write_fmu
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import checked

fmpy = pytest.importorskip("fmpy", reason="needs the extra fmi")
from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402
from lark import Lark  # noqa: E402

pytestmark = pytest.mark.slow
NOISY = {
    "navigation.name": "sensors",
    "navigation.position_noise": [0.01] * 3,
    "current.deviation": [0.05, 0.05, 0.02],
    "disturbance.deviation": [0.5, 0.5, 0.5, 0.05, 0.05, 0.05],
    "wall.friction": 0.3,
    "wall.damping": 40.0,
    "wall.tangential_damping": 100.0,
}


@pytest.fixture(scope="module")
def plants(tmp_path_factory) -> dict[str, Path]:
    folder, scenario = tmp_path_factory.mktemp("plant"), Scenario.load("push_wall")
    made = {name: folder / f"{name}.fmu" for name in ("plant", "thrusts", "noisy", "closed")}
    write_fmu(scenario, made["plant"])
    write_fmu(scenario.updated({"actuation.name": "external", "controller.name": "external"}), made["thrusts"])
    write_fmu(scenario.updated(NOISY), made["noisy"])
    write_fmu(scenario.updated(NOISY), made["closed"], with_law=True)
    return made


def logging_to(log) -> fmi2CallbackFunctions:
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(lambda _, __, ___, ____, message: log(message.decode()))
    callbacks.allocateMemory, callbacks.freeMemory = defaultCallbacks.allocateMemory, defaultCallbacks.freeMemory
    return callbacks


def places_of(outputs) -> tuple[list[int], ...]:
    """The indices of a signal's outputs, for each axis."""
    indices = [[int(i) - 1 for i in each.partition("[")[2][:-1].split(",") if i] for each in outputs]
    return tuple(map(list, zip(*indices, strict=True)))


class Unit:
    """An instance of an FMU in FMPy."""

    def __init__(self, path: Path, parameters: dict[str, float] | None = None, log=None) -> None:
        self.about = fmpy.read_model_description(str(path))
        self.refs = {each.name: each.valueReference for each in self.about.modelVariables}
        self.outputs = [each.name for each in self.about.modelVariables if each.causality == "output"]
        self.places = [(name, places_of(each)) for name, each in groupby(self.outputs, lambda o: o.partition("[")[0])]
        self.fmu = FMU2Slave(
            guid=self.about.guid,
            unzipDirectory=fmpy.extract(str(path)),
            modelIdentifier=self.about.coSimulation.modelIdentifier,
            instanceName="unit",
        )
        self.fmu.instantiate(callbacks=None if log is None else logging_to(log))
        self.fmu.setupExperiment(startTime=0.0)
        self.set(parameters or {})
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.t = 0.0

    def set(self, values: dict[str, float]) -> None:
        if values:
            self.fmu.setReal([self.refs[name] for name in values], list(values.values()))

    def step(self, steps: int) -> None:
        self.fmu.doStep(self.t, steps * 1e-4)
        self.t += steps * 1e-4

    def all(self) -> np.ndarray:
        return np.array(self.fmu.getReal([self.refs[name] for name in self.outputs]))

    def of(self, sim: Simulation) -> np.ndarray:
        """The same numbers of a Simulation."""
        return np.hstack([sim.signals[name][places] if places else sim.signals[name] for name, places in self.places])


def pushes(k: int) -> dict[str, float]:
    sizes = (25.0, 3.0, -2.0, 0.1, 0.2, 0.3)
    return {f"tau_cmd[{i + 1}]": size * (np.sin(0.02 * k + i) + (i == 0)) for i, size in enumerate(sizes)}


def test_fmpy_finds_nothing_wrong(plants, monkeypatch):
    """It parses the name of each variable, of several FMUs once."""
    parse, parsed = Lark.parse, set()

    def once(self, name):
        if name not in parsed:
            parse(self, name)
        parsed.add(name)

    monkeypatch.setattr(Lark, "parse", once)
    for path in plants.values():
        assert validate_fmu(str(path)) == []
    assert {"tau_cmd[1]", "u_cmd[1]", "R_WB[1,1]", "wall.stiffness"} < parsed


def test_variables_have_the_units_and_the_meanings_of_signals_and_keys(plants):
    about = fmpy.read_model_description(str(plants["noisy"]))
    named = {each.name: each for each in about.modelVariables}
    for name, unit, words in (
        ("nu[4]", "rad/s", "velocity"), ("f_contact_W[1]", "N", "in W"), ("tau_cmd[5]", "N.m", "wrench"),
        ("wall.stiffness", "N/m", "k_c"), ("p_WB[1]", "m", "position"), ("R_WB[1,1]", None, "rotation"),
    ):  # fmt: skip
        assert named[name].unit == unit
        assert words in named[name].description
    assert all(each.description for each in about.modelVariables)
    assert {each.unit for each in about.modelVariables} - {None} <= {each.name for each in about.unitDefinitions}


def test_tables_waves_and_a_cable_among_walls_are_in_it(tmp_path):
    """Waves keep their seed. The nodes of a cable begin outside of the walls, which are no parameters then."""
    plane = {"shape": "plane", "position": [0.4, 0.0, 0.0], "motion": [[0.0, 0.0, 0.0, 0.0], [0.5, -0.2, 0.0, 0.0]]}
    pile = {"shape": "cylinder", "position": [-1.6, 1.7, 0.0], "radius": 0.3, "amplitude": [0.0, 0.1, 0.0]}
    turn = {"turn_amplitude_deg": [0.0, 20.0, 0.0], "turn_frequency_hz": 0.4, "pivot": [-1.6, 1.7, -2.0]}
    water = {"current.shear": [[-1.0, 0.0], [5.0, 0.4]], "disturbance.table": [[0.0] * 7, [0.6, 5.0, *[0.0] * 5]]}
    sea = {"sea.height": 0.4, "sea.spectrum": "jonswap", "sea.components": 4, "sea.reflecting": True}
    walls = {"walls": [plane, pile | {"frequency_hz": 0.5} | turn]}
    cable = {"tether.length": 6.0, "tether.elements": 12, "tether.anchor": [-3.0, 1.0, -1.0]}
    noise = {"current.deviation": [0.05, 0.05, 0.02]}
    scenario = Scenario.load("push_wall", {"controller.name": "external", **walls, **water, **sea, **cable, **noise})
    with pytest.raises(InputError, match=r"sea\.seed: the waves follow simulation.seed"):
        write_fmu(scenario, tmp_path / "water.fmu")
    scenario = scenario.updated({"sea.seed": 7})
    parameters = write_fmu(scenario, tmp_path / "water.fmu")
    assert "wall.stiffness" in parameters
    assert "wall.position" not in parameters
    given = {"wall.stiffness": 2e4, "simulation.seed": 5.0}
    unit = Unit(tmp_path / "water.fmu", given)
    with Simulation(scenario.updated(given | {"simulation.seed": 5}), engine="free_body") as sim:
        for _ in range(10):
            unit.step(1000)
            sim.step(1000)
            np.testing.assert_array_equal(unit.all(), unit.of(sim), err_msg=f"t = {sim.t}")
        assert np.abs(sim.signals.v_c_W).max() > 0.0


@pytest.mark.parametrize("name", ["plant", "noisy"])
def test_the_plant_is_that_of_a_simulation_bit_for_bit(plants, name):
    keys = {"controller.name": "external", "wall.position": 0.1, **(NOISY if name == "noisy" else {})}
    unit = Unit(plants[name], {"wall.position": 0.1})
    with Simulation(Scenario.load("push_wall", keys), engine="free_body") as sim:
        np.testing.assert_array_equal(unit.all(), unit.of(sim))
        touched = False
        for k in range(2000):  # 20 s
            command = pushes(k)
            unit.set(command)
            sim.tau_cmd[:] = list(command.values())
            unit.step(100)
            sim.step(100)
            np.testing.assert_array_equal(unit.all(), unit.of(sim), err_msg=f"t = {sim.t}")
            touched |= bool(sim.signals.touches)
        assert touched


def test_thrusts_may_be_the_inputs(plants):
    unit = Unit(plants["thrusts"])
    keys = {"actuation.name": "external", "controller.name": "external"}
    with Simulation(Scenario.load("push_wall", keys), engine="free_body") as sim:
        for k in range(50):
            u = 5.0 * np.sin(0.1 * k + np.arange(len(sim.u)))
            unit.set({f"u_cmd[{i + 1}]": value for i, value in enumerate(u)})
            sim.u[:] = u
            unit.step(50)
            sim.step(50)
        np.testing.assert_array_equal(unit.all(), unit.of(sim))


def test_with_its_law_inside_it_is_the_run(plants):
    unit = Unit(plants["closed"])
    with Simulation(Scenario.load("push_wall", NOISY), engine="free_body") as sim:
        for _ in range(200):  # 20 s
            unit.step(1000)
            sim.step(1000)
            np.testing.assert_array_equal(unit.all(), unit.of(sim), err_msg=f"t = {sim.t}")


PARAMETERS = {
    "wall.position": 0.3,
    "wall.stiffness": 3.3e4,
    "wall.damping": 12.5,
    "current.speed": 0.31,
    "current.vertical": -0.07,
    "initial.position[1]": 0.21,
    "initial.position[2]": -0.11,
    "initial.velocity[1]": 0.05,
    "initial.velocity[6]": -0.02,
    "disturbance.bias[1]": 1.7,
    "simulation.seed": 991,
}


def test_parameters_are_the_keys_of_a_scenario(plants):
    given = {key.replace("[1]", "[0]").replace("[2]", "[1]").replace("[6]", "[5]"): v for key, v in PARAMETERS.items()}
    overrides: dict = {key: value for key, value in given.items() if "[" not in key}
    overrides |= {
        "initial.position": [0.21, -0.11, 0.0],
        "initial.velocity": [0.05, 0.0, 0.0, 0.0, 0.0, -0.02],
        "disturbance.bias": [1.7, 0.0, 0.0, 0.0, 0.0, 0.0],
    }
    unit = Unit(plants["noisy"], {key: float(value) for key, value in PARAMETERS.items()})
    scenario = Scenario.load("push_wall", {"controller.name": "external", **NOISY} | overrides)
    with Simulation(scenario, engine="free_body") as sim:
        for k in range(100):
            command = pushes(k)
            unit.set(command)
            sim.tau_cmd[:] = list(command.values())
            unit.step(100)
            sim.step(100)
        np.testing.assert_array_equal(unit.all(), unit.of(sim))


def test_ten_instances_side_by_side_and_a_state_saved_in_contact(plants):
    units = [Unit(plants["noisy"], {"wall.position": 0.05 + 0.01 * k}) for k in range(10)]
    for k in range(100):
        for unit in units:
            unit.set(pushes(k))
            unit.step(100)
    alone = Unit(plants["noisy"], {"wall.position": 0.12})
    for k in range(100):
        alone.set(pushes(k))
        alone.step(100)
    np.testing.assert_array_equal(units[7].all(), alone.all())
    unit = next(each for each in units if each.all()[each.outputs.index("force_peak")] > 0.0)
    state, bytes_ = unit.fmu.getFMUstate(), unit.fmu.serializeFMUstate(unit.fmu.getFMUstate())
    saved = unit.t
    unit.step(3000)
    later = unit.all()
    unit.fmu.setFMUstate(state)
    unit.t = saved
    unit.step(3000)
    np.testing.assert_array_equal(unit.all(), later)
    unit.fmu.setFMUstate(unit.fmu.deSerializeFMUstate(bytes_))
    unit.t = saved
    unit.step(3000)
    np.testing.assert_array_equal(unit.all(), later)
    other = Unit(plants["noisy"])
    other.fmu.reset()
    other.fmu.setupExperiment(startTime=0.0)
    other.fmu.enterInitializationMode()
    other.fmu.exitInitializationMode()
    np.testing.assert_array_equal(other.all(), Unit(plants["noisy"]).all())


def test_what_is_wrong_is_a_status(plants):
    unit = Unit(plants["plant"])
    for wrong in (
        lambda: unit.fmu.doStep(0.0, 1.5e-4),
        lambda: unit.fmu.doStep(0.0, 0.0),
        lambda: unit.fmu.doStep(0.0, float("inf")),
        lambda: unit.fmu.doStep(0.0, 1e300),
        lambda: unit.set({"wall.position": 2.0}),
        lambda: unit.set({"nu[1]": 2.0}),
        lambda: unit.set({"tau_cmd[1]": float("nan")}),
        lambda: unit.fmu.getReal([100_000]),
    ):
        with pytest.raises(FMICallException):
            wrong()
    unit.set({"tau_cmd[1]": 1e9})
    with pytest.raises(FMICallException):
        unit.step(10_000)
    said = []
    with pytest.raises(FMICallException):
        Unit(plants["plant"], {"wall.stiffness": -1.0}, said.append)
    assert said == ["wall.stiffness is out of its range"]


def test_a_call_out_of_order_is_a_status_and_changes_nothing(plants):
    """The communication point is that of the run, and the calls are in the order of FMI."""
    said = []
    unit, other = Unit(plants["plant"], log=said.append), Unit(plants["plant"])
    pushed = {"tau_cmd[1]": 20.0}
    for each in (unit, other):
        each.set(pushed)
        each.step(1000)
    for t, words in (
        (0.0, "a step from t = 0 s: the run is at t = 0.1 s"),  # again
        (0.2, "a step from t = 0.2 s: the run is at t = 0.1 s"),  # one is left out
        (0.09999, "a step from t = 0.09999 s"),
        (float("nan"), "the run is at t = 0.1 s"),
    ):
        with pytest.raises(FMICallException):
            unit.fmu.doStep(t, 0.1)
        assert words in said[-1]
    for call, words in (
        (lambda: unit.fmu.setupExperiment(startTime=0.0), "fmi2SetupExperiment is not allowed in a run"),
        (unit.fmu.enterInitializationMode, "fmi2EnterInitializationMode is not allowed in a run"),
        (unit.fmu.exitInitializationMode, "fmi2ExitInitializationMode is not allowed in a run"),
    ):
        with pytest.raises(FMICallException):
            call()
        assert said[-1] == words
    for each in (unit, other):
        each.step(1000)
    np.testing.assert_array_equal(unit.all(), other.all())
    state = unit.fmu.getFMUstate()
    unit.step(1000)
    unit.fmu.setFMUstate(state)  # a step is repeated from a saved state, whose time it has
    unit.t = 0.2
    unit.step(1000)
    other.step(1000)
    np.testing.assert_array_equal(unit.all(), other.all())
    unit.fmu.terminate()
    with pytest.raises(FMICallException):
        unit.step(1)
    assert said[-1] == "fmi2DoStep is not allowed after its end"
    unit.fmu.reset()
    with pytest.raises(FMICallException):
        unit.fmu.doStep(0.0, 0.1)
    assert said[-1] == "fmi2DoStep is not allowed before it is set up"
    unit.fmu.setupExperiment(startTime=0.0, stopTime=0.25)
    with pytest.raises(FMICallException):
        unit.fmu.doStep(0.0, 0.1)
    unit.fmu.enterInitializationMode()
    unit.fmu.exitInitializationMode()
    unit.t = 0.0
    unit.step(2000)
    with pytest.raises(FMICallException):
        unit.step(1000)
    assert said[-1] == "a step passes the end that fmi2SetupExperiment has set"
    unit.fmu.doStep(0.2, 0.05)


def test_a_run_that_has_failed_takes_no_step_until_it_is_reset(plants):
    said = []
    unit = Unit(plants["plant"], log=said.append)
    unit.set({"tau_cmd[1]": 1e9})
    with pytest.raises(FMICallException):
        unit.step(10)
    with pytest.raises(FMICallException):
        unit.fmu.doStep(1e-3, 1e-3)
    assert said[-1] == "fmi2DoStep is not allowed after it has failed"
    unit.fmu.reset()
    unit.fmu.setupExperiment(startTime=0.0)
    unit.fmu.enterInitializationMode()
    unit.fmu.exitInitializationMode()
    unit.fmu.doStep(0.0, 1e-3)


def test_the_time_that_a_master_adds_up_is_that_of_the_run(plants):
    unit, t = Unit(plants["plant"]), 0.0
    for _ in range(100_000):
        unit.fmu.doStep(t, 3e-4)
        t += 3e-4
    assert t != 30.0


def taken_by(make, *arguments) -> bool:
    try:
        make(*arguments)
    except (FMICallException, InputError):
        return False
    return True


def run_checked(scenario: Scenario, overrides: dict[str, float]) -> None:
    checked(scenario.updated(overrides))


def test_it_takes_exactly_the_numbers_that_a_run_takes(plants):
    """At both ends of each range, and on both sides of the stiffest wall and the strongest damper of the time step."""
    for name, base in (("plant", {}), ("noisy", NOISY)):
        scenario = Scenario.load("push_wall", {"controller.name": "external", **base})
        setup, h = set_up(scenario), scenario.simulation.timestep
        masses = [setup.mass_along_normal(), setup.mass_along_face()]
        ends = {
            key: [x for end in RANGES[key] for x in (end, np.nextafter(end, -np.inf), np.nextafter(end, np.inf))]
            for key in ("wall.position", "wall.damping", "wall.friction", "current.speed", "current.vertical")
        }
        ends["wall.stiffness"] = [1e-3, 9e-4, 1e11, *(f * 4.0 * m / h**2 for m in masses for f in (0.99, 0.9999, 1.01))]
        ends["wall.damping"] += [
            f * (2.0 * m / h - 0.5 * h * scenario.wall.stiffness) for m in masses for f in (0.999, 1.001)
        ]
        known, answers = Unit(plants[name]).refs, []
        for key, value in ((key, float(value)) for key, values in ends.items() for value in values):
            if key in known:
                answers.append(taken_by(Unit, plants[name], {key: value}))
                assert answers[-1] == taken_by(run_checked, scenario, {key: value}), (name, key, value)
        assert 10 < sum(answers) < len(answers) - 10


def test_what_can_not_be_in_an_fmu_is_refused(tmp_path):
    scenario = Scenario.load("push_wall", {"simulation.integrator": "implicitfast"})
    with pytest.raises(InputError, match="free_body"):
        write_fmu(scenario, tmp_path / "a.fmu")


def test_libcosim_runs_it(plants):
    libcosimpy = pytest.importorskip("libcosimpy")
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    assert libcosimpy
    execution = CosimExecution.from_step_size(step_size=10_000_000)  # [ns]
    index = execution.add_local_slave(CosimLocalSlave(fmu_path=str(plants["plant"]), instance_name="plant"))
    manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
    assert execution.add_manipulator(manipulator=manipulator)
    assert execution.add_observer(observer=observer)
    unit = Unit(plants["plant"])
    inputs = [unit.refs[f"tau_cmd[{i + 1}]"] for i in range(6)]
    place = unit.refs["wall.position"]
    assert execution.real_initial_value(slave_index=index, variable_reference=place, value=0.1)
    keys = {"controller.name": "external", "wall.position": 0.1}
    with Simulation(Scenario.load("push_wall", keys), engine="free_body") as sim:
        refs = [unit.refs[name] for name in unit.outputs]
        for k in range(2000):  # 20 s
            command = list(pushes(k).values())
            assert manipulator.slave_real_values(slave_index=index, variable_references=inputs, values=command)
            sim.tau_cmd[:] = command
            execution.step()
            sim.step(100)
            if k % 100 == 99:
                found = observer.last_real_values(slave_index=index, variable_references=refs)
                np.testing.assert_array_equal(np.array(found), unit.of(sim), err_msg=f"t = {sim.t}")
        assert sim.signals.touches
