"""A tether that moves: catenaries, a swinging chain, energy, another program's cables, slack and snap, and runs."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import j0

import uvms_mj.engine.native.compilation  # noqa: F401  # machine code for called_on
from twin import TwinParameters
from uvms_mj import InputError, McapLog, Scenario, Simulation, Tether, Trace, attach, simulate
from uvms_mj.physics.cable import CABLE, NODE, advance_cable, cable_state, place_ends, swing
from uvms_mj.physics.kernels import called_on, kernel
from uvms_mj.physics.surfaces import SHAPES, SURFACE
from uvms_mj.plant.settings import Surface
from uvms_mj.plant.tether import _bent
from uvms_mj.setup.base import set_up
from uvms_mj.setup.checks import warnings_of
from vehicles import load

HELD = 1e12
"""An inertia that no cable moves [kg]."""


@kernel
def held_steps(cable, nodes, state, flows, pose, rows, surfaces, t_0, count, walls):
    """Steps of a cable whose end is held, or free if it has no inertia. Rows (count, m) get its tensions, positions and
    velocities, and the force at the end."""
    n, h = state.p.shape[0], cable.timestep
    for k in range(count):
        nu = np.zeros(6)
        nu[:3] = pose[1]
        place_ends(cable, nodes.nodes, state, (t_0 + k) * h, pose[0], np.eye(3), nu)
        swing(cable, state, np.eye(3), np.array([0.0, 0.0, -9.81]), flows, surfaces, walls)
        row = rows[k]
        for i in range(n - 1):
            row[i] = state.tension[i]
        for i in range(n):
            row[n - 1 + 3 * i : n + 2 + 3 * i] = state.p[i]
            row[4 * n - 1 + 3 * i : 4 * n + 2 + 3 * i] = state.v[i]
        row[7 * n - 1 : 7 * n + 2] = state.f
        advance_cable(cable, state)
        if cable.inertia[0, 0] < 1.0:
            pose[1] = state.v_next[n - 1]
            pose[0] += h * pose[1]
    return 0


class Held:
    """A cable between its anchor and a point, in steady water, among walls."""

    def __init__(self, tether: Tether, end, h, speed=0.0, start=None, walls=()):
        self.n = tether.elements + 1
        self.cable, self.state = np.zeros(1, CABLE), np.zeros(1, cable_state(self.n))
        self.cable[0] = tether.cable_numbers(h, HELD * np.eye(3))
        self.nodes = np.zeros(1, np.dtype([("nodes", NODE, (self.n,))]))
        a, b = np.array(tether.anchor), np.array(end)
        if start is None:
            slack = 0.5 * math.sqrt(max(0.0, tether.length**2 - (b - a) @ (b - a)))
            corner = 0.5 * (a + b) + slack * np.array([1.0, 0.0, 0.0] if speed else [0.0, 0.0, -1.0])
            s = np.linspace(0.0, 2.0, self.n)[:, None]
            start = np.where(s < 1.0, a + s * (corner - a), corner + (s - 1.0) * (b - corner))
        self.nodes["nodes"]["start"][0] = start
        self.flows, self.pose, self.done = np.zeros((self.n, 6)), np.array([b, np.zeros(3)]), 0
        self.flows[:, 0] = speed
        self.surfaces, self.walls = np.zeros(max(2, len(walls)), SURFACE), len(walls)
        for record, wall in zip(self.surfaces, walls, strict=False):
            wall.place(record)

    def run(self, count):
        """Tensions (count, n), positions and velocities (count, n + 1, 3), force on the held end (count, 3)."""
        rows, n = np.zeros((count, 7 * self.n + 2)), self.n
        arrays = self.cable, self.nodes, self.state, self.flows, self.pose, rows, self.surfaces
        called_on(held_steps, *arrays)(self.done, count, self.walls)
        self.done += count
        shape = (count, n, 3)
        p, v = rows[:, n - 1 : 4 * n - 1].reshape(shape), rows[:, 4 * n - 1 : 7 * n - 1].reshape(shape)
        return rows[:, : n - 1], p, v, rows[:, 7 * n - 1 :]


SPAN = {"anchor": (0.0, -10.0, 0.0), "length": 22.0, "diameter": 7.6e-3, "drag_along": 0.0}
NEUTRAL = 1000.0 * math.pi / 4.0 * 7.6e-3**2


def across(elements, **keys):
    """A neutral cable across a current of 0.5 m/s: relative errors of its sag and its tension in the middle."""
    a, tension = 13.09928, 14.9332  # of a = T/q, q = rho C_d d U^2 / 2, for a span of 20 m
    held = Held(Tether(**SPAN, mass=NEUTRAL, elements=elements, **keys), (0.0, 10.0, 0.0), 5e-3, speed=0.5)
    T, p, v, f = held.run(20000)
    assert np.abs(v[-1]).max() < 1e-9
    sag = a * (math.cosh(10.0 / a) - 1.0)
    middle = 0.5 * (T[-1, elements // 2 - 1] + T[-1, elements // 2])
    assert sag == pytest.approx(4.00602, abs=1e-5)
    return p[-1, :, 0].max() / sag - 1.0, middle / tension - 1.0, f[-1]


def test_a_neutral_cable_across_a_current_is_a_catenary():
    """Each end is pulled with 9.60 N along the flow; the error falls with the square of the number of elements."""
    errors = {n: across(n) for n in (10, 20, 40)}
    assert abs(errors[40][0]) < 1e-3
    assert abs(errors[40][1]) < 1e-3
    assert errors[10][0] / errors[20][0] == pytest.approx(4.0, rel=0.05)
    assert errors[20][0] / errors[40][0] == pytest.approx(4.0, rel=0.05)
    assert abs(errors[40][2][0]) == pytest.approx(9.60, abs=0.01)
    assert np.linalg.norm(errors[40][2]) == pytest.approx(14.9332, rel=1e-3)


def test_no_stiffness_changes_the_step():
    """From cloth to a rod that does not stretch, in the same step."""
    stiff, hard = (across(20, stiffness=EA) for EA in (1e5, 1e12))
    rigid = across(20)
    assert hard[0] == pytest.approx(rigid[0], abs=1e-9)
    assert 0.0 < stiff[0] - rigid[0] < 1e-3  # it stretches by 15 N/1e5 N


def test_lowe_and_langleys_case():
    """Static reactions of a heavy cable (2006, kN), here without its bending stiffness, which is left out."""
    keys = {"diameter": 0.396, "mass": 165.0, "stiffness": 5e8, "length": 170.0, "elements": 40, "drag_along": 0.5}
    held = Held(Tether(anchor=(-100.0, 0.0, -55.0), **keys), (0.0, 0.0, -5.0), 2e-2)
    T, p, v, f = held.run(40000)
    assert np.abs(v[-1]).max() < 1e-2
    e = (p[-1, 1] - p[-1, 0]) / np.linalg.norm(p[-1, 1] - p[-1, 0])
    half = (165.0 - 1000.0 * math.pi / 4.0 * 0.396**2) * 9.81 * 170.0 / 80.0
    bottom = T[-1, 0] * e - [0.0, 0.0, half]  # the force on the anchor
    np.testing.assert_allclose(np.abs(f[-1]) / 1e3, [11.40, 0.0, 45.71], atol=0.2)
    np.testing.assert_allclose(np.abs(bottom) / 1e3, [11.40, 0.0, 24.04], atol=0.2)


def test_a_hanging_chain_swings_with_its_frequency():
    """omega_1 = 1.2024 sqrt(g/L) with a free end, and the shape of a Bessel function."""
    L, n, h = 2.0, 40, 1e-3
    keys = {"diameter": 1e-3, "mass": 1.0, "drag_coefficient": 0.0, "drag_along": 0.0, "added_mass": 0.0}
    s = np.linspace(0.0, L, n + 1)
    start = np.zeros((n + 1, 3))
    start[:, 0] = 1e-3 * j0(2.404826 * np.sqrt((L - s) / L))
    start[1:, 2] = -np.cumsum(np.sqrt((L / n) ** 2 - np.diff(start[:, 0]) ** 2))
    held = Held(Tether(anchor=tuple(start[0]), length=L, elements=n, **keys), start[-1], h, start=start)
    held.cable["inertia"] = 1e-9 * np.eye(3)
    x = held.run(12000)[1][:, n // 2, 0]
    down = np.flatnonzero((x[:-1] > 0.0) & (x[1:] <= 0.0))
    assert len(down) >= 3
    exact = down + x[down] / (x[down] - x[down + 1])
    period = h * np.diff(exact).mean()
    omega = 1.2024 * math.sqrt(9.81 * (1.0 - 1000.0 * math.pi / 4.0 * 1e-6) / L)
    assert 2.0 * math.pi / period == pytest.approx(omega, rel=2e-3)


def test_energy_is_in_balance_to_1e_6_of_the_work():
    """A swinging elastic cable whose anchor is moved: work of the anchor and of weight, less drag, is the change of
    kinetic and elastic energy and what the implicit scheme takes out, each from the recorded states."""
    h, n = 4e-5, 20
    keys = {"mass": 0.3, "stiffness": 2e3, "length": 5.0, "elements": n, "added_mass": 0.0, "drag_along": 0.05}
    moved = {"anchor_amplitude": (0.0, 0.2, 0.1), "anchor_frequency_hz": 0.7}
    held = Held(Tether(anchor=(0.0, 0.0, 0.0), **keys, **moved), (0.0, 4.0, 0.0), h)
    T, p, v, _ = held.run(50_000)
    c = held.cable[0]
    m, v_next, v = c["mass"], v[1:, 1:-1], v[:-1, 1:-1]
    dv = v_next - v
    kinetic = 0.5 * m * (np.einsum("kij,kij->", v_next[-1:], v_next[-1:]) - np.einsum("kij,kij->", v[:1], v[:1]))
    elastic = 0.5 * c["compliance"] * (T[-2] @ T[-2])
    weight = h * np.sum(v_next[:, :, 2]) * -9.81 * (m - c["displaced"])
    d = np.diff(p, axis=1)
    lengths = np.linalg.norm(d, axis=2)
    e = d / lengths[..., None]
    at_anchor = np.einsum("kj,kj,k->", e[:-1, 0], (p[1:, 0] - p[:-1, 0]), -T[:-1, 0])
    t = e[:-1, :-1] + e[:-1, 1:]
    t /= np.linalg.norm(t, axis=2)[..., None]
    along = np.einsum("kij,kij->ki", v, t)
    w_n = v - along[..., None] * t
    next_along = np.einsum("kij,kij->ki", v_next, t)
    D_n, D_t = c["drag_across"] * np.linalg.norm(w_n, axis=2), c["drag_along"] * np.abs(along)
    next_n = np.einsum("kij,kij->ki", v_next, v_next) - next_along**2
    drag = h * np.sum(D_n * next_n + D_t * next_along**2)
    before = np.vstack([np.zeros((1, n)), T[:-2]])
    stiff = before[:, :-1] / lengths[:-1, :-1] + before[:, 1:] / lengths[:-1, 1:]
    dv_along = np.einsum("kij,kij->ki", dv, t)
    slowed = np.sum(h * h * stiff * (np.einsum("kij,kij->ki", v_next, dv) - next_along * dv_along))
    scheme = 0.5 * m * np.sum(dv * dv) + slowed
    # what the tensions take: elastic energy, the scheme's loss in the springs, and turning elements
    stretch = np.einsum("kij,kij->ki", e[:-1], np.diff(p[1:] - p[:-1], axis=1))
    turned = lengths[:-1] - c["length"] - c["compliance"] * before
    springs = np.sum(0.5 * c["compliance"] * (T[:-1] - before) ** 2 - T[:-1] * turned)
    work = np.abs(np.einsum("kj,kj,k->k", e[:-1, 0], (p[1:, 0] - p[:-1, 0]), T[:-1, 0])).sum()
    assert abs(np.sum(T[:-1] * stretch) - elastic - springs) < 1e-6 * work
    assert abs(kinetic + elastic + drag + scheme + springs - weight - at_anchor) < 1e-6 * work
    assert work > 1.0
    assert drag > 0.05 * work
    assert abs(scheme) + abs(springs) < 0.02 * work  # of first order in the step


def of_moordyn(folder, tether: Tether, end, speed: float, seconds: float, every: float):
    """Positions (k, n + 1, 3) and tensions in the middle (k,) of the same cable in MoorDyn, its anchor moved along."""
    moordyn = pytest.importorskip("moordyn")
    moves = any(tether.anchor_amplitude)
    points = [("Coupled" if moves else "Fixed", tether.anchor), ("Fixed", end)]
    rows = "\n".join(f"{i + 1} {kind} {x} {y} {z} 0 0 0 0" for i, (kind, (x, y, z)) in enumerate(points))
    drag, skin = tether.drag_coefficient, tether.drag_along
    line = f"{tether.diameter} {tether.mass} {tether.stiffness} -0.1 0 {drag} {tether.added_mass} {skin} 0"
    options = "1e-3 dtM\nRK4 tScheme\n1000 WtrDnsty\n9.81 gravity\n200 WtrDpth\n0 kBot\n0 cBot\n1 dtIC\n60 TmaxIC\n"
    head = "- TypeName Diam Mass/m EA BA EI Cd Ca CdAx CaAx\n- - - - - - - - - -"
    text = (
        f"MoorDyn\n--- LINE TYPES ---\n{head}\nt {line}\n--- POINTS ---\n- -\n- -\n{rows}\n--- LINES ---\n- -\n- -\n"
        f"1 t 1 2 {tether.length} {tether.elements} -\n--- OPTIONS ---\n0 writeLog\n{options}1e-7 threshIC\n1 WaveKin\n"
        "1 disableOutTime\n--- end ---\n"
    )
    path = folder / "cable.txt"
    path.write_text(text)
    system = moordyn.Create(str(path))
    omega, base, amplitude = 2.0 * math.pi * tether.anchor_frequency_hz, tether.anchor, tether.anchor_amplitude
    moordyn.Init(system, list(base) if moves else [], [0.0, 0.0, 0.0] if moves else [])
    moordyn.ExternalWaveKinInit(system)
    count = len(moordyn.ExternalWaveKinGetCoordinates(system))
    still = [[0.0, 0.0, 0.0]] * count
    moordyn.ExternalWaveKinSet(system, [[speed, 0.0, 0.0]] * count, still, 0.0)
    found, h = line_of(moordyn, system, tether.elements), 2e-3
    p, tensions = [found[0]], [found[1]]
    for k in range(round(seconds / every)):
        for i in range(round(every / h)):
            t = k * every + i * h
            x = [b + a * math.sin(omega * t) for b, a in zip(base, amplitude, strict=True)] if moves else []
            v = [a * (math.sin(omega * (t + h)) - math.sin(omega * t)) / h for a in amplitude] if moves else []
            moordyn.Step(system, x, v, t, h)
        found = line_of(moordyn, system, tether.elements)
        p.append(found[0])
        tensions.append(found[1])
    moordyn.Close(system)
    return np.array(p), np.array(tensions)


def line_of(moordyn, system, n: int):
    """The nodes of the line, and the tension at its middle node."""
    line = moordyn.GetLine(system, 1)
    nodes = np.array([moordyn.GetLineNodePos(line, i) for i in range(n + 1)])
    return nodes, float(np.linalg.norm(moordyn.GetLineNodeTen(line, n // 2)))


HEAVY = {"length": 22.0, "diameter": 0.01, "mass": 0.3, "stiffness": 2e4, "elements": 20, "drag_along": 0.0}


@pytest.mark.parametrize("speed", [0.0, 0.5])
def test_moordyn_has_the_same_cable_at_rest(tmp_path, speed):
    """A heavy one in still water and in a current across it."""
    tether, end = Tether(anchor=(0.0, -10.0, -30.0), **HEAVY), (0.0, 10.0, -25.0)
    p_other, T_other = of_moordyn(tmp_path, tether, end, speed, 40.0, 40.0)
    T, p, v, _ = Held(tether, end, 5e-3, speed=speed).run(20000)
    assert np.abs(v[-1]).max() < 5e-3  # a quadratic drag stops nothing quite
    np.testing.assert_allclose(p[-1], p_other[-1], atol=0.01)
    assert 0.5 * (T[-1, 9] + T[-1, 10]) == pytest.approx(T_other[-1], rel=3e-3)


def test_moordyn_has_the_same_cable_whose_end_is_moved(tmp_path):
    """Both begin at the rest in still water, and the anchor moves as a sine."""
    moved = {"anchor_amplitude": (0.8, 0.0, 0.6), "anchor_frequency_hz": 0.25}
    tether, end, h = Tether(anchor=(0.0, -10.0, -30.0), **HEAVY, **moved), (0.0, 10.0, -25.0), 1e-3
    p_other, T_other = of_moordyn(tmp_path, tether, end, 0.0, 12.0, 0.1)
    T, p, _, _ = Held(tether, end, h, start=p_other[0]).run(12001)
    at = slice(0, None, 100)
    apart = np.linalg.norm(p[at, 10] - p_other[:, 10], axis=1)
    swing_of_middle = np.linalg.norm(np.ptp(p_other[:, 10], axis=0))
    middle = 0.5 * (T[at, 9] + T[at, 10])
    assert swing_of_middle > 0.5
    assert apart.max() < 0.02 * swing_of_middle
    assert np.abs(middle - T_other)[10:].max() < 0.05 * np.ptp(T_other[10:])


MOVING = {
    "tether.length": 6.0,
    "tether.elements": 12,
    "tether.anchor": [-3.0, 1.0, -1.0],
    "tether.position": [-0.2, 0.0, 0.1],
    "simulation.duration": 2.0,
}


@pytest.mark.parametrize("EA", [None, 6e4])
def test_both_engines_move_the_same_cable(EA):
    over = MOVING | {"tether.stiffness": EA, "tether.anchor_velocity": [0.0, 0.1, 0.0]}
    first, second = (simulate(Scenario.load("push_wall", over), engine=each) for each in ("free_body", "mujoco"))
    np.testing.assert_allclose(first.p_WB, second.p_WB, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(first.tether_nodes, second.tether_nodes, atol=1e-6)
    assert first.tether_nodes.shape[1:] == (13, 3)
    assert first.tether_tension.shape[1:] == (12,)
    assert "tether" in first.analytic.reason
    without = simulate(Scenario.load("push_wall", {"simulation.duration": 2.0}), engine="free_body")
    assert np.abs(first.tau_dist - without.tau_dist).max() > 0.1


@pytest.mark.parametrize("engine", ["free_body", "mujoco"])
def test_a_reset_repeats_bit_for_bit_and_a_log_has_the_nodes(engine, tmp_path):
    scenario = Scenario.load("push_wall", MOVING)
    with Simulation(scenario, engine=engine) as sim:
        sim.step(3000)
        first = sim.signals.tether_nodes.copy(), sim.signals.tether_tension.copy(), sim.signals.p_WB.copy()
        sim.reset()
        sim.step(3000)
        again = sim.signals.tether_nodes, sim.signals.tether_tension, sim.signals.p_WB
        assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
        sim.reset({"initial.position": [-0.2, 0.0, 0.0], "tether.mass": 0.06})
        sim.step(3000)
        with Simulation(sim.scenario, engine=engine) as fresh:
            fresh.step(3000)
            assert np.array_equal(fresh.signals.tether_nodes, sim.signals.tether_nodes)
        with pytest.raises(InputError, match=r"tether\.elements: .* can't change the number of elements"):
            sim.reset({"tether.elements": 8})
        sim.reset({"tether.length": 0.0, "tether.elements": 0, "tether.anchor": [0.0, 0.0, 0.0]})
        sim.step(300)
        assert not sim.signals.tether_tension.any()
    trace = simulate(scenario, engine=engine, sinks=[McapLog(tmp_path / "run.mcap")])
    assert np.array_equal(Trace.load(tmp_path / "run.mcap").tether_nodes, trace.tether_nodes)


def test_it_begins_at_rest_in_the_mean_current():
    scenario = Scenario.load("push_wall", MOVING | {"tether.stiffness": 6e4, "initial.position": [0.5, 0.0, 0.0]})
    with Simulation(scenario, engine="free_body") as sim:
        before = None
        for _ in range(2):
            sim.step(1)
            before = sim.signals.tether_nodes.copy() if before is None else before
        sim.step(500)
        assert np.abs(sim.signals.tether_nodes[:-4] - before[:-4]).max() < 2e-3


@pytest.mark.parametrize("EA", [None, 1e2, 1e5, 1e12])
@pytest.mark.parametrize("h", [1e-4, 2e-3])
def test_slack_and_snap(EA, h):
    """A vehicle without a law runs into the end of its slack cable, and stays within the cable's reach."""
    keys = {
        "tether.length": 2.0,
        "tether.elements": 10,
        "tether.stiffness": EA,
        "tether.anchor": [-0.5, 0.0, 0.0],
        "disturbance.bias": [60.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        "current.speed": 0.0,
        "controller.name": "external",
        "wall.present": False,
        "simulation.duration": 4.0,
        "simulation.timestep": h,
    }
    trace = simulate_without_law(Scenario.load("push_wall", keys))
    T, reach = trace["tension"], np.linalg.norm(trace["p"] - [-0.5, 0.0, 0.0], axis=1).max()
    assert np.isfinite(T).all()
    assert np.isfinite(trace["nodes"]).all()
    assert T.max() > 5.0 * T[0].max()  # slack, then taut
    if EA is None or EA > 1e4:
        assert reach < 2.02
    lengths = np.linalg.norm(np.diff(trace["nodes"], axis=1), axis=2)
    if EA is None:
        assert lengths.max() < 0.2 * 1.02


def simulate_without_law(scenario):
    found = {"tension": [], "nodes": [], "p": []}
    with Simulation(scenario, engine="free_body", looks=False) as sim:
        for _ in range(400):
            sim.step(round(sim.scenario.simulation.duration / sim.scenario.simulation.timestep / 400))
            found["tension"].append(sim.signals.tether_tension.copy())
            found["nodes"].append(sim.signals.tether_nodes.copy())
            found["p"].append(sim.signals.p_WB.copy())
    return {name: np.array(rows) for name, rows in found.items()}


def test_a_hanging_cable_lies_on_its_floor():
    keys = {"length": 6.0, "elements": 24, "mass": 0.3, "floor": -2.0, "stiffness": 1e5}
    _, p, v, _ = Held(Tether(anchor=(0.0, -2.0, -1.0), **keys), (0.0, 2.0, -1.0), 2e-3).run(20000)
    on_it = p[-1, :, 2] < -2.0
    assert on_it.sum() > 4
    assert p[-1, :, 2].min() > -2.006  # a node sinks by g/omega^2 and less
    assert np.abs(v[-1]).max() < 5e-3


def over_a_bar(elements):
    """A heavy elastic cable that hangs over a bar of 0.5 m radius with both ends below it: at its rest the tensions,
    the heights of the elements' middles, and the nodes."""
    keys = {"length": 5.0, "elements": elements, "mass": 0.5, "stiffness": 1e3, "diameter": 0.01}
    bar = Surface(shape="cylinder", position=(0.0, 0.0, 0.0), attitude_deg=(90.0, 0.0, 0.0), radius=0.5)
    anchor, end = (-0.8, 0.0, -1.5), (1.2, 0.0, -1.0)
    s = np.linspace(0.0, 1.0, elements + 1)[:, None]
    way = np.array([anchor, [-0.6, 0.0, 0.7], [0.6, 0.0, 0.7], end])
    start = np.column_stack([np.interp(s[:, 0], [0.0, 0.4, 0.6, 1.0], way[:, i]) for i in range(3)])
    held = Held(Tether(anchor=anchor, **keys), end, 2e-3, start=start, walls=(bar,))
    held.cable["drag_across"] *= 20.0  # which moves no rest
    for _ in range(12):
        T, p, v, _ = held.run(4000)
        held.state["v"][0] *= 0.1
    assert np.abs(v[-1]).max() < 1e-4
    return T[-1], 0.5 * (p[-1, 1:, 2] + p[-1, :-1, 2]), p[-1]


def test_without_friction_the_tension_over_a_bar_changes_with_the_height_alone():
    """As of a rope over a pulley: T - w z is the same in all elements, whatever they lie on. The error falls with the
    square of their number, and the nodes lie on the bar."""
    errors = []
    for elements in (25, 50):
        T, z, p = over_a_bar(elements)
        weight = 9.81 * (0.5 - 1000.0 * math.pi / 4.0 * 0.01**2)  # of an element without tension, per length
        level = T - weight * z
        level += 0.5 * T**2 / 1e3  # the stretched part of a length weighs less: d(T + T^2/2 EA) = w dz
        on_it = np.hypot(p[:, 0], p[:, 2]) < 0.5
        assert on_it.sum() > elements // 6
        assert np.hypot(p[:, 0], p[:, 2]).min() > 0.5 - 1e-3
        assert np.ptp(T) > 4.0
        errors.append(np.ptp(level) / T.max())
    assert errors[1] < 0.02
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


def test_a_wall_that_moves_carries_the_cable_in_both_engines():
    """A pile sweeps the cable before it: no node is in it by more than its share of the push, and the vehicle is
    pulled."""
    pile = {"shape": "cylinder", "position": [-1.5, -0.6, 0.0], "radius": 0.3}
    swept = pile | {"motion": [[0.0, 0.0, 0.0, 0.0], [2.0, 0.0, 1.2, 0.0]]}
    over = MOVING | {"tether.length": 3.7, "tether.anchor": [-3.0, 0.0, 0.0], "current.speed": 0.0, "walls": [swept]}
    first, second = (simulate(Scenario.load("push_wall", over), engine=each) for each in ("free_body", "mujoco"))
    np.testing.assert_allclose(first.tether_nodes, second.tether_nodes, atol=1e-5)
    away = simulate(Scenario.load("push_wall", over | {"walls": [pile]}), engine="free_body")
    axis = np.array([-1.5, -0.6])[None] + np.outer(np.minimum(first.t, 2.0), [0.0, 0.6])
    inside = 0.3 - np.linalg.norm(first.tether_nodes[:, :, :2] - axis[:, None], axis=2)
    assert 0.0 < inside.max() < 5e-3
    assert first.tether_nodes[-1, 6, 1] > away.tether_nodes[-1, 6, 1] + 0.3
    assert np.abs(first.tau_dist - away.tau_dist).max() > 1.0


@pytest.mark.parametrize("shape", ["plane", "sphere", "cylinder", "box"])
@pytest.mark.parametrize(("EA", "h"), [(None, 2e-4), (1e4, 1e-3)])
def test_a_cable_thrown_onto_a_wall_gains_no_energy(shape, EA, h):
    """Without drag: kinetic energy and height together stay below where they began."""
    keys = {"length": 3.0, "elements": 16, "mass": 0.3, "added_mass": 0.0, "drag_coefficient": 0.0, "drag_along": 0.0}
    size = {key: (0.5, 0.5, 0.4) if key == "edges" else 0.3 for key in SHAPES[shape].keys}
    turned = (0.0, 100.0, 0.0) if shape == "plane" else (90.0, 0.0, 20.0)
    wall = Surface(shape=shape, position=(0.6, 0.05, -0.7), attitude_deg=turned, **size)
    end = np.array([1.5, 0.3, 0.2])
    start = _bent(np.zeros(3), end, 3.0, np.array([0.0, 1.0, 0.2]), 17)
    assert min(wall.nearest(place)[0] for place in start) > 0.0
    held = Held(Tether(anchor=(0.0, 0.0, 0.0), stiffness=EA, **keys), end, h, start=start, walls=(wall,))
    _, p, v, _ = held.run(round(4.0 / h))
    c = held.cable[0]
    weight = 9.81 * (c["mass"] - c["displaced"])
    energy = 0.5 * c["mass"] * (v[:, 1:-1] ** 2).sum(axis=(1, 2)) + weight * p[:, 1:-1, 2].sum(axis=1)
    assert abs(min(wall.nearest(place)[0] for place in p[-1, 1:-1])) < 1e-3  # it lies on it
    assert energy.max() - energy[0] < 1e-3 * weight * 3.0 * 16
    assert energy[-1] < energy[0] - 0.05 * weight * 3.0 * 16


def test_a_cable_begins_outside_of_walls_and_one_of_long_elements_is_named():
    pile = {"shape": "cylinder", "position": [-1.6, 1.7, 0.0], "radius": 0.3}  # in the way that the current sends it
    setup = set_up(Scenario.load("push_wall", MOVING | {"walls": [pile]}))
    starts = setup.effects["nodes"]["start"][0][1:-1]
    distances = [setup.scenario.walls[0].nearest(start)[0] for start in starts]
    assert -2e-3 < min(distances) < 0.0
    assert any("is longer than walls[0]" in note for note in warnings_of(setup))
    few = set_up(setup.scenario.updated({"tether.elements": 60}))
    assert not any("is longer than" in note for note in warnings_of(few))


def test_a_vehicle_hangs_at_its_cable():
    """At rest the cable bears the vehicle's weight in water, and its own."""
    keys = {
        "tether.length": 2.0,
        "tether.elements": 10,
        "tether.mass": 0.2,
        "tether.anchor": [0.0, 0.0, 2.0],
        "tether.stiffness": 1e4,
        "vehicle.displaced_mass": 0.9,
        "current.speed": 0.0,
        "controller.name": "external",
        "wall.present": False,
        "simulation.duration": 60.0,
        "simulation.timestep": 2e-3,
    }
    scenario = Scenario.load("push_wall", keys)
    with Simulation(scenario, engine="free_body", looks=False) as sim:
        sim.step(30000)
        vehicle, T = sim.setup.vehicle, sim.signals.tether_tension
        weight = 9.81 * (vehicle.mass - vehicle.displaced_mass)
        element = 9.81 * (0.2 - 1000.0 * math.pi / 4.0 * 7.6e-3**2) * 0.2
        np.testing.assert_allclose(T, weight + element * (9.5 - np.arange(10)), rtol=2e-3)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"tether.length": 1.0}, r"tether\.length: 1 m is shorter than the distance of 3\.\d+ m from its anchor"),
        ({"tether.stiffness": 0.0}, r"tether\.stiffness"),
        ({"tether.anchor": [1.6, 0.0, 0.0]}, r"tether\.anchor: is 0\.\d+ m inside wall"),
        ({"tether.floor": 0.0}, r"tether\.anchor: is 1 m below the floor"),
        ({"tether.elements": 1}, r"elements must be 0 or at least 2"),
        ({"tether.elements": 0}, r"anchor of a cable that moves, which a tether is with elements"),
        ({"tether.length": 0.0}, r"tether\.length: a tether with elements needs a length"),
        ({"tether.anchor_frequency_hz": 1.0}, r"needs anchor_amplitude and anchor_frequency_hz"),
        (
            {"tether.anchor_amplitude": [0.1, 0.0, 0.0], "tether.anchor_frequency_hz": 501.0},
            r"anchor_frequency_hz: 501 Hz must be at most 500 Hz",
        ),
        (
            {"tether.floor": 0.0, "tether.anchor": [-3.0, 1.0, 1.0], "initial.position": [0.0, 0.0, -0.5]},
            r"tether\.floor: 0 m is above the cable's end at the vehicle, at z = -0\.4 m",
        ),
        ({"tether.anchor_velocity": [3.0, 0.0, 0.0]}, r"tether\.anchor: comes 1\.\d+ m inside wall on its way"),
        ({"tether.anchor_velocity": [0.0, 0.0, -1.0], "tether.floor": -2.0}, r"comes 1 m below the floor on its way"),
        ({"sea.height": 0.3, "sea.depth": 2.5}, r"tether\.anchor: comes to z = -1 m, below the bottom of the sea"),
        ({"sea.height": 0.3, "sea.depth": 4.0, "tether.floor": -3.0}, r"tether\.floor: -3 m is below the bottom"),
        (
            {"obstacle.half_width": 1.0, "current.direction_deg": 20.0},
            r"the current at the edges of a face is infinite",
        ),
        ({"tether.elements": "12"}, r"tether\.elements: '12' is not a whole number"),
        ({"tether.elements": True}, r"tether\.elements: True is not a whole number"),
        (
            {"walls": [{"shape": "sphere", "position": [-3.0, 1.0, -1.2], "radius": 0.5}]},
            r"tether\.anchor: is 0\.3 m inside walls\[0\]",
        ),
    ],
)
def test_bad_input_has_one_sentence(keys, said):
    with pytest.raises(InputError, match=said) as error:
        simulate(Scenario.load("push_wall", MOVING | keys), engine="free_body")
    assert len(error.value.faults) == 1


def test_a_run_says_what_a_cable_changes():
    """A cable that holds the vehicle back, one out of the water, and notes that leave it out."""
    scenario = Scenario.load("push_wall", MOVING | {"reference.target": [9.0, 0.0, 0.0], "sea.height": 0.3})
    notes = warnings_of(set_up(scenario.updated({"tether.anchor": [-3.0, 1.0, 2.5]})))
    for words in ("the reference ends 12", "is above the trough of the waves", "do not know the pull of the cable"):
        assert sum(words in note for note in notes) == 1
    notes = warnings_of(set_up(Scenario.load("push_wall", MOVING)))
    assert [note for note in notes if "cable" in note] == [
        "notes on chatter, vibration and bounces do not know the pull of the cable of [tether]"
    ]


def test_joints_and_attach_are_refused():
    with pytest.raises(InputError, match=r"tether\.elements: the pull .* not computed for a vehicle with joints"):
        Simulation(Scenario.load("tool_push", {"tether.length": 9.0, "tether.elements": 4}))
    model, data = load(TwinParameters())
    with pytest.raises(InputError, match=r"tether: moves from step to step of a run"):
        attach(model, data, tether=Tether(length=3.0, elements=4))


@pytest.mark.parametrize("over", [0.64, 1.05])
def test_a_long_and_nearly_neutral_cable_begins_as_a_catenary(over):
    """76 m between ends 26 m apart in still water, lighter and hardly heavier than it: its rest takes minutes."""
    far = {"tether.anchor": [-26.0, 0.0, 0.0], "tether.length": 76.0, "tether.elements": 40, "current.speed": 0.0}
    setup = set_up(Scenario.load("push_wall", far | {"tether.mass": over * NEUTRAL}))
    a = brentq(lambda a: 2.0 * a * math.sinh(13.0 / a) - 76.0, 2.0, 100.0)
    sag = a * (math.cosh(13.0 / a) - 1.0)
    middle = setup.effects["nodes"]["start"][0][20]
    np.testing.assert_allclose(middle, [-13.0, 0.0, sag if over < 1.0 else -sag], atol=2e-3 * 76.0)
