"""Checks of the names of a model's ``<numeric>`` entries: misspelt ones, and those of no link or joint."""

import difflib

import mujoco
import numpy as np

from ..errors import Fault, suggestion
from .coefficients import JOINT_NUMERICS, KNOWN_NUMERICS, LINK_NUMERICS

_CLOSE = 0.8
"""Least similarity at which a name counts as misspelt."""


def wrong_numerics(model: mujoco.MjModel, base: int, prefix: str, alone: bool = False) -> list[Fault]:
    """Errors for numerics with this prefix that are named almost like a coefficient of the vehicle on the body
    ``base``. Other numerics are allowed in a model, unless it consists of one vehicle ``alone``."""
    links, joints = _owners(model, base, prefix)
    faults = []
    for name in (model.numeric(i).name for i in range(model.nnumeric)):
        word = name.removeprefix(prefix)
        owner, dot, entry = word.rpartition(".")
        if not name.startswith(prefix) or ("/" in word and owner not in links | joints):  # of another attached model
            message: str | None = _IGNORED
        elif dot:
            message = _of_a_link(owner, entry, links, joints, model, prefix)
        else:
            message = None if word in KNOWN_NUMERICS else _misspelt(word, KNOWN_NUMERICS) or _IGNORED
        if message and (alone or message != _IGNORED):
            faults.append(Fault(name, message))
    return faults


_IGNORED = "is not a coefficient and would be ignored; leave it out, or write a remark as <text>"


def _owners(model: mujoco.MjModel, base: int, prefix: str) -> tuple[set[str], set[str]]:
    """Names of the links and of their joints, without the prefix. A joint without a name has that of its link."""
    links, joints = set[str](), set[str]()
    for body in np.flatnonzero((model.body_rootid == base) & (model.body_dofnum > 0)):
        if body != base:
            name = model.body(body).name
            links.add(name.removeprefix(prefix))
            first = model.body_jntadr[body]
            names = [model.joint(i).name or name for i in range(first, first + model.body_jntnum[body])]
            joints |= {each.removeprefix(prefix) for each in names}
    return links, joints


def _of_a_link(
    owner: str, word: str, links: set[str], joints: set[str], model: mujoco.MjModel, prefix: str
) -> str | None:
    """The error in a numeric ``owner.word``, or None."""
    owners = joints if word in JOINT_NUMERICS else links
    kind = "joint" if word in JOINT_NUMERICS else "link"
    if word in JOINT_NUMERICS or word in LINK_NUMERICS:
        if owner in owners:
            return None
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, prefix + owner)
        if kind == "link" and body > 0:
            carrier = model.body(model.body_weldid[body]).name.removeprefix(prefix)
            if carrier == owner:
                return f"body {owner!r} is the base: its coefficients have no name in front"
            return f"body {owner!r} has no joint: its water is part of that of {carrier!r}, which carries it"
        choices = suggestion(owner, owners) if owners else "the vehicle has none"
        return f"{owner!r} is not a {kind} of the vehicle; {choices}"
    if owner in links | joints:
        return _misspelt(word, LINK_NUMERICS | JOINT_NUMERICS) or _IGNORED
    return _IGNORED


def _misspelt(word: str, known: frozenset[str]) -> str | None:
    """The sentence for a word that is almost one of those that are known."""
    lower = {each.lower(): each for each in sorted(known)}
    close = difflib.get_close_matches(word.lower(), lower, n=1, cutoff=_CLOSE)
    return f"is not a coefficient; did you mean {lower[close[0]]!r}?" if close else None
