"""A run of a fleet is one of the engine free_body: bit for bit."""

import copy
import importlib.util
import pickle
import re
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, Simulation, World, simulate
from uvms_mj.compiler.targets import PTX
from uvms_mj.engine.fleet import Fleet, NotInFleet, Starts
from uvms_mj.engine.native.devices import Gpu
from uvms_mj.engine.native.fleet_code import FleetSource

BLUEROV1 = Path(__file__).parents[2] / "models" / "bluerov1.xml"
AT_WALL = {"initial.position": [0.9995, 0.0, 0.0], "initial.velocity": [0.1, 0.02, 0.0, 0.0, 0.1, 0.0]}
LAW = """
from dataclasses import dataclass

import numpy as np

from uvms_mj import Controller, gain


@dataclass(frozen=True)
class Late(Controller):
    k_p: float = gain(200.0, "N/m, N m", "stiffness")
    uses_task = False
    memory = {"ring": 180, "a": 6, "b": 6}
    states = {"z": 6}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        i = signals.instant % 30
        for k in range(6):
            push = signals.g_hat[k] - gains.k_p * signals.eta_e[k] - 150.0 * signals.nu_e[k]
            state.ring[6 * i + k] = push + 0.01 * state.ring[6 * i + k]
        j = (signals.instant + 27) % 30
        for k in range(6):
            tau_cmd[k] = state.ring[6 * j + k]
        x = state.a
        for k in range(3):
            x = state.b if signals.eta_e[k] > 0.0 else state.a
            x[k] += 1.0
            if state.b[k] > 5.0:
                return
        x[5] = np.abs(tau_cmd).max()
        state_dot.z[:] = state.a - state.b
"""
# Features of other stages share a case, since each case is a loop to compile
CASES: dict[str, tuple[Mapping[str, Any], Mapping[str, Sequence[Any]]]] = {
    "T200 thrusters, sines, tables, tether, delay, two walls that move and turn, friction": (
        {
            "vehicle.model": "bluerov2_heavy",
            "controller.name": "impedance",
            "controller.period": 5e-4,
            "controller.delay": 3e-4,
            "wall.friction": 0.3,
            "walls": [
                {
                    "shape": "sphere",
                    "position": [1.425, 0.0, 0.0],
                    "radius": 0.2,
                    "amplitude": [0.01, 0.0, 0.0],
                    "frequency_hz": 2.0,
                    "friction": 0.2,
                },
                {
                    "shape": "box",
                    "position": [1.44, 0.0, 0.0],
                    "edges": [0.4, 0.5, 0.6],
                    "attitude_deg": [0.0, 0.0, 10.0],
                    "motion": [[0.0, 0.0, 0.0, 0.0], [0.01, -0.01, 0.0, 0.0]],
                    "turn_amplitude_deg": [2.0, 0.0, -3.0],
                    "turn_frequency_hz": 4.0,
                    "turn_phase_deg": 30.0,
                },
            ],
            "thrusters.name": "t200",
            "current.amplitude": [0.1, 0.0, 0.1],
            "current.frequency_hz": [1.0, 0.0, 3.0],
            "current.shear": [[0.0, 1.0], [5.0, 0.4]],
            "disturbance.table": [[0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.02, 3.0, 0.0, 1.0, 0.0, 0.1, 0.0]],
            "tether.length": 5.0,
        },
        {
            "wall.friction": [0.1, 0.4],
            "initial.position": [[0.9995, 0.0, 0.0], [1.0, 0.01, 0.0]],
            "current.speed": [0.1, 0.4],
            "tether.length": [4.0, 6.0],
        },
    ),
    "at the surface, in a wave": (
        {
            "buoyancy.shapes": [
                {"shape": "capsule", "radius": 0.12, "length": 0.3, "attitude_deg": [0.0, 80.0, 0.0]},
                {"shape": "box", "edges": [0.2, 0.2, 0.2]},
            ],
            **{"sea.height": 0.1, "sea.period": 3.0},
        },
        {"sea.surface": [0.05, -0.02]},
    ),
    "a tether that moves, water at the wall": (
        {
            "tether.length": 4.0,
            "tether.elements": 2,
            "tether.anchor": [-2.0, 0.0, 0.0],
            "near_wall": [
                {"shape": "spheroid", "radius": 0.15, "length": 0.5, "position": [0.0, 0.0, 0.1]},
                {"shape": "cylinder", "radius": 0.1, "length": 0.4, "axis": [0.2, 1.0, 0.3]},
                {"radius": 0.2},
            ],
            "pads": [{"radius": 0.1, "position": [0.02, 0.0, 0.0]}],
        },
        {
            "tether.length": [4.0, 4.5],
            "tether.mass": [0.04, 0.06],
            "near_wall[0].length": [0.45, 0.6],
            "near_wall[2].radius": [0.2, 0.15],
        },
    ),
    "a linear mixer, late and slow pulses, outputs that freeze": (
        {
            "vehicle.model": "bluerov2_heavy",
            "controller.period": 1e-3,
            "controller.delay": 2e-3,
            "actuation.period": 5e-4,
            "thrusters.name": "t200",
            "thrusters.mixer": "linear",
            "thrusters.freeze_time": 2e-3,
            "thrusters.freeze_every": 5e-3,
        },
        {"thrusters.pilot_gain": [1.0, 0.5], "thrusters.freeze_at": [3e-3, 0.0]},
    ),
    "sensors with noise and delay, fins that an actuator moves": (
        {
            "controller.name": "pid",
            "navigation.name": "sensors",
            "navigation.position_noise": [1e-3, 1e-3, 1e-3],
            "navigation.position_delay": 1e-3,
            "navigation.attitude_noise": [1e-3, 1e-3, 1e-3],
            "navigation.attitude_jitter": 5e-4,
            "observer.name": "momentum_observer",
            "fins": [{"area": 0.02, "position": [-0.3, 0.0, 0.0], "mixing_deg": [0.1] * 6}],
        },
        {"navigation.position_noise": [[1e-3] * 3, [2e-3, 0.0, 0.0]], "fins[0].lag": [0.1, 0.003]},
    ),
    "a law from a file, products of velocities, contact bodies, a path, lagging thrusters": (
        {
            "controller.name": "LAW",
            "vehicle.model": "PRODUCTS",
            "vehicle.contact_bodies": [
                {"position": [0.25, 0.12, 0.0], "radius": 0.04, "stiffness": 2e3, "damping": 20.0},
                {"position": [0.25, -0.12, 0.0], "radius": 0.04, "stiffness": 2e3, "damping": 20.0},
            ],
            "initial.position": [0.9505, 0.0, 0.0],
            "reference.name": "path",
            "thrusters.name": "general",
            "thrusters.lag": "first_order",
            "actuation.name": "constrained",
        },
        {"controller.k_p": [150.0, 250.0], "wall.stiffness": [1e4, 1e5], "vehicle.mass": [1.0, 1.1]},
    ),
    "an extended Kalman filter": ({"navigation.name": "ekf"}, {"vehicle.mass": [0.9, 1.1]}),
}


def scenario(overrides: Mapping[str, Any], steps: int, folder: Any = None) -> Scenario:
    law = dict(overrides)
    if law.get("controller.name") == "LAW":
        (folder / "late.py").write_text(LAW)
        law["controller.name"] = f"{folder / 'late.py'}:Late"
    if law.get("vehicle.model") == "PRODUCTS":
        products = '<text name="products" data="Xuv -2 Yr|r| 0.6"/></custom>'
        (folder / "vehicle.xml").write_text(BLUEROV1.read_text().replace("</custom>", products, 1))
        law["vehicle.model"] = str(folder / "vehicle.xml")
    return Scenario.load("push_wall", AT_WALL | law | {"simulation.duration": steps * 1e-4})


def fleet_of(base: Scenario, n: int, signals: Sequence[str] = ()) -> Fleet:
    return Fleet(base, n, signals=signals, device="cpu")


def every_signal(base: Scenario) -> list[str]:
    return [*Starts(base).parts()]


def assert_runs_are(fleet: Fleet, runs: Sequence[Simulation]) -> None:
    for name in fleet.names[:-2]:
        ours = np.asarray(fleet.signals[name])
        for i, run in enumerate(runs):
            theirs = np.array(run.signals[name])
            assert ours[i].astype(theirs.dtype).tobytes() == theirs.tobytes(), (name, i)


SLOW = ("a tether that moves, water at the wall",)
LONG = (
    "an extended Kalman filter",
    "at the surface, in a wave",
    "a linear mixer, late and slow pulses, outputs that freeze",
)
"""Cases whose kernels have no construct that another case lacks. The filter's code takes a minute and more to compile;
its sensors and its memory that an index reaches are in the sensors and the law from a file, whose ring is so large that
it stays in the table. A wave is the sums over components that the sines are, and late pulses are a ring and a lag."""


def marks(case: str) -> Any:
    return pytest.mark.long if case in LONG else pytest.mark.slow if case in SLOW else ()


@pytest.mark.parametrize("what", [pytest.param(each, marks=marks(each)) for each in CASES])
def test_each_run_is_that_of_free_body(what, tmp_path):
    """All signals after steps of several sizes, and the running ones at the end."""
    overrides, vary = CASES[what]
    sizes = 1, 40, 7, 112
    base = scenario(overrides, sum(sizes), tmp_path)
    seeds = [3, 4]
    each = [
        base.updated({key: values[i] for key, values in vary.items()} | {"simulation.seed": seed})
        for i, seed in enumerate(seeds)
    ]
    fleet = fleet_of(base, 2, every_signal(base))
    fleet.reset({key: np.array(values) for key, values in vary.items()}, seed=np.array(seeds))
    runs = [Simulation(one, engine="free_body") for one in each]
    for size in sizes:
        fleet.step(size)
        for run in runs:
            run.step(size)
        if size != 7:
            assert_runs_are(fleet, runs)
    assert not fleet.stopped.any()
    fleet.finish()
    for i, one in enumerate(each):
        trace = simulate(one, engine="free_body")
        assert trace.touches[-1] == 1.0
        for name in ("touches", "force_peak", "impulse", "final_impulse", "effort", "tau_variation", "p_WB", "tau"):
            assert np.asarray(fleet.signals[name])[i].tobytes() == np.array(getattr(trace, name)[-1]).tobytes(), name


def test_it_starts_again_with_other_numbers():
    """Steps of any size are one; other keys may vary, and those of the reset before are the scenario's again."""
    base = scenario({}, 120)
    keys: list[dict[str, Any]] = [
        {"wall.stiffness": np.array([1e4, 5e4]), "controller.k_1": 3.0},
        {"controller.k_2": np.array([5.0, 15.0])},
    ]
    fleet = fleet_of(base, 2, ("p_WB", "tau", "force_peak"))
    for overrides in keys:
        fleet.reset(overrides)
        fleet.step(120)
        table, steps = fleet.table(), fleet.steps
        fleet.reset(overrides)
        for size in (1, 50, 0, 69):
            fleet.step(size)
        assert (fleet.table() == table).all()
        assert fleet.steps == steps == 120
        assert fleet.t == pytest.approx(0.012)
        for i in range(2):
            own = {key: value[i] if isinstance(value, np.ndarray) else value for key, value in overrides.items()}
            with Simulation(base.updated(own), engine="free_body") as run:
                run.step(120)
                assert np.array_equal(fleet.signals["p_WB"][i], run.signals["p_WB"])
                assert np.array_equal(fleet.signals["tau"][i], run.signals["tau"])


def external() -> tuple[Scenario, tuple[str, ...]]:
    """A scenario whose caller gives the commands, and signals: one code for the tests that take both."""
    return scenario({"controller.name": "external"}, 400), ("p_WB", "nu", "tau")


def test_a_run_that_stops_leaves_the_others_alone():
    base, names = external()
    fleet, pushes = fleet_of(base, 3, names), np.zeros((3, 6))
    pushes[:, 0] = 19.0, 1e7, 19.0
    fleet.tau_cmd[:] = pushes
    fleet.step(400)
    assert fleet.stopped.tolist() == [False, True, False]
    with Simulation(base, engine="free_body") as run:
        run.tau_cmd[:] = pushes[0]
        run.step(400)
        for i in (0, 2):
            for name in names:
                assert fleet.signals[name][i].tobytes() == np.array(run.signals[name]).tobytes()
    with Simulation(base, engine="free_body") as run:
        run.tau_cmd[:] = pushes[1]
        with pytest.raises(RuntimeError):
            run.step(400)
        assert of_record(fleet, "step")[1] > 1
        for name in ("stop", "step", "stop_index", "stop_value"):
            assert of_record(fleet, name)[1] == run.memory.run[name].view(np.int64)[0], name


def of_record(fleet: Fleet, name: str) -> np.ndarray:
    """The words of a field of the records, as a fleet's steps leave them."""
    fields: Any = fleet._starts.memory.run.dtype.fields
    assert fleet._code is not None
    return fleet._table.view(np.int64)[fleet._code.kept.index(fields[name][1] // 8)]


def test_the_caller_sets_what_an_external_law_commands():
    base, names = external()
    fleet = fleet_of(base, 2, names)
    runs = [Simulation(base, engine="free_body") for _ in range(2)]
    for k in range(3):
        commands = np.array([[1.0 + k, 0.0, -1.0, 0.0, 0.1, 0.0], [5.0, -k, 0.0, 0.0, 0.0, 0.1]])
        fleet.tau_cmd[:] = commands
        fleet.step(20)
        for run, command in zip(runs, commands, strict=True):
            run.tau_cmd[:] = command
            run.step(20)
    assert_runs_are(fleet, runs)
    with pytest.raises(InputError, match="the caller sets commands with external only"):
        _ = fleet.u


def test_what_is_wrong_is_said():
    with pytest.raises(InputError, match="n: 0: must be a positive integer"):
        Fleet(n=0, device="cpu")
    with pytest.raises(InputError, match=r"device: 'gpus'; .*'gpu'"):
        Fleet(n=1, device="gpus")
    with pytest.raises(InputError, match=r"signals: no 'p_WC'; .*'p_WB'"):
        Fleet(n=1, device="cpu", signals=("p_WC",))
    fleet = Fleet(n=3, device="cpu")
    for wrong in ({"wall.stiffnes": 1e4}, {"wall.stiffness": -1.0}, {"wall.stiffness": np.array([1.0, -2.0, 3.0])}):
        with pytest.raises(InputError):
            fleet.reset(wrong)
    with pytest.raises(InputError):
        fleet.reset({"wall.stiffness": np.array([1e4, 1e5])})
    with pytest.raises(InputError, match="an array of 3 rows, or one value"):
        fleet.reset({"initial.position": np.zeros((2, 3))})
    with pytest.raises(InputError, match="the caller sets commands with external only"):
        _ = fleet.tau_cmd
    with pytest.raises(KeyError, match="give it in signals="):
        fleet.signal("nu_dot")
    for steps in (-1, 1.5, True, "1"):
        with pytest.raises(InputError, match="is not a number of steps"):
            fleet.step(steps)  # type: ignore[arg-type]
    for wrong, said in (
        ({"wall.stiffness": np.array([None, 1e4, 1e4])}, "None is not a finite number"),
        ({"wall.stiffness": np.array([1e4, np.nan, 1e4])}, "nan is not a finite number"),
        ({"wall.stiffness": np.array([1e4, 1e5])}, "an array with a value for each run has 3 rows"),
        ([1, 2], "is not a mapping from dotted keys"),
    ):
        with pytest.raises(InputError, match=said):
            fleet.reset(wrong)  # type: ignore[arg-type]
    for arguments, said in (
        ({"n": True}, "n: True: must be a positive integer"),
        ({"n": 10**15}, "n: 10+: must be a positive integer"),
        ({"signals": "nu"}, "signals: 'nu': must be a list of names"),
        ({"scenario": World.load("press_together")}, "^scenario: is a world of several vehicles; .*$"),
        ({"mjcf": "bluerov1"}, "^mjcf: expected an Mjcf"),
    ):
        with pytest.raises(InputError, match=said):
            Fleet(**{"n": 1, "device": "cpu"} | arguments)
    for copied in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(InputError, match="sent to another process"):
            copied(fleet)
    fleet.close()
    fleet.close()
    for used in (fleet.step, fleet.reset, fleet.finish, fleet.table, fleet.describe, lambda: fleet.signals["nu"]):
        with pytest.raises(InputError, match=r"^the fleet is closed; make a new one$"):
            used()


SPHERE = {"shape": "sphere", "position": [1.3, 0.0, 0.0], "radius": 0.2, "stiffness": 1e4}


@pytest.mark.parametrize(
    ("first", "other", "said"),
    [
        ({}, {"simulation.integrator": "implicitfast"}, r"simulation\.integrator = 'implicitfast' is not computed"),
        ({}, {"controller.name": "pid"}, r"controller\.name: is another one"),
        ({"controller.name": "external"}, {"controller.name": "pid"}, r"controller\.name: is another one"),
        ({"actuation.name": "external"}, {"actuation.name": "pseudo_inverse"}, r"actuation\.name: is another one"),
        ({}, {"observer.name": "momentum_observer"}, r"observer\.name: is another one"),
        ({}, {"thrusters.name": "t200"}, r"thrusters\.name: is another one"),
        ({}, {"bumper.stiffness": 1e3}, "other walls or contacts"),
        ({}, {"wall.present": False, "walls": [SPHERE]}, "other walls or contacts"),
        ({}, {"vehicle.model": "bluerov2_heavy"}, "another number of thrusters"),
    ],
)
def test_a_run_of_another_kind_is_refused_and_not_computed_as_the_first_one(first, other, said):
    """Records of one shape may be of other stages, whose code is not the fleet's."""
    fleet = fleet_of(Scenario.load("push_wall", first), 2)
    start = fleet._words
    with pytest.raises(NotInFleet, match=said):
        fleet.reset(other)
    assert fleet._words is start


@pytest.mark.parametrize(
    ("overrides", "reason"),
    [
        ({"vehicle.model": "bluerov2_alpha5"}, "has joints"),
        ({"actuation.name": "pwm", "thrusters.name": "t200"}, "actuation.name: pwm: a fleet takes no pulse widths"),
        ({"simulation.integrator": "implicitfast"}, "simulation.integrator"),
        ({"current.deviation": [0.1, 0.1, 0.0]}, "can't be compiled for many runs at once"),
    ],
)
def test_a_scenario_that_it_lacks_something_for_is_refused(overrides, reason):
    with pytest.raises(NotInFleet, match=reason):
        Fleet(Scenario.load("push_wall", overrides), 2, device="cpu").step()


def test_tables_that_differ_are_refused():
    fleet = Fleet(
        Scenario.load("push_wall", {"current.table": [[0.0, 0.1, 0.0, 0.0], [1.0, 0.2, 0.0, 0.0]]}), 2, device="cpu"
    )
    with pytest.raises(NotInFleet, match="other tables"):
        fleet.reset({"current.table": [[0.0, 0.2, 0.0, 0.0], [1.0, 0.2, 0.0, 0.0]]})


@pytest.fixture(scope="module")
def ptx(tmp_path_factory) -> str:
    """The kernels of a law with erf."""
    file = tmp_path_factory.mktemp("law") / "erf.py"
    text = LAW.replace("150.0 * signals.nu_e[k]", "150.0 * math.erf(signals.nu_e[k])")
    file.write_text(text.replace("import numpy", "import math\n\nimport numpy"))
    starts = Starts(Scenario.load("push_wall", AT_WALL | {"controller.name": f"{file}:Late"}))
    memory, stages = starts.memory, starts.memory.stages
    first = starts.parts()["p_WB"][0]
    source = FleetSource(
        memory.shape, stages.running, starts.template.view(np.uint8), [], [*range(first, first + 3)], stages.control
    )
    return source.emitted(PTX).code.decode()


def test_the_code_for_a_gpu_is_kernels_that_round_every_operation(ptx):
    """Nothing is left to a library of the device, not even of a law with erf."""
    assert ptx.count(".entry") == 2
    assert ".extern" not in ptx
    assert not re.search(r"\bfma\b", ptx)
    operations = re.findall(r"\b(?:add|sub|mul|div|sqrt)[.\w]*\.f64", ptx)
    assert len(operations) > 1000
    for operation in operations:
        assert ".rn" in operation, operation


def test_the_assembler_of_nvidia_takes_the_kernels(ptx, tmp_path):
    """The driver has the same assembler in it."""
    places = getattr(importlib.util.find_spec("nvidia"), "submodule_search_locations", ())
    found = next((path for place in places for path in Path(place).glob("*/bin/ptxas")), None)
    if found is None:
        pytest.skip("there is no ptxas")
    kernels, code = tmp_path / "fleet.ptx", tmp_path / "fleet.cubin"
    kernels.write_text(ptx.rstrip("\0"))
    command = [found, "--verbose", "--gpu-name=sm_90", kernels, f"--output-file={code}"]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr
    assert said.stderr.count("Compiling entry function") == 2


def has_gpu() -> bool:
    try:
        Gpu()
    except InputError:
        return False
    return True


def test_without_a_gpu_it_says_so():
    if has_gpu():
        pytest.skip("there is a GPU")
    with pytest.raises(InputError) as caught:
        Fleet(n=1, device="gpu")
    assert str(caught.value).startswith(("no GPU", "no module"))
    assert len(str(caught.value).splitlines()) == 1


def test_a_gpu_computes_what_this_processor_computes():
    if not has_gpu():
        pytest.skip("there is no GPU")
    base, tables = scenario({}, 300), []
    for device in ("gpu", "cpu"):
        fleet = Fleet(base, 64, signals=("p_WB", "tau", "force_peak"), device=device)
        fleet.reset({"wall.stiffness": np.geomspace(1e4, 1e6, 64)})
        fleet.step(300)
        tables.append(fleet.table())
    assert (tables[0] == tables[1]).all()
