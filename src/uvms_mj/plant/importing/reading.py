"""Reading of files that others wrote: XML without entities, numbers with their place, and files in named folders only.

Nothing of a file is executed. A reference to another file is followed into the folder of the main file and into the
folders that the user named, nowhere else.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from ...errors import Fault, InputError, shortened, suggestion
from ..coefficients import LARGEST
from ..mjcf import DEEPEST

LARGEST_FILE = 10 * 2**20
"""Bound on each file [bytes]."""
_DECLARED = re.compile(r"<!(DOCTYPE|ENTITY)", re.IGNORECASE)
_NAMESPACE = re.compile(r"""\sxmlns\s*=\s*(?:"[^"]*"|'[^']*')""")
_PREFIX = re.compile(r"[<\s/]([A-Za-z_][\w.-]*):[A-Za-z_][\w.-]*(?=[\s=>/])")
_ROOT = re.compile(r"<([A-Za-z_][\w.:-]*)")


@dataclass
class Source:
    """A file that is read, the folders that it may refer to, its losses, and the decisions about it.

    Attributes:
        path: of the main file.
        packages: folders by the names of their packages, for ``$(find NAME)``, ``package://NAME`` and ``model://NAME``.
        said: sentences on what was left out and decided, each with the names of which it holds.
    """

    path: Path
    packages: Mapping[str, Path] = field(default_factory=dict)
    said: dict[str, list[str]] = field(default_factory=dict)

    def say(self, sentence: str, name: str = "") -> None:
        """Put a sentence on the list, once, with the name of an element of which it holds."""
        names = self.said.setdefault(sentence, [])
        if name and name not in names:
            names.append(name)

    def sentences(self) -> tuple[str, ...]:
        """The list, in which elements of one sentence stand together."""
        return tuple(f"{', '.join(names)}: {each}" if names else each for each, names in self.said.items())

    def fault(self, place: str, message: str) -> InputError:
        """The error of a place in the file."""
        return InputError([Fault(place, message)], str(self.path))

    def package(self, name: str, place: str) -> Path:
        """The folder of a package. Raises InputError if it is not named."""
        if name not in self.packages:
            known = f"; named are {', '.join(sorted(self.packages))}" if self.packages else ""
            raise self.fault(
                place, f"refers to the package {name!r}: name its folder with --package {name}=FOLDER{known}"
            )
        return self.packages[name].resolve()

    def within(self, path: Path, place: str) -> Path:
        """The real path of a file. Raises InputError if it is in none of the folders, or can't be looked up."""
        try:
            real = path.resolve()
            real.is_file()  # raises at a name that is too long
        except (OSError, RuntimeError, ValueError):  # RuntimeError: links that lead back, before Python 3.13
            reason = "can't be looked up: its name is too long, or its links lead back"
            raise self.fault(place, f"refers to {shortened(str(path))}, which {reason}") from None
        folders = [self.path.resolve().parent, *(folder.resolve() for folder in self.packages.values())]
        if not any(real.is_relative_to(folder) for folder in folders):
            reason = "is in none of the folders named: the file's own and --package NAME=FOLDER"
            raise self.fault(place, f"refers to {shortened(str(path))}, which {reason}")
        return real

    def referred(self, reference: str, place: str, beside: Path | None = None) -> Path:
        """The file that a reference means. Raises InputError if it is not in the folders named."""
        scheme, colon, rest = reference.strip().partition("://")
        if not colon:
            return self.within((beside or self.path.parent) / reference.strip(), place)
        if scheme in ("package", "model"):
            name, _, inside = rest.partition("/")
            return self.within(self.package(name, place) / inside, place)
        if scheme == "file":
            return self.within(Path(rest), place)
        raise self.fault(
            place, f"refers to {shortened(reference)}: a network is not read; download it, and name its folder"
        )

    def text(self, path: Path, place: str = "") -> str:
        """The text of a file in UTF-8. Raises InputError."""
        try:
            if not path.is_file():
                why = "it is not a regular file" if path.exists() else "there is no such file"
                raise self.fault(place, f"can't read {path.name}: {why}")
            with path.open("rb") as file:
                data = file.read(LARGEST_FILE + 1)
        except OSError as error:
            raise self.fault(place, f"can't read {path.name}: {error.strerror}") from None
        if len(data) > LARGEST_FILE:
            raise self.fault(place, f"{path.name} is larger than {LARGEST_FILE // 2**20} MiB")
        try:
            return data.decode("utf-8-sig")
        except UnicodeDecodeError:
            raise self.fault(place, f"{path.name} is not text in UTF-8") from None

    def xml(self, text: str, place: str = "") -> Element:
        """The root of an XML text. Raises InputError if it declares entities, or is not well-formed."""
        self.refuse_entities(text, place)
        text = re.sub(r"^\s*<\?xml.*?\?>", "", text, count=1, flags=re.DOTALL)
        text = _NAMESPACE.sub("", text)  # of elements without a prefix: neither format looks at it
        undeclared = sorted({*_PREFIX.findall(text)} - {*re.findall(r"xmlns:([\w.-]+)", text), "xmlns", "xml"})
        if undeclared:  # SDF's own readers don't look at prefixes
            names = "".join(f' xmlns:{each}="{each}"' for each in undeclared)
            bare = re.sub(r"<!--.*?-->", lambda found: " " * len(found[0]), text, flags=re.DOTALL)
            if root := _ROOT.search(bare):
                text = f"{text[: root.end()]}{names}{text[root.end() :]}"
        try:
            tree = ElementTree.fromstring(text)
        except (ElementTree.ParseError, ValueError) as error:
            raise self.fault(place, f"is not well-formed XML: {error}") from None
        level = [tree]
        for _ in range(DEEPEST):
            level = [child for element in level for child in element]
            if not level:
                return tree
        raise self.fault(place, f"has elements nested more than {DEEPEST} deep")

    def refuse_entities(self, text: str, place: str) -> None:
        if found := _DECLARED.search(text):
            raise self.fault(
                place, f"has a <!{found[1].upper()}>: entities are not read; write their text in their place"
            )

    def number(self, text: str | None, place: str) -> float:
        """A finite number. Raises InputError with its place."""
        return self.numbers(text, place, 1)[0]

    def numbers(self, text: str | None, place: str, *counts: int) -> list[float]:
        """Finite numbers, as many as one of the counts. Raises InputError with their place."""
        words = (text or "").split()
        found = []
        for each in words:
            try:
                found.append(float(each))
            except ValueError:
                raise self.fault(place, f"{shortened(each)} is not a number") from None
            if not abs(found[-1]) <= LARGEST:
                raise self.fault(place, f"{each} must be a finite number, at most {LARGEST:g}")
        if counts and len(found) not in counts:
            raise self.fault(place, f"has {len(found)} numbers; {' or '.join(map(str, counts))} are needed")
        return found

    def truth(self, text: str | None, place: str) -> bool:
        """Whether a word is true; missing is false. Raises InputError."""
        given = (text or "false").strip().lower()
        if given not in ("true", "false", "1", "0"):
            raise self.fault(place, f"{shortened(given)} must be true or false")
        return given in ("true", "1")


def place_of(*parts: Element | str) -> str:
    """The elements that lead to a place, as a reader finds them: ``<link name='base'> <inertial>``."""
    return " ".join(each if isinstance(each, str) else _written(each) for each in parts)


def _written(element: Element) -> str:
    tag = element.tag.rpartition("}")[2]
    name = element.get("name") or element.get("filename")
    return f"<{tag} name={name!r}>" if name else f"<{tag}>"


def one_of(source: Source, name: str, known: Iterable[str], place: str, noun: str) -> str:
    """A name that must be known. Raises InputError with the closest one."""
    known = list(known)
    if name not in known:
        raise source.fault(place, f"there is no {noun} {name!r}; {suggestion(name, known)}")
    return name


def positive(source: Source, value: float, place: str) -> float:
    """A number that must be positive. Raises InputError."""
    if not (value > 0.0 and math.isfinite(value)):
        raise source.fault(place, f"{value:g}: must be positive")
    return value
