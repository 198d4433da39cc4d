"""A vehicle's MJCF with every file that it refers to, in memory: what a run is built from and what its log carries."""

import os
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco

from .faults import InputError, suggestion
from .resources import names, resource

_FILE = re.compile(r"file(name|right|left|up|down|front|back)?")
"""Attributes that name a file."""
_FOLDERS = ("meshdir", "assetdir", "texturedir")
_XML = ("include", "model")
"""Elements whose file is XML again."""
_NAMED = ("hfield", "mesh", "skin", "texture")
"""Elements that without a name have that of their file."""
_COMMENT = re.compile(
    r"""(?P<comment><!--.*?-->)|<!\[CDATA\[.*?\]\]>|<[^!<>"'](?:[^<>"']|"[^"]*"|'[^']*')*>|<|[^<]+""", re.DOTALL
)


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
        path = Path(os.path.abspath(path))
        try:
            needed = {Path(os.path.abspath(file)) for file in mujoco.mju_getXMLDependencies(str(path))} - {path}
            contents = {file: file.read_bytes() for file in (path, *sorted(needed))}
        except (OSError, ValueError, RuntimeError, mujoco.FatalError) as error:
            raise InputError(f"vehicle.model {model}: can't read it: {_line(error)}") from None
        return cls(path.name, _flattened(contents))

    def spec(self) -> mujoco.MjSpec:
        """The model, parsed. No file is read but those in ``files``.

        Raises:
            InputError: MuJoCo can't read it, or it refers to a file that is not there.
        """
        trees = dict(_trees(self.files, self.name))
        missing = sorted({ref for tree in trees.values() for _, _, ref in _references(tree)} - self.files.keys())
        if missing:
            raise InputError(f"vehicle.model {self.name}: refers to what is not there: {', '.join(missing)}")
        # MuJoCo takes more for XML than what is well-formed: it gets what was checked, written anew
        texts = {name: ElementTree.tostring(tree) for name, tree in trees.items()}
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


def _trees(files: Mapping[str, bytes], name: str) -> Iterator[tuple[str, Element]]:
    """The model and the XML files that it includes, by name, parsed.

    Raises:
        InputError: one is not well-formed, or the model is no MJCF.
    """
    todo, done = [name], set()
    while todo:
        name = todo.pop()
        if name in done or name not in files:
            continue
        done.add(name)
        tree = _tree(name, files[name])
        if len(done) == 1 and tree.tag != "mujoco":
            raise InputError(f"vehicle.model {name}: is no MJCF: its root is <{tree.tag}>, not <mujoco>")
        todo += [reference for element, _, reference in _references(tree) if element.tag in _XML]
        yield name, tree


def _tree(name: str, data: bytes, comments: bool = False) -> Element:
    try:
        builder = ElementTree.TreeBuilder(insert_comments=comments)
        return ElementTree.fromstring(data, ElementTree.XMLParser(target=builder))
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the last two for an encoding
        raise InputError(f"vehicle.model {name}: is not well-formed XML: {error}") from None


def _references(tree: Element) -> Iterator[tuple[Element, str, str]]:
    """Each file that a tree names: the element, its attribute, and the file."""
    for element in tree.iter():
        yield from ((element, key, value) for key, value in element.attrib.items() if _FILE.fullmatch(key) and value)


def _flattened(contents: Mapping[Path, bytes]) -> dict[str, bytes]:
    """The same files without folders: no path of a user's stands in a log, and none of a log's is followed.

    Args:
        contents: by absolute path, the model's own first.
    """
    flat: dict[Path, str] = {}
    for path in contents:
        taken, name, n = {each.lower() for each in flat.values()}, path.name, 2  # MuJoCo's names know no capitals
        while name.lower() in taken:
            name, n = f"{path.stem}-{n}{path.suffix}", n + 1
        flat[path] = name
    main = next(iter(contents))
    trees, folders, todo = dict[Path, Element](), defaultdict[str, list[str]](list), [main]
    while todo:
        path = todo.pop()
        if path not in trees:
            trees[path] = _users_tree(path.name, contents[path])
            for compiler in trees[path].iter("compiler"):
                for key in _folders_of(compiler):
                    folders[key].append(compiler.attrib[key])
            named = [ref for element, _, ref in _references(trees[path]) if element.tag in _XML]
            todo += [_found(ref, contents, (main.parent, path.parent)) for ref in named]
    files = dict(zip(flat.values(), contents.values(), strict=True))
    for path, tree in trees.items():
        as_is = ElementTree.tostring(tree)
        for element, key, reference in list(_references(tree)):
            order = reversed(_FOLDERS) if element.tag == "texture" else _FOLDERS
            within = [] if element.tag in _XML else [folder for kind in order for folder in folders[kind]]
            places = [parent / folder for folder in (*within, "") for parent in (main.parent, path.parent)]
            found = _found(reference, contents, places)
            element.attrib[key] = flat[found]
            if key == "file" and element.tag in _NAMED and Path(flat[found]).stem != found.stem:
                element.attrib.setdefault("name", found.stem)
        for compiler in tree.iter("compiler"):
            for key in _folders_of(compiler):
                del compiler.attrib[key]
        text = ElementTree.tostring(tree)
        if text != as_is or not _is_well_formed(contents[path]):
            files[flat[path]] = text
    return files


def _folders_of(compiler: Element) -> list[str]:
    return [key for key in _FOLDERS if key in compiler.attrib]


def _users_tree(name: str, data: bytes) -> Element:
    """A user's own file, which MuJoCo read; without its comments, where it is not quite XML for their sake."""
    if _is_well_formed(data):
        return _tree(name, data, comments=True)
    text = data.decode("utf-8-sig", errors="surrogateescape")
    rest = _COMMENT.sub(lambda match: "" if match["comment"] else match[0], text).lstrip("\ufeff \t\r\n")
    return _tree(name, rest.encode("utf-8", errors="surrogateescape"))


def _is_well_formed(data: bytes) -> bool:
    try:
        _tree("", data)
    except InputError:
        return False
    return True


def _found(reference: str, contents: Mapping[Path, bytes], places: Iterable[Path]) -> Path:
    """The file that a reference means, sought in one folder after the other."""
    reference = reference.replace("\\", "/")
    for place in places:
        path = Path(os.path.abspath(place / reference))
        if path in contents:
            return path
    alike = [path for path in contents if path.name == PurePath(reference).name]  # as strippath asks for
    if len(alike) != 1:
        which = f"{reference!r} could be {len(alike)} of the files that MuJoCo reads"
        raise InputError(f"vehicle.model: {which}; give it a name of its own")
    return alike[0]
