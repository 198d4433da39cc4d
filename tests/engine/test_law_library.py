"""A law's library in C: equal bits on four processors, headers without a warning, and what misuse gives."""

import contextlib
import ctypes
import importlib
import json
import platform
import re
import shutil
import socket
import struct
import subprocess
import sys
import threading
import time
import tomllib
from pathlib import Path

import llvmlite.binding as llvm
import numpy as np
import pytest
from click.testing import CliRunner

from uvms_mj import InputError, Scenario, Simulation, simulate
from uvms_mj.cli import main
from uvms_mj.compiler import apart, libm
from uvms_mj.control import BUILT_IN
from uvms_mj.control.base import PORT
from uvms_mj.engine import law_library
from uvms_mj.engine.law_library import elf_object, linking, texts, vectors
from uvms_mj.engine.law_library.library import name_of, write_library
from uvms_mj.engine.law_library.linking import MACHINES
from uvms_mj.engine.native.chain import Chain
from uvms_mj.engine.udp import LAYOUT, MAGIC, SIGNALS, STATUSES

pytest.importorskip("ziglang")
QEMU = "apt-get install qemu-user qemu-system-arm"
EXAMPLES = Path(__file__).parents[2] / "examples"
USERS = EXAMPLES.parent / "tests" / "data" / "users_laws.py"
FREESTANDING = Path(law_library.__file__).with_name("freestanding")
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]
SOFT = {"wall.stiffness": 2e3}
HEAVY = SOFT | {"vehicle.model": "bluerov2_heavy", "thrusters.name": "t200", "controller.period": 0.02}
KINDS = {
    "pulses": ("gsta", HEAVY | {"actuation.name": "scaled"}),
    "delay": ("gsta", SOFT | {"controller.period": 0.01, "controller.delay": 0.005}),
    "observer": ("impedance", SOFT | {"observer.name": "momentum_observer", "current.speed": 0.0}),
    "constrained": ("fosm", {"actuation.name": "constrained"}),
    "a policy": (f"{EXAMPLES / 'learned_push.py'}:LearnedPush", {}),
    "a user's": (f"{EXAMPLES / 'pd.py'}:Pd", {}),
    "small MPC": (f"{USERS}:SmallMpc", SOFT | {"controller.period": 0.01}),
    "PID with limits": (f"{USERS}:AntiWindupPid", SOFT),
    "backstepping": (f"{USERS}:Backstepping", SOFT),
    "adaptive": (f"{USERS}:Adaptive", SOFT),
    "LQR": (f"{USERS}:LqrIntegral", SOFT),
    "a policy of 64 x 64": (f"{USERS}:Policy", SOFT),
}
MY_LAW = """
#include "uvms_stage.h"
int my_law(const struct settings *gains, struct state *state, const struct signals *signals, struct state *state_dot,
           double *tau_cmd)
{
    for (int i = 0; i < 6; i++) {
        state_dot->xi[i] = signals->eta_e[i];
        tau_cmd[i] = signals->g_hat[i] - gains->k * signals->eta_e[i] - 100.0 * signals->nu_e[i] - 10.0 * state->xi[i];
    }
    return 0;
}
"""
MY_TOML = 'stage = "controller"\nuses_task = false\n[settings]\nk = {default = 200.0}\n[states]\nxi = {size = 6}\n'
PLAIN = """
from dataclasses import dataclass
from uvms_mj import Controller
@dataclass(frozen=True)
class Plain(Controller):
    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        said = str(signals.t)
        tau_cmd[:] = float(said)
"""
READS_A_MODULE = """
from dataclasses import dataclass
from uvms_mj import Controller
from weight_of_law import WEIGHT
@dataclass(frozen=True)
class Reads(Controller):
    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.g_hat - 200.0 * signals.eta_e - WEIGHT * signals.nu_e
"""


def scenario(law, settings=None, name="push_wall"):
    return Scenario.load(name, settings or {}, law)


def runs_here(target):
    return linking.emulator(MACHINES[target]) is not None


EMULATED = [each for each in MACHINES if each != "x86_64" and runs_here(each)]


@pytest.fixture(scope="module")
def gsta(tmp_path_factory):
    """GSTA of push_wall for all processors, and what was made."""
    folder = tmp_path_factory.mktemp("gsta")
    return folder, write_library(scenario("gsta"), folder, [*MACHINES])


@pytest.mark.parametrize("target", MACHINES)
def test_the_recorded_steps_are_equal_on_each_processor(gsta, target):
    """1,200 steps in free motion, at the touch and pressing; thumbv7em on a Cortex-M7 without an operating system."""
    folder, library = gsta
    made = next(each for each in library.targets if each.target == target)
    if not runs_here(target):
        pytest.skip(f"no emulator of {target}: {QEMU}")
    assert made.equal == library.steps == 1200
    assert 200 < made.stack < 2000
    about = tomllib.loads((folder / "gsta.toml").read_text())
    assert f"{made.stack} bytes" in (folder / "README.md").read_text()
    assert about["targets"][target]["code_bytes"] == made.code
    assert about["scenario"]["controller"]["k_1"] == BUILT_IN["gsta"]().k_1


@pytest.mark.parametrize("target", MACHINES)
def test_a_library_takes_nothing_but_functions_that_move_memory(gsta, target):
    """No heap, no C library, and nothing that is kept beside an instance."""
    _, library = gsta
    made = next(each for each in library.targets if each.target == target)
    moves = {"memcpy", "memset", "memmove"} | {
        f"__aeabi_mem{n}{k}" for n in ("cpy", "move", "clr", "set") for k in ("", 4, 8)
    }
    assert set(made.undefined) <= moves
    assert made.code < 16_000
    assert library.record < 12_000


def texts_of(monkeypatch):
    """The texts that LLVM optimizes from now on."""
    made, taken = linking.emitted, []
    monkeypatch.setattr(linking, "emitted", lambda text, *given: taken.append(text) or made(text, *given))
    return taken


def assert_no_pointer_is_in_memory(text):
    """It is optimized where pointers have 64 bits, and taken where they have 32: numbers alone have equal sizes."""
    module = str(apart._WIDEST.optimized(llvm.parse_assembly(text)))
    assert module.count(" load double") > 100
    assert re.findall(r"^.*(?:alloca|load|store) (?:ptr|\[\d+ x ptr\]|\{[^}]*ptr).*$", module, re.MULTILINE) == []


@pytest.mark.parametrize("kind", ["constrained", "a policy of 64 x 64"])
def test_what_is_optimized_for_all_processors_has_no_pointer_in_memory(tmp_path, monkeypatch, kind):
    """So is a text with a loop of the law itself: :func:`test_stages_beside_the_law_leave_with_it`."""
    taken = texts_of(monkeypatch)
    write_library(scenario(*KINDS[kind]), tmp_path, ["x86_64"], test=False)
    assert_no_pointer_is_in_memory(taken[0])


def test_a_law_that_fails_in_the_run_is_refused_by_its_line(tmp_path):
    (tmp_path / "fails.py").write_text(
        READS_A_MODULE.replace("from weight_of_law", "# ").replace("WEIGHT", "1 / 0.0 * 0.0")
    )
    with pytest.raises(InputError, match=r"(?s)run for its test ends.*fails\.py, line 9"):
        write_library(scenario(f"{tmp_path / 'fails.py'}:Reads"), tmp_path / "out", ["x86_64"], test=False)


def test_the_recorded_steps_are_of_a_run_from_its_beginning(tmp_path, monkeypatch):
    """The run goes on from a state before the touch, if it can be saved."""
    scenario, restored, restore = Scenario.load("push_wall", {}, "gsta"), [], Simulation.restore

    def refuses(self):
        raise InputError("save: a stage may keep numbers that are not saved")

    monkeypatch.setattr(Simulation, "restore", lambda self, saved: restored.append(saved) or restore(self, saved))
    write_library(scenario, tmp_path / "saved", ["x86_64"], test=False)
    assert len(restored) == 1
    monkeypatch.setattr(Simulation, "save", refuses)
    write_library(scenario, tmp_path / "begun", ["x86_64"], test=False)
    assert len(restored) == 1
    one, other = ((tmp_path / name / "vectors.h").read_bytes() for name in ("saved", "begun"))
    assert one == other
    assert b'"pressing"' in one


def test_a_library_has_the_rows_of_its_reference_that_come(gsta, tmp_path):
    """One step, or three, which take four rows: 32 bytes each. The room for a thousand stays behind. With all of the
    steps, and a time after the last one, the recorded steps are the run's."""
    few = [{"time": 0.1 * k, "position": [0.02 * k, 0.0, 0.0]} for k in range(1, 4)]
    settings = {"reference.waypoints": few, "controller.period": 0.01, "simulation.duration": 13.0}
    library = write_library(scenario("gsta", settings), tmp_path, ["x86_64"])
    assert library.targets[0].equal in (None, library.steps)
    one = next(each for each in gsta[1].targets if each.target == "x86_64").constants
    assert 90 <= library.targets[0].constants - one < 1500  # three rows more, and another image
    assert one < 9000


def test_a_program_does_not_carry_the_law_of_a_run(gsta, tmp_path):
    """GSTA with model, allocation and T200 is at most 16 kB of code. The law of a run is in none of the sizes: it is an
    object of its own, which the linker leaves out of a program."""
    settings = HEAVY | {"actuation.name": "scaled"}
    made = write_library(scenario("gsta", settings), tmp_path / "heavy", ["x86_64"], test=False).targets[0]
    assert made.code <= 16 * 1024
    folder, library = gsta
    made = next(each for each in library.targets if each.target == "x86_64")
    archive = folder / "x86_64" / "libgsta.a"
    linking.run([*linking.zig(), "ar", "x", str(archive)], tmp_path)
    objects = {each.stem: each.read_bytes() for each in tmp_path.glob("*.o")}
    adapter = objects.pop("as_law")
    assert "gsta_law" in elf_object.defined(adapter)
    assert sum(elf_object.sizes(code)[0] for code in objects.values()) == made.code
    assert sum(elf_object.sizes(adapter)) == made.adapter
    program = linking.program(MACHINES["x86_64"], archive, folder / "test.c", tmp_path).read_bytes()
    assert "gsta_step_of" in elf_object.defined(program)
    assert "gsta_law" not in elf_object.defined(program)


def test_the_readme_has_the_line_of_a_compiler_for_each_target(gsta, tmp_path):
    """Each line names one target's library and its processor. The line for this machine is run as it stands."""
    folder = shutil.copytree(gsta[0], tmp_path / "copy")
    lines = [line.partition(" && ") for line in (folder / "README.md").read_text().splitlines() if " -std=c99 " in line]
    for target, machine in MACHINES.items():
        mine = [line for line, _, _ in lines if f" {target}/libgsta.a " in line]
        tests, loops = ([line for line in mine if f" {program}.c " in line] for program in ("test", "loop"))
        assert (len(tests), len(loops)) == ((2, 2) if machine.shared else (1, 0))
        triple = f"-target {(machine if machine.shared else MACHINES['armv7']).zig[1]} "
        assert all(line.startswith("cc ") or triple in line for line in mine)
    if platform.machine() != "x86_64" or not shutil.which("cc"):
        pytest.skip("no C compiler for this machine")
    (line,) = [line for line in map("".join, lines) if line.startswith("cc ") and "test.c x86_64/" in line]
    assert subprocess.run(line, shell=True, cwd=folder, capture_output=True).returncode == 0


def test_a_byte_of_the_record_that_changes_is_found(gsta, tmp_path):
    """The test of a library can fail: with another gain it says which number of which step differs."""
    folder, _ = gsta
    sources = tmp_path / "sources"
    sources.mkdir()
    for name in ("gsta.h", "vectors.h"):
        shutil.copy(folder / name, sources)
    text = (folder / "test.c").read_text()
    line = "        instance.last = segments[s].last;"
    assert line in text
    change = "{ gsta_settings g; gsta_get(&instance, &g); g.k_1 *= 1.0000000000000002; gsta_set(&instance, &g); }"
    (sources / "test.c").write_text(text.replace(line, f"{line}\n{change}"))
    program = linking.program(MACHINES["x86_64"], folder / "x86_64" / "libgsta.a", sources / "test.c", tmp_path)
    if not runs_here("x86_64"):
        pytest.skip("another processor")
    done = subprocess.run([program], capture_output=True, text=True)
    assert done.returncode == 1
    assert "tau_cmd[" in done.stdout
    assert "is the lowest that differs" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("target", MACHINES)
@pytest.mark.parametrize(("language", "suffix"), [("c99", "c"), ("c++17", "cpp")])
def test_header_and_test_compile_without_a_warning(gsta, tmp_path, target, language, suffix):
    folder, _ = gsta
    for name in ("gsta.h", "vectors.h"):
        shutil.copy(folder / name, tmp_path)
    shutil.copy(folder / "test.c", tmp_path / f"test.{suffix}")
    zig = [each for each in MACHINES[target].zig if each != "-fPIC"]
    tool = "cc" if language == "c99" else "c++"
    options = [*zig, f"-std={language}", *WARNINGS, "-ffreestanding", "-I", str(FREESTANDING), "-c", f"test.{suffix}"]
    done = subprocess.run([*linking.zig(), tool, *options], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_compiler_of_this_machine_warns_of_nothing_and_links_both_libraries(gsta, tmp_path):
    folder, _ = gsta
    if shutil.which("gcc") is None or not runs_here("x86_64"):
        pytest.skip("no gcc for x86_64 here")
    for library in ("libgsta.a", "libgsta.so"):
        place = (folder / "x86_64" / library).resolve()
        out = tmp_path / library.replace(".", "_")
        done = subprocess.run(
            ["gcc", "-std=c99", "-O2", *WARNINGS, "test.c", place, "-o", out], cwd=folder, capture_output=True
        )
        assert done.returncode == 0, done.stderr
        done = subprocess.run([out], capture_output=True, text=True, env={"LD_LIBRARY_PATH": str(place.parent)})
        assert done.returncode == 0
        assert "1200 of 1200 steps equal" in done.stdout


# misuse


class Measured(ctypes.Structure):
    _fields_ = [("t", ctypes.c_double), ("present", ctypes.c_uint64), ("numbers", ctypes.c_double * 22)]


class Command(ctypes.Structure):
    _fields_ = [("numbers", ctypes.c_double * 18), ("saturated", ctypes.c_uint64)]


OK, LATE, NULL, OTHER_HEADER, NOT_BEGUN, NOT_FINITE, MISSING, NO_ATTITUDE, TIME_BACK, GAP, FAULT = (
    0,
    1,
    *range(-1, -10, -1),
)
PERIOD = 1e-4


class Instance:
    """An instance of the library for this machine."""

    def __init__(self, folder):
        self.library = ctypes.CDLL(str(folder / "x86_64" / "libgsta.so"))
        self.layout = int(tomllib.loads((folder / "gsta.toml").read_text())["library"]["layout"], 16)
        self.library.gsta_bytes.restype = ctypes.c_uint64
        self.library.gsta_text.restype = ctypes.c_char_p
        self.memory = ctypes.create_string_buffer(self.library.gsta_bytes())
        self.command = Command()

    def init(self, layout=None):
        return self.library.gsta_init_of(ctypes.c_uint64(layout or self.layout), self.memory)

    def measured(self, t, x=None, present=7):
        """At rest at t = 0, where the reference begins, and 1 cm ahead of it later."""
        x = (0.0 if t == 0.0 else 0.01) if x is None else x
        numbers = [x, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, *[0.0] * 15]
        return Measured(t, present, (ctypes.c_double * 22)(*numbers))

    def step(self, measured, layout=None):
        """A step, whose command was something else before."""
        self.command = Command((ctypes.c_double * 18)(*[77.0] * 18), 5)
        return self.library.gsta_step_of(
            ctypes.c_uint64(layout or self.layout), self.memory, ctypes.byref(measured), ctypes.byref(self.command)
        )

    @property
    def neutral(self):
        return not any(self.command.numbers) and self.command.saturated == 0


@pytest.fixture
def instance(gsta):
    if not runs_here("x86_64"):
        pytest.skip("another processor")
    return Instance(gsta[0])


def test_a_step_before_init_is_neutral(instance):
    assert instance.step(instance.measured(0.0)) == NOT_BEGUN
    assert instance.neutral
    assert instance.library.gsta_reset(instance.memory) == NOT_BEGUN
    assert b"init" in instance.library.gsta_text(NOT_BEGUN)


def test_another_header_is_refused_and_nothing_is_written(instance):
    """Its structs may be smaller: the header's own function has made the command neutral before."""
    before = bytes(instance.memory)
    assert instance.init(instance.layout + 1) == OTHER_HEADER
    assert bytes(instance.memory) == before
    assert instance.init() == OK
    assert instance.step(instance.measured(0.0), instance.layout + 1) == OTHER_HEADER
    assert set(instance.command.numbers) == {77.0}


def test_a_program_with_an_old_header_gets_a_neutral_command(gsta, tmp_path):
    folder, _ = gsta
    if not runs_here("x86_64"):
        pytest.skip("another processor")
    header = (folder / "gsta.h").read_text()
    layout = header.split("#define GSTA_LAYOUT UINT64_C(")[1].split(")")[0]
    (tmp_path / "gsta.h").write_text(header.replace(layout, str(int(layout) ^ 2)))
    (tmp_path / "test.c").write_text("""
#include "gsta.h"
#include <stdio.h>
int main(void)
{
    static gsta law;
    gsta_measured measured = {0};
    gsta_command command;
    command.u_cmd[0] = 99.0;
    printf("%d ", gsta_init(&law));
    printf("%d ", gsta_step(&law, &measured, &command));
    printf("%d\\n", (int)command.u_cmd[0]);
    return 0;
}
""")
    program = linking.program(MACHINES["x86_64"], folder / "x86_64" / "libgsta.a", tmp_path / "test.c", tmp_path)
    assert subprocess.run([program], capture_output=True, text=True).stdout == "-2 -2 0\n"


def test_wrong_measurements_give_a_neutral_command_and_the_law_goes_on(instance):
    assert instance.init() == OK
    assert instance.step(instance.measured(0.0)) == OK
    assert instance.step(instance.measured(PERIOD)) == OK
    assert not instance.neutral
    wrong = [
        (instance.measured(float("nan")), NOT_FINITE),
        (instance.measured(2 * PERIOD, x=float("inf")), NOT_FINITE),
        (instance.measured(3 * PERIOD, present=3), MISSING),
        (instance.measured(4 * PERIOD, present=0), MISSING),
        (instance.measured(4 * PERIOD), TIME_BACK),
        (instance.measured(-1.0), TIME_BACK),
    ]
    longer = instance.measured(5 * PERIOD)
    longer.numbers[3] = 1.1
    for measured, status in [*wrong, (longer, NO_ATTITUDE)]:
        assert instance.step(measured) == status
        assert instance.neutral
    assert instance.step(instance.measured(6 * PERIOD)) == OK
    assert not instance.neutral


@pytest.mark.slow
def test_a_path_begins_at_the_first_command_whatever_the_clock(tmp_path):
    """A vehicle's clock does not begin at zero: the reference would be at its end, and the command at its limit."""
    write_library(scenario("gsta", {"controller.period": 0.01}, "follow_path"), tmp_path, ["x86_64"], test=False)
    (tmp_path / "test.c").write_text(CLOCK)
    program = linking.program(MACHINES["x86_64"], tmp_path / "x86_64/libgsta.a", tmp_path / "test.c", tmp_path)
    subprocess.run([program], check=True)


CLOCK = """
#include "gsta.h"
int main(void)
{
    static gsta laws[2];
    gsta_command commands[2];
    int i, k;
    for (i = 0; i < 2; i++)
        gsta_init(&laws[i]);
    for (k = 0; k < 300; k++)
        for (i = 0; i < 2; i++) {
            gsta_measured measured = {0};
            measured.t = k / 128.0 + i * 65536.0;
            measured.quat_WB[0] = 1.0;
            measured.present = GSTA_NEEDED;
            if (gsta_step(&laws[i], &measured, &commands[i]) != GSTA_OK)
                return 2;
        }
    for (k = 0; k < 6; k++)
        if (commands[0].tau_cmd[k] != commands[1].tau_cmd[k])
            return 1;
    return commands[0].tau_cmd[0] == 0.0;
}
"""


def test_late_calls_are_named_and_a_long_gap_is_neutral_once(instance):
    assert instance.init() == OK
    assert instance.step(instance.measured(0.0)) == OK
    assert instance.step(instance.measured(1.4 * PERIOD)) == OK
    assert instance.step(instance.measured(3.0 * PERIOD)) == LATE
    assert not instance.neutral
    assert instance.step(instance.measured(20.0 * PERIOD)) == GAP
    assert instance.neutral
    assert instance.step(instance.measured(21.0 * PERIOD)) == OK
    assert instance.library.gsta_reset(instance.memory) == OK
    assert instance.step(instance.measured(0.0)) == OK  # time begins anew


def test_a_command_out_of_bounds_stays_neutral_until_a_reset(instance):
    """A finite position of 1e200 m makes the command too large."""
    assert instance.init() == OK
    assert instance.step(instance.measured(0.0, x=1e200)) == FAULT
    assert instance.neutral
    assert instance.step(instance.measured(PERIOD)) == FAULT
    assert instance.library.gsta_reset(instance.memory) == OK
    assert instance.step(instance.measured(0.0)) == OK


@pytest.mark.parametrize("mode", [0x400, 0x800, 0xC00], ids=["down", "up", "to zero"])
def test_a_processor_that_rounds_in_another_way_is_refused(instance, mode):
    """The modes of fenv.h on x86-64; there are no other bits where a law has begun."""
    c = ctypes.CDLL(None)
    try:
        assert c.fesetround(mode) == 0
        status = instance.init()
    finally:
        c.fesetround(0)
    assert status == STATUSES["OTHER_ARITHMETIC"][0]
    assert instance.step(instance.measured(0.0)) == NOT_BEGUN
    assert instance.init() == OK


def test_null_pointers_are_named(instance):
    library, layout = instance.library, ctypes.c_uint64(instance.layout)
    assert library.gsta_init_of(layout, None) == NULL
    assert instance.init() == OK
    assert library.gsta_step_of(layout, instance.memory, ctypes.byref(instance.measured(0.0)), None) == NULL
    assert (
        library.gsta_step_of(layout, None, ctypes.byref(instance.measured(0.0)), ctypes.byref(instance.command)) == NULL
    )
    assert library.gsta_step_of(layout, instance.memory, None, ctypes.byref(instance.command)) == NULL
    assert instance.neutral


def test_settings_change_and_survive_a_reset(instance):
    """The desired force is one of them: 5 N make another command, again after a reset."""
    kinds = ctypes.c_double * 15  # k_1, k_2, beta, K_f, F_d
    settings, layout = kinds(), ctypes.c_uint64(instance.layout)

    def second():
        assert instance.step(instance.measured(0.0)) == OK
        assert instance.step(instance.measured(PERIOD)) == OK
        return list(instance.command.numbers)

    assert instance.init() == OK
    assert instance.library.gsta_get(instance.memory, settings) == OK
    assert [settings[0], settings[9]] == [BUILT_IN["gsta"]().k_1, 0.0]
    first = second()
    settings[9] = -5.0
    for _ in range(2):
        assert instance.library.gsta_set_of(layout, instance.memory, settings) == OK
        assert instance.library.gsta_reset(instance.memory) == OK
        assert second() != first
    settings[0] = float("nan")
    assert instance.library.gsta_set_of(layout, instance.memory, settings) == NOT_FINITE
    assert instance.init() == OK
    assert second() == first


def test_two_instances_do_not_know_each_other(gsta, instance):
    other = Instance(gsta[0])
    alone = Instance(gsta[0])
    for each in (instance, other, alone):
        assert each.init() == OK
    for k in range(20):
        assert alone.step(alone.measured(k * PERIOD, x=1e-3 * k)) == OK
        assert other.step(other.measured(k * PERIOD, x=-2e-3 * k)) == OK
        assert instance.step(instance.measured(k * PERIOD, x=1e-3 * k)) == OK
        assert list(alone.command.numbers) == list(instance.command.numbers)
    assert list(other.command.numbers) != list(instance.command.numbers)


# laws, stages and scenarios


_IN_THE_SUITE = ("pulses", "observer", "small MPC")


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", [pytest.param(each, marks=[] if each in _IN_THE_SUITE else [pytest.mark.long]) for each in KINDS]
)
def test_stages_beside_the_law_leave_with_it(tmp_path, monkeypatch, kind):
    """With GSTA and a law in C, five laws on each emulated processor."""
    (law, settings), taken = KINDS[kind], texts_of(monkeypatch)
    library = write_library(scenario(law, settings), tmp_path, EMULATED or ["x86_64"])
    assert_no_pointer_is_in_memory(taken[0])
    for each in library.targets:
        assert each.equal == library.steps >= 1000
    header = (tmp_path / f"{library.name}.h").read_text()
    assert ("pwm[8]" in header) == (kind == "pulses")
    assert ("f_contact_m_W" in header) == (kind != "observer")


def test_an_export_of_a_law_in_c_has_no_address_of_this_process(tmp_path):
    """Two runs have two copies of the law's library, at two places."""
    (tmp_path / "my_law.c").write_text(MY_LAW)
    (tmp_path / "my_law.toml").write_text(MY_TOML)
    runs = [Simulation(scenario(str(tmp_path / "my_law.c")), engine="free_body") for _ in range(2)]
    places = [run.memory.stages.stages["controller"].library.address for run in runs]
    images = [Chain(run.memory).image.tobytes() for run in runs]
    assert places[0] != places[1]
    assert images[0] == images[1]


WHOLE = r"""
#include <stdio.h>
typedef unsigned long long whole;
static volatile double numbers[] = {0.0, 0.5, 1.0, 1.9, 4294967295.5, 4294967296.0, 9007199254740993.0, 1.8e19, 9.2e18,
                                    1e-300};
static volatile whole wholes[] = {1, 3, 10, 0, 4294967295u, 4294967296u, 9007199254740993u, 18446744073709551615u,
                                  18446744073709550592u, 9223372036854775808u, 12345678901234567u};
static void show(whole x)
{
    char text[18] = "                 ";
    int i;
    for (i = 0; i < 16; i++)
        text[i] = "0123456789abcdef"[x >> (60 - 4 * i) & 15];
    printf("%s", text);
}
static void show_double(double x)
{
    union { double x; whole bits; } both;
    both.x = x;
    show(both.bits);
}
int main(void)
{
    unsigned i, j;
    for (i = 0; i < 10; i++) {
        show((whole)numbers[i]);
        if (numbers[i] < 9.3e18) {
            show((whole)(long long)numbers[i]);
            show((whole)(long long)-numbers[i]);
        }
    }
    for (i = 0; i < 11; i++) {
        show_double((double)wholes[i]);
        show_double((double)(long long)wholes[i]);
        for (j = 0; j < 11; j++)
            if (wholes[j]) {
                show(wholes[i] / wholes[j]);
                show(wholes[i] % wholes[j]);
                if ((long long)wholes[j] != -1) {
                    show((whole)((long long)wholes[i] / (long long)wholes[j]));
                    show((whole)((long long)wholes[i] % (long long)wholes[j]));
                }
            }
    }
    return 0;
}
"""


@pytest.mark.parametrize("target", ["armv7", "thumbv7em"])
def test_whole_numbers_of_64_bits_are_those_of_a_processor_that_has_them(tmp_path, target):
    """Division and conversion, signed and unsigned, at the edges: what ARM with 32 bits calls functions for."""
    if not (runs_here(target) and runs_here("x86_64")):
        pytest.skip(f"no emulator of {target}: {QEMU}")
    (tmp_path / "whole.c").write_text(WHOLE)
    (tmp_path / "nothing.c").write_text("int nothing;")
    said = []
    for each in (target, "x86_64"):
        machine, place = MACHINES[each], tmp_path / each
        place.mkdir()
        linking.own_c(machine, tmp_path / "nothing.c", place)
        linking.run([*linking.zig(), "ar", "rcs", "nothing.a", "nothing.o"], place)
        program = linking.program(machine, place / "nothing.a", tmp_path / "whole.c", place)
        said.append(subprocess.run([*linking.emulator(machine), program], capture_output=True, check=True).stdout)
    assert len(said[0]) > 5000
    assert said[0] == said[1]


_TWO = ("pow", "hypot", "fmod", "atan2")


@pytest.mark.slow
def test_a_law_in_c_has_the_functions_of_this_project_on_each_processor(tmp_path):
    """All of them, of numbers in and out of their domains: where one is not finite, it counts as zero. A compiler may
    not put a root in place of a power, or a constant in place of a function."""
    assert set(_TWO) < set(libm.FUNCTIONS)
    calls = [f"{each}(x, 0.5 + i)" if each in _TWO else f"{each}(x)" for each in libm.FUNCTIONS]
    calls += ["pow(fabs(x), 0.5)", "exp(1.0) * x", "pow(2.0, x)"]
    law = MY_LAW.replace("#include", "static double or_zero(double y) { return y - y == 0.0 ? y : 0.0; }\n#include", 1)
    sums = "\n".join(f"        sum += or_zero({each});" for each in calls)
    body = "        double x = 1.7 * sin(3.0 * signals->t + i), sum = 0.0;\n" + sums
    law = law.replace("    for (int i = 0; i < 6; i++) {", f"    for (int i = 0; i < 6; i++) {{\n{body}")
    (tmp_path / "my_law.c").write_text(law.replace("tau_cmd[i] = ", "tau_cmd[i] = 1e-3 * sum + "))
    (tmp_path / "my_law.toml").write_text(MY_TOML)
    library = write_library(scenario(str(tmp_path / "my_law.c"), SOFT), tmp_path / "out", EMULATED or ["x86_64"])
    assert [each.equal for each in library.targets] == [library.steps] * len(library.targets)
    assert library.steps >= 1000
    assert library.name == "my_law"


@pytest.mark.slow
def test_a_law_in_c_is_twice_in_one_program(tmp_path):
    """With a function of its own that the program has by the same name, a table that others see, and exp."""
    if shutil.which("gcc") is None or not runs_here("x86_64"):
        pytest.skip("no gcc for x86_64 here")
    above = (
        "const double table[2] = {1.0, 0.5};\ndouble clamp(double x) { return x > 9.0 ? 9.0 : exp(-x) * table[0]; }\n"
    )
    law = MY_LAW.replace("int my_law", f"{above}int my_law").replace("tau_cmd[i] =", "tau_cmd[i] = clamp(signals->t) *")
    (tmp_path / "my_law.c").write_text(law)
    (tmp_path / "my_law.toml").write_text(MY_TOML)
    names = ("left", "right")
    for name in names:
        made = write_library(scenario(str(tmp_path / "my_law.c"), SOFT), tmp_path / "out", ["x86_64"], f"{name}_law")
        assert made.targets[0].equal == made.steps
    calls = "".join(f"static {each}_law {each};\n" for each in names)
    began = " + ".join(f"{each}_law_init(&{each})" for each in names)
    source = "".join(f'#include "{each}_law.h"\n' for each in names) + calls
    source += "double clamp(void);\ndouble clamp(void) { return 0.0; }\n"
    (tmp_path / "out/both.c").write_text(f"{source}int main(void) {{ return {began} + (int)clamp(); }}\n")
    libraries = [f"x86_64/lib{each}_law.a" for each in names]
    subprocess.run(["gcc", "both.c", *libraries, "-o", "both", "-std=c99", *WARNINGS], cwd=tmp_path / "out", check=True)
    subprocess.run([tmp_path / "out/both"], check=True)


@pytest.mark.slow
def test_a_law_in_c_leaves_for_a_vehicle_with_joints(tmp_path):
    """The chain on this processor, which calls the law's own function, gives its commands here. The bits are not the
    run's, and no run takes the library."""
    (tmp_path / "my_law.c").write_text(MY_LAW)
    (tmp_path / "my_law.toml").write_text(MY_TOML)
    settings = SOFT | {"vehicle.model": "bluerov2_alpha5", "controller.period": 0.002}
    library = write_library(scenario(str(tmp_path / "my_law.c"), settings), tmp_path / "out", ["x86_64"])
    assert library.targets[0].equal in (None, library.steps)
    for words in ("with joints the library has the same bits", "can't take the library"):
        assert sum(words in note for note in library.notes) == 1
    law = f"{tmp_path}/out/x86_64/lib{library.name}.so:{library.name}_law"
    with pytest.raises(InputError, match=r"_law.toml: no law of a run: the vehicle has joints$"):
        scenario(law)


@pytest.mark.slow
def test_functions_of_the_targets_c_library_are_named(tmp_path):
    """Their last digits may be others there, so that the test does not run here."""
    (tmp_path / "my_law.c").write_text(MY_LAW.replace("tau_cmd[i] =", "tau_cmd[i] = expf(-signals->t) *"))
    (tmp_path / "my_law.toml").write_text(MY_TOML)
    library = write_library(scenario(str(tmp_path / "my_law.c"), SOFT), tmp_path / "out", ["x86_64"])
    assert library.targets[0].foreign == ["expf"]
    assert library.targets[0].equal is None
    assert "takes expf from the program's C library" in (tmp_path / "out" / "README.md").read_text()


@pytest.mark.slow
def test_a_run_with_few_steps_is_named(tmp_path):
    library = write_library(scenario("gsta", SOFT | {"simulation.duration": 0.02}), tmp_path, ["x86_64"], test=False)
    assert library.steps == 200
    assert "its test has 200 recorded steps, of free motion: a longer simulation.duration gives more" in library.notes


@pytest.mark.slow
def test_what_a_library_has_not_is_said_once(tmp_path):
    """Sensors stay behind, and the estimate is the vehicle's."""
    sensed = write_library(scenario("gsta", SOFT | {"navigation.name": "sensors"}), tmp_path, ["x86_64"], test=False)
    (note,) = [each for each in sensed.notes if "navigation sensors" in each]
    assert "p_WB, quat_WB, nu must be the estimate of the vehicle's own filter" in note
    assert note.partition(": ")[2] in (tmp_path / "README.md").read_text()


@pytest.mark.slow
@pytest.mark.parametrize(("delay", "asked"), [(0.04, True), (0.03, False)])
def test_a_run_can_ask_a_law_with_a_delay_of_whole_periods(tmp_path, delay, asked):
    """Another delay has a period of its own, at which no law of a run is called; the export says so, and its program
    answers frames alone."""
    settings = SOFT | {"controller.period": 0.02, "controller.delay": delay}
    library = write_library(scenario("gsta", settings), tmp_path, ["x86_64"], test=False)
    loop = (tmp_path / "loop.c").read_text()
    assert ("measured.present = GSTA_NEEDED;" in loop, "measured.present = 0;" in loop) == (asked, not asked)
    assert ("controller.export=" in (tmp_path / "README.md").read_text()) == asked
    assert any("no whole number of control periods" in note for note in library.notes) != asked
    assert library.period == pytest.approx(0.02 if asked else 0.01)


@pytest.mark.slow
def test_the_caller_gives_the_reference(tmp_path):
    """The library has no guidance: its recorded steps have the reference of the run's."""
    library = write_library(scenario("gsta", SOFT), tmp_path, ["x86_64"], guided=False)
    assert library.targets[0].equal in (None, 1200)
    header = (tmp_path / "gsta.h").read_text()
    assert "double p_d_ddot[3];" in header
    assert "const gsta_reference *reference, gsta_command *command" in header
    assert library.targets[0].constants < 8000


@pytest.mark.long
def test_a_vehicle_with_joints_has_the_same_bits_everywhere(tmp_path):
    """The run rounds some products and sums once; the library does not, and is near it."""
    targets = ["x86_64", *(each for each in ("aarch64",) if runs_here(each))]
    library = write_library(scenario("impedance", {"simulation.duration": 0.2}, "tool_push"), tmp_path, targets)
    assert {each.equal for each in library.targets} <= {None, library.steps}
    assert "of the largest one" in (tmp_path / "README.md").read_text()
    assert "q_dot_m[" in (tmp_path / "impedance.h").read_text()


@pytest.mark.long
@pytest.mark.parametrize(
    "law", [each for each in BUILT_IN if not (BUILT_IN[each].external or BUILT_IN[each].uses_truth)]
)
def test_every_law_leaves(tmp_path, law):
    targets = [each for each in MACHINES if runs_here(each)]
    library = write_library(scenario(law, SOFT), tmp_path, targets)
    assert [each.equal for each in library.targets] == [library.steps] * len(targets)


@pytest.mark.slow
def test_the_library_is_a_law_again(gsta):
    """6 s of push_wall, 0.8 s in contact, with the library as the controller are those of the law, in all signals, bit
    for bit."""
    if not runs_here("x86_64"):
        pytest.skip("another processor")
    folder, _ = gsta
    settings = {"simulation.duration": 6.0}
    usual = simulate(scenario("gsta", settings), engine="free_body")
    again = simulate(scenario(f"{folder / 'x86_64' / 'libgsta.so'}:gsta_law", settings), engine="free_body")
    assert usual.push.max() > 0.2
    for name in usual:
        if name in again:
            assert np.array_equal(usual[name], again[name], equal_nan=True), name
    with pytest.raises(InputError, match=r"names no function; give .*libgsta.so:gsta_law$"):
        scenario(str(folder / "x86_64" / "libgsta.so"))
    beside = Scenario.load(folder / "scenario.toml", settings, f"{folder / 'x86_64' / 'libgsta.so'}:gsta_law")
    assert np.array_equal(simulate(beside, engine="free_body").tau_cmd, usual.tau_cmd)
    weaker = scenario(f"{folder / 'x86_64' / 'libgsta.so'}:gsta_law", settings | {"controller.k_1": 1.0})
    assert not np.array_equal(simulate(weaker, engine="free_body").tau_cmd, usual.tau_cmd)


# the processor in the loop

AT_THE_WALL = SOFT | {
    "simulation.duration": 2.0,
    "controller.period": 1e-3,
    "initial.position": [0.99, 0.0, 0.0],
    "reference.step_time": 0.1,
}


@pytest.fixture(scope="module")
def loops(tmp_path_factory):
    """GSTA at the wall for all processors with Linux, and the run."""
    folder = tmp_path_factory.mktemp("loop")
    targets = [target for target in MACHINES if MACHINES[target].shared]
    write_library(scenario("gsta", AT_THE_WALL), folder, targets, test=False)
    return folder, simulate(scenario("gsta", AT_THE_WALL), engine="free_body")


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def export_of(folder, name="gsta"):
    return tomllib.loads((folder / f"{name}.toml").read_text())["library"]["export"]


def program_of(folder, target, place):
    """The program loop.c for a target, and how it runs here."""
    machine = MACHINES[target]
    if not runs_here(target):
        pytest.skip(f"no emulator of {target}: {QEMU}")
    for each in (*folder.glob("*.h"), folder / "loop.c"):
        shutil.copy(each, place)
    archive = next((folder / target).glob("*.a"))
    return [*linking.emulator(machine), str(linking.program(machine, archive, place / "loop.c", place))]


@contextlib.contextmanager
def answering(command, port):
    """A program that answers on a port of this machine."""
    with subprocess.Popen([*command, str(port)], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def in_the_loop(port, settings, export=0):
    keys = AT_THE_WALL | {"controller.port": port, "controller.export": export, "controller.timeout": 5.0} | settings
    return simulate(scenario("udp", keys), engine="free_body")


@pytest.mark.parametrize("target", [target for target in MACHINES if MACHINES[target].shared])
def test_the_processor_in_the_loop_gives_the_run(loops, tmp_path, target):
    """2 s with the touch: all signals, bit for bit; a second run begins the law anew."""
    folder, ours = loops
    port = free_port()
    assert ours.push[0] == 0.0
    assert ours.push[-1] > 0.1
    with answering(program_of(folder, target, tmp_path), port):
        in_the_loop(port, {"simulation.duration": 0.3})
        theirs = in_the_loop(port, {}, export_of(folder))
    common = [name for name in ours if name in theirs]
    assert len(common) > 30
    for name in common:
        assert np.array_equal(ours[name], theirs[name], equal_nan=True), name


@pytest.mark.long
@pytest.mark.parametrize("period", [1e-3, 1e-4])
@pytest.mark.parametrize("target", ["aarch64", "armv7"])
def test_the_paper_with_the_processor_in_the_loop(tmp_path, target, period):
    """20 s of push_wall, at 1 and 10 kHz."""
    run, port, place = scenario("gsta", {"controller.period": period}), free_port(), tmp_path / "place"
    write_library(run, tmp_path, [target], test=False)
    place.mkdir()
    keys = {"controller.port": port, "controller.export": export_of(tmp_path)}
    with answering(program_of(tmp_path, target, place), port):
        theirs = simulate(run.updated(keys, controller="udp"), engine="free_body")
    ours = simulate(run, engine="free_body")
    common = [name for name in ours if name in theirs]
    assert len(common) > 30
    for name in common:
        assert np.array_equal(ours[name], theirs[name], equal_nan=True), name


@pytest.fixture(scope="module")
def native_loop(loops, tmp_path_factory):
    folder, _ = loops
    return program_of(folder, "x86_64", tmp_path_factory.mktemp("native"))


@pytest.mark.parametrize(
    ("settings", "off", "said"),
    [
        ({}, 2, r"controller.export: the law on UDP 127.0.0.1:\d+ is export \d+, and \d+ is asked for"),
        ({"controller.period": 1e-2}, 0, "status 1 at t = 0.01 s: .*controller.period must be the export's"),
        ({"controller.delay": 1e-3}, 0, r"N of thruster \d, and this run 0 N, in the period before t = 0.002 s"),
        ({"vehicle.model": "bluerov2_heavy"}, 0, "expects other signals or thrusters than this run has"),
        ({"reference.target": [0.995, 0.0, 0.0]}, 0, None),
    ],
    ids=["another export", "another period", "a delay", "another vehicle", "another reference, which is the library's"],
)
def test_a_run_that_the_export_is_not_for_ends_with_one_sentence(loops, native_loop, settings, off, said):
    """The reference of the run is not heard by a library that has its own."""
    folder, ours = loops
    port = free_port()
    with answering(native_loop, port):
        if said is None:
            assert np.array_equal(in_the_loop(port, settings).push, ours.push)
        else:
            with pytest.raises(InputError, match=said):
                in_the_loop(port, settings, export_of(folder) ^ off)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (b"", r"controller.export: the law on UDP 127.0.0.1:\d+ is no export, and 5 is asked for"),
        (struct.pack("<qQQ6d", 0, 5, LAYOUT + 1, *[0.0] * 6), "expects other signals or thrusters than this run has"),
        (struct.pack("<qQQ5d", 0, 5, LAYOUT, *[0.0] * 5), "expects other signals or thrusters than this run has"),
        (struct.pack("<qQQ6d", -9, 5, LAYOUT, *[0.0] * 6), "has status -9 at t = 0 s: a stage ended early"),
        (struct.pack("<qQQ6d", -99, 5, LAYOUT, *[0.0] * 6), "has status -99 at t = 0 s: an unknown status"),
        (struct.pack("<qQQ", 0, 5, LAYOUT), "80 bytes came, and an answer has 56"),
    ],
    ids=["none", "other signals", "fewer thrusters", "a fault", "an unknown status", "no thrusts"],
)
def test_what_an_export_says_of_itself_is_checked(more, said):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as law:
        law.bind(("127.0.0.1", 0))

        def reply():
            _, address = law.recvfrom(65536)
            law.sendto(struct.pack("<Q6d", 0, *[0.0] * 6) + more, address)

        threading.Thread(target=reply, daemon=True).start()
        with pytest.raises(InputError, match=said):
            in_the_loop(law.getsockname()[1], {"controller.timeout": 0.5}, 5)


@pytest.mark.slow
def test_the_number_of_an_export_is_that_of_its_law(loops, tmp_path):
    """It does not depend on the target, and a gain or the reference changes it."""
    folder, _ = loops
    numbers = []
    for k, changed in enumerate(({}, {"controller.k_1": 5.5}, {"reference.bandwidth": 2.1})):
        write_library(scenario("gsta", AT_THE_WALL | changed), tmp_path / str(k), ["x86_64"], test=False)
        numbers.append(export_of(tmp_path / str(k)))
    assert numbers[0] == export_of(folder)
    assert len(set(numbers)) == 3


class Asking:
    """A run that asks a program for the commands of instants, without a plant."""

    def __init__(self, port):
        self.peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.peer.connect(("127.0.0.1", port))
        self.peer.settimeout(0.2)
        self.record = np.zeros(1, SIGNALS)
        self.record["quat_WB"] = [1.0, 0.0, 0.0, 0.0]

    def send(self, instant, more=b""):
        self.record["t"] = 1e-3 * instant
        self.peer.send(MAGIC + struct.pack("<Q", instant) + self.record.tobytes() + more)

    def asked(self, instant, more=b""):
        """The answer: instant, tau_cmd, status and thrusts; None without one."""
        try:
            self.send(instant, more)
            data = self.peer.recv(4096)
        except (TimeoutError, ConnectionRefusedError):
            return None
        instant, *tau_cmd, status, _, _ = struct.unpack_from("<Q6dqQQ", data)
        return instant, tau_cmd, status, np.frombuffer(data, "<f8", offset=80)

    def begin(self):
        until = time.monotonic() + 10.0
        while (found := self.asked(0)) is None:  # until it listens
            assert time.monotonic() < until
        return found


def test_misuse_of_the_program_gives_a_neutral_command_and_says_why(native_loop):
    port = free_port()
    with answering(native_loop, port):
        run, late = Asking(port), Asking(port)
        while (found := run.asked(7)) is None:
            pass
        assert found[2] == STATUSES["NOT_BEGUN"][0]  # a program that was restarted during a run
        assert found[1] == [0.0] * 6
        assert run.begin()[2] == 0
        first = run.asked(1)
        assert np.any(first[3] != 0.0)
        assert all(np.array_equal(*pair) for pair in zip(first, run.asked(1), strict=True))  # asked again
        assert late.asked(3) is None  # of an older run
        assert run.asked(2, b"more") is None
        run.record["nu"] = np.nan
        _, tau_cmd, status, thrusts = run.asked(2)
        assert status == STATUSES["NOT_FINITE"][0]
        assert tau_cmd == [0.0] * 6
        assert not thrusts.any()
        run.record["nu"] = 0.0
        assert run.asked(3)[2] == 0
        run.record["F_d"] = np.inf
        assert run.asked(4)[2] == STATUSES["NOT_FINITE"][0]
        run.record["F_d"] = 0.0
        assert run.asked(3)[2] == STATUSES["TIME_BACK"][0]
        assert late.begin()[2] == 0  # a run that begins replaces the other one
        assert run.asked(5) is None


def test_the_program_listens_on_this_machine_alone_and_names_a_wrong_port(native_loop):
    port = free_port()
    with answering(native_loop, port):
        Asking(port).begin()
        table = Path("/proc/net/udp").read_text()
        assert f"0100007F:{port:04X}" in table
        assert f"00000000:{port:04X}" not in table
        for text in (str(port), "0", "65536", "99999999999999999999", "-1", "a", ""):
            done = subprocess.run([*native_loop, text], capture_output=True, text=True, timeout=10.0)
            assert done.returncode == 2
            assert "is not free" in done.stdout if text == str(port) else "1 to 65535" in done.stdout


@pytest.mark.slow
def test_the_program_compiles_without_a_warning(loops, tmp_path):
    folder, _ = loops
    for target in MACHINES:
        if not MACHINES[target].shared:
            continue
        zig = [each for each in MACHINES[target].zig if each != "-fPIC"]
        options = [*zig, "-std=c99", *WARNINGS, "-I", str(folder), "-c", str(folder / "loop.c"), "-o", "loop.o"]
        done = subprocess.run([*linking.zig(), "cc", *options], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:gsta oscillates")
@pytest.mark.parametrize(("kind", "guided"), [("observer", True), ("pulses", False)])
def test_other_laws_run_in_the_loop(tmp_path, kind, guided):
    """Pulses at 50 Hz, an observer, and a reference that the run gives."""
    law, settings = KINDS[kind]
    run = scenario(law, AT_THE_WALL | {"controller.period": 0.02} | settings)
    write_library(run, tmp_path, ["x86_64"], "shown", guided, test=False)
    place, port = tmp_path / "place", free_port()
    place.mkdir()
    with answering(program_of(tmp_path, "x86_64", place), port):
        keys = {"controller.port": port, "controller.export": export_of(tmp_path, "shown")}
        theirs = simulate(run.updated(keys, controller="udp"), engine="free_body")
    ours = simulate(run, engine="free_body")
    for name in ours:
        if name in theirs:
            assert np.array_equal(ours[name], theirs[name], equal_nan=True), name


def dockerfile():
    """The instructions of the example, each with what follows it."""
    text = (EXAMPLES / "blueos.Dockerfile").read_text()
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return text, [tuple(line.split(" ", 1)) for line in "\n".join(lines).replace("\\\n", "").splitlines()]


def test_the_labels_of_the_extension_are_those_of_blueos():
    text, instructions = dockerfile()
    labels = dict(rest.split("=", 1) for word, rest in instructions if word == "LABEL")
    assert set(labels) == {
        "version", "permissions", "authors", "company", "readme", "links", "type", "tags", "requirements"
    }  # fmt: skip
    for key in ("permissions", "authors", "company", "links", "tags"):
        assert labels[key][0] == labels[key][-1] == "'"
        labels[key] = json.loads(labels[key][1:-1])
    assert labels["permissions"] == {"HostConfig": {"NetworkMode": "host"}}  # 127.0.0.1 is the vehicle's computer
    assert all(set(each) == {"name", "email"} for each in labels["authors"])
    assert re.fullmatch(r'"\d+\.\d+\.\d+"', labels["version"])
    assert "--platform linux/arm/v7,linux/arm64 " in text
    assert instructions[0] == ("ARG", "BASE=scratch")  # before the first FROM, so that each FROM sees it
    stages = [rest for word, rest in instructions if word == "FROM"]
    assert stages == ["alpine:3.20 AS build", "python:3.12-alpine AS gate", "${BASE}"]
    words = {word for word, _ in instructions}
    assert words <= {"ARG", "FROM", "RUN", "COPY", "WORKDIR", "LABEL", "USER", "ENTRYPOINT"}
    assert not [word for word, _ in instructions if word == "EXPOSE"]
    entry = json.loads(next(rest for word, rest in instructions if word == "ENTRYPOINT"))
    assert entry == ["/loop", str(PORT)]


@pytest.mark.parametrize(
    ("arch", "variant", "target"),
    [("arm", "v7", "armv7"), ("arm64", "", "aarch64"), ("arm64", "v8", "aarch64"), ("amd64", "", "x86_64"),
     ("arm", "v6", None), ("riscv64", "", None)],
)  # fmt: skip
def test_the_extension_is_made_of_the_library_of_its_platform(loops, tmp_path, arch, variant, target):
    """With a compiler that writes down what it is told, and a test that ends with a status of ours."""
    folder, _ = loops
    command = next(rest for word, rest in dockerfile()[1] if word == "RUN" and "test.c" in rest)
    tools = tmp_path / "tools"
    tools.mkdir()
    (tools / "cc").write_text(
        '#!/bin/sh\necho "$@" >> said\nprintf "#!/bin/sh\\nexit $STATUS\\n" > test\nchmod +x test\ntouch loop\n'
    )
    (tools / "cc").chmod(0o755)

    for name in ("LICENSE", "gsta.toml"):
        (tmp_path / name).write_text("")

    def made(status):
        (tmp_path / "said").unlink(missing_ok=True)
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        env = {"PATH": f"{tools}:/usr/bin:/bin", "TARGETARCH": arch, "TARGETVARIANT": variant, "NAME": "gsta"}
        env["STATUS"] = str(status)
        done = subprocess.run(["sh", "-c", command], cwd=tmp_path, env=env, capture_output=True, text=True)
        told = (tmp_path / "said").read_text().splitlines() if (tmp_path / "said").exists() else []
        return done.returncode, told, done.stdout

    code, told, said = made(0)
    if target is None:
        assert (code, told, said) == (1, [], f"no library for {arch} {variant}\n")
        return
    library = f"{target}/libgsta.a"
    assert (folder / library).is_file()
    assert (code, told) == (0, [f"-std=c99 test.c {library} -o test", f"-std=c99 -static loop.c {library} -o loop"])
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"loop", "LICENSE", "gsta.toml"}
    (tmp_path / "ardusub_sender.py").write_text("")
    assert made(0)[0] == 0
    assert (tmp_path / "out" / "ardusub_sender.py").is_file()
    code, told, _ = made(1)
    assert (code, len(told)) == (1, 1)  # no program where a step differs
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_extensions_programs_are_made_by_a_compiler_of_this_machine(gsta, tmp_path):
    """The instruction of the Dockerfile as it is, in a copy of an export with its recorded steps."""
    if shutil.which("gcc") is None or not runs_here("x86_64"):
        pytest.skip("no gcc for x86_64 here")
    shutil.copytree(gsta[0], tmp_path, dirs_exist_ok=True)
    command = next(rest for word, rest in dockerfile()[1] if word == "RUN" and "test.c" in rest)
    env = {"PATH": "/usr/bin:/bin", "TARGETARCH": "amd64", "TARGETVARIANT": "", "NAME": "gsta"}
    done = subprocess.run(["sh", "-c", command], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "1200 of 1200 steps equal" in done.stdout
    done = subprocess.run([tmp_path / "out" / "loop", "none"], capture_output=True, text=True)
    assert done.returncode == 2
    assert "loop [PORT]" in done.stdout


def test_the_reference_has_all_statuses():
    """With their numbers and words, which the header has, too."""
    page = (Path(__file__).parents[2] / "docs" / "reference" / "law_library.md").read_text()
    for word, (number, said) in STATUSES.items():
        assert f"| `{word}` | {number} | {said} |" in page


# refusals


@pytest.mark.parametrize(
    ("law", "settings", "said"),
    [
        ("ideal", {}, "controller.name: ideal is given the truth"),
        ("external", {}, "controller.name: external: there is nothing to export"),
        ("gsta", {"actuation.name": "external"}, "actuation.name: external: there is nothing to export"),
    ],
)
def test_what_can_not_leave_is_refused_by_name(tmp_path, law, settings, said):
    with pytest.raises(InputError) as refused:
        write_library(scenario(law, settings), tmp_path, ["x86_64"])
    assert said in str(refused.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (
            "static double sum[2], one = 1.0; tau_cmd[0] += (sum[0] += 1.0) + (one *= 0.5) + (all_see[0] += 1.0);",
            "it keeps all_see, one, sum beside an instance; put numbers that last into its state",
        ),
        (
            'tau_cmd[0] += 1e-9 * rand(); printf("%g\\n", signals->t);',
            "it calls printf, rand; a library takes functions of math.h and string.h alone",
        ),
    ],
)
def test_a_law_in_c_that_keeps_numbers_or_asks_a_system_is_refused(tmp_path, body, said):
    """An instance is all of its memory, so that several run in several threads, and a reset begins anew."""
    law = MY_LAW.replace("    return 0;", f"    {body}\n    return 0;")
    above = "#include <stdio.h>\n#include <stdlib.h>\n" + ("double all_see[2];\n" if "all_see" in body else "")
    (tmp_path / "my_law.c").write_text(above + law)
    (tmp_path / "my_law.toml").write_text(MY_TOML)
    with pytest.raises(InputError) as refused:
        write_library(scenario(str(tmp_path / "my_law.c"), SOFT), tmp_path / "out", ["x86_64"])
    assert f"controller.name: my_law.c: {said}" in str(refused.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("target", MACHINES)
def test_constant_tables_of_a_law_in_c_are_nothing_that_it_keeps(tmp_path, target):
    """Where addresses are written when a program is loaded, a table of functions is in memory that is changed then."""
    (tmp_path / "table.c").write_text(
        "static double a(double x) { return x; }\nstatic double b(double x) { return -x; }\n"
        "static double (*const table[])(double) = {a, b};\nstatic const double weights[] = {1.0, 2.0};\n"
        "double law(int i, double x) { return table[i & 1](x) * weights[i & 1]; }\n"
    )
    code = (tmp_path / linking.compiled_c(MACHINES[target], "table.c", tmp_path)).read_bytes()
    assert elf_object.kept_apart(code) == []
    assert elf_object.sizes(code)[1] + elf_object.sizes(code)[2] >= 16


def test_a_law_that_runs_as_plain_python_is_refused_with_the_reason(tmp_path):
    (tmp_path / "plain.py").write_text(PLAIN)
    with pytest.raises(InputError, match=r"runs as plain Python, which no library takes: .*str"):
        write_library(scenario(f"{tmp_path / 'plain.py'}:Plain"), tmp_path / "out", ["x86_64"])


def test_machine_code_of_another_one_is_refused(gsta, tmp_path):
    law = f"{gsta[0] / 'x86_64' / 'libgsta.so'}:gsta_law"
    with pytest.raises(InputError, match="is machine code for this machine alone; export it from its source"):
        write_library(scenario(law), tmp_path, ["x86_64"])


def test_a_further_export_translates_and_compiles_nothing_and_gives_the_same_files(gsta, tmp_path, monkeypatch):
    folder, _ = gsta

    def never(*arguments, **options):
        raise AssertionError("made again")

    monkeypatch.setattr(linking, "compiled_c", never)
    monkeypatch.setattr(linking, "_emitted", never)
    monkeypatch.setattr(Chain, "_translated", never)
    write_library(scenario("gsta"), tmp_path, [*MACHINES])
    files = sorted(each.relative_to(folder) for each in folder.rglob("*") if each.is_file())
    assert files == sorted(each.relative_to(tmp_path) for each in tmp_path.rglob("*") if each.is_file())
    assert all((folder / each).read_bytes() == (tmp_path / each).read_bytes() for each in files)
    with pytest.raises(AssertionError, match="made again"):
        write_library(scenario("sta"), tmp_path, ["x86_64"])


@pytest.mark.parametrize("suffix", ["py", "c"])
def test_a_law_that_reads_another_file_leaves_with_what_the_file_has_now(tmp_path, monkeypatch, suffix):
    """A number in a module or in a header beside the law is in no text of the law itself."""
    beside = tmp_path / ("weight_of_law.py" if suffix == "py" else "weight.h")
    if suffix == "py":
        monkeypatch.syspath_prepend(tmp_path)
        law = READS_A_MODULE
    else:
        (tmp_path / "reads.toml").write_text(MY_TOML)
        law = '#include "weight.h"\n' + MY_LAW.replace("my_law", "reads").replace("100.0 *", "WEIGHT *")
    path = tmp_path / f"reads.{suffix}"
    path.write_text(law)
    codes, numbers = [], []
    for weight in ("100.0", "101.0", "100.0"):
        beside.write_text(f"WEIGHT = {weight}\n" if suffix == "py" else f"#define WEIGHT {weight}\n")
        sys.modules.pop("weight_of_law", None)
        importlib.invalidate_caches()
        sys.dont_write_bytecode, before = True, sys.dont_write_bytecode
        label = f"{path}:Reads" if suffix == "py" else str(path)
        made = write_library(scenario(label, SOFT), tmp_path / "out", ["x86_64"], "reads")
        sys.dont_write_bytecode = before
        assert made.targets[0].equal == made.steps
        codes.append((tmp_path / "out/x86_64/libreads.a").read_bytes())
        numbers.append(export_of(tmp_path / "out", "reads"))
    assert codes[0] == codes[2] != codes[1]
    assert numbers[0] == numbers[2] != numbers[1]


def test_without_ziglang_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ziglang", None)
    monkeypatch.setattr(linking.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'uvms-mj\[c\]'"):
        write_library(scenario("gsta"), tmp_path, ["x86_64"])


NAMED = """
from dataclasses import dataclass
from uvms_mj import Controller, gain
@dataclass(frozen=True)
class Law(Controller):
    int: float = gain(200.0, "N/m, N m", "*/ stiffness")
    private: float = gain(150.0, "N s/m, N m s", "damping")
    K_f: float = gain(1.0, "1", "part of the weight")
    \u03bb: float = gain(0.0, "1", "nothing")
    uses_task = False
    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        for i in range(6):
            pd = gains.int * signals.eta_e[i] + gains.private * signals.nu_e[i]
            tau_cmd[i] = gains.K_f * signals.g_hat[i] - pd + gains.\u03bb
"""


def test_names_that_c_or_the_library_has_are_changed(tmp_path, monkeypatch):
    """A class Law with gains that are words of C and C++ or names of signals; beside it a file that hides a module of
    Python's from a process that looks into its working folder."""
    (tmp_path / "mine.py").write_text(NAMED, encoding="utf-8")
    (tmp_path / "keyword.py").write_text("raise SystemExit(3)\n")
    monkeypatch.chdir(tmp_path)
    short = {"simulation.duration": 0.5, "controller.period": 0.01}
    library = write_library(scenario("mine.py:Law", short), tmp_path / "out", ["x86_64"])
    assert library.name == "law_controller"
    header = (tmp_path / "out/law_controller.h").read_text(encoding="utf-8")
    for field in ("double int_;", "double private_;", "double K_f_;", "double u3bb;", "double K_f[6];"):
        assert field in header
    ours, theirs = (
        simulate(scenario(law, short | {f"controller.{word}": 0.9}))
        for law, word in (("mine.py:Law", "K_f"), ("out/x86_64/liblaw_controller.so:law_controller_law", "K_f_"))
    )
    np.testing.assert_array_equal(theirs.tau, ours.tau)


@pytest.mark.parametrize(
    ("label", "name"),
    [
        ("Image", "image_controller"),
        ("law_pd", "law_pd"),
        ("3d", "controller_3d"),
        ("a-b \u00fc", "a_b"),
        ("-", "controller_"),
    ],
)
def test_the_default_name_of_a_library_is_free(monkeypatch, label, name):
    law = scenario("gsta")
    monkeypatch.setattr(type(law.controller), "label", classmethod(lambda cls: f"x.py:{label}"))
    assert name_of(law) == name


def test_a_name_is_put_into_a_text_once():
    assert texts.named('#include "law.h"\nlaw_x LAW_Y LAW ADAPTER', "law_a") == (
        '#include "law_a.h"\nlaw_a_x LAW_A_Y law_a law_a_law'
    )


def test_the_warnings_of_the_run_come_with_the_library(tmp_path):
    """A loop that a run warns of leaves, and the export says so, too."""
    wild = scenario("gsta", HEAVY | {"simulation.duration": 0.1})
    old = tmp_path / "armv7/libgsta.a"
    old.parent.mkdir()
    old.touch()
    assert any("oscillates" in note for note in write_library(wild, tmp_path, ["x86_64"], test=False).notes)
    assert not old.exists()  # it would be another law than the header's


def test_functions_that_round_to_whole_numbers_are_exact():
    """A processor without instructions for them has these: the same bits for edges, halves and numbers of all sizes."""
    from llvmlite import binding as llvm

    rng = np.random.default_rng(0)
    edges = [0.0, -0.0, 0.5, -0.5, 1.5, -1.5, 2.5, 2.0**52, 2.0**52 + 1, 2.0**51 + 0.5, np.inf, -np.inf, np.nan, 5e-324]
    values = np.array([*edges, *rng.normal(size=500), *(rng.normal(size=500) * 2.0 ** rng.integers(-60, 70, 500))])
    text = "\n".join(
        f"declare double @llvm.{name}.f64(double)\ndefine double @its_{name}(double %x) {{\n"
        f"%r = call double @llvm.{name}.f64(double %x)\nret double %r\n}}"
        for name in ("floor", "ceil", "trunc", "rint")
    )
    module = llvm.parse_assembly(linking.without_rounding(text))
    assert "llvm.floor" not in str(module)
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    with llvm.create_mcjit_compiler(module, machine) as engine:
        engine.finalize_object()
        for name in ("floor", "ceil", "trunc", "rint"):
            function = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(engine.get_function_address(f"its_{name}"))
            found = np.array([function(x) for x in values])
            wanted = getattr(np, name)(values)
            assert np.array_equal(found.view("u8")[~np.isnan(values)], wanted.view("u8")[~np.isnan(values)]), name


def test_a_file_in_the_place_of_the_folder_is_named(tmp_path):
    (tmp_path / "taken").write_text("mine")
    done = CliRunner().invoke(main, ["export", "law", "gsta", "--out", str(tmp_path / "taken"), "--force"])
    assert done.exit_code != 0
    assert "taken: is a file; name a folder" in done.output
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.skipif(sys.platform != "linux", reason="a copy of the process is not sure to work")
@pytest.mark.parametrize(
    ("law", "settings", "rests", "touches"),
    [
        ("gsta", {}, False, True),
        ("impedance", {}, True, False),
        ("fosm", {}, False, True),  # with longer steps it does not come to the wall, and does not come to rest
        ("impedance", {"controller.period": 0.0123}, False, False),  # no multiple of longer steps
        ("impedance", {"wall.position": 0.99}, False, True),
    ],
)
def test_a_run_that_rests_apart_is_known_before_its_steps(law, settings, rests, touches):
    """What longer steps say is what all steps say, or nothing; and the run does not notice."""
    sim = Simulation(scenario(law, settings), engine="free_body", looks=False)
    sim.run(1, np.inf)
    before = sim.memory.image.saved()
    assert vectors._rests_apart(sim) is rests
    for name, now in sim.memory.image.saved().items():
        assert now.tobytes() == before[name].tobytes()
    row = sim.memory.run["row"]
    while row["first_contact"][0] < 0.0 and sim.steps < sim.scenario.steps:
        sim.run(5000, np.inf)
    assert bool(row["first_contact"][0] >= 0.0) is touches
