"""The MJCF elements and attributes that a vehicle's file may have.

A run uses the vehicle's body with its inertia, geoms, sites and motors, gravity, the coefficients in ``<custom>``, and
all purely visual elements. Timestep, integrator and cone may be given, as other programs need them; a run uses the
scenario's instead. Everything else is refused by name, because a list of bad settings would always be incomplete.

A tag has the same meaning wherever it is accepted, so the table needs no nesting. MuJoCo checks the nesting.
"""

import math
import re
from collections.abc import Callable, Mapping

LARGEST_NUMBER = 1e10
"""MuJoCo's mjMAXVAL: a larger number in a state means that the simulation has diverged."""
MOST_ELEMENTS = 10_000
"""Bound on a model's elements, counting each copy by <replicate>. MuJoCo's compile time grows with their square."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)

Rule = Callable[[str], str]
"""Returns the error in an attribute's value, or an empty text."""


def values_of(text: str) -> list[float]:
    """The numbers of an attribute; empty if one of its words is not a finite number."""
    words = text.split()
    values = [float(word) for word in words if _NUMBER.fullmatch(word)]
    return values if len(values) == len(words) and all(map(math.isfinite, values)) else []


def _rule(holds: Callable[[list[float]], bool], otherwise: str) -> Rule:
    """The rule that an attribute is a list of finite numbers for which something holds."""

    def rule(text: str) -> str:
        values = values_of(text)
        return "" if values and holds(values) else otherwise

    return rule


def finite(text: str) -> str:
    """The rule of every attribute of a purely visual element."""
    return "must be finite" if any(_NOT_FINITE.fullmatch(word) for word in text.split()) else ""


_numbers = _rule(lambda x: max(map(abs, x)) <= LARGEST_NUMBER, f"must be finite numbers within +-{LARGEST_NUMBER:g}")
_range = _rule(lambda x: len(x) == 2 and x[0] < x[1], "must be two numbers, the lower limit first")
_not_negative = _rule(
    lambda x: len(x) == 1 and 0.0 <= x[0] <= LARGEST_NUMBER, "must be one number that is not negative"
)


def _at_most(largest: int) -> Rule:
    return _rule(lambda x: 0 <= min(x) <= max(x) <= largest, f"must be within 0 and {largest}")


def _zero(reason: str) -> Rule:
    return _rule(lambda x: not any(x), f"must be 0: {reason}")


def _only(*choices: str, reason: str = "") -> Rule:
    said = reason or f"must be {' or '.join(map(repr, choices))}"
    return lambda text: "" if text in choices else said


def _rules(words: str = "", numbers: str = "", **others: Rule) -> dict[str, Rule]:
    return dict.fromkeys(words.split(), lambda text: "") | dict.fromkeys(numbers.split(), _numbers) | others


_OF_A_RUN = _only(reason="friction and stops of a joint have constants of the run; leave it out")
_PLACE = "pos quat axisangle euler xyaxes zaxis"
_TURNS_B = _only("false", "auto", reason="it would rotate the body frame of the coefficients; leave it out")
_INERTIA = "the file must give the true mass and inertia"
_WATER = "hydrodynamic forces come from the coefficients in <custom>"
_LIMITS = {"ctrlrange": _range, "forcerange": _range}
_MOTOR = _rules("name class group site joint ctrllimited forcelimited", "gear", **_LIMITS)

ELEMENTS: Mapping[str, Mapping[str, Rule] | None] = {
    "mujoco": _rules("model"),
    "include": _rules("file"),
    "compiler": _rules(
        "angle eulerseq autolimits meshdir texturedir assetdir strippath inertiagrouprange fitaabb "
        "fusestatic usethread",
        coordinate=_only("local"),
        alignfree=_TURNS_B,
        inertiafromgeom=_only("auto", "false", reason="it would override <inertial>; leave it out"),
        discardvisual=_only("false", reason="it would discard the hull, whose front touches the wall; leave it out"),
        balanceinertia=_only("false", reason="it would change the inertia; leave it out"),
        boundmass=_zero(_INERTIA),
        boundinertia=_zero(_INERTIA),
    ),
    "option": _rules(
        "integrator cone", "timestep gravity", density=_zero(_WATER), viscosity=_zero(_WATER), wind=_zero(_WATER)
    ),
    "statistic": _rules(numbers="center extent meansize meanmass"),
    **dict.fromkeys(("visual", "global", "quality", "headlight", "map", "scale", "rgba")),
    **dict.fromkeys(("material", "layer", "light", "camera")),
    "default": _rules("class"),
    "custom": _rules(),
    "numeric": _rules("name size", "data"),
    "text": _rules("name data"),
    "asset": _rules(),
    "texture": _rules(
        "name class type colorspace content_type file gridlayout builtin mark hflip vflip "
        "fileright fileleft fileup filedown filefront fileback",
        "rgb1 rgb2 markrgb random",
        width=_at_most(4096),
        height=_at_most(4096),
        gridsize=_at_most(64),
        nchannel=_at_most(4),
    ),
    "mesh": _rules(
        "name class content_type file inertia smoothnormal builtin material",
        "scale refpos refquat vertex normal texcoord face",
        params=_at_most(200),
        maxhullvert=_only("-1"),
    ),
    "model": _rules("name file"),
    "worldbody": _rules(),
    "body": _rules(
        "name childclass simple",
        _PLACE,
        gravcomp=_zero("buoyancy is displaced_mass times gravity"),
        mocap=_only("false", reason="the vehicle must move on its free joint; leave it out"),
    ),
    "frame": _rules("name childclass", _PLACE),
    "replicate": _rules("sep", "offset euler", count=_at_most(MOST_ELEMENTS)),
    "attach": _rules("model body frame prefix"),
    "inertial": _rules(numbers=f"{_PLACE} mass diaginertia fullinertia"),
    "freejoint": _rules("name group", align=_TURNS_B),
    "joint": _rules(
        "name class group limited",
        "pos axis",
        type=_only("free", "hinge", "slide", reason="must be 'hinge' or 'slide'; chain three hinges for a ball"),
        damping=_not_negative,
        armature=_not_negative,
        frictionloss=_not_negative,
        **dict.fromkeys(("solreffriction", "solimpfriction", "solreflimit", "solimplimit", "margin"), _OF_A_RUN),
        range=_range,
        ref=_zero("the coefficients hold for the pose of the file"),
        stiffness=_zero("springs are not computed; a gear's friction is damping and frictionloss"),
    ),
    "geom": _rules(
        "name class contype conaffinity group mesh material shellinertia",
        f"{_PLACE} size fromto rgba mass density fitscale",
        type=_only("plane", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"),
    ),
    "site": _rules("name class type group material mesh", f"{_PLACE} size fromto rgba"),
    "actuator": _rules(),
    "motor": _MOTOR,
    "general": _MOTOR | _rules("", "gainprm", gaintype=_only("fixed"), biastype=_only("none"), dyntype=_only("none")),
}
"""Rules for the attributes of each element; None allows every attribute of a purely visual element."""

_WALL = "the vehicle may touch only the scenario's wall; leave it out"
_HOLDS = "it would constrain the vehicle; leave it out"
_RIGID = "a vehicle is a rigid body and its links; leave it out"
_PLAIN = (
    "a motor acts on a site or a joint of the vehicle, and its force is gain times ctrl without delay; leave it out"
)
_THRUSTER = (
    "a thruster must be a <motor> on a site, and a joint's motor a <motor> on a joint; the scenario's [joints] drives "
    "it to a position or at a velocity"
)

REASONS: Mapping[str, str] = {
    "compiler": "it would change the vehicle that the file describes; leave it out",
    **dict.fromkeys(("option", "statistic"), "a run has its own solver settings; leave it out"),
    "body": "a vehicle is one free body and its links; leave it out",
    "joint": "of a joint, only range, damping, armature and frictionloss are computed; leave it out",
    **dict.fromkeys(("geom", "contact", "hfield", "pair", "exclude"), _WALL),
    **dict.fromkeys(("motor", "general"), _PLAIN),
    "flag": "a run has its own flags; leave it out",
    "size": "MuJoCo computes the sizes; leave it out",
    "lengthrange": "a vehicle has no muscles; leave it out",
    **dict.fromkeys(("equality", "tendon"), _HOLDS),
    **dict.fromkeys(("composite", "flexcomp", "deformable", "skin"), _RIGID),
    **dict.fromkeys(("extension", "plugin"), "a plugin could change the dynamics; leave it out"),
    **dict.fromkeys(("position", "velocity", "intvelocity", "orientation", "pid", "damper"), _THRUSTER),
    **dict.fromkeys(("cylinder", "muscle", "adhesion", "dcmotor"), _THRUSTER),
    "sensor": "a run neither reads nor records the file's sensors; leave it out",
    "keyframe": "a run starts from the scenario's [initial]; leave it out",
    "tuple": "write coefficients as <numeric> and remarks as <text>; leave it out",
}
"""By tag: the reason why an element, or its other attributes, are refused, and a remedy."""
