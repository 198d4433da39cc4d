"""The physics of couplings between vehicles: against equations that are written down anew, loads, arms and surfaces."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from two_bars import BAR, DRY, bars
from uvms_mj import (
    InputError,
    McapLog,
    Scenario,
    Trace,
    World,
    WorldSimulation,
    coupled_rest,
    internal_forces,
    simulate,
)
from uvms_mj.control.base import NoClosedForm
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.plant.settings import lightest_at

ENGINES = ("free_body", "mujoco")

# two vehicles in the water, from Fossen's equations and the numbers of the file alone

MASS, R_G = 7.31, np.array([0.0, 0.0, -0.00019])
M_A = np.diag([5.5, 12.7, 14.57, 0.12, 0.12, 0.12])
D_LINEAR = np.array([4.03, 6.22, 5.18, 0.07, 0.07, 0.07])
D_QUADRATIC = np.array([18.18, 21.66, 36.99, 1.55, 1.55, 1.55])
GRAVITY = 9.81


def skew(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


M_RB = np.block([[MASS * np.eye(3), -MASS * skew(R_G)], [MASS * skew(R_G), 0.16 * np.eye(3)]])


def accelerated(R, nu, f_W, arm_W):
    """nu_dot of one neutral BlueROV1 under a force, by Kirchhoff's equations of its momentum."""
    v, omega, momentum = nu[:3], nu[3:], (M_RB + M_A) @ nu
    up = R.T @ [0.0, 0.0, 1.0]
    tau = -D_LINEAR * nu - D_QUADRATIC * np.abs(nu) * nu
    tau[:3] += R.T @ f_W - np.cross(omega, momentum[:3])
    tau[3:] += R.T @ np.cross(arm_W, f_W) - np.cross(omega, momentum[3:]) - np.cross(v, momentum[:3])
    tau[3:] -= np.cross(MASS * GRAVITY * R_G, up)
    return np.linalg.solve(M_RB + M_A, tau)


def force_on_the_first(coupling, d, w):
    distance, k, b, L = np.linalg.norm(d), coupling["stiffness"], coupling["damping"], coupling.get("length", 0.0)
    if coupling["kind"] == "joint":
        return k * d + b * w
    T = k * (distance - L) + b * (d @ w) / distance
    if coupling["kind"] == "cable":
        T = max(T, 0.0) if distance > L else 0.0
    if coupling["kind"] == "contact":
        T = min(T, 0.0) if distance < L else 0.0
    return T * d / distance


def integrated(coupling, start, times):
    """States (n, 26) of two coupled vehicles at times (n,): position, quaternion and nu of each, by DOP853."""
    r = np.array(coupling["points"])

    def rate(_, y):
        states = y.reshape(2, 13)
        p, nu = states[:, :3], states[:, 7:]
        R = Rotation.from_quat(states[:, 3:7], scalar_first=True).as_matrix()
        x = p + np.einsum("nij,nj->ni", R, r)
        x_dot = np.einsum("nij,nj->ni", R, nu[:, :3] + np.cross(nu[:, 3:], r))
        f, middle, out = force_on_the_first(coupling, x[1] - x[0], x_dot[1] - x_dot[0]), x.mean(axis=0), []
        for i, sign in enumerate((1.0, -1.0)):
            q, omega = states[i, 3:7], nu[i, 3:]
            turning = np.concatenate([[-q[1:] @ omega], q[0] * omega + np.cross(q[1:], omega)])
            out += [R[i] @ nu[i, :3], 0.5 * turning, accelerated(R[i], nu[i], sign * f, middle - p[i])]
        return np.concatenate(out)

    return solve_ivp(rate, times[[0, -1]], start, "DOP853", times, rtol=1e-8, atol=1e-10, max_step=1e-2).y.T


@pytest.mark.parametrize(("kind", "seed"), [("joint", 1), ("spring", 2), ("cable", 3), ("contact", 4)])
def test_two_coupled_vehicles_follow_equations_that_are_written_anew(kind, seed):
    """Two BlueROV1 with added mass, drag and turning, coupled at random points: the difference from an integrator of
    order eight is of the order of the step, in both engines."""
    rng = np.random.default_rng(seed)
    points, degrees = rng.uniform(-0.3, 0.3, (2, 3)), rng.uniform(-30.0, 30.0, (2, 3))
    R = [Rotation.from_euler("ZYX", each[::-1], degrees=True).as_matrix() for each in degrees]
    way, length = np.array([0.9, 0.3, -0.3]) / np.linalg.norm([0.9, 0.3, -0.3]), 1.0
    gap = {"joint": 0.02, "spring": 0.95, "cable": 0.99, "contact": 1.01}[kind]
    towards = {"cable": -0.3, "contact": 0.3}.get(kind, 0.0)
    nu = rng.uniform(-0.2, 0.2, (2, 6))
    nu[0, :3] += towards * R[0].T @ way
    coupling = {"vehicles": ["a", "b"], "kind": kind, "points": points.tolist(), "stiffness": 700.0, "damping": 3.0}
    coupling |= {"length": length} if kind != "joint" else {}
    positions = np.zeros(3), R[0] @ points[0] + gap * way - R[1] @ points[1]
    world = World.from_dict(
        {
            "simulation": {"duration": 0.5},
            "wall": {"present": False},
            "current": {"speed": 0.0},
            "controller": {"name": "none"},
            "couplings": [coupling],
            "vehicles": [
                {
                    "name": name,
                    "initial": {"position": p.tolist(), "attitude_deg": a.tolist(), "velocity": v.tolist()},
                }
                for name, p, a, v in zip("ab", positions, degrees, nu, strict=True)
            ],
        }
    )
    expected = None
    for engine in ENGINES:
        errors = []
        for h in (4e-4, 2e-4):
            traces = [*simulate(world.updated({"simulation.timestep": h}), engine=engine, log_rate=100.0).values()]
            found = np.hstack([np.hstack([each.p_WB, each.quat_WB, each.nu]) for each in traces])
            if expected is None:
                expected = integrated(coupling, found[0], traces[0].t)
            errors.append(np.abs(found - expected).max())
        assert np.abs(traces[0].f_couplings_W).max() > 5.0
        assert errors[1] < 3e-3
        assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)


# a contact body of one vehicle in front of a surface of another

BODY = Mjcf.find(BAR).vehicle
SHAPES = {
    "plane": {},
    "sphere": {"radius": 0.2},
    "cylinder": {"radius": 0.2},
    "capsule": {"radius": 0.2, "length": 0.4},
    "box": {"edges": [0.4, 1.0, 0.6]},
}


def heavy_bar(folder):
    """The path of a file with a bar of 1e8 times the inertia."""
    heavy = Path(BAR).read_text()
    for light, n in (('mass="9.4248"', "mass="), ('data="9.4248"', "data=")):
        assert heavy.count(light) == 1
        heavy = heavy.replace(light, f'{n}"9.4248e8"')
    heavy = heavy.replace('"1.1369 0.01178 1.1369"', '"1.1369e8 0.01178e8 1.1369e8"')
    (folder / "heavy.xml").write_text(heavy)
    return str(folder / "heavy.xml")


def thrown(shape, timestep, **contact):
    """A sphere before the middle of a turning bar is thrown at a surface that rides on another one."""
    reach = {"plane": 0.0, "box": 0.2}.get(shape, 0.2)
    position = [0.0, 0.1, 0.0] if shape == "box" else [0.0, 0.0, 0.0]
    surface = {"shape": shape, "position": position, "stiffness": 5e3, **SHAPES[shape], **contact}
    coupling = {"kind": "contact", "surface": surface, "body": {"position": [0.3, 0.1, 0.05], "radius": 0.1}}
    world = bars(coupling, (0.0, 0.0, 0.0), (0.42 + reach, 0.05, 0.0), timestep=timestep, duration=0.6)
    return world.updated(
        {
            "vehicles[a].initial.velocity": [0.5, 0.05, 0.02, 0.1, 0.0, 0.2],
            "vehicles[b].initial.velocity": [0.0, 0.1, 0.0, 0.2, 0.3, -0.1],
        }
    )


def momenta(traces):
    """Linear and angular momentum (n, 3) about W's origin and kinetic energy (n,) of bars without water."""
    M, moved, spun, energy = BODY.M_RB, 0.0, 0.0, 0.0
    for trace in traces.values():
        R = rotation_matrix(trace.quat_WB)
        p = M[0, 0] * np.einsum("nij,nj->ni", R, trace.nu[:, :3])
        spin = np.einsum("nij,jk,nk->ni", R, M[3:, 3:], trace.nu[:, 3:])
        moved, spun = moved + p, spun + np.cross(trace.p_WB, p) + spin
        energy = energy + 0.5 * np.einsum("ni,ij,nj->n", trace.nu, M, trace.nu)
    return moved, spun, energy


@pytest.mark.parametrize("shape", [*SHAPES])
def test_a_contact_with_a_surface_that_rides_keeps_momentum_and_energy(shape):
    """At each sample the reaction is the opposite force. Linear momentum is kept to rounding, angular momentum and the
    energy of an elastic contact by the order of the step."""
    lost = []
    for h in (1e-4, 2.5e-5):
        traces = simulate(thrown(shape, h), engine="free_body", log_rate=1e4)
        one, two = traces.values()
        moved, spun, energy = momenta(traces)
        assert np.array_equal(one.f_couplings_W, -two.f_couplings_W)
        assert np.abs(one.f_couplings_W).max() > 10.0
        assert not one.f_couplings_W[0].any()
        assert not one.f_couplings_W[-1].any()
        assert np.abs(moved - moved[0]).max() < 1e-12
        lost.append((np.abs(spun - spun[0]).max(), abs(energy[-1] / energy[0] - 1.0)))
    for coarse, fine in zip(*lost, strict=True):
        assert fine < 0.3 * coarse < 0.3 * 1e-3


def test_a_sphere_on_a_sphere_that_rides_is_the_contact_of_two_spheres():
    """The same force by two ways, with a damper, off the middle of two bars that turn."""
    points = [[0.3, 0.1, 0.05], [-0.1, 0.15, 0.1]]
    spheres = {"kind": "contact", "points": points, "length": 0.3, "stiffness": 5e3, "damping": 40.0}
    surface = {"shape": "sphere", "position": points[1], "radius": 0.2, "stiffness": 5e3, "damping": 40.0}
    riding = {"kind": "contact", "body": {"position": points[0], "radius": 0.1}, "surface": surface}
    start = {
        "vehicles[a].initial.velocity": [0.5, 0.05, 0.02, 0.1, 0.0, 0.2],
        "vehicles[b].initial.velocity": [0.0, 0.1, 0.0, 0.3, -0.5, 0.5],
    }
    found = []
    for coupling in (spheres, riding):
        world = bars(coupling, (0.0, 0.0, 0.0), (0.72, 0.0, 0.0), duration=0.4).updated(start)
        found.append(simulate(world, engine="free_body", log_rate="full"))
    assert np.abs(found[0]["a"].f_couplings_W).max() > 20.0
    for name in "ab":
        one, two = (traces[name] for traces in found)
        assert two.f_couplings_W == pytest.approx(one.f_couplings_W, abs=1e-8)
        assert two.p_WB == pytest.approx(one.p_WB, abs=1e-12)
        assert two.nu == pytest.approx(one.nu, abs=1e-11)


def test_friction_on_a_surface_that_rides_keeps_momentum_and_takes_energy():
    contact = {"friction": 0.5, "damping": 20.0}
    slid = simulate(thrown("box", 1e-4, **contact), engine="free_body", log_rate="full")
    moved, spun, energy = momenta(slid)
    force = slid["a"].f_couplings_W[:, 0]
    assert np.abs(force[:, 1:]).max() > 0.1 * np.abs(force).max()
    assert np.abs(moved - moved[0]).max() < 1e-12
    assert np.abs(spun - spun[0]).max() < 1e-3 * np.abs(spun[0]).max()
    assert energy[-1] < 0.99 * energy[0]
    assert np.diff(energy[force[:, 0] == 0.0]).max() < 1e-6 * energy[0]


def test_a_surface_on_a_body_that_hardly_moves_is_a_wall(tmp_path):
    """The same contact with friction as of one of [[walls]], on a bar of 1e8 times the inertia."""
    table = {"shape": "box", "edges": [0.4, 1.0, 0.6], "stiffness": 5e3, "damping": 10.0, "friction": 0.3}
    table |= {"tangential_stiffness": 4e3, "tangential_damping": 10.0}
    body = {"position": [0.3, 0.1, 0.05], "radius": 0.1}
    coupling = {"kind": "contact", "surface": table | {"position": [0.0, 0.0, 0.0]}, "body": body}
    changes = {"vehicles[a].initial.velocity": [0.5, 0.1, 0.0, 0.0, 0.0, 0.3]}
    changes["vehicles[b].vehicle.model"] = heavy_bar(tmp_path)
    riding = bars(coupling, (0.0, 0.0, 0.0), (0.65, 0.1, 0.0)).updated(changes)
    tables = {key: value for key, value in riding.scenarios["a"].to_dict().items() if key != "couplings"}
    tables["vehicle"] |= {"name": "", "contact_bodies": [body]}
    wall = Scenario.from_dict(tables | {"walls": [table | {"position": [0.65, 0.1, 0.0]}]})
    on_wall, on_vehicle = simulate(wall, engine="free_body"), simulate(riding, engine="free_body")["a"]
    assert np.abs(on_wall.f_contact_W).max() > 10.0
    assert np.abs(on_wall.f_contact_W[:, 1:]).max() > 3.0
    assert on_vehicle.p_WB == pytest.approx(on_wall.p_WB, abs=1e-7)
    assert on_vehicle.nu == pytest.approx(on_wall.nu, abs=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_world_with_friction_between_vehicles_is_reset_and_stepped_with_the_same_bits(engine):
    world = thrown("box", 1e-4, friction=0.4)
    traces = simulate(world, engine=engine, log_rate="full")
    with WorldSimulation(world, engine=engine) as sim:
        for _ in range(2):
            for n in (1, 400, 2000):
                sim.step(n)
                for name, trace in traces.items():
                    signals = sim.vehicles[name].signals
                    assert np.array_equal(signals.p_WB, trace.p_WB[sim.steps])
                    assert np.array_equal(signals.nu, trace.nu[sim.steps])
            sim.reset()


def test_plain_python_has_the_bits_of_machine_code(monkeypatch):
    world = thrown("box", 1e-3, friction=0.4, stiffness=500.0).updated({"simulation.duration": 0.06})

    def bits():
        traces = [trace for engine in ENGINES for trace in simulate(world, engine=engine, log_rate="full").values()]
        assert all(np.abs(trace.f_couplings_W).max() > 1.0 for trace in traces)
        return [signal.tobytes() for trace in traces for signal in (trace.p_WB, trace.nu)]

    compiled = bits()
    monkeypatch.setenv("UVMS_MJ_PLAIN", "1")
    with pytest.warns(UserWarning, match="runs as plain Python"):
        assert bits() == compiled


def test_both_engines_agree_on_a_surface_that_rides():
    found = [simulate(thrown("capsule", 1e-4, friction=0.4), engine=engine) for engine in ENGINES]
    for name in "ab":
        one, two = (traces[name] for traces in found)
        assert one.p_WB == pytest.approx(two.p_WB, abs=1e-12)
        assert one.nu == pytest.approx(two.nu, abs=1e-10)


@pytest.mark.parametrize(
    ("coupling", "said"),
    [
        (
            {"body": {"position": [0.3, 0.0, 0.0], "radius": 0.1}},
            "body and surface belong together; surface is missing",
        ),
        (
            {"kind": "joint"},
            "body and surface are of a contact, and this is a joint",
        ),
        ({"length": 0.1}, "a contact with a surface has no length; body and surface have its numbers"),
        (
            {"body": {"position": [0.3, 0.0, 0.0], "radius": 0.1, "body": "tool"}},
            "body.body has no effect: at names the frame of each vehicle",
        ),
        (
            {"body": {"position": [0.3, 0.0, 0.0], "end": [0.3, 0.2, 0.0], "radius": 0.1}},
            "end: contact of a capsule with a box, surface, is not computed; give spheres along the capsule",
        ),
        (
            {"surface": {"amplitude": [0.1, 0.0, 0.0], "frequency_hz": 1.0}},
            "surface.amplitude, surface.frequency_hz: the vehicle moves its surface",
        ),
    ],
)
def test_a_wrong_surface_is_refused_by_name(coupling, said):
    surface = {"shape": "box", "position": [0.0, 0.0, 0.0], "edges": [0.4, 1.0, 0.6]} | coupling.get("surface", {})
    given = {"kind": "contact", "body": {"position": [0.3, 0.0, 0.0], "radius": 0.1}} | coupling
    if "surface is missing" not in said:
        given["surface"] = surface
    with pytest.raises(InputError) as raised:
        bars(given, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    assert said in str(raised.value)


def test_a_key_of_a_surface_is_changed_by_its_name(tmp_path):
    world = thrown("box", 1e-4).updated({"couplings[0].surface.stiffness": 1e3, "couplings[0].body.radius": 0.11})
    (coupling,) = world.couplings
    assert (coupling.surface.stiffness, coupling.body.radius) == (1e3, 0.11)
    (tmp_path / "world.toml").write_text(world.to_toml())
    assert World.load(tmp_path / "world.toml") == world
    logs = {name: [McapLog(tmp_path / f"{name}.mcap")] for name in "ab"}
    simulate(world.updated({"simulation.duration": 0.01}), engine="free_body", sinks=logs)
    assert Trace.load(tmp_path / "b.mcap").scenario.couplings == world.couplings
    for key, said in (
        ("couplings[0].surface.stifness", "no such key; did you mean 'stiffness'?"),
        ("couplings[0].stiffness.k", "stiffness is no table; its key is couplings[0].stiffness"),
    ):
        with pytest.raises(InputError) as raised:
            world.updated({key: 1e3})
        assert said in str(raised.value)
    with pytest.raises(InputError, match=r"couplings\[0\] has no surface"):
        World.load("press_bar", {"couplings[0].surface.stiffness": 1e3})


def test_a_surface_that_is_too_stiff_or_begins_inside_is_refused():
    world = thrown("box", 1e-4, stiffness=1e9)
    with pytest.raises(InputError, match=r"couplings\[0\]\.surface\.stiffness: with damping, it moves"):
        simulate(world, engine="free_body")
    inside = thrown("box", 1e-4).updated({"vehicles[b].initial.position": [0.4, 0.05, 0.0]})
    with pytest.raises(InputError, match=r"couplings\[0\]\.body: is 0\.2\d* m inside the surface at the start"):
        simulate(inside, engine="free_body")


# at the tool of an arm

SPRING_AT_TOOL = """
from dataclasses import dataclass
import numpy as np
from uvms_mj import Effect


@dataclass(frozen=True)
class Spring(Effect):
    @staticmethod
    def wrench(settings, state, given, state_dot, tau):
        d = np.array([0.75, 0.02, -0.09]) - given.p_WB
        f = given.R_WB.T @ (200.0 * d) - 8.0 * given.nu[:3]
        tau[:3], tau[3:] = f, np.cross(given.R_WB.T @ (0.5 * d), f)
"""
ARM = {"model": "planar_arm"}
PLACE = [0.75, 0.02, -0.09]


def held_by_tools(arm, bar, coupling, duration, timestep=1e-4, **tables):
    """A vehicle with an arm whose tool is coupled to the middle of a bar, with all motors off."""
    posture = {"order": [], "free_damping": 0.0}
    return World.from_dict(
        {
            "simulation": {"duration": duration, "timestep": timestep},
            "wall": {"present": False},
            "current": {"speed": 0.0},
            "controller": {"name": "none"},
            "couplings": [{"vehicles": ["a", "b"], "at": ["tool", "body"], **coupling}],
            "vehicles": [
                {
                    "name": "a",
                    "vehicle": arm,
                    "initial": {"joints": [-0.7, 1.3]},
                    "joints": {"name": "torque"},
                    "posture": posture,
                },
                {"name": "b", "vehicle": bar, "initial": {"position": PLACE}},
            ],
            **tables,
        }
    )


def test_a_spring_at_a_tool_is_the_force_of_an_effect_at_the_tool(tmp_path):
    """A spring between a tool and a bar of 1e8 times the inertia, against a user's effect at the tool of a vehicle
    alone, by the path of effects: joints, base and drag in the water."""
    (tmp_path / "spring.py").write_text(SPRING_AT_TOOL)
    joint = {"stiffness": 200.0, "damping": 8.0}
    world = held_by_tools(ARM, {"model": heavy_bar(tmp_path)}, joint, 1.0).updated(
        {"vehicles[a].initial.velocity": [0.0, 0.1, 0.1, 0.0, 0.3, 0.2]}
    )
    tables = world.scenarios["a"].to_dict()
    del tables["couplings"], tables["vehicle"]["name"]
    effect = {"name": f"{tmp_path / 'spring.py'}:Spring", "at": "tool"}
    alone = simulate(Scenario.from_dict(tables | {"effects": [effect]}))
    coupled = simulate(world)["a"]
    assert np.abs(alone.q - alone.q[0]).max() > 0.1
    assert coupled.q == pytest.approx(alone.q, abs=1e-7)
    assert coupled.p_WB == pytest.approx(alone.p_WB, abs=1e-7)
    assert coupled.nu == pytest.approx(alone.nu, abs=1e-6)
    own = tables["effects"] if tables.get("effects") else []
    assert not own
    assert np.abs(coupled.f_couplings_W).max() > 4.0


def bar_at_two_tools(arm, bar, coupling, duration, timestep):
    """Two vehicles side by side with arms, whose tools hold the ends of one bar."""
    tables = held_by_tools(arm, bar, coupling | {"points": [[0.0] * 3, [0.0, -0.4, 0.0]]}, duration, timestep).to_dict()
    a, b = tables["vehicles"]
    c = {**a, "name": "c", "initial": {**a["initial"], "position": [0.0, 0.8, 0.0]}}
    b["initial"] = {**b["initial"], "position": [PLACE[0], 0.4, PLACE[2]]}
    second = {**tables["couplings"][0], "vehicles": ["c", "b"], "points": [[0.0] * 3, [0.0, 0.4, 0.0]]}
    return World.from_dict(tables | {"vehicles": [a, b, c], "couplings": [*tables["couplings"], second]})


@pytest.mark.parametrize("held", ["bar_at_two_tools", "tool_on_surface"])
def test_tools_and_a_bar_keep_their_momentum_without_water(tmp_path, held):
    """Vehicles with arms and a bar, without water and weight, coupled at the tools: momentum and angular momentum by
    MuJoCo's own sums over the bodies, to the order of the step. The dampers of the joints are inside."""
    arm = (Path(__file__).parents[1] / "models" / "planar_arm.xml").read_text()
    for name, text in (("arm", re.sub(r'data="-[0-9.e-]+"', 'data="0"', arm)), ("bar", Path(BAR).read_text())):
        (tmp_path / f"{name}.xml").write_text(text.replace('gravity="0 0 -9.81"', 'gravity="0 0 0"'))
    models = {"model": str(tmp_path / "arm.xml")}, {"model": str(tmp_path / "bar.xml"), **DRY}
    start, lost = {"vehicles[a].initial.velocity": [0.2, 0.1, -0.1, 0.2, 0.1, 0.3]}, []
    for h in (2e-4, 1e-4):
        if held == "bar_at_two_tools":
            world = bar_at_two_tools(*models, {"stiffness": 300.0, "damping": 2.0}, 0.5, h)
        else:
            rod = {"shape": "cylinder", "radius": 0.05, "position": [0.0] * 3, "attitude_deg": [90.0, 0.0, 0.0]}
            body = {"position": [0.0, 0.0, 0.0], "radius": 0.03}
            coupling = {"kind": "contact", "surface": rod | {"stiffness": 2e3, "friction": 0.3}, "body": body}
            world = held_by_tools(*models, coupling, 0.5, h)
            start["vehicles[b].initial.position"] = [0.81, 0.02, -0.09]
        found, forces = [], []
        with WorldSimulation(world.updated(start)) as sim:
            for _ in range(51):
                found.append(sum(momentum_by_mujoco(each) for each in sim.vehicles.values()))
                forces.append([sim.vehicles[name].signals.f_couplings_W[0].copy() for name in ("a", "b")])
                sim.step(round(0.01 / h))
        first, second = np.array(forces).transpose(1, 0, 2)
        assert np.array_equal(first, -second)
        assert np.abs(first).max() > 3.0
        lost.append(np.abs(np.array(found) - found[0]).max(axis=0))
    for part in (slice(0, 3), slice(3, 6)):
        assert lost[1][part].max() < 0.6 * lost[0][part].max() < 0.6 * 4e-3


def momentum_by_mujoco(sim):
    """Linear and angular momentum (6,) about W's origin of all bodies of a Simulation."""
    model, data = sim.model, sim.data
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    root = 1
    p = model.body_subtreemass[root] * data.subtree_linvel[root]
    return np.concatenate([p, data.subtree_angmom[root] + np.cross(data.subtree_com[root], p)])


def test_the_least_mass_at_a_contact_is_that_of_the_quickest_direction(rng):
    """A unit force at the end of a sphere along an axis of B accelerates its point by at most 1/m, in the lightest of
    many directions almost by it: from the momentum that the force gives the body, without a Jacobian."""
    A = rng.normal(size=(6, 6))
    M, centres, radius = A @ A.T + 2.0 * np.eye(6), rng.uniform(-0.5, 0.5, (2, 3)), 0.1
    directions = rng.normal(size=(20_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    quickest = 0.0
    for arm in (centre + sign * radius * axis for centre in centres for axis in np.eye(3) for sign in (1.0, -1.0)):
        nu_dot = np.linalg.solve(M, np.hstack([directions, np.cross(arm, directions)]).T).T
        along = directions * (nu_dot[:, :3] + np.cross(nu_dot[:, 3:], arm))
        quickest = max(quickest, along.sum(axis=1).max())
    assert lightest_at(M, centres, radius) * quickest == pytest.approx(1.0, abs=1e-3)
    assert lightest_at(M, centres, radius) * quickest <= 1.0


def test_the_engine_that_has_no_arms_names_the_one_that_has():
    world = held_by_tools(ARM, {"model": BAR}, {"stiffness": 200.0}, 0.1)
    with pytest.raises(InputError, match=r"'planar_arm' has joints, .*use the engine mujoco"):
        simulate(world, engine="free_body")


@pytest.mark.parametrize(
    ("at", "more", "said"),
    [
        (
            ["tol", "body"],
            {},
            "couplings[0].at: a: 'tol' is neither a link nor a site of the vehicle; did you mean 'tool'?",
        ),
        (["tool", "hook"], {}, "couplings[0].at: b: 'hook' is neither a link nor a site"),
        (
            ["tool", "body"],
            {"wrist": {"name": "sensor"}},
            "the wrist sensor knows no coupling there",
        ),
    ],
)
def test_a_frame_that_is_not_there_is_refused_by_name(at, more, said):
    world = held_by_tools(ARM, {"model": BAR}, {"at": at}, 0.1, **more)
    for made in (simulate, coupled_rest):
        with pytest.raises(InputError) as raised:
            made(world)
        assert said in str(raised.value)


# loads and internal forces


@pytest.mark.parametrize("n", [2, 3, 5])
def test_internal_forces_move_nothing_and_leave_nothing_out(n):
    """They have no resultant and no moment; what is left is the least that has the same ones; and among two points they
    are along their line."""
    rng = np.random.default_rng(n)
    points, forces = rng.normal(size=(2, 7, n, 3))
    internal = internal_forces(points, forces)
    assert internal.sum(axis=1) == pytest.approx(np.zeros((7, 3)), abs=1e-12)
    assert np.cross(points, internal).sum(axis=1) == pytest.approx(np.zeros((7, 3)), abs=1e-12)
    assert internal_forces(points + np.array([1e3, -2e3, 500.0]), forces) == pytest.approx(internal, abs=1e-9)
    assert np.einsum("kni,kni->k", internal, forces - internal) == pytest.approx(np.zeros(7), abs=1e-12)
    if n == 2:
        line = points[:, 1] - points[:, 0]
        line /= np.linalg.norm(line, axis=1, keepdims=True)
        along = 0.5 * np.einsum("ki,ki->k", line, forces[:, 0] - forces[:, 1])
        assert internal[:, 0] == pytest.approx(along[:, None] * line, abs=1e-12)
    else:
        rest = np.concatenate([np.broadcast_to(np.eye(3), (7, n, 3, 3)), skews(points)], axis=2)
        rest = rest.transpose(0, 2, 1, 3).reshape(7, 6, 3 * n)
        least = np.linalg.pinv(rest) @ (rest @ forces.reshape(7, 3 * n, 1))
        assert (forces - internal).reshape(7, 3 * n) == pytest.approx(least[..., 0], abs=1e-9)


def skews(points):
    return np.array([[skew(p) for p in each] for each in points])


def squeezed(F, **more):
    """press_bar without a wall: each vehicle is demanded a force F at its nose towards the other one, as a wrench at B,
    and its target is where the spring of its joint has given way."""
    side = 0.4 - F / 2e3
    demands = {
        "vehicles[left].impedance.F_d": [0.0, F, 0.0, 0.0, 0.0, 0.3 * F],
        "vehicles[right].impedance.F_d": [0.0, -F, 0.0, 0.0, 0.0, -0.3 * F],
        "vehicles[left].reference.target": [0.4, side, 0.0],
        "vehicles[right].reference.target": [0.4, -side, 0.0],
    }
    stepping = {"walls": [], "simulation.duration": 20.0, "simulation.timestep": 5e-4}
    return World.load("press_bar", stepping | demands | more)


@pytest.mark.parametrize("F", [20.0, 5.0])
def test_a_demanded_internal_force_is_the_force_in_the_bar(F):
    world = squeezed(F)
    rest, traces = coupled_rest(world), simulate(world, engine="free_body", keep_s=1.0)
    assert rest.internal("bar") == pytest.approx(np.array([[0.0, -F, 0.0], [0.0, F, 0.0]]), abs=1e-9 * F)
    found = internal_forces(rest.points, traces["bar"].f_couplings_W[-1])
    assert found == pytest.approx(rest.internal("bar"), abs=1e-9 * F)
    assert traces["left"].f_couplings_W[-1, 0, 1] == pytest.approx(F, rel=1e-6)


@pytest.mark.parametrize(
    ("law", "tolerance"),
    [("gsta", 1e-4), ("sta", 1e-4), ("admittance", 1e-9), ("dob_impedance", 1e-9), ("aismc", 1e-9), ("ideal", 1e-9)],
)
def test_the_loads_under_each_law_are_those_of_its_closed_form(law, tolerance):
    """Two vehicles squeeze a bar with 10 N; the yardstick feels a force that it does not demand. Super-twisting laws
    chatter by the boundary of their sampling."""
    world = squeezed(10.0, **{f"vehicles[{name}].controller.name": law for name in ("left", "right")})
    world = world.updated({"simulation.duration": 25.0, "simulation.timestep": 2e-4})
    rest, traces = coupled_rest(world), simulate(world, engine="free_body", keep_s=1.0)
    load = np.abs(rest.forces).max()
    assert load == pytest.approx(10.0, rel=1e-9) or law == "ideal"
    assert traces["bar"].f_couplings_W[-1] == pytest.approx(rest.on("bar"), abs=tolerance * load)


@pytest.mark.parametrize(
    ("case", "tolerance"),
    [("pressed", 1e-8), ("hanging", 1e-9), ("yielding", 1e-9), ("in a current", 1e-9)],
)
def test_the_loads_of_a_run_are_those_of_the_closed_form(case, tolerance):
    """Poses and loads of springs between two vehicles and a bar: at a wall; of a bar that is heavier than its water and
    held beside its middle; with forces at B that turn the vehicles; and in a current that pushes on all of them."""
    changes = {
        "pressed": {},
        "hanging": {
            "vehicles[bar].vehicle.mass": 1.3,
            "couplings[1].points": [[0.3, 0.0, 0.0], [0.0, -0.2, 0.0]],
            "vehicles[right].initial.position": [0.4, -0.2, 0.0],
            "vehicles[right].reference.target": [0.4, -0.19, 0.0],
            "observer.name": "none",
        },
        "yielding": {"vehicles[left].impedance.F_d": [3.0, 20.0, 1.0, 0.0, 0.0, 0.0]},
        "in a current": {"current.speed": 0.2, "current.direction_deg": 60.0, "observer.name": "none"},
    }[case]
    world = World.load("press_bar", {"simulation.duration": 25.0}) if case == "pressed" else squeezed(20.0, **changes)
    rest, traces = coupled_rest(world), simulate(world, engine="free_body", keep_s=1.0)
    load = np.abs(rest.forces).max()
    for name, trace in traces.items():
        assert trace.p_WB[-1] == pytest.approx(rest.positions[name], abs=1e-9)
        assert trace.f_couplings_W[-1] == pytest.approx(rest.on(name), abs=tolerance * load)
    if case == "hanging":
        assert rest.on("bar").sum(axis=0) == pytest.approx([0.0, 0.0, 0.3 * 9.4248 * 9.81], abs=1e-9)


def test_a_cable_pulls_a_vehicle_without_a_law_with_its_drag():
    """A tug holds a barge in a current: the tension is the barge's drag, D_l v + D_q v^2, by hand, by the closed form
    and by the run."""
    v = 0.3
    world = World.from_dict(
        {
            "simulation": {"duration": 60.0, "timestep": 1e-3},
            "wall": {"present": False},
            "current": {"speed": v, "direction_deg": 180.0},
            "couplings": [
                {
                    "vehicles": ["tug", "barge"],
                    "points": [[-0.2, 0.0, 0.0], [0.2, 0.0, 0.0]],
                    "kind": "cable",
                    "length": 0.7,
                    "stiffness": 500.0,
                    "damping": 20.0,
                }
            ],
            "vehicles": [
                {"name": "tug", "reference": {"target": [0.0, 0.0, 0.0]}, "controller": {"name": "gsta"}},
                {
                    "name": "barge",
                    "initial": {"position": [-1.1, 0.0, 0.0]},
                    "controller": {"name": "none"},
                    "vehicle": {"added_mass": 0.0},  # whose Munk moment would turn it aside
                },
            ],
        }
    )
    rest, tension = coupled_rest(world), D_LINEAR[0] * v + D_QUADRATIC[0] * v**2
    assert rest.on("tug") == pytest.approx(np.array([[-tension, 0.0, 0.0]]), rel=1e-9, abs=1e-9)
    traces = simulate(world, engine="free_body", keep_s=1.0)
    assert traces["barge"].f_couplings_W[-1] == pytest.approx(rest.on("barge"), abs=1e-4)
    assert traces["barge"].p_WB[-1] == pytest.approx(rest.positions["barge"], abs=1e-4)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"couplings": []}, "nothing is coupled"),
        ({"vehicles[left].controller.name": "external"}, "left: "),
        ({"vehicles[left].disturbance.amplitude": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
          "vehicles[left].disturbance.frequency_hz": [1.0] * 6}, "left: "),
        ({"vehicles[left].vehicle.model": "planar_arm", "vehicles[left].observer.name": "none"}, "left has joints"),
        ({"walls[0].friction": 0.3}, "bar: with friction, the rest position depends on the path"),
    ],
)  # fmt: skip
def test_what_the_closed_form_of_loads_does_not_know_is_said(changes, reason):
    found = coupled_rest(World.load("press_bar", changes))
    assert isinstance(found, NoClosedForm)
    assert found.reason.startswith(reason)
    assert len(found.reason) > len(reason) or reason[-2:] != ": "


def test_the_forces_of_two_couplings_are_no_twist():
    """The bar's signal has two vectors of three: their numbers are not called roll, pitch and yaw."""
    traces = simulate(World.load("press_bar", {"simulation.duration": 0.02}), engine="free_body")
    bar = traces["bar"].header.by_name["f_couplings_W"]
    assert bar.components == ("1", "2", "3", "4", "5", "6")
    assert traces["left"].header.by_name["f_couplings_W"].components == ("x", "y", "z")
    assert [len(axes.get_lines()) for axes in traces["bar"].plot("f_couplings_W").axes] == [3, 3]
