"""The reference along a wall of any shape: on it, at its speed, along its normal; and with a wall that moves."""

import functools
import itertools
from typing import Any

import numpy as np
import pytest

from uvms_mj import InputError, Scenario, Simulation, simulate
from uvms_mj.guidance.base import samples
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.physics.kernels import record_of
from uvms_mj.physics.surfaces import SURFACE, move, signed_distance
from uvms_mj.setup.base import set_up

BUMPER = {"position": [0.25, 0.0, 0.0], "radius": 0.04, "stiffness": 2e3, "damping": 20.0}
REACH = 0.29
WALLS: dict[str, tuple[dict, list]] = {
    "plane": ({"position": [1.3, 0.0, 0.0], "attitude_deg": [0, 20, 15]}, [[1.3, -0.3, 0], [1.3, 0.4, 0.2]]),
    "cylinder": ({"position": [1.6, 0, 0], "radius": 0.4}, [[1.3, -0.3, 0], [1.2, 0.1, 0.2], [1.4, 0.4, 0.3]]),
    "sphere": ({"position": [1.6, 0, 0], "radius": 0.4}, [[1.3, -0.3, 0], [1.2, 0.1, 0.2], [1.4, 0.3, 0.2]]),
    "box": ({"position": [1.6, 0, 0], "edges": [0.6, 1.4, 1.2]}, [[1.3, -0.3, 0], [1.3, 0.1, 0.2], [1.3, 0.4, 0.1]]),
    "capsule": ({"position": [1.6, 0, 0], "radius": 0.4, "length": 1.0}, [[1.3, -0.3, 0], [1.4, 0.4, 0.3]]),
}
BASE = {
    "wall.present": False,
    "vehicle.contact_bodies": [BUMPER],
    "current.speed": 0.0,
    "simulation.duration": 40.0,
    "simulation.timestep": 1e-3,
    "reference.name": "along_surface",
    "reference.dwell": 1.37,
}


def scenario(shape: str, wall: dict | None = None, **reference: Any) -> Scenario:
    own, points = WALLS[shape]
    given = {"points": points} | reference
    walls = [{"shape": shape} | own | (wall or {})]
    return Scenario.load("push_wall", BASE | {"walls": walls} | {f"reference.{k}": v for k, v in given.items()})


@functools.cache
def _surface(one: Scenario) -> Any:
    record = np.zeros(1, SURFACE)
    one.walls[0].place(record[0])
    return record_of(record)


def distance(one: Scenario, p: np.ndarray) -> tuple[float, np.ndarray]:
    n = np.zeros(3)
    return signed_distance(_surface(one), np.array(p), n), n


def reference(one: Scenario, times: np.ndarray) -> np.ndarray:
    setup = set_up(one)
    return samples(one.reference, setup, [round(t / one.simulation.timestep) for t in times])


def arrival(one: Scenario) -> tuple[float, float]:
    """The times at which the path along the wall begins and ends [s]."""
    begins = one.reference.constants(set_up(one))["begins"]
    found = begins[np.isfinite(begins)]
    (dwell,) = np.flatnonzero(np.abs(np.diff(found) - one.reference.dwell) < 1e-9)
    return float(found[dwell + 1]), float(found[-1])


@pytest.mark.parametrize("keep_depth", [False, True])
@pytest.mark.parametrize("shape", WALLS)
def test_the_way_is_on_the_wall_at_its_speed_along_the_normal(shape, keep_depth):
    one = scenario(shape, distance=0.05, keep_depth=keep_depth)
    first, last = arrival(one)
    found = reference(one, np.linspace(first, last, 301))
    speeds = np.linalg.norm(found["p_d_dot"], axis=1)
    for p, quat in zip(found["p_d"], found["quat_d"], strict=True):
        d, n = distance(one, p)
        assert d == pytest.approx(REACH + 0.05, abs=1e-9)
        R = rotation_matrix(quat)
        np.testing.assert_allclose(R[:, 0], -n, atol=1e-6)
        assert R[2, 1] == pytest.approx(0.0, abs=1e-6), "y is level"
    middle = (found["p_d"][1:] - found["p_d"][:-1], 0.5 * (found["p_d_dot"][1:] + found["p_d_dot"][:-1]))
    assert np.abs(middle[0] - middle[1] * (last - first) / 300).max() < 1e-4
    cruise = 1.5 * one.reference.speed / one.reference.acceleration
    times = np.linspace(first, last, 301)
    inside = (times > first + cruise) & (times < last - cruise)
    assert inside.sum() > 20
    np.testing.assert_allclose(speeds[inside], one.reference.speed, rtol=1e-6)
    assert speeds.max() < one.reference.speed * (1.0 + 1e-6)
    if keep_depth:
        given = one.reference.points
        assert found["p_d"][0, 2] == pytest.approx(given[0][2], abs=1e-9)
        assert found["p_d"][-1, 2] == pytest.approx(given[-1][2], abs=1e-9)


def test_the_velocities_are_the_derivatives():
    for ride in (False, True):
        wall = {"amplitude": [0.02, 0.01, 0.1], "frequency_hz": 0.2, "pivot": [2.0, 0.5, 1.0]}
        wall |= {"turn_amplitude_deg": [4.0, 3.0, 8.0], "turn_frequency_hz": 0.15, "turn_phase_deg": 30.0}
        one = scenario("sphere", wall, ride=ride)
        h = one.simulation.timestep
        for start in (1.7, 2.5, 6.0, 12.0):
            found = reference(one, start + h * np.arange(5))
            p, v, R = found["p_d"], found["p_d_dot"], rotation_matrix(found["quat_d"])
            np.testing.assert_allclose(v[2], (8 * (p[3] - p[1]) - (p[4] - p[0])) / (12 * h), atol=1e-9)
            np.testing.assert_allclose(found["p_d_ddot"][2], (8 * (v[3] - v[1]) - (v[4] - v[0])) / (12 * h), atol=1e-8)
            R_dot = (8 * (R[3] - R[1]) - (R[4] - R[0])) / (12 * h)
            S = R_dot @ R[2].T
            np.testing.assert_allclose(found["omega_d"][2], [S[2, 1], S[0, 2], S[1, 0]], atol=1e-9)
            w = found["omega_d"]
            np.testing.assert_allclose(
                found["omega_d_dot"][2], (8 * (w[3] - w[1]) - (w[4] - w[0])) / (12 * h), atol=1e-8
            )


@pytest.mark.parametrize("shape", WALLS)
def test_it_rides_on_a_wall_that_moves_and_turns(shape):
    """At each time it is at its distance from the wall as the contacts know it, and looks along its normal there."""
    wall = {"amplitude": [0.02, 0.01, 0.1], "frequency_hz": 0.2, "phase_deg": 50.0, "pivot": [2.0, 0.5, 1.0]}
    wall |= {"turn_amplitude_deg": [4.0, 3.0, 8.0], "turn_frequency_hz": 0.15, "turn_phase_deg": 30.0}
    one, still = scenario(shape, wall, ride=True), scenario(shape)
    first, last = arrival(still)
    times = np.round(np.linspace(first, last, 60), 3)
    found, path = reference(one, times), reference(still, times)
    surface = set_up(one).contacts.records(lambda _: 1.0)[0].view(np.recarray)[0]
    for t, p, quat, p_still in zip(times, found["p_d"], found["quat_d"], path["p_d"], strict=True):
        move(surface, np.zeros(1), t)
        n = np.zeros(3)
        assert signed_distance(surface, p, n) == pytest.approx(REACH, abs=1e-9)
        np.testing.assert_allclose(rotation_matrix(quat)[:, 0], -n, atol=1e-6)
        in_wall = surface.R_start @ surface.R_WS.T @ (p - surface.p_WS) + surface.start_W
        np.testing.assert_allclose(in_wall, p_still, atol=1e-12)
    assert reference(one, np.array([0.0]))["p_d"] == pytest.approx(np.zeros((1, 3)), abs=1e-15), "no jump at the start"


def test_it_rides_on_a_hull_that_follows_the_sea():
    sea = {"sea.height": 0.2, "sea.period": 6.0, "sea.surface": 3.0, "sea.spectrum": "jonswap", "sea.components": 12}
    response = [[0.05, 1.0, 0.0], [30.0, 0.5, -90.0]]
    wall = {"heave": response, "roll": response, "pitch": response, "turns": True, "pivot": [2.0, 0.0, 2.0]}
    one = scenario("cylinder", wall, ride=True).updated(sea)
    setup, times = set_up(one), np.linspace(22.0, 37.0, 30)
    found = samples(one.reference, setup, [round(t / 1e-3) for t in times])
    moved, tilt = setup.swells[0]
    surface = setup.contacts.records(lambda _: 1.0)[0].view(np.recarray)[0]
    surface.swell_rows, surface.tilt, surface.tilt_rows = len(moved), moved.size, len(tilt)
    places = []
    for t, p in zip(times, found["p_d"], strict=True):
        move(surface, np.concatenate([moved.reshape(-1), tilt.reshape(-1)]), round(t / 1e-3) * 1e-3)
        assert signed_distance(surface, p, np.zeros(3)) == pytest.approx(REACH, abs=1e-9)
        places.append(surface.p_WS.copy())
    assert np.ptp(places, axis=0).max() > 0.01


def test_two_bumpers_touch_a_pile_where_the_circles_do():
    """sqrt((R + r)^2 - y^2) + x from the axis."""
    bodies = [BUMPER | {"position": [0.25, y, 0.0]} for y in (0.12, -0.12)]
    one = scenario("cylinder").updated({"vehicle.contact_bodies": bodies})
    away = np.sqrt((0.4 + 0.04) ** 2 - 0.12**2) + 0.25 - 0.4
    assert one.reference.way_of(one).away == pytest.approx(away, abs=1e-13)


def test_the_least_turn_from_an_attitude_needs_no_level_axis():
    """Under a hull, where the normal is vertical: a rotation of x from place to place without a turn about it."""
    hull = {"position": [1.6, 0.0, 0.9], "radius": 0.5, "attitude_deg": [90.0, 0.0, 0.0]}
    points = [[1.2, 0.0, 0.6], [1.6, 0.0, 0.4], [2.0, 0.2, 0.6]]
    with pytest.raises(InputError, match="normal is vertical there"):
        set_up(scenario("cylinder", hull, points=points))
    one = scenario("cylinder", hull, points=points, level=False)
    first, last = arrival(one)
    found = reference(one, np.linspace(first, last, 200))
    for p, quat, omega in zip(found["p_d"], found["quat_d"], found["omega_d"], strict=True):
        d, n = distance(one, p)
        assert d == pytest.approx(REACH, abs=1e-9)
        np.testing.assert_allclose(rotation_matrix(quat)[:, 0], -n, atol=1e-6)
        assert float(omega @ n) == pytest.approx(0.0, abs=1e-5)
    assert max(abs(distance(one, p)[1][2]) for p in found["p_d"]) > 0.999


def test_stops_have_no_speed_and_the_lines_between_them_are_straight_on_a_plane():
    points = [[1.3, -0.3, 0.0], [1.3, 0.3, 0.0], [1.3, 0.3, -0.2], [1.3, -0.3, -0.2]]
    one = scenario("plane", {"attitude_deg": [0.0, 0.0, 0.0]}, points=points, stop=True)
    first, last = arrival(one)
    found = reference(one, np.linspace(first, last, 2000))
    for a, b in itertools.pairwise(points):
        off = np.linalg.norm(found["p_d"][:, 1:] - b[1:], axis=1)
        assert off.min() < 1e-3
        assert np.linalg.norm(found["p_d_dot"][off.argmin()]) < 0.02
        assert a != b
    inside = (found["p_d"][:, 1:] - [0.3, -0.2]) * [1, 1]
    assert (np.abs(found["p_d"][:, 1]) < 0.3 + 1e-9).all()
    assert (np.minimum(np.abs(inside[:, 1]), np.abs(inside[:, 1] - 0.2)) < 1e-9)[
        np.abs(found["p_d"][:, 1]) < 0.29
    ].all()


EDGE = [[1.3, -0.3, 0.0], [1.3, 0.6, 0.0], [1.4, 0.7, 0.0], [1.8, 0.7, 0.1]]


@pytest.mark.parametrize(
    ("shape", "points"), [("box", EDGE), ("capsule", [[1.2, 0.0, 0.0], [1.2, 0.1, 0.45], [1.3, 0.1, 0.8]])]
)
@pytest.mark.parametrize("stop", [False, True])
def test_a_way_goes_round_an_edge_from_rest_to_rest(shape, points, stop):
    """It is at its distance from the wall, round the edge as well. Where it begins to turn it has no speed, so that the
    angular velocity does not jump: its rate is at most that of the speed over the radius, a/s."""
    one = scenario(shape, points=points, stop=stop, distance=0.1)
    first, last = arrival(one)
    times = np.arange(first, last, 2e-3)
    found = reference(one, times)
    away = one.reference.way_of(one).away
    normals = []
    for p, quat in zip(found["p_d"][::50], found["quat_d"][::50], strict=True):
        d, n = distance(one, p)
        assert d == pytest.approx(REACH + 0.1, abs=1e-7)
        np.testing.assert_allclose(rotation_matrix(quat)[:, 0], -n, atol=1e-4)
        normals.append(n)
    assert np.degrees(np.arccos(normals[0] @ normals[-1])) > 40.0
    step = times[1] - times[0]
    np.testing.assert_allclose(np.diff(found["p_d"], axis=0) / step, found["p_d_dot"][:-1], atol=2e-4)
    sharpest = np.linalg.norm(found["omega_d_dot"], axis=1).max()
    radius = away if shape == "box" else away + 0.4
    along = one.reference.acceleration + one.reference.speed**2 / radius  # and Coriolis' part of a level y
    assert sharpest < 1.1 * along / radius
    if shape == "capsule":  # its middle turns, too
        return
    turns = np.linalg.norm(found["omega_d"], axis=1)
    begins = np.flatnonzero((turns[1:] > 1e-3) & (turns[:-1] <= 1e-3))
    assert len(begins) >= 1
    assert (np.linalg.norm(found["p_d_dot"][begins], axis=1) < 5e-3).all(), "from rest"


def test_a_push_round_an_edge_needs_more_stiffness_across_it_than_its_force_over_the_radius():
    """A ball that is pressed on an edge is as a pencil on its tip, with the stiffness -F/r across."""
    points, K_rot = [[1.3, 0.4, 0.0], [1.3, 0.65, 0.0], [1.35, 0.7, 0.0], [1.6, 0.7, 0.0]], [100.0] * 3
    base = scenario("box", {"stiffness": 1e4, "damping": 200.0}, points=points, push=8.0)
    errors = []
    for K in (0.5 * 8.0 / 0.04, 4.0 * 8.0 / 0.04):
        one = base.updated({"impedance.K_d": [K] * 3 + K_rot, "simulation.duration": 60.0})
        trace = simulate(one, engine="free_body")
        errors.append(np.abs(trace.push[trace.t > arrival(one)[0]] - 8.0).max())
        assert any("slips off the edge of walls[0]" in note for note in trace.notes) == (K < 8.0 / 0.04)
    assert errors[0] > 4.0
    assert errors[1] < 0.4


def test_the_push_is_the_demanded_one_all_along_a_pile():
    """By the depth, and by F_d at the face: 5 N along the local normal, all the way round a quarter of a pile."""
    pile = {"stiffness": 1e4, "damping": 200.0, "radius": 0.4}
    K = [100.0] * 3 + [50.0] * 3
    by_depth = {"reference.push": 5.0, "impedance.K_d": K}
    by_force = {"impedance.F_d": [-5.0 * (1.0 + 100.0 * (1.0 / 1e4 + 1.0 / 2e3)), 0, 0, 0, 0, 0], "impedance.K_d": K}
    for overrides in (by_depth, by_force):
        one = scenario("cylinder", pile, points=[[1.2, 0.0, 0.0], [1.3, 0.3, 0.0], [1.6, 0.4, 0.0]], speed=0.05)
        one = one.updated(overrides | {"simulation.duration": 52.0})
        trace = simulate(one, engine="free_body")
        late = trace.t > arrival(one)[0]
        assert trace.push[late] == pytest.approx(5.0, rel=2e-2)
        assert trace.push[-1] == pytest.approx(5.0, rel=5e-5)
        n = trace.f_contact_W[late] / np.linalg.norm(trace.f_contact_W[late], axis=1)[:, None]
        assert np.ptp(np.degrees(np.arctan2(n[:, 1], -n[:, 0]))) > 20.0
        assert trace.analytic.force == pytest.approx(5.0, rel=1e-9)


def test_a_wall_with_the_reference_on_it_is_pushed_as_one_at_rest():
    """A slow wide heave and roll: riding, the push hardly changes; standing, it does."""
    wall = {"stiffness": 1e4, "damping": 200.0, "amplitude": [0.05, 0.0, 0.0], "frequency_hz": 0.1}
    wall |= {"turn_amplitude_deg": [0.0, 0.0, 5.0], "turn_frequency_hz": 0.05, "pivot": [1.6, 0.0, 0.0]}
    spread = []
    for ride in (False, True):
        one = scenario("cylinder", wall, points=[[1.2, 0.0, 0.0]], push=8.0, ride=ride)
        trace = simulate(one, engine="free_body")
        spread.append(np.ptp(trace.push[trace.t > 20.0]))
    assert spread[0] > 2.0
    assert spread[1] < 0.1 * spread[0]


@pytest.mark.parametrize(
    ("shape", "overrides", "said"),
    [
        ("plane", {"reference.wall": "walls[3]"}, r"none of the scenario's \[\[walls\]\]: walls\[0\]"),
        ("plane", {"reference.wall": "wall"}, "along_wall follows"),
        ("plane", {"reference.points": []}, "has 0 points"),
        ("plane", {"reference.push": 3.0, "reference.distance": 0.1}, "choose one"),
        ("plane", {"reference.ride": True}, "does not move"),
        ("plane", {"vehicle.contact_bodies": []}, "reference.reach: give the distance"),
        ("plane", {"reference.attitude_deg": [0.0, 10.0, 0.0]}, "y is level"),
        ("plane", {"reference.points": [[1.3, 0, 0], [1.3, 0, 0]]}, "is the point before it"),
        ("cylinder", {"reference.points": [[1.2, 0, 0], [1.0, 0, 0]]}, "one place on the wall"),
        ("box", {"reference.points": [[1.3, 0, 0], [1.6, -0.7, 0.0]]}, "edge"),
        ("box", {"reference.points": [[1.3, 0, 0], [1.6, -0.7, 0.0]], "reference.distance": 0.1}, "edge"),
        ("cylinder", {"reference.points": [[1.2, 0, 0], [2.0, 0.0, 0.1]]}, "points between"),
        ("cylinder", {"reference.distance": -0.6}, "in the middle of the wall"),
        ("cylinder", {"reference.points": [[1.6, 0.0, 0.0]]}, "give a point next to its face"),
        ("cylinder", {"vehicle.contact_bodies": [BUMPER | {"position": [-0.25, 0, 0]}]}, "give a body in front"),
        ("sphere", {"reference.points": [[1.6, 0, -0.4]]}, "normal is vertical"),
        ("sphere", {"reference.points": [[1.6, 0, -0.4]], "reference.keep_depth": True}, "level there|not brought"),
        ("cylinder", {"initial.attitude_deg": [0.0, 0.0, 170.0]}, "begin with x towards the wall"),
        (
            "plane",
            {"reference.stop": True, "reference.points": [[1.3, 0.1 * (i % 2), 0.1 * i] for i in range(60)]},
            "legs with stops",
        ),
    ],
)
def test_what_can_not_be_followed_is_refused_in_a_sentence(shape, overrides, said):
    with pytest.raises(InputError, match=said):
        simulate(scenario(shape).updated(overrides), engine="free_body")


def test_ride_on_a_table_of_displacements_is_refused():
    with pytest.raises(InputError, match="its velocity jumps"):
        simulate(scenario("plane", {"motion": [[0, 0, 0, 0], [1, 0.1, 0, 0]]}, ride=True))


def test_a_start_behind_a_pile_is_told():
    one = scenario("cylinder").updated({"initial.position": [2.6, 0.0, 0.0], "initial.attitude_deg": [0, 0, 90.0]})
    notes = list(one.reference.notes(set_up(one)))
    assert any("nearer than the path" in note for note in notes), notes


def test_a_way_that_the_run_cuts_short_is_told():
    one = scenario("cylinder").updated({"simulation.duration": 5.0})
    assert any("ends at 5 s" in note for note in one.reference.notes(set_up(one)))
    assert not list(scenario("sphere").reference.notes(set_up(scenario("sphere"))))


def test_a_reset_moves_the_way_with_the_wall():
    """A changed wall and a changed distance are a new way, as of a new run."""
    wall = {"amplitude": [0.0, 0.0, 0.1], "frequency_hz": 0.2}
    one = scenario("cylinder", wall, ride=True).updated({"simulation.duration": 0.5, "reference.start_time": 0.0})
    changes = {"walls[0].position": [1.7, 0.1, 0.0], "walls[0].amplitude": [0.2, 0.0, 0.1], "reference.distance": 0.1}
    with Simulation(one, engine="free_body") as sim:
        sim.step(100)
        sim.reset(changes)
        sim.step(400)
        found = np.array(sim.signals.p_d)
    with Simulation(one.updated(changes), engine="free_body") as sim:
        sim.step(400)
        np.testing.assert_array_equal(found, sim.signals.p_d)
    with Simulation(one, engine="free_body") as sim:
        sim.step(400)
        assert np.abs(found - sim.signals.p_d).max() > 1e-5
