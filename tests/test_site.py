"""The site: it is built without a warning, loads nothing from elsewhere, and its links lead to lines of the source."""

import contextlib
import inspect
import json
import linecache
import os
import re
import subprocess
import sys
import warnings
from html import unescape
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import unquote

import pytest
from matplotlib.figure import Figure

import uvms_mj
from chromium import CHROMIUM, Chromium
from uvms_mj import still

ROOT = Path(__file__).parents[1]
SHORT_STUDY = '"base": {"scenario": "push_wall"', '"base": {"scenario": "push_wall", "simulation": {"duration": 2.0}'
SHORTER = {
    "results/gusts.py": (('"push_wall_gusts")', '"push_wall_gusts", {"simulation.duration": 8.0})'),),
    "results/path.py": (('"follow_path")', '"follow_path", {"simulation.duration": 4.0})'),),
    "results/real_thrusters.py": (('"simulation.duration": 15.0', '"simulation.duration": 7.0'),),
    "results/slide.py": (('"tool_slide")', '"tool_slide", {"simulation.duration": 3.0})'),),
    "results/stiffness_and_peak.py": (("np.logspace(3, 6, 13)", "np.logspace(3, 6, 2)"),),
    "results/study.py": (('"runs": 24', '"runs": 2'), SHORT_STUDY),
    "results/tool.py": (('"tool_push")', '"tool_push", {"simulation.duration": 6.0})'),),
    "results/wipe.py": (('"wipe_wall")', '"wipe_wall", {"simulation.duration": 6.0})'),),
    "notebooks/2_your_own_law.ipynb": (('"runs": 24', '"runs": 2'), SHORT_STUDY),
    "notebooks/4_an_arm_pushes.ipynb": (
        ('load("tool_push")', 'load("tool_push", {"simulation.duration": 6.0})'),
        ('("impedance", "fosm", "gsta")', '("fosm",)'),
        ('load("tool_push", controller=law)', 'load("tool_push", {"simulation.duration": 6.0}, law)'),
        ('"tool_slide")', '"tool_slide", {"simulation.duration": 3.0})'),
    ),
    "notebooks/5_learning_to_push.ipynb": (
        ("in range(6):", "in range(1):"),
        ("for k in range(3)]", "for k in range(1)]"),
        ("range(10_000, 10_020)", "range(10_000, 10_003)"),
    ),
}
"""What makes programs of the site short: a page of docs, texts that it has, and the shorter ones."""
PROGRAMS = sorted(str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs" / "results").glob("*.py"))
NOTEBOOKS = sorted(str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs" / "notebooks").glob("*.ipynb"))
LOADED = """new Promise(done => {
    const typeset = () => Promise.resolve(window.MathJax?.startup?.promise).then(() => setTimeout(done, 200));
    document.readyState === "complete" ? typeset() : addEventListener("load", typeset);
})"""
"""A promise of a page with its equations."""
IN_THE_SITE = r"(added_mass|pd)\.py"
"""Programs of the gallery that the build of the site runs. The others run in this process; tests of the guides run the
examples."""


def test_the_api_has_every_public_name():
    listed = re.findall(r"^   ([A-Za-z]\w*)$", (ROOT / "docs" / "reference" / "api.md").read_text(), re.MULTILINE)
    assert sorted(listed) == sorted(uvms_mj.__all__)


def shortened(page: str, text: str) -> str:
    """A program of a page of docs, with what makes its runs short."""
    for long, short in SHORTER.get(page, ()):
        assert text.count(long) == 1, long
        text = text.replace(long, short)
    return text


@pytest.fixture
def module(monkeypatch, tmp_path, undrawn):
    """A function that runs a text as a module whose source Python finds, as that of a cell, and gives its names."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.setattr(uvms_mj, "still", lambda *given, **named: inspect.signature(still).bind(*given, **named))

    def run(name: str, text: str) -> dict[str, Any]:
        made = ModuleType(name)
        monkeypatch.setitem(sys.modules, name, made)
        monkeypatch.setitem(linecache.cache, file := str(tmp_path / name), (1, None, text.splitlines(True), file))
        with warnings.catch_warnings():
            exec(compile(text, file, "exec"), vars(made))
        return vars(made)

    return run


@pytest.mark.parametrize("page", NOTEBOOKS)
def test_the_cells_of_a_notebook_run(page, module):
    cells = json.loads((ROOT / "docs" / page).read_text())["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    module(Path(page).stem, shortened(page, "\n".join(code)))


@pytest.mark.parametrize("page", PROGRAMS)
def test_a_program_of_the_gallery_runs_and_leaves_a_figure(page, module):
    names = module(Path(page).stem, shortened(page, (ROOT / "docs" / page).read_text()))
    assert any(isinstance(each, Figure) for each in names.values())


def test_the_site(tmp_path, subtests):
    """One test, because the build takes half a minute."""
    for module in ("sphinx", "ziglang"):
        pytest.importorskip(module, reason="the site needs the extra docs")
    site = built(tmp_path)
    with subtests.test("no page loads anything from another address"):
        loads = re.compile(r"""<(?:script|img|link|iframe|source|video)\b[^>]*?\s(?:src|href)=["'](?:https?:)?//""")
        imports = re.compile(r"""(?:url\(|@import\s)["']?(?:https?:)?//""")
        pages = list(site.rglob("*.html"))
        assert len(pages) > 100
        assert [page.name for page in pages if loads.search(page.read_text())] == []
        assert [style.name for style in site.rglob("*.css") if imports.search(style.read_text())] == []
    with subtests.test("each link inside the site leads to a page and to a place in it"):
        assert broken(site) == []
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
    with contextlib.closing(Chromium(tmp_path / "chromium")) as browser:
        for width in (1280, 390):
            with subtests.test("pages ask for nothing outside and fit the screen", width=width):
                look(browser, site, width)


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
            target = (page.parent / path).resolve() if path else page
            there = place in places[target] if target in places and place else target.exists()
            if not there:
                wrong.append(f"{page.relative_to(site.resolve())}: {link}")
    return wrong


def built(work: Path) -> Path:
    """The site as ``make docs`` builds it, from a copy of the checkout's files, but for what runs in this
    process, and for the colours of sources."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    for name in subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines():
        if (ROOT / name).is_file():
            (work / name).parent.mkdir(parents=True, exist_ok=True)
            (work / name).write_bytes((ROOT / name).read_bytes())
    with (work / "docs" / "conf.py").open("a") as conf:
        conf.write(f'\nnb_execution_mode = "off"\nsphinx_gallery_conf["filename_pattern"] = {IN_THE_SITE!r}\n')
        conf.write("import source_pages\nsource_pages.get_lexer_for_filename = lambda path: source_pages.TextLexer()\n")
    build = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "docs", "docs/_build/html"]
    environment = os.environ | {"MUJOCO_GL": "disable"}  # test_video.py draws the scene
    done = subprocess.run(build, cwd=work, env=environment, capture_output=True, text=True, timeout=560)
    assert done.returncode == 0, done.stderr[-3000:]
    return work / "docs" / "_build" / "html"


def look(browser: Chromium, site: Path, width: int) -> None:
    """Open some pages in a window of a width."""
    browser("Network.enable")
    browser("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=width < 600)
    for page in ("index", "physics/equations", "gallery/index", "notebooks/1_first_push", "reference/keys"):
        browser("Page.navigate", url=(site / f"{page}.html").as_uri())
        browser.evaluate(LOADED)
        assert browser.evaluate("location.pathname").endswith(f"/{page}.html")
        assert browser.evaluate("document.documentElement.scrollWidth") <= width, page
    asked = {e["params"]["request"]["url"] for e in browser.events if e["method"] == "Network.requestWillBeSent"}
    assert len(asked) > 20
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
