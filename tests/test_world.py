"""Worlds: several vehicles in one scenario, alone or coupled."""

import dataclasses
import itertools
import json
import math
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from click.testing import CliRunner

from two_bars import BAR, bars
from uvms_mj import Diverged, InputError, McapLog, Scenario, Simulation, Trace, WorldSimulation, simulate, still
from uvms_mj.cli import main
from uvms_mj.engine.world_run import EncounterWarning
from uvms_mj.physics.frames import rotation_matrix
from uvms_mj.plant import encounter
from uvms_mj.plant.geometry import Geometry, Shape
from uvms_mj.plant.mjcf import Mjcf
from uvms_mj.plant.settings import EffectTable
from uvms_mj.records.header import Status
from uvms_mj.scenario import TABLES
from uvms_mj.setup.world import OF_WORLD, World, vehicles_of
from uvms_mj.stages.base import Stage

ENGINES = ("free_body", "mujoco")
PUSH = """from dataclasses import dataclass

from uvms_mj import Controller


@dataclass(frozen=True)
class Push(Controller):
    uses_task = False

    @staticmethod
    def law(gains, state, signals, state_dot, tau_cmd):
        tau_cmd[:] = 0.0
        tau_cmd[0] = 10.0
"""
"""A law that pushes with 10 N."""


def row(n, **more):
    """A world of n vehicles in a row."""
    laws = itertools.cycle([{"name": "gsta"}, {"name": "fosm"}, {"name": "pid"}])
    vehicles = [
        {
            "name": f"v{i}",
            "initial": {"position": [0.98, 0.6 * i, 0.0], "velocity": [0.4, 0.0, 0.0, 0.0, 0.0, 0.0]},
            "reference": {"target": [1.1, 0.6 * i, 0.0]},
            "controller": next(laws),
        }
        for i in range(n)
    ]
    return World.from_dict(
        {"name": "row", "simulation": {"duration": 0.3}, "wall": {"position": 0.985}, "vehicles": vehicles} | more
    )


def test_every_table_says_whether_all_vehicles_share_it():
    """No class of a table inherits the answer but a stage, which is of a vehicle; and two vehicles share the tables
    that say so, and no other one."""
    fields = {f.name for f in dataclasses.fields(Scenario)} - {"name", "description"}
    assert fields == TABLES.keys()
    for name, table in TABLES.items():
        assert "of_world" in vars(table) or (issubclass(table, Stage) and not table.of_world), name
    assert not hasattr(EffectTable, "of_world")
    tables = row(2).to_dict()
    assert {*OF_WORLD} == tables.keys() - {"name", "description", "vehicles"}
    for each in tables["vehicles"]:
        assert each.keys() == fields - {*OF_WORLD} | {"name"}


# vehicles that do not touch


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("n", [2, 3, 8])
def test_each_vehicle_has_the_bits_of_its_run_alone(n, engine):
    world = row(n).updated({"simulation.duration": 0.3 if n < 8 else 0.1})
    together = simulate(world, engine=engine)
    assert [*together] == [f"v{i}" for i in range(n)]
    for name, scenario in world.scenarios.items():
        alone = simulate(scenario, engine=engine)
        assert together[name].rows().tobytes() == alone.rows().tobytes()
        assert together[name].scenario == scenario
    assert all(trace.touches[-1] > 0 for trace in together.values())


def test_the_water_is_the_same_and_the_noise_is_not():
    water = {
        "current": {"speed": 0.3, "deviation": [0.1, 0.1, 0.0]},
        "navigation": {"name": "sensors", "position_noise": [1e-3] * 3},
    }
    traces = simulate(row(2, **water).updated({"controller.name": "gsta"}), engine="free_body")
    one, two = traces.values()
    assert np.array_equal(one.v_c_W, two.v_c_W)
    assert np.ptp(one.v_c_W[:, 0]) > 0.0
    noise = [trace.p_WB_m - trace.p_WB for trace in (one, two)]
    assert np.ptp(noise[0][:, 2]) > 0.0
    assert not np.any(noise[0][1:, 2] == noise[1][1:, 2])


def test_a_name_alone_changes_no_number_but_the_noise():
    plain = Scenario.load("push_wall", {"simulation.duration": 0.3})
    named = plain.updated({"vehicle.name": "left"})
    assert simulate(plain, engine="free_body").rows().tobytes() == simulate(named, engine="free_body").rows().tobytes()


def test_tables_and_toml_give_the_world_again(tmp_path):
    for name in ("press_together", "press_bar"):
        world = World.load(name)
        path = tmp_path / f"{name}.toml"
        path.write_text(world.to_toml())
        assert World.load(path) == World.from_dict(world.to_dict()) == world
        assert vehicles_of(path) == [*world.scenarios]


def test_keys_of_all_of_one_by_number_and_of_one_by_name():
    world = row(2).updated(
        {"current.speed": 0.2, "vehicles[0].controller.k_1": 7.5, "vehicles[v1].initial.position": [0.5, 2.0, 0.0]}
    )
    one, two = world.scenarios.values()
    assert one.current.speed == two.current.speed == 0.2
    assert one.controller.k_1 == 7.5
    assert two.initial.position == (0.5, 2.0, 0.0)
    assert one.initial.position == (0.98, 0.0, 0.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"vehicles": []}, "vehicles: [] is not a list of tables, one a vehicle"),
        ({"vehicles": [{"name": "a"}, {"name": "A"}]}, "vehicles[1].name: 'A' is the name of another vehicle"),
        ({"vehicles": [{"name": "a"}, {}]}, "vehicles[1].name: lacks this key"),
        ({"vehicles": [{"name": "a b"}]}, "vehicles[0].name: 'a b' is no name"),
        ({"vehicles": [{"name": "a", "wall": {}}]}, "vehicles[0].wall: is the world's"),
        ({"vehicles": [{"name": "a", "initial": {"positon": 1}}]}, "vehicles[0].initial.positon: no such key"),
        ({"couplings": [{"vehicles": ["v0", "v7"]}]}, "couplings[0].vehicles: no vehicle 'v7'"),
        ({"couplings": [{"vehicles": ["v0", "v1"], "length": 1.0}]}, "couplings[0]: a joint has no length"),
        ({"couplings": [{"vehicles": ["v0", "v1"], "kind": "cable"}]}, "couplings[0]: a cable needs a length"),
        ({"couplings": [{"vehicles": ["v0", "v0"]}]}, "couplings[0].vehicles: 'v0' can't be coupled to itself"),
    ],
)
def test_a_wrong_world_is_refused_by_name(change, said):
    with pytest.raises(InputError) as raised:
        row(2, **change)
    assert said in str(raised.value)


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("vehicles[9].controller.k_1", "no such vehicle; the world has 2 vehicles"),
        ("vehicles[v8].controller.k_1", "no such vehicle"),
        ("vehicles.controller.k_1", "name one vehicle and its key"),
        ("vehicles[0].current.speed", "is the world's"),
        ("vehicles[0].vehicle.name", "is given by the file"),
        ("vehicle.name", "each vehicle has its own"),
    ],
)
def test_a_wrong_key_is_refused_by_name(key, said):
    with pytest.raises(InputError) as raised:
        row(2).updated({key: 1.0})
    assert said in str(raised.value)


def test_one_vehicle_is_no_world_and_a_world_no_vehicle():
    with pytest.raises(InputError, match=r"several vehicles, which World\.load and uvms-mj run take"):
        Scenario.load("press_together")
    with pytest.raises(InputError, match="mapping from the names of its vehicles, left, right"):
        simulate(World.load("press_together"), sinks=[McapLog("never")])
    with pytest.raises(InputError, match="is a world of several vehicles"):
        Simulation(World.load("press_together"))


def test_a_vehicle_inside_another_is_refused_and_a_meeting_is_told():
    with pytest.raises(InputError, match=r"vehicles\[v1\].initial: is inside 'v0': the boxes around both overlap by"):
        simulate(row(2).updated({"vehicles[1].initial.position": [0.98, 0.1, 0.0]}))
    towards = {"vehicles[1].initial.velocity": [0.0, -1.0, 0.0, 0.0, 0.0, 0.0], "controller.name": "none"}
    with pytest.warns(
        EncounterWarning, match=r"v0 and v1 meet at t = 0\.4\d+ s: contact between vehicles is not computed"
    ) as told:
        simulate(row(2).updated({"simulation.duration": 0.5, "wall.position": 9.0} | towards), engine="free_body")
    assert {each.filename for each in told} == {__file__}


@pytest.mark.parametrize("turn", [0.0, 30.0, 90.0])
def test_boxes_are_apart_as_far_as_their_nearest_faces(turn):
    """A box turns beside another one, 0.4 m away: its half width is then that of a rectangle."""
    a, b, half = 0.23, 0.17, math.radians(turn) / 2
    box = Shape("box", (a, b, 0.14), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0), None)
    geometry, no_joints = Geometry((box,), {}), np.zeros((1, 0))
    still = encounter.boxes(geometry, np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]), no_joints)
    quat = np.array([[math.cos(half), 0.0, 0.0, math.sin(half)]])
    turned = encounter.boxes(geometry, np.array([[0.0, 0.4, 0.0]]), quat, no_joints)
    wide = a * math.sin(2 * half) + b * math.cos(2 * half)
    assert encounter.gap(still, turned)[0] == pytest.approx(0.4 - b - wide, abs=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_boxes_overlap_where_some_place_is_in_both(seed):
    """Against a search for a place in both boxes by quadratic programming, at random poses."""
    from scipy.optimize import lsq_linear

    rng = np.random.default_rng(seed)
    halves = rng.uniform(0.1, 0.5, (2, 3))
    poses = rng.uniform(-0.6, 0.6, (2, 3)), rng.normal(size=(2, 4))
    found = []
    for half, p, quat in zip(halves, *poses, strict=True):
        shape = Shape("box", tuple(half), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0), None)
        quat = quat / np.linalg.norm(quat)
        found.append(encounter.boxes(Geometry((shape,), {}), p[None], quat[None], np.zeros((1, 0))))
    one, two = found
    A, B = one.axes[0, 0], two.axes[0, 0]
    bound = np.concatenate(halves)  # one.p + A u = two.p + B v within both boxes
    nearest = lsq_linear(np.hstack([A, -B]), (two.centres - one.centres)[0, 0], (-bound, bound), tol=1e-14)
    distance = math.sqrt(2.0 * nearest.cost)
    gap = float(encounter.gap(one, two)[0])
    assert gap <= distance + 1e-6
    assert encounter.overlap(one, two)[0] == (gap < 0.0)
    far = two._replace(centres=two.centres + np.array([4.0, 0.0, 0.0]))
    assert not encounter.overlap(one, far)[0]
    assert encounter.gap(one, far)[0] > 0.0
    assert (gap > 0.0) == (distance > 1e-6) or abs(gap) < 1e-3


# how a run ends


def test_an_interrupt_ends_all_vehicles():
    def stop(done, total):
        if done >= 1000:
            raise KeyboardInterrupt

    traces = simulate(row(3).updated({"simulation.duration": 5.0}), engine="mujoco", progress=stop)
    assert {trace.status for trace in traces.values()} == {Status.interrupted}
    assert all(0 < trace.steps < 50_000 for trace in traces.values())


def test_a_vehicle_that_diverges_stops_those_that_it_is_coupled_to_and_no_other():
    world = row(3, couplings=[{"vehicles": ["v0", "v1"], "kind": "spring", "stiffness": 10.0, "length": 0.6}])
    wild = world.updated({"vehicles[0].disturbance.bias": [1e5, 0.0, 0.0, 0.0, 0.0, 0.0]})
    traces = simulate(wild, engine="free_body")
    assert traces["v0"].status is Status.unstable
    assert traces["v1"].status is Status.failed
    assert "v0 has stopped, to which it is coupled" in traces["v1"].message
    assert traces["v2"].status is Status.completed


@pytest.mark.parametrize("engine", ENGINES)
def test_each_vehicle_has_a_log_with_its_topics_below_its_name(tmp_path, engine):
    from mcap.reader import make_reader

    world = World.load("press_bar", {"simulation.duration": 0.1})
    logs = {name: tmp_path / f"{name}.mcap" for name in world.scenarios}
    traces = simulate(world, sinks={name: [McapLog(path)] for name, path in logs.items()}, engine=engine)
    for name, path in logs.items():
        loaded = Trace.load(path)
        assert loaded.rows().tobytes() == traces[name].rows().tobytes()
        with path.open("rb") as file:
            channels = make_reader(file).get_summary().channels.values()
        assert {channel.topic.split("/")[1] for channel in channels} == {name}
        assert f"/{name}/odom" in {channel.topic for channel in channels}


# couplings


@pytest.mark.parametrize("engine", ENGINES)
def test_a_spring_is_the_closed_form_and_its_error_falls_with_the_time_step(engine):
    """Two equal bodies on a damped spring: x'' = -(k x + b x') / mu, with the reduced mass mu = m / 2."""
    k, b, length, stretch, duration = 400.0, 6.0, 1.0, 0.1, 1.0
    mu = 0.5 * float(Mjcf.find(BAR).vehicle.M_RB[0, 0])
    decay = b / (2.0 * mu)
    omega = math.sqrt(k / mu - decay**2)
    errors = []
    for h in (2e-3, 1e-3, 5e-4):
        spring = {"kind": "spring", "stiffness": k, "damping": b, "length": length}
        start = (0.0, 0.0, 0.0), (length + stretch, 0.0, 0.0)
        world = bars(spring, *start, duration=duration, timestep=h)
        one, two = simulate(world, engine=engine, log_rate="full").values()
        t, found = one.t, two.p_WB[:, 0] - one.p_WB[:, 0] - length
        wave = np.cos(omega * t) + decay / omega * np.sin(omega * t)
        errors.append(np.abs(found - stretch * np.exp(-decay * t) * wave).max())
        force = k * found + b * (two.nu[:, 0] - one.nu[:, 0])
        assert one.f_couplings_W[:-1, 0, 0] == pytest.approx(force[:-1], rel=1e-9, abs=1e-9)
    assert errors[0] < 0.2 * stretch
    assert [a / b for a, b in itertools.pairwise(errors)] == pytest.approx([2.0, 2.0], rel=0.05)


@pytest.mark.parametrize(
    "coupling",
    [
        {"kind": "spring", "stiffness": 300.0, "damping": 5.0, "length": 0.5},
        {"stiffness": 300.0, "damping": 5.0, "length": 0.59, "kind": "cable"},
        {"stiffness": 3000.0, "damping": 20.0},
    ],
    ids=["spring", "cable", "joint"],
)
@pytest.mark.parametrize("engine", ENGINES)
def test_momentum_is_kept_without_water(coupling, engine):
    """Linear momentum to rounding at every step; angular momentum about W's origin as exactly as the step turns a body,
    which is to its order."""
    turning = {"vehicles[0].initial.velocity": [0.1, -0.2, 0.3, 0.2, 0.1, 0.5]}
    points = [[0.1, 0.5, 0.0], [0.0, -0.5, 0.1]]
    gap = 0.0 if "length" not in coupling else 0.6
    start = (0.0, 0.0, 0.0), (0.1, 1.0 + gap, -0.1)
    M, losses = Mjcf.find(BAR).vehicle.M_RB, []
    for h in (4e-4, 2e-4):
        world = bars(coupling | {"points": points}, *start, timestep=h).updated(turning)
        traces = simulate(world, engine=engine).values()
        spun, moved = 0.0, 0.0
        for trace in traces:
            R = rotation_matrix(trace.quat_WB)
            p = M[0, 0] * np.einsum("nij,nj->ni", R, trace.nu[:, :3])
            spin = np.einsum("nij,jk,nk->ni", R, M[3:, 3:], trace.nu[:, 3:])
            moved, spun = moved + p, spun + np.cross(trace.p_WB, p) + spin
        assert np.abs(moved - moved[0]).max() < 1e-12 * np.abs(moved[0]).max() * len(moved)
        losses.append(np.abs(spun - spun[0]).max())
        one, two = traces
        assert np.array_equal(one.f_couplings_W, -two.f_couplings_W)
        assert np.abs(one.f_couplings_W).max() > 1.0
    assert losses[1] < 0.6 * losses[0] < 0.01 * np.abs(spun[0]).max()


def test_a_cable_never_pushes():
    world = bars({"stiffness": 300.0, "length": 1.0, "kind": "cable"}, (0.0, 0.0, 0.0), (0.9, 0.0, 0.0), duration=3.0)
    towards = world.updated({"vehicles[1].initial.velocity": [0.2, 0.0, 0.0, 0.0, 0.0, 0.0]})
    one, two = simulate(towards, engine="free_body").values()
    distance = np.linalg.norm(two.p_WB - one.p_WB, axis=1)
    pull = one.f_couplings_W[:, 0, 0]
    assert pull.min() == 0.0 < pull.max()
    assert np.all((pull > 0.0) <= (distance > 1.0 - 1e-3))


@pytest.mark.parametrize("engine", ENGINES)
def test_two_spheres_bounce_with_their_energy_and_momentum(engine):
    """Two equal spheres without a damper: a head-on impact exchanges their velocities (Newton's cradle), and a glancing
    one keeps energy and momentum, with an error of the order of the step."""
    k, speed, losses = 5e3, 0.4, []
    for h in (2e-4, 1e-4):
        contact = {"kind": "contact", "stiffness": k, "length": 0.2}
        world = bars(contact, (0.0, 0.0, 0.0), (0.25, 0.0, 0.08), timestep=h, duration=1.0)
        going = world.updated({"vehicles[0].initial.velocity": [speed, 0.0, 0.0, 0.0, 0.0, 0.0]})
        one, two = simulate(going, engine=engine).values()
        m = float(Mjcf.find(BAR).vehicle.M_RB[0, 0])
        energies = [0.5 * m * np.sum(trace.nu[:, :3] ** 2, axis=1) for trace in (one, two)]
        assert one.nu[-1, :3] + two.nu[-1, :3] == pytest.approx([speed, 0.0, 0.0], abs=1e-12)
        assert np.abs(one.f_couplings_W).max() > 10.0
        assert one.f_couplings_W[:, 0, 0].max() <= 0.0  # pushed back, never pulled
        assert one.f_couplings_W[-1].tolist() == [[0.0] * 3]
        losses.append(abs((energies[0] + energies[1])[-1] / energies[0][0] - 1.0))
    assert losses[0] < 1e-3
    head_on = bars(contact, (0.0, 0.0, 0.0), (0.25, 0.0, 0.0), duration=1.0, timestep=1e-4)
    going = head_on.updated({"vehicles[0].initial.velocity": [speed, 0.0, 0.0, 0.0, 0.0, 0.0]})
    one, two = simulate(going, engine=engine).values()
    assert [one.nu[-1, 0], two.nu[-1, 0]] == pytest.approx([0.0, speed], abs=1e-3 * speed)
    touching = np.ptp(one.t[one.f_couplings_W[:, 0, 0] < 0.0])
    assert touching == pytest.approx(math.pi * math.sqrt(0.5 * m / k), abs=3e-3)  # half a period on the spring


def test_both_engines_agree_on_coupled_vehicles():
    found = {}
    for engine in ENGINES:
        found[engine] = simulate(World.load("press_bar", {"simulation.duration": 3.0}), engine=engine)
    for name, trace in found["mujoco"].items():
        assert trace.p_WB == pytest.approx(found["free_body"][name].p_WB, abs=1e-9)
    assert found["mujoco"]["bar"].touches[-1] == 1


def test_the_bar_hangs_by_statics():
    """A bar heavier than its water, held at two points beside its middle: the loads are those of a lever, and the force
    along the bar is that of the springs, k (x_1 - x_2), which hold it against each other."""
    world = World.load(
        "press_bar",
        {
            "simulation.duration": 20.0,
            "simulation.timestep": 2e-4,
            "walls": [],
            "impedance.F_d": [0.0] * 6,
            "observer.name": "none",
            "vehicles[bar].vehicle.mass": 1.3,
            "couplings[1].points": [[0.3, 0.0, 0.0], [0.0, -0.2, 0.0]],
            "vehicles[right].initial.position": [0.4, -0.2, 0.0],
            "vehicles[right].reference.target": [0.4, -0.19, 0.0],
            "vehicles[left].reference.target": [0.4, 0.39, 0.0],
        },
    )
    traces = simulate(world, engine="free_body", keep_s=1.0)
    bar = traces["bar"]
    weight = 0.3 * 9.4248 * 9.81
    p, R = bar.p_WB[-1], rotation_matrix(bar.quat_WB[-1:])[0]
    forces, points = bar.f_couplings_W[-1], []
    for (own, name), f in zip([([0, 0.4, 0], "left"), ([0, -0.2, 0], "right")], forces, strict=True):
        held = traces[name]
        at = held.p_WB[-1] + rotation_matrix(held.quat_WB[-1:])[0] @ [0.3, 0.0, 0.0]
        x = p + R @ own
        assert f == pytest.approx(2e3 * (at - x), abs=1e-7)  # and no damper at rest
        points.append(0.5 * (x + at))
    assert forces.sum(axis=0) == pytest.approx([0.0, 0.0, weight], abs=1e-9 * weight)
    arms = np.array(points) - p
    assert sum(np.cross(arms, forces)) == pytest.approx(np.zeros(3), abs=1e-9 * weight)
    assert forces[0, 1] < -1.0  # the two vehicles push the bar together


@pytest.mark.parametrize("engine", ENGINES)
def test_each_vehicle_presses_with_the_demanded_force(engine):
    world = World.load("press_bar", {"simulation.timestep": 5e-4} if engine == "mujoco" else {})
    traces = simulate(world, engine=engine, keep_s=1.0)
    assert traces["bar"].push[-1] == pytest.approx(40.0, rel=1e-6)
    for name in ("left", "right"):
        assert traces[name].f_couplings_W[-1, 0] == pytest.approx([-20.0, 0.0, 0.0], abs=1e-4)


def test_with_a_stiff_bar_two_vehicles_are_one_body(tmp_path):
    """Two equal vehicles with the same thrust and a bar between them: after the joints have settled, they accelerate as
    one body of the summed mass and added mass, and its place differs by what the joints yield."""
    law = tmp_path / "push.py"
    law.write_text(PUSH)
    still = {"linear_damping": 0.0, "quadratic_damping": 0.0}
    base = World.load("press_bar", {"walls": [], "simulation.duration": 1.0, "simulation.timestep": 2e-5})
    tables = base.to_dict()
    for each in tables["vehicles"]:
        each["vehicle"] |= still
        if each["name"] != "bar":
            each["controller"], each["observer"] = {"name": f"{law}:Push"}, {"name": "none"}
    rov, bar = (Mjcf.find(name).vehicle for name in ("bluerov1", BAR))
    mass = sum(float((each.M_RB + each.M_A)[0, 0]) for each in (rov, rov, bar))
    errors = []
    for stiffness in (1e4, 1e5, 1e6):
        for each in tables["couplings"]:
            each |= {"stiffness": stiffness, "damping": math.sqrt(5.0 * stiffness)}
        traces = simulate(World.from_dict(tables), engine="free_body")
        rate = {name: trace.nu_dot[-1, 0] for name, trace in traces.items()}
        assert [*rate.values()] == pytest.approx([20.0 / mass] * 3, rel=1e-6)
        moved = traces["left"].p_WB[-1, 0] - traces["left"].p_WB[0, 0]
        errors.append(abs(moved - 0.5 * 20.0 / mass) / moved)
    assert errors[2] < 1e-4 < 1e-3 > errors[0] > 5.0 * errors[1]


@pytest.mark.parametrize(
    ("coupling", "said"),
    [
        (
            {"kind": "spring", "stiffness": 1e9, "length": 1.0},
            "couplings[0].stiffness: with damping, it moves 4.71 kg faster than",
        ),
        ({}, "couplings[0].points: are 1 m apart at the start; a joint begins with at most 0.05 m"),
        ({"length": 0.5, "kind": "cable"}, "couplings[0].length: 0.5 m is shorter than the distance of 1 m"),
    ],
)
def test_a_wrong_coupling_is_refused_by_name(coupling, said):
    with pytest.raises(InputError) as raised:
        simulate(bars(coupling, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), engine="free_body")
    assert said in str(raised.value)


def test_a_bar_that_is_shorter_than_the_gap_is_refused():
    with pytest.raises(InputError, match=r"couplings\[1\].points: are 0.3 m apart at the start"):
        simulate(World.load("press_bar", {"couplings[1].points": [[0.3, 0.0, 0.0], [0.0, -0.1, 0.0]]}))


def test_a_coupled_vehicle_is_not_run_alone_and_has_no_closed_form():
    world = World.load("press_bar", {"simulation.duration": 0.01})
    for make in (simulate, Simulation):
        with pytest.raises(InputError, match="a coupling needs the other vehicle; run the world"):
            make(world.scenarios["left"])
    assert simulate(world, engine="free_body")["left"].analytic.reason == (
        "closed forms do not know where couplings[0] moves"
    )
    arm = World.load("press_bar", {"vehicles[0].vehicle.model": "planar_arm", "vehicles[0].observer.name": "none"})
    with pytest.raises(InputError, match="'planar_arm' has joints, which the engine free_body does not compute"):
        simulate(arm, engine="free_body")


# stepped by its caller


@pytest.mark.parametrize("engine", ENGINES)
def test_a_world_that_is_stepped_and_reset_has_the_bits_of_its_run(engine):
    world = World.load("press_bar", {"vehicles[bar].initial.velocity": [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]})
    world = world.updated({"simulation.duration": 0.1})
    traces = simulate(world, engine=engine, log_rate="full")
    faster = {"vehicles[bar].initial.velocity": [0.2, 0.0, 0.0, 0.0, 0.0, 0.0]}
    other = simulate(world.updated(faster), engine=engine, log_rate="full")
    with WorldSimulation(world, engine=engine) as sim:
        for expected, then in ((traces, faster), (other, None), (traces, {"wall.present": True})):
            for n in (1, 99, 900):
                sim.step(n)
                for name, trace in expected.items():
                    signals = sim.vehicles[name].signals
                    assert np.array_equal(signals.p_WB, trace.p_WB[sim.steps])
                    assert np.array_equal(signals.nu, trace.nu[sim.steps])
            if then is not None and "wall.present" in then:
                with pytest.raises(InputError, match="wall"):
                    sim.reset(then)
            else:
                sim.reset(then)
        sim.step(1000)  # a reset that was refused has returned to the start
        assert np.array_equal(sim.vehicles["bar"].signals.p_WB, traces["bar"].p_WB[1000])
        with pytest.raises(InputError, match="couplings: reset can't change it; make a new WorldSimulation"):
            sim.reset({"couplings": []})


def test_a_world_that_is_stepped_names_the_vehicle_that_diverges():
    world = row(2).updated({"vehicles[1].disturbance.bias": [1e5, 0.0, 0.0, 0.0, 0.0, 0.0]})
    with WorldSimulation(world, engine="free_body") as sim, pytest.raises(Diverged, match=r"v1: t = .*velocity"):
        sim.step(3000)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("coupled", [True, False])
def test_a_restored_world_goes_on_with_the_same_bits(engine, coupled):
    """With gusts, noise and contact, and twice from one state."""
    if coupled:
        world = World.load("press_bar", {"current.deviation": [0.1, 0.1, 0.0], "current.correlation_time": 0.5})
        world = world.updated({"vehicles[bar].initial.velocity": [0.3, 0.0, 0.0, 0.0, 0.0, 0.0]})
    else:
        noise = {"name": "sensors", "position_noise": [1e-3] * 3}
        world = row(2, navigation=noise, current={"deviation": [0.1, 0.1, 0.0], "correlation_time": 0.01})

    def signals(sim):
        return [np.copy(each.signals[name]).tobytes() for each in sim.vehicles.values() for name in each.signals]

    begun = 150 if coupled else 2500  # the nodes of the gusts are drawn anew every 0.32 s
    with WorldSimulation(world, engine=engine) as sim:
        sim.step(begun)
        saved, at = sim.save(), signals(sim)
        sim.step(1300)
        expected = signals(sim)
        for _ in range(2):
            sim.restore(saved)
            assert sim.steps == begun
            assert signals(sim) == at
            sim.step(1300)
            assert signals(sim) == expected
        sim.reset(seed=3)
        with pytest.raises(InputError, match="since the state was saved, a reset or set has changed numbers"):
            sim.restore(saved)
        with WorldSimulation(world, engine=engine) as other, pytest.raises(InputError, match="another Simulation"):
            other.restore(saved)


def test_what_may_keep_numbers_that_are_not_saved_is_refused(tmp_path):
    law = tmp_path / "push.py"
    law.write_text(PUSH.replace("tau_cmd[0] = 10.0", "tau_cmd[0] = float(str(10.0))"))
    scenario = Scenario.load("push_wall", {"controller.name": f"{law}:Push"})
    with (
        Simulation(scenario, engine="free_body") as sim,
        pytest.raises(InputError, match=r"save: .* no compiled Python"),
    ):
        sim.save()
    law.write_text(PUSH)
    with Simulation(Scenario.load("push_wall", {"controller.name": f"{law}:Push"}), engine="free_body") as sim:
        sim.step(100)
        saved = sim.save()
        sim.step(500)
        expected = sim.signals.p_WB.copy()
        sim.restore(saved)
        sim.step(500)
        assert np.array_equal(sim.signals.p_WB, expected)
        sim.record(1)
        with pytest.raises(InputError, match="the run is recorded"):
            sim.save()


@pytest.mark.parametrize("engine", ENGINES)
def test_a_caller_commands_one_vehicle_of_a_world(engine):
    """The same commands give a vehicle alone the same bits, and the other one keeps its law."""
    world = row(2).updated({"vehicles[v1].controller.name": "external"})
    force = np.array([5.0, 1.0, 0.0, 0.0, 0.0, 0.1])
    with (
        WorldSimulation(world, engine=engine) as both,
        Simulation(world.scenarios["v0"], engine=engine) as law,
        Simulation(world.scenarios["v1"], engine=engine) as alone,
    ):
        for k in range(10):
            both.vehicles["v1"].tau_cmd[:] = alone.tau_cmd[:] = (-1) ** k * force
            for each in (both, law, alone):
                each.step(100)
        for name, single in (("v0", law), ("v1", alone)):
            assert np.array_equal(both.vehicles[name].signals.p_WB, single.signals.p_WB)
            assert np.array_equal(both.vehicles[name].signals.nu, single.signals.nu)
        with pytest.raises(ValueError, match=r"read-only"):
            both.vehicles["v0"].tau_cmd[:] = 0.0


@pytest.mark.parametrize("run", [simulate, WorldSimulation])
def test_errors_of_vehicles_name_them_and_come_together(run):
    wrong = {"vehicles[v0].initial.joints": [1.0], "vehicles[v1].initial.joints": [1.0]}
    with pytest.raises(InputError) as raised:
        run(row(2).updated(wrong), engine="free_body")
    assert [fault.key for fault in raised.value.faults] == ["vehicles[0].initial.joints", "vehicles[1].initial.joints"]


def test_a_law_of_the_caller_is_refused_with_its_vehicle():
    with pytest.raises(InputError, match=r"vehicles\[1\]\.controller\.name: external leaves tau_cmd"):
        simulate(row(2).updated({"vehicles[v1].controller.name": "external"}))


@pytest.mark.parametrize("n", [-1, 1.5])
def test_a_world_takes_whole_steps_as_one_vehicle_does(n):
    with (
        WorldSimulation(row(2), engine="free_body") as sim,
        pytest.raises(InputError, match="is not a number of steps"),
    ):
        sim.step(n)
    assert sim.steps == 0


def test_a_state_of_other_vehicles_is_refused():
    with WorldSimulation(row(2), engine="free_body") as two, WorldSimulation(row(3), engine="free_body") as three:
        with pytest.raises(InputError, match="another WorldSimulation"):
            two.restore(three.save())
        with pytest.raises(InputError, match="another WorldSimulation"):
            three.restore(two.save())


# the command


def command(*words):
    result = CliRunner().invoke(main, [*words])
    assert result.exit_code == 0, result.output
    return result


@pytest.mark.usefixtures("undrawn")
def test_the_command_writes_a_log_of_each_vehicle_and_shows_them_together(tmp_path):
    out = tmp_path / "out"
    short = ("simulation.duration=0.05", "--engine", "free_body", "--json", "-o", str(out))
    said = json.loads(command("run", "press_bar", *short).stdout)
    assert said["scenario"] == "press_bar"
    assert [*said["vehicles"]] == ["left", "right", "bar"]
    assert {report["status"] for report in said["vehicles"].values()} == {"completed"}
    written = {"left.mcap", "right.mcap", "bar.mcap", "scenario.toml"}
    assert {path.name for path in out.iterdir()} == written
    assert World.load(out / "scenario.toml") == World.load("press_bar", {"simulation.duration": 0.05})
    command("run", str(out / "scenario.toml"), *short)
    assert {path.name for path in (out / "earlier-1").iterdir()} == written
    said = command("info", str(out)).stdout
    assert all(f"/{name}/odom" in said for name in ("left", "right", "bar"))
    refused = CliRunner().invoke(main, ["info", str(tmp_path)])
    assert (refused.exit_code, "is a folder; name a log in it" in refused.output) == (2, True)
    command("plot", str(out), "--what", "position")
    assert (out / "position.png").exists()
    command("replay", str(out), "--save", str(tmp_path / "world.rrd"))
    command("compare", str(out), "-o", str(tmp_path / "world.html"))
    page = (tmp_path / "world.html").read_text()
    assert all(name in page for name in ("left", "right", "bar"))
    refused = CliRunner().invoke(main, ["run", "press_bar", "--viewer"])
    assert refused.exit_code == 2
    assert "uvms-mj replay DIR shows a world" in refused.output


@pytest.mark.parametrize("name", ["converge", "certify"])
def test_commands_of_one_vehicle_refuse_a_world(name):
    result = CliRunner().invoke(main, [name, "press_together"])
    assert result.exit_code == 2
    assert "World.load" in result.output


def test_the_logs_of_a_world_outlive_kill_9(tmp_path):
    out = tmp_path / "out"
    words = ["run", "press_bar", "simulation.duration=1000", "--engine", "free_body", "-o", str(out), "-q"]
    process = subprocess.Popen([sys.executable, "-m", "uvms_mj", *words], stderr=subprocess.DEVNULL)
    logs = [out / f"{name}.mcap" for name in ("left", "right", "bar")]
    until = time.monotonic() + 60.0
    while time.monotonic() < until and not all(log.exists() and log.stat().st_size > 3_000_000 for log in logs):
        time.sleep(0.1)
    process.send_signal(signal.SIGKILL)
    process.wait()
    for log in logs:
        trace = Trace.load(log)
        assert trace.status is Status.truncated
        assert len(trace) > 500


def test_all_vehicles_are_in_one_picture():
    pytest.importorskip("imageio_ffmpeg")
    traces = simulate(World.load("press_together", {"simulation.duration": 0.05}), engine="free_body")
    try:
        both = np.asarray(still(traces, size=(320, 180)), float)
    except InputError as error:
        pytest.skip(str(error))
    one = np.asarray(still(traces["left"], size=(320, 180), plots=()), float)
    assert both.shape == one.shape
    assert np.abs(both - one).mean() > 1.0
    with pytest.raises(InputError, match="plots stand beside the scene of one vehicle"):
        still(traces, plots=["force"])
    other = simulate(traces["left"].scenario.updated({"vehicle.name": "other", "wall.position": 1.2}))
    with pytest.raises(InputError, match="of the vehicles of one world"):
        still({"left": traces["left"], "other": other})
