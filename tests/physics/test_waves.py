"""Waves: linear theory by its equations, by published numbers and by closed forms of bodies that ride on them."""

import math

import mujoco
import numpy as np
import pytest

import uvms_mj.engine.native.compilation  # noqa: F401  # machine code for called_on
from twin import TwinParameters
from uvms_mj import InputError, Scenario, Sea, attach, simulate
from uvms_mj.engine.simulation import Simulation
from uvms_mj.physics.kernels import called_on, kernel
from uvms_mj.physics.waves import WAVE, add_waves, decayed, turned
from uvms_mj.plant.sea import sea_notes, spectral_density, wave_number
from uvms_mj.plant.settings import Situation
from uvms_mj.setup.checks import checked
from vehicles import load

G = 9.80665
TABLE = [  # H, T, depth, z; lambda; u, w; a_x, a_z; half axes of the orbit; design numbers of the project
    (0.2, 2.0, 2.0, -1.0, 6.0501, 0.1271, 0.0988, 0.3994, 0.3105, 0.0405, 0.0315),
    (0.5, 3.0, 10.0, -2.0, 14.0433, 0.2142, 0.2138, 0.4486, 0.4479, 0.1023, 0.1021),
    (0.5, 4.0, 10.0, -2.0, 24.6680, 0.2414, 0.2334, 0.3793, 0.3666, 0.1537, 0.1486),
    (1.0, 6.0, 20.0, -5.0, 55.0324, 0.3087, 0.2892, 0.3233, 0.3029, 0.2948, 0.2762),
    (2.0, 8.0, 50.0, -10.0, 99.5282, 0.4212, 0.4158, 0.3308, 0.3266, 0.5363, 0.5295),
]
DRY = {"shape": "sphere", "radius": 0.2, "position": [3.0, 0.0, 1.8]}
CEILING = {"shape": "plane", "position": [0.0, 0.0, 1.95], "attitude_deg": [0.0, -90.0, 0.0]}
BOOM = {"shape": "cylinder", "radius": 0.2, "position": [3.0, 0.0, 2.1], "attitude_deg": [90.0, 0.0, 0.0]}
OBLIQUE = Sea(height=0.4, period=2.5, depth=3.0, surface=0.7, direction_deg=35.0)


def motion(sea, t, p, face=None, gravity=G):
    """v (3,), v_dot (3,) and gradient (3, 3) of the water."""
    v, v_dot, gradient = np.zeros(3), np.zeros(3), np.zeros((3, 3))
    records = np.array(sea.records(Situation(0, gravity, face)), WAVE).view(np.recarray)
    add_waves(records, t, np.asarray(p, float), v, v_dot, gradient)
    return v, v_dot, gradient


@pytest.mark.parametrize("row", TABLE)
def test_velocity_acceleration_and_orbit_are_the_tables(row):
    height, period, depth, z, length, u, w, a_x, a_z, along, up = row
    sea = Sea(height=height, period=period, depth=depth, surface=0.0)
    omega = 2.0 * math.pi / period
    crest, side = motion(sea, 0.0, (0.0, 0.0, z)), motion(sea, 0.0, (0.25 * sea.length(G), 0.0, z))
    found = [sea.length(G), crest[0][0], side[0][2], side[1][0], -crest[1][2], crest[0][0] / omega, side[0][2] / omega]
    np.testing.assert_allclose(found, [length, u, w, a_x, a_z, along, up], rtol=0, atol=0.6e-4)


@pytest.mark.parametrize("depth", [0.1, 0.5, 2.0, 30.0, 4e4, None])
def test_wave_numbers_satisfy_the_dispersion_relation(depth):
    for period in (0.3, 1.0, 3.0, 12.0, 90.0):
        omega = 2.0 * math.pi / period
        k = wave_number(omega, G, depth)
        assert G * k * (1.0 if depth is None else math.tanh(k * depth)) == pytest.approx(omega**2, rel=1e-12)


def test_the_field_has_the_derivatives_that_it_says_and_neither_divergence_nor_curl():
    p, t, h = np.array([0.4, -1.1, -0.6]), 0.83, 1e-6
    v, v_dot, gradient = motion(OBLIQUE, t, p)
    assert np.trace(gradient) == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(gradient, gradient.T, atol=1e-15)
    by_time = (motion(OBLIQUE, t + h, p)[0] - motion(OBLIQUE, t - h, p)[0]) / (2.0 * h)
    by_place = np.array([motion(OBLIQUE, t, p + h * e)[0] - motion(OBLIQUE, t, p - h * e)[0] for e in np.eye(3)])
    np.testing.assert_allclose(v_dot, by_time, atol=1e-9)
    np.testing.assert_allclose(gradient, by_place.T / (2.0 * h), atol=1e-9)
    assert np.abs(v).min() > 1e-3


def test_no_water_crosses_the_bottom_or_a_wall_that_throws_the_waves_back():
    sea = Sea(height=0.4, period=2.5, depth=3.0, surface=0.7, direction_deg=35.0, reflecting=True)
    alone = Sea(height=0.4, period=2.5, depth=3.0, surface=0.7, direction_deg=35.0)
    for t in (0.0, 0.7, 1.9):
        assert motion(alone, t, (0.3, 0.2, 0.7 - 3.0))[0][2] == pytest.approx(0.0, abs=1e-15)
        assert motion(sea, t, (1.3, 0.2, -0.5), face=1.3)[0][0] == pytest.approx(0.0, abs=1e-15)
    straight = Sea(height=0.4, period=2.5, surface=0.7, reflecting=True)
    once = Sea(height=0.4, period=2.5, surface=0.7)
    times = np.linspace(0.0, 2.5, 50)
    heave = [max(abs(motion(s, t, (1.3, 0.0, 0.0), face=1.3)[0][2]) for t in times) for s in (straight, once)]
    assert heave[0] == pytest.approx(2.0 * heave[1], rel=1e-2)  # an antinode, by fifty instants


def test_cosine_and_sine_of_a_phase_at_all_quarters_and_far_away():
    random = np.random.default_rng(0)
    for reach in (1e-3, 1.0, 7.0, 1e3, 1e5):
        for theta in [*random.uniform(-reach, reach, 2000), *(0.25 * np.pi * np.arange(-9, 10))]:
            cosine, sine = turned(float(theta))
            assert abs(cosine - math.cos(theta)) < 1e-14 + 1e-16 * abs(theta)
            assert abs(sine - math.sin(theta)) < 1e-14 + 1e-16 * abs(theta)


def test_decay_with_depth_is_the_exponential_and_ends_where_no_motion_is_left():
    for x in [0.0, -1e-300, -40.0, *np.random.default_rng(1).uniform(-40.0, 0.0, 5000)]:
        assert decayed(float(x)) == pytest.approx(math.exp(x), rel=1e-14)
    assert decayed(-41.0) == decayed(-1e6) == decayed(-40.0)


@kernel
def sea_at(waves, instant, found):
    """The motion (5, 3) of the water at a time and a place (4,)."""
    add_waves(waves, instant[0], instant[1:], found[0], found[1], found[2:])


@pytest.mark.parametrize("components", [2, 7, 30])
def test_machine_code_has_the_bits_of_plain_python_for_any_number_of_components(components):
    """Also where a processor computes several of them at once, and some alone."""
    sea = Sea(height=0.5, period=4.0, spectrum="jonswap", spreading=3.0, depth=12.0, components=components)
    waves = np.array(sea.records(Situation(5, G)), WAVE)
    for t in np.linspace(0.0, 600.0, 13):
        instant = np.array([t, 0.3, -1.0, -0.1 * t])
        compiled, plain = np.zeros((5, 3)), np.zeros((5, 3))
        called_on(sea_at, waves, instant, compiled)()
        sea_at(waves.view(np.recarray), instant, plain)
        assert compiled.tobytes() == plain.tobytes()
        assert np.abs(plain).max() > 0.0


@pytest.mark.parametrize(("gamma", "height", "ratio"), [(1.0, 2.0, 0.7107), (3.3, 2.0024, 0.7777), (5.0, None, 0.8055)])
def test_moments_of_spectra(gamma, height, ratio):
    """Hs = 4 m_0^(1/2), and T_z/T_p = (m_0/m_2)^(1/2) omega_p/(2 pi)."""
    omega = np.linspace(0.05, 60.0, 400_001)
    density = spectral_density(omega, 2.0, 7.0, gamma)
    m_0, m_2 = (np.trapezoid(omega**n * density, omega) for n in (0, 2))
    assert height is None or 4.0 * math.sqrt(m_0) == pytest.approx(height, abs=2e-4)
    assert 2.0 * math.pi * math.sqrt(m_0 / m_2) / 7.0 == pytest.approx(ratio, abs=4e-3)


def test_components_have_the_energy_of_the_spectrum_and_are_those_of_the_seed():
    sea = Sea(height=1.2, period=6.0, spectrum="jonswap", spreading=4.0, depth=15.0)
    one, same, other = (np.array(sea.records(Situation(seed, G)), WAVE) for seed in (3, 3, 4))
    assert one.tobytes() == same.tobytes() != other.tobytes()
    amplitude = one["rate"] * (1.0 - one["bottom"]) / one["omega"]
    assert 4.0 * math.sqrt((amplitude**2).sum() / 2.0) == pytest.approx(1.2, rel=1e-12)
    assert len(np.unique(one["omega"])) == sea.components
    headings = np.arctan2(one["e"][:, 1], one["e"][:, 0])
    assert 0.1 < headings.std() < 0.8
    again = sea.records(Situation(3, G))
    higher = Sea(height=2.4, period=6.0, spectrum="jonswap", spreading=4.0, depth=15.0).records(Situation(3, G))
    assert higher[0][0] == pytest.approx(2.0 * again[0][0])


def rider(mass: float, h: float):
    """A sphere that displaces 100 kg, with added mass and without damping, in a wave; its net weight is held."""
    of = TwinParameters(
        mass=mass, buoyancy=981.0, r_g=(0.0,) * 3, r_b=(0.0,) * 3, inertia=np.diag([5.0] * 3),
        M_A=np.diag([50.0] * 3 + [1.0] * 3), D_linear=np.zeros((6, 6)), D_quadratic=np.zeros((6, 6)), timestep=h,
    )  # fmt: skip
    model, data = load(of)
    data.xfrc_applied[1, 2] = (mass - 100.0) * float(-model.opt.gravity[2])
    return model, data


def ridden(mass: float, h: float, seconds: float, height: float = 0.4) -> tuple[np.ndarray, np.ndarray]:
    """The way (n, 3) of a body that begins with the velocity of the water, and that of the water there, by RK4."""
    sea = Sea(height=height, period=3.0, surface=1.0)
    model, data = rider(mass, h)
    g = float(-model.opt.gravity[2])

    def water(t, p):
        v, v_dot, gradient = np.zeros(3), np.zeros(3), np.zeros((3, 3))
        add_waves(np.array(sea.records(Situation(0, g)), WAVE).view(np.recarray), t, p, v, v_dot, gradient)
        return v

    p, k = data.qpos[:3].copy(), h
    data.qvel[:3] = water(0.0, p) * ((100.0 + 50.0) / (mass + 50.0))
    ways = []
    with attach(model, data, sea=sea):
        for n in range(round(seconds / h)):
            mujoco.mj_step(model, data)
            t = n * h
            a = water(t, p)
            b = water(t + k / 2, p + k / 2 * a)
            c = water(t + k / 2, p + k / 2 * b)
            p = p + k / 6 * (a + 2 * b + 2 * c + water(t + k, p + k * c))
            ways.append((data.qpos[:3].copy(), p))
    return tuple(np.moveaxis(np.array(ways), 1, 0))


def test_a_neutral_body_rides_with_the_water_and_drifts_with_it():
    """It has the acceleration of the water along the way of both, so that they never part but by the order of the
    scheme; the water drifts by Stokes's a^2 omega k e^(2 k z)."""
    apart = []
    for h in (0.02, 0.01, 0.005):
        body, water = ridden(100.0, h, 6.0)
        apart.append(np.abs(body - water).max())
    assert apart[2] < 0.04 * np.ptp(water[:, 2])
    assert apart[1] / apart[0] == pytest.approx(0.5, abs=0.05)
    assert apart[2] / apart[1] == pytest.approx(0.5, abs=0.05)
    body, _ = ridden(100.0, 0.005, 3.0)
    omega, k = 2.0 * math.pi / 3.0, wave_number(2.0 * math.pi / 3.0, G, None)
    drift = 0.2**2 * omega * k * math.exp(-2.0 * k * (1.0 - (body[:, 2].max() + body[:, 2].min()) / 2.0))
    assert (body[-1, 0] - body[0, 0]) / 3.0 == pytest.approx(drift, rel=0.12)


@pytest.mark.parametrize("mass", [80.0, 130.0])
def test_a_body_of_another_mass_moves_by_the_ratio_of_what_pushes_and_what_resists(mass):
    """(rho V + A)/(m + A), in waves so small that the body stays where it is."""
    body, _ = ridden(mass, 0.005, 3.0, height=2e-3)
    water, _ = ridden(100.0, 0.005, 3.0, height=2e-3)
    ratio = np.ptp(body[:, 0]) / np.ptp(water[:, 0])
    assert ratio == pytest.approx(150.0 / (mass + 50.0), rel=2e-3)


def test_a_run_has_the_motion_of_the_water_along_both_ways():
    """In both engines."""
    over = {"sea.height": 0.5, "sea.period": 3.0, "sea.depth": 10.0, "sea.surface": 2.0, "sea.direction_deg": 20.0}
    for engine in ("free_body", "mujoco"):
        with Simulation(Scenario.load("push_wall", over | {"current.speed": 0.0}), engine=engine) as sim:
            sim.step(700)
            water, plant = sim.memory.run["plant"]["water"][0], sim.memory.run["plant"][0]
            g = float(np.linalg.norm(sim.setup.gravity_W))
            v, v_dot, gradient = motion(sim.scenario.sea, sim.t, sim.signals.p_WB, gravity=g)
            R = sim.signals.R_WB
            np.testing.assert_allclose(water["v_c_W"], v, atol=1e-12)
            np.testing.assert_allclose(water["a_c_W"], v_dot + gradient @ v, atol=1e-12)
            np.testing.assert_allclose(water["v_c_dot_W"], v_dot + gradient @ R @ sim.signals.nu[:3], atol=1e-12)
            assert plant["water"]["unsteady"] == 1


def test_engines_agree_and_a_closed_form_is_refused_by_name():
    over = {"sea.height": 0.4, "sea.period": 3.0, "sea.spectrum": "jonswap", "simulation.duration": 3.0}
    first, second = (simulate(Scenario.load("push_wall", over), engine=each) for each in ("free_body", "mujoco"))
    assert "waves" in first.analytic.reason
    np.testing.assert_allclose(first.p_WB, second.p_WB, atol=3e-7)
    assert np.ptp(first.v_c_W, axis=0).max() > 0.1


@pytest.mark.parametrize(
    ("over", "words"),
    [
        ({"sea.height": 3.0, "sea.period": 2.0}, "breaks at"),
        ({"sea.height": 0.5, "sea.surface": 0.2}, "begins above it"),
        ({"sea.height": 0.5, "sea.depth": 1.0}, "begins below"),
        ({"sea.height": 0.5, "walls": [DRY]}, r"walls\[0\].position: z = 1.8 m is above the trough"),
        (
            {"sea.height": 0.5, "walls": [CEILING]},
            r"walls\[0\].position: z = 1.95 m, where it is nearest to the vehicle",
        ),
        (
            {"sea.height": 0.5, "walls": [BOOM]},
            r"walls\[0\].position: z = 1.9\d+ m, where it is nearest to the vehicle",
        ),
        ({"sea.height": 0.5, "reference.target": [1.0, 0.0, 1.9]}, "reference: ends at z = 1.9 m, above the trough"),
        (
            {"sea.height": 0.5, "sea.depth": 3.0, "reference.target": [1.0, 0.0, -1.5]},
            "reference: ends .* below the bottom",
        ),
        (
            {"sea.height": 6.0, "sea.surface": 8.0, "sea.spectrum": "jonswap"},
            "at the spectrum's peak a wave .* breaks at",
        ),
        ({"sea.height": 0.5, "sea.reflecting": True, "wall.present": False}, "no \\[wall\\]"),
        ({"sea.height": 1e-3, "sea.period": 0.11, "simulation.timestep": 1e-2}, "must be at least 0.2 s"),
    ],
)
def test_a_sea_that_is_none_is_refused(over, words):
    with pytest.raises(InputError, match=words) as error:
        simulate(Scenario.load("push_wall", over))
    assert len(error.value.faults) == 1


def test_a_pile_and_a_face_that_reach_into_the_water_are_not_refused():
    """However high their position is: they have no end."""
    pile = {"shape": "cylinder", "radius": 0.2, "position": [3.0, 0.0, 9.0]}
    slope = {"shape": "plane", "position": [-5.0, 0.0, 9.0], "attitude_deg": [0.0, -45.0, 0.0]}
    checked(Scenario.load("push_wall", {"sea.height": 0.5, "walls": [pile, slope]}))


def test_a_reset_changes_the_waves_and_refuses_to_add_them():
    def water(over):
        sim.reset(over)
        sim.step(5)
        return sim.memory.run["plant"]["water"]["v_c_W"][0].copy()

    with Simulation(Scenario.load("push_wall", {"sea.height": 0.4}), engine="free_body") as sim:
        low, high, none = (water({"sea.height": height}) for height in (0.4, 0.8, 0.0))
        np.testing.assert_allclose(none, [-0.25, 0.25 * math.sqrt(3.0), 0.0], atol=1e-12)
        np.testing.assert_allclose(high - none, 2.0 * (low - none), atol=1e-6)
        assert np.abs(low - none).max() > 0.05
    with Simulation(Scenario.load("push_wall"), engine="free_body") as sim, pytest.raises(InputError, match="sea"):
        sim.reset({"sea.height": 0.4})


@pytest.mark.parametrize(("spectrum", "idle"), [("regular", "gamma, seed"), ("pierson_moskowitz", "gamma")])
def test_keys_of_another_spectrum_are_named(spectrum, idle):
    over = {"sea.height": 0.2, "sea.spectrum": spectrum, "sea.gamma": 5.0, "sea.seed": 3, "simulation.duration": 0.01}
    with pytest.warns(match=f"sea: {idle}: without effect"):
        simulate(Scenario.load("push_wall", over))


@pytest.mark.parametrize(("height", "said"), [(0.6, False), (0.63, True)])
def test_a_wave_that_is_long_for_its_depth_is_named(height, said):
    """Of 8 s in 3 m it is 42.02 m long, and its Ursell number is 40 at a height of 0.612 m."""
    sea = Sea(height=height, period=8.0, depth=3.0)
    length = 42.0238
    assert G * 2.0 * math.pi / length * math.tanh(6.0 * math.pi / length) == pytest.approx(
        (math.pi / 4.0) ** 2, rel=1e-5
    )
    notes = list(sea_notes(sea, G, 12.0, 0.0, False))
    assert any("Ursell number" in note for note in notes) is said is (height * length**2 / 27.0 > 40.0)
