"""Links of pages and of the API into the repository: each file that a link names is a page with numbered lines.

A page links to ``../../src/uvms_mj/physics/flow.py``, as it does in a checkout, or to a definition in it,
``flow.py#added_mass``. The link of a folder leads to a list of its files.
"""

import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import TextLexer, get_lexer_for_filename
from pygments.util import ClassNotFound
from sphinx.application import Sphinx

ROOT = Path(__file__).parents[1]
_LINK = re.compile(
    r"\]\((?:\.\./)*((?:src|tests|scripts|examples|models|CITATION\.cff|CODE_OF_CONDUCT\.md|LICENSE|SECURITY\.md|pyproject\.toml)\b[^)\s]*)\)"
)


def line_of(path: Path, name: str) -> int:
    """The line of a function, class, method ``Class.method`` or constant in a Python file. Raises KeyError."""
    body: list[ast.stmt] = ast.parse(path.read_text()).body
    line = 0
    for part in name.split("."):
        named = {}
        for each in body:
            if isinstance(each, ast.FunctionDef | ast.ClassDef):
                named[each.name] = each
            elif isinstance(each, ast.Assign | ast.AnnAssign):
                targets = each.targets if isinstance(each, ast.Assign) else [each.target]
                named |= {target.id: each for target in targets if isinstance(target, ast.Name)}
        line, body = named[part].lineno, getattr(named[part], "body", [])
    return line


def linkcode_resolve(domain: str, info: dict[str, str]) -> str | None:
    """The line of an object's source, for ``sphinx.ext.linkcode``."""
    if domain != "py" or not info["fullname"]:
        return None
    import uvms_mj  # what the API describes

    value: Any = __import__(info["module"], fromlist=["x"]) if info["module"] else uvms_mj
    try:
        for part in info["fullname"].split("."):
            value = inspect.getattr_static(value, part) if inspect.isclass(value) else getattr(value, part)
        value = inspect.unwrap(getattr(value, "fget", None) or getattr(value, "__func__", value))
        path, (_, line) = Path(inspect.getfile(value)), inspect.getsourcelines(value)
    except (AttributeError, TypeError, OSError):
        return None
    if not path.is_relative_to(ROOT / "src"):
        return None
    where = path.relative_to(ROOT).as_posix()
    return f"source:{where}#L{line}"


linked: set[str] = set()
"""The files and folders that links name, from the repository's root."""


def _page(path: str) -> str:
    return f"source/{path.rstrip('/')}"


def _mark(app: Sphinx, docname: str, source: list[str]) -> None:
    """Give links into the repository a scheme of their own, so that they are not taken for pages."""
    source[0] = _LINK.sub(r"](source:\1)", source[0])


def _mark_included(app: Sphinx, path: Path, docname: str, source: list[str]) -> None:
    """The same in a file of the repository that a page includes. Its links start at the repository's root."""
    _mark(app, docname, source)
    source[0] = source[0].replace("](CONTRIBUTING.md)", "](contributing.md)")


def _resolve(app: Sphinx, tree: nodes.document, docname: str) -> None:
    for reference in tree.findall(nodes.reference):
        scheme, _, target = reference.get("refuri", "").partition(":")
        if scheme != "source":
            continue
        path, _, name = target.partition("#")
        try:
            line = name.removeprefix("L")
            anchor = f"#L{line if line.isdigit() else line_of(ROOT / path, name)}" if name else ""
            (ROOT / path).stat()
        except (KeyError, OSError):
            raise ValueError(f"{docname}: the repository has no {target}") from None
        linked.add(path)
        reference["refuri"] = app.builder.get_relative_uri(docname, _page(path)) + anchor
        reference["internal"] = True


def _pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """A page for each file that is linked, and for each file of a folder that is linked."""
    folders = sorted(path for path in linked if (ROOT / path).is_dir())
    inside = {each: sorted(p.name for p in (ROOT / each).iterdir() if p.is_file()) for each in folders}
    for folder, names in inside.items():
        links = "".join(f'<li><a href="{Path(folder).name}/{name}.html">{name}</a></li>' for name in names)
        yield _page(folder), {"title": folder, "body": f"<h1>{folder}</h1><ul>{links}</ul>"}, "page.html"
    files = {path for path in linked if (ROOT / path).is_file()}
    files |= {f"{folder}/{name}" for folder, names in inside.items() for name in names}
    for path in sorted(files):
        text = (ROOT / path).read_text(errors="replace")
        try:
            lexer = get_lexer_for_filename(path)
        except ClassNotFound:
            lexer = TextLexer()
        lines = HtmlFormatter(linenos="inline", anchorlinenos=True, lineanchors="L", linespans="L", wrapcode=True)
        # an anchor of Pygments is L-12; ours is L12, as links to lines are written elsewhere
        body = re.sub(r'((?:id|name|href)="#?L)-', r"\1", highlight(text, lexer, lines))
        yield _page(path), {"title": path, "body": f'<h1 class="source">{path}</h1>{body}'}, "page.html"


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("source-read", _mark)
    app.connect("include-read", _mark_included)
    app.connect("doctree-resolved", _resolve)
    app.connect("html-collect-pages", _pages)
    return {"parallel_read_safe": False, "parallel_write_safe": False}
