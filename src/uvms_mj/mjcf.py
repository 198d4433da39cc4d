"""A vehicle's MJCF with every file that it refers to, in memory: what a run is built from and what its log carries."""

import html
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePath

import mujoco

from .faults import InputError, suggestion
from .resources import names, resource

_REFERENCE = re.compile(rb"""(\bfile(?:name|right|left|up|down|front|back)?\s*=\s*)("[^"]*"|'[^']*')""")
"""Attributes that name a file. In the text as it is: MuJoCo reads more than what is well-formed XML."""
_FOLDER = re.compile(rb"""\b(?:meshdir|texturedir|assetdir)\s*=\s*(?:"[^"]*"|'[^']*')""")


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
            InputError: there is none, or a file that it refers to can't be read.
        """
        path = Path(model)
        if not path.is_file():
            shipped = resource("models", f"{model}.xml")
            if shipped is None:
                hint = suggestion(model, names("models", ".xml"))
                raise InputError(f"vehicle.model {model!r}: no such file, nor a model that ships; {hint}")
            path = shipped
        path = path.absolute()
        try:
            needed = {path, *(Path(file).absolute() for file in mujoco.mju_getXMLDependencies(str(path)))}
            contents = {file: file.read_bytes() for file in sorted(needed)}
        except (OSError, ValueError, mujoco.FatalError) as error:
            raise InputError(f"vehicle.model {model}: can't read it: {' '.join(str(error).split())}") from None
        return cls(path.name, _flattened(contents))

    def spec(self) -> mujoco.MjSpec:
        """The model, parsed. No file is read but those in ``files``.

        Raises:
            InputError: MuJoCo can't read it, or it refers to a file that is not there.
        """
        known = self.files.keys()
        if missing := sorted({ref for data in self.files.values() for ref in _references(data)} - known):
            raise InputError(f"vehicle.model {self.name}: refers to what is not there: {', '.join(missing)}")
        rest = {name: data for name, data in self.files.items() if name != self.name}
        try:
            return mujoco.MjSpec.from_string(self.files[self.name].decode(), include=rest, assets=rest)
        except (ValueError, mujoco.FatalError) as error:
            raise InputError(f"vehicle.model {self.name}: MuJoCo can't compile it: {_line(error)}") from None

    def compiled(self, spec: mujoco.MjSpec) -> mujoco.MjModel:
        """The model of a spec of this one's; raises InputError where MuJoCo can't compile it."""
        try:
            return spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            raise InputError(f"vehicle.model {self.name}: MuJoCo can't compile it: {_line(error)}") from None


def _line(error: Exception) -> str:
    return " ".join(str(error).split())


def _is_text(data: bytes) -> bool:
    """Whether MuJoCo could read a file as XML, rather than as a mesh or a picture."""
    return b"<" in data and b"\0" not in data


def _references(data: bytes) -> Iterator[str]:
    """The files that an XML file names, in its comments too; none if it is no XML."""
    if _is_text(data):
        yield from filter(None, (_name(match[2]) for match in _REFERENCE.finditer(data)))


def _name(quoted: bytes) -> str:
    return html.unescape(quoted[1:-1].decode(errors="replace"))


def _flattened(contents: Mapping[Path, bytes]) -> dict[str, bytes]:
    """The same files without folders: no path of a user's stands in a log, and none of a log's is followed."""
    flat: dict[Path, str] = {}
    for path in contents:
        taken, name, n = set(flat.values()), path.name, 2
        while name in taken:
            name, n = f"{path.stem}-{n}{path.suffix}", n + 1
        flat[path] = name

    def short(match: re.Match[bytes]) -> bytes:
        reference = _name(match[2])
        parts = [part for part in PurePath(reference.replace("\\", "/")).parts if part not in (".", "..", "/")]
        fits = [path for path in contents if path.parts[-len(parts) :] == tuple(parts)]
        if len(fits) > 1:
            raise InputError(f"vehicle.model: {reference!r} could be {len(fits)} files; give them different names")
        name = html.escape(flat[fits[0]]) if fits else ""  # what MuJoCo does not depend on stands in a comment
        return match[1] + f'"{name}"'.encode()

    files = {}
    for path, data in contents.items():
        if _is_text(data):
            data = _FOLDER.sub(b"", _REFERENCE.sub(short, data))
        files[flat[path]] = data
    return files
