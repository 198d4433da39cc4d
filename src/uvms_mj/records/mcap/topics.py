"""Topics of a log: the ROS 2 type, the frame and the signals of each.

Frames follow REP 105: ``map`` is W and ``base_link`` is B; ``reference`` is the desired pose and ``wall`` the face of
the wall, with x out of it. Each row of a run gives one message on each topic of :func:`sampled`.
"""

from dataclasses import dataclass

import numpy as np

from ...control.rest import SteadyState
from ...physics.frames import quat_from_euler_deg, rotation_matrices, rotation_matrix
from ...plant.geometry import Geometry, Shape
from ...stages.signals import RUNNING, STATE, Signal
from ..header import Header
from ..mcap import ros2
from ..scene import FORCE_SCALE, WALL_RGBA, WALL_SIZE, WALL_THICKNESS, current_arrow, span, wall_face
from ..scene import arrows as drawn
from .cdr import Message

ARROWS_HZ = 20.0
"""Rate of the force arrows in simulated time [Hz], or the log rate if that is lower."""
CONTACT_RGBA, THRUST_RGBA, CURRENT_RGBA = (0.85, 0.22, 0.18, 1.0), (0.95, 0.62, 0.10, 1.0), (0.25, 0.55, 0.95, 1.0)


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


def sampled(header: Header) -> tuple[Topic, ...]:
    """The topics with one message per row, in their order in the log."""
    known = {signal.name: signal for signal in header.signals}
    fixed = {signal.name for signal in (*STATE, *RUNNING)}

    def topic(name: str, kind: str, frame: str, signal: str, message: Message, meaning: str = "") -> Topic:
        return Topic(name, kind, frame, known[signal].unit, meaning or known[signal].meaning, message)

    def wrench(name: str, signal: str) -> Topic:
        return topic(name, "geometry_msgs/WrenchStamped", "base_link", signal, ros2.wrench("base_link", signal))

    def force(name: str, signal: str) -> Topic:
        return topic(name, "geometry_msgs/WrenchStamped", "map", signal, ros2.force("map", signal))

    def array(name: str, signal: str, meaning: str = "") -> Topic:
        frame = "base_link" if known[signal].frame == "B" else "-"
        message = ros2.multi_array(", ".join(known[signal].components), signal, known[signal].size)
        return topic(name, "std_msgs/Float64MultiArray", frame, signal, message, meaning)

    def running(signal: Signal) -> Topic:
        if signal.size > 1:
            return array(f"/running/{signal.name}", signal.name)
        frame = "map" if signal.frame == "W" else "-"
        return topic(f"/running/{signal.name}", "std_msgs/Float64", frame, signal.name, Message().hole(signal.name))

    pose = "m, 1"
    return (
        Topic(
            "/tf",
            "tf2_msgs/TFMessage",
            "map",
            pose,
            "pose of base_link and of reference in map",
            ros2.transforms(("map", "base_link", "p_WB", "quat_WB.xyzw"), ("map", "reference", "p_d", "quat_d.xyzw")),
        ),
        Topic(
            "/odom",
            "nav_msgs/Odometry",
            "map, base_link",
            "m, 1; m/s, rad/s",
            "pose of base_link in map; velocity nu in base_link",
            ros2.odometry("map", "base_link", ("p_WB.odom", "quat_WB.odom"), "nu"),
        ),
        topic("/accel", "geometry_msgs/AccelStamped", "base_link", "nu_dot", ros2.stamped("base_link", "nu_dot", 6)),
        Topic(
            "/reference/pose",
            "geometry_msgs/PoseStamped",
            "map",
            pose,
            "desired pose",
            ros2.header(Message(), "map").hole("p_d.pose", count=3).hole("quat_d.pose", count=4),
        ),
        topic(
            "/reference/twist",
            "geometry_msgs/TwistStamped",
            "map",
            "p_d_dot",
            ros2.stamped("map", "p_d_dot", 3).put("f8", 0, 0, 0),
        ),
        array("/error/pose", "eta_e"),
        topic("/error/twist", "geometry_msgs/TwistStamped", "base_link", "nu_e", ros2.stamped("base_link", "nu_e", 6)),
        array("/s", "s"),
        array("/zeta", "zeta"),
        *(array(f"/law/{name}", name) for name in known if name not in fixed and name != "u"),
        wrench("/tau_nom", "tau_nom"),
        wrench("/tau_cmd", "tau_cmd"),
        wrench("/tau", "tau"),
        wrench("/tau_dist", "tau_dist"),
        array("/thrusters", "u"),
        force("/contact/map", "f_contact_W"),
        Topic(
            "/contact/base_link",
            "geometry_msgs/WrenchStamped",
            "base_link",
            "N, N m",
            "contact force as a wrench at B's origin",
            ros2.wrench("base_link", "f_contact.wrench"),
        ),
        force("/contact/measured", "f_contact_m_W"),
        topic(
            "/contact/stretch",
            "geometry_msgs/Vector3Stamped",
            "map",
            "stretch_W",
            ros2.stamped("map", "stretch_W", 3),
        ),
        *map(running, RUNNING),
    )


def arrows(header: Header) -> Topic:
    """The topic of contact force and thrust as arrows, at :data:`ARROWS_HZ`."""
    message = Message().put("u4", 2)
    ros2.marker(
        message, "map", "contact force", 0, ros2.ARROW, (0.015, 0.03, 0.0), CONTACT_RGBA, points=("tip-f", "tip")
    )
    ros2.marker(message, "map", "thrust", 0, ros2.ARROW, (0.015, 0.03, 0.0), THRUST_RGBA, points=("p", "p+f"))
    meaning = f"contact force and thrust as arrows, {FORCE_SCALE:g} m per newton, cut off at the size of the scene"
    return Topic("/markers/forces", "visualization_msgs/MarkerArray", "map", "m", meaning, message)


def once(header: Header) -> tuple[tuple[Topic, ...], dict[str, np.ndarray]]:
    """The topics of constant values, with one message at the start, and the values for their holes."""
    scenario, analytic = header.scenario, header.analytic
    face = wall_face(header)
    v_c_W = np.array(scenario.current.velocity_W)
    topics = [
        Topic(
            "/tf_static",
            "tf2_msgs/TFMessage",
            "map",
            "m, 1",
            "pose of the wall's face in map",
            ros2.transforms(("map", "wall", "face", "turn.xyzw")),
        ),
        Topic(
            "/current",
            "geometry_msgs/Vector3Stamped",
            "map",
            "m/s",
            "velocity of the current",
            ros2.stamped("map", "v_c_W", 3),
        ),
        Topic(
            "/markers/vehicle",
            "visualization_msgs/MarkerArray",
            "base_link",
            "m",
            "geoms of the vehicle",
            _vehicle(header.geometry),
        ),
        Topic(
            "/markers/surroundings",
            "visualization_msgs/MarkerArray",
            "map",
            "m",
            "the wall, and the current as an arrow",
            _surroundings(header),
        ),
    ]
    if isinstance(analytic, SteadyState):
        message = ros2.force("map", "force")
        text = "closed form of the contact force at rest"
        topics.append(Topic("/analytic/contact", "geometry_msgs/WrenchStamped", "map", "N", text, message))
    position = getattr(analytic, "position", None)
    if position is not None:
        message = ros2.stamped("map", "position", 3)
        text = "closed form of B's position at rest"
        topics.append(Topic("/analytic/position", "geometry_msgs/PointStamped", "map", "m", text, message))
    values = {"face": np.array([face, 0.0, 0.0]), "turn.xyzw": np.array([0.0, 0.0, 1.0, 0.0]), "v_c_W": v_c_W}
    if isinstance(analytic, SteadyState):
        values["force"] = np.array([-analytic.force, 0.0, 0.0])
    if position is not None:
        values["position"] = position
    return tuple(Topic(t.name, t.type, t.frame, t.unit, t.meaning, t.message, latched=True) for t in topics), values


def columns(header: Header, rows: np.ndarray) -> dict[str, np.ndarray]:
    """The values (n, size) for the holes of the sampled topics and of the arrows, from rows (n, width) of signals."""
    values = {name: rows[:, place] for name, place in header.places.items()}
    p, quat = values["p_WB"], values["quat_WB"]
    quat_d = quat_from_euler_deg(*header.scenario.reference.attitude_deg)
    values["quat_WB.xyzw"] = values["quat_WB.odom"] = quat[:, [1, 2, 3, 0]]
    values["p_WB.odom"], values["p_d.pose"] = p, values["p_d"]
    values["quat_d.xyzw"] = values["quat_d.pose"] = np.broadcast_to(quat_d[[1, 2, 3, 0]], (len(rows), 4))
    depth = np.maximum(0.0, p[:, 0] - header.scenario.wall.position)
    values["f_contact.wrench"] = _contact_wrench(values["f_contact_W"], quat, header.geometry.reach - 0.5 * depth)
    return values


def arrow_columns(header: Header, row: np.ndarray) -> dict[str, np.ndarray]:
    """Values for the arrows at one row (width,). The force ends at the contact point, the thrust begins at B."""
    p, quat, tau, f_W = (row[header.places[name]] for name in ("p_WB", "quat_WB", "tau", "f_contact_W"))
    tip = p + np.array([header.geometry.reach, 0.0, 0.0])
    force, thrust = drawn(np.array([f_W, rotation_matrix(quat) @ tau[:3]]), FORCE_SCALE, span(header))
    return {"tip-f": tip - force, "tip": tip, "p": p, "p+f": p + thrust}


def _contact_wrench(f_W: np.ndarray, quat: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """(n, 6) contact wrench at B's origin, in B. The contact point is ``arm`` (n,) [m] from the origin along x of W."""
    R = rotation_matrices(quat)
    moment_W = np.stack([np.zeros(len(f_W)), -arm * f_W[:, 2], arm * f_W[:, 1]], axis=1)
    return np.concatenate([np.einsum("nij,ni->nj", R, f_W), np.einsum("nij,ni->nj", R, moment_W)], axis=1)


def _vehicle(geometry: Geometry) -> Message:
    markers: list[tuple[Shape, int, tuple[float, float, float], np.ndarray, tuple[float, ...]]] = []
    none = np.zeros((0, 3))
    for shape in geometry.shapes:
        a, b, c = shape.size
        centre = shape.position
        if shape.kind == "box":
            markers.append((shape, ros2.CUBE, (2 * a, 2 * b, 2 * c), none, centre))
        elif shape.kind == "sphere":
            markers.append((shape, ros2.SPHERE, (2 * a,) * 3, none, centre))
        elif shape.kind == "ellipsoid":
            markers.append((shape, ros2.SPHERE, (2 * a, 2 * b, 2 * c), none, centre))
        elif shape.kind == "mesh":
            mesh = geometry.meshes[str(shape.mesh)]
            markers.append((shape, ros2.TRIANGLES, (1.0,) * 3, mesh.vertices[mesh.triangles.reshape(-1)], centre))
        else:
            markers.append((shape, ros2.CYLINDER, (2 * a, 2 * a, 2 * b), none, centre))
            if shape.kind == "capsule":
                along = b * rotation_matrix(np.array(shape.quat))[:, 2]
                for sign in (-1, 1):
                    end = tuple(map(float, np.array(centre) + sign * along))
                    markers.append((shape, ros2.SPHERE, (2 * a,) * 3, none, end))
    message = Message().put("u4", len(markers))
    for i, (shape, kind, scale, points, position) in enumerate(markers):
        w, x, y, z = shape.quat
        ros2.marker(
            message,
            "base_link",
            "vehicle",
            i,
            kind,
            scale,
            shape.rgba,
            position=position,
            quat_xyzw=(x, y, z, w),
            points=points,
            locked=True,
        )
    return message


def _surroundings(header: Header) -> Message:
    message = Message().put("u4", 2)
    size = (WALL_THICKNESS, WALL_SIZE, WALL_SIZE)
    position = (wall_face(header) + WALL_THICKNESS / 2, 0.0, 0.0)
    ros2.marker(message, "map", "wall", 0, ros2.CUBE, size, WALL_RGBA, position=position)
    points = np.array(current_arrow(header))
    return ros2.marker(message, "map", "current", 0, ros2.ARROW, (0.02, 0.05, 0.0), CURRENT_RGBA, points=points)
