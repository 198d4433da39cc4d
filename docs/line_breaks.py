"""No line of a page begins with the punctuation behind a formula or a name: both are in a box without a break."""

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

_PUNCTUATION = re.compile(r"[.,;:!?)\]]+")


def _tie(app: Sphinx, tree: nodes.document, docname: str) -> None:
    for text in list(tree.findall(nodes.Text)):
        place = text.parent.index(text)
        before = text.parent[place - 1] if place else None
        found = _PUNCTUATION.match(text)
        if found and isinstance(before, nodes.math | nodes.literal | nodes.reference):
            tied = nodes.inline("", "", before, nodes.Text(found.group()), classes=["tied"])
            text.parent[place - 1 : place + 1] = [tied, nodes.Text(text[found.end() :])]


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("doctree-resolved", _tie, priority=900)
    return {"parallel_read_safe": False, "parallel_write_safe": False}
