"""A vehicle that nothing holds rises or sinks for ever, and a run says so before it begins."""

import pytest

from uvms_mj import Scenario, Simulation

ALONE = {"wall.present": False, "current.speed": 0.0, "simulation.timestep": 1e-3}


def begun(keys: dict[str, object]) -> Simulation:
    return Simulation(Scenario.load("push_wall", ALONE | keys), engine="free_body")


@pytest.mark.parametrize(
    ("factor", "said"), [(1.1, "it rises; the water of a run has no surface"), (0.9, "it sinks"), (1.0, "")]
)
def test_the_note_tells_where_a_vehicle_without_commands_goes(factor, said):
    with begun({"controller.name": "external", "vehicle.displaced_mass": factor}) as simulation:
        notes = [note for note in simulation.notes if "water of a run" in note]
        simulation.step(5000)
        climbed = float(simulation.signals.p_WB[2])
    assert len(notes) == bool(said)
    assert not said or said in notes[0]
    assert climbed == 0.0 if not said else abs(climbed) > 1.0
    assert (climbed > 0.0) == ("rises" in said)


@pytest.mark.parametrize(("factor", "holds"), [(1.5, True), (3.0, False)])
def test_under_a_law_the_thrusters_hold_the_vehicle_or_the_note_says_that_they_cannot(factor, holds):
    """The Heavy's four vertical thrusters against half its weight, and against twice its weight."""
    keys = {"controller.name": "pid", "vehicle.model": "bluerov2_heavy", "vehicle.displaced_mass": factor}
    with begun(keys | {"reference.target": [0.0, 0.0, 0.0]}) as simulation:
        notes = [note for note in simulation.notes if "its thrusters can't hold it" in note]
        simulation.step(20000)
        climbed = float(simulation.signals.p_WB[2])
    assert bool(notes) is not holds
    assert (abs(climbed) < 0.5) is holds
