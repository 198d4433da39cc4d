"""The ROS 2 messages of a log: their definitions, and messages of fixed size with holes for numbers.

The definitions come from ROS 2 Humble and later, without comments and constants.

Messages are in Common Data Representation (CDR). They begin with four bytes that mean "little-endian CDR". After them,
every number is aligned to a multiple of its size (OMG, DDS-XTypes 1.3, sec. 7.4.1, "plain CDR"). A string is its length
including the final zero, then its characters. A sequence is its length, then its elements.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/ColorRGBA": "float32 r\nfloat32 g\nfloat32 b\nfloat32 a",
    "std_msgs/Float64": "float64 data",
    "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset",
    "std_msgs/Float64MultiArray": "std_msgs/MultiArrayLayout layout\nfloat64[] data",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/PointStamped": "std_msgs/Header header\ngeometry_msgs/Point point",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/TwistStamped": "std_msgs/Header header\ngeometry_msgs/Twist twist",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "geometry_msgs/Accel": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/AccelStamped": "std_msgs/Header header\ngeometry_msgs/Accel accel",
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
    "geometry_msgs/WrenchStamped": "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
    "geometry_msgs/Vector3Stamped": "std_msgs/Header header\ngeometry_msgs/Vector3 vector",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "nav_msgs/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist"
    ),
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data",
    "visualization_msgs/UVCoordinate": "float32 u\nfloat32 v",
    "visualization_msgs/MeshFile": "string filename\nuint8[] data",
    "visualization_msgs/Marker": (
        "std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\ngeometry_msgs/Pose pose\n"
        "geometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\nbuiltin_interfaces/Duration lifetime\n"
        "bool frame_locked\ngeometry_msgs/Point[] points\nstd_msgs/ColorRGBA[] colors\nstring texture_resource\n"
        "sensor_msgs/CompressedImage texture\nvisualization_msgs/UVCoordinate[] uv_coordinates\nstring text\n"
        "string mesh_resource\nvisualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials"
    ),
    "visualization_msgs/MarkerArray": "visualization_msgs/Marker[] markers",
}

HEADER = b"\x00\x01\x00\x00"
STAMP = "stamp."
"""Prefix of the names of holes for stamps. States of a law are identifiers, so a name with a point is not a state."""
ARROW, CUBE, SPHERE, CYLINDER, TRIANGLES = 0, 1, 2, 3, 11
"""Types of a Marker."""

LATCHED_QOS = (
    "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n"
    "  deadline:\n    sec: 9223372036\n    nsec: 854775807\n"
    "  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n"
    "  liveliness: 1\n"
    "  liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n"
    "  avoid_ros_namespace_conventions: false"
)
"""Quality of service that ``ros2 bag play`` offers for a message sent once: late subscribers get it, too."""


def schema_text(name: str) -> str:
    """The definition of ``package/Name`` followed by the definitions of all types in it, in MCAP's encoding
    "ros2msg"."""
    seen, waiting = [name], [name]
    while waiting:
        for line in DEFINITIONS[waiting.pop(0)].splitlines():
            part = line.split()[0].partition("[")[0]
            if part in DEFINITIONS and part not in seen:
                seen.append(part)
                waiting.append(part)
    rule = "=" * 80
    first, *rest = seen
    return "\n".join([DEFINITIONS[first], *(f"{rule}\nMSG: {each}\n{DEFINITIONS[each]}" for each in rest)]) + "\n"


@dataclass(frozen=True)
class Hole:
    """Place for numbers in a message: ``count`` numbers of type ``kind`` at byte ``offset``."""

    offset: int
    kind: str
    count: int


class Message:
    """A message under construction: its bytes, zero in the holes, and the holes by name. Constants are written; numbers
    that change from row to row leave a hole."""

    def __init__(self) -> None:
        self.data = bytearray(HEADER)
        self.holes: dict[str, Hole] = {}

    def _align(self, size: int) -> None:
        self.data += b"\x00" * (-(len(self.data) - len(HEADER)) % size)

    def put(self, kind: str, *values: ArrayLike) -> Self:
        """Append constants of a NumPy type, without their number."""
        self._align(int(kind[1]))
        self.data += np.array(values, f"<{kind}").tobytes()
        return self

    def text(self, value: str) -> Self:
        encoded = value.encode() + b"\x00"
        self.put("u4", len(encoded)).data += encoded
        return self

    def hole(self, name: str, kind: str = "f8", count: int = 1) -> Self:
        size = int(kind[1])
        self._align(size)
        self.holes[name] = Hole(len(self.data), f"<{kind}", count)
        self.data += bytes(size * count)
        return self

    def header(self, frame: str) -> Self:
        """Append a std_msgs/Header with a hole for its stamp, seconds and nanoseconds. All stamps are equal."""
        return self.hole(f"{STAMP}{len(self.holes)}", "u4", 2).text(frame)


def stamped(frame: str, name: str, count: int, of: int = 0) -> Message:
    """A PoseStamped, TwistStamped, ... of ``of`` numbers: the numbers of one signal, then zeros."""
    return Message().header(frame).hole(name, count=count).put("f8", *(0.0,) * (of - count))


def multi_array(label: str, name: str, size: int) -> Message:
    """A Float64MultiArray of one dimension."""
    return Message().put("u4", 1).text(label).put("u4", size, size, 0, size).hole(name, count=size)


def odometry(frame: str, child: str, pose: tuple[str, str], twist: str) -> Message:
    """An Odometry with zero covariances; ``pose`` has the names of position and orientation."""
    message = Message().header(frame).text(child).hole(pose[0], count=3).hole(pose[1], count=4)
    return message.put("f8", np.zeros(36)).hole(twist, count=6).put("f8", np.zeros(36))


def transforms(*items: tuple[str, str, str, str]) -> Message:
    """A TFMessage of (frame, child, name of the translation, name of the rotation)."""
    message = Message().put("u4", len(items))
    for frame, child, translation, rotation in items:
        message.header(frame).text(child).hole(translation, count=3).hole(rotation, count=4)
    return message


def marker(
    message: Message,
    frame: str,
    namespace: str,
    number: int,
    kind: int,
    scale: tuple[float, float, float],
    rgba: tuple[float, float, float, float],
    *,
    position: tuple[float, ...] = (0.0, 0.0, 0.0),
    quat_xyzw: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0),
    points: np.ndarray | tuple[str, ...] = (),
    locked: bool = False,
) -> Message:
    """One Marker of an array.

    ``points`` are (n, 3) numbers, or names of holes of three numbers each. A ``locked`` marker moves with its frame.
    """
    message.header(frame).text(namespace).put("i4", number, kind, 0)
    message.put("f8", *position, *quat_xyzw, *scale).put("f4", *rgba).put("i4", 0).put("u4", 0).put("u1", locked)
    message.put("u4", len(points))
    if isinstance(points, np.ndarray):
        message.put("f8", points)
    else:
        for name in points:
            message.hole(name, count=3)
    message.put("u4", 0).text("")  # colors, texture_resource
    message.put("i4", 0).put("u4", 0).text("").text("").put("u4", 0)  # texture
    message.put("u4", 0).text("").text("")  # uv_coordinates, text, mesh_resource
    return message.text("").put("u4", 0).put("u1", 0)  # mesh_file, mesh_use_embedded_materials
