"""HTML pages, read back and checked to be complete."""

import re
from html.parser import HTMLParser

HOSTILE = "<script>alert('x')</script>"


class Page(HTMLParser):
    """Tags with attributes, ids, and text; reports tags that don't match."""

    VOID = ("meta", "img", "br", "link", "input", "hr")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.text.append(data)

    def of(self, *names):
        return [attributes for tag, attributes in self.tags if tag in names]


def complete_by_itself(text: str) -> Page:
    """Parse a page and check that it has no script, no form, and no external resource."""
    page = Page(text)
    assert not page.of("script", "link", "iframe", "object", "embed", "base", "form")
    for tag, attributes in page.tags:
        assert not any(name.startswith("on") for name in attributes), (tag, attributes)
    assert all(image["src"].startswith("data:image/svg+xml;base64,") and image["alt"] for image in page.of("img"))
    assert all(link["href"].startswith("#") for link in page.of("a"))
    assert not re.search(r"https?:|url\(|@import|//[a-z]", re.sub(r"base64,[A-Za-z0-9+/=]+", "", text))
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert {link["href"][1:] for link in page.of("a")} <= set(ids)
    return page
