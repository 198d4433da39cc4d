"""Each row of "Where to add something" is shown by a test that follows it: with a toy here, or where its subject is."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import click
import numpy as np
import pytest
from click.testing import CliRunner

from page_numbers import page
from two_joints import STILL, two_joints
from uvms_mj import Scenario, Trace, actuation, cli, control, guidance, navigation, simulate
from uvms_mj.actuation import Actuation, Joints, Thrusters, pseudo_inverse
from uvms_mj.analysis import summary
from uvms_mj.cli.plot import FONTS
from uvms_mj.control import Controller
from uvms_mj.engine.native import pipeline
from uvms_mj.errors import Fault, InputError
from uvms_mj.guidance import Guidance, station_keep
from uvms_mj.navigation import Observer
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.setup import checks
from uvms_mj.setup.base import set_up
from uvms_mj.stages.base import Room, Stage, setting
from uvms_mj.stages.signals import CLOCK, MEASURED, REFERENCE, Signal
from uvms_mj.views.figures import style

TESTS = Path(__file__).parent
SHORT = {"simulation.timestep": 1e-3, "simulation.duration": 0.02}
HERE, IN_SRC, SENSORS = "test_where_to_add.py", "test_added_to_src.py", "navigation/test_sensors.py"
LIBRARY = "engine/test_law_library.py"
SHIPS, NUMBER = "test_a_stage_that_ships_is_a_class_and_an_entry", "test_a_number_is_a_function_and_an_entry"
SHOWN = {
    "law, sensor, thruster, reference, vehicle of a user": ("cli/test_new.py", "test_the_commands_in_a_file_work"),
    "sensor channel": (SENSORS, "test_noise_has_its_variance_in_each_axis_and_is_white"),
    "preset of sensors": (SENSORS, "test_presets_are_sensors_with_other_numbers"),
    "observer of the contact force": (HERE, SHIPS),
    "guidance stage": (HERE, SHIPS),
    "allocation, `[actuation]`": (HERE, SHIPS),
    "joint interface": (HERE, "test_a_joint_interface_that_ships_is_a_class_and_an_entry"),
    "thrusters, `[thrusters]`": (HERE, SHIPS),
    "law, `[controller]`": (HERE, "test_a_law_that_ships_has_its_own_closed_form"),
    "check of a run, or warning before it": (HERE, "test_a_check_refuses_and_a_warning_is_said"),
    "vehicle": ("plant/test_own_vehicle.py", "test_it_runs_by_the_command_that_is_printed"),
    "format of a vehicle of others": ("plant/test_importing.py", "test_sdf_of_gz_sim_is_the_same_vehicle"),
    "wall shape": (IN_SRC, "test_a_shape_is_an_entry_and_its_lines"),
    "force of the water, of a user": ("plant/test_own_effects.py", "test_both_engines_and_plain_python_agree"),
    "motion of the water": ("physics/test_waves.py", "test_a_run_has_the_motion_of_the_water_along_both_ways"),
    "inertia that the water adds": (
        "physics/test_near_wall.py",
        "test_engines_agree_on_a_landing_and_the_rest_is_that_without_a_pad",
    ),
    "force of the water on the base": (IN_SRC, "test_an_effect_of_the_water_is_a_record_a_kernel_and_a_table"),
    "force of the water with states of its own": ("physics/test_cable.py", "test_both_engines_move_the_same_cable"),
    "number about a run": (HERE, NUMBER),
    "metric: a number that a study keeps, or that `run` prints": (HERE, NUMBER),
    "fonts of figures": (HERE, "test_fonts_are_an_entry_of_the_figures_and_of_the_command"),
    "command": (HERE, "test_a_command_is_a_function_that_is_added"),
    "signal": (HERE, "test_a_signal_is_recorded_where_its_owner_says_so"),
    "stage of the loop": (HERE, "test_a_stage_of_the_loop_is_a_class_and_a_place"),
    "function of NumPy in the language": ("compiler/test_functions.py", "test_no_function_is_left_out"),
    "processor that the loop is emitted for": (
        "engine/test_other_targets.py",
        "test_the_loop_is_emitted_for_another_processor",
    ),
    "processor that a law leaves for": (LIBRARY, "test_the_recorded_steps_are_equal_on_each_processor"),
    "stage that a law takes along, or leaves behind": (LIBRARY, "test_stages_beside_the_law_leave_with_it"),
    "device of a fleet": ("engine/test_fleet.py", "test_a_gpu_computes_what_this_processor_computes"),
    "view of a video, format of a video": ("views/test_video.py", "test_refusals_come_before_the_first_picture"),
    "what an object shows in a notebook": ("views/test_notebook.py", "test_a_study_shows_its_plan_and_its_results"),
    "page of a task": ("test_pages.py", "test_each_block_of_a_page_runs"),
    "measured number of a page": ("test_page_numbers.py", "test_numbers_of_a_page_are_those_of_its_runs"),
    "number that a reader of the pool may change": (
        "test_pool.py",
        "test_numbers_change_during_a_run_as_those_of_a_simulation",
    ),
    "axis or claim of practicality": (
        "reproduce/test_practicality.py",
        "test_the_studies_have_every_axis_law_and_step",
    ),
    "claim about the paper": ("reproduce/test_claims.py", "test_a_claim_needs_a_threshold"),
    "kind of experiment of an identification": (
        "studies/test_identify.py",
        "test_the_force_of_a_towing_holds_the_velocity_in_the_plant",
    ),
    "coefficient that can be identified": ("studies/test_identify.py", "test_every_name_reads_what_it_sets"),
    "study that ships": ("studies/test_shipped.py", "test_a_shipped_study_runs"),
    "table of the reference: signals, keys, metrics, stages": ("cli/test_listing.py", "test_keys_and_signals_list_all"),
}
"""The test that shows a row: its file and its name."""
NOT_SHOWN = {
    "task of Contact-10": "none is added",
    "section, table, or column, of a page of results": "each page has a test of its own tables",
    "table that another command prints": "each command has a test of its own table",
}
"""Rows without a test of their own, and the reason."""


def test_every_row_is_shown_by_a_test():
    rows = page("architecture").read_text().split("| new | where | how |")[1].split("\n\n")[0].splitlines()[2:]
    assert sorted(row.split("|")[1].strip() for row in rows) == sorted([*SHOWN, *NOT_SHOWN])
    for row, (file, name) in SHOWN.items():
        assert re.search(rf"^def {name}\(", (TESTS / file).read_text(), re.MULTILINE), row


def ships(cls):
    """The class as one of the package."""
    cls.__module__ = "uvms_mj.toys"
    return cls


@ships
@dataclass(frozen=True)
class Spot(Guidance):
    name = "spot"
    x: float = setting(0.7, "m", "place along x")

    @staticmethod
    def step(settings, state, given, state_dot, out):
        station_keep(settings, given, out)
        out.p_d[0] = settings.x


@ships
@dataclass(frozen=True)
class Blind(Observer):
    name = "blind"

    @staticmethod
    def step(settings, state, given, state_dot, out):
        out.f_contact_m_W[:] = 0.0
        out.f_contact_m_W[1] = -3.0
        out.tau_contact_m_B[:] = 0.0


@ships
@dataclass(frozen=True)
class Weak(Actuation):
    name = "weak"

    @staticmethod
    def step(settings, state, given, state_dot, u):
        pseudo_inverse(given, u)
        u[0] = 1.25


@ships
@dataclass(frozen=True)
class Half(Thrusters):
    name = "half"

    @staticmethod
    def step(settings, state, given, state_dot, u):
        u[:] = 0.5 * given.u_cmd


@ships
@dataclass(frozen=True)
class Spring(Joints):
    name = "spring"

    @staticmethod
    def step(settings, state, given, state_dot, tau_q):
        tau_q[:] = -2.0 * given.q_m - 0.25


@ships
@dataclass(frozen=True)
class Push(Controller):
    name = "push"
    uses_task = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = 0.0
        tau_cmd[0] = 4.5

    def at_rest(self, setup):
        return 4.5


@pytest.mark.parametrize(
    ("table", "entries", "toy", "shown"),
    [
        ("reference", guidance.SHIPPED, Spot, lambda run: (run.p_d[:, 0], 0.7)),
        ("observer", navigation.OBSERVERS, Blind, lambda run: (run.f_contact_m_W[:, 1], -3.0)),
        ("actuation", actuation.SHIPPED, Weak, lambda run: (run.u[:, 0], 1.25)),
        ("thrusters", actuation.THRUSTERS, Half, lambda run: (run.u, 0.5 * run.u_cmd)),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
@pytest.mark.parametrize("engine", ["mujoco", "free_body"])
def test_a_stage_that_ships_is_a_class_and_an_entry(monkeypatch, engine, table, entries, toy, shown):
    monkeypatch.setitem(entries, toy.name, toy)
    scenario = Scenario.load("push_wall", SHORT | {f"{table}.name": toy.name})
    run = simulate(scenario, engine=engine, log_rate="full")
    assert np.array_equal(*np.broadcast_arrays(*shown(run)))
    assert Scenario.from_dict(scenario.to_dict()) == scenario


def test_a_joint_interface_that_ships_is_a_class_and_an_entry(monkeypatch, tmp_path):
    (tmp_path / "rov.xml").write_text(two_joints())
    monkeypatch.setitem(actuation.JOINTS, Spring.name, Spring)
    own = {"vehicle.model": str(tmp_path / "rov.xml"), "joints.name": "spring", "simulation.duration": 0.01}
    run = simulate(Scenario.load("push_wall", STILL | own), log_rate="full")
    assert np.array_equal(run.tau_q, -2.0 * run.q - 0.25)


def test_a_law_that_ships_has_its_own_closed_form(monkeypatch):
    """A constant force along the wall's normal, in still water, is the force at rest."""
    monkeypatch.setitem(control.SHIPPED, Push.name, Push)
    own = {"simulation.timestep": 1e-3, "wall.stiffness": 2e3, "wall.damping": 1e3, "current.speed": 0.0}
    run = simulate(Scenario.load("push_wall", own | {"simulation.duration": 60.0}, "push"), engine="free_body")
    assert run.analytic.force == 4.5
    assert run.push[-1] == pytest.approx(4.5, abs=1e-6)


def test_a_check_refuses_and_a_warning_is_said(monkeypatch):
    setup = set_up(Scenario.load("push_wall", SHORT))
    monkeypatch.setattr(checks, "NOTES", (*checks.NOTES, lambda setup: [f"it is {setup.scenario.name}"]))
    assert "it is push_wall" in checks.warnings_of(setup)
    monkeypatch.setattr(checks, "CHECKS", (*checks.CHECKS, lambda setup: [Fault("wall", "is not painted")]))
    with pytest.raises(InputError, match="wall: is not painted"):
        simulate(setup.scenario)


def test_a_number_is_a_function_and_an_entry(monkeypatch):
    number = summary.Number(lambda trace: float(trace.p_WB[-1, 2]), "height at the end [m]")
    monkeypatch.setitem(summary.NUMBERS, "height_m", number)
    run = simulate(Scenario.load("push_wall", SHORT))
    assert summary.summary(run, {})["height_m"] == run.p_WB[-1, 2]


def test_fonts_are_an_entry_of_the_figures_and_of_the_command():
    assert tuple(style.FONTS) == FONTS


@pytest.mark.parametrize("engine", ["mujoco", "free_body"])
def test_a_signal_is_recorded_where_its_owner_says_so(monkeypatch, tmp_path, engine):
    """The estimated restoring wrench of the law's model, of which no topic of a log knows."""
    g_hat = Signal("g_hat", (6,), "N, N m", "B", "estimated restoring wrench")
    shown = {"model": lambda loop, run: [(g_hat, loop.signals["g_hat"])]}
    places = tuple(replace(each, records=shown.get(each.name, each.records)) for each in pipeline.INSTANT)
    monkeypatch.setattr(pipeline, "INSTANT", places)
    run = simulate(
        Scenario.load(
            "push_wall", SHORT | {"vehicle.model": "bluerov2_heavy", "initial.attitude_deg": [10.0, 20.0, 0.0]}
        ),
        engine=engine,
    )
    setup = set_up(run.scenario)
    restoring = setup.start.restoring(rotation_matrix(run.quat_WB[0]), setup.gravity_W)
    assert np.abs(restoring[:5]).min() > 0.1  # in all axes but yaw
    assert run.g_hat[0] == pytest.approx(restoring, abs=1e-12)
    run.save(tmp_path / "run.mcap")
    assert np.array_equal(Trace.load(tmp_path / "run.mcap").g_hat, run.g_hat)


@ships
@dataclass(frozen=True)
class Lift(Stage):
    """Moves the reference up, after guidance has set it."""

    name = "lift"
    room = Room("guidance", "lift", lambda thrusters: CLOCK, REFERENCE)

    @staticmethod
    def step(settings, state, given, state_dot, out):
        out.p_d[2] += 0.25


@pytest.mark.parametrize("engine", ["mujoco", "free_body"])
def test_a_stage_of_the_loop_is_a_class_and_a_place(monkeypatch, engine):
    own = SHORT | {"reference.target": [1.2, 0.0, 0.5], "controller.period": 0.002, "simulation.duration": 0.1}
    before = simulate(Scenario.load("push_wall", own), engine=engine, log_rate="full")
    place = pipeline.Place("lift", "always", lambda setup: Lift(), *map(pipeline._signals, (CLOCK, REFERENCE)))
    at = [each.name for each in pipeline.INSTANT].index("tracking")
    monkeypatch.setattr(pipeline, "INSTANT", (*pipeline.INSTANT[:at], place, *pipeline.INSTANT[at:]))
    after = simulate(before.scenario, engine=engine, log_rate="full")
    assert np.array_equal(after.p_d, before.p_d + np.array([0.0, 0.0, 0.25]))
    assert np.allclose(after.eta_e[0] - before.eta_e[0], [0.0, 0.0, -0.25, 0.0, 0.0, 0.0], atol=1e-15)


@ships
@dataclass(frozen=True)
class Mean(Stage):
    """A second estimator: the mean motion. Its result is its state alone, and it sets nothing."""

    name = "mean"
    states: ClassVar = {"nu_mean": 6}
    room = Room("navigation", "mean", lambda thrusters: CLOCK + MEASURED, ())

    @staticmethod
    def step(settings, state, given, state_dot, out):
        state_dot.nu_mean[:] = given.nu - state.nu_mean


@pytest.mark.parametrize("engine", ["mujoco", "free_body"])
def test_a_stage_whose_states_are_its_results_sets_nothing(monkeypatch, engine):
    place = pipeline.Place(
        "mean", "always", lambda setup: Mean(), pipeline._signals(CLOCK + MEASURED), pipeline._signals(())
    )
    monkeypatch.setattr(pipeline, "INSTANT", (*pipeline.INSTANT[:5], place, *pipeline.INSTANT[5:]))
    run = simulate(Scenario.load("push_wall", SHORT | {"initial.velocity": [0.1] * 6}), engine=engine, log_rate="full")
    mean = np.zeros(6)
    for k in range(len(run.t)):
        assert run.nu_mean[k] == pytest.approx(mean, abs=1e-15)
        mean += 1e-3 * (run.nu[k] - mean)


def test_a_command_is_a_function_that_is_added(monkeypatch):
    @click.command()
    def greet():
        click.echo("ahoy")

    monkeypatch.setitem(cli.main.commands, "greet", greet)
    assert CliRunner().invoke(cli.main, ["greet"]).output == "ahoy\n"
