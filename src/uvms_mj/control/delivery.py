r"""The thrust at rest behind a commanded wrench.

The allocation gives the commands, :math:`u_{cmd} = \hat B^+ \tau_{cmd}`, the thrusters turn each into a thrust by their
static curve, :math:`u = F(u_{cmd})`, and the true thrusters produce :math:`\tau = B u`. Lags, delays and the rate limit
do not matter at rest. For thrusters with a gain each, :math:`u = G u_{cmd}`, the wrench is
:math:`\tau = T \tau_{cmd}` with :math:`T = B G \hat B^+`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

_ZERO = 1e-9
"""A smaller thrust at rest is zero [N]."""


@dataclass(frozen=True, eq=False)
class Delivery:
    """The map from tau_cmd to tau at rest, within the thrusters' limits.

    Attributes:
        setup: the run's :class:`uvms_mj.setup.base.Setup`, with its allocation and its thrusters.
        inverse: (n, 6) of the allocation.
        static: :class:`uvms_mj.actuation.thrusters.Static`.
        T: (6, 6), with gains of one if the static curve is not a gain.
    """

    setup: Any
    inverse: np.ndarray
    static: Any
    T: np.ndarray

    @classmethod
    def of(cls, setup: Any) -> "Delivery | str":
        """The map of a run, or the reason why it is not known."""
        static = setup.scenario.thrusters.at_rest(setup)
        if isinstance(static, str):
            return static
        inverse = setup.scenario.actuation.inverse(setup.nominal.B)
        gain = np.ones(len(inverse)) if static.gain is None else static.gain
        same = setup.vehicle.B is setup.nominal.B or np.array_equal(setup.vehicle.B, setup.nominal.B)
        ideal = same and bool((gain == 1.0).all())
        return cls(setup, inverse, static, np.eye(6) if ideal else (setup.vehicle.B * gain) @ inverse)

    def thrusts(self, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The thrusts (n,) that give tau (6,), and the least and the greatest ones (n,) [N]. Thrusters with a curve
        that the control system does not know are taken to share tau with the least thrust."""
        gain, thrust = self.static.gain, self.static.thrust
        low, high = self.setup.scenario.thrusters.command_limits(self.setup)
        if gain is None:
            return np.linalg.pinv(self.setup.vehicle.B) @ tau, thrust(low), thrust(high)
        working = gain > 0.0
        least, most = (np.where(working, np.where(working, gain, 1.0) * each, 0.0) for each in (low, high))
        return gain * (self.inverse @ np.linalg.solve(self.T, tau)), least, most

    def missing(self, tau: np.ndarray) -> np.ndarray:
        """What the thrusters at their limits add to tau (6,), zero within them."""
        u, least, most = self.thrusts(tau)
        missing: np.ndarray = self.setup.vehicle.B @ (np.clip(u, least, most) - u)
        return missing

    def weak(self, tau: np.ndarray) -> str:
        """The reason why the thrusters can't hold tau (6,), with their names; empty if they can."""
        u, least, most = self.thrusts(tau)
        weak, starting = [], []
        for k, name in enumerate(self.setup.vehicle.thrusters):
            needs = f"{name or f'thruster {k + 1}'} needs {u[k]:.4g} N at rest"
            start = self.static.start[int(u[k] > 0.0)]
            if not least[k] <= u[k] <= most[k]:
                weak.append(f"{needs} and has {(most if u[k] > 0.0 else least)[k]:.4g} N")
            elif _ZERO < abs(u[k]) < abs(start) - _ZERO:
                starting.append(f"{needs} and starts at {start:.4g} N")
        if weak:
            return f"the thrusters are too weak: {'; '.join(weak)}"
        return f"the dead band of the thrusters: {'; '.join(starting)}" if starting else ""
