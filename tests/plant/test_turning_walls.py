"""Walls that turn: the motion of a rigid body, force and power of a contact, and runs of both engines."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pressed import PUSH, M
from uvms_mj import Controller, InputError, Scenario, Sea, gain, simulate
from uvms_mj.control.base import NoClosedForm
from uvms_mj.physics.contacts import PAIR, pair_force
from uvms_mj.physics.surfaces import SHAPES, SURFACE, move, quaternion_of, signed_distance, surface_velocity
from uvms_mj.plant.hull import swell
from uvms_mj.plant.settings import Situation, Surface
from uvms_mj.setup.base import set_up

REACH = set_up(Scenario()).plant.geometry.reach
SIZES = {"radius": 0.4, "length": 0.6, "edges": (0.5, 0.7, 0.6)}
NO_NUMBERS = np.zeros(1)


@dataclasses.dataclass(frozen=True)
class Push(Controller):
    """A constant push along x with damping, and attitude control."""

    damping: float = gain(100.0, "N s/m", "along x")

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = 0.0
        tau_cmd[0] = 7.5 - gains.damping * signals.nu[0]
        for i in range(3, 6):
            tau_cmd[i] = -2000.0 * signals.eta_e[i] - 40.0 * signals.nu[i]


def turning(shape: str = "plane", **keys: Any) -> Any:
    """The SURFACE record of a wall that turns and shakes."""
    sizes = {key: SIZES[key] for key in SHAPES[shape].keys}
    given = {"turn_amplitude_deg": (12.0, -20.0, 30.0), "turn_frequency_hz": 0.7, "turn_phase_deg": 40.0}
    given |= {"amplitude": (0.05, -0.02, 0.1), "frequency_hz": 0.45, "phase_deg": 15.0, "pivot": (0.4, -0.3, 0.2)}
    given |= {"position": (1.0, 0.2, -0.3), "attitude_deg": (20.0, -30.0, 50.0)}
    wall = Surface(shape=shape, **sizes, **(given | keys))
    contacts = set_up(Scenario.load("push_wall", {"wall.present": False, "walls": [wall]})).contacts
    return contacts.records(lambda _: 1.0)[0].view(np.recarray)[0]


@pytest.mark.parametrize("size", [0.0, 1e-5, 0.17, 0.1733, 1.5])
def test_the_quaternion_of_a_rotation_vector_and_its_derivatives(size):
    """Against SciPy's rotations and differences of them, below and above the end of the series."""
    theta, rate, growth = size * np.array([0.48, -0.6, 0.64]), np.array([0.3, 0.5, -0.2]), np.array([-0.7, 0.4, 0.9])

    def Q(t: float) -> np.ndarray:
        x, y, z, w = Rotation.from_rotvec(theta + t * rate + 0.5 * t * t * growth).as_quat()
        return np.array([w, x, y, z])

    found, h = np.zeros((3, 4)), 1e-3
    quaternion_of(theta, rate, growth, *found)
    before_2, before, now, after, after_2 = (Q(k * h) for k in (-2, -1, 0, 1, 2))
    np.testing.assert_allclose(found[0], now, atol=1e-15)
    np.testing.assert_allclose(found[1], (8.0 * (after - before) - (after_2 - before_2)) / (12.0 * h), atol=1e-11)
    second = (16.0 * (after + before) - (after_2 + before_2) - 30.0 * now) / (12.0 * h * h)
    np.testing.assert_allclose(found[2], second, atol=2e-9)


def test_the_wall_moves_as_a_rigid_body_about_its_pivot():
    """Points of the body keep their distances, and their velocities are the differences of their places."""
    wall, h = turning(), 1e-6
    R_0, points = wall.R_start.copy(), np.random.default_rng(1).normal(size=(5, 3))

    def places(t: float) -> np.ndarray:
        move(wall, NO_NUMBERS, t)
        return wall.p_WS + (points - wall.start_W) @ R_0 @ wall.R_WS.T

    for t in (0.0, 0.3, 1.1):
        late, early, here, speed = places(t + h), places(t - h), places(t), np.zeros(3)
        for x, rate in zip(here, (late - early) / (2.0 * h), strict=True):
            surface_velocity(wall, x, speed)
            np.testing.assert_allclose(speed, rate, atol=1e-9)
        apart, apart_0 = (np.linalg.norm(each[:, None] - each[None], axis=2) for each in (here, points))
        np.testing.assert_allclose(apart, apart_0, atol=1e-14)
        theta = np.radians([12.0, -20.0, 30.0]) * math.sin(2.0 * np.pi * 0.7 * t + math.radians(40.0))
        np.testing.assert_allclose(wall.R_WS, Rotation.from_rotvec(theta).as_matrix() @ R_0, atol=1e-15)
        shift = np.array([0.05, -0.02, 0.1]) * math.sin(2.0 * np.pi * 0.45 * t + math.radians(15.0))
        pivot = places(t)[0] + Rotation.from_rotvec(theta).apply(np.array([0.4, -0.3, 0.2]) - points[0])
        np.testing.assert_allclose(pivot, np.array([0.4, -0.3, 0.2]) + shift, atol=1e-15)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_damper_feels_the_rate_of_the_distance(shape):
    """A body that stands still in a wall that turns: F = k delta - b d_dot, with d_dot as a difference of distances."""
    wall, h, k, b = turning(shape), 1e-6, 1e3, 1e4
    move(wall, NO_NUMBERS, 0.4)
    n = np.zeros(3)
    c = wall.p_WS + wall.R_WS @ np.array([-0.05, 0.31, 0.62] if shape == "capsule" else [-0.3, 0.1, 0.2])
    c = c - (signed_distance(wall, c, n) - 0.03) * n  # 2 cm deep for a radius of 5 cm

    def d(t: float) -> float:
        move(wall, NO_NUMBERS, t)
        return signed_distance(wall, c, n)

    rate = (d(0.4 + h) - d(0.4 - h)) / (2.0 * h)
    depth, contact = 0.05 - d(0.4), np.zeros(1, PAIR).view(np.recarray)[0]
    contact.contact.stiffness, contact.contact.damping, contact.layer_depth, contact.radius = k, b, np.inf, 0.05
    pair_force(contact, wall, c, np.eye(3), np.zeros(6), 1e-4)
    assert depth == pytest.approx(0.02, abs=1e-12)
    assert abs(b * rate) > 100.0
    assert contact.f_n == pytest.approx(max(0.0, k * depth - b * rate), abs=1e-4)


def test_the_power_of_a_turning_wall_is_what_its_spring_takes():
    """Of a body that stands still: -F v at the contact point, over the time, is the spring's energy k delta^2/2."""
    wall, k, h = turning("cylinder"), 1e3, 4e-4
    contact = np.zeros(1, PAIR).view(np.recarray)[0]
    contact.contact.stiffness, contact.layer_depth, contact.radius = k, np.inf, 0.6
    move(wall, NO_NUMBERS, 0.0)
    c, power, energy, speed = wall.p_WS + wall.R_WS @ [0.45, 0.3, 0.1], [], [], np.zeros(3)
    for i in range(2001):
        move(wall, NO_NUMBERS, h * i)
        pair_force(contact, wall, c, np.eye(3), np.zeros(6), h)
        surface_velocity(wall, c + contact.contact.arm_W, speed)
        power.append(speed @ contact.contact.f_W)
        energy.append(0.5 * k * contact.depth**2)
    work = np.concatenate([[0.0], np.cumsum(0.5 * h * (np.array(power[1:]) + power[:-1]))])
    assert min(energy) == 0.0, "the wall leaves the body, and comes back"
    assert np.ptp(energy) > 1.0
    np.testing.assert_allclose(work, np.array(energy) - energy[0], atol=1e-5 * np.ptp(energy))


def test_friction_turns_with_the_wall():
    """Wall and body turn together about the normal, stuck: in the wall's frame the friction stays."""
    wall, h = turning(amplitude=(0.0,) * 3, frequency_hz=0.0, phase_deg=0.0, attitude_deg=(0.0,) * 3), 1e-3
    wall.turn_W[:], wall.turn_frequency, wall.turn_phase, wall.pivot[:] = (1.2, 0.0, 0.0), 0.25, 0.0, wall.start_W
    contact = np.zeros(1, PAIR).view(np.recarray)[0]
    settings, forces = contact.contact, []
    settings.stiffness, settings.friction, settings.tangential_stiffness = 1e4, 10.0, 1e3
    contact.layer_depth, contact.radius = np.inf, 0.1
    for i in range(1001):
        move(wall, NO_NUMBERS, h * i)
        nu = np.concatenate([np.zeros(3), wall.omega_W])
        pair_force(contact, wall, wall.p_WS - [0.09, 0.0, 0.0], np.eye(3), nu, h)
        if i == 0:
            settings.stretch_W[:] = (0.0, 1e-3, 2e-3)
        elif i > 0:
            forces.append(wall.R_WS.T @ settings.f_tangential_W)
    assert np.linalg.norm(forces[0]) == pytest.approx(1e3 * math.hypot(1e-3, 2e-3), rel=1e-12)
    sizes = np.linalg.norm(forces, axis=1)
    np.testing.assert_allclose(sizes, sizes[0], rtol=1e-12)
    assert np.abs(np.subtract(forces, forces[0])).max() < 2e-3 * sizes[0]  # of first order in the step


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_plate_that_turns_by_a_small_angle_pushes_as_one_that_shakes(slippery, engine):
    """The plate turns about a pivot 2 m above the contact by 5e-4 rad: there its face moves by 1 mm, and the push is
    the response of vehicle and springs, exact for symplectic Euler."""
    k, b, d, angle, lever, f, h = 2e4, 150.0, 100.0, 5e-4, 2.0, 0.8, 1e-4
    start = PUSH / k
    wall = {"shape": "plane", "position": [REACH, 0.0, 0.0], "stiffness": k, "damping": b, "pivot": [REACH, 0.0, lever]}
    wall |= {"turn_amplitude_deg": [0.0, -math.degrees(angle), 0.0], "turn_frequency_hz": f, "turn_phase_deg": 90.0}
    overrides = {"vehicle.model": str(slippery), "wall.present": False, "initial.position": [start, 0.0, 0.0]}
    overrides |= {"simulation.duration": 5.0, "walls": [wall], "current.speed": 0.0}
    trace = simulate(Scenario.load("push_wall", overrides), Push(damping=d), log_rate="full", engine=engine)
    s, a = 2j * np.pi * f, angle * lever
    z = np.exp(s * h)
    mobility = z * h / (z - 1.0)
    V = (k * a + b * s * a) / (M[0] * (z - 1.0) / h + d + b + k * mobility)
    X, late = mobility * V, trace.t > 3.0
    force = PUSH + ((k * (X - a) + b * (V - s * a)) * np.exp(s * trace.t[late])).real
    assert np.ptp(force) > 0.1
    assert np.abs(trace.push[late] - force).max() < 2e-3 * np.ptp(force)
    assert isinstance(trace.analytic, NoClosedForm)


def test_both_engines_press_on_the_same_turning_box():
    wall = {"shape": "box", "position": [1.55, 0.0, 0.0], "edges": [0.5, 1.0, 1.0], "stiffness": 1e4, "damping": 100.0}
    wall |= {"friction": 0.3, "turn_amplitude_deg": [3.0, 4.0, 6.0], "turn_frequency_hz": 0.6, "turn_phase_deg": 50.0}
    overrides = {
        "wall.present": False,
        "walls": [wall],
        "simulation.duration": 3.0,
        "reference.target": [1.1, 0.0, 0.0],
    }
    scenario = Scenario.load("push_wall", overrides | {"initial.position": [0.95, 0.0, 0.0]})
    free, mujoco = (simulate(scenario, engine=engine) for engine in ("free_body", "mujoco"))
    assert free.push.max() > 1.0
    np.testing.assert_allclose(free.p_WB, mujoco.p_WB, atol=1e-7)
    np.testing.assert_allclose(free.push, mujoco.push, atol=2e-3)


HULL = {
    "shape": "plane",
    "position": (1.4, 0.3, -0.2),
    "pivot": (4.0, -1.0, 1.5),
    "heading_deg": 25.0,
    "heave": ((0.1, 1.0, 0.0), (20.0, 0.5, -90.0)),
    "roll": ((0.1, 1.0, 90.0), (1.5, 6.0, 40.0), (20.0, 0.0, 0.0)),
    "pitch": ((0.1, 2.0, -90.0), (1.5, 4.0, -130.0), (20.0, 0.0, 0.0)),
}


def test_a_hull_turns_with_its_roll_and_pitch():
    """Its place differs from the place of a hull that does not turn by the square of the angles, and its normal turns
    by the angles to first order."""
    errors, turns = [], []
    for height in (0.2, 0.1):
        sea, found = Sea(height=height, period=5.0), []
        for turned in (False, True):
            wall, surface = Surface(**HULL, turns=turned), np.zeros(1, SURFACE)
            moved, tilt = swell(wall, sea, Situation(0, 9.81))
            wall.place(surface[0])
            surface["turns"], surface["swell_rows"], surface["tilt_rows"] = turned, len(moved), len(tilt)
            surface["tilt"] = moved.size
            surface, numbers = surface.view(np.recarray)[0], np.concatenate([moved.reshape(-1), tilt.reshape(-1)])
            for t in np.linspace(0.0, 5.0, 21):
                move(surface, numbers, t)
                found.append((surface.p_WS.copy(), surface.R_WS.copy()))
        (still, turned), rows = (found[:21], found[21:]), tilt
        errors.append(max(np.abs(a[0] - b[0]).max() for a, b in zip(still, turned, strict=True)))
        for t, (_, R) in zip(np.linspace(0.0, 5.0, 21), turned, strict=True):
            angles = sum(c * math.cos(o * t) + s * math.sin(o * t) for o, c, s in ((r[0], r[1:4], r[4:]) for r in rows))
            turns.append(np.abs(R - Rotation.from_rotvec(angles).as_matrix()).max())
        assert all((np.eye(3) == R).all() for _, R in still)
    assert 1e-9 < errors[0] < 1e-3
    assert errors[1] == pytest.approx(0.25 * errors[0], rel=2e-2)
    assert max(turns) < 1e-14


def test_a_hull_that_turns_is_the_same_in_both_engines():
    hull = {key: list(map(list, v)) if key in ("heave", "roll", "pitch") else v for key, v in HULL.items()}
    hull |= {"position": [1.3, 0.0, 0.0], "stiffness": 1e4, "damping": 100.0, "turns": True}
    overrides = {
        "wall.present": False,
        "walls": [hull],
        "simulation.duration": 3.0,
        "reference.target": [1.1, 0.0, 0.0],
    }
    overrides |= {"sea.height": 0.1, "sea.period": 5.0, "sea.surface": 3.0, "initial.position": [0.95, 0.0, 0.0]}
    scenario = Scenario.load("push_wall", overrides)
    free, mujoco = (simulate(scenario, engine=engine) for engine in ("free_body", "mujoco"))
    other = simulate(scenario.updated({"walls[0].turns": False}), engine="free_body")
    assert free.push.max() > 1.0
    np.testing.assert_allclose(free.p_WB, mujoco.p_WB, atol=1e-7)
    assert np.abs(free.push - other.push).max() > 1e-3


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"turn_amplitude_deg": [1.0, 0.0, 0.0]}, "turn_amplitude_deg needs turn_frequency_hz"),
        ({"turn_frequency_hz": 1.0}, "turn_frequency_hz needs turn_amplitude_deg"),
        ({"turn_phase_deg": 90.0}, "turn_phase_deg needs turn_amplitude_deg"),
        ({"phase_deg": 90.0}, "phase_deg needs amplitude"),
        ({"turns": True}, "turns needs roll or pitch"),
        ({"turn_amplitude_deg": [80.0, 80.0, 0.0], "turn_frequency_hz": 1.0}, "at most 90 deg"),
        ({"turn_amplitude_deg": [0.0, 0.0, 120.0], "turn_frequency_hz": 1.0}, "90"),
    ],
)
def test_what_does_not_belong_together_is_refused(keys, said):
    with pytest.raises(InputError, match=said):
        Scenario.load("push_wall", {"walls": [{"shape": "plane", "position": [1.3, 0, 0]} | keys]})
