"""A vehicle's MJCF with all files that it refers to, in memory. Runs are built from it, and logs contain it."""

import contextlib
import functools
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from .. import display
from ..errors import InputError, suggestion
from ..files import is_file, shipped
from .geometry import Geometry
from .looks import add_vehicle
from .mjcf_files import ModelFiles, trees
from .vehicle import Vehicle, free_body_id
from .vehicle_files import check_model, check_specs, check_xml

_COMPARED = ("mesh_vert", "mesh_face", "tex_data", "geom_size", "body_mass", "names")


@dataclass(frozen=True)
class Mjcf:
    """An MJCF model: its file name, and the contents of all its files by name, without folders: the model's file, and
    all includes, meshes and textures. One that ships was checked by a test, which saves a start 25 ms."""

    name: str
    files: Mapping[str, bytes] = field(repr=False)
    ships: bool = field(default=False, repr=False, compare=False)

    @classmethod
    def find(cls, model: str) -> "Mjcf":
        """Read a model from the path of its file, or a shipped model by its name. Raises InputError if there is no such
        model, or it or a file that it refers to can't be read or has something that is not allowed in a vehicle's
        file."""
        path, ships = Path(model), False
        if not is_file(path):
            known = shipped("models")
            if str(model) not in known:
                hint = suggestion(model, known)
                fault = (
                    "is not a regular file"
                    if os.path.exists(path)
                    else f"is neither a file nor a shipped model; {hint}"
                )
                raise InputError(f"vehicle.model {model!r}: {fault}")
            path, ships = known[str(model)], True
        path = Path(os.path.abspath(path))
        if path not in _found or not _found[path][0].unchanged():
            files = ModelFiles(path)
            found = cls(path.name, files.flat(), ships)
            if len(found.files) > 1:
                found._check_against(path)
            if len(_found) >= _MOST_FOUND:
                _found.clear()
            _found[path] = files, found
        return _found[path][1]

    def _check_against(self, path: Path) -> None:
        """Raise InputError unless MuJoCo compiles the same model from the files in their folders. MuJoCo decides which
        file a name means."""
        ours = self.compiled(self.spec())
        with _compiling(path):
            theirs = mujoco.MjModel.from_xml_path(str(path))
        for name in _COMPARED:
            if not np.array_equal(getattr(ours, name), getattr(theirs, name)):
                raise InputError(
                    f"vehicle.model {path}: the model changes when its files are put into one folder ({name} differs); "
                    "give each file a different, plain name"
                )

    @functools.cached_property
    def _read(self) -> tuple[Vehicle, Geometry, np.ndarray, float]:
        whole = self.compiled(self.spec())
        check_model(whole, self.name)
        vehicle, gravity_W = Vehicle.from_model(whole, file=self.name), whole.opt.gravity.copy()
        gravity_W.setflags(write=False)
        body = free_body_id(whole, vehicle.body)
        return vehicle, Geometry.of(whole, body, vehicle.arm.links), gravity_W, float(whole.body_invweight0[body, 0])

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle's coefficients. Raises InputError if the model is not one physical vehicle."""
        return self._read[0]

    @property
    def geometry(self) -> Geometry:
        """The vehicle's shapes. Raises InputError as :attr:`vehicle` does."""
        return self._read[1]

    @property
    def gravity_W(self) -> np.ndarray:
        """(3,) acceleration of gravity [m/s^2]. Raises InputError as :attr:`vehicle` does."""
        return self._read[2]

    @property
    def remarks(self) -> dict[str, str]:
        """The ``<text>`` entries by name. Raises InputError as :meth:`spec` does."""
        return {text.name: text.data for text in self._parsed.texts}

    @property
    def inverse_weight(self) -> float:
        """MuJoCo's inverse mass of the vehicle's body, without added mass [1/kg]. Raises InputError as :attr:`vehicle`
        does."""
        return self._read[3]

    def spec(self) -> mujoco.MjSpec:
        """A copy of the parsed model. Only the files in ``files`` are read, once. Raises InputError if the model has
        something that is not allowed in a vehicle's file, MuJoCo can't read it, or it refers to a missing file."""
        return self._parsed.copy()

    @functools.cached_property
    def _parsed(self) -> mujoco.MjSpec:
        parsed = trees(self.files, self.name)
        if not self.ships:
            check_xml(parsed, self.name)
        # MuJoCo also accepts malformed XML, so it gets the checked trees, written anew
        texts = {name: ElementTree.tostring(tree) for name, tree in parsed.items()}
        rest = {name: texts.get(name, data) for name, data in self.files.items() if name != self.name}
        parts = {each.get("file", "") for tree in parsed.values() for each in tree.iter("model")} - {""}
        with _compiling(self.name):
            specs = [
                mujoco.MjSpec.from_string(texts[each].decode(), rest, rest) for each in (self.name, *sorted(parts))
            ]
        if not self.ships:
            check_specs(specs, parsed, self.name)
        with _compiling(self.name):
            spec = specs[0]
            if len(spec.copy().actuators) < len(spec.actuators):
                spec.compile()  # it names the motor without a site or a joint, which a copy loses without a word
            return spec

    def drawn_spec(self) -> mujoco.MjSpec:
        """A copy of the parsed model with the looks of the vehicle as skins. Raises InputError as :attr:`vehicle`
        does."""
        return self._drawn.copy()

    @functools.cached_property
    def _drawn(self) -> mujoco.MjSpec:
        spec = self.spec()
        add_vehicle(spec, self.vehicle.body, self.geometry)
        return spec

    def __reduce__(self) -> tuple[Any, ...]:
        """The files alone: MuJoCo's parsed model can't be pickled."""
        return type(self), (self.name, dict(self.files))

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        return display.html(self)

    def compiled(self, spec: mujoco.MjSpec) -> mujoco.MjModel:
        """Compile a spec of this model; raises InputError if MuJoCo can't."""
        with _compiling(self.name):
            # MuJoCo keeps meshes by the names of their files, and may take that of another vehicle
            mujoco.mj_clearCache(mujoco.mj_getCache())
            return spec.compile()


_MOST_FOUND = 16
_found: dict[Path, tuple[ModelFiles, Mjcf]] = {}
"""The models that were found, so that a thousand runs read and compile a vehicle once."""


@contextlib.contextmanager
def _compiling(name: str | Path) -> Iterator[None]:
    """Turn an error of MuJoCo's compiler into an InputError."""
    try:
        yield
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        line = " ".join(str(error).split())
        raise InputError(f"vehicle.model {name}: MuJoCo can't compile it: {line}") from None
