"""A vehicle's MJCF with every file that it refers to, in memory: what a run is built from and what its log carries."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from .faults import InputError, suggestion
from .mjcf_files import flattened, trees
from .resources import names, resource
from .vehicle_files import check_elements

_COMPARED = ("mesh_vert", "mesh_face", "tex_data", "geom_size", "body_mass", "names")


@dataclass(frozen=True)
class Mjcf:
    """An MJCF model, complete by itself.

    Attributes:
        name: file name of the model.
        files: contents by file name: the model's own, and those of all includes, meshes and textures. No folders.
    """

    name: str
    files: Mapping[str, bytes] = field(repr=False)

    @classmethod
    def find(cls, model: str) -> "Mjcf":
        """A model from the path of a file, or one that ships by its name.

        Raises:
            InputError: there is none, or it or a file that it refers to can't be read or has what a vehicle's file may
                not have.
        """
        path = Path(model)
        if not path.is_file():
            shipped = resource("models", f"{model}.xml")
            if shipped is None:
                hint = suggestion(model, names("models", ".xml"))
                fault = "is not a regular file" if path.exists() else f"no such file, nor a model that ships; {hint}"
                raise InputError(f"vehicle.model {model!r}: {fault}")
            path = shipped
        path = Path(os.path.abspath(path))
        found = cls(path.name, flattened(path))
        if len(found.files) > 1:
            found._check_against(path)
        return found

    def _check_against(self, path: Path) -> None:
        """Raise InputError unless the flat files make what MuJoCo makes of the folders: it has the last word on which
        file a name means."""
        ours = self.compiled(self.spec())
        try:
            theirs = mujoco.MjModel.from_xml_path(str(path))
        except (ValueError, RuntimeError, mujoco.FatalError) as error:
            raise InputError(f"vehicle.model {path}: MuJoCo can't compile it: {_line(error)}") from None
        for name in _COMPARED:
            if not np.array_equal(getattr(ours, name), getattr(theirs, name)):
                raise InputError(
                    f"vehicle.model {path}: without its folders it would be another model ({name} differs); "
                    "give each file a plain name of its own"
                )

    def spec(self) -> mujoco.MjSpec:
        """The model, parsed. No file is read but those in ``files``.

        Raises:
            InputError: it has what a vehicle's file may not have, MuJoCo can't read it, or it refers to a file that is
                not there.
        """
        parsed = trees(self.files, self.name)
        check_elements(parsed, self.name)
        # MuJoCo takes more for XML than what is well-formed: it gets what was checked, written anew
        texts = {name: ElementTree.tostring(tree) for name, tree in parsed.items()}
        rest = {name: texts.get(name, data) for name, data in self.files.items() if name != self.name}
        try:
            return mujoco.MjSpec.from_string(texts[self.name].decode(), include=rest, assets=rest)
        except (ValueError, RuntimeError, mujoco.FatalError) as error:
            raise InputError(f"vehicle.model {self.name}: MuJoCo can't compile it: {_line(error)}") from None

    def compiled(self, spec: mujoco.MjSpec) -> mujoco.MjModel:
        """The model of a spec of this one's; raises InputError where MuJoCo can't compile it."""
        try:
            return spec.compile()
        except (ValueError, RuntimeError, mujoco.FatalError) as error:
            raise InputError(f"vehicle.model {self.name}: MuJoCo can't compile it: {_line(error)}") from None


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
