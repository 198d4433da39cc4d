"""A vehicle's MJCF with all files that it refers to, in memory. Runs are built from it, and logs contain it.

The copy is one flat set of files without folders, to which the references in the XML are changed. MuJoCo looks for a
file relative to the folder of its model, which is the main file or one named by ``<model file=...>``. ``meshdir`` or
``texturedir`` is inserted after that folder; the last setting counts. Included files belong to the model that includes
them (MuJoCo, XML reference, compiler and include).
"""

import contextlib
import functools
import os
import re
import stat
import struct
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from .. import display
from ..errors import InputError, suggestion
from ..files import is_file, shipped, shipped_file
from .geometry import Geometry
from .looks import add_vehicle
from .vehicle import Vehicle, free_body_id
from .vehicle_files import check_model, check_specs, check_xml


class MujocoWarning(UserWarning):
    """A warning of MuJoCo, e.g. of a state that is not finite."""


_lock = threading.Lock()
_collecting: dict[int, list[str]] = {}
"""Texts by thread: MuJoCo has one handler per process and calls it on the thread that steps."""
_before: list[Callable[[str], None] | None] = []


def _collect(text: str) -> None:
    texts = _collecting.get(threading.get_ident())
    if texts is not None:
        texts.append(text)
    elif _before and _before[0] is not None:
        _before[0](text)


@contextlib.contextmanager
def mujoco_warnings() -> Iterator[None]:
    """Collect this thread's warnings from MuJoCo, and issue each different one once at the end."""
    thread = threading.get_ident()
    with _lock:
        if not _collecting:
            _before[:] = [mujoco.get_mju_user_warning()]
            mujoco.set_mju_user_warning(_collect)
        outer = _collecting.get(thread)
        texts: list[str] = []
        _collecting[thread] = texts
    try:
        yield
    finally:
        with _lock:
            if outer is None:
                del _collecting[thread]
            else:
                _collecting[thread] = outer
            if not _collecting:
                mujoco.set_mju_user_warning(_before[0])
        for text in dict.fromkeys(texts):
            warnings.warn(f"MuJoCo: {text}", MujocoWarning, stacklevel=4)


DEEPEST = 100
"""Bound on the nesting of elements and on the included files of a model; MuJoCo's parser would overflow its stack."""
_FILE = re.compile(r"file(name|right|left|up|down|front|back)?")
LARGEST_XML, LARGEST_FILE, LARGEST_MODEL = 8 * 2**20, 64 * 2**20, 256 * 2**20
"""Bounds on an XML file, on any file, and on all files of a model together [bytes]."""
LARGEST_PICTURE = 2**26
"""Bound on the pixels of a picture; a compressed file of a few kilobytes may contain billions."""
_PNG = b"\x89PNG\r\n\x1a\n"
_NAMED = ("mesh", "texture")
"""Elements whose default name is the name of their file."""
_COMMENT = re.compile(
    r"""(?P<comment><!--.*?-->)|<!\[CDATA\[.*?\]\]>|<[^!<>"'](?:[^<>"']|"[^"]*"|'[^']*')*>|<|[^<]+""", re.DOTALL
)


def parsed(name: str, data: bytes, comments: bool = False) -> Element:
    """The root of an XML file. Raises InputError if the file is not well-formed, too large or nested too deeply."""
    if len(data) > LARGEST_XML:
        raise InputError(f"vehicle.model {name}: is larger than {LARGEST_XML // 2**20} MiB, too large for an XML file")
    try:
        builder = ElementTree.TreeBuilder(insert_comments=comments)
        tree = ElementTree.fromstring(data, ElementTree.XMLParser(target=builder))
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the last two for an encoding
        raise InputError(f"vehicle.model {name}: is not well-formed XML: {error}") from None
    level = [tree]
    for _ in range(DEEPEST):
        level = [child for element in level for child in element]
        if not level:
            return tree
    raise InputError(f"vehicle.model {name}: has elements nested more than {DEEPEST} deep")


def _references(element: Element) -> list[tuple[str, str]]:
    """The references of an element to files: attribute and file."""
    return [(key, value) for key, value in element.attrib.items() if _FILE.fullmatch(key) and value]


class ModelFiles:
    """The files that a model refers to, found as MuJoCo finds them. Raises InputError if a file is missing, or must be
    XML and is not."""

    def __init__(self, main: Path) -> None:
        self.contents: dict[Path, bytes] = {}
        self.trees: dict[Path, Element] = {}
        self.found: list[tuple[Path, Element, str, Path]] = []
        """File, element and attribute of each reference, and the file that it means."""
        self.places: dict[tuple[str, tuple[Path, ...]], Path] = {}
        """The path that a reference means, relative to folders."""
        self.models = [main]
        for model in self.models:  # grows in the loop
            self._model(model)

    def unchanged(self) -> bool:
        """Whether all references still mean the same files, with the same contents."""
        try:
            same = all(_place(*reference) == path for reference, path in self.places.items())
            return same and all(read_regular(path) == data for path, data in self.contents.items())
        except InputError:
            return False

    def flat(self) -> dict[str, bytes]:
        """The model and every file that it refers to, by names without folders, so that a log contains no path of the
        user. The main file is the first and keeps its name. Call it once."""
        names: dict[Path, str] = {}
        for path in self.contents:
            taken, name, n = {each.lower() for each in names.values()}, path.name, 2  # MuJoCo ignores case
            while name.lower() in taken:
                name, n = f"{path.stem}-{n}{path.suffix}", n + 1
            names[path] = name
        before = {path: ElementTree.tostring(tree) for path, tree in self.trees.items()}
        for _, element, key, target in self.found:
            element.attrib[key] = names[target]
            if key == "file" and element.tag in _NAMED and Path(names[target]).stem != target.stem:
                element.attrib["name"] = element.attrib.get("name") or target.stem
        files = {names[path]: data for path, data in self.contents.items()}
        for path, tree in self.trees.items():
            for compiler in tree.iter("compiler"):
                for key in ("meshdir", "texturedir", "assetdir", "strippath"):
                    compiler.attrib.pop(key, None)
            text = ElementTree.tostring(tree)
            if text != before[path] or not _is_well_formed(self.contents[path]):
                files[names[path]] = text
        return files

    def _model(self, path: Path) -> None:
        """Read one model: its file, its includes, and its assets in the folders set by its compiler elements."""
        folder, settings = path.parent, dict[str, str]()
        assets: list[tuple[Path, Element, str, str]] = []
        for file, element, key, reference in self._included(path, folder, settings, []):
            if element.tag == "model":
                target = self._read(self._place(reference, (folder, file.parent)))
                self.found.append((file, element, key, target))
                if target not in self.models:
                    self.models.append(target)
            else:
                assets.append((file, element, key, reference))
        for file, element, key, reference in assets:
            within = settings.get("texturedir" if element.tag == "texture" else "meshdir", "")
            if settings.get("strippath") == "true":
                reference = PurePath(reference.replace("\\", "/")).name
            target = self._place(reference, (folder / within, file.parent / within, folder, file.parent))
            self.found.append((file, element, key, self._read(target)))

    def _included(
        self, path: Path, folder: Path, settings: dict[str, str], before: list[Path]
    ) -> Iterator[tuple[Path, Element, str, str]]:
        """References of a file and its includes, in MuJoCo's order. Later compiler elements overwrite ``settings``."""
        if path in before or len(before) > DEEPEST:
            reason = "is included twice, or includes itself" if path in before else f"has more than {DEEPEST} includes"
            raise InputError(f"vehicle.model {path}: {reason}")
        before.append(path)
        self._read(path)
        if path not in self.trees:
            self.trees[path] = _users_tree(path.name, self.contents[path])
            if path == self.models[0]:
                _refuse_another_format(path.name, self.trees[path])
        for element in self.trees[path].iter():
            if element.tag == "compiler":
                if "assetdir" in element.attrib:
                    settings["meshdir"] = settings["texturedir"] = element.attrib["assetdir"]
                settings |= {k: v for k, v in element.attrib.items() if k in ("meshdir", "texturedir", "strippath")}
            for key, reference in _references(element):
                if element.tag == "include":
                    target = self._place(reference, (folder, path.parent))
                    self.found.append((path, element, key, target))
                    yield from self._included(target, folder, settings, before)
                else:
                    yield path, element, key, reference

    def _read(self, path: Path) -> Path:
        if path not in self.contents:
            self.contents[path] = read_regular(path)
            if sum(map(len, self.contents.values())) > LARGEST_MODEL:
                raise InputError(f"vehicle.model: its files are together larger than {LARGEST_MODEL // 2**20} MiB")
        return path

    def _place(self, reference: str, folders: tuple[Path, ...]) -> Path:
        path = self.places[reference, folders] = _place(reference, folders)
        return path


def _place(reference: str, folders: tuple[Path, ...]) -> Path:
    """The path in the first folder that has it, even as a pipe or a device; else the path in the first folder."""
    places = [Path(os.path.abspath(folder / reference.replace("\\", "/"))) for folder in folders]
    return next((place for place in places if os.path.exists(place) and not place.is_dir()), places[0])


def read_regular(path: Path) -> bytes:
    """The contents of a regular file. Devices and pipes are never read, as they may be endless or block. Raises
    InputError if the path is not a regular file, is too large, or can't be read."""
    try:
        # without O_NONBLOCK, opening a pipe waits for a writer
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
            status = os.fstat(file.fileno())
            readable = stat.S_ISREG(status.st_mode) and status.st_size <= LARGEST_FILE
            data = (file.read(LARGEST_FILE + 1) if readable else None) or b""  # None if a read would block
    except OSError as error:
        raise InputError(f"vehicle.model: can't read {path}: {error.strerror}") from None
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"vehicle.model: can't read {path}: it is not a regular file")
    if max(status.st_size, len(data)) > LARGEST_FILE:
        raise InputError(f"vehicle.model: can't read {path}: it is larger than {LARGEST_FILE // 2**20} MiB")
    return data


def trees(files: Mapping[str, bytes], main: str) -> dict[str, Element]:
    """The parsed and checked XML files of a flat model, by name.

    Raises:
        InputError: a file is not well-formed, is included twice, or refers to a missing file; a sub-model has
            sub-models itself; or the main file is not MJCF.
    """
    found: dict[str, Element] = {}

    def model(top: str) -> list[str]:
        """Parse a model's file and its includes. Returns the files of its sub-models."""
        parts, below = [top], list[str]()
        for name in parts:  # grows in the loop
            if name not in found:
                found[name] = parsed(name, files[name])
            named = [(element.tag, file) for element in found[name].iter() for _, file in _references(element)]
            missing = sorted({file for _, file in named} - (files.keys() - {main}))
            if missing:
                raise InputError(f"vehicle.model {main}: refers to missing files: {', '.join(missing)}")
            parts += [file for tag, file in named if tag == "include"]
            below += [file for tag, file in named if tag == "model"]
            if len(set(parts)) < len(parts) or len(parts) > DEEPEST:
                reason = f"includes itself, or a file twice, or more than {DEEPEST} files"
                raise InputError(f"vehicle.model {main}: {name} {reason}")
        return below

    for sub in dict.fromkeys(model(main)):
        if model(sub):  # MuJoCo reads it again at each reference
            raise InputError(f"vehicle.model {main}: {sub} is a sub-model and must not have sub-models itself")
    for name in files.keys() - found.keys():
        if files[name].startswith(_PNG) and len(files[name]) >= 24:
            width, height = struct.unpack_from(">II", files[name], 16)  # PNG (ISO 15948), 11.2.2
            if width * height > LARGEST_PICTURE:
                size = f"has {width} x {height} pixels; at most {LARGEST_PICTURE} allowed"
                raise InputError(f"vehicle.model {name}: {size}")
    _refuse_another_format(main, found[main])
    return found


_FORMATS = {"sdf": "SDF of Gazebo", "robot": "URDF"}


def _refuse_another_format(name: str, root: Element) -> None:
    """Raise InputError if the root of a vehicle's file is not MJCF's, before its references are followed."""
    if root.tag == "mujoco":
        return
    wrong = f"vehicle.model {name}: is not MJCF: its root is <{root.tag}>, not <mujoco>"
    if root.tag not in _FORMATS:
        raise InputError(wrong)
    way = f"`uvms-mj new vehicle NAME --from {name}` writes an MJCF file of it (docs: Bring your vehicle)"
    raise InputError(f"{wrong}. It is {_FORMATS[root.tag]}. {way}")


def _users_tree(name: str, data: bytes) -> Element:
    """The root of a user's file. Comments are removed if they make the XML malformed."""
    if _is_well_formed(data):
        return parsed(name, data, comments=True)
    text = data.decode("utf-8-sig", errors="surrogateescape")
    rest = _COMMENT.sub(lambda match: "" if match["comment"] else match[0], text).lstrip("\ufeff \t\r\n")
    return parsed(name, rest.encode("utf-8", errors="surrogateescape"))


def _is_well_formed(data: bytes) -> bool:
    try:
        parsed("", data)
    except InputError:
        return False
    return True


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
            known = shipped_file("models", str(model))
            if known is None:
                whole = f"{model}.xml"
                hint = f"did you mean {whole!r}?" if is_file(whole) else suggestion(model, shipped("models"))
                fault = (
                    "is not a regular file"
                    if os.path.exists(path)
                    else f"is neither a file nor a shipped model; {hint}"
                )
                raise InputError(f"vehicle.model {model!r}: {fault}")
            path, ships = known, True
        path = Path(os.path.abspath(path))
        kept = _found.pop(path, None)
        if kept is None or not kept[0].unchanged():
            files = ModelFiles(path)
            found = cls(path.name, files.flat(), ships)
            if len(found.files) > 1:
                found._check_against(path)
            kept = files, found
        _found[path] = kept  # the last one now
        for oldest in list(_found)[:-_MOST_FOUND]:
            _found.pop(oldest, None)
        return kept[1]

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
        """The picture in a notebook."""
        return display.html(self)

    def compiled(self, spec: mujoco.MjSpec) -> mujoco.MjModel:
        """Compile a spec of this model; raises InputError if MuJoCo can't."""
        with _compiling(self.name):
            # MuJoCo keeps meshes by the names of their files, and may take another vehicle's
            mujoco.mj_clearCache(mujoco.mj_getCache())
            return spec.compile()


_MOST_FOUND = 16
_found: dict[Path, tuple[ModelFiles, Mjcf]] = {}
"""The models that were found, so that a thousand runs read and compile a vehicle once."""


_REMEDIES = {
    "inertia must satisfy A + B >= C; use 'balanceinertia' to fix": "no rigid body has this inertia: none of its "
    "principal moments is greater than the sum of the other two; correct it, or make the greatest the sum",
}
"""Messages of MuJoCo that name a remedy which a vehicle's file must not have, and what is right here."""
_REMEDY = re.compile("|".join(map(re.escape, _REMEDIES)))


@contextlib.contextmanager
def _compiling(name: str | Path) -> Iterator[None]:
    """Turn an error of MuJoCo's compiler into an InputError."""
    try:
        yield
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        line = " ".join(_REMEDY.sub(lambda found: _REMEDIES[found[0]], str(error)).split())
        raise InputError(f"vehicle.model {name}: MuJoCo can't compile it: {line}") from None
