"""Settings of what is in the way of the current: a wall whose water the vehicle is in (:mod:`..physics.obstacle`)."""

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar

import numpy as np
from pydantic.dataclasses import dataclass

from ..errors import Fault
from ..quantities import STRICT, Number, doc, within
from .settings import EffectTable, Situation, Surface

SHAPES = ("plane", "cylinder")
"""The shapes of walls around which the flow is known."""


@dataclass(frozen=True, config=STRICT)
class Obstacle(EffectTable):
    """A wall in the way of the current: a plane, a face of a declared width, or a cylinder, a pile."""

    of_world: ClassVar[bool] = True
    wall: str | None = doc(
        "the wall that the current meets, 'walls[0]'; null: [wall] with half_width, otherwise none", None
    )
    half_width: Annotated[Number, within(1e-3, 1e6, "m")] | None = doc(
        "of a plane: L, from its middle to its edge across the current [m]", None
    )

    @property
    def key(self) -> str | None:
        """The key of the wall; None if the current goes through all walls."""
        return "wall" if self.wall is None and self.half_width is not None else self.wall

    @property
    def unsteady(self) -> str:
        """Empty: it moves nothing by itself."""
        return ""

    @property
    def constant(self) -> bool:
        """Whether there is none."""
        return self.key is None

    @property
    def velocity_W(self) -> tuple[float, float, float]:
        """(3,) zero: the current has the velocity far away [m/s]."""
        return 0.0, 0.0, 0.0

    def records(self, situation: Situation) -> list[tuple]:
        """The numbers of :data:`uvms_mj.physics.obstacle.OBSTACLE`."""
        if self.key is None:
            return []
        wall = situation.walls[self.key]
        x, y, _ = wall.R_WS.T
        if wall.shape == "plane":
            return [(self.half_width, 0.0, wall.position, -x, y)]
        return [(0.0, wall.radius, wall.position, x, y)]

    def faults(self, situation: Situation) -> Iterator[Fault]:
        if self.key is None:
            return
        wall = situation.walls.get(self.key)
        if wall is None:
            there = ", ".join(situation.walls) or "there is none"
            yield Fault("wall", f"{self.key!r} is no wall of the scenario: {there}")
            return
        if wall.shape not in SHAPES:
            yield Fault("wall", f"the flow around a {wall.shape} is not computed; choose a plane or a cylinder")
        elif wall.moves:
            yield Fault("wall", f"{self.key} moves; the flow is that about a wall at rest")
        elif wall.shape == "plane" and self.half_width is None:
            yield Fault("half_width", "a plane needs it: the current goes around the face at its edges")
        elif wall.shape == "cylinder" and self.half_width is not None:
            yield Fault("half_width", "a cylinder has its radius")
        if situation.links:
            wrong = "the flow is that at the vehicle's origin, which is not computed at the links of an arm"
            yield Fault("wall", f"{wrong}; take a vehicle without joints")


def lost(obstacle: Obstacle, wall: Surface, flow_W: np.ndarray, p_W: np.ndarray, reach: float) -> str:
    """The reason why potential flow about an obstacle does not hold at a place (3,) in W for a vehicle of a reach [m],
    in a current (3,) [m/s, W]; empty if it holds."""
    x, y, _ = wall.R_WS.T
    q = p_W - np.array(wall.position)
    X, Y, U_x, U_y = q @ x, q @ y, flow_W @ x, flow_W @ y
    if wall.shape == "plane":
        assert obstacle.half_width is not None
        if abs(Y) >= obstacle.half_width:
            return f"beside the face, {abs(Y):.3g} m from its middle, where the current leaves its edge"
        return "in the lee of the face, where the current has a wake" if U_x < -_LEAST else ""
    U = math.hypot(U_x, U_y)
    if U <= _LEAST:
        return ""
    assert wall.radius is not None
    along, across = (U_x * X + U_y * Y) / U, abs(U_x * Y - U_y * X) / U
    return "behind the pile, where the current has a wake" if along > 0.0 and across < wall.radius + reach else ""


_LEAST = 1e-9
"""A slower current is none [m/s]."""
