"""Files of an MJCF model: the references in its XML, and a copy of all files as one flat set without folders.

MuJoCo looks for a file relative to the folder of its model, which is the main file or one named by
``<model file=...>``. ``meshdir`` or ``texturedir`` is inserted after that folder; the last setting counts. Included
files belong to the model that includes them (MuJoCo, XML reference, compiler and include).
"""

import os
import re
import stat
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePath
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from ..errors import InputError

DEEPEST = 100
"""Bound on the nesting of elements and on the included files of a model; MuJoCo's parser would overflow its stack."""
_FILE = re.compile(r"file(name|right|left|up|down|front|back)?")
LARGEST_XML, LARGEST_FILE, LARGEST_MODEL = 8 * 2**20, 64 * 2**20, 256 * 2**20
"""Bounds on an XML file, on any file, and on all files of a model together [bytes]."""
LARGEST_PICTURE = 2**26
"""Bound on the pixels of a picture; a compressed file of a few kilobytes may contain billions."""
_PNG = b"\x89PNG\r\n\x1a\n"
_NAMED = ("mesh", "texture")
"""Elements whose default name is that of their file."""
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
    if found[main].tag != "mujoco":
        raise InputError(f"vehicle.model {main}: is not MJCF: its root is <{found[main].tag}>, not <mujoco>")
    return found


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
