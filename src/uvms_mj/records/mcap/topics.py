"""Topics of a log: the ROS 2 type, the frame and the signals of each, the joints of an arm and the scene as markers.

Every signal of a run is on a topic. :data:`_TYPES` and :func:`_together` declare the signals with a ROS 2 message type
of their own. All other signals have a topic of numbers, so a new signal needs no change here. A topic whose signals are
not all recorded is left out.

Frames follow REP 105: ``map`` is W and ``base_link`` is B; ``reference`` is the desired pose and ``wall`` the face of
the wall, with x out of it; ``walls/0`` is ``walls[0]``, if it moves. Each row of a run gives one message on each
topic of :func:`sampled`.

The frame of a link is ``link/`` and the name of its body, so that no link has the name of another frame. Its parent is
the frame of the parent link, or ``base_link``. The tool's frame is ``tool``. The topics and frames of a vehicle with a
name are below it, ``/left/odom`` and ``left/base_link``, so that the logs of a world can be shown together.
"""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...control.base import SteadyState
from ...physics.frames import BODY, quat_from_euler_deg, rotation_matrix
from ...plant.geometry import LinkGeometry, Shape
from ...stages.signals import RUNNING, Signal, joint_saturation_signal, thruster_saturation_signal, wall_signals
from ..header import Header
from ..scene import FORCE_SCALE, FORCES, Arrow, Force, Scene, scene_of, wall_face, walls_of_scene
from . import ros2
from .ros2 import STAMP, Message

ARROWS_HZ = 20.0
"""Rate of the force arrows in simulated time [Hz], or the log rate if that is lower."""
_ARRAY, _NUMBER = "std_msgs/Float64MultiArray", "std_msgs/Float64"
_ACCEL, _TWIST = "geometry_msgs/AccelStamped", "geometry_msgs/TwistStamped"
_POSE, _VECTOR, _WRENCH = "geometry_msgs/PoseStamped", "geometry_msgs/Vector3Stamped", "geometry_msgs/WrenchStamped"
_TF, _MARKERS, _JOINT_STATE = "tf2_msgs/TFMessage", "visualization_msgs/MarkerArray", "sensor_msgs/JointState"
_FRAMES = {"W": "map", "B": "base_link", "T": "tool", "-": "-"}


@dataclass(frozen=True, eq=False)
class Topic:
    """A topic, and its message with holes for the values of :func:`columns`."""

    name: str
    type: str
    frame: str
    unit: str
    meaning: str
    message: Message
    latched: bool = False


_TYPES = {
    "nu_dot": ("/accel", _ACCEL),
    "p_d_dot": ("/reference/twist", _TWIST),
    "p_d_ddot": ("/reference/accel", _ACCEL),
    "eta_e": ("/error/pose", _ARRAY),
    "nu_e": ("/error/twist", _TWIST),
    "nu_m": ("/measured/twist", _TWIST),
    "nu_T": ("/tool/twist", _TWIST),
    "s": ("/s", _ARRAY),
    "zeta": ("/zeta", _ARRAY),
    "tau_nom": ("/tau_nom", _WRENCH),
    "tau_cmd": ("/tau_cmd", _WRENCH),
    "tau_cmd_delayed": ("/tau_cmd/delayed", _WRENCH),
    "tau": ("/tau", _WRENCH),
    "tau_dist": ("/tau_dist", _WRENCH),
    "tau_lost": ("/tau_lost", _WRENCH),
    "u": ("/thrusters", _ARRAY),
    "f_contact_W": ("/contact/map", _WRENCH),
    "f_contact_m_W": ("/contact/measured", _WRENCH),
    "stretch_W": ("/contact/stretch", _VECTOR),
}
"""Topic and type of a signal that is alone on its topic."""
_SIZES = {_ACCEL: 6, _TWIST: 6, _WRENCH: 6, _VECTOR: 3}
"""Numbers in a message of a type. A signal with fewer numbers is followed by zeros."""


def below(header: Header) -> str:
    """The beginning of the names of all topics: ``/`` and the name of the vehicle, if it has one."""
    return f"/{name}" if (name := header.scenario.vehicle.name) else ""


def frame_below(header: Header, frame: str) -> str:
    """The name of a frame of the vehicle."""
    return f"{below(header)}/{frame}".lstrip("/")


def _pose(position: str, quat: str) -> Message:
    return Message().header("map").hole(position, count=3).hole(quat, count=4)


def _together(header: Header) -> tuple[Topic, ...]:
    """Topics with several signals, or with numbers that are computed from signals by :func:`columns`."""
    base = frame_below(header, "base_link")
    contact = ros2.stamped(base, "f_contact.wrench", 6)
    return (
        Topic(
            "/odom",
            "nav_msgs/Odometry",
            f"map, {base}",
            "m, 1; m/s, rad/s",
            "pose of base_link in map; velocity nu in base_link",
            ros2.odometry("map", base, ("p_WB", "quat_WB.xyzw"), "nu"),
        ),
        Topic("/reference/pose", _POSE, "map", "m, 1", "desired pose", _pose("p_d", "quat_d.xyzw")),
        Topic("/measured/pose", _POSE, "map", "m, 1", "measured pose", _pose("p_WB_m", "quat_WB_m.xyzw")),
        Topic("/tool/pose", _POSE, "map", "m, 1", "pose of the tool", _pose("p_WT", "quat_WT.xyzw")),
        Topic("/contact/base_link", _WRENCH, base, "N, N m", "contact force as a wrench at B's origin", contact),
    )


_RUNNING = {signal.name for signal in (*RUNNING, joint_saturation_signal(0), thruster_saturation_signal(0))}
_COMPUTED = {"quat_d", "f_contact.wrench"}
"""Values that need not be signals."""
_JOINTS = {
    "/joint_states": ("position, velocity and torque of each joint", ("q", "q_dot", "tau_q")),
    "/measured/joint_states": ("measured position and velocity of each joint", ("q_m", "q_dot_m")),
}
"""Meaning and signals of the topics of joints."""


def sampled(header: Header) -> tuple[Topic, ...]:
    """The topics with one message per row, in their order in the log."""
    names = {*header.by_name} - {*header.law.states}
    known = names | _COMPUTED
    together = [
        _transforms(header, names),
        *(t for t in (*_together(header), *_joints(header)) if _signals_of(t) <= known),
    ]
    there = {"t"}.union(*map(_signals_of, together))
    return *together, *(_alone(header, signal) for signal in header.signals if signal.name not in there)


def _signals_of(topic: Topic) -> set[str]:
    """The values that a topic has holes for."""
    return {hole.removesuffix(".xyzw") for hole in topic.message.holes if not hole.startswith(STAMP)}


def _transforms(header: Header, names: set[str]) -> Topic:
    """The topic of the frames that move; tool and links are among them if their signals are recorded."""
    vehicle, wanted = frame_below(header, "base_link"), frame_below(header, "reference")
    items, said = [("map", vehicle, "p_WB", "quat_WB.xyzw"), ("map", wanted, "p_d", "quat_d.xyzw")], ""
    if {"p_WT", "quat_WT"} <= names:
        items.append(("map", frame_below(header, "tool"), "p_WT", "quat_WT.xyzw"))
        said = ", of the tool in map"
    if "q" in names:
        items += transforms(header)
        said += ", of each link in its parent"
    for wall in walls_of_scene(header)[1]:
        p, quat = wall_signals(wall.k)
        items.append(("map", frame_below(header, wall.frame), p.name, f"{quat.name}.xyzw"))
        said += f", of walls[{wall.k}] in map"
    meaning = f"pose of base_link and of reference in map{said}"
    return Topic("/tf", _TF, "map", "m, 1", meaning, ros2.transforms(*items))


def _joints(header: Header) -> Iterator[Topic]:
    """The topics of the states of the joints, if there are any."""
    for name, (meaning, signals) in _JOINTS.items() if header.geometry.links else ():
        message = state(header, *signals)
        yield Topic(name, _JOINT_STATE, "-", "rad, m", meaning, message)


def _alone(header: Header, signal: Signal) -> Topic:
    own = signal.name in header.law.states
    if signal.name in _TYPES and not own:
        name, kind = _TYPES[signal.name]
    else:
        room = "running" if signal.name in _RUNNING else "law" if own else "signals"
        name, kind = f"/{room}/{signal.name}", _ARRAY if signal.shape else _NUMBER
    frame = _FRAMES.get(signal.frame, "-")
    frame = frame if frame in ("map", "-") else frame_below(header, frame)
    if kind == _ARRAY:
        message = ros2.multi_array(", ".join(header.components(signal)), signal.name, signal.size)
    elif kind == _NUMBER:
        message = Message().hole(signal.name)
    else:
        message = ros2.stamped(frame, signal.name, signal.size, _SIZES[kind])
    return Topic(name, kind, frame, signal.unit, signal.meaning, message)


def columns(header: Header, rows: np.ndarray) -> dict[str, np.ndarray]:
    """The values (n, size) for the holes of the sampled topics, from rows (n, width) of signals."""
    values = {name: rows[:, place] for name, place in header.places.items()}
    if "quat_d" not in values:
        quat_d = quat_from_euler_deg(*header.scenario.reference.attitude_deg)
        values["quat_d"] = np.broadcast_to(quat_d, (len(rows), 4))
    of_walls = (wall_signals(wall.k)[1].name for wall in walls_of_scene(header)[1])
    for name in ("quat_WB", "quat_d", "quat_WB_m", "quat_WT", *of_walls):
        if name in values:
            values[f"{name}.xyzw"] = values[name][:, [1, 2, 3, 0]]
    if "q" in values:
        values |= columns_of_joints(header, values["q"])
    if "tau_contacts_B" in values:
        values["f_contact.wrench"] = values["tau_contacts_B"]
        return values
    origin = values[header.task_frame[0]]
    depth = np.maximum(0.0, origin[:, 0] - header.scenario.wall.position)
    arm = header.probe_radius - 0.5 * depth
    f_W, R = values["f_contact_W"], rotation_matrix(values["quat_WB"])
    # the contact point is arm (n,) from the origin of the frame of the task along x of W
    moment_W = np.stack([np.zeros(len(f_W)), -arm * f_W[:, 2], arm * f_W[:, 1]], axis=1)
    if header.scenario.task.frame != BODY:
        moment_W += np.cross(origin - values["p_WB"], f_W)
    values["f_contact.wrench"] = np.concatenate([np.einsum("nij,ni->nj", R, each) for each in (f_W, moment_W)], axis=1)
    return values


# Constant values and arrows


def arrows() -> Topic:
    """The topic of the forces as arrows, at :data:`ARROWS_HZ`."""
    meaning = f"contact force and thrust as arrows, {FORCE_SCALE:g} m per newton, cut off at the size of the scene"
    return Topic("/markers/forces", _MARKERS, "map", "m", meaning, forces())


ONCE = {
    "/tf_static": _TF,
    "/current": _VECTOR,
    "/markers/vehicle": _MARKERS,
    "/markers/surroundings": _MARKERS,
    "/analytic/contact": _WRENCH,
    "/analytic/position": "geometry_msgs/PointStamped",
}
"""Topics of constant values and their types. A log has the topics of the closed form if there is one."""


def once(header: Header) -> tuple[tuple[Topic, ...], dict[str, np.ndarray]]:
    """The topics of constant values, with one message at the start, and the values for their holes."""
    scene, analytic = scene_of(header), header.analytic
    wall = ros2.transforms(("map", "wall", "face", "turn.xyzw"))
    current = ros2.stamped("map", "v_c_W", 3)
    meaning = "velocity of the current" if header.scenario.constant_flow else "constant part of the current"
    shapes, around = vehicles(header, scene), surroundings(header, scene)
    topics = [
        ("/tf_static", "map", "m, 1", "pose of the wall's face in map", wall),
        ("/current", "map", "m/s", meaning, current),
        ("/markers/vehicle", frame_below(header, "base_link"), "m", "geoms of the vehicle", shapes),
        ("/markers/surroundings", "map", "m", "the walls, and the current as an arrow", around),
    ]
    values = {
        "face": np.array([wall_face(header), 0.0, 0.0]),
        "turn.xyzw": np.array([0.0, 0.0, 1.0, 0.0]),
        "v_c_W": header.scenario.mean_flow_W,
    }
    if isinstance(analytic, SteadyState):
        if "f_normal" not in header.by_name:  # the force is along x
            text = "closed form of the contact force at rest"
            topics.append(("/analytic/contact", "map", "N", text, ros2.stamped("map", "force", 3, 6)))
            values["force"] = np.array([-analytic.force, 0.0, 0.0])
        if analytic.position is not None:  # a user's law may predict the force only
            whose = "the tool's" if header.task_frame[0] == "p_WT" else "B's"
            text = f"closed form of {whose} position at rest"
            topics.append(("/analytic/position", "map", "m", text, ros2.stamped("map", "position", 3)))
            values["position"] = analytic.position
    return tuple(
        Topic(name, ONCE[name], frame, unit, text, message, latched=True) for name, frame, unit, text, message in topics
    ), values


def frame_of(link: LinkGeometry) -> str:
    """The frame of a link in ``/tf``."""
    return f"link/{link.name}"


def transforms(header: Header) -> Iterator[tuple[str, str, str, str]]:
    """The items of ``/tf`` for the links; :func:`columns_of_joints` gives the values for their holes."""
    links = header.geometry.links
    for link in links:
        parent = frame_below(header, frame_of(links[link.parent]) if link.parent >= 0 else "base_link")
        yield parent, frame_below(header, frame_of(link)), f"{frame_of(link)}.p", f"{frame_of(link)}.quat.xyzw"


def columns_of_joints(header: Header, q: np.ndarray) -> dict[str, np.ndarray]:
    """The poses of the links in their parents' frames from joint positions q (n, joints)."""
    values = {}
    for i, link in enumerate(header.geometry.links):
        position, quat = link.pose(q[:, i])
        values[f"{frame_of(link)}.p"], values[f"{frame_of(link)}.quat.xyzw"] = position, quat[:, [1, 2, 3, 0]]
    return values


def state(header: Header, position: str, velocity: str, effort: str = "") -> Message:
    """A JointState of signals with one number a joint; without effort if that is empty."""
    joints = [link.joint for link in header.geometry.links]
    message = Message().header("").put("u4", len(joints))
    for joint in joints:
        message.text(joint)
    for name in (position, velocity, effort):
        message.put("u4", len(joints) if name else 0)
        if name:
            message.hole(name, count=len(joints))
    return message


_NO_POINTS = np.zeros((0, 3))


def forces() -> Message:
    """The forces as arrows; :func:`force_columns` gives the values for the holes."""
    message = Message().put("u4", len(FORCES))
    for force in FORCES:
        _arrow(message, force, 0, (f"{force.name}.start", f"{force.name}.tip"))
    return message


def force_columns(header: Header, rows: np.ndarray) -> dict[str, np.ndarray]:
    """The values (n, 3) for the holes of :func:`forces`, from rows (n, width)."""
    values = {name: rows[:, place] for name, place in header.places.items()}
    found = {}
    for force in FORCES:
        found[f"{force.name}.start"], found[f"{force.name}.tip"] = force.ends(header, values, FORCE_SCALE)
    return found


def vehicles(header: Header, scene: Scene) -> Message:
    """The geoms of the vehicles, each in the frame of the body or link that carries it."""
    parts = [
        (vehicle, frame_below(header, frame), part)
        for vehicle in scene.vehicles
        for frame, shapes in (("base_link", vehicle.shapes), *((frame_of(link), link.shapes) for link in vehicle.links))
        for shape in shapes
        for part in _parts(shape)
    ]
    message = Message().put("u4", len(parts))
    for i, (vehicle, frame, shape) in enumerate(parts):
        points = vehicle.meshes[str(shape.mesh)].corners() if shape.kind == "mesh" else _NO_POINTS
        _solid(message, frame, "vehicle", i, shape, points)
    return message


def surroundings(header: Header, scene: Scene) -> Message:
    """The walls, each in its frame if it moves, and the constant arrows."""
    walls = [("map", part) for wall in scene.walls for part in _parts(wall)]
    walls += [(frame_below(header, wall.frame), part) for wall in scene.moving for part in _parts(wall.shape)]
    message = Message().put("u4", len(walls) + len(scene.arrows))
    for i, (frame, wall) in enumerate(walls):
        _solid(message, frame, "wall", i, wall)
    for i, arrow in enumerate(scene.arrows):
        _arrow(message, arrow, i, np.array([arrow.start, arrow.tip]))
    return message


def _arrow(message: Message, arrow: Force | Arrow, number: int, points: np.ndarray | tuple[str, str]) -> None:
    """Append an arrow in map, from the first of two points to the second."""
    r, g, b = (c / 255 for c in arrow.colour)
    diameters = (2.0 * arrow.radius, 4.0 * arrow.radius, 0.0)  # of shaft and head; the head has its default length
    ros2.marker(message, "map", arrow.name, number, ros2.ARROW, diameters, (r, g, b, 1.0), points=points)


def _parts(shape: Shape) -> Iterator[Shape]:
    """The shapes that ROS 2 has markers for: a capsule is a cylinder and two spheres."""
    if shape.kind != "capsule":
        yield shape
        return
    radius, half, _ = shape.size
    yield dataclasses.replace(shape, kind="cylinder")
    along = half * rotation_matrix(np.array([shape.quat]))[0, :, 2]
    for end in (shape.position - along, shape.position + along):
        yield dataclasses.replace(shape, kind="sphere", position=tuple(end.tolist()), size=(radius, 0.0, 0.0))


def _solid(message: Message, frame: str, name: str, number: int, shape: Shape, points: np.ndarray = _NO_POINTS) -> None:
    """Append a shape, with the corners of its triangles if it is a mesh."""
    a, b, c = shape.size
    kind, size = {
        "box": (ros2.CUBE, (2 * a, 2 * b, 2 * c)),
        "sphere": (ros2.SPHERE, (2 * a, 2 * a, 2 * a)),
        "ellipsoid": (ros2.SPHERE, (2 * a, 2 * b, 2 * c)),
        "cylinder": (ros2.CYLINDER, (2 * a, 2 * a, 2 * b)),
        "mesh": (ros2.TRIANGLES, (1.0, 1.0, 1.0)),
    }[shape.kind]
    w, x, y, z = shape.quat
    pose = {"position": shape.position, "quat_xyzw": (x, y, z, w)}
    ros2.marker(message, frame, name, number, kind, size, shape.rgba, **pose, points=points, locked=frame != "map")
