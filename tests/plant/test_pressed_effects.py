"""Effects of a user's own that depend on the contacts: they are given the normal forces of the same instant."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uvms_mj import Effect, Scenario, Simulation, simulate
from uvms_mj.control.base import NoClosedForm, SteadyState
from uvms_mj.physics.frames import BODY
from uvms_mj.stages.signals import CLOCK

FILE = '''
from dataclasses import dataclass
import numpy as np
from uvms_mj import Effect, setting

@dataclass(frozen=True)
class Scrub(Effect):
    """A brush on the hull: drag along the wall that grows with the push, and a drive up the wall."""
    c: float = setting(2.0, "s/m", "drag over the push and the velocity along the wall")
    drive: float = setting(0.0, "1", "force over the push")

    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        tau[:] = 0.0
        push = np.sqrt(given.f_normal_W @ given.f_normal_W)
        if push > 0.0:
            n = given.R_WB.T @ given.f_normal_W / push
            v = given.nu[:3] - (given.nu[:3] @ n) * n
            tau[:3] = -settings.c * push * v + settings.drive * push * given.R_WB[2]

@dataclass(frozen=True)
class Cancel(Effect):
    """Takes the contacts of its body away."""

    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        tau[:] = -given.tau_normal_B
'''


@pytest.fixture
def own(tmp_path):
    (tmp_path / "e.py").write_text(FILE)
    return lambda name, **settings: {"name": f"{tmp_path / 'e.py'}:{name}", **settings}


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_brush_drags_with_the_push_of_the_same_instant(own, engine):
    """The push that acts is the engine's soft contact, whose inerter makes 1e-3 of it at most."""
    base = {"simulation.duration": 0.6, "initial.velocity": [0.1, 0.15, -0.05, 0.0, 0.0, 0.0]}
    base |= {"initial.position": [0.995, 0.0, 0.0], "wall.stiffness": 2e3, "wall.damping": 20.0}
    scenario = Scenario.load("push_wall", base | {"effects": [own("Scrub", c=40.0)]}, "impedance")
    trace = simulate(scenario, engine=engine, log_rate="full")
    pressed = trace.push > 0.1
    assert pressed.sum() > 100
    assert not trace.tau_Scrub[trace.push == 0.0].any()
    R = Rotation.from_quat(trace.quat_WB[pressed], scalar_first=True)
    along_W = R.apply(trace.nu[pressed, :3]) * [0.0, 1.0, 1.0]
    expected = R.inv().apply(-40.0 * trace.push[pressed, None] * along_W)
    assert np.abs(expected).max() > 1.0
    np.testing.assert_allclose(trace.tau_Scrub[pressed, :3], expected, rtol=0.0, atol=1e-3 * np.abs(expected).max())
    assert (trace.tau_Scrub[:, :3] * trace.nu[:, :3]).sum(axis=1).max() <= 0.0
    without = simulate(scenario.updated({"effects": []}), engine=engine)
    assert np.abs(trace.nu[-1, 1:3] - without.nu[-1, 1:3]).max() > 5e-5


def test_both_engines_agree(own):
    base = {"simulation.duration": 0.6, "initial.velocity": [0.1, 0.15, -0.05, 0.0, 0.0, 0.0]}
    base |= {"initial.position": [0.995, 0.0, 0.0], "effects": [own("Scrub", c=40.0, drive=0.2)]}
    scenario = Scenario.load("push_wall", base, "impedance")
    free, whole = (simulate(scenario, engine=engine) for engine in ("free_body", "mujoco"))
    assert np.abs(free.tau_Scrub).max() > 0.1
    np.testing.assert_allclose(free.p_WB, whole.p_WB, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(free.tau_Scrub, whole.tau_Scrub, rtol=0.0, atol=1e-3 * np.abs(free.tau_Scrub).max())


SHAPES = [
    {"shape": "sphere", "radius": 0.3, "position": [1.0, 0.1, -0.1], "stiffness": 2e3},
    {
        "shape": "plane",
        "position": [0.75, 0.0, 0.0],
        "attitude_deg": [0.0, 0.0, 10.0],
        "stiffness": 1e3,
        "damping": 50.0,
    },
]
MOVING = {"simulation.timestep": 1e-3, "wall.present": False, "initial.velocity": [0.3, 0.1, -0.1, 0.2, -0.2, 0.4]}
RIGID = MOVING | {
    "vehicle.model": "bluerov2_heavy",
    "vehicle.contact_bodies": [
        {"position": [0.25, 0.1, 0.05], "radius": 0.05},
        {"position": [0.25, -0.2, 0.0], "end": [0.3, 0.2, -0.1], "radius": 0.04, "stiffness": 5e3, "damping": 30.0},
    ],
    "initial.position": [0.35, 0.0, 0.0],
}
ARM = MOVING | {
    "vehicle.model": "bluerov2_alpha5",
    "vehicle.contact_bodies": [
        {"position": [0.35, 0.1, 0.05], "radius": 0.3},
        {"position": [0.05, 0.0, 0.1], "radius": 0.3, "body": "forearm"},
    ],
    "initial.joints": [0.3, 1.0, 2.0, 0.5],
    "initial.position": [0.1, 0.0, 0.0],
}


@pytest.mark.parametrize(
    ("changes", "frames", "engine"),
    [
        (RIGID, ["body"], "free_body"),
        (RIGID, ["horizontal_front_left"], "free_body"),
        (ARM, ["body", "forearm"], "mujoco"),
    ],
)
def test_effects_that_cancel_the_contacts_of_their_bodies_leave_the_motion_in_free_water(own, changes, frames, engine):
    """Each is given the contacts of its own body alone, at the origin of its frame and in its axes."""

    def motion(**more) -> tuple[np.ndarray, np.ndarray]:
        scenario, nu, given = Scenario.load("push_wall", changes | more, "external"), [], []
        with Simulation(scenario, engine=engine) as sim:
            for _ in range(100):
                sim.step(3)
                nu.append(sim.signals.nu.copy())
                given.append([sim.signals[name].copy() for name in names if "effects" in more])
        return np.array(nu), np.array(given)

    names = ["tau_Cancel"] if len(frames) == 1 else ["tau_Cancel_0", "tau_Cancel_1"]
    free, hit = motion()[0], motion(walls=SHAPES)[0]
    assert np.abs(hit - free).max() > 1e-2
    cancelled, given = motion(walls=SHAPES, effects=[own("Cancel", at=frame) for frame in frames])
    assert (np.abs(given).max(axis=(0, 2)) > 1.0).all()
    np.testing.assert_allclose(cancelled, free, rtol=0.0, atol=1e-9)


RUN = {"simulation.timestep": 1e-3, "simulation.duration": 25.0, "reference.target": [1.03, 0.0, -0.5]}


@pytest.mark.parametrize("law", ["impedance", "gsta", "ideal", "dob_impedance", "pid"])
def test_the_closed_form_has_the_drive_of_a_brush_in_it(own, law):
    """Laws without an integral give way up the wall by what the push drives."""
    scenario = Scenario.load("push_wall", RUN | {"effects": [own("Scrub", drive=0.3)]}, law)
    trace = simulate(scenario, engine="free_body", log_rate=10.0)
    assert isinstance(trace.analytic, SteadyState)
    assert trace.push[-1] == pytest.approx(trace.analytic.force, rel=1e-4)
    assert trace.tau_Scrub[-1, 2] == pytest.approx(0.3 * trace.analytic.force, rel=1e-4)
    np.testing.assert_allclose(trace.p_WB[-1], trace.analytic.position, rtol=0.0, atol=1e-5)
    if law in ("impedance", "ideal"):
        assert trace.analytic.position[2] > -0.5 + 1e-4


def test_a_brush_that_feeds_energy_under_the_push_has_no_closed_form(own):
    """Its free motion is damped: only the loop under the push shows that the run goes on moving."""
    scenario = Scenario.load("push_wall", RUN | {"effects": [own("Scrub", c=-30.0)]}, "pid")
    trace = simulate(scenario, engine="free_body", log_rate=10.0)
    assert "a motion under the push grows" in trace.analytic.reason
    assert np.abs(trace.nu[-10:]).max() > 0.1
    calm = simulate(scenario.updated({"effects[0].c": 30.0}), engine="free_body", log_rate=10.0)
    assert isinstance(calm.analytic, SteadyState)
    assert calm.push[-1] == pytest.approx(calm.analytic.force, rel=1e-6)


@pytest.mark.filterwarnings("ignore:what is said of chatter")
def test_closed_forms_know_the_contacts_of_a_rigid_vehicle_at_b_alone(own):
    changes = {"vehicle.model": "bluerov2_alpha5", "simulation.duration": 0.02, "effects": [own("Scrub")]}
    trace = simulate(Scenario.load("push_wall", changes, "impedance"))
    assert isinstance(trace.analytic, NoClosedForm)
    assert "depends on contacts, which are known of a rigid vehicle at B" in trace.analytic.reason


def test_the_plant_as_an_fmu_gives_it_the_contacts(own, tmp_path):
    fmpy = pytest.importorskip("fmpy", reason="needs the extra fmi")
    from uvms_mj.engine.plant_fmu import write_fmu

    changes = {"simulation.timestep": 1e-3, "simulation.duration": 0.2, "initial.position": [1.0002, 0.0, 0.0]}
    scenario = Scenario.load("push_wall", changes | {"effects": [own("Scrub", drive=0.5)]})
    write_fmu(scenario, tmp_path / "plant.fmu", with_law=True)
    found = fmpy.simulate_fmu(str(tmp_path / "plant.fmu"), stop_time=0.2, output_interval=1e-3, output=["p_WB[3]"])
    trace = simulate(scenario, engine="free_body", log_rate="full")
    assert np.abs(trace.tau_Scrub).max() > 1.0
    np.testing.assert_array_equal(found["p_WB[3]"], trace.p_WB[: len(found), 2])


READERS = """
@dataclass(frozen=True)
class Direct(Effect):
    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        tau[:] = 0.01 * np.sum(np.abs(given.{0}))

def handed(record):
    return np.sum(np.abs(record.{0}))

@dataclass(frozen=True)
class Handed(Effect):
    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        tau[:] = 0.01 * handed(given)

@dataclass(frozen=True)
class Renamed(Effect):
    @staticmethod
    def wrench(settings, state, record, state_dot, tau):
        other = record
        tau[:] = 0.01 * np.sum(np.abs(other.{0}))
"""


@pytest.mark.parametrize("at", [BODY, "horizontal_front_left"])
@pytest.mark.parametrize("signal", [signal.name for signal in Effect.given() if signal not in CLOCK])
def test_each_signal_is_there_however_an_effect_reads_it(tmp_path, signal, at):
    """Signals that no effect reads are not filled. One that is handed on, or renamed, may be read."""
    (tmp_path / "e.py").write_text(FILE + READERS.format(signal))
    base = {"initial.position": [1.001, 0.0, 0.0], "initial.velocity": [0.1, 0.15, -0.05, 0.02, 0.0, 0.1]}
    base |= {"wall.stiffness": 2e3, "current.speed": 0.2, "vehicle.model": "bluerov2_heavy"}
    found = []
    for name in ("Direct", "Handed", "Renamed"):
        effects = [{"name": f"{tmp_path / 'e.py'}:{name}", "at": at}]
        with Simulation(Scenario.load("push_wall", base | {"effects": effects}, "pid"), engine="free_body") as sim:
            sim.step(20)
            found.append((getattr(sim.signals, f"tau_{name}").copy(), sim.signals.p_WB.copy()))
    assert found[0][0][0] != 0.0
    for each in found[1:]:
        assert all(np.array_equal(*pair) for pair in zip(each, found[0], strict=True))
