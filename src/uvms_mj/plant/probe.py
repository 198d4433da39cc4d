"""The sphere of a vehicle that touches ``[wall]``, and the frames that contact bodies are fixed to."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..physics.frames import BODY


@dataclass(frozen=True, eq=False)
class Carrier:
    """A frame C on a link.

    Attributes:
        link: index in ``vehicle.arm.links``; -1 is the base.
        p: (3,) position in the link's frame [m].
        R: (3, 3) attitude in the link's frame.
    """

    link: int
    p: np.ndarray
    R: np.ndarray

    @classmethod
    def of_link(cls, link: int) -> "Carrier":
        """The frame of a link itself."""
        return cls(link, np.zeros(3), np.eye(3))

    @property
    def is_B(self) -> bool:
        """Whether it is the vehicle's frame B."""
        return self.same(Carrier.of_link(-1))

    def same(self, other: "Carrier") -> bool:
        """Whether both are one frame."""
        return self.link == other.link and np.array_equal(self.p, other.p) and np.array_equal(self.R, other.R)


@dataclass(frozen=True, eq=False)
class Probe:
    """The sphere about the origin of the frame of the task: B, or a site. ``body`` is MuJoCo's body that carries it,
    and ``radius`` is the vehicle's reach, or the size of the site [m]."""

    body: str
    carrier: Carrier
    radius: float

    @classmethod
    def of(cls, frame: str, mjcf: Any) -> "Probe":
        """The probe at the frame of a task, "body" or the name of a site, from the vehicle's
        :class:`uvms_mj.plant.mjcf.Mjcf`."""
        vehicle = mjcf.vehicle
        if frame == BODY:
            return cls(vehicle.body, Carrier.of_link(-1), mjcf.geometry.reach)
        site = vehicle.arm.sites[frame]
        body = vehicle.arm.links[site.link].name if site.link >= 0 else vehicle.body
        return cls(body, Carrier(site.link, site.p, site.R), site.radius)
