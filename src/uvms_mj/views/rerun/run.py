"""A run as Rerun entities: its appearance, its samples as columns, and the ranges of its signals.

The entities below the root of a run are ``world/...``, the contents of the 3-D view in W; ``signals/<name>``, every
recorded signal with all its components, or ``signals/<name>/<component>`` for plotted signals; and ``push``, the force
on the wall, with ``push/analytic``. Each link of an arm is below its parent: Rerun composes the transforms along a
path, so that a link has its pose in its parent's frame. Scalars keep full precision. Poses are float32, because Rerun
stores them so.

The bands of signals that may alternate, ``tau_low`` and ``tau_high``, are thin lines beside them. Where not every row
is sent, a band has the extremes of the rows between.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from ...control.base import SteadyState
from ...physics.frames import quat_from_euler_deg
from ...plant.geometry import Geometry, Shape, Solid, solids
from ...records.header import Header
from ...records.scene import (
    BLUE,
    FORCE_SCALE,
    FORCES,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    WALL_SIZE,
    YELLOW,
    Colour,
    Force,
    magnitudes,
    scene_of,
    span,
    walls_of_scene,
)
from ...records.trace import Trace
from ...stages.signals import BAND, BANDED, PUSH, Signal, band_signals
from ..colours import legible, mixed

MOST_STEPS = 5
"""Most readable numbers on an axis. Rerun puts numbers at multiples of a power of ten only."""
_LARGEST = 1e12
"""Largest magnitude on an axis."""
_EDGE = 0.07
"""Least distance of a number from the end of its axis, as a fraction of the axis."""
_RESTS = 0.1
"""Final fraction of a run in which the largest force counts as the force at rest."""


@dataclass(frozen=True)
class Extents:
    """Extents of one run: ranges (size, 2) of each signal's components by its name, the largest push in the last tenth
    of the run [N], the largest push [N], and the largest of all forces that are drawn as arrows [N]."""

    ranges: Mapping[str, np.ndarray]
    rest: float
    peak: float
    force: float

    @classmethod
    def of(cls, trace: Trace) -> "Extents":
        ranges = {}
        for signal in trace.signals:
            values = _drawable(trace[signal.name].reshape(len(trace), signal.size))
            values = values if len(values) else np.zeros((1, signal.size))
            ranges[signal.name] = np.stack([values.min(axis=0), values.max(axis=0)], axis=1)
        push = _drawable(trace.band("push")[1])
        late = push[trace.t >= (1.0 - _RESTS) * trace.t[-1]] if len(trace) else push
        forces = [_drawable(f) for f in (trace.f_contact_W, trace.tau[:, :3])]
        force = max(float(np.linalg.norm(f, axis=1).max(initial=0.0)) for f in forces)
        return cls(ranges, float(late.max(initial=0.0)), float(push.max(initial=0.0)), force)


def _drawable(values: np.ndarray) -> np.ndarray:
    """Values, with 0 for values that are not finite or too large to draw, as at the end of a run that diverged."""
    return np.where(np.abs(values) < _LARGEST, values, 0.0)


def readable(limits: Iterable[tuple[float, float]]) -> tuple[float, float]:
    """Range of an axis that contains all given ranges.

    The range also contains at least two multiples of a power of ten, where Rerun puts numbers, but no more of them than
    are readable.
    """
    lows, highs = zip(*limits, strict=True)
    low, high = float(min(lows)), float(max(highs))
    margin = 0.05 * (high - low) or 0.5 * abs(high) or 0.5
    low, high = low - margin, high + margin
    step = 10.0 ** math.ceil(math.log10((high - low) / MOST_STEPS))
    edge = _EDGE * (high - low)  # Rerun shows no number at the edge
    while (first := math.ceil((low + edge) / step)) + 1 > (last := math.floor((high - edge) / step)):
        if (last + 1) * step - high <= low - (first - 1) * step:
            high = (last + 1) * step + 2.0 * edge
        else:
            low = (first - 1) * step - 2.0 * edge
    return low, high


TRIAD_M = 0.12
"""Length of the axes of a triad [m]."""
_AXES = (VERMILLION, GREEN, BLUE)


def paths(geometry: Geometry) -> list[tuple[str, ...]]:
    """Parts of each link's path below the vehicle."""
    found: list[tuple[str, ...]] = []
    for link in geometry.links:
        found.append((*(found[link.parent] if link.parent >= 0 else ()), link.name))
    return found


def link_solids(geometry: Geometry) -> Iterator[tuple[tuple[str, ...], Solid]]:
    """The solids of the links in their frames, with the parts of their paths."""
    for path, link in zip(paths(geometry), geometry.links, strict=True):
        for i, solid in enumerate(solids(Geometry(link.shapes, geometry.meshes))):
            yield (*path, f"part {i + 1}"), solid


def poses(header: Header, values: Mapping[str, np.ndarray]) -> Iterator[tuple[tuple[str, ...], np.ndarray, np.ndarray]]:
    """Path below ``world``, positions (n, 3) and attitudes (n, 4) of the links and of the tool, if recorded."""
    if "q" in values:
        for i, (path, link) in enumerate(zip(paths(header.geometry), header.geometry.links, strict=True)):
            yield ("vehicle", *path), *link.pose(values["q"][:, i])
    if "p_WT" in values:
        yield ("tool",), values["p_WT"], values["quat_WT"]


def triad(share: float = 0.0) -> rr.Arrows3D:
    """The axes of a frame in its own entity: x, y and z in the colours of their components, mixed with white."""
    colours: list[Colour] = [mixed(colour, share) for colour in _AXES]
    return rr.Arrows3D(
        origins=np.zeros((3, 3)), vectors=TRIAD_M * np.eye(3), colors=colours, radii=[0.05 * TRIAD_M] * 3
    )


TIMELINE = "sim_time"
"""Simulated time [s]."""
POSE_HZ = 50.0
"""Most poses and arrows per simulated second [Hz]."""
TRAJECTORY_PIECES = 1000
"""Approximate number of straight pieces of a trajectory, for a run of any length."""
_ABOVE = 0.125
"""Height of a run's name above its vehicle [m]."""

LIGHT, GREY = (235, 235, 235), (160, 160, 160)
COMPONENTS = (ORANGE, SKY, GREEN, YELLOW, BLUE, PURPLE)
"""Colours of x, y, z, roll, pitch and yaw of any signal."""
CONTACT, REFERENCE = VERMILLION, GREY
_THIN = 0.6
"""Width of the lines of a band; Rerun's own lines are twice as wide [ui points]."""


@dataclass(frozen=True)
class Place:
    """Lane of a run among others: its offset y to the left of W's origin [m], its width [m], and the length of the
    force arrows [m/N]."""

    y: float = 0.0
    width: float = WALL_SIZE
    force_scale: float = FORCE_SCALE


@dataclass(eq=False)
class Run:
    """Writes one run to a Rerun stream.

    Among several runs, one has a label, the prefix of its paths and names, and a colour.

    Attributes:
        row_steps: rows between two samples that are sent.
        extents: ranges of the signals of a finished run; None while the run is in progress.
        signals: the recorded signals by name, and the bands that the rows between two samples need.
        plotted: signals that the layout plots.
        origin: signal that the reference p_d is for, p_WB or p_WT; the trajectory is its way.
    """

    header: Header
    label: str = ""
    colour: Colour | None = None
    row_steps: int = 1
    place: Place = Place()
    extents: Extents | None = None

    def __post_init__(self) -> None:
        row_s = self.header.row_steps * self.header.scenario.simulation.timestep
        duration = self.header.scenario.steps * self.header.scenario.simulation.timestep
        self.pose_steps = max(1, round(1.0 / (POSE_HZ * row_s)))
        self.piece_steps = self.pose_steps * max(1, round(duration / TRAJECTORY_PIECES / (self.pose_steps * row_s)))
        joints = ("q", "q_dot", "tau_q", "p_WT") if self.header.geometry.links else ()
        known = self.header.by_name | {PUSH.name: PUSH}
        self._bands = {
            name: band_signals(known[name])
            for name in BANDED
            if name in known and (self.row_steps > 1 or BAND[name][0] in known)
        }
        edges = {edge.name: edge for pair in self._bands.values() for edge in pair}
        self.signals = self.header.by_name | {name: edge for name, edge in edges.items() if name not in known}
        shown = ("p_WB", "p_d", "tau", "s", *joints, *self.header.law.states)
        self.plotted = (*shown, *(edge for name in shown for edge in self.band(name)))
        self.origin = self.header.task_frame[0]
        self._rows = 0
        self._unsent: dict[str, np.ndarray] = {}  # bands of the rows since the last one that was sent
        self._last_p: np.ndarray | None = None

    def path(self, *parts: str) -> str:
        return rr.new_entity_path([self.label, *parts] if self.label else list(parts))

    def line(self, name: str, component: int) -> str:
        """Path of one component of a plotted signal."""
        signal = self.signals[name]
        part = [self.header.components(signal)[component]] if signal.size > 1 else []
        return self.path("signals", name, *part)

    def band(self, name: str) -> tuple[str, ...]:
        """Names of the band of a signal or of the push; none without a band."""
        return tuple(edge.name for edge in self._bands.get(name, ()))

    def named(self, what: str) -> str:
        return f"{self.label}: {what}" if self.label else what

    def columns(self) -> Iterator[tuple[tuple[str, ...], Signal, slice]]:
        """Entities of all signals: parts of the path, the signal, and the components stored there."""
        for signal in self.signals.values():
            if signal.name in self.plotted and signal.size > 1:
                for i, component in enumerate(self.header.components(signal)):
                    yield ("signals", signal.name, component), signal, slice(i, i + 1)
            elif signal.name != "t":
                yield ("signals", signal.name), signal, slice(None)

    def begin(self, stream: rr.RecordingStream) -> None:
        """Set the stream, and send the static entities."""
        self.stream = stream
        self._things()
        self._series()

    def write(self, values: Mapping[str, np.ndarray]) -> None:
        """Send the next rows: t (n,) and each signal (n, size)."""
        t, first = values["t"].reshape(-1), self._rows
        self._rows += len(t)

        def every(steps: int) -> slice:
            return slice(-first % steps, None, steps)

        rows = every(self.row_steps)
        forces = values["f_normal"] if "f_normal" in values else 0.0 - values["f_contact_W"][:, :1]
        pushes = np.maximum(0.0, forces)
        bands = self._widened({**values, PUSH.name: pushes}, range(len(t))[rows])
        if len(t[rows]):
            for parts, signal, place in self.columns():
                sent = bands[signal.name] if signal.name in bands else values[signal.name][rows]
                self._scalars(parts, t[rows], sent[:, place])
            self._scalars(("push",), t[rows], pushes[rows])
            if isinstance(self.header.analytic, SteadyState):
                ends = t[rows][[0, -1]]
                self._scalars(("push", "analytic"), ends, np.full((2, 1), self.header.analytic.force))
        self._poses({name: value[every(self.pose_steps)] for name, value in values.items()})
        self._trajectory(t[every(self.piece_steps)], values[self.origin][every(self.piece_steps)])

    def _widened(self, values: Mapping[str, np.ndarray], sent: range) -> dict[str, np.ndarray]:
        """The bands (n, size) of the rows that are sent, each with the rows since the one sent before."""
        found = {}
        for name in self._bands:
            for edge, extreme in zip(self.band(name), (np.minimum, np.maximum), strict=True):
                block = values.get(edge, values[name])
                before = self._unsent.get(edge, block[:0])
                block = np.concatenate([before, block])
                starts = np.concatenate([[0], len(before) + np.array(sent, dtype=int) + 1])
                found[edge] = extreme.reduceat(block[: starts[-1]], starts[:-1]) if len(sent) else block[:0]
                self._unsent[edge] = block[starts[-1] :]
        return found

    def _send(self, parts: tuple[str, ...], t: np.ndarray, columns: Iterable[rr.ComponentColumn]) -> None:
        ns = np.rint(t * 1e9).astype("timedelta64[ns]")
        rr.send_columns(
            self.path(*parts), [rr.TimeColumn(TIMELINE, duration=ns)], columns, recording=self.stream, strict=True
        )

    def _log(self, parts: tuple[str, ...], what: rr.AsComponents) -> None:
        rr.log(self.path(*parts), what, static=True, recording=self.stream, strict=True)

    def _scalars(self, parts: tuple[str, ...], t: np.ndarray, values: np.ndarray) -> None:
        n, size = values.shape
        flat = np.ascontiguousarray(values).reshape(-1)
        self._send(parts, t, rr.Scalars.columns(scalars=flat).partition(np.full(n, size)))

    def _poses(self, values: Mapping[str, np.ndarray]) -> None:
        t = values["t"].reshape(-1)
        if not len(t):
            return
        quat_d = values.get("quat_d")
        if quat_d is None:
            quat_d = np.tile(quat_from_euler_deg(*self.header.scenario.reference.attitude_deg), (len(t), 1))
        vehicle, reference = (values["p_WB"], values["quat_WB"]), (values["p_d"], quat_d)
        moving = [(("vehicle",), *vehicle), (("reference",), *reference), *poses(self.header, values)]
        moving += [(("wall", f"moving {wall.k}"), *wall.poses(values)) for wall in walls_of_scene(self.header)[1]]
        for parts, p, quat in moving:
            turned = rr.Transform3D.columns(translation=p, quaternion=quat[:, [1, 2, 3, 0]])
            self._send(("world", *parts), t, turned)
        for force in FORCES:
            self._force(force, t, values)
        if "tether_nodes" in values:
            strips = list(values["tether_nodes"].reshape(len(t), -1, 3))
            self._send(("world", "tether"), t, rr.LineStrips3D.columns(strips=strips))

    def _force(self, force: Force, t: np.ndarray, values: Mapping[str, np.ndarray]) -> None:
        """Send the arrows of a force with its magnitude, for samples with a non-zero force."""
        newtons = magnitudes(force.acts(self.header, values)[1])
        starts, tips = force.ends(self.header, values, self.place.force_scale)
        some = newtons > 0.0
        drawn = rr.Arrows3D.columns(origins=starts[some], vectors=(tips - starts)[some])
        self._send(("world", force.name), t, drawn.partition(some.astype(int)))
        if not self.label:
            fits = span(self.header) / self.place.force_scale
            labels = [f"{force.name} {n:.2f} N{' (arrow cut)' if n > fits else ''}" for n in newtons[some]]
            text = rr.Points3D.columns(positions=tips[some] + [0.0, 0.0, force.text_above], labels=labels)
            self._send(("world", force.name, "text"), t, text.partition(some.astype(int)))

    def _trajectory(self, t: np.ndarray, p: np.ndarray) -> None:
        """Send the trajectory as straight pieces. The layout shows all pieces up to the time cursor."""
        if not len(t):
            return
        way = np.concatenate([p[:1] if self._last_p is None else self._last_p[None], p])
        self._last_p = p[-1].copy()
        pieces = np.stack([way[:-1], way[1:]], axis=1)
        self._send(("world", "trajectory"), t, rr.LineStrips3D.columns(strips=list(pieces)))

    def _things(self) -> None:
        scene = scene_of(self.header)
        self._log(("world",), rr.Transform3D(translation=[0.0, self.place.y, 0.0]))
        shapes = [solid for vehicle in scene.vehicles for solid in solids(vehicle)]
        for i, solid in enumerate(shapes):
            self._log(("world", "vehicle", f"part {i + 1}"), mesh_of(solid, self._tinted(solid.rgba)))
        for vehicle in scene.vehicles:
            for parts, solid in link_solids(vehicle):
                self._log(("world", "vehicle", *parts), mesh_of(solid, self._tinted(solid.rgba)))
        plates = [wall for wall in scene.walls if wall.kind == "box"]
        if plates:
            self._log(("world", "wall"), self._plates(plates))
        for i, wall in enumerate(wall for wall in scene.walls if wall.kind != "box"):
            (solid,) = solids(Geometry((wall,), {}))
            self._log(("world", "wall", f"round {i + 1}"), mesh_of(solid, rgba8(wall.rgba)))
        for moved in scene.moving:
            (solid,) = solids(Geometry((moved.shape,), {}))
            self._log(("world", "wall", f"moving {moved.k}"), mesh_of(solid, rgba8(moved.shape.rgba)))
        for force in FORCES:
            colour = self.colour or force.colour
            self._log(("world", force.name), rr.Arrows3D.from_fields(colors=[colour], radii=[force.radius]))
            self._log(("world", force.name, "text"), rr.Points3D.from_fields(colors=[legible(colour)], radii=[0.0]))
        for arrow in scene.arrows:
            drawn = rr.Arrows3D(
                origins=[arrow.start],
                vectors=[arrow.tip - arrow.start],
                colors=[arrow.colour],
                radii=[arrow.radius],
            )
            self._log(("world", arrow.name), drawn)
            middle = np.mean([arrow.start, arrow.tip], axis=0)
            text = rr.Points3D([middle], radii=[0.0], colors=[legible(arrow.colour)], labels=[arrow.label])
            self._log(("world", arrow.name, "text"), text)
        if self.header.scenario.tether.advances:
            self._log(("world", "tether"), rr.LineStrips3D.from_fields(colors=[self.colour or YELLOW], radii=[0.01]))
        self._log(("world", "trajectory"), rr.LineStrips3D.from_fields(colors=[self.colour or PURPLE], radii=[0.007]))
        self._names(*bounds(shapes, self.header.geometry.reach))

    def _plates(self, walls: Sequence[Shape]) -> rr.Boxes3D:
        """Walls that are boxes, not wider than the lane of the run."""
        thick, wide, high = np.array([wall.size for wall in walls]).T
        return rr.Boxes3D(
            centers=[wall.position for wall in walls],
            half_sizes=np.stack([thick, np.minimum(wide, self.place.width / 2), high], axis=1),
            quaternions=[np.roll(wall.quat, -1) for wall in walls],
            colors=[rgba8(wall.rgba) for wall in walls],
            fill_mode="solid",
        )

    def _names(self, low: np.ndarray, high: np.ndarray) -> None:
        """Send the reference, a box between the vehicle's corners (3,), or a triad for a tool, and the
        name of the run or the reference."""
        box = rr.Boxes3D(
            centers=[(low + high) / 2],
            half_sizes=[(high - low) / 2],
            colors=[LIGHT],
            radii=[0.003],
            fill_mode="majorwireframe",
        )
        if at_tool := self.origin == "p_WT":
            self._log(("world", "tool"), triad())
        self._log(("world", "reference"), triad(0.6) if at_tool else box)
        if self.label:
            above = (0.0, 0.0, high[2] + _ABOVE)
            name = rr.Points3D([above], radii=[0.0], colors=[legible(self.colour or LIGHT)], labels=[self.label])
            self._log(("world", "vehicle", "name"), name)
        else:
            place = (0.0, 0.0, 1.2 * TRIAD_M) if at_tool else (low[0], 0.0, high[2])
            label = rr.Points3D([place], radii=[0.0], colors=[legible(LIGHT)], labels=["reference"])
            self._log(("world", "reference", "label"), label)

    def _tinted(self, rgba: tuple[float, float, float, float]) -> tuple[int, int, int, int]:
        r, g, b, a = rgba8(rgba)
        if self.colour is not None:
            r, g, b = (round(0.4 * own + 0.6 * tint) for own, tint in zip((r, g, b), self.colour, strict=True))
        return r, g, b, a

    def _series(self) -> None:
        edges = {edge for name in self._bands for edge in self.band(name)}
        for parts, signal, place in self.columns():
            names, colours = zip(*(self.series(signal, i) for i in range(signal.size)[place]), strict=True)
            self._log(parts, _series(list(names), list(colours), _THIN if signal.name in edges else None))
        force = _series([self.named("push [N]")], [self.colour or CONTACT])
        self._log(("push",), force)
        if isinstance(self.header.analytic, SteadyState):
            name = self.named("analytic [N]")
            line = _series([name], [mixed(self.colour, 0.45) if self.colour else REFERENCE])
            self._log(("push", "analytic"), line)

    def series(self, signal: Signal, component: int) -> tuple[str, Colour]:
        """Name and colour of one component of a signal."""
        part, unit = self.header.components(signal)[component], self.header.units(signal)[component]
        name = f"{signal.name}.{part}" if part else signal.name
        colour = self.colour or (CONTACT if PUSH.name in signal.name else COMPONENTS[component % len(COMPONENTS)])
        return self.named(f"{name} [{unit}]"), REFERENCE if signal.name == "p_d" else colour


def bounds(shapes: Sequence[Solid], reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest corner (3,) of a vehicle in B [m]; plus and minus its reach for a vehicle without shapes."""
    if not shapes:
        return np.full(3, -reach), np.full(3, reach)
    corners = np.concatenate([solid.vertices for solid in shapes])
    return corners.min(axis=0), corners.max(axis=0)


def _series(names: list[str], colours: list[Colour], width: float | None = None) -> rr.SeriesLines:
    """Lines that keep every peak at any zoom. Rerun's default, the mean, would halve an impact."""
    policy = rr.components.AggregationPolicy.MinMax
    widths = None if width is None else [width] * len(names)
    return rr.SeriesLines(names=names, colors=colours, widths=widths, aggregation_policy=policy)


def mesh_of(solid: Solid, rgba: tuple[int, int, int, int]) -> rr.Mesh3D:
    """The mesh of a solid. Rerun has no cut-away cylinders, and its solid primitives do not support opacity."""
    return rr.Mesh3D(
        vertex_positions=solid.vertices,
        vertex_normals=solid.normals,
        triangle_indices=solid.triangles,
        albedo_factor=rgba,
    )


def rgba8(rgba: tuple[float, ...]) -> tuple[int, int, int, int]:
    r, g, b, a = (min(255, round(255 * c)) for c in rgba)
    return r, g, b, a
