"""``uvms-mj new``: a commented file of the user's own, which runs as it is."""

import keyword
from pathlib import Path

import click

from .common import bad_input, refuse_existing
from .options import command, force_option, path_option

KINDS = {
    "vehicle": ("vehicle.xml", "uvms-mj run --set vehicle.model={file}"),
    "scenario": ("scenario.toml", "uvms-mj run {file}"),
    "law": ("law.py", "uvms-mj run --controller {file}:{cls}"),
    "reference": ("reference.py", "uvms-mj run --set reference.name={file}:{cls}"),
    "sensor": ("sensor.py", "uvms-mj run --set navigation.name={file}:{cls}"),
    "observer": ("observer.py", "uvms-mj run --set observer.name={file}:{cls}"),
    "thrusters": ("thrusters.py", "uvms-mj run --set thrusters.name={file}:{cls}"),
}
"""Template and use of each kind. A template, in ``templates`` with the suffix ``.txt``, is a valid file about
``template_name`` with the class ``TemplateName``."""


@command()
@click.argument("kind", metavar="|".join(KINDS))
@click.argument("name")
@path_option("-o", "--out", metavar="FOLDER", default=".", help="Folder of the new file [default: here].")
@force_option
def new(kind: str, name: str, out: str, force: bool) -> None:
    """Write a commented file NAME.xml, NAME.toml or NAME.py, which runs as it is.

    \b
    uvms-mj new vehicle my_rov
    uvms-mj new law my_law
    """
    with bad_input():
        from ..errors import InputError
        from ..files import whole

        kind = kind if kind in KINDS else _kind_of(kind)
        cls = "".join(word[:1].upper() + word[1:] for word in name.split("_"))
        if not name.isascii() or any(not word.isidentifier() or keyword.iskeyword(word) for word in (name, cls)):
            hint = f"must be a word of letters, digits and _ that begins with a letter, as my_{kind}"
            raise InputError(f"NAME {name!r}: {hint}; --out names a folder")
        template, use = KINDS[kind]
        source = Path(__file__).parent / "templates" / f"{template}.txt"
        path = Path(out, f"{name}{Path(template).suffix}")
        refuse_existing("NAME", path, force)
        text = source.read_text(encoding="utf-8").replace("template_name", name).replace("TemplateName", cls)
        with whole(path) as part:
            part.write_text(text, encoding="utf-8")
    click.echo(f"{path}: {use.format(file=path, cls=cls)}")


def _kind_of(word: str) -> str:
    """The kind of file that a word for stages means: ``law`` of ``controller``. Raises InputError if there is none."""
    from ..errors import InputError, suggestion
    from ..scenario import STAGES
    from ..stages.words import tables_by_word

    tables = {table: table for table in STAGES} | tables_by_word(STAGES)
    for kind in KINDS:
        if word in tables and tables[word] == tables.get(kind):
            return kind
    raise InputError(f"{word!r}: is not a kind of file; {suggestion(word, KINDS)}")
