"""The site: it is built without a warning, loads nothing from elsewhere, and its links lead to lines of the source."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import uvms_mj
from chromium import Chromium, needs_chromium

pytest.importorskip("sphinx", reason="the site needs the extra docs")

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The site as ``make docs`` builds it, from a copy, so that a build of the checkout is left alone."""
    work = tmp_path_factory.mktemp("site")
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    for name in subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines():
        if (ROOT / name).is_file():
            (work / name).parent.mkdir(parents=True, exist_ok=True)
            (work / name).write_bytes((ROOT / name).read_bytes())
    build = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "docs", "docs/_build/html"]
    done = subprocess.run(build, cwd=work, capture_output=True, text=True, timeout=1200)
    assert done.returncode == 0, done.stderr[-3000:]
    return work / "docs" / "_build" / "html"


def test_the_api_has_every_public_name():
    listed = re.findall(r"^   ([A-Za-z]\w*)$", (ROOT / "docs" / "reference" / "api.md").read_text(), re.MULTILINE)
    assert sorted(listed) == sorted(uvms_mj.__all__)


@pytest.mark.slow
def test_no_page_loads_anything_from_another_address(site):
    loads = re.compile(r"""<(?:script|img|link|iframe|source|video)\b[^>]*?\s(?:src|href|data)=["'](?:https?:)?//""")
    pages = list(site.rglob("*.html"))
    assert len(pages) > 100
    assert [page.name for page in pages if loads.search(page.read_text())] == []
    assert [
        style.name for style in site.rglob("*.css") if re.search(r"url\(['\"]?(?:https?:)?//", style.read_text())
    ] == []


@pytest.mark.slow
@needs_chromium
@pytest.mark.parametrize("width", [1280, 390])
def test_pages_ask_for_nothing_outside_and_fit_the_screen(site, width, tmp_path):
    browser = Chromium(tmp_path)
    try:
        browser("Network.enable")
        browser("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=width < 600)
        for page in ("index", "physics/equations", "gallery/index", "notebooks/1_first_push", "reference/keys"):
            browser("Page.navigate", url=(site / f"{page}.html").as_uri())
            browser.evaluate("new Promise(done => setTimeout(done, 1500))")
            assert browser.evaluate("document.documentElement.scrollWidth") <= width, page
        asked = {e["params"]["request"]["url"] for e in browser.events if e["method"] == "Network.requestWillBeSent"}
        assert len(asked) > 20
        assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
    finally:
        browser.close()


@pytest.mark.slow
def test_three_clicks_lead_from_the_equation_of_added_mass_to_its_line_and_its_test(site):
    """Physics, the page of the equations, the line; and the line is that of the definition."""
    first = (site / "index.html").read_text()
    assert 'href="physics/index.html"' in first
    assert 'href="equations.html"' in (site / "physics" / "index.html").read_text()
    equations = (site / "physics" / "equations.html").read_text()
    for name in ("added_inertia", "test_acceleration_is_the_matrix_equations"):
        links = re.findall(r'href="\.\./(source/[^"]+\.html)#L(\d+)"', equations)
        found = [(site / page, line) for page, line in links]
        lines = [re.search(rf'id="L{line}".*', page.read_text()) for page, line in found]
        assert any(each and name in each.group() for each in lines), name
