"""A link of a vehicle's arm as plain data, for drawing: its shapes, and its pose from the position of its joint."""

from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ..physics.frames import quat_product, rotation_matrix
from ..quantities import STRICT, NonNegative, Real, Vector3
from .shapes import Shape


@dataclass(frozen=True, config=STRICT)
class LinkGeometry:
    """A link with its joint, and the shapes of its body and of the bodies fixed to it, in the link's frame.

    Attributes:
        name, joint: names of the link's body and of its joint.
        parent: index of the parent among the links, which precedes the link; -1 is the base.
        slide: whether the joint slides; otherwise it is a hinge.
        position, quat: of the link's frame in its parent's frame at q = 0 [m], w x y z.
        axis, anchor: of the joint in the link's frame: unit vector, and a point on it [m].
        range: limits of the joint's position [rad, or m if it slides]; None without limits.
        effort: greatest torque of the motor [N m, or N if it slides]; 0 without a motor, None without a limit.
    """

    name: str
    joint: str
    parent: Annotated[int, Field(ge=-1)]
    slide: bool
    position: Vector3
    quat: tuple[Real, Real, Real, Real]
    axis: Vector3
    anchor: Vector3
    range: tuple[Real, Real] | None
    effort: NonNegative | None
    shapes: tuple[Shape, ...]

    def pose(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, 3) [m] and attitudes (n, 4) of the link's frame in its parent's frame, at joint positions q
        (n,) [rad or m].

        A hinge turns the frame about the axis through the anchor, a slide moves it along the axis.
        """
        axis, anchor, quat_0 = (np.array(each) for each in (self.axis, self.anchor, self.quat))
        R_0 = rotation_matrix(quat_0)
        if self.slide:
            return self.position + q[:, None] * (R_0 @ axis), np.tile(quat_0, (len(q), 1))
        turn = np.concatenate([np.cos(0.5 * q)[:, None], np.sin(0.5 * q)[:, None] * axis], axis=1)
        return self.position + (anchor - rotation_matrix(turn) @ anchor) @ R_0.T, quat_product(quat_0, turn)
