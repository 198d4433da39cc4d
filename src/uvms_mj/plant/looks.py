"""Looks of a run: the shapes of its vehicle and its walls, and their appearance in MuJoCo's model.

In the model every shape is a skin, bound to the body that carries it. MuJoCo moves a skin when it draws a picture and
not in a step, so that the looks cost a step nothing, and no number of a run depends on them.
"""

import dataclasses
from collections.abc import Sequence

import mujoco
import numpy as np

from ..physics.frames import attitude, quat_from_euler_deg, rotation_matrix
from ..physics.surfaces import DRAWN_LENGTH, SHAPES
from ..stages.setup import ScenarioLike
from .arm import Arm
from .contacts import carrier_at
from .coupling import Coupling
from .geometry import Geometry, Shape, solids
from .settings import ContactBody, Surface

WALL_SIZE, WALL_THICKNESS = DRAWN_LENGTH, 0.05
"""Size of the drawn part of a wall [m]."""
WALL_RGBA = (0.62, 0.64, 0.66, 0.35)
"""Colour of a wall, through which the contact can be seen."""
BODY_RGBA = (0.90, 0.62, 0.0, 0.6)
"""Colour of a contact body."""
PREFIX = "uvms_mj/"
"""Prefix of all added names, to keep them apart from a vehicle's."""
OVERVIEW = "overview"
"""Name of the camera that sees start and wall."""
AZIMUTH, ELEVATION = 75.0, -25.0
"""Direction in which it looks [deg]."""


def wall_in_its_frame(wall: Surface) -> Shape:
    """A wall in its frame S: a plane is a square plate, whose face has its middle at the origin."""
    level = (1.0, 0.0, 0.0, 0.0)
    if (drawn := SHAPES[wall.shape].drawn) is None:
        half = (WALL_THICKNESS / 2, WALL_SIZE / 2, WALL_SIZE / 2)
        return Shape("box", half, (half[0], 0.0, 0.0), level, WALL_RGBA)
    kind, size = drawn(wall.size)
    return Shape(kind, size, (0.0, 0.0, 0.0), level, WALL_RGBA)


def drawn_wall(wall: Surface) -> Shape:
    """A wall in W, at its place without motion."""
    shape = wall_in_its_frame(wall)
    middle = np.array(wall.position) + shape.position[0] * wall.R_WS[:, 0]
    quat = tuple(quat_from_euler_deg(*wall.attitude_deg).tolist())
    return dataclasses.replace(shape, position=tuple(middle.tolist()), quat=quat)


def drawn_vehicle(geometry: Geometry, scenario: ScenarioLike, arm: Arm) -> Geometry:
    """The shapes of a vehicle, of its contact bodies, and of its bodies and surfaces in contacts with other vehicles,
    each with the base or the link that carries it."""
    added = [(body.body, drawn_body(body)) for body in scenario.vehicle.contact_bodies]
    name = scenario.vehicle.name
    touching = [each for each in scenario.couplings if each.surface is not None and name in each.vehicles]
    added += [_of_coupling(each, name, arm) for each in touching]
    if not added:
        return geometry

    def with_added(shapes: tuple[Shape, ...], link: str | None) -> tuple[Shape, ...]:
        return *shapes, *(shape for carrier, shape in added if carrier == link)

    links = tuple(dataclasses.replace(link, shapes=with_added(link.shapes, link.name)) for link in geometry.links)
    return dataclasses.replace(geometry, shapes=with_added(geometry.shapes, None), links=links)


def _of_coupling(coupling: Coupling, vehicle: str, arm: Arm) -> tuple[str | None, Shape]:
    """The body or the surface that a vehicle has in a contact, with the link that carries it; None for the base."""
    end = coupling.vehicles.index(vehicle)
    assert coupling.body is not None
    assert coupling.surface is not None
    shape = drawn_wall(coupling.surface) if end else drawn_body(coupling.body)
    C, quat = carrier_at(coupling.at[end], arm), np.empty(4)
    assert C is not None  # a scenario without faults
    attitude(C.R @ rotation_matrix(np.array(shape.quat)), quat)
    position = C.p + C.R @ shape.position
    placed = dataclasses.replace(shape, position=tuple(position.tolist()), quat=tuple(quat.tolist()))
    return arm.links[C.link].name if C.link >= 0 else None, placed


def drawn_body(body: ContactBody) -> Shape:
    """A contact body in the frame of its base or link."""
    if body.end is None:
        return Shape("sphere", (body.radius, 0.0, 0.0), body.position, (1.0, 0.0, 0.0, 0.0), BODY_RGBA)
    a, b = np.array(body.position), np.array(body.end)
    length = float(np.linalg.norm(b - a))
    x, y, z = (b - a) / length
    quat = np.array([1.0 + z, -y, x, 0.0]) if z > -1.0 + 1e-9 else np.array([0.0, 1.0, 0.0, 0.0])  # from z to the axis
    quat /= np.linalg.norm(quat)
    middle = tuple((0.5 * (a + b)).tolist())
    return Shape("capsule", (body.radius, length / 2, 0.0), middle, tuple(quat.tolist()), BODY_RGBA)


def add_vehicle(spec: mujoco.MjSpec, body: str, geometry: Geometry) -> None:
    """Add the looks of a vehicle and of its links to a model, each to the body that carries it."""
    for carrier, shapes in ((body, geometry.shapes), *((link.name, link.shapes) for link in geometry.links)):
        _add(spec, carrier, carrier, Geometry(shapes, geometry.meshes))


def add_surroundings(
    spec: mujoco.MjSpec, body: str, contact_bodies: Sequence[ContactBody], walls: Sequence[Surface]
) -> None:
    """Add the looks of contact bodies and walls to a model, and the water behind them, a camera, and a light if it has
    none. The model has been compiled without its own visual elements."""
    for i, each in enumerate(contact_bodies):
        _add(spec, f"contact body {i + 1}", each.body or body, Geometry((drawn_body(each),), {}))
    for i, wall in enumerate(walls):
        _add(spec, _name(i), "world", Geometry((drawn_wall(wall),), {}))
    add_water(spec, f"{PREFIX}water", 64)
    if not spec.lights:
        sun = spec.worldbody.add_light(name=f"{PREFIX}sun", type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, pos=[0, 0, 2])
        sun.dir, sun.castshadow = [-0.25, 0.3, -1.0], False
    spec.worldbody.add_camera(name=OVERVIEW)


def add_water(spec: mujoco.MjSpec, name: str, pixels: int) -> None:
    """Add the water behind everything, bright above and dark below, as a cube of so many pixels along an edge."""
    spec.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.30, 0.80, 0.90],
        rgb2=[0.00, 0.04, 0.12],
        width=pixels,
        height=6 * pixels,
    )


def _name(wall: int) -> str:
    return f"wall {wall + 1}"


def _add(spec: mujoco.MjSpec, name: str, carrier: str, geometry: Geometry) -> None:
    """Add one skin for each colour of a geometry, in the frame of the body that carries it. MuJoCo takes lists faster
    than arrays."""
    for k, solid in enumerate(solids(geometry)):
        n = len(solid.vertices)
        spec.add_skin(
            name=f"{PREFIX}{name} {k + 1}",
            rgba=solid.rgba,
            vert=solid.vertices.reshape(-1).tolist(),
            face=solid.triangles.reshape(-1).tolist(),
            bodyname=[carrier],
            bindpos=[0.0, 0.0, 0.0],
            bindquat=[1.0, 0.0, 0.0, 0.0],
            vertid=[list(range(n))],
            vertweight=[np.ones(n)],
        )


def aim(model: mujoco.MjModel, start: Sequence[float], face: float, reach: float) -> None:
    """Let the free camera and the one called :data:`OVERVIEW` see the vehicle between its start (3,) and the wall's
    face at x of W [m]."""
    span = max(WALL_SIZE, abs(face - start[0]) + 2.0 * reach)
    model.stat.center[:], model.stat.extent = (0.5 * (start[0] + face), *start[1:]), span
    model.vis.global_.azimuth, model.vis.global_.elevation = AZIMUTH, ELEVATION
    azimuth, elevation = np.radians([AZIMUTH, ELEVATION])
    away = -np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    camera = model.camera(OVERVIEW)
    camera.pos[:] = model.stat.center + 1.5 * span * away
    mujoco.mju_mat2Quat(camera.quat, np.stack([right, np.cross(away, right), away], axis=1).reshape(9))


def move_walls(model: mujoco.MjModel, drawn: Sequence[Shape], walls: Sequence[Surface]) -> list[Shape]:
    """Draw the walls of a model elsewhere, in the same number and of the same shapes; ``drawn`` is what this function
    has returned, or :func:`drawn_wall` of the walls that the model was made with."""
    shapes = [drawn_wall(wall) for wall in walls]
    for i, (old, new) in enumerate(zip(drawn, shapes, strict=True)):
        if new == old:
            continue
        (solid,) = solids(Geometry((new,), {}))
        skin = model.skin(f"{PREFIX}{_name(i)} 1").id
        first = model.skin_vertadr[skin]
        model.skin_vert[first : first + len(solid.vertices)] = solid.vertices
    return shapes
