"""Contact-10 gives no truth away: what a law is given at t = 0, and laws that look for their draw."""

import functools

import numpy as np
import pytest

from law_files import HEADER
from uvms_mj import Simulation
from uvms_mj.reproduce.bench.draws import Draws
from uvms_mj.reproduce.bench.task import LEVELS, Entry, tasks
from uvms_mj.studies.bundle import StudyBundle
from uvms_mj.studies.rows import rows_of

TASKS = tasks()
BLIND = Draws.parsed("seed:20260101")
MEASURED = {
    "gusts_and_delay": ("f_contact_m_W", "tau_contact_m_B", "w", "tau_nom"),
    "everything_real": (
        *("p_WB", "quat_WB", "R_WB", "nu", "f_contact_m_W", "tau_contact_m_B", "quat_e", "eta_e", "nu_e"),
        *("C_hat_nu", "D_hat_nu", "g_hat", "tau_hat", "w", "tau_nom", "s"),
    ),
}
"""The signals of tasks with real sensors that have a measurement at t = 0, or are computed from one."""


def given_at_start(plan, index):
    """What the law is given at t = 0 by name, and the settings of its stages as bytes."""
    with Simulation(plan.scenario(index), engine=plan.engine, looks=False) as sim:
        sim.step(1)
        stages = {each.stage.room.table: each for each in sim._stages.running}
        record = stages["controller"].given
        settings = b"".join(stages[table].settings.tobytes() for table in ("controller", "task", "actuation"))
        return {name: np.array(record[name][0]) for name in record.dtype.names}, settings


@pytest.mark.parametrize("name", TASKS)
def test_no_signal_key_or_setting_at_the_start_differs_between_draws_but_a_measurement(name):
    for level in (LEVELS[0], LEVELS[-1]):
        plan = Entry("impedance", "impedance").plan(TASKS[name], level, BLIND, 3)
        first, settings = given_at_start(plan, 0)
        for index in (1, 2):
            other, its = given_at_start(plan, index)
            assert its == settings
            differ = {each for each in first if first[each].tobytes() != other[each].tobytes()}
            assert differ <= set(MEASURED.get(name, ())), differ
            assert "key" not in differ


@pytest.mark.parametrize("name", MEASURED)
def test_no_drawn_number_is_read_off_a_measurement_at_the_start(name):
    """The squared correlation of each drawn number with each number that is measured stays below a half: the bias of a
    sensor shows in its noise, as it does in water, and nothing else."""
    draws = 40
    plan = Entry("impedance", "impedance").plan(TASKS[name], 3, BLIND, draws)
    rows = [given_at_start(plan, index)[0] for index in range(draws)]
    seen = np.array([np.concatenate([row[each].astype(float).ravel() for each in MEASURED[name]]) for row in rows])
    drawn = np.array([[float(x) for x in point if np.isscalar(x)] for point in plan.points])
    for column in drawn.T:
        for signal in seen.T:
            if signal.std() > 1e-12 and column.std() > 0.0:
                assert np.corrcoef(column, signal)[0, 1] ** 2 < 0.5


LAW = """
@dataclass(frozen=True)
class Peeks(Controller):
    states: ClassVar = {{"nu_hat": 6, "sigma": 6, "d_hat": 6}}
    memory: ClassVar = {{"calls": 1, "first": 3, "k": 1}}

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        if state.calls[0] == 0.0:
            state.k[0] = 20.0
        state.calls[0] += 1.0
        {peek}
        integral_residual(signals, state.nu_hat, state_dot.nu_hat, state.sigma)
        state.d_hat[:] = 0.0
        add_product(state.k[0] * signals.M_hat, state.sigma, state.d_hat)
        tau_cmd[:] = signals.tau_nom - state.d_hat
"""
IMPORTS = "from typing import ClassVar\nfrom uvms_mj.control.laws.terms import add_product, integral_residual\n"
WRONG_K = "state.k[0] = 0.0"
PEEKS = {
    "honest": ("", "pass"),
    "time": ("", f"if signals.t > 1e9: {WRONG_K}"),
    "key": ("", f"if signals.key != KEY: {WRONG_K}"),
    "M_d": ("", f"if abs(signals.M_d[0, 0] - signals.M_hat[0, 0]) > 1e-9: {WRONG_K}"),
    "first signals": ("TABLE = {table}\n", f"if state.calls[0] == 3.0 and signals.p_WB[0] in TABLE: {WRONG_K}"),
    "number of calls": ("", f"if state.calls[0] != signals.instant + 1: {WRONG_K}"),
    "globals": ("RUNS = [0]\nRUNS[0] += 1\n", f"if RUNS[0] != 1: {WRONG_K}"),
    "clock": ("import time\nTHEN = time.time()\n", f"if THEN < 1e9: {WRONG_K}"),
    "seed": ("", f"if signals.seed > 0: {WRONG_K}"),
    "files as it loads": ("import glob\nFOUND = glob.glob('/**/study.toml')\n", f"if FOUND: {WRONG_K}"),
    "files in the run": ("", f"if 'seed' in open('/etc/passwd').read(): {WRONG_K}"),
    "frames": ("import sys\nABOVE = sys._getframe(1)\n", f"if ABOVE is None: {WRONG_K}"),
    "objects": ("import gc\nOBJECTS = gc.get_objects()\n", f"if OBJECTS: {WRONG_K}"),
    "a process": ("import subprocess\nsubprocess.run(['true'])\n", "pass"),
    "a socket": ("import socket\nsocket.create_server(('127.0.0.1', 0))\n", "pass"),
}
REFUSED = ("seed", "files as it loads", "files in the run", "frames", "objects", "a process", "a socket")


@functools.cache
def first_positions():
    """x of the third instant in development draws of the task: what a law may have in a table."""
    plan = Entry("impedance", "impedance").plan(TASKS["other_vehicle"], 2, most=5)
    found = []
    for index in range(5):
        with Simulation(plan.scenario(index), engine=plan.engine, looks=False) as sim:
            while sim.t < 2.0 * plan.base.controller.period:
                sim.step(1)
            (law,) = (each for each in sim._stages.running if each.stage.room.table == "controller")
            found.append(float(law.given["p_WB"][0, 0]))
    return tuple(found)


def rows(tmp_path, name):
    """The outcomes of a law on two blind draws: status, message, and the metrics."""
    top, peek = PEEKS[name]
    key = 0
    if name == "key":
        plan = Entry("impedance", "impedance").plan(TASKS["other_vehicle"], 2, most=1)
        key = int(given_at_start(plan, 0)[0]["key"])
    top = top.replace("{table}", repr(first_positions()) if "{table}" in top else "") + f"KEY = {key}\n"
    path = tmp_path / "peeks.py"
    path.write_text(HEADER + IMPORTS + top + LAW.format(peek=peek))
    try:
        plan = Entry("peeks", f"{path}:Peeks").plan(TASKS["other_vehicle"], 2, BLIND, 2)
        found = rows_of(StudyBundle.of(plan), (0, 1))
    except Exception as error:
        return str(error)
    return [
        (row["status"], row["message"], row["hold.error_N"], row["contact.peak_N"], row["effort_N2s"]) for row in found
    ]


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    """The rows of the law that does not look."""
    return rows(tmp_path_factory.mktemp("honest"), "honest")


@pytest.mark.parametrize("name", [name for name in PEEKS if name != "honest"])
def test_a_law_that_looks_for_its_draw_gains_nothing(tmp_path, honest, name):
    """Its blind rows are the rows of the same law without the look, bit for bit, or it does not run."""
    found = rows(tmp_path, name)
    if name not in REFUSED:
        assert found == honest
        assert all(row[0] == "completed" for row in found)
        return
    said = found if isinstance(found, str) else " ".join(f"{row[0]} {row[1]}" for row in found)
    assert isinstance(found, str) or all(row[0] in ("failed", "refused") for row in found), found
    assert "reads the files beside its own alone" in said or "seed" in said
