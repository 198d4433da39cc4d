"""Hydrodynamic coefficients in a vehicle's MJCF: names, their checks, and the 6x6 matrices built from them.

They are ``<custom><numeric>`` entries. Each matrix is given either as a whole or by its SNAME derivatives:

===============  ======================  ===========================================================================
matrix           derivatives             meaning
===============  ======================  ===========================================================================
``M_A``          ``X_udot``..``N_rdot``  added mass, symmetric, positive semi-definite [kg, kg m, kg m^2]
``D_linear``     ``X_u`` .. ``N_r``      linear damping [N s/m, N s, N m s]
``D_quadratic``  ``X_uu`` .. ``N_rr``    quadratic damping: the entry [i, j] multiplies abs(nu_j) nu_j; ``Y_rr`` is the
                                         coefficient of abs(r) r in Y [N s^2/m^2, N s^2/m, N s^2, N m s^2]
===============  ======================  ===========================================================================

A whole matrix has 36 numbers, row by row, with the sign of M_A or D: its diagonal is positive. Derivatives have the
signs of the literature: D_linear[0, 0] is -X_u. The six diagonal derivatives are required. A missing cross term such as
``N_v`` or ``Y_rr`` is zero. Added mass is symmetric, so ``Y_rdot`` alone also sets ``N_vdot``.
"""

import difflib

import mujoco
import numpy as np

from ..errors import Fault, suggestion


def _derivatives(suffix: str) -> np.ndarray:
    """(6, 6) names, such as Y_r at [1, 5]; ``suffix`` is a format for the velocity."""
    return np.array([[f"{wrench}_{suffix.format(v)}" for v in "uvwpqr"] for wrench in "XYZKMN"])


DERIVATIVES = {"M_A": _derivatives("{0}dot"), "D_linear": _derivatives("{0}"), "D_quadratic": _derivatives("{0}{0}")}
"""(6, 6) names of the derivatives of each matrix."""

KNOWN_NUMERICS = frozenset(
    ["displaced_mass", "center_of_buoyancy", *DERIVATIVES, *np.concatenate([*DERIVATIVES.values()]).ravel().tolist()]
)
"""Names of all ``<numeric>`` entries that are read from a vehicle's file."""

LINK_NUMERICS = KNOWN_NUMERICS | {"strip_theory"}
"""Names of the numerics behind the name of a link and a dot."""

JOINT_NUMERICS = frozenset(["speed_limit"])
"""Names of the numerics behind the name of a joint and a dot."""

_CLOSE = 0.8
"""Least similarity at which a name counts as misspelt."""
_IGNORED = "is not a coefficient and would be ignored; leave it out, or write a remark as <text>"
LARGEST = 1e15
"""Bound on every number, in SI units; products of larger numbers could overflow."""
_ROUNDING = 1e-9
"""Relative tolerance, as numbers in a file may be rounded."""


def has_numeric(model: mujoco.MjModel, name: str) -> bool:
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name) >= 0


def numeric(
    model: mujoco.MjModel, name: str, size: int, faults: list[Fault], default: np.ndarray | None = None
) -> np.ndarray:
    """The (size,) numbers of a ``<numeric>``, or the default.

    A missing numeric without a default, a wrong size and a number out of bounds are errors, appended to ``faults``. The
    numbers are then the default or zero.
    """
    instead = np.zeros(size) if default is None else default
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
    if index < 0:
        if default is None:
            faults.append(Fault(name, "no such <numeric> in the model"))
        return instead
    start, n = model.numeric_adr[index], model.numeric_size[index]
    values = np.array(model.numeric_data[start : start + n])
    if n != size:
        faults.append(Fault(name, f"has {n} values; {size} are needed"))
        return instead
    wrong = values[~(np.abs(values) <= LARGEST)]
    if wrong.size:
        faults.append(Fault(name, f"{wrong[0]:g}: must be finite and at most {LARGEST:g}"))
        return instead
    return values


def added_mass(model: mujoco.MjModel, prefix: str, faults: list[Fault]) -> np.ndarray:
    """M_A (6, 6) [kg, kg m, kg m^2], symmetric and positive semi-definite unless an error is appended to ``faults``."""
    before = len(faults)
    M_A, names, sign = _matrix(model, prefix, "M_A", faults)
    faults += [
        Fault(names[i, i], f"{sign * M_A[i, i]:g}: must not be {_wrong(sign)}, as added mass is positive")
        for i in np.flatnonzero(np.diag(M_A) < 0.0)
    ]
    if sign < 0.0:
        given = np.vectorize(lambda name: has_numeric(model, name))(names)
        M_A = np.where(given, M_A, M_A.T)
    largest = np.abs(M_A).max()
    faults += [
        Fault(names[i, j], f"{sign * M_A[i, j]:g}, but {names[j, i]} has {sign * M_A[j, i]:g}: added mass is symmetric")
        for i, j in zip(*np.triu_indices(6, 1), strict=True)
        if abs(M_A[i, j] - M_A[j, i]) > _ROUNDING * largest
    ]
    M_A = (M_A + M_A.T) / 2.0
    if len(faults) == before and (least := np.linalg.eigvalsh(M_A)[0]) < -_ROUNDING * largest:
        faults.append(Fault(f"{prefix}M_A", f"is not positive semi-definite: its least eigenvalue is {least:g}"))
    return M_A


def damping_matrix(model: mujoco.MjModel, prefix: str, name: str, faults: list[Fault]) -> np.ndarray:
    """D_linear or D_quadratic (6, 6), by its name. No diagonal entry is negative unless an error is appended to
    ``faults``."""
    D, names, sign = _matrix(model, prefix, name, faults)
    faults += [
        Fault(names[i, i], f"{sign * D[i, i]:g} is not dissipative: must not be {_wrong(sign)}")
        for i in np.flatnonzero(np.diag(D) < 0.0)
    ]
    return D


def _wrong(sign: float) -> str:
    return "negative" if sign > 0.0 else "positive"


def _matrix(
    model: mujoco.MjModel, prefix: str, whole: str, faults: list[Fault]
) -> tuple[np.ndarray, np.ndarray, float]:
    """A matrix (6, 6) from its 36 numbers or its derivatives, the names (6, 6) of its entries in the file, and the sign
    with which the file gives them."""
    names = np.char.add(prefix, DERIVATIVES[whole])
    if has_numeric(model, prefix + whole):
        beside = [name for name in names.flat if has_numeric(model, name)]
        if beside:
            reason = f"is given together with {', '.join(beside)}: give the matrix or its derivatives, not both"
            faults.append(Fault(prefix + whole, reason))
        values = numeric(model, prefix + whole, 36, faults, np.zeros(36))
        places = [[f"{prefix}{whole}, row {i}, column {j}" for j in range(1, 7)] for i in range(1, 7)]
        return values.reshape(6, 6), np.array(places), 1.0
    zero = np.zeros(1)
    matrix = np.array(
        [[numeric(model, names[i, j], 1, faults, None if i == j else zero)[0] for j in range(6)] for i in range(6)]
    )
    return 0.0 - matrix, names, -1.0


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
