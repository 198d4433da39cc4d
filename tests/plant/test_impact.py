"""Contacts with restitution and friction with breakaway: impacts by theory, energy, rests, and both engines."""

import numpy as np
import pytest
from scipy.optimize import brentq

from twin import TwinParameters
from uvms_mj import InputError, Scenario, simulate
from uvms_mj.engine.simulation import Simulation
from uvms_mj.physics.contacts import CONTACT, press
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.physics.kernels import record_of
from uvms_mj.plant.impact import dissipation_of, restitution_of, stiffness_of_hertz
from uvms_mj.setup.base import set_up
from vehicles import vehicle_xml

PLANE = {"shape": "plane", "position": [0.2, 0.0, 0.0]}
KINDS = {
    "hunt_crossley": PLANE | {"contact": "hunt_crossley", "stiffness": 2e4},
    "hertz": PLANE | {"contact": "hertz", "modulus": 1.5e5},
    "hertz on a sphere": PLANE
    | {"shape": "sphere", "radius": 0.2, "position": [0.4, 0.0, 0.0], "contact": "hertz", "modulus": 1.5e5},
}
SPHERE = 0.1


@pytest.fixture
def ball(tmp_path):
    """A neutral body without drag, whose mass is the same in all directions, with a sphere about its middle."""
    file = tmp_path / "ball.xml"
    file.write_text(vehicle_xml(TwinParameters(r_g=(0.0, 0.0, 0.0), M_A=np.diag([5.0, 5.0, 5.0, 0.1, 0.1, 0.1]))))
    over = {"vehicle.model": str(file), "controller.name": "external", "current.speed": 0.0, "wall.present": False}
    over |= {"vehicle.linear_damping": 0.0, "vehicle.quadratic_damping": 0.0}
    return over | {"vehicle.contact_bodies": [{"position": [0.0, 0.0, 0.0], "radius": SPHERE}]}


def thrown(scenario, engine="free_body", every=0):
    """p_WB (3,) and nu (6,) at the end of a run without a law, and the push at each instant, or none of them."""
    with Simulation(scenario, engine=engine) as sim:
        push = []
        for _ in range(scenario.steps if every else 1):
            sim.step(every or scenario.steps)
            push.append(float(np.sum(sim.signals.f_normal)))
        return sim.signals.p_WB.copy(), sim.signals.nu.copy(), np.array(push)


def energy(setup, nu):
    return 0.5 * nu @ setup.vehicle.M @ nu


def test_the_restitution_of_the_equation_is_that_of_its_integral():
    """The impact is integrated over time, by an integrator of high order that shares nothing with the plant."""
    from scipy.integrate import solve_ivp

    for power, k, m in ((1.0, 2e4, 3.0), (1.5, 5e5, 12.0)):
        a, speed = dissipation_of(0.6, 0.4), 0.4

        def motion(t, y, k=k, m=m, a=a, power=power):
            return [y[1], -k * max(y[0], 0.0) ** power * (1.0 + a * y[1]) / m]

        def out(t, y):
            return y[0] + 1e-12 if t > 1e-4 else 1.0

        out.terminal = True
        found = solve_ivp(motion, (0.0, 10.0), [0.0, speed], events=out, rtol=1e-11, atol=1e-14)
        assert -found.y[1, -1] / speed == pytest.approx(0.6, abs=1e-6)
        assert restitution_of(a, speed) == pytest.approx(0.6, abs=1e-12)
    assert dissipation_of(1.0, 0.1) == 0.0
    assert restitution_of(1e-9, 1.0) == pytest.approx(1.0 - 2e-9 / 3.0, abs=1e-15)


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
@pytest.mark.parametrize("kind", KINDS)
def test_restitution_over_speed_is_that_of_theory(kind, engine, ball):
    wall = KINDS[kind] | {"restitution": 0.7, "restitution_speed": 0.2}
    a = dissipation_of(0.7, 0.2)
    for speed in (0.02, 0.2, 0.8):
        over = ball | {"walls": [wall], "initial.velocity": [speed, 0.0, 0.0, 0.0, 0.0, 0.0]}
        over |= {"simulation.timestep": 1e-4, "simulation.duration": 0.12 / speed + 0.6}
        _, nu, _ = thrown(Scenario.load("push_wall", over), engine)
        assert -nu[0] / speed == pytest.approx(restitution_of(a, speed), rel=0.01)


def test_four_hundred_throws_gain_no_energy(ball):
    rng = np.random.default_rng(4)
    bodies = [{"position": p, "radius": 0.06} for p in ([0.05, 0.08, 0.0], [0.05, -0.08, 0.03], [0.0, 0.0, -0.1])]
    touched = 0
    for kind in ("hunt_crossley", "hertz"):
        wall = KINDS[kind] | {"friction": 0.3, "breakaway_friction": 0.5, "tangential_stiffness": 1e4}
        over = ball | {
            "vehicle.contact_bodies": bodies,
            "walls": [wall | {"restitution": 0.8, "restitution_speed": 0.3}],
        }
        scenario = Scenario.load("push_wall", over | {"simulation.timestep": 5e-4, "simulation.duration": 3.0})
        setup = set_up(scenario)
        with Simulation(scenario, engine="free_body") as sim:
            for _ in range(200):
                v_W, angles = rng.uniform([0.1, -0.3, -0.3], [0.6, 0.3, 0.3]), rng.uniform(-180.0, 180.0, 3)
                v = rotation_matrix(quat_from_euler_deg(*angles)).T @ v_W
                nu = np.concatenate([v, rng.uniform(-1.5, 1.5, 3)])
                start = {"initial.velocity": nu.tolist(), "initial.attitude_deg": angles.tolist()}
                sim.reset(start | {"walls[0].restitution": float(rng.uniform(0.5, 0.98))})
                before = energy(setup, sim.signals.nu)
                sim.step(4000)
                assert energy(setup, sim.signals.nu) <= before * (1.0 + 1e-12)
                touched += sim.signals.touches > 0.0
    assert touched > 320


@pytest.mark.parametrize("kind", KINDS)
def test_the_force_has_no_jump_at_the_touch(kind, ball):
    """A damper has the force b v at once; here the force grows from zero as the depth does."""
    over = ball | {"simulation.timestep": 1e-4, "simulation.duration": 0.5}
    over |= {"initial.velocity": [0.5, 0.0, 0.0, 0.0, 0.0, 0.0]}
    walls = KINDS[kind] | {"restitution": 0.5}, PLANE | {"stiffness": 2e4, "damping": 200.0}
    pushes = [thrown(Scenario.load("push_wall", over | {"walls": [wall]}), every=1)[2] for wall in walls]
    first = [push[np.argmax(push > 0.0)] for push in pushes]
    assert first[0] < 0.03 * pushes[0].max()
    assert first[1] > 0.9 * 200.0 * 0.5


@pytest.mark.parametrize("law", ["impedance", "gsta"])
@pytest.mark.parametrize("kind", ["hunt_crossley", "hertz"])
def test_the_rest_is_the_root_of_force_and_stiffness_and_the_runs(kind, law):
    over = {"wall.present": False, "walls": [KINDS[kind] | {"position": [1.2285, 0.0, 0.0], "restitution": 0.5}]}
    over |= {"controller.name": law, "current.speed": 0.0, "simulation.duration": 25.0, "simulation.timestep": 1e-3}
    over |= {"reference.target": [1.1, 0.0, 0.0]}
    scenario = Scenario.load("push_wall", over)
    trace, other = (simulate(scenario, engine=each) for each in ("free_body", "mujoco"))
    setup = set_up(scenario)
    radius, wall = setup.plant.probe.radius, scenario.walls[0]
    k, n = wall.stiffness_on(radius), wall.power
    K, free = scenario.impedance.K_d[0], 1.1 - (1.2285 - radius)
    depth = brentq(lambda x: k * x**n - K * (free - x), 0.0, free, xtol=1e-15)
    assert trace.analytic.force == pytest.approx(k * depth**n, rel=1e-9)
    assert trace.push[trace.t > 24.5].mean() == pytest.approx(k * depth**n, rel=1e-5)
    np.testing.assert_allclose(trace.p_WB, other.p_WB, atol=1e-7)


def test_hertz_is_four_thirds_of_the_modulus_and_two_spheres_are_softer():
    assert stiffness_of_hertz(3e6, 0.04, None) == pytest.approx(4.0 / 3.0 * 3e6 * 0.2)
    assert stiffness_of_hertz(3e6, 0.08, 0.08) == pytest.approx(stiffness_of_hertz(3e6, 0.04, None))


def test_a_contact_breaks_away_at_the_larger_coefficient_and_slides_at_the_smaller():
    contact = record_of(np.zeros(1, CONTACT))
    contact.friction, contact.breakaway, contact.tangential_stiffness = 0.3, 0.2, 1e4
    contact.normal_W[:] = [-1.0, 0.0, 0.0]
    h, pulled = 1e-4, []
    for k in range(400):
        v = 0.05 if k < 200 else 0.0 if k < 220 else 0.05  # drawn, at rest, drawn again
        press(contact, 10.0, np.array([0.0, v, 0.0]), np.eye(3), h)
        pulled.append(-contact.f_tangential_W[1])
    assert 4.9 < max(pulled) <= 5.0
    assert pulled[199] == pytest.approx(3.0)
    assert max(pulled[221:]) > 4.9  # it has stuck again
    assert pulled[-1] == pytest.approx(3.0)


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_breakaway_in_a_run(engine, ball):
    """A steady push along the face below breakaway and above friction: it stays, and slides without breakaway."""
    over = ball | {"walls": [PLANE | {"stiffness": 2e4, "friction": 0.3, "tangential_stiffness": 2e4}]}
    over |= {"simulation.duration": 4.0, "simulation.timestep": 1e-3, "initial.position": [0.1, 0.0, 0.0]}
    feet = [[0.0, 0.2, 0.0], [0.0, -0.2, 0.0], [0.0, 0.0, 0.2], [0.0, 0.0, -0.2]]
    over |= {"vehicle.contact_bodies": [{"position": place, "radius": SPHERE} for place in feet]}
    over |= {"disturbance.table": [[0.0] * 7, [1.0, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0], [2.0, 20.0, 8.0, *[0.0] * 4]]}
    moved = []
    for breakaway in (0.5, None):
        scenario = Scenario.load("push_wall", over | {"walls": [over["walls"][0] | {"breakaway_friction": breakaway}]})
        moved.append(thrown(scenario, engine)[0][1])
    assert abs(moved[0]) < 0.001
    assert moved[1] > 0.1


@pytest.mark.parametrize(
    ("wall", "message"),
    [
        ({"restitution": 0.5}, "restitution belongs to contact = 'hunt_crossley' or 'hertz'"),
        (
            {"contact": "hunt_crossley", "damping": 3.0},
            "a hunt_crossley contact has restitution in the place of damping",
        ),
        ({"contact": "hertz"}, "a hertz contact needs modulus"),
        ({"contact": "hunt_crossley", "modulus": 1e6}, "a hunt_crossley contact has no modulus"),
        ({"contact": "hertz", "modulus": 1e6, "shape": "cylinder", "radius": 0.2}, "with a cylinder is not computed"),
        ({"contact": "hertz", "modulus": 1e6, "friction": 0.2}, "needs tangential_stiffness"),
        ({"contact": "hunt_crossley", "layer_depth": 0.1, "layer_stiffness": 1e3}, "has one layer"),
        ({"friction": 0.4, "breakaway_friction": 0.2}, "breakaway_friction must be at least friction"),
        ({"breakaway_friction": 0.2}, "breakaway_friction must be at least friction, which must be above zero"),
    ],
)
def test_what_does_not_fit_together_is_one_sentence(wall, message):
    with pytest.raises(InputError, match=message):
        Scenario.load("push_wall", {"walls": [PLANE | wall]})


def test_bumpers_capsules_and_steep_impacts_are_refused_by_name():
    walls = [PLANE | {"position": [3.0, 0.0, 0.0], "contact": "hertz", "modulus": 1e6}]
    base = {"wall.present": False, "walls": walls}
    with pytest.raises(InputError, match=r"bumper\.stiffness: a bumper in series with the hertz contact of walls\[0\]"):
        simulate(Scenario.load("push_wall", base | {"bumper.stiffness": 1e3}))
    rod = [{"position": [0.0, 0.0, 0.0], "end": [0.2, 0.0, 0.0], "radius": 0.1}]
    with pytest.raises(InputError, match="Hertz's contact of a capsule with"):
        simulate(Scenario.load("push_wall", base | {"vehicle.contact_bodies": rod}))
    hard = {"walls": [walls[0] | {"modulus": 1e13}], "simulation.timestep": 1e-3}
    with pytest.raises(InputError, match=r"walls\[0\]\.contact: a time step of 0\.001 s does not resolve impacts"):
        simulate(Scenario.load("push_wall", base | hard))
