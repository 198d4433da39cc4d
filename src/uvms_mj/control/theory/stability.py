r"""Does the sampled law come to rest? Chatter, vibration, bounce and a late command, from the eigenvalues of the loop.

A law that is linear at rest does, if no motion grows (:mod:`.loop`), neither in free water nor against a wall. A law
that is not linear over s is swept over the amplitude S of s. A motion that grows at small S and decays at larger ones
ends at the amplitude between, the describing function's limit cycle; its force follows from the eigenvector. One that
grows again at still larger S bounces on after a hard impact.

Super-twisting is infinitely steep at s = 0, so that it always chatters by a little. A describing function knows one
motion at a time: where slow measurements make the chatter large, it does not see that an old force undamps the wall
behind it. There the closed form decides (:class:`.loop.ForceAge`), which is the limit of the loop for S = 0 and a
short period:

.. math:: T < (D_d / K_f + b_c) / k_c.
"""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...stages.setup import SetupLike
from ..base import SteadyState
from .approach import SLOWEST
from .loop import About, ForceAge, Loop, Timing
from .own_effects import OwnEffects

SLOWLY_DAMPED = 0.75
"""If more than this fraction of the damping against the wall is lost, a vibration lasts for many seconds."""
_SEEN = 0.01
"""Least peak-to-peak force of a vibration that is worth a warning [N]."""
_CHATTERS = 0.02
"""Peak-to-peak force over the force at rest from which super-twisting limit-cycles [1]. Its chatter has 1e-3; the mean
force of a limit cycle is not that at rest."""
_SMALLEST, _LARGEST, _AMPLITUDES = 1e-8, 2e-2, 40
"""Amplitudes of s [m/s], and their number. The largest follows an impact at a few decimetres per second."""
_HALVINGS = 8
"""Number of times that the range of a boundary layer is halved."""


@dataclass(frozen=True, eq=False)
class Stability:
    """The motion of a run about its rest under the sampled law.

    Attributes:
        setup: the run's :class:`uvms_mj.setup.base.Setup`.
        age: the age of the contact force, for the laws whose damping it takes.
        layer: amplitude of s up to which the law is linear [m/s]: infinite for a law without s, 0 for super-twisting.
        about: states of the law at rest that are not zero.
        held: the same states for a rest, where they depend on it.
    """

    setup: SetupLike
    age: ForceAge | None = None
    layer: float = math.inf
    about: About = ()
    held: Callable[[SteadyState], About] = lambda state: ()

    @functools.cached_property
    def unknown(self) -> str:
        """The reason why nothing is known of the loop; empty if its motions are."""
        if (reason := Timing.of(self.setup).too_long) or not self.setup.scenario.effects or self.setup.not_rigid:
            return reason
        return OwnEffects(self.setup.scenario.effects, self.setup).not_in_the_loop(self.setup)

    @functools.cached_property
    def free(self) -> float:
        """Growth rate of a small motion without contact [1/s]. Super-twisting chatters there, and has none."""
        return self._growth(None) if self.layer else -math.inf

    @functools.cached_property
    def at_wall(self) -> tuple[float, bool, float, Any]:
        """At the worst contact: the peak-to-peak force of the vibration in which the law ends [N], 0 if it decays and
        infinite if it has no end; whether it bounces after a hard impact; the growth rate of a small motion [1/s]; and
        the contact, None without any."""
        contacts = [each for each in self.setup.contacts_at_rest if each.normal.any()]  # none at the centre of a shape
        found = [(*self._ends(contact), contact) for contact in contacts]
        return max(found, key=lambda each: each[:3], default=(0.0, False, -math.inf, None))

    @functools.cached_property
    def _of_effects(self) -> str:
        """The reason why a user's effects let no run come to rest, or why that is not known; empty if they may."""
        setup = self.setup
        if not setup.scenario.effects or setup.not_rigid:
            return ""
        own = OwnEffects(setup.scenario.effects, setup)
        if own.longest_step(setup) < setup.scenario.simulation.timestep:
            return f"the time step does not resolve {own.names}"
        if self.layer == 0.0 and own.feed(setup):
            return f"{own.names} feeds energy in about rest, and a super-twisting law is not known to hold it"
        return ""

    def _growth(self, contact: Any, period: float | None = None, push: float | None = None) -> float:
        """Growth rate of a small motion [1/s], also at another control period [s], or under another push [N]."""
        amplitudes = () if math.isinf(self.layer) else (self.layer,)
        return float(Loop(self.setup, contact, self.about, amplitudes, period, push=push).growths[0])

    def _grows_pressed(self, state: SteadyState) -> bool:
        """Whether a user's effects, which may depend on the contact, make a motion grow under the push of a rest."""
        setup = self.setup
        if not setup.scenario.effects or setup.not_rigid or state.force <= 0.0:
            return False
        contacts = [each for each in setup.contacts_at_rest if each.normal.any()]
        if self.layer == 0.0:
            own = OwnEffects(setup.scenario.effects, setup)
            return any(own.feed(setup, state.force * each.normal) for each in contacts)
        return any(self._growth(each, push=state.force) > SLOWEST for each in contacts)

    def _grows_about(self, state: SteadyState) -> bool:
        """Whether the motion about a rest among shapes grows, with one of the sets of contacts that it meets.
        Super-twisting keeps eq. (7), which :mod:`.approach` has checked."""
        if state.contacts is None or self.layer == 0.0:
            return False
        amplitudes = () if math.isinf(self.layer) else (self.layer,)
        rest, about = state.contacts, (*self.about, *self.held(state))
        loops = (Loop(self.setup, None, about, amplitudes, rest=rest, springs=k) for k in range(len(rest.springs)))
        return any(loop.growths[0] > SLOWEST or loop.swings for loop in loops)

    def _ends(self, contact: Any) -> tuple[float, bool, float]:
        if math.isinf(self.layer):
            growth = self._growth(contact)
            return math.inf if growth > SLOWEST else 0.0, False, growth
        S = np.geomspace(self.layer or _SMALLEST, max(_LARGEST, 10.0 * self.layer), _AMPLITUDES)
        loop = Loop(self.setup, contact, self.about, tuple(S.tolist()))
        growths = loop.growths
        grows, i = growths > SLOWEST, int((growths > SLOWEST).argmin())
        if grows.all():
            return math.inf, True, float(growths[0])
        swing = 0.0
        if i:
            share = growths[i - 1] / (growths[i - 1] - growths[i])
            swing = float(2.0 * S[i - 1] * (S[i] / S[i - 1]) ** share * loop.force_per_s(i - 1))
        return swing, bool(grows[i:].any()), float(growths[0])

    @property
    def _too_old(self) -> bool:
        """Whether the old force undamps the wall behind the chatter of super-twisting."""
        return self.layer == 0.0 and self.age is not None and self.age.share >= 1.0

    @property
    def free_reason(self) -> str:
        """The reason why the sampled law does not come to rest anywhere, or why that is not known; empty if it may."""
        if self.unknown or self._of_effects:
            return self.unknown or self._of_effects
        what = "is unstable" if math.isinf(self.layer) else "chatters"
        return f"the sampled law {what} without contact" if self.free > SLOWEST else ""

    def checked(self, state: SteadyState | str) -> SteadyState | str:
        """The state at rest, or the reason why the sampled law does not come to rest there."""
        if not isinstance(state, SteadyState):
            return state
        if self.free_reason:
            return self.free_reason
        most = 0.0 if self.layer else _CHATTERS * state.force
        if state.force > 0.0 and (self._too_old or self.at_wall[0] > most):
            if self.age and self.age.share >= 1.0:
                return f"the sampled law limit-cycles against this wall: {self.age.comparison()}"
            return "the sampled law does not damp the vibration against this wall"
        if self._grows_pressed(state):
            return "the sampled law does not come to rest here: a motion under the push grows with the effects"
        if self._grows_about(state):
            return "the sampled law does not come to rest at this contact: a motion about it grows, or hardly decays"
        return state

    def notes(self, label: str) -> Iterator[str]:
        """Warnings if a motion grows or vibrates, without a wall or against it, or decays slowly, or if that is not
        known."""
        if self.unknown:
            yield f"whether {label} chatters or vibrates is not checked: {self.unknown}"
            return
        effects, not_rigid = self.setup.scenario.effects, self.setup.not_rigid
        if effects and not_rigid:
            names = OwnEffects(effects, self.setup).names
            yield (
                f"what is said of chatter and vibration leaves out {names}: the loop has effects of a rigid vehicle at "
                f"B in it, and {not_rigid}"
            )
        swing, bounces, growth, contact = self.at_wall
        old = self.age is not None and self.age.share > SLOWLY_DAMPED
        if self.free > SLOWEST:
            what = "oscillates" if math.isinf(self.layer) else "chatters"
            yield f"{label} {what} without contact: {self._growing(None, self.free)}"
        elif self.age and old and (self._too_old or swing > _SEEN):
            yield f"{label} limit-cycles against the wall {self._old(self.age)}"
        elif self.age and old and self.age.share < 1.0:
            yield f"{label} hardly damps the vibration against the wall {self._old(self.age)}"
        elif math.isinf(swing) and self.layer:
            where = f"against the wall, {contact.stiffness:g} N/m"
            yield f"{label} oscillates {where}: {self._growing(contact, growth)}"
        elif swing > _SEEN:
            what = f"vibrates against the wall by about {swing:.2g} N, or until it leaves it"
            if math.isinf(swing):
                what = "oscillates against the wall without end"
            yield f"{label} {what}: {self._late()}"
        if bounces and math.isfinite(swing):
            yield (
                f"{label} may bounce or oscillate against the wall without end after a hard impact: with these gains, "
                "estimates and delays it compensates the contact force too late"
            )

    def _quiet(self, contact: Any, period: float) -> bool:
        """Whether a small motion is known not to grow at a control period [s]."""
        return not Timing.of(self.setup, period).too_long and self._growth(contact, period) <= SLOWEST

    def _growing(self, contact: Any, growth: float) -> str:
        """Growth rate of a small motion, and a control period or a boundary layer with which it does not grow."""
        h, period = self.setup.scenario.simulation.timestep, self.setup.scenario.control_period
        shorter = round(period / h) // 2
        while shorter and not self._quiet(contact, shorter * h):
            shorter //= 2
        cures = [f"a period of {shorter * h:.4g} s"] if shorter else []
        if contact is None and math.isfinite(self.layer):
            cures.append(f"an epsilon of {self._quiet_layer():.3g}")
        cure = f"{' or '.join(cures)} suffices" if cures else "these gains and estimates need a change"
        return f"at a control period of {period:g} s a small motion grows with {growth:.3g} 1/s; {cure}"

    def _quiet_layer(self) -> float:
        """Width of the boundary layer in which a law that chatters would not."""
        chatters, quiet = self.layer, 1e4 * self.layer
        for _ in range(_HALVINGS):
            middle = math.sqrt(chatters * quiet)
            if Loop(self.setup, None, self.about, (middle,)).growths[0] > SLOWEST:
                chatters = middle
            else:
                quiet = middle
        return quiet

    def _late(self) -> str:
        if self.age is None or not self.age.chain.command_latency:
            return "its measurements are too slow or too late for these gains and estimates"
        chain = self.age.chain
        late = f"its command acts {1e3 * chain.command_latency:.3g} ms late ({chain.command_parts()})"
        return f"{late}; it takes less of that, or smaller gains"

    def _old(self, age: ForceAge) -> str:
        """The cause of an old contact force, its cost, and the remedy."""
        chain, k_c = age.chain, age.contact.stiffness
        here = f"at {'an' if chain.longest == 'actuation' else 'a'} {chain.longest} period of "
        here += f"{chain.periods[chain.longest]:g} s"
        delay, longest = max(chain.delays.items(), key=lambda each: each[1])
        if longest > max(value for name, value in chain.ages.items() if name not in chain.delays):
            here = f"with the {delay} of {longest:.4g} s"
        lost = f"it holds the contact force so long that {min(1.0, age.share):.0%} of the damping D_d is lost at "
        lost += f"{age.contact.key}.stiffness {k_c:g} N/m"
        if not age.age:
            return f"{here}: {lost}"
        return (
            f"{here}: {lost}: {age.comparison()}. Its parts: {chain.parts()}. It takes less of the largest part, or a "
            f"wall, or a bumper before it, of less than {k_c * age.limit / age.age:.3g} N/m in all"
        )


def zeta_limit(setup: SetupLike) -> float:
    """Control period above which the explicit Euler steps of zeta, eq. (15), grow: |1 + A T| > 1 [s]."""
    fastest = max(abs(a) for a in setup.task.A)
    return 2.0 / fastest if fastest > 0.0 else np.inf


def zeta_grows(setup: SetupLike) -> str:
    """The reason why there is no rest if zeta grows at the control period; empty if it does not."""
    grows = setup.scenario.control_period > zeta_limit(setup)
    return "the sampled zeta, eq. (15), grows without bound at this control period" if grows else ""
