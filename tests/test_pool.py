"""The pool in a real browser: its module, its numbers against native runs, and its pages."""

import base64
import dataclasses
import io
import json
import math
import re
import tomllib
from urllib.parse import parse_qsl, urlencode, urlsplit

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from chromium import Chromium, needs_chromium
from symbols import undefined
from uvms_mj import Scenario, simulate
from uvms_mj.engine.native.other_targets import STEPS
from uvms_mj.views.colours import LAWS as COLOURS
from uvms_mj.views.colours import legible

pytest.importorskip("ziglang", reason="the extra docs, which has the linker, is not installed")
import build_pool

LAWS = build_pool.LAWS
MOST_BYTES = 500_000
CHANGED = {
    "gsta": {"wall.stiffness": 3e3, "current.speed": 0.3, "controller.k_1": 3.3, "controller.beta": 1.5},
    "fosm": {"wall.damping": 123.4, "controller.epsilon": 3e-3, "controller.K_s": 7.0, "impedance.F_d[0]": -2.0},
    "impedance": {"controller.period": 0.005, "task.F_1": 0.5, "task.A": -33.0, "current.speed": 0.9},
}


STILL = [{"name": "prefers-reduced-motion", "value": "reduce"}]
"""Of a reader who wants less motion: the page begins paused."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    CliRunner().invoke(build_pool.main, ["--out", str(folder)], catch_exceptions=False)
    return folder


@pytest.fixture(scope="module")
def loops():
    return build_pool.Loops()


@pytest.fixture(scope="module")
def browser(site, tmp_path_factory):
    """The page, from its file. At the end of the tests it has reported no error."""
    browser = Chromium(tmp_path_factory.mktemp("browser"))
    for domain in ("Page", "Network", "Runtime", "Log"):
        browser(f"{domain}.enable")
    browser("Emulation.setEmulatedMedia", features=STILL)
    browser("Page.navigate", url=(site / "pool.html").as_uri())
    browser.evaluate("new Promise((done) => (document.readyState === 'complete' ? done() : (onload = done)))")
    yield browser
    browser.evaluate("0")  # collects the events up to now
    browser.close()
    wrong = [e["params"] for e in browser.events if e["method"] in ("Runtime.exceptionThrown", "Log.entryAdded")]
    assert wrong == []


def run_of_the_page(browser, law, values, seconds, during=()):
    """The samples (n, 15) of a run of the page's own code, t, F, p_WB, quat_WB and s, and its record at the start."""
    said = browser.evaluate(
        f"""uvms_mj_pool.simulate({json.dumps([law, values, seconds, [*during]])[1:-1]}).then(({{ rows, start }}) => {{
            const text = (array) => {{
                const bytes = new Uint8Array(array.buffer, array.byteOffset, array.byteLength);
                let letters = "";
                for (let k = 0; k < bytes.length; k += 8192)
                    letters += String.fromCharCode(...bytes.subarray(k, k + 8192));
                return btoa(letters);
            }};
            return [text(rows), text(start)];
        }})"""
    )
    rows, start = (base64.b64decode(each) for each in said)
    return np.frombuffer(rows).reshape(-1, 15), np.frombuffer(start, np.int64).copy()


def samples(trace):
    return np.column_stack([trace.t, trace.push, trace.p_WB, trace.quat_WB, trace.s])


def native(law, values, seconds):
    scenario = Scenario.load("push_wall", {"simulation.duration": seconds, **build_pool.overrides(values)}, law)
    return samples(simulate(scenario, engine="free_body", log_rate=1.0 / build_pool.SAMPLE_S))


def test_the_module_uses_nothing_of_the_browser(loops):
    module = build_pool.module(loops)
    assert undefined(module) == set()
    assert STEPS.encode() in module


@needs_chromium
@pytest.mark.parametrize("law", LAWS)
def test_a_run_of_other_numbers_begins_with_the_record_of_a_native_run(browser, loops, law):
    """No number that set-up derives from a key is stale."""
    _, start = run_of_the_page(browser, law, CHANGED[law], 0.0)
    start[loops.first._memory.image.place(loops.first._memory.run["address"])] = 0
    assert np.array_equal(start, loops.image(build_pool.simulation(law, CHANGED[law])))


@needs_chromium
def test_another_desired_stiffness_brings_its_damping(browser, loops):
    """D_d is that of another eigenvalue solver: it agrees to rounding. Every other number is equal."""
    stiffness = {f"impedance.K_d[{i}]": value for i, value in enumerate((333.0, 700.0, 2e3, 20.0, 80.0, 11.0))}
    memory = loops.first._memory
    _, start = run_of_the_page(browser, "gsta", stiffness, 0.0)
    start[memory.image.place(memory.run["address"])] = 0
    expected = loops.image(build_pool.simulation("gsta", stiffness))
    at = memory.image.place(memory.run["signals"]["D_d"])
    D_d, D_d_native = (words[at : at + 36].view(float) for words in (start, expected))
    assert np.abs(D_d - D_d_native).max() < 1e-15 * np.abs(D_d_native).max()
    start[at : at + 36] = expected[at : at + 36]
    assert np.array_equal(start, expected)


@needs_chromium
@pytest.mark.parametrize("law", LAWS)
def test_the_default_run_is_that_of_free_body_bit_for_bit(browser, law):
    """20 s."""
    here, there = run_of_the_page(browser, law, {}, 20.0)[0], native(law, {}, 20.0)
    assert there[:, 1].max() > 10.0 or law == "impedance"
    assert np.array_equal(here, there)


RESTS = [
    *((law, {}) for law in LAWS),
    *CHANGED.items(),
    ("impedance", {"current.speed": 0.2, "impedance.K_d[5]": 20.0}),
    ("impedance", {"impedance.F_d[0]": -6.0, "wall.stiffness": 500.0, "task.A": -20.0}),
    ("fosm", {"controller.epsilon": 0.02, "task.A": -10.0, "current.speed": 0.8}),
    ("fosm", {"controller.K_s": 0.1, "task.A": -10.0, "controller.epsilon": 1e-3}),  # outside of the layer
    ("fosm", {"controller.period": 0.005}),  # chatters
    ("fosm", {"task.A": 0.0}),
    ("fosm", {"task.A": 0.0, "controller.K_s": 0.0}),  # drifts
    ("impedance", {"task.A": 0.0}),
    ("gsta", {"controller.k_2": 0.0}),
    *(
        (law, {"controller.period": 1.0 / rate, "wall.stiffness": stiffness, "impedance.F_d[0]": -3.0} | stiff)
        for law in LAWS
        for rate in (1000, 200, 50)
        for stiffness in (1e3, 1e4, 1e5, 1e6)
        for stiff in ({}, {"impedance.K_d[0]": 600.0})
    ),
]


@needs_chromium
@pytest.mark.parametrize(("law", "values"), RESTS)
def test_the_closed_form_of_the_page_is_that_of_the_law(browser, law, values):
    run = build_pool.simulation(law, values)
    theirs = run.scenario.controller.at_rest(run.setup)
    D_d = run.setup.design.D_d.ravel().tolist()
    ours = browser.evaluate(f"uvms_mj_pool.at_rest({json.dumps([law, values, D_d])[1:-1]})")
    if isinstance(theirs, str):
        assert "reason" in ours, theirs
    else:
        assert ours["force"] == pytest.approx(theirs.force, rel=1e-7, abs=1e-9)


@needs_chromium
def test_numbers_change_during_a_run_as_those_of_a_simulation(browser):
    """Another wall, current, rate and gain while the vehicle pushes."""
    changes = {"wall.stiffness": 2e4, "current.speed": 0.8, "controller.period": 0.0005, "controller.k_1": 8.0}
    here = run_of_the_page(browser, "gsta", {}, 9.0, [[7.0, changes]])[0]
    run = build_pool.simulation("gsta", {})
    every = build_pool.SAMPLE_S / run.scenario.simulation.timestep
    run.run(round(7.0 / build_pool.SAMPLE_S * every) + 1, math.inf)
    run.set(build_pool.overrides(changes))
    run.run(round(2.0 / build_pool.SAMPLE_S * every), math.inf)
    there = [run._memory.run["true"][name][0] for name in ("p_WB", "quat_WB")]
    assert here[-1, 0] == run._memory.run["t"][0] == 9.0
    assert np.array_equal(here[-1, 2:9], np.concatenate(there))


def colours_in(png: bytes) -> np.ndarray:
    """The pixels (n, 3) of a picture."""
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=int).reshape(-1, 3)


def opened(browser, site, page: str, width: int = 1280, scheme: str = "light", refused: bool = False) -> None:
    """Open a page from its file and wait until it has drawn a run for half a second of its time."""
    browser("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=width < 600)
    browser("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    browser("Page.navigate", url=f"{site.as_uri()}/{page}")
    said = browser.evaluate(
        """new Promise((done) => {
            const look = () => {
                const time = document.querySelector(".pool-told div:last-child output");
                if (!time || !(parseFloat(time.textContent) >= 0.5)) setTimeout(look, 20);
                else done(document.querySelector(".pool-message").textContent);
            };
            look();
        })"""
    )
    assert bool(said) == refused


@needs_chromium
@pytest.mark.parametrize(
    ("page", "width", "scheme"),
    [("pool.html", 390, "dark"), ("numbers.html", 1280, "light")],
)
def test_a_page_shows_the_pool_and_is_no_wider_than_its_window(browser, site, page, width, scheme):
    opened(browser, site, page, width, scheme)
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    browser.evaluate("document.querySelector('.pool-plots').scrollIntoView()")
    pixels = colours_in(browser.picture())
    assert len(np.unique(pixels[::20], axis=0)) > 100
    line = np.abs(pixels - legible(COLOURS["gsta"])).max(axis=1) < 4
    assert line.sum() > 50, "no line of the run in its plots"
    assert (pixels.mean() > 128) == (scheme == "light")


@needs_chromium
def test_the_pool_is_small_and_asks_nobody(browser, site):
    assert sum(file.stat().st_size for file in site.iterdir()) < MOST_BYTES
    opened(browser, site, "pool.html")
    asked = {e["params"]["request"]["url"] for e in browser.events if e["method"] == "Network.requestWillBeSent"}
    assert asked
    assert [url for url in asked if not url.startswith((site.as_uri(), "blob:", "data:"))] == []


@needs_chromium
def test_the_page_follows_the_readers_wishes(browser, site):
    """It begins paused for who wants less motion, and has the theme of the page around it."""
    browser("Emulation.setEmulatedMedia", features=STILL)
    browser("Page.navigate", url=(site / "pool.html").as_uri())
    shown = browser.evaluate(
        """new Promise((done) => {
            const text = (each) => document.querySelector("#pool " + each)?.textContent, begun = Date.now();
            const time = () => text(".pool-told div:last-child output");
            const dark = () => document.querySelector("#pool").classList.contains("pool-dark");
            const look = () => {
                const seen = [text(".pool-bar button"), time()];
                document.documentElement.dataset.theme = "dark";
                setTimeout(() => {
                    const first = dark();
                    document.documentElement.dataset.theme = "light";
                    setTimeout(() => done([...seen, first, dark()]), 50);
                }, 50);
            };
            const wait = () => {
                const drawn = time()?.endsWith("s") || Date.now() > begun + 20000;
                setTimeout(drawn ? look : wait, drawn ? 300 : 20); // it would run by then
            };
            wait();
        })"""
    )
    assert shown == ["Play", "0.0 s", True, False]


@needs_chromium
def test_what_the_page_shows_is_the_run(browser, site):
    """A run with the clock, held after a while: its time and its distance to the wall."""
    opened(browser, site, "pool.html")
    shown = browser.evaluate(
        """new Promise((done) => {
            const [play, , speed] = document.querySelector(".pool-bar").children;
            const told = () => [...document.querySelectorAll(".pool-told output")].map((each) => each.textContent);
            speed.value = "4";
            speed.dispatchEvent(new Event("change"));
            const look = () => {
                if (!(parseFloat(told()[5]) >= 2.2)) return setTimeout(look, 20);
                play.click();
                setTimeout(() => done(told()), 200);
            };
            look();
        })"""
    )
    number, unit = shown[2].replace("\N{MINUS SIGN}", "-").split()  # a slow machine holds it at the wall
    t, distance = float(shown[5].removesuffix(" s")), float(number) * {"mm": 1.0, "µm": 1e-3}[unit]
    there = native("gsta", {}, 8.0)
    near = there[np.abs(there[:, 0] - t) < 0.0501]
    assert 2.0 < t < 8.0
    assert 1e3 * (1.0 - near[-1, 2]) - 0.1 <= distance <= 1e3 * (1.0 - near[0, 2]) + 0.1
    assert shown[1] == "1.498 N"


def shown_by(browser) -> dict:
    """Message, law and scenario of the page with all numbers."""
    return browser.evaluate(
        """({
            said: document.querySelector(".pool-message").textContent,
            law: document.querySelector("input[name=pool-law]:checked").value,
            scenario: document.querySelector("textarea").value,
        })"""
    )


@needs_chromium
@pytest.mark.parametrize("law", LAWS)
def test_a_link_has_the_numbers_of_the_page(browser, site, law):
    """The link of a page that was opened by a link, and its scenario, are the same."""
    query = urlencode({"law": law} | CHANGED[law])
    opened(browser, site, f"numbers.html?{query}")
    shown = shown_by(browser)
    assert shown["law"] == law
    scenario = Scenario.from_dict(tomllib.loads(shown["scenario"]))
    expected = Scenario.load("push_wall", build_pool.overrides(CHANGED[law]), law)
    assert dataclasses.replace(scenario, name=expected.name, description=expected.description) == expected
    again = browser.evaluate(
        """new Promise((done) => {
            navigator.clipboard.writeText = (text) => done(text) ?? Promise.resolve();
            const buttons = [...document.querySelectorAll(".pool-keys button")];
            buttons.find((each) => each.textContent === "Copy link").click();
        })"""
    )
    assert {name: float(value) for name, value in parse_qsl(urlsplit(again).query)[1:]} == CHANGED[law]
    assert parse_qsl(urlsplit(again).query)[0] == ("law", law)


@needs_chromium
def test_a_page_without_a_clipboard_copies_by_the_old_command(browser, site):
    """A page over http has none. The button says that the text is copied, and it is."""
    opened(browser, site, "numbers.html?law=impedance&current.speed=0.3")
    x, y = browser.evaluate(
        """(() => {
            Object.defineProperty(navigator, "clipboard", { value: undefined, configurable: true });
            document.addEventListener("copy", () => (window.copied = document.activeElement.value), { once: true });
            const buttons = [...document.querySelectorAll(".pool-toml button")];
            window.button = buttons.find((each) => each.textContent === "Copy");
            button.scrollIntoView({ block: "center", behavior: "instant" });
            const { x, y, width, height } = button.getBoundingClientRect();
            return [x + 0.5 * width, y + 0.5 * height];
        })()"""
    )
    for kind in ("mousePressed", "mouseReleased"):
        browser("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
    assert browser.evaluate("[copied, button.textContent]") == [shown_by(browser)["scenario"], "Copied"]


@needs_chromium
def test_the_numbers_go_along_to_the_other_page(browser, site):
    opened(browser, site, "pool.html?law=fosm&current.speed=0.2")
    leads_to = browser.evaluate(
        """(() => {
            const link = document.querySelector('a[href$="numbers.html"]');
            link.addEventListener("click", (event) => event.preventDefault());
            link.click();
            return link.href;
        })()"""
    )
    opened(browser, site, leads_to.removeprefix(f"{site.as_uri()}/"))
    shown = shown_by(browser)
    assert shown["law"] == "fosm"
    assert "speed = 0.2" in shown["scenario"]


@needs_chromium
def test_the_links_of_the_exercise_open_the_pool(browser, site):
    text = (build_pool.SOURCES.parent / "start" / "exercise.md").read_text()
    links = re.findall(r'href="\.\./index\.html(\?[^"]+)"', text)
    assert len(links) >= 4
    for link in links:
        opened(browser, site, f"numbers.html{link}")
        assert shown_by(browser)["scenario"].count("=") == link.count("="), link


@needs_chromium
@pytest.mark.parametrize(
    "query",
    ["law=pid", "current.sped=1", "law=fosm&controller.k_1=1", "current.speed=7", "controller.period=7e-4", "task.A="],
)
def test_a_link_of_something_else_is_refused_whole(browser, site, query):
    opened(browser, site, f"numbers.html?current.speed=0.2&{query}", refused=True)
    shown = shown_by(browser)
    assert query.split("&")[-1].split("=")[0] in shown["said"]
    assert shown["law"] == "gsta"
    assert "current" not in shown["scenario"]


@needs_chromium
def test_a_finger_that_scrolls_the_page_changes_no_slider(browser, site):
    opened(browser, site, "pool.html", 390)
    browser("Emulation.setTouchEmulationEnabled", enabled=True)

    def swipe(right: float, up: float) -> float:
        """Move a finger that begins on the slider of the current's speed. Returns its number."""
        x, y = browser.evaluate(
            """(() => {
                const slider = document.querySelectorAll(".pool-keys input")[1];
                slider.scrollIntoView({ block: "center", behavior: "instant" });
                const { x, y, width, height } = slider.getBoundingClientRect();
                return [x + 0.7 * width, y + 0.5 * height];
            })()"""
        )
        for k in range(13):
            place = [{"x": x + right * k / 12, "y": y - up * k / 12}]
            browser("Input.dispatchTouchEvent", type="touchMove" if k else "touchStart", touchPoints=place)
        browser("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        return browser.evaluate(
            "new Promise((done) => setTimeout(() => done(parseFloat(document.querySelectorAll('.pool-keys output')[1]"
            ".textContent)), 300))"
        )

    assert swipe(0.0, 200.0) == 0.5
    assert browser.evaluate("scrollY") > 0
    assert swipe(-100.0, 0.0) < 0.5
    browser("Emulation.setTouchEmulationEnabled", enabled=False)


@needs_chromium
@pytest.mark.parametrize("law", LAWS)
def test_the_scenario_of_the_page_is_one_that_runs_alike(browser, site, tmp_path, law):
    """The numbers are typed into the fields; the TOML is loaded as a file."""
    opened(browser, site, "numbers.html")
    browser.evaluate(f"document.querySelector('input[value={law}]').click()")
    stiffness = {"impedance.K_d[0]": 300.0, "impedance.K_d[4]": 20.0}
    for name, value in (CHANGED[law] | stiffness).items():
        (key,) = (key for key in build_pool.KEYS if key.key == name)
        number = {"rate": 1.0 / value, "minus": -value}.get(key.shown, value)
        browser.evaluate(
            f"""(() => {{
                const field = document.querySelector('[title$=": {name}"] :is(input, select)');
                field.value = "{number:g}";
                field.dispatchEvent(new Event("change"));
            }})()"""
        )
    (file := tmp_path / "scenario.toml").write_text(browser.evaluate("document.querySelector('textarea').value"))
    scenario = Scenario.load(file)
    expected = Scenario.load("push_wall", build_pool.overrides(CHANGED[law] | stiffness), law)
    assert dataclasses.replace(scenario, name=expected.name, description=expected.description) == expected
    shorter = scenario.updated({"simulation.duration": 7.0})
    here = run_of_the_page(browser, law, CHANGED[law] | stiffness, 7.0)[0]
    there = samples(simulate(shorter, engine="free_body", log_rate=1.0 / build_pool.SAMPLE_S))
    assert np.abs(here[:, 2:9] - there[:, 2:9]).max() < 1e-7  # the last bits of D_d, and what impacts make of them
