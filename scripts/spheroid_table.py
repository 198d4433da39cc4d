"""The added mass of a spheroid near a wall: the numbers of src/uvms_mj/plant/spheroid.csv.

Ideal flow about a spheroid of the radius 1 and the half length L along e, at the gap g from the plane z = 0, and about
its mirror image: point sources on confocal spheroids inside, each with its image, whose strengths make the water's
velocity normal to the surface equal to the body's, by least squares at four times as many places. The places are dense
where the gap is small. Of a sphere the result equals the sum of all multipoles to 2e-7. Takes some ten minutes.

    python scripts/spheroid_table.py
"""

import functools
import math
from multiprocessing import Pool
from pathlib import Path

import numpy as np

from uvms_mj.physics.near_wall import sphere_mass

FILE = Path(__file__).parents[1] / "src/uvms_mj/plant/spheroid.csv"
LONGEST, NEAREST, FARTHEST = 2.5, 0.02, 8.0
SLENDERNESSES = LONGEST ** (0.5 * (1.0 - np.cos(np.pi * np.arange(5) / 4.0)))
TILTS = 0.5 * (1.0 + np.cos(np.pi * (np.arange(6) + 0.5) / 6.0))
GAPS = NEAREST * (FARTHEST / NEAREST) ** (0.5 * (1.0 + np.cos(np.pi * (np.arange(10) + 0.5) / 10.0)))
FAR = 1e3
RINGS, AROUND = 24, 16
MIRROR, BESIDE = np.array([1.0, 1.0, -1.0]), np.array([1.0, -1.0, 1.0])


def frame(s: float) -> np.ndarray:
    """Rows (3, 3) across, beside and along the axis e = s z + sqrt(1 - s^2) x."""
    c = math.sqrt(1.0 - s * s)
    return np.array([[-s, 0.0, c], [0.0, 1.0, 0.0], [c, 0.0, s]])


def places(length: float, s: float, gap: float, rings: int, around: int) -> tuple[np.ndarray, ...]:
    """Points (n, 3) of the half y > 0 of the surface about its centre, normals (n, 3), areas (n,), and the distance of
    the rings there (n,)."""
    axes, half = frame(s), np.array([1.0, 1.0, length])
    stretch = axes.T @ np.diag(half) @ axes
    down = -stretch[2] / np.linalg.norm(stretch[2])  # of the unit sphere, where the wall is nearest
    side, spread = np.cross([0.0, 1.0, 0.0], down), 1.4 * math.sqrt(2.0 * gap)
    x, w = np.polynomial.legendre.leggauss(rings)
    last = math.asinh(math.pi / spread)
    tau, w = 0.5 * last * (x + 1.0), 0.5 * last * w
    chi, psi = spread * np.sinh(tau), math.pi * (np.arange(around) + 0.5) / around
    X, P = (each.ravel() for each in np.meshgrid(chi, psi, indexing="ij"))
    apart = np.repeat(spread * np.cosh(tau), around)
    across = np.cos(P)[:, None] * side + np.sin(P)[:, None] * np.array([0.0, 1.0, 0.0])
    unit = np.cos(X)[:, None] * down + np.sin(X)[:, None] * across
    normal = unit @ np.linalg.inv(stretch)
    size = np.linalg.norm(normal, axis=1)
    area = np.sin(X) * np.repeat(w, around) * apart * math.pi / around * length * size
    return unit @ stretch, normal / size[:, None], area, apart


def masses(length: float, s: float, gap: float) -> np.ndarray:
    """The added mass (3, 3) over the displaced one, along x and y of the wall and along its normal z."""
    centre = np.array([0.0, 0.0, gap + math.sqrt(1.0 + (length**2 - 1.0) * s * s)])
    axes = frame(s)
    surface, n, area, _ = places(length, s, gap, 2 * RINGS, 2 * AROUND)
    points, normals, _, apart = places(length, s, gap, RINGS, AROUND)
    depth = np.minimum(0.95, 1.6 * (points * normals).sum(1) * apart)  # of a source's confocal spheroid
    half = np.array([np.sqrt(1.0 - depth), np.sqrt(1.0 - depth), np.sqrt(length**2 - depth) / length]).T
    sources, surface, root = (points @ axes.T * half) @ axes + centre, surface + centre, np.sqrt(area)[:, None]
    found = np.zeros((3, 3))
    for parity, directions in ((1.0, [0, 2]), (-1.0, [1])):
        potential, normal_velocity = 0.0, 0.0
        for sign, flip in ((1.0, np.ones(3)), (parity, BESIDE)):
            for image in (np.ones(3), MIRROR):
                d = surface[:, None] - (sources * flip * image)[None]
                r = np.sqrt((d * d).sum(axis=2))
                potential = potential + sign / r
                normal_velocity = normal_velocity - sign * np.einsum("ijk,ik->ij", d, n) / r**3
        scale = np.linalg.norm(normal_velocity * root, axis=0)
        strengths = np.linalg.lstsq(normal_velocity * root / scale, n[:, directions] * root, rcond=1e-14)[0]
        phi = potential @ (strengths / scale[:, None])
        M = -2.0 * (phi * area[:, None]).T @ n[:, directions] / (4.0 / 3.0 * math.pi * length)
        found[np.ix_(directions, directions)] = 0.5 * (M + M.T)
    return found


def coefficients(M: np.ndarray, s: float) -> list[float]:
    """A, B, C and D/s of A I + B n n^T + C e e^T + D (n e^T + e n^T)."""
    c = math.sqrt(1.0 - s * s)
    C = (M[0, 0] - M[1, 1]) / c**2
    D = (M[0, 2] - C * s * c) / c
    return [M[1, 1], M[2, 2] - M[1, 1] - C * s * s - 2.0 * D * s, C, D / s]


def rows(length: float, tilt: float) -> list[str]:
    """The rows of a slenderness and a w = (reach - 1)/(length - 1), where reach is the height of the centre at the
    touch."""
    s, found = math.sqrt(tilt * (2.0 + (length - 1.0) * tilt) / (length + 1.0)), []
    far = masses(length, s, FAR) if length > 1.0 else 0.0
    for gap in GAPS:
        if length > 1.0:
            values = coefficients(masses(length, s, gap) - far, s)
        else:
            normal, along, _, _ = sphere_mass(gap)
            values = [along, normal - along, 0.0, 0.0]
        numbers = [length, tilt, math.log(gap), *((1.0 + gap) ** 3 * x for x in values)]
        found.append(",".join(f"{x:.10g}" if k < 3 else f"{x:.7f}" for k, x in enumerate(numbers)))
    return found


def main() -> None:
    cases = [(float(length), float(tilt)) for length in SLENDERNESSES for tilt in TILTS]
    with Pool() as pool:
        found = pool.starmap(rows, cases)
    lines = [
        "# made by scripts/spheroid_table.py",
        "slenderness,w,ln(g/a),A,B,C,D/s",
        *functools.reduce(list.__add__, found),
    ]
    FILE.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
