"""A vehicle at the surface: wet volumes against other ways to them, stiffness, equilibrium, period, energy, engines."""

import math
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.spatial import ConvexHull, HalfspaceIntersection

from twin import TwinParameters, skew
from uvms_mj import Buoyancy, Current, InputError, NearWall, Scenario, Sea, Simulation, Volume, attach, simulate
from uvms_mj.analysis.summary import ending, rows, summary
from uvms_mj.physics.buoyancy import VOLUME, add_hemisphere, cut, cut_sphere, find_wet
from uvms_mj.physics.frames import quat_from_euler_deg, rotation_matrix
from uvms_mj.physics.kernels import record_of
from uvms_mj.physics.surfaces import BOX, CAPSULE, SPHERE
from uvms_mj.plant.effects import effect_records
from uvms_mj.plant.settings import Situation
from uvms_mj.setup.checks import checked
from vehicles import load, place

pytestmark = pytest.mark.filterwarnings("ignore::uvms_mj.setup.checks.SamplingWarning")

RADIUS, HALF_EDGES, CAPSULE_SIZE = 0.2, np.array([0.23, 0.17, 0.12]), (0.15, 0.3)
SIZES = {
    SPHERE: ((RADIUS, 0.0, 0.0), 4.0 / 3.0 * math.pi * RADIUS**3),
    BOX: (tuple(HALF_EDGES), 8.0 * HALF_EDGES.prod()),
    CAPSULE: ((*CAPSULE_SIZE, 0.0), math.pi * 0.15**2 * (0.6 + 4.0 / 3.0 * 0.15)),
}
SHAPES = {
    "sphere": {"shape": "sphere", "radius": 0.2},
    "box": {"shape": "box", "edges": (0.5, 0.3, 0.2), "attitude_deg": (10.0, 20.0, 30.0)},
    "capsule": {"shape": "capsule", "radius": 0.1, "length": 0.4, "attitude_deg": (0.0, 70.0, 0.0)},
}
G, RHO = 9.81, 1000.0


def volume(kind):
    size, whole = SIZES[kind]
    return record_of(np.array([(kind, size, np.zeros(3), np.eye(3), whole, RHO, 0.0, 0.04)], VOLUME))


def wet_part(kind, n, D):
    """V, its moment (3,), A and its moment (3,)."""
    out = np.zeros(8)
    cut(volume(kind), np.array(n, float), D, out)
    return np.split(out, [1, 4, 5])


def directions(seed, count):
    """Unit vectors (3,), among them such as are nearly along an axis or across it."""
    random = np.random.default_rng(seed)
    for k in range(count):
        n = random.normal(size=3)
        if k % 4 == 1:
            n[2] *= 10.0 ** -random.integers(1, 12)
        if k % 4 == 2:
            n[:2] *= 10.0 ** -random.integers(1, 12)
        if k % 8 == 3:
            n = np.eye(3)[k % 3]
        yield n / np.linalg.norm(n), random.uniform(-1.0, 1.0)


def test_a_box_at_any_attitude_is_the_hull_of_its_clipped_faces():
    for n, share in directions(0, 120):
        reach = np.abs(n) @ HALF_EDGES
        D = 0.999 * share * reach
        faces = np.vstack([np.c_[np.eye(3), -HALF_EDGES], np.c_[-np.eye(3), -HALF_EDGES], [*n, -D]])
        lowest = -np.sign(n) * HALF_EDGES
        within = lowest * (1.0 - (D + reach) / (2.0 * reach)) if n.all() else 0.5 * (D - reach) * n
        hull = ConvexHull(HalfspaceIntersection(faces, within * (1.0 - 1e-6)).intersections, qhull_options="QJ")
        middle, moment = hull.points.mean(axis=0), np.zeros(3)
        for corners in hull.points[hull.simplices]:
            moment += abs(np.linalg.det(corners - middle)) / 24.0 * (corners.sum(axis=0) + middle)
        V, found, _, _ = wet_part(BOX, n, D)
        assert V[0] == pytest.approx(hull.volume, rel=1e-8)
        np.testing.assert_allclose(found, moment, rtol=0.0, atol=1e-8 * hull.volume)


def by_discs(a, half, n, D):
    """The wet part of a capsule about its middle from integrals over the discs across its axis, by SciPy."""
    slant = math.hypot(n[0], n[1])
    across = np.array([n[0], n[1], 0.0]) / slant

    def radius(z):
        return math.sqrt(max(0.0, a * a - max(0.0, abs(z) - half) ** 2))

    def segment(z):
        r = radius(z)
        u = min(1.0, max(-1.0, (D - n[2] * z) / (slant * r + 1e-300)))
        psi, chord = math.asin(u), 2.0 * r * math.sqrt(max(0.0, 1.0 - u * u))
        S = r * r * (0.5 * math.pi + psi + u * math.cos(psi))
        return S, z * S, -(chord**3) / 12.0, chord / slant, chord / slant * z, chord / slant * r * u

    ends = [-half - a, -half, half, half + a]
    for side in (1.0, -1.0):
        z = np.linspace(-half - a, half + a, 4001)
        f = [n[2] * each + side * slant * radius(each) - D for each in z]
        ends += [
            brentq(lambda x, side: n[2] * x + side * slant * radius(x) - D, z[i], z[i + 1], args=(side,), xtol=1e-15)
            for i in range(4000)
            if f[i] * f[i + 1] < 0.0
        ]
    ends.sort()
    V, z, k, A, Az, Ak = (
        sum(quad(lambda z, i: segment(z)[i], *part, args=(i,), epsabs=1e-13, limit=200)[0] for part in pairwise(ends))
        for i in range(6)
    )
    axis = np.array([0.0, 0.0, 1.0])
    return V, z * axis + k * across, A, Az * axis + Ak * across


def test_a_capsule_and_a_sphere_are_the_integral_over_their_discs():
    for n, share in directions(1, 24):
        if math.hypot(n[0], n[1]) < 1e-3:
            continue
        for kind, (a, half) in ((CAPSULE, CAPSULE_SIZE), (SPHERE, (RADIUS, 0.0))):
            D = 0.99 * share * (a + half * abs(n[2]))
            for found, other in zip(wet_part(kind, n, D), by_discs(a, half, n, D), strict=True):
                np.testing.assert_allclose(found, np.atleast_1d(other), rtol=0.0, atol=1e-9)


def test_two_hemispheres_are_a_sphere():
    for n, share in directions(4, 60):
        ball, two = np.zeros(8), np.zeros(8)
        cut_sphere(RADIUS, n, share * RADIUS, ball)
        for end in (1.0, -1.0):
            add_hemisphere(RADIUS, 0.0, n, end, share * RADIUS, two)
        np.testing.assert_allclose(two, ball, rtol=0.0, atol=1e-16)


@pytest.mark.parametrize("kind", SIZES)
def test_the_waterplane_is_the_slope_of_the_volume_and_the_limits_are_dry_and_whole(kind):
    size, whole = SIZES[kind]
    for n, share in directions(2, 40):
        reach = np.abs(n) @ HALF_EDGES if kind == BOX else size[0] + size[1] * abs(n[2])
        D, h = 0.98 * share * reach, 1e-6
        more, less = wet_part(kind, n, D + h)[0][0], wet_part(kind, n, D - h)[0][0]
        V, _, A, at = wet_part(kind, n, D)
        if n.all():  # a face that lies in the plane has a jump
            assert A[0] == pytest.approx((more - less) / (2.0 * h), rel=1e-5, abs=1e-8)
        assert n @ at == pytest.approx(D * A[0], abs=1e-12)  # it lies in the plane
        opposite = wet_part(kind, -n, -D)
        assert V[0] + opposite[0][0] == pytest.approx(whole, rel=1e-12)
        assert wet_part(kind, n, reach)[0][0] == pytest.approx(whole, rel=1e-14)
        assert wet_part(kind, n, -reach)[0][0] == pytest.approx(0.0, abs=1e-15)


def shapes_of(*given, displaced_mass=8.0, r_b=(0.01, 0.0, 0.03), surface=0.0, sea=None):
    """Records of shapes for kernels."""
    table = Buoyancy(shapes=tuple(Volume(**each) for each in given))
    situation = Situation(displaced_mass=displaced_mass, r_b=np.array(r_b), surface=surface)
    return record_of(effect_records({"buoyancy": table} | ({} if sea is None else {"sea": sea}), situation))


def wet_at(records, p, R, t=0.0):
    """Mass [kg], its moment (3,) in B, its slope (6,) and the mass of all."""
    moment, slope = np.zeros(3), np.zeros(6)
    mass, whole, _ = find_wet(records, t, np.array(p, float), R, moment, slope)
    return mass, moment, slope, whole


MANY = (
    {"shape": "box", "edges": (0.3, 0.2, 0.1), "position": (0.01, 0.1, 0.03), "attitude_deg": (5.0, 0.0, 20.0)},
    {"shape": "box", "edges": (0.3, 0.2, 0.1), "position": (0.01, -0.1, 0.03), "attitude_deg": (5.0, 0.0, 20.0)},
    SHAPES["sphere"],
    SHAPES["capsule"],
)


@pytest.mark.parametrize("given", [*([each] for each in SHAPES.values()), MANY])
def test_the_buoyancy_is_the_slope_of_a_potential_and_the_slope_is_that_of_the_mass(given):
    """By all six motions of the vehicle, at any attitude."""
    records, random = shapes_of(*given), np.random.default_rng(3)

    def potential(p, R):
        mass, moment, _, _ = wet_at(records, p, R)
        return -G * (mass * p[2] + (R @ moment)[2])

    for _ in range(20):
        p, R = random.uniform(-0.12, 0.12, 3), rotation_matrix(quat_from_euler_deg(*random.uniform(-180, 180, 3)))
        mass, moment, slope, _ = wet_at(records, p, R)
        f = R.T @ [0.0, 0.0, G]
        wrench, h = np.concatenate([mass * f, np.cross(moment, f)]), 1e-6
        for k, e in enumerate(np.eye(6)):
            turned = [R @ rotation_matrix(_small(sign * h * e[3:])) for sign in (1.0, -1.0)]
            moved = [p + sign * h * R @ e[:3] for sign in (1.0, -1.0)]
            U, m = (
                [of(*each) for each in zip(moved, turned, strict=True)]
                for of in (potential, lambda p, R: wet_at(records, p, R)[0])
            )
            assert (U[1] - U[0]) / (2.0 * h) == pytest.approx(wrench[k], rel=1e-5, abs=2e-5)
            assert (m[0] - m[1]) / (2.0 * h) == pytest.approx(slope[k], rel=1e-4, abs=1e-4)


def _small(turn):
    """The quaternion of a small rotation vector (3,)."""
    q = np.concatenate([[1.0], 0.5 * turn])
    return q / np.linalg.norm(q)


def lift(records, z, R=None):
    return G * wet_at(records, (0.0, 0.0, z), np.eye(3) if R is None else R)[0]


LEVEL = {"shape": "box", "edges": (0.5, 0.3, 0.2)}
LYING = {"shape": "capsule", "radius": 0.1, "length": 0.4, "attitude_deg": (0.0, 90.0, 0.0)}
STANDING = {"shape": "capsule", "radius": 0.1, "length": 0.4}


@pytest.mark.parametrize(
    ("shape", "z", "area", "whole"),
    [
        (SHAPES["sphere"], 0.05, math.pi * (0.2**2 - 0.05**2), 4.0 / 3.0 * math.pi * 0.2**3),
        (LEVEL, 0.03, 0.15, 0.03),
        (LYING, 0.06, math.pi * 0.08**2 + 0.4 * 0.16, math.pi * 0.01 * (0.4 + 4.0 / 30.0)),
        (STANDING, 0.11, math.pi * 0.01, math.pi * 0.01 * (0.4 + 4.0 / 30.0)),
    ],
)
def test_the_stiffness_in_heave_is_that_of_the_waterplane(shape, z, area, whole):
    """A lying capsule's waterplane is a rectangle with two half circles, a sphere's a circle."""
    records, h = shapes_of(shape, displaced_mass=RHO * whole, r_b=np.zeros(3)), 1e-6
    stiffness = (lift(records, z - h) - lift(records, z + h)) / (2.0 * h)
    assert stiffness == pytest.approx(RHO * G * area, rel=1e-6)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_stiffness_in_roll_and_pitch_of_a_box_is_its_metacentric_height(axis):
    """GM = I/V + KB - KG, with I of the waterplane; G is the middle of the box."""
    edges, draft = np.array(LEVEL["edges"]), 0.13
    records = shapes_of(LEVEL, displaced_mass=RHO * edges.prod(), r_b=np.zeros(3))
    z = 0.5 * edges[2] - draft
    inertia = edges[axis] * edges[1 - axis] ** 3 / 12.0
    V = edges[0] * edges[1] * draft
    height = inertia / V + 0.5 * draft - 0.5 * edges[2]

    def restoring(angle):
        R = rotation_matrix(_small(angle * np.eye(3)[axis]))
        _, moment, _, _ = wet_at(records, (0.0, 0.0, z), R)
        return np.cross(moment, R.T @ [0.0, 0.0, G])[axis]

    h = 1e-5
    assert -(restoring(h) - restoring(-h)) / (2.0 * h) == pytest.approx(RHO * G * V * height, rel=1e-6)


def test_deep_below_it_is_the_buoyancy_of_all_and_above_there_is_none():
    for p, R in (((0.1, -0.2, -0.7), np.eye(3)), ((0, 0, -5.0), rotation_matrix(quat_from_euler_deg(50, -20, 90)))):
        mass, moment, slope, whole = wet_at(shapes_of(*MANY), p, R)
        assert mass == pytest.approx(8.0, rel=1e-14)
        assert whole == pytest.approx(8.0, rel=1e-14)
        np.testing.assert_allclose(moment, 8.0 * np.array([0.01, 0.0, 0.03]), rtol=0.0, atol=1e-14)
        assert not slope.any()
    mass, moment, slope, _ = wet_at(shapes_of(*MANY), (0, 0, 0.5), np.eye(3))
    assert mass == 0.0
    assert not moment.any()
    assert not slope.any()


def body(h, displaced=8.0, r=(0.01, 0.0, -0.02), D=False):
    """A vehicle with full added mass, without damping."""
    vehicle = TwinParameters(r_g=r, r_b=(0.01, 0.0, 0.03), buoyancy=displaced * G, timestep=h)
    if not D:
        for name in ("D_linear", "D_quadratic"):
            object.__setattr__(vehicle, name, np.zeros((6, 6)))
    return vehicle, *load(vehicle, option='integrator="RK4"')


def test_attach_deep_below_is_attach_without_shapes():
    parts, p, nu = [], (0.2, 0.1, -2.0), (0.4, -0.3, 0.2, 0.5, -0.7, 0.3)
    for given in ({}, {"buoyancy": Buoyancy(shapes=tuple(Volume(**each) for each in MANY)), "sea": Sea(surface=0.0)}):
        _, model, data = body(1e-3, D=True)
        with attach(model, data, current=Current.of((0.3, 0.1, 0.0)), **given) as attachment:
            place(model, data, p, quat_from_euler_deg(40, 30, 20), nu)
            mujoco.mj_forward(model, data)
            parts.append((attachment.wrench, data.qacc.copy()))
    for one, other in zip(*parts, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


def thrown(shape, h, z, seconds=0.42):
    """The energy gained by a tumbling vehicle on its way out of the water, over what it had, and what is wet then."""
    vehicle, model, data = body(h)
    data.qpos[2], data.qvel[:] = z, (0.2, 0.1, 3.0, 1.0, -0.7, 0.4)
    table = Buoyancy(shapes=(Volume(**shape),))
    records = shapes_of(shape)
    S = skew(np.array(vehicle.r_g))
    M_RB = np.block([[vehicle.mass * np.eye(3), -vehicle.mass * S], [vehicle.mass * S, vehicle.inertia]])

    def energy():
        R, p = data.xmat[1].reshape(3, 3), data.qpos[:3]
        nu = np.concatenate([R.T @ data.qvel[:3], data.qvel[3:]])
        mass, moment, _, whole = wet_at(records, p, R)
        lifted = G * (vehicle.mass * (p[2] + (R @ vehicle.r_g)[2]) - mass * p[2] - (R @ moment)[2])
        return 0.5 * nu @ (M_RB + mass / whole * vehicle.M_A) @ nu, lifted, mass / whole

    with attach(model, data, buoyancy=table, sea=Sea(surface=0.0)):
        mujoco.mj_forward(model, data)
        moving, lifted, before = energy()
        mujoco.mj_step(model, data, round(seconds / h))
        mujoco.mj_forward(model, data)
        then, high, wet = energy()
    assert before == 1.0
    return (then + high - moving - lifted) / moving, wet, then / moving


@pytest.mark.parametrize("shape", SHAPES)
def test_a_vehicle_that_is_thrown_out_keeps_its_energy_to_the_order_of_the_scheme(shape):
    """The water gives its kinetic energy back as the added mass falls. At the touch the force has a kink, so that the
    error of one run depends on where in a step it is met: the root mean square of several is of second order."""
    starts = np.linspace(-0.6, -0.55, 12)
    errors = []
    for h in (4e-3, 2e-3, 1e-3):
        found = [thrown(SHAPES[shape], h, z, 0.44) for z in starts]
        assert all(wet == 0.0 for _, wet, _ in found)
        assert all(0.2 < kept < 0.4 for _, _, kept in found)  # it has risen
        errors.append(np.sqrt(np.mean([error**2 for error, _, _ in found])))
    assert errors[2] < 5e-5
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2]


FLOATING = {
    "wall.present": False,
    "controller.name": "external",
    "simulation.timestep": 1e-3,
    "simulation.duration": 100.0,
    "current.speed": 0.0,
    "vehicle.linear_damping": 0.0,
    "vehicle.quadratic_damping": 0.0,
    "sea.surface": 0.0,
}
"""Nobody commands, and nothing takes energy out."""


def sphere_that_floats(share=0.55):
    """A scenario of a bluerov1 as a sphere that displaces more than it weighs, its radius [m] and the depth of its
    centre [m] at rest, the root of the cubic of the cap."""
    vehicle = checked(Scenario.load("push_wall", FLOATING)).vehicle
    displaced = vehicle.mass / share
    radius = (0.75 * displaced / RHO / math.pi) ** (1.0 / 3.0)
    # of the cap of the height a + s: (a + s)^2 (2 a - s) / (4 a^3) = share
    s = brentq(lambda s: (radius + s) ** 2 * (2.0 * radius - s) - 4.0 * share * radius**3, -radius, radius, xtol=1e-15)
    over = FLOATING | {"buoyancy.shapes": [{"shape": "sphere", "radius": radius}]}
    return over | {"vehicle.displaced_mass": displaced / vehicle.displaced_mass}, radius, s, vehicle


def crossings(t, x):
    """Times at which x (n,) rises through zero, by straight lines."""
    i = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    return t[i] - x[i] * (t[i + 1] - t[i]) / (x[i + 1] - x[i])


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_sphere_floats_at_the_root_of_its_cubic_and_heaves_with_its_period(engine):
    over, radius, s, vehicle = sphere_that_floats()
    z_b = vehicle.r_b[2]
    rest, small = -s - z_b, 1e-3
    scenario = Scenario.load("push_wall", over | {"initial.position": [0.0, 0.0, rest]})
    with Simulation(scenario, engine=engine) as sim:
        sim.step(2000)
        assert sim.signals.p_WB[2] == pytest.approx(rest, abs=1e-12)  # it stays
        assert float(sim.signals.wet_fraction) == pytest.approx(0.55, rel=1e-12)
    scenario = scenario.updated({"initial.position": [0.0, 0.0, rest + small]})
    z, t = [], 0.001 * np.arange(8000)
    with Simulation(scenario, engine=engine) as sim:
        for _ in t:
            z.append(sim.signals.p_WB[2] - rest)
            sim.step(1)
    found = np.diff(crossings(t, np.array(z))).mean()
    area = math.pi * (radius**2 - s**2)
    period = 2.0 * math.pi * math.sqrt((vehicle.mass + 0.55 * vehicle.M_A[2, 2]) / (RHO * G * area))
    assert found == pytest.approx(period, rel=2e-4)
    assert max(z) == pytest.approx(small, rel=2e-2)  # nothing takes energy out


def test_a_vehicle_falls_back_as_a_stone_falls():
    """Above the water it is ballistic, to rounding."""
    over, *_ = sphere_that_floats()
    z, v, h = 0.5, 1.2, 1e-3
    start = {"initial.position": [0.0, 0.0, z], "initial.velocity": [0.3, 0.0, v, 0.0, 0.0, 0.0]}
    scenario = Scenario.load("push_wall", over | start)
    with Simulation(scenario, engine="free_body") as sim:
        sim.step(300)
        t = 0.3
        assert sim.signals.p_WB[2] == pytest.approx(z + v * t - 0.5 * G * t * (t + h), abs=1e-12)  # of the scheme
        assert float(sim.signals.wet_fraction) == 0.0
        sim.step(400)
        assert float(sim.signals.wet_fraction) > 0.3


LEAPING = FLOATING | {
    "initial.position": [0.0, 0.0, -0.5],
    "initial.velocity": [0.0, 0.1, 4.5, 0.2, -0.3, 0.1],
    "current.speed": 0.3,
    "tether.length": 2.0,
    "vehicle.linear_damping": 1.0,
    "vehicle.quadratic_damping": 0.3,
    "buoyancy.shapes": [{"shape": "capsule", "radius": 0.12, "length": 0.4, "attitude_deg": [0.0, 80.0, 0.0]}],
}
"""A vehicle with drag in a current that rises fast through the surface and falls back into it."""


def test_both_engines_agree_across_the_surface():
    """In waves; in calm water each is compared with closed forms."""
    motions, more = [], {"sea.height": 0.2, "sea.period": 3.0, "sea.direction_deg": 40.0}
    for engine in ("free_body", "mujoco"):
        found = []
        with Simulation(Scenario.load("push_wall", LEAPING | more), engine=engine) as sim:
            for _ in range(250):
                sim.step(5)
                found.append([*sim.signals.p_WB, *sim.signals.nu, float(sim.signals.wet_fraction)])
        motions.append(np.array(found))
    one, other = motions
    wet = one[:, -1]
    assert wet[0] == wet[-1] == 1.0
    assert wet.min() == 0.0
    np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9)


def test_a_uniform_current_carries_the_leap_along():
    """Seen from the water, a vehicle in a current moves as in still water, also through the surface."""
    motions = []
    for U in (0.0, 0.6):
        start = {
            "current.speed": U,
            "current.direction_deg": 0.0,
            "initial.velocity": [0.2 + U, 0.1, 4.5, 0.2, -0.3, 0.1],
        }
        with Simulation(Scenario.load("push_wall", LEAPING | start), engine="free_body") as sim:
            sim.step(300)
            assert float(sim.signals.wet_fraction) == 0.0
            sim.step(850)
            motions.append([*(sim.signals.p_WB - [1.15 * U, 0.0, 0.0]), *sim.signals.quat_WB])
    np.testing.assert_allclose(*motions, rtol=0.0, atol=1e-13)


def test_the_rate_of_the_surface_is_that_of_the_wet_mass():
    """At a place that stands still, of the plane that rises and turns."""
    sea = Sea(height=0.1, period=3.0, surface=0.0, spectrum="jonswap", components=5, seed=2)
    records, R, h, most = shapes_of(*MANY, sea=sea), np.eye(3), 1e-5, 0.0
    for t in (0.3, 1.1, 7.9):
        args = np.array([0.4, -0.2, 0.02]), R
        before, after = (find_wet(records, t + s * h, *args, np.zeros(3), np.zeros(6))[0] for s in (-1.0, 1.0))
        rate = find_wet(records, t, *args, np.zeros(3), np.zeros(6))[2]
        most = max(most, abs(rate))
        assert rate == pytest.approx((after - before) / (2.0 * h), rel=1e-6)
    assert most > 0.5


WAVES = {"sea.height": 0.2, "sea.period": 5.0, "sea.depth": None}


def test_a_floating_sphere_follows_a_long_wave():
    """Its heave is the surface's at its place: the wave is a hundred times as long as it is wide."""
    over, _, s, vehicle = sphere_that_floats()
    over |= WAVES | {"vehicle.quadratic_damping": 1.0, "vehicle.linear_damping": 1.0}
    scenario = Scenario.load("push_wall", over | {"initial.position": [0, 0, 0.1 - s - vehicle.r_b[2]]})
    z, surface, h = [], [], 0.01
    with Simulation(scenario, engine="free_body") as sim:
        for k in range(2000):
            p = sim.signals.p_WB
            k_wave = (2.0 * math.pi / 5.0) ** 2 / G
            z.append(p[2])
            surface.append(0.1 * math.cos(k_wave * p[0] - 2.0 * math.pi / 5.0 * k * h))
            sim.step(10)
    rest = -s - vehicle.r_b[2]
    found, wanted = np.array(z[1000:]) - rest, np.array(surface[1000:])
    assert np.abs(found - wanted).max() < 0.1 * 0.1
    assert found.std() == pytest.approx(wanted.std(), rel=0.03)


LARGE = [{"shape": "box", "edges": [0.5, 0.3, 0.25]}]
"""More than a bluerov1 displaces."""


@pytest.mark.parametrize(
    ("over", "said"),
    [
        ({"buoyancy.shapes": [{"shape": "box", "edges": [0.1, 0.1, 0.1]}]}, r"shapes: hold 1 l, and the vehicle"),
        ({"buoyancy.shapes": [LARGE[0] | {"position": [0.1, 0, 0]}]}, r"shapes: their centroid is \(0.1 0 0\) m in B"),
        ({"buoyancy.shapes": LARGE, "vehicle.displaced_mass": 0.0}, r"buoyancy.shapes: the vehicle displaces no water"),
        ({"buoyancy.shapes": [{"shape": "sphere"}]}, r"a sphere needs radius"),
        ({"buoyancy.shapes": [{"shape": "box", "edges": [1, 1, 1], "radius": 0.1}]}, r"a box has no radius"),
        ({"buoyancy.shapes": [{"shape": "cylinder", "radius": 0.1}]}, r"shape"),
        ({"buoyancy.shapes": LARGE, "near_wall": [{"radius": 0.2}]}, r"buoyancy.shapes: .*near_wall"),
        ({"buoyancy.shapes": LARGE, "pads": [{"radius": 0.1, "position": [0.1, 0, 0]}]}, r"buoyancy.shapes: .*pads"),
        ({"buoyancy.shapes": LARGE, "controller.name": "ideal"}, r"buoyancy.shapes: .*ideal"),
        (
            {"buoyancy.shapes": LARGE, "tether.elements": 5, "tether.length": 3.0, "tether.anchor": [0.0, 2.0, 0.0]},
            r"buoyancy.shapes: .*tether",
        ),
    ],
)  # fmt: skip
def test_what_is_not_computed_is_refused_in_a_sentence(over, said):
    with pytest.raises(InputError, match=said):
        simulate(Scenario.load("push_wall", over | {"simulation.duration": 0.01}))


def test_joints_and_a_tilted_gravity_are_refused_in_a_run_and_in_attach():
    _, model, data = body(1e-3)
    with pytest.raises(InputError, match=r"attach: buoyancy.shapes: hold 1 l"):
        attach(model, data, buoyancy=Buoyancy(shapes=(Volume("box", edges=(0.1, 0.1, 0.1)),)))
    table = Buoyancy(shapes=(Volume("box", edges=(0.3, 0.3, 0.3)),))
    with pytest.raises(InputError, match=r"attach: buoyancy: is one table"):
        attach(model, data, buoyancy=[table, table])
    wall = NearWall(radius=0.1, point=(1.0, 0.0, 0.0))
    with pytest.raises(InputError, match=r"attach: buoyancy.shapes: the water of near_wall"):
        attach(model, data, buoyancy=table, near_wall=wall)
    model.opt.gravity[:] = 0.1, 0.0, -9.8
    with pytest.raises(InputError, match=r"attach: buoyancy.shapes: the surface is level"):
        attach(model, data, buoyancy=table)
    with pytest.raises(InputError, match="take a vehicle without joints"):
        checked(Scenario.load("tool_push", {"buoyancy.shapes": [{"shape": "box", "edges": [0.5, 0.5, 0.5]}]}))


def test_closed_forms_and_notes_say_that_they_do_not_know_the_surface():
    trace = simulate(Scenario.load("push_wall", {"buoyancy.shapes": LARGE, "simulation.duration": 4.0}))
    assert trace.analytic.reason == "closed forms do not know buoyancy"
    assert trace.wet_fraction.min() == 1.0
    assert any("a share of" in note for note in trace.notes)  # of the box displaces


def test_a_reset_takes_the_shapes_away_and_back():
    scenario = Scenario.load("push_wall", LEAPING | {"simulation.duration": 1.0})
    with Simulation(scenario, engine="free_body") as sim, Simulation(scenario, engine="free_body") as fresh:
        sim.step(30)
        sim.reset({"buoyancy.shapes": []})
        sim.step(600)
        with Simulation(scenario.updated({"buoyancy.shapes": []}), engine="free_body") as plain:
            plain.step(600)
            np.testing.assert_allclose(sim.signals.nu, plain.signals.nu, rtol=0.0, atol=1e-12)  # M is solved with
        sim.reset({"sea.surface": 0.1})
        sim.reset()
        sim.step(600)
        fresh.step(600)
        assert np.array_equal(sim.signals.nu, fresh.signals.nu)


def test_a_thruster_that_leaves_the_water_gives_no_thrust_and_the_law_does_not_know():
    """By the share of a sphere of the propeller's radius, for each thruster at its own place."""
    over = LEAPING | {"vehicle.model": "bluerov2_heavy", "initial.velocity": [0.0] * 6}
    over |= {"buoyancy.propeller_radius": 0.05}
    for z, roll in ((-0.5, 0.0), (0.02, 0.0), (0.0, 20.0), (0.6, 0.0)):
        start = {"initial.position": [0.0, 0.0, z], "initial.attitude_deg": [roll, 0.0, 0.0]}
        scenario = Scenario.load("push_wall", over | start | {"buoyancy.shapes": LARGE})
        with Simulation(scenario, engine="free_body") as sim:
            vehicle, tau_cmd = sim.setup.vehicle, np.array([5.0, 3.0, 8.0, 0.0, 0.0, 0.0])
            sim.tau_cmd[:] = tau_cmd
            depth = -(np.array([0.0, 0.0, z]) + vehicle.places @ rotation_matrix(quat_from_euler_deg(roll, 0, 0)).T)[
                :, 2
            ]
            s = np.clip(depth / 0.05, -1.0, 1.0)
            wanted = np.linalg.pinv(vehicle.B) @ tau_cmd
            sim.step(1)
            np.testing.assert_allclose(sim.signals.u, 0.25 * (1 + s) ** 2 * (2 - s) * wanted, rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(sim.signals.tau, vehicle.B @ sim.signals.u, rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(sim.signals.tau_hat, tau_cmd, rtol=0.0, atol=1e-9)


def test_a_run_says_that_the_vehicle_left_the_water():
    """At every step, whatever the rows: thrown up from above, it falls into the water."""
    over = {"wall.present": False, "sea.surface": 0.3, "buoyancy.shapes": LARGE, "simulation.timestep": 1e-3}
    over |= {"initial.velocity": [0.0, 0.0, 1.0, 0.0, 0.0, 0.0], "initial.position": [0.0, 0.0, 0.6]}
    over |= {"reference.target": [0.0, 0.0, -0.5]}
    scenario = Scenario.load("push_wall", over | {"simulation.duration": 3.0}, "impedance")
    full, few = (simulate(scenario, engine="free_body", log_rate=rate) for rate in (1000, 2))
    assert full.dry_time[-1] == pytest.approx(1e-3 * (full.wet_fraction[:-1] == 0.0).sum(), rel=1e-12)
    assert full.dry_time[-1] > 0.1
    assert few.dry_time[-1] == full.dry_time[-1]
    assert few.wet_fraction_low.min() == 0.0
    assert f"the vehicle was out of the water for {full.dry_time[-1]:.4g} s" in ending(full)
    assert dict(rows(full, summary(full, {})))["out of the water"].startswith(f"{full.dry_time[-1]:.4g} s")
    calm = simulate(scenario.updated({"initial.position": [0.0, 0.0, -0.5]}), engine="free_body", log_rate=100)
    assert calm.dry_time[-1] == 0.0
    assert not any("out of the water" in note for note in ending(calm))
