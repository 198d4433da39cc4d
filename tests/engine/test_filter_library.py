"""A law's library with the Kalman filter: equal bits on four processors, and what its sensors may lack."""

import contextlib
import ctypes
import re
import shutil
import socket
import struct
import subprocess
import time
import tomllib
import zlib
from pathlib import Path

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, simulate
from uvms_mj.engine import law_library
from uvms_mj.engine.law_library import linking
from uvms_mj.engine.law_library.border import PRESENT
from uvms_mj.engine.law_library.library import write_library
from uvms_mj.engine.law_library.linking import MACHINES
from uvms_mj.engine.udp import STATUSES

pytest.importorskip("ziglang")
FREESTANDING = Path(law_library.__file__).with_name("freestanding")
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]
H = 0.005
"""Period of the inertial unit, and of the library [s]; the law is called at every second sample."""
FILTERED = {
    "navigation.name": "ekf",
    "wall.stiffness": 2e3,
    "controller.period": 2 * H,
    "initial.position": [0.8, 0.0, 0.0],
    "reference.step_time": 0.1,
}
BIT = {group: 1 << k for k, group in enumerate(PRESENT)}
STATUS = {word: number for word, (number, _) in STATUSES.items()}
FIELDS = {
    "p_WB": 3, "quat_WB": 4, "v_WB": 3, "omega": 3, "interval": 1, "turn": 3, "push": 3,
    "v_dvl": 3, "z_WB": 1, "heading": 1, "p_fix": 3, "tau_contact_m_B": 6,
}  # fmt: skip
NUMBERS = sum(FIELDS.values())
COMMAND = {"tau_cmd": 6, "u_cmd": 6, "tau_hat": 6, "p_WB": 3, "quat_WB": 4, "nu": 6}


def runs_here(target):
    return linking.emulator(MACHINES[target]) is not None


@pytest.fixture(scope="module")
def filtered(tmp_path_factory):
    """GSTA at a soft wall with the filter, for all processors, and what was made."""
    folder = tmp_path_factory.mktemp("filtered")
    return folder, write_library(Scenario.load("push_wall", FILTERED, "gsta"), folder, [*MACHINES])


@pytest.mark.parametrize("target", MACHINES)
def test_the_recorded_steps_are_equal_on_each_processor(filtered, target):
    """From the samples of the sensors on, in free motion, at the touch and pressing."""
    folder, library = filtered
    made = next(each for each in library.targets if each.target == target)
    if not runs_here(target):
        pytest.skip(f"no qemu-{MACHINES[target].emulator}: apt-get install qemu-user")
    assert made.equal == library.steps == 1200
    assert library.period == H
    assert not made.foreign
    assert made.code < 28_000
    assert library.record < 20_000
    assert "free motion, touch, pressing" in (folder / "README.md").read_text()


def rows_of(folder, name="gsta"):
    """The recorded steps of the first segment: words of what is measured, and words of the command."""
    header, text = (folder / f"{name}.h").read_text(), (folder / "vectors.h").read_text()
    fields = re.search(rf"typedef struct {name}_measured {{(.*?)}}", header, re.DOTALL)[1]
    given = sum(int(n or 1) for n in re.findall(r"^ *(?:double|uint64_t) \w+(?:\[(\d+)\])?;", fields, re.MULTILINE))
    steps = int(re.search(r"\{\"free motion\", 0\.0, 0, 0, (\d+),", text)[1])
    text = text[text.index("rows[STEPS]") :]
    words = np.array([int(word, 16) for word in re.findall(r"0x([0-9a-f]+)u", text)], np.uint64)
    rows = words.reshape(-1, int(re.search(r"rows\[STEPS\]\[(\d+)\]", text)[1]))[:steps]
    return rows[:, :given], rows[:, given:]


def test_each_sensor_comes_at_its_own_rate_and_what_is_not_there_is_no_number(filtered):
    """What a library is given where a sensor has no sample is NaN, so that equal steps show that it is not read."""
    given, _ = rows_of(filtered[0])
    present, n = given[:, 1].astype(int), len(given)
    every = {"start": n, "inertial": 1, "dvl": 40, "depth": 40, "heading": 20, "position": 40}
    for group, steps in every.items():
        at = np.flatnonzero(present & BIT[group])
        first = 0 if group == "start" else steps
        assert at.tolist() == [*range(first, n, steps)], group
    numbers = given[:, 2:].view(float)
    at = np.cumsum([0, *FIELDS.values()])
    for name, group in {"turn": "inertial", "z_WB": "depth", "p_fix": "position", "quat_WB": "start"}.items():
        first = at[list(FIELDS).index(name)]
        assert np.array_equal(np.isnan(numbers[:, first]), (present & BIT[group]) == 0), name
    assert (present & BIT["force"] > 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("target", MACHINES)
@pytest.mark.parametrize(("language", "suffix"), [("c99", "c"), ("c++17", "cpp")])
def test_header_and_programs_compile_without_a_warning(filtered, tmp_path, target, language, suffix):
    folder, _ = filtered
    for name in ("gsta.h", "vectors.h"):
        shutil.copy(folder / name, tmp_path)
    files = ["test"] + (["loop"] if language == "c99" and MACHINES[target].shared else [])
    for name in files:
        shutil.copy(folder / f"{name}.c", tmp_path / f"{name}.{suffix}")
    zig = [each for each in MACHINES[target].zig if each != "-fPIC"]
    own = [] if MACHINES[target].shared else ["-ffreestanding", "-I", str(FREESTANDING)]
    tool = "cc" if language == "c99" else "c++"
    for name in files:
        options = [*zig, f"-std={language}", *WARNINGS, *own, "-c", f"{name}.{suffix}"]
        done = subprocess.run([*linking.zig(), tool, *options], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


class Measured(ctypes.Structure):
    _fields_ = [
        ("t", ctypes.c_double),
        ("present", ctypes.c_uint64),
        *((name, ctypes.c_double * n) for name, n in FIELDS.items()),
    ]


class Command(ctypes.Structure):
    _fields_ = [*((name, ctypes.c_double * n) for name, n in COMMAND.items()), ("saturated", ctypes.c_uint64)]


class Vehicle:
    """A vehicle that is level, turns and accelerates uniformly, and has exact sensors, with an instance of the library
    for this machine.

    Attributes:
        a: (3,) its acceleration in W [m/s^2].
    """

    def __init__(self, folder):
        self.library = ctypes.CDLL(str(folder / "x86_64" / "libgsta.so"))
        self.layout = ctypes.c_uint64(int(tomllib.loads((folder / "gsta.toml").read_text())["library"]["layout"], 16))
        self.library.gsta_bytes.restype = ctypes.c_uint64
        self.memory = ctypes.create_string_buffer(self.library.gsta_bytes())
        self.command, self.a = Command(), np.zeros(3)
        self.init()

    def init(self):
        assert self.library.gsta_init_of(self.layout, self.memory) == STATUS["OK"]

    def measured(self, t, *groups, interval=H, **fields):
        """The samples of groups at a time; the others, and what a test does not give, are no numbers."""
        g = np.array([0.0, 0.0, -9.81])
        exact = {
            "start": {"p_WB": np.zeros(3), "quat_WB": [1.0, 0.0, 0.0, 0.0], "v_WB": np.zeros(3), "omega": np.zeros(3)},
            "inertial": {"interval": [interval], "turn": np.zeros(3), "push": interval * (self.a - g)},
            "dvl": {"v_dvl": t * self.a},
            "depth": {"z_WB": [0.5 * t * t * self.a[2]]},
            "heading": {"heading": [0.0]},
            "position": {"p_fix": 0.5 * t * t * self.a},
            "force": {"tau_contact_m_B": np.zeros(6)},
        }
        found = Measured(t, sum(BIT[group] for group in ("force", *groups)))
        for name, n in FIELDS.items():
            setattr(found, name, (ctypes.c_double * n)(*[np.nan] * n))
        for group in ("force", *groups):
            for name, values in (exact[group] | {k: v for k, v in fields.items() if k in exact[group]}).items():
                setattr(found, name, (ctypes.c_double * FIELDS[name])(*values))
        return found

    def step(self, *arguments, **more):
        """The status of a step, whose command was something else before."""
        measured = arguments[0] if isinstance(arguments[0], Measured) else self.measured(*arguments, **more)
        ctypes.memset(ctypes.byref(self.command), 0x55, ctypes.sizeof(self.command))
        return self.library.gsta_step_of(self.layout, self.memory, ctypes.byref(measured), ctypes.byref(self.command))

    def begin(self, until=0):
        """The first estimate, and so many samples of the inertial unit."""
        assert self.step(0.0, "start") == STATUS["OK"]
        for k in range(1, until + 1):
            assert self.step(k * H, "inertial") == STATUS["OK"]

    @property
    def words(self):
        return bytes(self.command)

    @property
    def neutral(self):
        return not any(self.words)


@pytest.fixture
def vehicle(filtered):
    if not runs_here("x86_64"):
        pytest.skip("another processor")
    return Vehicle(filtered[0])


def test_without_a_first_estimate_a_step_is_neutral(vehicle):
    """Before it, and after a reset, whatever else is measured."""
    for t in (0.0, H):
        assert vehicle.step(t, "inertial", "dvl", "depth", "heading", "position") == STATUS["MISSING"]
        assert vehicle.neutral
    assert vehicle.step(2 * H, "start") == STATUS["OK"]
    assert not vehicle.neutral
    assert vehicle.step(3 * H, "inertial") == STATUS["OK"]
    assert vehicle.library.gsta_reset(vehicle.memory) == STATUS["OK"]
    assert vehicle.step(0.0, "inertial") == STATUS["MISSING"]
    assert vehicle.step(H, "start") == STATUS["OK"]


@pytest.mark.parametrize("every", [1, 2, 5])
def test_the_estimate_of_a_uniform_acceleration_is_exact_whatever_the_interval(vehicle, every):
    """p = a t^2 / 2 and v = a t, as the trapezoidal rule has them. Lost samples are in the next one's interval."""
    vehicle.a = np.array([0.2, -0.1, 0.05])
    vehicle.begin()
    n = 40
    for k in range(every, n + 1, every):
        late = STATUS["OK"] if every == 1 else STATUS["LATE"]
        assert vehicle.step(k * H, "inertial", interval=every * H) == late
    t = n * H
    assert [*vehicle.command.p_WB] == pytest.approx(0.5 * t * t * vehicle.a, abs=1e-15)
    assert [*vehicle.command.nu] == pytest.approx([*(t * vehicle.a), 0.0, 0.0, 0.0], abs=1e-15)
    assert [*vehicle.command.quat_WB] == [1.0, 0.0, 0.0, 0.0]


def test_a_turn_is_taken_and_a_push_is_turned_with_it(vehicle):
    """A quarter of a turn about z in 40 samples, then a push along B's x, which is y of W."""
    vehicle.begin()
    angle = 0.5 * np.pi / 40
    for k in range(1, 41):
        assert vehicle.step(k * H, "inertial", turn=[0.0, 0.0, angle]) == STATUS["OK"]
    assert vehicle.command.nu[5] == pytest.approx(angle / H, rel=1e-12)
    assert vehicle.step(41 * H, "inertial", push=[0.1, 0.0, 9.81 * H]) == STATUS["OK"]
    assert [*vehicle.command.quat_WB] == pytest.approx([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], abs=1e-12)
    assert [*vehicle.command.nu[:3]] == pytest.approx([0.1, 0.0, 0.0], abs=1e-12)
    assert vehicle.command.p_WB[1] == pytest.approx(0.5 * H * 0.1, abs=1e-12)


@pytest.mark.parametrize("aid", ["dvl", "depth", "heading", "position"])
def test_an_aid_moves_the_estimate_and_one_that_is_no_number_is_as_if_it_were_not_there(filtered, aid):
    """Bit for bit, and the status says so."""
    field = {"dvl": "v_dvl", "depth": "z_WB", "heading": "heading", "position": "p_fix"}[aid]
    wrong = [np.nan] * FIELDS[field]
    wrong[0] = np.inf
    off = {field: [0.01] * FIELDS[field]}
    groups = {"there": ("inertial", aid), "no number": ("inertial", aid), "not there": ("inertial",)}
    said, words = {}, {}
    for case, its_groups in groups.items():
        vehicle = Vehicle(filtered[0])
        vehicle.begin(3)
        said[case] = vehicle.step(4 * H, *its_groups, **(off if case == "there" else {field: wrong}))
        assert vehicle.step(5 * H, "inertial") == STATUS["OK"]
        assert vehicle.step(6 * H, "inertial") == STATUS["OK"]
        words[case] = vehicle.words
    assert said == {"there": STATUS["OK"], "no number": STATUS["LEFT_OUT"], "not there": STATUS["OK"]}
    assert words["no number"] == words["not there"] != words["there"]


@pytest.mark.parametrize(
    ("aid", "field"), [("dvl", "v_dvl"), ("depth", "z_WB"), ("heading", "heading"), ("position", "p_fix")]
)
def test_an_aid_alone_corrects_and_takes_no_time(vehicle, aid, field):
    """Without a sample of the inertial unit an exact aid changes nothing of a moving vehicle, and another one does."""
    vehicle.a = np.array([0.2, -0.1, 0.05])
    vehicle.begin(20)
    estimate = [*vehicle.command.p_WB, *vehicle.command.quat_WB, *vehicle.command.nu]
    exact = vehicle.measured(20 * H, aid)
    exact.t = 20.5 * H
    assert vehicle.step(exact) == STATUS["OK"]
    assert [*vehicle.command.p_WB, *vehicle.command.quat_WB, *vehicle.command.nu] == pytest.approx(estimate, abs=1e-12)
    assert vehicle.step(vehicle.measured(21.1 * H, aid, **{field: [0.1] * FIELDS[field]})) == STATUS["OK"]
    found = [*vehicle.command.p_WB, *vehicle.command.quat_WB, *vehicle.command.nu]
    assert np.abs(np.subtract(found, estimate)).max() > 1e-4


def test_the_corrections_bring_a_wrong_first_estimate_to_the_fixes(vehicle):
    """A fix of the position weighs as the covariances say: 1 cm of the first estimate against 1 cm of a fix."""
    vehicle.begin()
    assert vehicle.step(H, "inertial", "position", p_fix=[0.02, 0.0, 0.0]) == STATUS["OK"]
    assert vehicle.command.p_WB[0] == pytest.approx(0.01, rel=1e-3)
    for k in range(2, 400):
        assert vehicle.step(k * H, "inertial", "position", "dvl", p_fix=[0.02, 0.0, 0.0]) == STATUS["OK"]
    assert vehicle.command.p_WB[0] == pytest.approx(0.02, abs=1e-3)


@pytest.mark.parametrize(
    ("field", "value", "status"),
    [
        ("turn", [np.nan, 0.0, 0.0], "NOT_FINITE"),
        ("push", [0.0, 0.0, np.inf], "NOT_FINITE"),
        ("interval", [np.nan], "NOT_FINITE"),
        ("interval", [0.0], "MISSING"),
        ("interval", [-H], "MISSING"),
        ("interval", [11 * H], "MISSING"),
        ("tau_contact_m_B", [np.nan] * 6, "NOT_FINITE"),
    ],
)
def test_a_wrong_sample_is_neutral_and_the_next_one_may_cover_its_time(vehicle, field, value, status):
    vehicle.a = np.array([0.2, 0.0, 0.0])
    vehicle.begin(5)
    wrong = vehicle.measured(6 * H, "inertial")
    setattr(wrong, field, (ctypes.c_double * len(value))(*value))
    assert vehicle.step(wrong) == STATUS[status]
    assert vehicle.neutral
    assert vehicle.step(7 * H, "inertial", interval=2 * H) == STATUS["OK"]
    assert vehicle.command.p_WB[0] == pytest.approx(0.5 * (7 * H) ** 2 * 0.2, abs=1e-15)


def test_lost_samples_that_nothing_covers_are_named_and_after_ten_a_first_estimate_is_needed(vehicle):
    """A held estimate is good until the next sample is due. A filter that missed a long motion does not go on."""
    vehicle.begin(5)
    assert vehicle.step(6 * H) == STATUS["OK"]  # one may come half a period late: its estimate is held
    assert vehicle.step(7 * H) == STATUS["MISSING"]
    assert vehicle.neutral
    assert vehicle.step(8 * H, "inertial") == STATUS["LATE"]
    assert not vehicle.neutral
    for k in range(10, 20):
        assert vehicle.step(k * H) == STATUS["MISSING"]
    assert vehicle.step(20 * H, "inertial") == STATUS["MISSING"]
    assert vehicle.step(21 * H, "inertial", interval=10 * H) == STATUS["MISSING"]
    assert vehicle.neutral
    assert vehicle.step(22 * H, "start", p_WB=[0.3, 0.0, 0.0]) == STATUS["OK"]
    assert [*vehicle.command.p_WB] == [0.3, 0.0, 0.0]
    assert vehicle.step(23 * H, "inertial") == STATUS["OK"]
    assert vehicle.step(24 * H, "inertial", interval=2 * H) == STATUS["LATE"]  # it covers more than the time


def test_a_first_estimate_is_checked_and_a_later_one_forgets_the_covariance(filtered, vehicle):
    assert vehicle.step(0.0, "start", quat_WB=[1.1, 0.0, 0.0, 0.0]) == STATUS["NO_ATTITUDE"]
    assert vehicle.neutral
    assert vehicle.step(H, "start", v_WB=[np.nan, 0.0, 0.0]) == STATUS["NOT_FINITE"]
    assert vehicle.step(2 * H, "start") == STATUS["OK"]
    fresh = Vehicle(filtered[0])
    for each in (vehicle, fresh):
        for k in range(3, 60 if each is vehicle else 3):
            assert each.step(k * H, "inertial", "position", "dvl", p_fix=[0.1, 0.0, 0.0]) == STATUS["OK"]
        assert each.step(60 * H, "start") == STATUS["OK"]
        assert each.step(61 * H, "inertial", "position", "dvl", p_fix=[0.02, 0.0, 0.0]) == STATUS["OK"]
    for name in ("p_WB", "quat_WB", "nu"):
        assert [*getattr(vehicle.command, name)] == [*getattr(fresh.command, name)], name


def test_time_that_goes_back_is_neutral_and_changes_no_estimate(vehicle):
    vehicle.begin(5)
    before = bytes(vehicle.memory)[40:]
    assert vehicle.step(5 * H, "inertial") == STATUS["TIME_BACK"]
    assert vehicle.neutral
    after = bytes(vehicle.memory)[40:]
    assert sum(before[k : k + 8] != after[k : k + 8] for k in range(0, len(before), 8)) <= 6  # tau_hat alone
    assert vehicle.step(6 * H, "inertial") == STATUS["OK"]


PROGRAM = """
static double clock_s;
static int calls;
static double now(void) { return clock_s; }
static void first_estimate(double *p, double *q, double *v, double *omega)
{
    int i;
    for (i = 0; i < 3; i++)
        p[i] = v[i] = omega[i] = 0.0;
    q[0] = 1.0;
    q[1] = q[2] = q[3] = 0.0;
}
static int new_imu(double last, double *turn, double *push)
{
    turn[0] = turn[1] = turn[2] = push[1] = 0.0;
    push[0] = 0.2 * (clock_s - last);
    push[2] = 9.81 * (clock_s - last);
    return calls != 7 && calls != 13 && calls != 14;
}
static int new_dvl(double *v) { v[0] = v[1] = v[2] = clock_s - clock_s; return 0; }
static int new_pressure(double *z) { *z = 0.0; return 0; }
static int new_heading(double *angle) { *angle = 0.0; return 0; }
static int new_fix(double *p) { p[0] = p[1] = p[2] = 0.0; return 0; }
static int new_force(double *f) { f[0] = f[1] = f[2] = f[3] = f[4] = f[5] = 0.0; return calls != 21; }
static int refused;
static void report(const char *said) { refused += said != 0; }
static double distance(double x, double y) { return x > y ? x - y : y - x; }
"""
END = """
    clock_s += GSTA_PERIOD;
    if (++calls == 31)
        return 100 * (distance(command.p_WB[0], 0.5 * 0.2 * last * last) > 1e-12) + refused;
"""


def test_the_program_of_the_page_covers_lost_samples_and_refused_calls(filtered, tmp_path):
    """The page's loop with sensors of a vehicle that accelerates uniformly: samples are lost in three calls, and a
    force in one. The estimate is exact after each."""
    if not runs_here("x86_64"):
        pytest.skip("another processor")
    folder, _ = filtered
    page = Path(__file__).parents[2] / "docs/how_to/filter_to_vehicle.md"
    text = page.read_text().split("```c\n")[1].split("```")[0]
    front, loop = text.split("static gsta law;\n")
    assert "    send_pulses(command.pwm);\n" in loop
    loop = loop.replace("    send_pulses(command.pwm);\n", "")  # this vehicle has none
    loop = f"{loop.rstrip().removesuffix('}')}{END}}}"
    (tmp_path / "test.c").write_text(f"{front}{PROGRAM}static gsta law;\nint main(void)\n{{\n{loop}\n}}\n")
    shutil.copy(folder / "gsta.h", tmp_path)
    program = linking.program(MACHINES["x86_64"], folder / "x86_64/libgsta.a", tmp_path / "test.c", tmp_path)
    assert subprocess.run([program], timeout=10.0).returncode == 2  # the second sample of two, and the force


# loop.c, and runs


@contextlib.contextmanager
def answering(folder, target, place, name="gsta"):
    """The program loop.c of a target on a port of this machine: the port, and a function that asks it."""
    machine = MACHINES[target]
    if not runs_here(target):
        pytest.skip(f"no qemu-{machine.emulator}: apt-get install qemu-user")
    for each in (*folder.glob("*.h"), folder / "loop.c"):
        shutil.copy(each, place)
    program = linking.program(machine, folder / target / f"lib{name}.a", place / "loop.c", place)
    layout = int(tomllib.loads((folder / f"{name}.toml").read_text())["library"]["layout"], 16)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with contextlib.ExitStack() as stack:
        peer = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        peer.connect(("127.0.0.1", port))
        peer.settimeout(5.0)

        def asked(instant, body):
            """Status and words of the command."""
            front = struct.pack("<8sIIQQ", b"uvms-mj2", len(body), ~len(body) & 0xFFFFFFFF, instant, layout)
            until = time.monotonic() + 10.0
            while True:  # until it listens
                try:
                    peer.send(front + body + struct.pack("<I", zlib.crc32(front + body)))
                    data = peer.recv(4096)
                    return struct.unpack_from("<q", data, 32)[0], np.frombuffer(data[56:-4], "<u8")
                except ConnectionRefusedError:
                    assert time.monotonic() < until
                    time.sleep(0.02)

        process = stack.enter_context(subprocess.Popen([*linking.emulator(machine), str(program), str(port)]))
        stack.callback(process.kill)
        yield port, asked


@pytest.mark.parametrize("target", [target for target in MACHINES if MACHINES[target].shared])
def test_frames_of_samples_get_the_commands_of_the_run(filtered, tmp_path, target):
    """The first recorded steps as datagrams; the number 0 of an instant begins the law anew. A request of a run, which
    has no samples, is refused with the status."""
    folder, _ = filtered
    given, wanted = rows_of(folder)
    with answering(folder, target, tmp_path) as (port, asked):
        for _ in range(2):
            for k in range(100):
                status, command = asked(k, given[k].tobytes())
                assert status == STATUS["OK"]
                assert np.array_equal(command, wanted[k])
        keys = {"controller.port": port, "simulation.duration": 0.1, "controller.timeout": 5.0}
        run = Scenario.load("push_wall", FILTERED, "gsta").updated(keys, controller="udp")
        with pytest.raises(InputError, match="a measurement is missing that the law needs"):
            simulate(run, engine="free_body")


def test_the_export_says_that_no_run_takes_it_and_what_is_in_it(filtered):
    folder, library = filtered
    with pytest.raises(InputError, match=r"gsta_law.toml: no law of a run: it has the Kalman filter"):
        Scenario.load("push_wall", {}, f"{folder / 'x86_64' / 'libgsta.so'}:gsta_law")
    (note,) = [each for each in library.notes if "Kalman filter" in each]
    assert "a run can't take the library as its law" in note
    about = tomllib.loads((folder / "gsta.toml").read_text())["library"]
    assert about["stages"][0] == "navigation"
    assert about["left_behind"] == []
    readme = (folder / "README.md").read_text()
    assert "GSTA_START" in readme
    assert "controller.export=" not in readme


# scenarios


FEELS = """
from dataclasses import dataclass
from uvms_mj import Controller, gain
@dataclass(frozen=True)
class Feels(Controller):
    k: float = gain(200.0, "N/m, N m", "stiffness")
    uses_task = False
    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = signals.g_hat - gains.k * signals.eta_e - 100.0 * signals.nu_e
        tau_cmd[:3] += 0.3 * signals.f_contact_m_W
"""


def test_the_force_is_turned_to_the_world_with_the_estimate(tmp_path):
    """A law that reads the force in W, at a wall, by a vehicle that is turned."""
    (tmp_path / "feels.py").write_text(FEELS)
    turned = {"initial.attitude_deg": [3.0, -4.0, 25.0], "initial.position": [0.9, 0.0, 0.0]}
    run = Scenario.load("push_wall", FILTERED | turned, f"{tmp_path / 'feels.py'}:Feels")
    library = write_library(run, tmp_path / "out", ["x86_64"])
    assert library.targets[0].equal in (None, 1200)
    assert "pressing" in (tmp_path / "out/README.md").read_text()


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        pytest.param(
            {
                **{"navigation.dvl_period": 0.0, "navigation.position_period": 0.0},
                **{"navigation.force_delay": 0.02, "navigation.force_noise": 0.3},
            },
            id="fewer sensors, a real one of the force",
        ),
        pytest.param(
            {"observer.name": "momentum_observer", "current.speed": 0.0, "controller.period": 0.02}, id="an observer"
        ),
        pytest.param(
            {"navigation.period": H, "controller.period": 1e-3, "controller.delay": 0.005},
            id="a law that is faster, a delay",
        ),
    ],
)
def test_other_rates_and_sensors_leave_with_the_bits_of_the_run(tmp_path, settings):
    library = write_library(Scenario.load("push_wall", FILTERED | settings, "gsta"), tmp_path, ["x86_64"])
    assert library.targets[0].equal in (None, 1200)
    header = (tmp_path / "gsta.h").read_text()
    assert ("v_dvl" in header) == ("navigation.dvl_period" not in settings)
    assert ("tau_contact_m_B" in header) == ("observer.name" not in settings)
    assert "GSTA_NEEDED (0)" in header or "GSTA_NEEDED (GSTA_FORCE)" in header


@pytest.mark.slow
@pytest.mark.parametrize("navigation", ["perfect", pytest.param("ekf", marks=pytest.mark.long)])
def test_frames_get_the_commands_of_a_law_at_a_tool(tmp_path, navigation):
    """No run can ask this law, whose vehicle has joints: its recorded steps as datagrams get their commands."""
    run = Scenario.load("tool_push", {"navigation.name": navigation, "simulation.duration": 0.2}, "impedance")
    targets = ["x86_64", *(each for each in ("aarch64",) if navigation == "ekf" and runs_here(each))]
    library = write_library(run, tmp_path / "made", targets)
    assert {each.equal for each in library.targets} <= {None, library.steps}
    given, wanted = rows_of(tmp_path / "made", "impedance")
    place = tmp_path / "place"
    place.mkdir()
    with answering(tmp_path / "made", "x86_64", place, "impedance") as (_, asked):
        for k in range(100):
            status, command = asked(k, given[k].tobytes())
            assert status == STATUS["OK"]
            assert np.array_equal(command, wanted[k])
