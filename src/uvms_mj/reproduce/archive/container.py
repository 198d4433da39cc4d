"""The container of an archive: a zip with archive.json, which has the digest of every other member.

A zip is checked whole before anything of it is used. A member is refused whose name is absolute, leaves the folder or
means another one's place, or which is a link, is not in archive.json, or does not have its digest. Nothing in a zip is
executed, imported or unpickled here. The same members give the same bytes of a zip.
"""

import contextlib
import dataclasses
import hashlib
import io
import json
import os
import shlex
import shutil
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import IO, Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from ...errors import InputError, faults_of, shortened
from ...files import atomic_write
from ...quantities import STRICT

MANIFEST, README = "archive.json", "README.md"
FORMAT = 1
MOST_BYTES = 8_000_000_000
"""Largest size of all members together, unpacked [bytes]."""
_MOST_OF_MANIFEST = 32_000_000
_BLOCK = 1 << 20
_DATE = (1980, 1, 1, 0, 0, 0)
KINDS = ("run", "study", "bench", "paper")


@dataclass(frozen=True, config=STRICT)
class Member:
    """The digest of a member and its size [bytes]."""

    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    size: Annotated[int, Field(ge=0)]


@dataclass(frozen=True, config=STRICT)
class Manifest:
    """The contents of archive.json.

    Attributes:
        format: version of this table.
        kind: what is repeated, one of :data:`KINDS`.
        name: of the run's scenario or the study, or of the experiment.
        command: the command that repeats it.
        versions: of the packages, Python and the machine that made it.
        about: what the kind needs to be repeated: texts and lists of texts by name.
        members: all other members by name.
    """

    format: int
    kind: str
    name: str
    command: str
    versions: Mapping[str, str]
    about: Mapping[str, Any]
    members: Mapping[str, Member]

    @property
    def digest(self) -> str:
        """Digest of archive.json: two archives with equal digests have the same members."""
        return hashlib.sha256(_text_of(self)).hexdigest()


_MANIFEST = TypeAdapter(Manifest)


def _text_of(manifest: Manifest) -> bytes:
    tables = _MANIFEST.dump_python(manifest, mode="json")
    return (json.dumps(tables, indent=1, sort_keys=True, ensure_ascii=False) + "\n").encode()


def write(path: Path, manifest: Manifest, members: Mapping[str, bytes | Path]) -> Manifest:
    """Write an archive of these members, contents or files by name, and return its manifest with their digests. An
    existing file is replaced when the new one is whole. Raises InputError if a member can't be read or named so."""
    for name in members:
        if wrong := _wrong_name(name):
            raise InputError(f"{name}: can't be a member of an archive: it {wrong}")
    with atomic_write(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as file:
        found = {name: _put(file, name, each) for name, each in sorted(members.items())}
        whole = dataclasses.replace(manifest, members=found)
        with file.open(_info(MANIFEST), "w") as place:
            place.write(_text_of(whole))
    return whole


def _info(name: str) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name, _DATE)
    info.compress_type, info.create_system = zipfile.ZIP_DEFLATED, 3
    info.external_attr = (stat.S_IFREG | 0o644) << 16
    return info


def _put(file: zipfile.ZipFile, name: str, contents: bytes | Path) -> Member:
    digest, size = hashlib.sha256(), 0
    with contextlib.ExitStack() as stack:
        place = stack.enter_context(file.open(_info(name), "w", force_zip64=True))
        if isinstance(contents, Path):
            source = stack.enter_context(contents.open("rb"))
            blocks: Iterator[bytes] = iter(lambda: source.read(_BLOCK), b"")
        else:
            blocks = iter([contents])
        for block in blocks:
            place.write(block)
            digest.update(block)
            size += len(block)
    return Member(digest.hexdigest(), size)


def is_archive(path: str | None) -> bool:
    """Whether a name is an archive's, by its ending; its contents are checked when it is read."""
    return path is not None and path.lower().endswith(".zip")


def read(path: Path) -> Manifest:
    """The manifest of an archive whose members are all there, and no others, each with its digest. Raises InputError
    for anything else, and names what is wrong."""
    with _opened(path) as file:
        return _checked(file)


def contents(path: Path, manifest: Manifest, name: str) -> bytes:
    """The contents of a member of an archive with this manifest. Raises InputError unless they have their digest."""
    found = io.BytesIO()
    with _opened(path) as file:
        _copy(file, name, manifest.members[name], found)
    return found.getvalue()


def extract(path: Path, folder: Path) -> Manifest:
    """Check an archive, then write its members to a new folder. A folder that has exactly these members is left as it
    is. Raises InputError as :func:`read` does, and if the folder has anything else."""
    with _opened(path) as file:
        manifest = _checked(file)
        if os.path.lexists(folder):
            _refuse_another(manifest, folder)
            return manifest
        folder.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=".uvms-mj-", dir=folder.parent))
        try:
            for name, member in manifest.members.items():
                place = part / name
                place.parent.mkdir(parents=True, exist_ok=True)
                with place.open("xb") as target:
                    _copy(file, name, member, target)
            (part / MANIFEST).write_bytes(_text_of(manifest))
            part.chmod(0o755)
            os.rename(part, folder)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise
    return manifest


def _refuse_another(manifest: Manifest, folder: Path) -> None:
    """Raise InputError unless a folder has the members of an archive and nothing else."""
    expected = {name: member.sha256 for name, member in manifest.members.items()}
    expected[MANIFEST] = manifest.digest
    there = {each.relative_to(folder).as_posix(): each for each in folder.rglob("*") if not each.is_dir()}
    wrong = [name for name in there if name not in expected]
    wrong += [name for name, digest in expected.items() if name not in there or _digest_at(there[name]) != digest]
    wrong += [folder.name] if folder.is_symlink() else []
    if wrong:
        raise InputError(f"{folder}: is not this archive, unpacked: {_some(wrong)} differ; choose another --out")


def _digest_at(place: Path) -> str:
    """The digest of a regular file; empty for a link or anything else."""
    return hashlib.sha256(place.read_bytes()).hexdigest() if stat.S_ISREG(place.lstat().st_mode) else ""


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
    """A zip, and the errors of reading it as one InputError."""
    try:
        if not path.is_file():
            raise InputError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}")
        with zipfile.ZipFile(path) as file:
            yield file
    except InputError as error:
        raise InputError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from None
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError) as error:
        raise InputError(f"{path}: is not a whole zip: {error}") from None
    except OSError as error:
        raise InputError(f"{error.filename or path}: {error.strerror or error}") from None


def _checked(file: zipfile.ZipFile) -> Manifest:
    """The manifest of a zip in which all is as it says."""
    infos = {info.filename: info for info in file.infolist()}
    for info in file.infolist():
        if wrong := _wrong_member(info):
            raise InputError(f"is refused: the member {shortened(info.orig_filename)} {wrong}")
    if twice := _same_place([info.filename for info in file.infolist()]):
        raise InputError(f"is refused: the members {_some(twice)} mean one place")
    if MANIFEST not in infos:
        raise InputError(f"is a zip, but not one that `uvms-mj archive` wrote: it has no {MANIFEST}")
    manifest = _manifest_of(file, infos.pop(MANIFEST))
    if missing := [name for name in manifest.members if name not in infos]:
        raise InputError(f"is refused: {_some(missing)} is missing")
    if others := [name for name in infos if name not in manifest.members]:
        raise InputError(f"is refused: {MANIFEST} does not know {_some(others)}")
    if sum(member.size for member in manifest.members.values()) > MOST_BYTES:
        raise InputError(f"is refused: its members have more than {MOST_BYTES / 1e9:g} GB")
    for name, member in manifest.members.items():
        _copy(file, name, member)
    return manifest


def _manifest_of(file: zipfile.ZipFile, info: zipfile.ZipInfo) -> Manifest:
    if info.file_size > _MOST_OF_MANIFEST:
        raise InputError(f"is refused: {MANIFEST} has {info.file_size / 1e6:.4g} MB")
    with file.open(info) as source:
        data = source.read(_MOST_OF_MANIFEST)
    try:
        found = json.loads(data)
        if isinstance(found, dict) and isinstance(found.get("format"), int) and found["format"] != FORMAT:
            raise InputError(f"has the format {shortened(found['format'])}; this version reads format {FORMAT}")
        manifest = _MANIFEST.validate_python(found)
        _text_of(manifest)  # which fails for tables that are nested too deeply
    except InputError:
        raise
    except ValidationError as error:
        raise InputError(faults_of(error), MANIFEST) from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{MANIFEST} can't be read: {error}") from None
    if manifest.kind not in KINDS:
        raise InputError(f"{MANIFEST}: the kind {shortened(manifest.kind)} is not one of {', '.join(KINDS)}")
    if not manifest.name.isprintable() or not _is_command(manifest):
        raise InputError(f"{MANIFEST}: the name or the command {shortened(manifest.command)} is none of an archive's")
    return manifest


def command_of(kind: str, name: str) -> str:
    """The command that repeats an archive in a file of this name."""
    return shlex.join(["uvms-mj", kind, "--from", name, "--out", "repeated"])


def _is_command(manifest: Manifest) -> bool:
    """Whether the command repeats the archive: a reader who copies it runs nothing else."""
    try:
        name = shlex.split(manifest.command)[3]
    except (ValueError, IndexError):
        return False
    return manifest.command.isprintable() and manifest.command == command_of(manifest.kind, name)


def _copy(file: zipfile.ZipFile, name: str, member: Member, target: IO[bytes] | None = None) -> None:
    """Read a member, and write it to ``target``. Raises InputError unless it has its size and digest."""
    digest, left = hashlib.sha256(), member.size
    with file.open(name) as source:
        while block := source.read(_BLOCK):
            left -= len(block)
            if left < 0:
                break
            digest.update(block)
            if target is not None:
                target.write(block)
    if left or digest.hexdigest() != member.sha256:
        raise InputError(f"is refused: {name} was changed since the archive was made: its digest is another one")


def _wrong_member(info: zipfile.ZipInfo) -> str:
    """The fault of a member of a zip; empty if it has none."""
    if info.orig_filename != info.filename:
        return "has a name that is no path"
    mode = stat.S_IFMT(info.external_attr >> 16)
    if mode == stat.S_IFLNK:
        return "is a link"
    if info.is_dir() or mode not in (0, stat.S_IFREG):
        return "is not a regular file"
    if info.flag_bits & 1:
        return "is encrypted"
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        return "is compressed in an unknown way"
    return _wrong_name(info.filename)


def _wrong_name(name: str) -> str:
    """The fault of the name of a member; empty for a relative path below the folder on every system."""
    if name.startswith("/") or PureWindowsPath(name).drive or "\\" in name or ":" in name:
        return "has an absolute path, or one of another system"
    if ".." in name.split("/"):
        return "leaves the folder: '..'"
    if not name.isprintable() or len(name.encode(errors="replace")) > 1000 or str(PurePosixPath(name)) != name:
        return "has a name that is no plain path"
    return ""


def _same_place(names: list[str]) -> list[str]:
    """Names that mean one file, or a file and a folder, also where the system does not tell case."""
    folders = {str(above).casefold() for name in names for above in PurePosixPath(name).parents}
    seen, found = set[str](), []
    for name in names:
        if (key := name.casefold()) in seen or key in folders:
            found.append(name)
        seen.add(key)
    return found


def _some(names: list[str]) -> str:
    return ", ".join(sorted(map(shortened, names))[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
