"""The live page in a browser: it plays, steps, changes, compares, remembers, and is written to one file."""

import json
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from aimd_des.scenario import validate_scenario
from tests.conftest import quietly
from tests.test_live import TOKEN, base, serving
from tests.test_report_browser import (
    _CONTRAST,
    _PATIENCE,
    _SWITCHES,
    look,
    press,
    requests,
    screenshot,
    until,
)

pytestmark = pytest.mark.skipif(
    not (shutil.which("chromium") and shutil.which("chromedriver")),
    reason="chromium and chromedriver are not installed",
)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = str(shutil.which("chromium"))
    # This machine is asked, and nobody else.
    own = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
    for switch in (*_SWITCHES[:-1], own, f"--user-data-dir={tmp_path_factory.mktemp('browser')}"):
        options.add_argument(switch)
    options.set_capability("goog:loggingPrefs", {"performance": "ALL", "browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    driver.set_page_load_timeout(_PATIENCE)
    driver.execute_cdp_cmd("Network.enable", {})
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with serving(base(until=400.0)) as port:
        yield f"http://127.0.0.1:{port}/?token={TOKEN}"


@pytest.fixture
def page(browser: Any, address: str) -> Any:
    """The page at its beginning, in a window of usual size."""
    look(browser)
    browser.get("about:blank")
    for log in ("performance", "browser"):
        browser.get_log(log)
    browser.get(address)
    until(browser, "window.live && live.tracks.a && live.tracks.a.frames.length > 0")
    return browser


def value(browser: Any, expression: str) -> Any:
    return browser.execute_script(f"return {expression}")


def click(browser: Any, selector: str) -> None:
    browser.execute_script("arguments[0].click()", browser.find_element("css selector", selector))


def shown(browser: Any) -> None:
    """Wait until what was asked for is on the page."""
    until(browser, "!live.waits.a && !live.waits.b && live.dirty === false")


def dots(browser: Any, selector: str) -> int:
    """How many pixels of a canvas are drawn on."""
    found = browser.execute_script(
        "const c = document.querySelector(arguments[0]);"
        "const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
        "let n = 0; for (let k = 3; k < d.length; k += 4) n += d[k] > 0; return n",
        selector,
    )
    return int(found)


def signals(browser: Any, which: str = "true") -> list[float]:
    """The times of the signals that the page knows of, of those for which something holds."""
    found = "live.tracks.a.signals.flat().map(signal => signal.time)"
    return list(value(browser, f"{found}.filter(t => {which}).sort((a, b) => a - b)"))


def test_it_plays_at_once_and_asks_nobody_else(page: Any, address: str, tmp_path: Path) -> None:
    began = value(page, "live.time")
    until(page, f"live.time > {began} + 1 && live.tracks.a.measures.length > 3")
    for canvas in (".ring", ".score", ".saw canvas", ".error", ".scatter"):
        assert dots(page, canvas) > 300, canvas
    assert value(page, "document.querySelectorAll('.counts tbody tr').length") == 3
    assert value(page, "document.getElementById('title').textContent") == base().title
    until(page, "document.querySelector('.theory').textContent.includes('constant')")
    assert page.get_log("browser") == []
    host = address.partition("?")[0]
    assert {url.partition("?")[0] for url in requests(page)} <= {host}
    screenshot(page, tmp_path / "live.png")


def test_it_pauses_and_steps_with_the_keyboard(page: Any) -> None:
    press(page, " ")
    until(page, "!live.playing")
    before = value(page, "live.time")
    press(page, "s")
    until(page, f"live.time > {before}")
    times = signals(page, f"t > {before}")
    assert value(page, "live.time") == pytest.approx(times[0], abs=1e-4)
    now = value(page, "live.time")
    press(page, "e")
    until(page, f"live.time > {now}")
    assert value(page, "live.time") - now < 2.0
    assert value(page, "document.getElementById('play').textContent.includes('Play')")
    click(page, "#play")
    until(page, f"live.playing && live.time > {now} + 0.3")


def test_a_slider_runs_again_from_the_start(page: Any) -> None:
    before = value(page, "live.ids.a")
    page.execute_script("document.getElementById('control-loss').focus()")
    press(page, "\ue014")
    until(page, f"live.ids.a > {before}")
    shown(page)
    assert value(page, "live.tracks.a.start.shown.loss") == pytest.approx(0.11)
    assert value(page, "document.querySelector('[for=control-loss] + output').textContent") == "11 %"
    assert value(page, "live.systems.a") == {"start": {"loss": 0.11}, "changes": []}
    # The state is in the address: whoever opens it sees the same.
    until(page, "decodeURIComponent(location.hash).includes('0.11')")
    page.refresh()
    until(page, "window.live && live.tracks.a && live.tracks.a.frames.length > 0")
    assert value(page, "live.tracks.a.start.shown.loss") == pytest.approx(0.11)


def test_a_change_goes_on_from_now_and_the_file_repeats_it(page: Any) -> None:
    click(page, "#play")
    until(page, "!live.playing")
    past = len(signals(page, "t < live.time"))
    click(page, "[name=when][value=now]")
    page.execute_script("document.getElementById('control-latency').focus()")
    press(page, "\ue014")
    shown(page)
    click(page, "[data-do=capacity]")
    shown(page)
    (first, second) = value(page, "live.systems.a.changes")
    assert first["set"] == {"latency": pytest.approx(0.65)}
    assert second["do"] == "capacity"
    assert value(page, "document.querySelectorAll('#changes li').length") == 2
    at = first["at"]
    assert len(signals(page, f"t < {at}")) == past
    for _ in range(6):
        press(page, "s")
    until(page, f"live.time > {at} + 0.5")
    seen = signals(page, "t < live.time && t > 30")
    click(page, "#save")
    until(page, "live.saved && live.saved.name === 'played.toml'")
    played = tomllib.loads(value(page, "live.saved.text"))
    assert [row["kind"] for row in played["interventions"]] == ["channel", "capacity_step"]
    times = quietly(validate_scenario(played, "played").run).signals["time"]
    assert times[(times > 30) & (times < value(page, "live.time"))].to_numpy() == pytest.approx(
        seen, abs=1e-4
    )
    click(page, "#changes button")
    shown(page)
    assert value(page, "live.systems.a.changes.length") == 1


def test_what_is_refused_is_said_and_taken_back(page: Any) -> None:
    page.execute_script("live.systems.a.start.loss = 3; document.getElementById('control-seed').focus()")
    press(page, "\ue014")
    until(page, "document.getElementById('message').classList.contains('bad')")
    assert "loss" in value(page, "document.getElementById('message').textContent")


def test_two_systems_side_by_side_share_their_random_numbers(page: Any, tmp_path: Path) -> None:
    click(page, "#compare")
    until(page, "live.tracks.b && live.tracks.b.frames.length > 0")
    shown(page)
    # Where nothing differs, nothing does.
    numbers = "live.tracks.{}.signals[0].find(s => s.number === 20)"
    until(page, f"{numbers.format('a')} && {numbers.format('b')}")
    assert value(page, f"{numbers.format('a')}.time") == pytest.approx(
        value(page, f"{numbers.format('b')}.time"), abs=1e-4
    )
    page.execute_script("document.getElementById('control-latency').focus()")
    press(page, "\ue014")
    shown(page)
    assert value(
        page, "[live.tracks.a.start.shown.latency, live.tracks.b.start.shown.latency]"
    ) == pytest.approx([0.6, 0.65])
    until(page, "live.tracks.b.measures.length > 3")
    assert value(page, "document.querySelectorAll('.system').length") == 2
    screenshot(page, tmp_path / "two.png")
    click(page, "#compare")
    until(page, "document.querySelectorAll('.system').length === 1")


def test_an_agent_is_chosen_by_a_click_or_by_its_name(page: Any) -> None:
    ring = "(({x, y, inner}) => [x + inner, y])(live.views.a.ring.places[0])"
    until(page, "live.views.a.ring.places.length")
    x, y = value(page, ring)
    page.execute_script(
        "const ring = document.querySelector('.ring'), box = ring.getBoundingClientRect();"
        "const at = {clientX: box.left + arguments[0], clientY: box.top + arguments[1]};"
        "ring.dispatchEvent(new MouseEvent('click', at))",
        x,
        y,
    )
    assert value(page, "live.agent") == 3  # a quarter of the way round twelve
    assert value(page, "document.querySelector('.history-title').textContent").startswith("Agent 3")
    press(page, "\ue00c")  # escape
    assert value(page, "live.agent") == -1
    from selenium.webdriver.support.ui import Select

    Select(page.find_element("css selector", ".agent")).select_by_visible_text("7")
    assert value(page, "live.agent") == 7


def test_the_page_in_one_file_plays_without_a_server(page: Any, browser: Any, tmp_path: Path) -> None:
    click(page, "#export")
    until(page, "live.saved && live.saved.name === 'played.html'")
    path = tmp_path / "played.html"
    path.write_text(value(page, "live.saved.text"), encoding="utf-8")
    assert path.stat().st_size < 2_000_000
    for log in ("performance", "browser"):
        browser.get_log(log)
    browser.get(path.as_uri())
    until(browser, "window.live && live.tracks.a && live.tracks.a.frames.length > 0")
    began = value(browser, "live.time")
    until(browser, f"live.time > {began} + 1")
    assert dots(browser, ".ring") > 300
    assert value(browser, "document.querySelector('#save').offsetParent") is None
    assert browser.get_log("browser") == []
    assert requests(browser) == [path.as_uri()]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 820, 1440])
def test_it_fits_any_window(page: Any, tmp_path: Path, width: int, scheme: str) -> None:
    look(page, width, scheme)
    until(page, f"innerWidth === {width} && palette.dark === {json.dumps(scheme == 'dark')}")
    shown(page)
    assert value(page, "document.documentElement.scrollWidth") <= width
    contrasts = page.execute_script(
        _CONTRAST.replace("h1, h2, dt, dd", "h1, h2, b, label, legend, td, th, button:not(.primary)")
    )
    assert len(contrasts) > 40
    assert min(contrasts) >= 4.5
    # Nothing that is touched is smaller than a finger-tip, as WCAG 2.2 has it.
    touched = (
        "[...document.querySelectorAll('button, select, input[type=range]')].filter(b => b.offsetParent)"
    )
    sizes = value(page, f"{touched}.map(b => Math.min(b.offsetWidth, b.offsetHeight))")
    assert min(sizes) >= 22
    screenshot(page, tmp_path / f"{width}_{scheme}.png")


def test_nothing_moves_where_that_is_not_wanted(browser: Any, address: str) -> None:
    browser.get("about:blank")
    media = {"features": [{"name": "prefers-reduced-motion", "value": "reduce"}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    browser.get(address)
    until(browser, "window.live && live.tracks.a && live.tracks.a.frames.length > 0")
    assert value(browser, "live.playing") is False
    before = value(browser, "live.time")
    until(browser, "live.stats.frames > 0")
    assert value(browser, "live.time") == before
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_all_controls_are_reached_by_the_keyboard(page: Any) -> None:
    reached = set()
    for _ in range(45):
        press(page, "\ue004")  # tabulator
        reached.add(value(page, "(a => a.id || a.dataset.do || a.className)(document.activeElement)"))
    wanted = {"play", "next-event", "next-signal", "speed", "time", "compare", "link", "save", "export"}
    assert (
        wanted | {"capacity", "leave", "partition", "failover", "agent", "reset", "control-latency"}
        <= reached
    )
