"""Powers of units in texts, ``m/s^2``, as they are typeset. Code keeps its signs."""

import re
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

_POWER = re.compile(r"(?<=[\w|)])\^(?:\((\d/\d)\)|(-?\d+(?:\.\d+)?))")
_CODE = (nodes.literal, nodes.FixedTextElement, nodes.math, nodes.raw, addnodes.desc_signature)


def _raise(app: Sphinx, tree: nodes.document, docname: str) -> None:
    for text in list(tree.findall(nodes.Text)):
        above = text.parent
        while above is not None and not isinstance(above, _CODE):
            above = above.parent
        parts = [] if above else _POWER.split(text.astext())
        if len(parts) > 1:
            pieces: list[nodes.Node] = [nodes.Text(parts[0])]
            for fraction, number, behind in zip(parts[1::3], parts[2::3], parts[3::3], strict=True):
                pieces += [nodes.superscript("", fraction or number), nodes.Text(behind)]
            place = text.parent.index(text)
            text.parent[place : place + 1] = pieces


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("doctree-resolved", _raise)
    return {"parallel_read_safe": False, "parallel_write_safe": False}
