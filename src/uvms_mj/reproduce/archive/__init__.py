"""Archives for reviewers: one zip with the logs or rows, all that the runs read, versions and digests."""

from collections.abc import Mapping
from pathlib import Path

from . import container
from .contents import Contents, contents_of

_WHAT = {"run": "a run", "study": "a study", "bench": "a result of the benchmark", "paper": "the paper's runs"}
_EQUAL = {
    "run": "every sample and every file of the log, all but its wall time",
    "study": "every number of the rows, and every sample of the logs that were kept",
    "bench": "every byte of bench.json but the versions and the digest over them",
    "paper": "every sample of the logs, and every claim",
}


def archive(source: Path, out: Path, secret: Path | None = None) -> tuple[container.Manifest, tuple[str, ...]]:
    """Write the archive of a log or of a folder to a file, which is replaced, and return its manifest and notes.
    ``secret`` is the file of a result's blind draws. Raises InputError if it can't be repeated."""
    found = contents_of(source, secret)
    command = container.command_of(found.kind, out.name)
    members = {**found.members, container.README: _readme(found, command).encode()}
    empty = container.Manifest(container.FORMAT, found.kind, found.name, command, found.versions, found.about, {})
    return container.write(out, empty, members), found.notes


def _readme(found: Contents, command: str) -> str:
    members: Mapping[str, str] = {
        "results/": "what came out",
        "files/": "laws, files that they import or read, vehicles, FMUs, libraries",
        "scenario.toml": "the scenario with every key",
        "study.toml": "the study with every key",
        "laws.toml": "the laws with their settings",
        container.MANIFEST: "versions, and the SHA-256 of each file",
    }
    here = {name: text for name, text in members.items() if any(each.startswith(name) for each in found.members)}
    here[container.MANIFEST] = members[container.MANIFEST]
    table = "\n".join(f"- `{name}`: {text}" for name, text in here.items())
    of = "\n".join(f"- {name} {version}" for name, version in found.versions.items())
    packages = " ".join(f"{name}=={found.versions[name]}" for name in ("mujoco", "numpy", "llvmlite", "mcap"))
    notes = "".join(f"\nNote: {note}.\n" for note in found.notes)
    return f"""# {found.name}: {_WHAT[found.kind]} of uvms-mj

This command repeats it and compares it with the archive:

```sh
{command}
```

It executes the laws of the archive. It compares {_EQUAL[found.kind]}, and its exit status is 1 where one differs. The
bits are promised for the versions and the kind of machine below. `uvms-mj info FILE.zip` checks all digests and
executes nothing.

{table}
{notes}
It needs uvms-mj {found.versions["uvms-mj"]}. Where it is installed, `pip install {packages}` gives its packages the
versions of the archive: of these NumPy decides last digits, since its OpenBLAS computes numbers of the set-up, such as
the pseudoinverse of the thrusters.

Made with:

{of}
"""
