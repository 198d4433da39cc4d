"""The current in front of a face and around a pile: potential flow, the forces on a vehicle in it, and its rest."""

import cmath

import numpy as np
import pytest

from twin import TwinParameters
from uvms_mj import Current, InputError, Obstacle, Scenario, attach, simulate
from uvms_mj.control.theory.terms import Balance, ThrustMap
from uvms_mj.engine.simulation import Simulation
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.physics.kernels import record_of
from uvms_mj.physics.obstacle import OBSTACLE, turn_aside
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import checked
from uvms_mj.setup.linear_loop import RestingVehicle
from vehicles import load, vehicle_xml

TILTED = rotation_matrix(quat_from_euler_deg(25.0, -40.0, 70.0))
POINT, U, RATE = np.array([0.3, -0.2, 0.5]), np.array([0.4, -0.3, 0.2]), np.array([-0.1, 0.5, 0.3])
FACE, PILE = (0.8, 0.0), (0.0, 0.3)
PLACES = [(0.05, 0.0), (0.2, 0.5), (0.4, -0.75), (1.5, 2.0), (0.3, -1.4), (20.0, 3.0), (1e-3, 0.3)]
"""Places X, Y in front of a face; those beyond 0.3 are outside of the pile, too."""
AROUND = [*((x, y) for x, y in PLACES if np.hypot(x, y) > 0.31), (-0.5, 0.1), (-0.2, -0.4)]
CASES = [(FACE, place) for place in PLACES] + [(PILE, place) for place in AROUND]


def record(size, axes=TILTED):
    n, e, _ = axes.T
    return record_of(np.array([(*size, POINT, n, e)], OBSTACLE))


def at(place, axes=TILTED, axial=0.7):
    return POINT + axes @ np.array([*place, axial])


def motion(size, p_W, u=U, rate=RATE):
    """v (3,), v_dot (3,) and gradient (3, 3) of a current u (3,) that changes by rate (3,)."""
    v, v_dot, gradient = u.copy(), rate.copy(), np.zeros((3, 3))
    turn_aside(record(size), p_W, v, v_dot, gradient)
    return v, v_dot, gradient


def potential(size, p_W, u=U):
    """The real potential of the flow, by complex numbers: its gradient is the velocity."""
    X, Y, axial = TILTED.T @ (p_W - POINT)
    U_n, U_e, U_a = TILTED.T @ u
    Z, (L, a) = complex(X, Y), size
    F = U_n * cmath.sqrt(Z * Z + L * L) - 1j * U_e * Z if L else (U_n - 1j * U_e) * Z + (U_n + 1j * U_e) * a * a / Z
    return F.real + U_a * axial


def slope(function, p, h=1e-3):
    """The gradient of a function of a place, by differences of eighth order."""
    weights = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
    return np.array(
        [sum(w * (function(p + k * h * e) - function(p - k * h * e)) for k, w in weights) / h for e in np.eye(3)]
    )


@pytest.mark.parametrize(("size", "place"), CASES)
def test_the_velocity_is_the_gradient_of_the_potential(size, place):
    p = at(place)
    np.testing.assert_allclose(motion(size, p)[0], slope(lambda q: potential(size, q), p, 1e-4), rtol=0, atol=1e-9)
    np.testing.assert_allclose(motion(size, p)[1], slope(lambda q: potential(size, q, RATE), p, 1e-4), atol=1e-9)
    gradient = motion(size, p)[2]
    by_place = slope(lambda q: motion(size, q)[0], p, 2e-4).T
    np.testing.assert_allclose(gradient, by_place, rtol=0, atol=1e-9)
    assert abs(np.trace(gradient)) < 1e-14  # mass is conserved
    np.testing.assert_allclose(gradient, gradient.T, atol=1e-14)


@pytest.mark.parametrize(("size", "place"), CASES)
def test_the_acceleration_is_that_of_eulers_equation(size, place):
    """Bernoulli: p/rho = -phi_t - v^2/2, whose gradient is minus the water's own acceleration."""
    p = at(place)
    v, v_dot, gradient = motion(size, p)

    def pressure(q):
        here = motion(size, q)[0]
        return -potential(size, q, RATE) - 0.5 * here @ here

    np.testing.assert_allclose(v_dot + gradient @ v, -slope(pressure, p, 1e-4), rtol=0, atol=1e-9)


def test_no_water_crosses_a_face_or_a_pile_and_far_away_the_current_is_as_given():
    for y in (0.0, 0.3, -0.79):
        v = motion(FACE, at((0.0, y)))[0]
        assert TILTED[:, 0] @ v == pytest.approx(0.0, abs=1e-15)
    for angle in np.linspace(0.0, 6.0, 13):
        out = np.array([np.cos(angle), np.sin(angle)])
        v = motion(PILE, at(0.3 * out))[0]
        assert (TILTED[:, :2] @ out) @ v == pytest.approx(0.0, abs=1e-15)
    for size in (FACE, PILE):
        np.testing.assert_allclose(motion(size, at((4e4, 3e4)))[0], U, atol=1e-9)
    assert np.isfinite(motion(FACE, at((0.0, 0.8)))[0]).all()  # at the edge
    assert np.isfinite(motion(PILE, at((0.0, 0.0)))[0]).all()


BASE = {"vehicle.model": "bluerov2_heavy", "controller.name": "impedance", "wall.friction": 0.0}
FACING = {"obstacle.half_width": 1.0}


def in_front_of(half_width, distance, **more):
    """The wrench (6,) of a current of 0.5 m/s at a held vehicle's origin at a distance from a face, and its part by
    the acceleration of the water."""
    reach = set_up(Scenario.load("push_wall", BASE)).plant.probe.radius
    over = {"initial.position": [1.0 + reach - distance, 0.0, 0.0], "reference.target": [1.0, 0.0, 0.0]}
    over |= {"current.direction_deg": 0.0} | more
    if half_width:
        over |= FACING | {"obstacle.half_width": half_width}
    return wrench_at_start(BASE | over)


def wrench_at_start(over):
    setup = set_up(Scenario.load("push_wall", over))
    balance, p = Balance(setup, 0.0, ThrustMap.of(setup)), np.array(setup.scenario.initial.position)
    d, _ = balance.environment(balance.pose(p, np.array([1.0, 0.0, 0.0, 0.0])))
    return d, setup.mean_water.pull(p, np.eye(3))


def test_the_force_on_a_vehicle_in_front_of_a_face_is_the_published_one():
    """Of the project's design numbers: 42.1 N through the wall, and drag of 10.1, 3.7, 0.8 N in front of a face."""
    assert in_front_of(None, 0.25)[0][0] == pytest.approx(42.1, abs=0.05)
    for L, force in ((0.5, 10.1), (1.0, 3.7), (3.0, 0.8)):
        d, pull = in_front_of(L, 0.25)
        assert d[0] - pull[0] == pytest.approx(force, abs=0.05)
        assert pull[0] < 0.0  # the pressure of the stagnation point keeps the vehicle off


def test_the_forces_at_a_pile_are_the_published_ones_with_its_suction():
    reach = set_up(Scenario.load("push_wall", BASE)).plant.probe.radius
    pile = {"shape": "cylinder", "position": [1.25, 0.0, 0.0], "radius": 0.3}
    base = BASE | {"wall.present": False, "walls": [pile], "obstacle.wall": "walls[0]"}
    base |= {"initial.position": [0.7, 0.0, 0.0], "reference.target": [0.95 - reach, 0.0, 0.0]}
    ahead, _ = wrench_at_start(base | {"current.direction_deg": 0.0})
    beside, pull = wrench_at_start(base | {"current.direction_deg": 90.0})
    assert ahead[0] - wrench_at_start(base | {"current.direction_deg": 0.0})[1][0] == pytest.approx(22.0, abs=0.5)
    assert beside[1] == pytest.approx(91.0, abs=0.5)
    assert beside[0] == pull[0] == pytest.approx(6.9, abs=0.05)


SIZES = {"face": FACING | {"obstacle.half_width": 0.5}, "pile": {"obstacle.wall": "walls[0]", "wall.present": False}}
STANDING = {"walls": [{"shape": "cylinder", "position": [1.3, 0.2, 0.0], "radius": 0.3}], "wall.position": 1.1}


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
@pytest.mark.parametrize("kind", SIZES)
def test_a_sphere_without_drag_keeps_its_energy_in_a_flow_that_is_not_uniform(kind, engine, tmp_path):
    """The force (rho V + A) Du/Dt - A dv/dt keeps (m + A) v^2 - (rho V + A) u^2, since the flow is steady and
    Du/Dt = grad(u^2/2). The rate along the path in the place of Du/Dt does not keep it."""
    ball = TwinParameters(r_g=(0.0, 0.0, 0.0), M_A=np.diag([5.0, 5.0, 5.0, 0.1, 0.1, 0.1]))
    file = tmp_path / "ball.xml"
    file.write_text(vehicle_xml(ball))
    over = STANDING | SIZES[kind] | {"vehicle.model": str(file), "controller.name": "external"}
    over |= {"vehicle.linear_damping": 0.0, "vehicle.quadratic_damping": 0.0, "reference.target": [0.5, 0.0, 0.0]}
    over |= {"initial.velocity": [0.4, 0.3, 0.1, 0.0, 0.0, 0.0], "current.direction_deg": 20.0}
    over |= {"simulation.duration": 2.0}
    errors = []
    for h in (4e-3, 2e-3):
        scenario = Scenario.load("push_wall", over | {"simulation.timestep": h})
        setup, energies = set_up(scenario), []
        m, A, d = setup.vehicle.mass, setup.vehicle.M_A[0, 0], setup.vehicle.displaced_mass
        with Simulation(scenario, engine=engine) as sim:
            for _ in range(2):
                u, v = setup.mean_water.flow(sim.signals.p_WB), sim.signals.nu[:3]
                energies.append(0.5 * (m + A) * v @ v - 0.5 * (d + A) * u @ u)
                sim.step(round(1.6 / h))
        errors.append(abs(energies[1] - energies[0]) / (0.5 * (m + A) * v @ v))
    assert errors[1] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.25)  # semi-implicit Euler is of first order


@pytest.mark.parametrize("law", ["impedance", "gsta", "ideal"])
@pytest.mark.parametrize("kind", SIZES)
def test_the_rest_in_closed_form_is_that_of_the_run_in_both_engines(kind, law):
    over = STANDING | SIZES[kind] | {"controller.name": law, "simulation.duration": 25.0, "current.direction_deg": 15.0}
    over |= {"simulation.timestep": 1e-3, "wall.stiffness": 1e4, "reference.target": [1.15, 0.1, 0.0]}
    first, second = (simulate(Scenario.load("push_wall", over), engine=each) for each in ("free_body", "mujoco"))
    np.testing.assert_allclose(first.p_WB[-1], second.p_WB[-1], atol=1e-6)
    closed = first.analytic
    assert closed.force > 0.5
    assert first.push[first.t > 24.5].mean() == pytest.approx(closed.force, rel=1e-4)
    rows = first.t > 1.0
    np.testing.assert_array_equal(first.v_c_dot_W[rows], first.a_c_W[rows])


def test_slopes_of_the_loop_about_a_rest_have_the_gradient_of_the_flow():
    over = STANDING | SIZES["face"] | {"controller.name": "impedance", "wall.stiffness": 1e4, "wall.damping": 50.0}
    setup = set_up(Scenario.load("push_wall", over))
    rest = setup.scenario.controller.at_rest(setup)
    loop = RestingVehicle(setup, rest)
    found = (setup.vehicle.M @ loop.acceleration_by_state - loop.contact_by_state)[:, :3]
    balance, h = Balance(setup, 0.0, ThrustMap.of(setup)), 1e-5

    def by_water(k):
        poses = (balance.pose(np.asarray(rest.position) + s * h * np.eye(3)[k], np.asarray(rest.quat)) for s in (1, -1))
        ahead, behind = (balance.environment(pose)[0] for pose in poses)
        return (ahead - behind) / (2.0 * h)

    np.testing.assert_allclose(found, np.column_stack([by_water(k) for k in range(3)]), atol=1e-4)
    assert np.abs(found).max() > 1.0


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ({"obstacle.wall": "walls[3]"}, r"obstacle.wall: 'walls\[3\]' is no wall of the scenario: wall"),
        ({"obstacle.wall": "wall"}, "obstacle.half_width: a plane needs it"),
        (FACING | {"current.shear": [[0.0, 1.0], [5.0, 0.5]]}, "a sheared current about it is not computed"),
        (FACING | {"current.direction_deg": 180.0}, "the vehicle begins in the lee of the face, where the current has"),
        (FACING | {"initial.position": [0.0, 1.2, 0.0]}, "the vehicle begins beside the face, 1.2 m from its middle"),
        (FACING | {"vehicle.model": "bluerov2_alpha5"}, "not computed at the links of an arm"),
        (
            {"walls": [{"shape": "box", "position": [2.0, 0.0, 0.0], "edges": [1.0, 1.0, 1.0]}]}
            | {"obstacle.wall": "walls[0]"},
            "the flow around a box is not computed",
        ),
        (
            {"walls": [{"shape": "cylinder", "position": [-1.0, 0.0, 0.0], "radius": 0.2}]}
            | {"obstacle.wall": "walls[0]", "current.direction_deg": 0.0},
            "the vehicle begins behind the pile, where the current has a wake",
        ),
        (
            STANDING
            | {"obstacle.wall": "walls[0]", "walls[0].amplitude": [0.1, 0.0, 0.0], "walls[0].frequency_hz": 0.1},
            "moves; the flow is that about a wall at rest",
        ),
        (STANDING | {"obstacle.wall": "walls[0]", "obstacle.half_width": 1.0}, "a cylinder has its radius"),
    ],
)
def test_what_is_not_computed_is_refused_in_a_sentence(over, message):
    over = {"current.direction_deg": 30.0} | over
    more = {key: over.pop(key) for key in [*over] if key.startswith("walls[")}
    scenario = Scenario.load("push_wall", over).updated(more)
    with pytest.raises(InputError, match=message):
        checked(scenario)


def test_attach_has_no_walls_and_says_so():
    _, model, data = TwinParameters(), *load(TwinParameters())
    with pytest.raises(InputError, match=r"attach: obstacle\.wall: 'wall' is no wall of the scenario: there is none"):
        attach(model, data, current=Current(speed=0.3), obstacle=Obstacle(half_width=1.0))
