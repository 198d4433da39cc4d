"""Links, joints, contacts and water of a vehicle in the record of a run.

The water, the model of a law, a wrist sensor and the walls have their own part of it.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ...control.model import estimate_links
from ...physics.effects import EFFECTS, moving, state_of
from ...physics.frames import BODY
from ...plant.arm import Link
from ...plant.contacts import Carrier
from ...plant.effects import set_places
from ...plant.vehicle import Vehicle
from ...setup.base import Setup
from ...stages.signals import (
    AT_SURFACE,
    MANIPULABILITY,
    TOOL,
    UNSTEADY,
    WAVES,
    Signal,
    contact_signals,
    coupling_signal,
    deflection_signal,
    joint_saturation_signal,
    joint_signals,
    joint_torque_signal,
    tether_signals,
    thruster_saturation_signal,
    thruster_signal,
    wall_signals,
)
from .record import Image


def fill_joints(run: np.ndarray, setup: Setup) -> None:
    """Set the motors and the limits of the joints in the record of a run (1,)."""
    links, given = setup.vehicle.arm.links, run["joints"]
    for name in ("effort", "speed_limit"):
        given[name] = [getattr(link, name) for link in links]
    for i, name in enumerate(("q_min", "q_max")):
        given[name] = [link.range[i] for link in links]
    run["motor_index"] = [link.actuator_id for link in links]
    run["torque_of_ctrl"] = [link.torque_of_ctrl for link in links]
    run["encoded"], run["frames_m"] = setup.scenario.encoder.runs, setup.nominal.arm.frames


def fill_model(model: np.ndarray, setup: Setup) -> None:
    """Set the tool and the gravity of a law's model (1,); its links follow from the estimates."""
    arm, frame, tool = setup.nominal.arm, setup.scenario.task.frame, model["tool"]
    if frame != BODY:
        site = arm.sites[frame]
        tool["link"], tool["p_LT"], tool["R_LT"] = site.link + 1, site.p, site.R
    model["gravity_W"] = setup.gravity_W


def fill_wrist(record: np.ndarray, setup: Setup) -> None:
    """Set the true links of a wrist sensor (1,)."""
    record["rigid"]["coriolis"] = 1.0
    bodies: tuple[Vehicle | Link, ...] = (setup.vehicle, *setup.vehicle.arm.links)
    for link, body in zip(record["rigid"][0], bodies, strict=True):
        link["M"], link["mass"], link["r_g"] = body.M_RB, body.mass, body.r_g
    record["wet"], record["gravity_W"] = setup.vehicle.links_in_water, setup.gravity_W


def write_wrist(record: np.ndarray, setup: Setup) -> None:
    """Set the numbers of the scenario."""
    wrist, sensor = setup.scenario.wrist, record["sensor"]
    link, site = wrist.carried(setup)
    sensor["link"], sensor["p_LT"], sensor["R_LT"] = link + 1, 0.0, np.eye(3)
    if site is not None:
        sensor["p_LT"], sensor["R_LT"] = site.p, site.R
    estimate_links(record["model"][0], setup.nominal, setup.scenario.estimates)
    record["model"]["coriolis"] = 1.0  # of the inertia's factor
    record["weighs"], record["dynamic"] = wrist.compensation != "none", wrist.compensation == "dynamic"


_OF_CONTACT = ("stiffness", "damping", "friction", "breakaway", "tangential_stiffness", "tangential_damping")
_OF_PAIR = (
    *("surface", "capsule", "carrier", "solved", "ends_C", "radius", "layer_depth", "layer_stiffness"),
    *("bumper_stiffness", "bumper_damping", "power", "dissipation"),
)
"""Settings; the other fields are states and forces, which go on if a setting changes during a run."""


def place_carriers(records: np.ndarray, carriers: Sequence[Carrier]) -> None:
    """Set the places of frames on their links in CARRIER records (n,)."""
    for record, carrier in zip(records, carriers, strict=True):
        record["link"], record["p_LC"], record["R_LC"] = carrier.link + 1, carrier.p, carrier.R
        record["p_BC"], record["R_BC"] = carrier.p, carrier.R  # frames on the base never change


def motion_room(k: int) -> str:
    """The room for the table of motion of a wall."""
    return f"motion of wall {k}"


def swell_room(k: int) -> str:
    """The room for the swell of a wall."""
    return f"swell of wall {k}"


def tilt_room(k: int) -> str:
    """The room for the turn of a wall with the sea."""
    return f"tilt of wall {k}"


def write_contacts(image: Image, run: np.ndarray, setup: Setup) -> None:
    """Set the numbers of a scenario with as many walls and pairs."""
    contacts = setup.contacts
    surfaces, pairs = contacts.records(setup.lightest)
    for k, (record, (_, wall)) in enumerate(zip(surfaces, contacts.walls, strict=True)):
        if wall.motion:
            record["table"], record["rows"] = image.put(motion_room(k), np.array(wall.motion, float))
        if wall.follows_sea:
            moved, turned = setup.swells[k]
            record["swell"], record["swell_rows"] = image.put(swell_room(k), moved)
            if wall.turns:
                record["tilt"], record["tilt_rows"] = image.put(tilt_room(k), turned)
    run["surfaces"][0][: len(surfaces)] = surfaces
    own = run["pairs"][0][: len(pairs)]
    for name in _OF_PAIR:
        own[name] = pairs[name]
    for name in _OF_CONTACT:
        own["contact"][name] = pairs["contact"][name]
    run["surface_count"], run["pair_count"] = len(surfaces), len(pairs)


def recorded_of_plant(run: np.ndarray, setup: Setup) -> Iterator[tuple[Signal, np.ndarray]]:
    """The recorded signals of the plant, each with its memory: the motion of the water unless it is constant, the
    contacts beside the contact of the probe and ``[wall]``, the walls that move, the thrusts, the deflections of fins,
    a tether that moves, the joints and the tool."""
    contacts, u, true = setup.contacts, run["u"], run["true"]
    if not setup.scenario.constant_flow:
        of_water = (*UNSTEADY, *WAVES) if run["plant"]["effects"]["sea"].size else UNSTEADY
        yield from ((signal, run["plant"]["water"][signal.name]) for signal in of_water)
    if n := len(contacts.springs):
        first = int(contacts.paper)
        forces, depths = (run[name][0][first : first + n] for name in ("f_pairs", "depths"))
        yield from zip(contact_signals(n), (run["push"], forces, depths, true["tau_springs_B"]), strict=True)
    listed = run["surfaces"][0][len(contacts.walls) - len(setup.scenario.walls) :]
    for k, wall in enumerate(setup.scenario.walls):
        if wall.moves:
            yield from zip(wall_signals(k), (listed[k : k + 1]["p_WS"], listed[k : k + 1]["quat_WS"]), strict=True)
    if u.size:
        yield thruster_signal(u.size), u
        yield thruster_saturation_signal(u.size), run["limited"]
    effects = run["plant"]["effects"]
    if any(key.startswith("fins") for key in setup.advancing):
        deltas = effects[state_of("fins")][0]
        yield deflection_signal(deltas.size), deltas
    if effects["buoyancy"].size:
        wet = run["plant"]["wet"][0]
        yield from zip(AT_SURFACE, (wet["fraction"], wet["dry_time"]), strict=True)
    if effects["cable"].size:
        cable = effects[state_of("cable")][0, :1]
        yield from zip(tether_signals(cable["p"].size // 3), (cable["p"], cable["tension"]), strict=True)
    if pulled := effects["couplings"].size:
        yield coupling_signal(pulled), effects[state_of("pulls")][0]["f_W"]
    if n := len(setup.vehicle.arm.links):
        yield from zip(joint_signals(n), (run["encoder"]["q"], run["encoder"]["q_dot"]), strict=True)
        yield joint_torque_signal(n), run["tau_q"]
        yield joint_saturation_signal(n), run["saturation"]
    if setup.at_tool:
        probe, motion = run["carriers"][0][:1], (true["p_WB"], true["quat_WB"], true["nu"])
        if not contacts.carriers[0].is_B:
            motion = probe["p_WC"], run["quat_WT"], probe["nu"]
        yield from zip(TOOL, motion, strict=True)
        yield MANIPULABILITY, run["model"]["manipulability"]


class Water:
    """The links of a vehicle and the effects of the water in the record ``plant`` (1,) of an image, and their tables in
    its rooms."""

    def __init__(self, image: Image, plant: np.ndarray, vehicle: Vehicle, gravity_W: np.ndarray) -> None:
        self._image, self._plant, self._water = image, plant, plant["water"]
        self._effects = plant["effects"]
        self._there = [name for name in EFFECTS if self._effects[name].size]
        self._noisy = [name for name in self._there if "nodes" in (EFFECTS[name].names or ())]
        plant["links"], plant["frames"] = vehicle.links_in_water, vehicle.arm.frames
        plant["gravity_W"] = gravity_W

    def affect(self, effects: np.ndarray, rows: Mapping[str, np.ndarray]) -> None:
        """Set the records (1,) of the effects, at most as many of each as there is room for, and their tables of
        numbers."""
        drawn = self.drawn()
        for name in self._there:  # and not their states, which go on
            room, given = self._effects[name][0], effects[name][0]
            room[: given.size].view(np.uint8)[:] = given.view(np.uint8)  # a third of the time of field by field
            if given.size < room.size:
                room[given.size :] = np.zeros((), room.dtype)
        set_places(self._effects, rows, lambda key, table: self._image.put(key, table)[0])
        for name in self._noisy:
            self._effects[name]["nodes"] = self._image.room(f"{name}.nodes")[0]
        self.keep(drawn)
        water = self._water
        water["unsteady"], water["fresh"] = moving(self._effects), False
        water["v_c_W"], water["v_c_dot_W"], water["a_c_W"], water["wave_head"] = self.mean_W, 0.0, 0.0, 0.0

    def drawn(self) -> dict[str, np.ndarray]:
        """The records of the processes whose nodes are in memory."""
        return {name: self._effects[name].copy() for name in self._noisy if self._effects[name]["noisy"][0, 0]}

    def keep(self, drawn: Mapping[str, np.ndarray]) -> None:
        """Keep the blocks of :meth:`drawn`, which the rooms still have, for the processes that are the same."""
        for name, before in drawn.items():
            now = self._effects[name]
            if all(np.array_equal(now[field], before[field]) for field in ("noisy", "key", "kept", "deviation")):
                now["block"] = before["block"]

    @property
    def mean_W(self) -> np.ndarray:
        """(3,) constant part of the current in W [m/s]. Setting it takes effect at the next step."""
        return self._effects["current"]["mean"][0, 0].copy()

    @mean_W.setter
    def mean_W(self, value: np.ndarray) -> None:
        self._effects["current"]["mean"] = value
        if not self._water["unsteady"][0]:
            self._water["v_c_W"] = value
