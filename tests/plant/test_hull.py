"""Walls that follow the sea: their motion against the response of a hull, and the same run by two engines."""

import math

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, Sea, simulate
from uvms_mj.control.base import NoClosedForm
from uvms_mj.engine.simulation import Simulation
from uvms_mj.physics.surfaces import SURFACE, move
from uvms_mj.plant.hull import response, swell
from uvms_mj.plant.sea import spectral_density, wave_number
from uvms_mj.plant.settings import Situation, Surface
from uvms_mj.setup.base import set_up

REACH = set_up(Scenario()).plant.geometry.reach
G = 9.80665
FLAT = ((0.1, 1.0, 0.0), (20.0, 1.0, 0.0))
HULL = {
    "shape": "plane",
    "position": [1.4, 0.3, -0.2],
    "pivot": [4.0, -1.0, 1.5],
    "heading_deg": 25.0,
    "heave": [[0.1, 1.0, 0.0], [1.5, 0.9, -20.0], [3.0, 0.3, -90.0], [20.0, 0.0, -90.0]],
    "roll": [[0.1, 1.0, 90.0], [1.5, 6.0, 40.0], [20.0, 0.0, 0.0]],
    "pitch": [[0.1, 2.0, -90.0], [1.5, 4.0, -130.0], [20.0, 0.0, 0.0]],
}
NO_WALL = {"wall.present": False, "simulation.duration": 3.0, "current.speed": 0.0}


def hull(**keys):
    given = HULL | keys
    return Surface(
        **{
            key: tuple(map(tuple, v)) if key in ("heave", "roll", "pitch") else (tuple(v) if isinstance(v, list) else v)
            for key, v in given.items()
        }
    )


def moved(wall, sea, times, seed=0, gravity=G):
    """Places (n, 3) and velocities (n, 3) of a wall in the sea, by the kernel."""
    rows = swell(wall, sea, Situation(seed, gravity))[0]
    surface = np.zeros(1, SURFACE)
    surface["start_W"], surface["swell_rows"] = wall.position, len(rows)
    surface = surface.view(np.recarray)[0]
    places, velocities = [], []
    for t in times:
        move(surface, rows.reshape(-1), t)
        places.append(surface.p_WS.copy())
        velocities.append(surface.v_W.copy())
    return np.array(places), np.array(velocities)


def test_in_a_regular_sea_the_wall_moves_by_amplitude_and_phase_of_the_response():
    """Heave alone: at the crest's time plus the lag; a row of the table is met, and the phase is the crest's at the
    wall's place."""
    omega = 1.5
    sea = Sea(height=0.6, period=2.0 * math.pi / omega, direction_deg=35.0, depth=7.0)
    wall = hull(roll=[], pitch=[], pivot=None, heading_deg=0.0)
    k = wave_number(omega, G, 7.0)
    crest = k * (1.4 * math.cos(math.radians(35.0)) + 0.3 * math.sin(math.radians(35.0))) / omega
    times = np.linspace(0.0, 9.0, 40)
    places, _ = moved(wall, sea, times)
    expected = 0.3 * 0.9 * np.cos(omega * (times - crest) + math.radians(-20.0))
    np.testing.assert_allclose(places[:, 2] - wall.position[2], expected, atol=1e-12)
    assert np.array_equal(places[:, :2], np.broadcast_to(wall.position[:2], (40, 2)))


def test_roll_and_pitch_move_the_wall_as_a_small_turn_about_the_pivot():
    """Against rotations of the arm: they differ by the square of the angle, a quarter at half the height."""
    wall, errors = hull(), []
    arm = np.array(wall.position) - np.array(wall.pivot)
    for height in (0.2, 0.1):
        sea, omega = Sea(height=height, period=5.0), 2.0 * math.pi / 5.0
        k, e, times = wave_number(omega, G, None), np.array([1.0, 0.0]), np.linspace(0.0, 5.0, 21)
        crest = 0.5 * height * np.exp(1j * (omega * times - k * (e @ np.array(wall.pivot)[:2])))
        heave, roll, pitch = (
            (crest * response(getattr(wall, m), np.array([omega]))).real for m in ("heave", "roll", "pitch")
        )
        places, _ = moved(wall, sea, times)
        axes = [np.array([math.cos(a), math.sin(a), 0.0]) for a in np.radians([25.0, 115.0])]
        worst = 0.0
        for place, z, *angles in zip(places, heave, np.radians(roll), np.radians(pitch), strict=True):
            turn = np.array(axes).T @ angles
            size = np.linalg.norm(turn)
            n = turn / size
            turned = arm * math.cos(size) + np.cross(n, arm) * math.sin(size) + n * (n @ arm) * (1.0 - math.cos(size))
            worst = max(worst, np.abs(np.array(wall.pivot) + turned + [0.0, 0.0, z] - place).max())
        errors.append(worst)
    assert 1e-9 < errors[0] < 1e-3
    assert errors[1] == pytest.approx(0.25 * errors[0], rel=2e-2)


def test_the_velocity_is_the_rate_of_the_place():
    sea, h = Sea(height=0.6, period=6.0, spectrum="jonswap", spreading=4.0), 1e-5
    times = np.linspace(0.0, 30.0, 31)
    before, now, after = (moved(hull(), sea, times + d) for d in (-h, 0.0, h))
    np.testing.assert_allclose(now[1], (after[0] - before[0]) / (2.0 * h), atol=1e-9)
    assert np.abs(now[1]).max() > 0.05


def test_the_variance_is_the_integral_of_the_spectrum_times_the_square_of_the_response():
    """Of the seed's components: half the squares of their amplitudes. On the mean over seeds: the integral."""
    sea, wall = (
        Sea(height=0.8, period=5.0, spectrum="jonswap", components=200),
        hull(roll=[], pitch=[], pivot=None, heading_deg=0.0),
    )
    peak = 2.0 * math.pi / 5.0
    fine = peak * np.linspace(0.5, 4.0, 40001)
    S = spectral_density(fine, 0.8, 5.0, 3.3)
    S *= 0.8**2 / 16.0 / np.trapezoid(S, fine)
    integral = np.trapezoid(np.abs(response(wall.heave, fine)) ** 2 * S, fine)
    variances = []
    for seed in range(20):
        rows = swell(wall, sea, Situation(seed, G))[0]
        variances.append(0.5 * float(np.sum(rows[:, 3] ** 2 + rows[:, 6] ** 2)))
    assert np.mean(variances) == pytest.approx(integral, rel=2e-3)
    assert integral < 0.9 * 0.8**2 / 16.0


def test_a_hull_with_the_response_one_rides_the_surface():
    sea = Sea(height=0.5, period=4.0, spectrum="pierson_moskowitz", components=12, depth=6.0)
    wall = hull(heave=FLAT, roll=[], pitch=[], pivot=None, heading_deg=0.0)
    times = np.linspace(0.0, 20.0, 50)
    surface = sum(
        a * np.cos(k * (e_x * 1.4 + e_y * 0.3) - w * times + p) for a, w, k, e_x, e_y, p in sea.waves(Situation(3, G))
    )
    np.testing.assert_allclose(moved(wall, sea, times, seed=3)[0][:, 2] + 0.2, surface, atol=1e-12)


SHIP = HULL | {"position": [1.0 + REACH, 0.0, 0.0], "stiffness": 2e4, "damping": 200.0, "pivot": [3.0, 0.0, 1.0]}
PRESSED = NO_WALL | {
    "sea.height": 0.5, "sea.period": 4.0, "sea.spectrum": "jonswap", "walls": [SHIP], "reference.target": [1.1, 0, 0],
    "initial.position": [1.0, 0.0, 0.0],
}  # fmt: skip


def test_both_engines_press_on_the_same_hull():
    """And the depth of the contact is by the place of the wall."""
    scenario = Scenario.load("push_wall", PRESSED)
    free, mujoco = (simulate(scenario, engine=engine) for engine in ("free_body", "mujoco"))
    assert free.push.max() > 1.0
    np.testing.assert_allclose(free.push, mujoco.push, atol=1e-6 * free.push.max())
    setup = set_up(scenario)
    gravity = float(np.linalg.norm(setup.gravity_W))
    places, _ = moved(setup.contacts.walls[0][1], scenario.sea, free.t, gravity=gravity)
    depth = free.p_WB[:, 0] + REACH - places[:, 0]
    inside = depth > 0.0
    assert inside.mean() > 0.1
    np.testing.assert_allclose(free.contact_depths[inside, 0], depth[inside], atol=1e-9)
    assert np.ptp(places[:, 0]) > 0.004
    assert isinstance(free.analytic, NoClosedForm)


def test_a_reset_has_another_sea_and_comes_back():
    scenario = Scenario.load("push_wall", PRESSED)

    def place(simulation):
        simulation.step(9000)
        return simulation.signals.p_WB.copy()

    with Simulation(scenario) as simulation:
        first = place(simulation)
        simulation.reset({"sea.seed": 9})
        other = place(simulation)
        simulation.reset({"walls": [SHIP | {"heading_deg": 115.0}]})
        turned = place(simulation)
        simulation.reset()
        assert np.array_equal(place(simulation), first)
    with Simulation(scenario.updated({"sea.seed": 9})) as fresh:
        assert np.array_equal(place(fresh), other)
    with Simulation(scenario.updated({"walls": [SHIP | {"heading_deg": 115.0}]})) as fresh:
        assert np.array_equal(place(fresh), turned)
    assert not np.array_equal(other, first)
    assert not np.array_equal(turned, first)


def test_what_is_no_hull_is_refused():
    short = HULL | {"heave": [[1.0, 1.0, 0.0], [2.0, 0.5, 0.0]]}
    waves = {"sea.height": 0.5}
    cases = [
        ({"sea.spectrum": "jonswap", "walls": [short]}, "walls[0].heave: the rows are from 1 to 2 rad/s"),
        ({"walls": [HULL], "wall.present": True, "sea.reflecting": True}, "sea.reflecting"),
        ({"walls": [HULL | {"pivot": None}]}, "need pivot"),
        ({"walls": [HULL | {"heave": [[2.0, 1.0, 0.0], [1.0, 0.5, 0.0]]}]}, "must increase"),
    ]
    for overrides, said in cases:
        with pytest.raises(InputError) as raised:
            Simulation(Scenario.load("push_wall", NO_WALL | waves | overrides))
        assert said in str(raised.value)


def test_a_hull_without_waves_is_said():
    with Simulation(Scenario.load("push_wall", NO_WALL | {"walls": [HULL]})) as simulation:
        assert any("walls[0]: heave, roll and pitch have no effect" in note for note in simulation.notes)


OWN = {"shape": "plane", "position": [1.4, 0.3, -0.2], "swell_height": 0.8, "swell_period": 5.0}


def test_a_wall_with_waves_of_its_own_heaves_by_their_spectrum():
    """Hs is four standard deviations, of the components and over an hour; the seed and no sea decides it."""
    calm, rough = Sea(), Sea(height=2.0, period=9.0)
    rows = swell(hull_of(OWN), calm, Situation(3, G))[0]
    assert 4.0 * math.sqrt(0.5 * np.sum(rows[:, 3] ** 2 + rows[:, 6] ** 2)) == pytest.approx(0.8, rel=1e-12)
    assert not rows[:, [1, 2, 4, 5]].any()
    places, _ = moved(hull_of(OWN), calm, np.arange(0.0, 3600.0, 0.5), seed=3)
    assert 4.0 * places[:, 2].std() == pytest.approx(0.8, rel=0.05)
    assert np.array_equal(rows, swell(hull_of(OWN), rough, Situation(3, G))[0])
    assert not np.array_equal(rows, swell(hull_of(OWN), calm, Situation(4, G))[0])
    seeded = hull_of(OWN | {"swell_seed": 3})
    assert np.array_equal(rows, swell(seeded, calm, Situation(4, G))[0])


def test_its_operators_answer_its_own_waves_as_those_of_a_sea():
    own = hull(swell_height=0.6, swell_period=6.0, swell_spectrum="pierson_moskowitz")
    sea = Sea(height=0.6, period=6.0, spectrum="pierson_moskowitz")
    assert np.array_equal(swell(own, Sea(), Situation(1, G))[0], swell(hull(), sea, Situation(1, G))[0])


def test_both_engines_press_on_a_wall_that_heaves_by_itself_in_still_water():
    wall = SHIP | {"swell_height": 0.5, "swell_period": 4.0}
    scenario = Scenario.load("push_wall", PRESSED | {"sea.height": 0.0, "walls": [wall]})
    free, mujoco = (simulate(scenario, engine=engine) for engine in ("free_body", "mujoco"))
    assert free.push.max() > 1.0
    np.testing.assert_allclose(free.push, mujoco.push, atol=1e-6 * free.push.max())
    assert not any("have no effect" in note for note in free.notes)


@pytest.mark.parametrize(
    ("wall", "said"),
    [
        ({"swell_height": 0.0, "swell_seed": 2}, "which it has with swell_height"),
        ({"swell_height": 0.5, "swell_period": 0.1, "swell_spectrum": "jonswap"}, "walls[0].swell_period"),
        ({"swell_height": 0.5, "heave": [[2.0, 1.0, 0.0], [3.0, 1.0, 0.0]]}, "the wall has waves from"),
    ],
)
def test_waves_of_a_wall_that_are_none_are_refused(wall, said):
    given = {"shape": "plane", "position": [1.4, 0.0, 0.0]} | wall
    with pytest.raises(InputError) as raised:
        Simulation(Scenario.load("push_wall", NO_WALL | {"simulation.timestep": 2e-3, "walls": [given]}))
    assert said in str(raised.value)


def hull_of(keys):
    return Surface(**{key: tuple(value) if isinstance(value, list) else value for key, value in keys.items()})
