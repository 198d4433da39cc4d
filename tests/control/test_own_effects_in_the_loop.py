"""What a run says of chatter, vibration and its time step has the effects of a user's own in it, or says that not."""

import numpy as np
import pytest

from uvms_mj import Scenario, Simulation, simulate
from uvms_mj.control.base import NoClosedForm, SteadyState
from uvms_mj.control.theory.loop import Loop
from uvms_mj.control.theory.own_effects import OwnEffects
from uvms_mj.control.theory.predictions import steady_state
from uvms_mj.engine.native.loop import Diverged
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import checked, warnings_of

EFFECTS = """
from dataclasses import dataclass
import numpy as np
from uvms_mj import Effect, setting

@dataclass(frozen=True)
class Push(Effect):
    k: float = setting(1.0, "N s/m", "force over the velocity along x; negative: drag")

    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        tau[:] = 0.0
        tau[0] = settings.k * given.nu_r[0]

@dataclass(frozen=True)
class Spring(Effect):
    k: float = setting(1.0, "N/m", "stiffness along y")

    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        tau[:] = 0.0
        tau[:3] = -settings.k * given.p_WB[1] * given.R_WB[1]

@dataclass(frozen=True)
class Keel(Effect):
    k: float = setting(1.0, "N s^2/m^2", "drag along y over |v| v, at 0.4 m before B")

    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        v = given.nu_r[1] + 0.4 * given.nu_r[5]
        tau[:] = 0.0
        tau[1] = -settings.k * abs(v) * v
        tau[5] = 0.4 * tau[1]

@dataclass(frozen=True)
class Timed(Effect):
    k: float = setting(1.0, "N", "force")

    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        tau[:] = 0.0
        tau[0] = settings.k * np.sin(given.t)
"""
H = 1e-3


@pytest.fixture
def run_with(tmp_path):
    path = tmp_path / "e.py"
    path.write_text(EFFECTS)

    def made(name, k, law="impedance", **others) -> Scenario:
        effects = [{"name": f"{path}:{name}", "k": k}]
        base = {"simulation.timestep": H, "simulation.duration": 3.0, "effects": effects}
        return Scenario.load("push_wall", base | others, law)

    return made


@pytest.mark.parametrize("law", ["impedance", "pid", "gsta"])
def test_no_force_is_announced_where_an_effect_feeds_more_than_the_law_takes(run_with, law):
    """GSTA announced 1.498 N, and its run had thousands."""
    with pytest.warns(UserWarning, match="oscillate"):
        trace = simulate(run_with("Push", 500.0, law), engine="free_body", log_rate=100.0)
    assert np.abs(trace.nu).max() > 10.0
    assert isinstance(trace.analytic, NoClosedForm)
    assert isinstance(simulate(run_with("Push", -50.0, law), engine="free_body").analytic, SteadyState)


def test_the_growth_of_the_loop_is_that_of_a_run(run_with):
    calm = {"wall.present": False, "current.speed": 0.0, "initial.velocity": [1e-6, 0.0, 0.0, 0.0, 0.0, 0.0]}
    scenario = run_with("Push", 500.0, **calm | {"reference.target": [0.0, 0.0, 0.0]})
    growth = Loop(set_up(scenario)).growths[0]
    with Simulation(scenario, engine="free_body") as sim:
        sim.step(200)
        first = sim.signals.nu[0]
        sim.step(100)
        assert np.log(sim.signals.nu[0] / first) / 0.1 == pytest.approx(growth, rel=1e-3)
    without = Loop(set_up(scenario.updated({"effects": []}))).growths[0]
    assert without < 0.0 < growth


@pytest.mark.parametrize(("name", "k"), [("Push", -8e4), ("Spring", 1e8)])
@pytest.mark.filterwarnings("ignore:.*:uvms_mj.setup.checks.SamplingWarning")
def test_a_time_step_that_does_not_resolve_an_effect_is_named_with_a_shorter_one_that_does(run_with, name, k):
    scenario = run_with(name, k, "gsta")
    setup = checked(scenario)
    notes = [note for note in warnings_of(setup) if "does not resolve" in note]
    assert len(notes) == 1
    assert f"the time step of 0.001 s does not resolve {name}" in notes[0]
    shorter = float(notes[0].rpartition("; ")[2].removesuffix(" s do"))
    with Simulation(scenario, engine="free_body") as sim, pytest.raises(Diverged):
        sim.step(3000)
    fine = scenario.updated({"simulation.timestep": shorter, "controller.period": shorter})
    assert not [note for note in warnings_of(checked(fine)) if "does not resolve" in note]
    with Simulation(fine, engine="free_body") as sim:
        sim.step(3000)
        assert np.abs(sim.signals.nu).max() < 1.0
    assert "the time step does not resolve" in str(steady_state(setup))


def test_where_an_effect_is_not_in_the_loop_the_note_says_so(run_with):
    notes = warnings_of(checked(run_with("Timed", 1.0)))
    assert [note for note in notes if "is not checked: the wrench of an effect depends on the time" in note]
    notes = warnings_of(checked(run_with("Push", -1.0, **{"vehicle.model": "bluerov2_alpha5"})))
    assert [note for note in notes if "leaves out Push" in note and "has joints" in note]
    assert not [note for note in warnings_of(checked(run_with("Push", -1.0))) if "Push" in note]


@pytest.mark.filterwarnings("ignore:.*:uvms_mj.setup.checks.SamplingWarning")
def test_a_time_step_that_does_not_resolve_a_shipped_effect_is_named_too():
    """Drag in a current of 0.5 m/s, whose slope is 2 c |v|: h 2 c |v| / m = 2 is the limit."""
    calm = {"simulation.timestep": 1e-3, "current.direction_deg": 0.0, "wall.present": False}
    M = set_up(Scenario()).vehicle.M
    for factor, notes in ((0.98, 0), (1.02, 1)):
        c = factor * 2.0 / (1e-3 * 2.0 * 0.5 * np.linalg.inv(M)[0, 0])
        scenario = Scenario.load("push_wall", calm | {"drag": [{"forward": [c, 0.0, 0.0]}]})
        found = [note for note in warnings_of(checked(scenario)) if "does not resolve drag" in note]
        assert len(found) == notes, factor
    fin = {"area": 1e4, "position": [-0.5, 0.0, 0.0]}
    found = warnings_of(checked(Scenario.load("push_wall", calm | {"fins": [fin]})))
    assert any("does not resolve fins, by slopes at rest" in note for note in found)


def test_a_shipped_effect_is_in_the_loop_as_the_same_effect_of_a_user(run_with):
    """A keel before B in a current: it damps, and by the attitude it turns the vehicle across the current."""
    others = {"current.speed": 0.4, "current.direction_deg": 75.0}
    own = set_up(run_with("Keel", 900.0, "impedance", **others))
    base = run_with(
        "Keel", 900.0, "impedance", **others, drag=[{"forward": [0.0, 900.0, 0.0], "position": [0.4, 0.0, 0.0]}]
    )
    shipped = set_up(base.updated({"effects": []}))
    plain = set_up(base.updated({"effects": [], "drag": []}))
    slopes = OwnEffects(own.scenario.effects, own).slopes(own)
    assert np.abs(slopes[1, 5]) > 10.0
    np.testing.assert_allclose(shipped.effect_slopes, slopes, atol=1e-5 * np.abs(slopes).max())
    of_own, of_shipped, of_none = (Loop(each) for each in (own, shipped, plain))
    np.testing.assert_allclose(of_shipped.step, of_own.step, atol=1e-9)
    assert of_shipped.growths == pytest.approx(of_own.growths, rel=1e-5)
    assert np.abs(of_none.step - of_own.step).max() > 1e-4
