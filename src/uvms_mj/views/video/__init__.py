"""Videos and stills of a run: the scene under water, with arrows of the contact force and of the current, and plots
that grow beside it."""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np

from ...errors import InputError, needs_extra
from ...records.header import Header, Outcome, Status
from ...records.scene import FORCES, SKY, YELLOW
from ...records.trace import Trace
from ...setup.world import one_world
from ..progress import following
from .encoding import CODERS, encoded
from .underwater import VIEWS, Camera, View, view_of

if TYPE_CHECKING:
    from PIL.Image import Image

PLOTS = ("force", "position", "sliding")
"""The plots that are drawn if none is chosen, as far as the run has them."""
SIZES = {"gif": (800, 450)}
SIZE = (1280, 720)
FPS = {"gif": 15.0}
"""Sizes in pixels and pictures per second that are not the default, by ending."""
_SHARE = 0.6
"""Share of the width, or of the height of an upright picture, that the scene takes."""
_NEEDED = ("t", "p_WB", "quat_WB", "f_contact_W")
_FINER = 3
"""Factor by which arrows and letters are drawn larger, for smooth edges."""
_ARROW_N = 0.9
"""Length of the arrow of the largest force of a run [m]."""
_LEAST_PX = 24.0
"""Length of the arrow of a small force, in a picture of a height of 450 pixels."""
_STREAMS = np.array([[0.14, 0.30, 0.36], [0.66, 0.10, 0.43], [0.60, 0.45, 0.24]])
"""Starts of the arrows of the current, from the start of the way [m]."""


def video(
    trace: Trace | Mapping[str, Trace],
    path: str | os.PathLike,
    *,
    speed: float = 1.0,
    view: str | View = "overview",
    plots: Sequence[str] | None = None,
    size: tuple[int, int] | None = None,
    fps: float | None = None,
    progress: Callable[[int, int], None] | bool | None = None,
) -> None:
    """Write a video of a run, by the ending of the file .mp4 or .gif. An existing file is replaced.

    Args:
        trace: the run; ``trace.between(4.0, 8.0)`` for a part of it. Of a world, the traces by the names of the
            vehicles, which are drawn together, without plots.
        path: the file.
        speed: simulated seconds per second of the video.
        view: overview, side, top, behind, close, follow or surface, in which the sea's surface is;
            "azimuth,elevation,distance" [deg, deg, m]; or a View.
        plots: quantities or signals as in ``trace.plot``, one plot for each; default: force, position and the sliding
            variable; empty for the scene alone.
        size: width and height in pixels, even numbers; default: 1280 x 720, of a GIF 800 x 450.
        fps: pictures per second; default: 30, of a GIF 15.
        progress: True for a progress bar, or a function of the pictures done and their total.

    Raises InputError for an unknown ending, a run that can't be drawn, without the extra ``video``, and without a
    driver that draws without a window.
    """
    path = Path(path)
    kind = path.suffix.lower().removeprefix(".")
    if kind not in CODERS:
        raise InputError(f"{path}: the name must end in one of .{', .'.join(CODERS)}; still() makes a picture")
    fps = fps or FPS.get(kind, 30.0)
    if not (math.isfinite(speed) and speed > 0.0 and math.isfinite(fps) and fps > 0.0):
        raise InputError(f"speed {speed:g} and fps {fps:g}: must be positive")
    size = size or SIZES.get(kind, SIZE)
    frames = _Frames(trace, view, plots, size, samples=4)
    with needs_extra("video"):
        import imageio_ffmpeg  # noqa: F401  before the first picture is drawn
    times = _times(frames.trace, speed / fps)
    with (
        frames,
        following(progress, path.name, "{done} of {total} pictures", lambda i, n: {"done": i, "total": n}) as told,
        encoded(path, *size, fps) as add,
    ):
        for i, (since, now) in enumerate(times):
            add(frames.at(since, now))
            told(i + 1, len(times))


def still(
    trace: Trace | Mapping[str, Trace],
    t: float | None = None,
    *,
    view: str | View = "overview",
    plots: Sequence[str] | None = None,
    size: tuple[int, int] = SIZE,
) -> "Image":
    """One picture of a video at a time [s], by default the last; a Pillow image, which a notebook shows. It
    takes the arguments of :func:`video` and raises its errors."""
    from PIL import Image

    with _Frames(trace, view, plots, size, samples=8) as frames:
        last = len(frames.trace) - 1
        now = last if t is None else int(np.clip(np.searchsorted(frames.trace.t, t - 1e-9), 0, last))
        return Image.fromarray(frames.at(now, now))


def _times(trace: Trace, step: float) -> list[tuple[int, int]]:
    """The rows (from, to) of each picture, the last row of the picture before and its own."""
    n = max(2, round((float(trace.t[-1]) - float(trace.t[0])) / step) + 1)
    rows = np.searchsorted(trace.t, float(trace.t[0]) + step * np.arange(n) - 1e-9).clip(0, len(trace) - 1)
    return list(zip([rows[0], *rows[:-1]], rows.tolist(), strict=True))


class _Frames:
    """The pictures of a run. The arrow of the force is as long as it may be at the largest force of the run, or at
    ``largest`` [N]."""

    def __init__(
        self,
        given: Trace | Mapping[str, Trace],
        view: str | View,
        plots: Sequence[str] | None,
        size: tuple[int, int],
        samples: int,
        largest: float | None = None,
    ) -> None:
        trace, *others = given.values() if isinstance(given, Mapping) else (given,)
        for each in (trace, *others):
            missing = [name for name in _NEEDED if name not in each.arrays]
            if missing or len(each) < 2:
                why = f"no {', '.join(missing)}" if missing else "fewer than two samples"
                raise InputError(f"the run has {why}, and can't be drawn")
        if others and not one_world([each.scenario for each in (trace, *others)]):
            raise InputError("several runs are drawn in one scene if they are of the vehicles of one world")
        if others and plots:
            raise InputError("plots stand beside the scene of one vehicle; uvms-mj plot draws all vehicles of a world")
        plots = () if others else plots
        width, height = size
        if not (160 <= width <= 7680 and 90 <= height <= 4320) or width % 2 or height % 2:
            raise InputError(f"size {width}x{height}: give even numbers of pixels, from 160x90 to 7680x4320")
        from . import underwater

        self.trace, self._others, header = trace, others, trace.header
        chosen = [each for each in PLOTS if each != "sliding" or "s" in trace.arrays] if plots is None else [*plots]
        beside = width >= height
        scene_w = width if not (chosen and beside) else 2 * round(0.5 * _SHARE * width)
        scene_h = height if not chosen or beside else 2 * round(0.5 * _SHARE * height)
        self._scene, self._beside = (scene_w, scene_h), beside
        self._scale = min(scene_h, scene_w / 1.2) / 450.0
        self._plots = None
        if chosen:
            from .plots import Plots

            rest = (width - scene_w, height) if beside else (width, height - scene_h)
            self._plots = Plots(trace, chosen, *rest, dpi=max(60.0, 110.0 * min(rest[0] / 330.0, rest[1] / 330.0)))
        self._camera = Camera(trace, view_of(view), scene_w / scene_h, others)
        extent = max(1.0, 0.8 * float(self._camera.view.distance or 1.0))
        floor = self._camera.lowest + underwater.FLOOR
        self._surface = underwater.SeaSurface(header) if header.scenario.sea.moves else None
        headers = [each.header for each in others]
        model = underwater.model_of(header, self._camera.point, extent, floor, samples, self._surface, headers)
        self._put = [underwater.pose_setter(model, header.mjcf)]
        self._put += [underwater.pose_setter(model, each.mjcf, underwater.prefix_of(each)) for each in headers]
        self._put_walls = underwater.wall_setter(model, header)
        self._renderer = underwater.Offscreen(model, scene_w, scene_h)
        self._data = _data(model)
        peaks = [float(np.linalg.norm(each.f_contact_W, axis=1).max()) for each in (trace, *others)]
        peak = max(peaks) if largest is None else largest
        self._force_scale = _ARROW_N / peak if peak > 0.0 else 0.0

    def __enter__(self) -> "_Frames":
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    def close(self) -> None:
        self._renderer.close()

    def at(self, since: int, now: int) -> np.ndarray:
        """The picture (height, width, 3) of a row. Its force is the largest since another row."""
        trace = self.trace
        self._put_walls(self._data, {name: trace[name][now : now + 1] for name in trace})
        for put, each in zip(self._put, (trace, *self._others), strict=True):
            at = min(now, len(each) - 1)
            put(self._data, each.p_WB[at], each.quat_WB[at], each.q[at] if "q" in each.arrays else ())
        if self._surface is not None:
            self._surface.put(self._renderer.model, float(trace.t[now]))
            self._renderer.upload_surface()
        scene = self._renderer.draw(self._data, self._camera.at(trace.p_WB[now]))
        drawn = self._annotated(scene, since, now)
        if self._plots is None:
            return drawn
        plots = self._plots.at(float(trace.t[now]))
        return np.concatenate([drawn, plots], axis=1 if self._beside else 0)

    def _annotated(self, scene: np.ndarray, since: int, now: int) -> np.ndarray:
        from PIL import Image, ImageDraw

        trace, s = self.trace, self._scale
        big = (_FINER * self._scene[0], _FINER * self._scene[1])
        layer = Image.new("RGBA", big, (255, 255, 255, 0))
        pen = ImageDraw.Draw(layer)
        together = (trace, *self._others)
        names = [each.scenario.vehicle.name for each in together]
        whose = ", ".join(names) if self._others else trace.scenario.controller.label()
        lines: list[tuple[str, tuple[int, int, int] | None]] = [
            (f"{trace.scenario.name} · {whose}", None),
            (f"t = {trace.t[now]:.2f} s", None),
        ]
        for name, each in zip(names, together, strict=True):
            self._draw_force(pen, each, f"{name}: " if self._others else "", lines, since, now)
        if "tether_nodes" in trace.arrays:
            way = _FINER * self._renderer.place(trace.tether_nodes[now].reshape(-1, 3)[::-1])
            seen = np.cumprod(np.abs(way).max(axis=1) < 4.0 * max(big)).sum()  # up to the first one behind the camera
            pen.line(way[:seen].ravel().tolist(), fill=(*YELLOW, 255), width=round(_FINER * 3.0 * s), joint="curve")
        current = trace.scenario.mean_flow_W
        speed = float(np.linalg.norm(current))
        if speed > 0.0:
            part = "" if trace.scenario.constant_flow else "constant part of the "
            lines.append((f"{part}current {speed:.2f} m/s", SKY))
            lead = trace.p_WB[0] if self._camera.view.lookat == "way" else trace.p_WB[now] + [-0.35, 0.0, 0.0]
            for start in lead + _STREAMS:
                ends = self._renderer.place(np.array([start, start + 0.5 * current]))
                _arrow(pen, ends[0], ends[1], 4.5 * s, SKY, 0.0)
        _write(pen, lines, s)
        layer = layer.resize(self._scene, Image.Resampling.BOX)
        return np.asarray(Image.alpha_composite(Image.fromarray(scene).convert("RGBA"), layer).convert("RGB"))

    def _draw_force(self, pen: Any, trace: Trace, whose: str, lines: list, since: int, now: int) -> None:
        """Draw the largest contact force of a vehicle since a row, and say it in a line if it has touched."""
        now = min(now, len(trace) - 1)
        forces = np.linalg.norm(trace.f_contact_W[since : now + 1], axis=1)
        if not len(forces):  # of a vehicle that has stopped
            return
        force, at_force = FORCES[0], since + int(forces.argmax())
        newtons = float(forces.max())
        if trace.touches[-1] > 0 if "touches" in trace.arrays else newtons > 0.0:
            lines.append((f"{whose}contact force {newtons:.1f} N", force.colour))
        if newtons > 0.0:
            row = {name: trace[name][at_force : at_force + 1] for name in trace}
            start, tip = (each[0] for each in force.ends(trace.header, row, self._force_scale))
            width, least = 9.0 * self._scale, _LEAST_PX * self._scale
            _arrow(pen, self._renderer.place(start), self._renderer.place(tip), width, force.colour, least)


class LivePictures:
    """Pictures of a run while somebody steps it, without plots.

    Args:
        header: of the run.
        rows: (n, width) rows between which the vehicle will move, at least two: the start, and another one.
        view, size: as of :func:`still`.
        largest: force of the longest arrow [N].

    Raises the errors of :func:`still`.
    """

    def __init__(
        self, header: Header, rows: np.ndarray, *, view: str | View, size: tuple[int, int], largest: float
    ) -> None:
        self._header, self._outcome = header, Outcome(Status.interrupted, "", len(rows) - 1, 0.0)
        self._frames = _Frames(self._trace(rows), view, (), size, samples=1, largest=largest)

    def _trace(self, rows: np.ndarray) -> Trace:
        return Trace.of(self._header, rows, self._outcome)

    def of(self, row: np.ndarray) -> np.ndarray:
        """The picture (height, width, 3) of a row (width,)."""
        self._frames.trace = self._trace(row[None])
        return self._frames.at(0, 0)

    def close(self) -> None:
        self._frames.close()


def _data(model: Any) -> Any:
    import mujoco

    return mujoco.MjData(model)


def _arrow(
    pen: Any, start: np.ndarray, tip: np.ndarray, width: float, colour: tuple[int, int, int], least: float
) -> None:
    """A flat arrow between two places [pixels], at least so long, with a dark edge."""
    way = tip - start
    length = float(np.hypot(*way))
    if length < 1e-6:
        return
    ahead = way / length
    if length < least:
        start, length = tip - least * ahead, least
    aside = np.array([-ahead[1], ahead[0]])
    head = min(2.2 * width, 0.6 * length)
    neck, half, wing = tip - head * ahead, 0.32 * width, 0.5 * head
    outline = [
        start + half * aside,
        neck + half * aside,
        neck + wing * aside,
        tip,
        neck - wing * aside,
        neck - half * aside,
        start - half * aside,
    ]
    points = [tuple(_FINER * each) for each in outline]
    pen.line([*points, points[0], points[1]], fill=(10, 25, 35, 150), width=round(_FINER * 0.22 * width) + 2)
    pen.polygon(points, fill=(*colour, 255))


def _write(pen: Any, lines: Sequence[tuple[str, tuple[int, int, int] | None]], scale: float) -> None:
    """Lines of text in the upper left corner, each with the colour of its arrow."""
    from PIL import ImageFont

    font = ImageFont.truetype(str(Path(mpl.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")), _FINER * 15.0 * scale)
    size = _FINER * scale
    longest = max(pen.textlength(text, font=font) for text, _ in lines)
    high = (14.0 + 22.0 * len(lines)) * size
    box = [10.0 * size, 10.0 * size, 10.0 * size + longest + 44.0 * size, 10.0 * size + high]
    pen.rounded_rectangle(box, radius=6.0 * size, fill=(4, 24, 38, 130))
    for i, (text, colour) in enumerate(lines):
        y = (17.0 + 22.0 * i) * size
        if colour is not None:
            pen.rounded_rectangle(
                [20.0 * size, y + 6.0 * size, 32.0 * size, y + 13.0 * size], radius=2.0 * size, fill=(*colour, 255)
            )
        pen.text(((40.0 if colour else 20.0) * size, y), text, font=font, fill=(255, 255, 255, 255))


__all__ = ["CODERS", "PLOTS", "VIEWS", "LivePictures", "View", "still", "video"]
