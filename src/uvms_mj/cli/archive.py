"""``uvms-mj archive``, and what commands do with an archive that ``--from`` names."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .common import bad_input, printable, refuse_existing, warn, warn_of_versions
from .options import command, force_option, json_option, path_argument, path_option

if TYPE_CHECKING:
    from ..reproduce.archive.container import Manifest

EXIT_DIFFERS = 1


@command("archive")
@path_argument("source", metavar="RUN|STUDY|BENCH|PAPER")
@path_option("-o", "--out", required=True, metavar="FILE.zip", help="The archive.")
@path_option("--secret", metavar="FILE", help="Of a bench with draws of a secret: its file, which becomes a member.")
@force_option
@json_option
def archive(source: str, out: str, secret: str | None, force: bool, as_json: bool) -> None:
    """Write one zip with all that a reviewer needs to repeat a run, a study, a bench or the paper.

    RUN is a log, or the folder of a run; the others are folders. The zip has logs or rows; laws with the files that
    they import and read; vehicles with meshes, FMUs, libraries; the scenario or study with every key; versions, a
    digest of each file, and a README with the command that repeats it. All paths in it are relative.

    Nothing is executed. The archive has each file as it was in the run. A file that has changed since, and whose old
    contents no record has, is refused.

    \b
    uvms-mj archive results --out run.zip
    uvms-mj archive runs/monte_carlo --out study.zip
    uvms-mj info study.zip                            its contents; every digest is checked
    uvms-mj study --from study.zip --out repeated     runs it, and compares each row
    """
    with bad_input():
        from ..errors import InputError
        from ..reproduce.archive import archive as write

        path = Path(out)
        if path.suffix.lower() != ".zip":
            raise InputError(f"--out {out}: the name must end in .zip")
        refuse_existing("--out", path, force)
        manifest, notes = write(Path(source), path, None if secret is None else Path(secret))
    for note in notes:
        warn(note)
    if as_json:
        click.echo(json.dumps({"archive": out, **about(manifest)}))
        return
    size = path.stat().st_size
    click.echo(printable(f"{out}: {len(manifest.members)} files, {size / 1e6:.2g} MB, sha256 of {manifest.digest}"))
    click.echo(manifest.command)


def about(manifest: "Manifest") -> dict[str, Any]:
    """The report of ``--json`` of an archive."""
    members = {name: {"sha256": each.sha256, "size": each.size} for name, each in manifest.members.items()}
    whole = {name: getattr(manifest, name) for name in ("kind", "name", "command", "digest")}
    return whole | {"versions": dict(manifest.versions), "members": members}


def unpacked(source: str, kind: str, out: str | None) -> "tuple[Path, Path, Manifest]":
    """Check an archive of a kind and unpack it into the output folder, by default runs/<name of the zip>. Returns the
    output folder, the folder of the members, and the manifest. Warns of other versions. Raises InputError if it is
    none, or of another kind."""
    from ..errors import InputError
    from ..files import locked
    from ..reproduce.archive.container import extract, read
    from ..reproduce.archive.contents import refuse_unfit
    from ..reproduce.archive.repeated import UNPACKED
    from ..studies.bundle import code

    path = Path(source)
    found = read(path)
    if found.kind != kind:
        raise InputError(f"{path}: is the archive of a {found.kind}: {found.command}")
    refuse_unfit(path, found)
    folder = Path(out or Path("runs", path.stem))
    place = folder / UNPACKED
    with locked(folder):
        manifest = extract(path, place)
    if kind != "run":  # its log has the same versions, of which the run warns
        warn_of_versions(manifest.versions, code())
    return folder, place, manifest


def compared(kind: str, folder: Path, quiet: bool = False) -> int:
    """Compare the results of a folder with its unpacked archive, say what differs, and return the exit status."""
    from ..reproduce.archive.repeated import differences

    found = differences(kind, folder)
    if not found:
        if not quiet:
            click.echo("equal to the archive", err=True)
        return 0
    more = f"\nand {len(found) - 10} more" if len(found) > 10 else ""
    lines = "\n".join(f"- {each}" for each in found[:10])
    click.echo(printable(f"differs from the archive:\n{lines}{more}\n{_of_rounding(folder)}"), err=True)
    return EXIT_DIFFERS


def _of_rounding(folder: Path) -> str:
    """Why the last digits of a repetition may differ: the linear algebra of its set-up is another one."""
    from ..records.header import versions
    from ..reproduce.archive.container import MANIFEST
    from ..reproduce.archive.repeated import UNPACKED

    then = json.loads((folder / UNPACKED / MANIFEST).read_bytes())["versions"].get("numpy", "")
    numbers = "numbers of the set-up, such as the pseudoinverse of the thrusters, to other last digits"
    if then not in ("", versions()["numpy"]):
        return f"The OpenBLAS of another NumPy computes {numbers}. Install numpy {then} to repeat them."
    return f"NumPy is the same; for another kind of processor its OpenBLAS computes {numbers}."
