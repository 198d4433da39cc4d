"""The site: it is built without a warning, loads nothing from elsewhere, and its links lead to lines of the source."""

import contextlib
import os
import re
import signal
import subprocess
import sys
from html import unescape
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest

import uvms_mj
from chromium import CHROMIUM, Chromium

ROOT = Path(__file__).parents[1]
LOADED = """new Promise(done => {
    const typeset = () => Promise.resolve(window.MathJax?.startup?.promise).then(() => setTimeout(done, 200));
    document.readyState === "complete" ? typeset() : addEventListener("load", typeset);
})"""
"""A promise of a page with its equations."""
WRONG = """[...document.querySelectorAll("div.math")].filter(box => box.querySelector("mjx-merror") ||
    !box.querySelector("mjx-math") ||
    box.querySelector("mjx-math").getBoundingClientRect().right > box.getBoundingClientRect().right + 2
).map(box => box.textContent)"""
"""The displayed equations of a page that are not typeset, or are wider than the page."""
BEYOND = """(() => {
    const article = document.querySelector("article"), edge = article.getBoundingClientRect().right + 1;
    const kept = box => box !== article && (getComputedStyle(box).overflowX !== "visible" || kept(box.parentElement));
    return [...article.querySelectorAll(":not(svg *, mjx-container *)")].filter(
        box => box.getBoundingClientRect().right > edge && !kept(box.parentElement)
    ).map(box => box.outerHTML.slice(0, 200));
})()"""
"""The elements of a page that pass the edge of its column, and don't scroll in a box within it."""
SCROLLED = """[...document.querySelectorAll("article .pst-scrollable-table-container")].filter(
    box => box.scrollWidth > box.clientWidth + 1).map(box => box.textContent.slice(0, 200))"""
"""The tables of a page that are wider than its column."""


def test_the_api_has_every_public_name():
    listed = re.findall(r"^   ([A-Za-z]\w*)$", (ROOT / "docs" / "reference" / "api.md").read_text(), re.MULTILINE)
    assert sorted(listed) == sorted(uvms_mj.__all__)


def test_the_site(tmp_path, subtests):
    """One test, because the build takes minutes."""
    for module in ("sphinx", "ziglang"):
        pytest.importorskip(module, reason="the site needs the extra docs")
    site = built(tmp_path)
    with subtests.test("each program and notebook ran, but for those that the gallery shows alone"):
        written, shown = tmp_path / "docs" / "_build" / "gallery", tmp_path / "docs" / "gallery"
        programs = sorted(path.relative_to(written) for path in written.rglob("*.py"))
        names = {path.name for folder in ("docs/results", "examples") for path in (ROOT / folder).glob("*.py")}
        assert {path.name for path in programs} == names
        ran = {path.name for path in programs if (shown / f"{path}.md5").is_file()}
        assert names - ran == {"ardusub_sender.py", "learn_push.py", "ppo.py", "udp_law.py"}
        for path in programs:
            pictures = site / "gallery" / path.with_suffix(".html")
            assert path.parent.name or f"sphx_glr_{path.stem}_001.png" in pictures.read_text(), path
        for path in (ROOT / "docs" / "notebooks").glob("*.ipynb"):
            assert "cell_output" in (site / "notebooks" / f"{path.stem}.html").read_text(), path.name
    with subtests.test("no program of the examples changes one of them"):
        for path in (ROOT / "examples").glob("*.py"):
            texts = [each.read_text().split('"""', 2)[2] for each in (path, written / "examples" / path.name)]
            assert texts[0] == re.sub(r"# sphinx_gallery_thumbnail_path = .*\n\Z", "", texts[1]), path.name
    with subtests.test("no two cards of the gallery have the same picture"):
        cards = list((site / "_images").glob("sphx_glr_*_thumb.png"))
        assert len(cards) == len(programs)
        assert len({card.read_bytes() for card in cards}) == len(cards)
    with subtests.test("no page loads anything from another address"):
        loads = re.compile(r"""<(?:script|img|link|iframe|source|video)\b[^>]*?\s(?:src|href)=["'](?:https?:)?//""")
        imports = re.compile(r"""(?:url\(|@import\s)["']?(?:https?:)?//""")
        pages = list(site.rglob("*.html"))
        assert len(pages) > 100
        assert [page.name for page in pages if loads.search(page.read_text())] == []
        assert [style.name for style in site.rglob("*.css") if imports.search(style.read_text())] == []
    with subtests.test("each link inside the site leads to a page and to a place in it"):
        assert broken(site) == []
    with subtests.test("the API shows classes as their users make them, and a sentence of each name"):
        for page in (site / "reference" / "api").glob("*.html"):
            assert found(r"check\)|Annotated|\bat 0x|<function|\(\*args|, \.\.\.\)|\b_[A-Z]", article(page)) == [], (
                page.name
            )
        rows = re.findall(r"<tr.*?</tr>", (site / "reference" / "api.html").read_text(), re.DOTALL)
        listed = [words(row) for row in rows if "autosummary" in row or "api/uvms_mj." in row]
        assert len(listed) > len(uvms_mj.__all__)
        assert [row for row in listed if not row.endswith(".") or len(row.split()) < 4] == []
    with subtests.test("powers of units are raised outside of code and formulas"):
        kept = re.compile(r"<(pre|code|dt)\b.*?</\1>|class=\"math.*?</(?:span|div)>", re.DOTALL)
        for page in (each for each in pages if "<article" in each.read_text()):
            text = words(re.search(r"<article.*?</article>", kept.sub("", page.read_text()), re.DOTALL).group())
            assert found(r"[\w|)]\^[-(\d]\S*", text) == [], page
    with subtests.test("three clicks lead from the equation of added mass to its line and to its test"):
        assert 'href="physics/index.html"' in (site / "index.html").read_text()
        assert 'href="equations.html"' in (site / "physics" / "index.html").read_text()
        equations = (site / "physics" / "equations.html").read_text()
        for name in ("added_inertia", "test_acceleration_is_the_matrix_equations"):
            links = re.findall(r'href="\.\./(source/[^"#]+\.html)#L(\d+)"', equations)
            lines = [re.search(rf'id="L{line}".*', (site / page).read_text()) for page, line in links]
            assert any(each and name in each.group() for each in lines), name
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    fit = subtests.test("pages ask for nothing outside and fit the screen")
    with contextlib.closing(Chromium(tmp_path / "chromium")) as browser, fit:
        look(browser, site)


def article(page: Path) -> str:
    """The text of a page without its lists of pages and sections."""
    return words(re.search(r"<article.*?</article>", page.read_text(), re.DOTALL).group())


def words(html: str) -> str:
    """The text of a piece of a page."""
    return " ".join(unescape(re.sub(r"<[^>]+>", "", html)).split())


def found(pattern: str, text: str) -> list[str]:
    return [each.group() for each in re.finditer(pattern, text)]


def broken(site: Path) -> list[str]:
    """The links of all pages that lead nowhere."""
    places = {
        page.resolve(): set(re.findall(r"""\s(?:id|name)=["']([^"']+)["']""", page.read_text()))
        for page in site.rglob("*.html")
    }
    wrong = []
    for page in places:
        for link in set(re.findall(r"""<a\b[^>]*?\shref=["']([^"']+)["']""", page.read_text())):
            if re.match(r"[a-z]+:", link):
                continue
            path, _, place = unescape(unquote(link)).partition("#")
            path = path.partition("?")[0]  # the numbers of the pool, which tests/test_pool.py checks
            target = (page.parent / path).resolve() if path else page
            there = place in places[target] if target in places and place else target.exists()
            if not there:
                wrong.append(f"{page.relative_to(site.resolve())}: {link}")
    return wrong


def built(work: Path) -> Path:
    """The site as ``make docs`` builds it in a clean clone, with all programs and notebooks: from the files that git
    would have there, by the Makefile's own recipe."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    for name in subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines():
        if (ROOT / name).is_file():
            (work / name).parent.mkdir(parents=True, exist_ok=True)
            (work / name).write_bytes((ROOT / name).read_bytes())
    environment = {name: value for name, value in os.environ.items() if "MAKE" not in name and name != "MFLAGS"}
    environment["PYTHONPATH"] = str(work / "src")
    build = ["make", "--assume-old=setup", "docs", f"BIN={Path(sys.executable).parent}"]  # what is installed here
    pipe: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(build, cwd=work, env=environment, start_new_session=True, **pipe)
    try:
        _, said = process.communicate(timeout=1100)
    except BaseException:
        os.killpg(process.pid, signal.SIGKILL)  # also what make has started
        raise
    assert process.returncode == 0, said[-3000:]
    return work / "docs" / "_build" / "html"


def look(browser: Chromium, site: Path) -> None:
    """Open some pages as wide as on a phone, then widen the window: an equation is typeset where it has least room."""
    browser("Network.enable")
    theory = [f"physics/{each.stem}" for each in sorted((site / "physics").glob("*.html"))]
    wide = ("start/exercise", "how_to/step", "how_to/bring_your_vehicle", "evidence/contact10", "evidence/twins")
    tables = [f"reference/{name}" for name in ("keys", "bench_tasks", "topics", "metrics", "commands", "environment")]
    names = ("reference/api/uvms_mj.Identification", "reference/api/uvms_mj.Coupling")
    for page in ("index", *theory, *wide, *tables, *names, "gallery/index", "gallery/tool", "notebooks/1_first_push"):
        for width in (390, 1280):
            phone = width < 600
            browser("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=phone)
            if phone:
                browser("Page.navigate", url=(site / f"{page}.html").as_uri())
                browser.evaluate(LOADED)
            assert browser.evaluate("location.pathname").endswith(f"/{page}.html")
            assert browser.evaluate("document.documentElement.scrollWidth") <= width, (page, width)
            assert browser.evaluate(WRONG) == [], (page, width)
            assert browser.evaluate(BEYOND) == [], (page, width)
            assert phone or browser.evaluate(SCROLLED) == [], page
    asked = {e["params"]["request"]["url"] for e in browser.events if e["method"] == "Network.requestWillBeSent"}
    assert len(asked) > 20
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
