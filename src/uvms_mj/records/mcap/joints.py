"""Topics of a vehicle with an arm: the frame of each link in ``/tf``, and the states of the joints.

The frame of a link is ``link/`` and the name of its body, so that no link has the name of another frame. Its parent is
the frame of the parent link, or ``base_link``. The tool's frame is ``tool``.
"""

from collections.abc import Iterator

import numpy as np

from ...plant.geometry import LinkGeometry
from ..header import Header
from .ros2 import Message


def frame_of(link: LinkGeometry) -> str:
    """The frame of a link in ``/tf``."""
    return f"link/{link.name}"


def transforms(header: Header) -> Iterator[tuple[str, str, str, str]]:
    """The items of ``/tf`` for the links; :func:`columns` gives the values for their holes."""
    links = header.geometry.links
    for link in links:
        parent = frame_of(links[link.parent]) if link.parent >= 0 else "base_link"
        yield parent, frame_of(link), f"{frame_of(link)}.p", f"{frame_of(link)}.quat.xyzw"


def columns(header: Header, q: np.ndarray) -> dict[str, np.ndarray]:
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
