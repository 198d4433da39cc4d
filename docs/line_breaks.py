"""Where lines of a page may break: not before the punctuation behind a formula or a name, in a long name behind
a dot, an underscore or a slash, and between the words of an output whose longest line is no row of columns."""

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

_PUNCTUATION = re.compile(r"[.,;:!?)\]]+")
_NAMES = re.compile(r'(?<=<span class="pre">)[^<]+|(?<=<h1>)[\w.]+(?=<)|(?<=>)[\w./]+(?=</a>)')
_JOINTS = re.compile(r"(?<=[A-Za-z\]][._/])(?=[A-Za-z_]\w\w)")

_COLUMNS = re.compile(r"\S {2,}\S|[│┃|]")
_OUTPUTS = ("text", "none", "myst-ansi")
"""Languages of what a program prints."""


def _tie(app: Sphinx, tree: nodes.document, docname: str) -> None:
    for text in list(tree.findall(nodes.Text)):
        place = text.parent.index(text)
        before = text.parent[place - 1] if place else None
        found = _PUNCTUATION.match(text)
        if found and isinstance(before, nodes.math | nodes.literal | nodes.reference):
            tied = nodes.inline("", "", before, nodes.Text(found.group()), classes=["tied"])
            text.parent[place - 1 : place + 1] = [tied, nodes.Text(text[found.end() :])]
    for block in tree.findall(nodes.literal_block):
        longest = max(block.astext().splitlines(), key=len, default="")
        if block.get("language") in _OUTPUTS and not _COLUMNS.search(longest.strip()):
            block["classes"].append("sentences")


def _name(app: Sphinx, page: str, template: str, context: dict[str, Any], tree: nodes.document | None) -> None:
    context["body"] = _NAMES.sub(lambda found: _JOINTS.sub("<wbr>", found.group()), context.get("body", ""))
    for side in ("prev", "next"):
        if (link := context.get(side)) and re.fullmatch(r"[\w.]+", link["title"]):
            link["title"] = _JOINTS.sub("<wbr>", link["title"])


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("doctree-resolved", _tie, priority=900)
    app.connect("html-page-context", _name)
    return {"parallel_read_safe": False, "parallel_write_safe": False}
