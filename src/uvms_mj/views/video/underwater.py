"""The scene of a run under water, as MuJoCo draws it: the vehicle of the log, its walls, a floor of sand, and fog; and
where the camera is."""

import contextlib
import functools
import importlib
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from ...errors import InputError, suggestion
from ...physics.waves import WAVE
from ...plant.geometry import Geometry, Shape
from ...plant.looks import PREFIX, add_water, drawn_vehicle
from ...plant.mjcf import Mjcf
from ...plant.sea import elevation
from ...plant.settings import Situation
from ...plant.vehicle import free_body_id, free_joint_addresses
from ...records.header import Header
from ...records.scene import MovingWall, wall_face, walls_of_scene
from ...records.trace import Trace

_NEAR = 3.0
"""A wall further away than this from the way of the vehicle is not in the picture [m]."""
_FOVY = np.radians(45.0)
"""MuJoCo's angle of view over the height."""
_AROUND = 0.6
"""Room for the vehicle around the way of its origin [m]."""


@dataclass(frozen=True)
class View:
    """A camera.

    Attributes:
        azimuth, elevation: direction in which it looks [deg]; azimuth 90 looks along +y of W, so that the wall is on
            the right.
        distance: from the point that it looks at [m]; None for the least at which all of it is seen.
        lookat: "way" for the middle of the vehicle's way and the wall, "surface" for these and the surface of the sea,
            "wall" for the place of contact, or "vehicle", which it follows.
    """

    azimuth: float
    elevation: float
    distance: float | None = None
    lookat: str = "way"


VIEWS = {
    "overview": View(74.0, -20.0),
    "side": View(90.0, -4.0),
    "top": View(90.0, -89.0),
    "behind": View(22.0, -20.0),
    "close": View(75.0, -28.0, 1.05, "wall"),
    "follow": View(68.0, -22.0, 1.4, "vehicle"),
    "surface": View(68.0, -6.0, lookat="surface"),
}
"""The views by name."""


def view_of(chosen: "str | View") -> View:
    """A view by its name, or by "AZIMUTH,ELEVATION" or "AZIMUTH,ELEVATION,DISTANCE" [deg, m]. Raises InputError."""
    if isinstance(chosen, View):
        return chosen
    if chosen in VIEWS:
        return VIEWS[chosen]
    try:
        numbers = [float(each) for each in chosen.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not np.isfinite(numbers).all() or (len(numbers) == 3 and numbers[2] <= 0.0):
        known = suggestion(chosen, VIEWS)
        raise InputError(f"view {chosen!r}: {known}, or give azimuth, elevation and distance: 74,-20,2.5 [deg, deg, m]")
    return View(numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else None)


class Camera:
    """The camera of a run."""

    def __init__(self, trace: Trace, view: View, aspect: float, others: Sequence[Trace] = ()) -> None:
        """``aspect`` is the picture's width over its height, and ``others`` are the other vehicles of a world."""
        name = trace.header.task_frame[0]
        way = np.concatenate([trace.p_WB, trace[name], *(each.p_WB for each in others)])
        low, high = way.min(axis=0), way.max(axis=0)
        face = np.array([wall_face(trace.header), *trace[name][-1, 1:]])
        if np.linalg.norm(np.clip(face, low, high) - face) < _NEAR:
            low, high = np.minimum(low, face), np.maximum(high, face)
        self.lowest, sea = float(way[:, 2].min()), trace.scenario.sea
        if view.lookat == "surface" and sea.moves:
            high[2] = max(high[2], sea.surface + sea.height)
        before_wall = face + np.array([0.03 - trace.header.probe_radius, 0.0, 0.08])
        if not trace.scenario.wall.present:  # where the vehicle touched last
            touching = np.flatnonzero(trace.f_contact_W.any(axis=1))
            before_wall = trace[name][touching[-1] if len(touching) else -1] + np.array([0.03, 0.0, 0.08])
        self.point = before_wall if view.lookat == "wall" else 0.5 * (low + high)
        azimuth = np.radians(view.azimuth)
        sides = high - low
        across = abs(sides[0] * np.sin(azimuth)) + abs(sides[1] * np.cos(azimuth)) + _AROUND
        upright = sides[2] + abs(sides[0] * np.cos(azimuth)) * 0.5 + _AROUND
        fitting = max(across / aspect, upright) / (2.0 * np.tan(0.5 * _FOVY)) + 0.25
        self.view = replace(view, distance=view.distance or float(fitting))

    def at(self, p_WB: np.ndarray) -> mujoco.MjvCamera:
        """MuJoCo's camera while the vehicle is at a position (3,)."""
        camera = mujoco.MjvCamera()
        camera.azimuth, camera.elevation = self.view.azimuth, self.view.elevation
        camera.distance = self.view.distance
        camera.lookat = p_WB if self.view.lookat == "vehicle" else self.point
        return camera


_FLAT = 1e-3
"""Distance of a facet from a round wall [m]."""
FLOOR = -0.42
"""Height of the floor below the lowest position of a run [m]."""
_PACKAGES = {"egl": "libegl1 libgl1-mesa-dri", "osmesa": "libosmesa6", "glfw": "libglfw3 and a display"}
"""Debian's packages for each way to draw without a window."""


def noise(seed: int, slope: float, n: int = 1024) -> np.ndarray:
    """Periodic noise (n, n) of unit variance; a steeper slope of the spectrum makes it smoother."""
    frequency = n * np.hypot(*np.meshgrid(np.fft.fftfreq(n), np.fft.fftfreq(n)))
    white = np.random.default_rng(seed).standard_normal((n, n))
    field = np.real(np.fft.ifft2(np.fft.fft2(white) / np.maximum(frequency, 2.0) ** slope))
    return (field - field.mean()) / field.std()


@functools.cache
def concrete() -> np.ndarray:
    """Pixels (n, n, 3) of cast concrete in panels."""
    grey = 0.61 + 0.03 * noise(1, 1.6)
    n = len(grey)
    to_joint = np.abs((np.arange(n) + n // 4) % (n // 2) - n // 4)
    grey *= 1.0 - 0.35 * np.exp(-((np.minimum.outer(to_joint, to_joint) / 2.5) ** 2))
    return _pixels(grey, (0.97, 1.0, 0.98))


@functools.cache
def sand() -> np.ndarray:
    """Pixels (n, n, 3) of rippled sand with caustics."""
    warp = noise(2, 1.75)
    n = len(warp)
    ripples = np.sin(2 * np.pi * 20 * np.add.outer(0.2 * np.arange(n), np.arange(n)) / n + 1.2 * warp)
    caustics = np.exp(-8.0 * np.abs(noise(3, 2.25)))
    return _pixels(0.52 + 0.03 * ripples + 0.03 * noise(4, 1.7) + 0.16 * caustics, (0.86, 0.84, 0.70))


def _pixels(brightness: np.ndarray, rgb: tuple[float, float, float]) -> np.ndarray:
    return (255 * np.clip(brightness[..., None] * np.array(rgb), 0, 1)).astype(np.uint8)


class SeaSurface:
    """The surface of the sea of a run, a field of heights about a place."""

    _HALF, _NODES = 8.0, 129
    _MOST = 1.5
    """Height that is drawn, over the (significant) height of the waves."""

    def __init__(self, header: Header) -> None:
        sea, gravity = header.scenario.sea, float(np.linalg.norm(header.mjcf.gravity_W))
        situation = Situation(header.scenario.simulation.seed, gravity, wall_face(header))
        self._records, self._sea = np.array(sea.records(situation), WAVE), sea

    def add_to(self, spec: mujoco.MjSpec, centre: Sequence[float] | np.ndarray) -> None:
        """Add the field to a scene."""
        n, half, most = self._NODES, self._HALF, self._MOST * self._sea.height
        self._x, self._y = np.meshgrid(*(centre[i] + np.linspace(-half, half, n) for i in (0, 1)))
        spec.add_hfield(name="sea", nrow=n, ncol=n, size=[half, half, 2.0 * most, 1e-3], userdata=np.zeros(n * n))
        place = [centre[0], centre[1], self._sea.surface - most]
        kind = mujoco.mjtGeom.mjGEOM_HFIELD
        spec.worldbody.add_geom(type=kind, hfieldname="sea", pos=place, rgba=[0.55, 0.85, 0.95, 0.45])

    def put(self, model: mujoco.MjModel, t: float) -> None:
        """Set the heights of a compiled scene to a time [s]."""
        most = self._MOST * self._sea.height
        high = elevation(self._records, t, self._x, self._y)
        model.hfield_data[:] = np.clip(0.5 + 0.5 * high / most, 0.0, 1.0).ravel()


def model_of(
    header: Header,
    centre: Sequence[float] | np.ndarray,
    extent: float = 1.0,
    floor: float = FLOOR,
    samples: int = 8,
    surface: SeaSurface | None = None,
    others: Sequence[Header] = (),
) -> mujoco.MjModel:
    """A model of the run's vehicle and walls for drawing only.

    Args:
        header: of the run.
        centre: the point that the light and the fog refer to, in W [m].
        extent: distance from the camera at which the fog begins to hide [m].
        floor: height of the floor in W [m].
        samples: samples of a pixel; they also decide how finely shadows are drawn, which takes most of the time.
        surface: the surface of the sea, if there is one.
        others: of the other vehicles of a world; their names in the model begin with :func:`prefix_of`.
    """
    spec = header.mjcf.spec()
    for body, each in _touching_shapes(header):
        _add_solid(spec, body, each)
    for other in others:
        child = other.mjcf.spec()
        for body, each in _touching_shapes(other):
            _add_solid(child, body, each)
        for light in list(child.lights):
            child.delete(light)
        spec.attach(child, prefix=prefix_of(other), frame=spec.worldbody.add_frame())
    add_water(spec, "water", 512)
    for name, pixels in (("concrete", concrete()), ("sand", sand())):
        height, width, _ = pixels.shape
        kind = mujoco.mjtTexture.mjTEXTURE_2D
        spec.add_texture(name=name, type=kind, width=width, height=height, nchannel=3).data = pixels.tobytes()
        material = spec.add_material(name=name, texuniform=True, specular=0.05)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    if (acrylic := spec.material("acrylic")) is not None:
        acrylic.rgba = [0.75, 0.93, 1.0, 0.36]
    plane, size = mujoco.mjtGeom.mjGEOM_PLANE, [20.0 * extent, 20.0 * extent, 1.0]
    spec.worldbody.add_geom(type=plane, size=size, pos=[0, 0, floor], material="sand")
    standing, moving = walls_of_scene(header)
    for shape in standing:
        _add_wall(spec.worldbody, shape)
    for wall in moving:
        _add_wall(spec.worldbody.add_body(name=_body_of(wall), mocap=True), wall.shape)
    round_ = [shape.size[0] for shape in (*standing, *(wall.shape for wall in moving)) if shape.kind != "box"]
    if round_:  # a facet is at most _FLAT beside the wall
        slices = math.ceil(math.pi / math.sqrt(2.0 * _FLAT / max(round_)))
        spec.visual.quality.numslices = max(spec.visual.quality.numslices, slices)
        spec.visual.quality.numstacks = max(spec.visual.quality.numstacks, slices // 2)
    if surface is not None:
        surface.add_to(spec, centre)
    directional = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    sun = spec.light("sun") or spec.worldbody.add_light(name="sun", type=directional, pos=[0, 0, 2])
    sun.castshadow, sun.dir, sun.diffuse = surface is None, [0.35, -0.25, -1.0], [0.85, 0.90, 0.90]
    visual = spec.visual
    visual.headlight.ambient, visual.headlight.diffuse = [0.34, 0.42, 0.46], [0.25, 0.27, 0.28]
    visual.quality.shadowsize, visual.quality.offsamples = 1024 * samples, samples
    visual.rgba.fog = [0.10, 0.42, 0.55, 1.0]
    visual.map.fogstart, visual.map.fogend, visual.map.shadowclip, visual.map.znear = 0.9, 4.0, 6.0, 0.02
    spec.stat.extent, spec.stat.center = extent, [*centre]
    return header.mjcf.compiled(spec)


def _add_wall(body: Any, shape: Shape) -> None:
    sizes, quat = np.array(shape.size), np.array(shape.quat)
    if shape.kind == "box":  # the texture is mapped to x and y, which must be the axes of the wall's face
        sizes, given = np.roll(sizes, -1), quat.copy()
        mujoco.mju_mulQuat(quat, given, np.array([0.5, 0.5, -0.5, -0.5]))
    body.add_geom(type=_kind(shape), size=sizes, pos=shape.position, quat=quat, material="concrete")


def _body_of(wall: MovingWall) -> str:
    return f"{PREFIX}{wall.frame}"


def wall_setter(model: mujoco.MjModel, header: Header) -> Any:
    """A function that puts the walls of mjData that move where they are in values, of one row."""
    moving = walls_of_scene(header)[1]
    places = [int(model.body(_body_of(wall)).mocapid[0]) for wall in moving]

    def put(data: mujoco.MjData, values: Mapping[str, np.ndarray]) -> None:
        for wall, place in zip(moving, places, strict=True):
            (data.mocap_pos[place],), (data.mocap_quat[place],) = wall.poses(values)

    return put


def _kind(shape: Shape) -> Any:
    return getattr(mujoco.mjtGeom, f"mjGEOM_{shape.kind.upper()}")


def prefix_of(other: Header) -> str:
    """The beginning of the names of another vehicle of a world in the model for drawing."""
    return f"{other.scenario.vehicle.name}/"


def _add_solid(spec: mujoco.MjSpec, body: str, shape: Shape) -> None:
    place = {"size": shape.size, "pos": shape.position, "quat": shape.quat}
    spec.body(body).add_geom(type=_kind(shape), rgba=shape.rgba, mass=0.0, **place)


def _touching_shapes(header: Header) -> Iterator[tuple[str, Shape]]:
    """The contact bodies of a vehicle, also for contacts with others, as shapes with the bodies that carry them."""
    geometry: Geometry = header.geometry
    drawn = drawn_vehicle(geometry, header.scenario, header.mjcf.vehicle.arm)
    for shape in drawn.shapes[len(geometry.shapes) :]:
        yield header.mjcf.vehicle.body, shape
    for link, with_bodies in zip(geometry.links, drawn.links, strict=True):
        for shape in with_bodies.shapes[len(link.shapes) :]:
            yield link.name, shape


def pose_setter(model: mujoco.MjModel, mjcf: Mjcf, prefix: str = "") -> Any:
    """A function that puts the vehicle of mjData to a position (3,), an attitude (4,) and joint positions (n,)."""
    first, _ = free_joint_addresses(model, free_body_id(model, prefix + mjcf.vehicle.body))
    joints = [int(model.joint(prefix + link.joint).qposadr[0]) for link in mjcf.geometry.links]

    def put(data: mujoco.MjData, p: np.ndarray, quat: np.ndarray, q: Sequence[float]) -> None:
        data.qpos[first : first + 7] = *p, *quat
        data.qpos[joints] = q
        mujoco.mj_forward(model, data)

    return put


class Offscreen:
    """Draws a model without a window.

    mujoco.Renderer takes the way that MUJOCO_GL names when MuJoCo is imported, which is too late here. This class takes
    the first that works: MUJOCO_GL's if it names one, then EGL, then OSMesa, then a display.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        """Raises InputError, which names the system's packages, if there is no way."""
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self.model, self.width, self.height = model, width, height
        self._gl = gl_context(width, height)
        self.scene = mujoco.MjvScene(model, maxgeom=2000)
        self.scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = 1
        self._options, self._perturb = mujoco.MjvOption(), mujoco.MjvPerturb()
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)

    def draw(self, data: mujoco.MjData, camera: mujoco.MjvCamera) -> np.ndarray:
        """The picture (height, width, 3)."""
        every, rect = mujoco.mjtCatBit.mjCAT_ALL.value, mujoco.MjrRect(0, 0, self.width, self.height)
        mujoco.mjv_updateScene(self.model, data, self._options, self._perturb, camera, every, self.scene)
        pixels = np.empty((self.height, self.width, 3), np.uint8)
        self._gl.make_current()
        mujoco.mjr_render(rect, self.scene, self._context)
        mujoco.mjr_readPixels(pixels, None, rect, self._context)
        return np.flipud(pixels)

    def upload_surface(self) -> None:
        """Draw the heights that the model has from now on, from both sides."""
        self._gl.make_current()
        mujoco.mjr_uploadHField(self.model, self._context, 0)
        self.scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = 0

    def place(self, points_W: np.ndarray) -> np.ndarray:
        """Places (..., 2) of points (..., 3) in W in the last picture, from the upper left corner [pixels]."""
        left, right = self.scene.camera
        ray = points_W - (left.pos + right.pos) / 2
        scale = self.height / 2 * left.frustum_near / left.frustum_top / np.maximum(ray @ left.forward, 1e-6)
        x, y = scale * (ray @ np.cross(left.forward, left.up)), scale * (ray @ left.up)
        return np.stack([self.width / 2 + x, self.height / 2 - y], axis=-1)

    def close(self) -> None:
        self._context.free()
        self._gl.free()

    def __enter__(self) -> "Offscreen":
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()


def gl_context(width: int, height: int) -> Any:
    """MuJoCo's context of OpenGL without a window, of a size in pixels. Raises InputError if no driver gives one."""
    ways = ["cgl"] if sys.platform == "darwin" else ["egl", "osmesa", "glfw"]
    chosen = os.environ.get("MUJOCO_GL", "").lower()
    tried: Mapping[str, str] = {}
    for way in [chosen] if chosen in ways else ways:
        with contextlib.suppress(KeyError):
            if os.environ["PYOPENGL_PLATFORM"] in ways:  # of the way that was tried before
                del os.environ["PYOPENGL_PLATFORM"]
        try:
            context = importlib.import_module(f"mujoco.{way}").GLContext(width, height)
            context.make_current()
            return context
        except Exception as error:  # of PyOpenGL, ctypes or the driver
            tried = {**tried, way: " ".join(str(error).split())[:100] or type(error).__name__}
    said = "; ".join(f"{way}: {why}" for way, why in tried.items())
    hint = "on Debian or Ubuntu, as root: apt install " + _PACKAGES[next(iter(tried))] if "cgl" not in tried else ""
    raise InputError(f"no driver draws without a window ({said}); {hint}".rstrip("; "))
