"""Reports in a browser without a network: charts are drawn, controls move them, and nothing is asked for."""

import base64
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from aimd_des.report import report_run, report_study, write_page
from aimd_des.scenario.run_folder import load_run
from tests.command_line import run, write
from tests.reports import HOSTILE, HOSTILE_SCENARIO, results_of, study_of

pytestmark = [
    pytest.mark.skipif(
        not (shutil.which("chromium") and shutil.which("chromedriver")),
        reason="chromium and chromedriver are not installed",
    ),
    pytest.mark.usefixtures("own_folder"),
]

_SWITCHES = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)
_PATIENCE = 60.0
AXES = {"latency": [0.0, 0.5, 2.0], "loss": [0.0, 0.5], "way": ["tree", HOSTILE]}


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = str(shutil.which("chromium"))
    for switch in (*_SWITCHES, f"--user-data-dir={tmp_path_factory.mktemp('browser')}"):
        options.add_argument(switch)
    options.set_capability("goog:loggingPrefs", {"performance": "ALL", "browser": "ALL"})
    # The path is given, so that selenium does not look for a driver elsewhere.
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    driver.set_page_load_timeout(_PATIENCE)
    driver.execute_cdp_cmd("Network.enable", {})
    offline = {"offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0}
    driver.execute_cdp_cmd("Network.emulateNetworkConditions", offline)
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def study_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    write_page(report_study(results_of(study_of(AXES, title=HOSTILE), folder)), folder / "study.html")
    return folder / "study.html"


def look(browser: Any, width: int = 1200, scheme: str = "light") -> None:
    """Set the width of the window, and the scheme of colours."""
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)


def until(browser: Any, condition: str) -> None:
    """Wait for a condition of the page."""
    from selenium.webdriver.support.ui import WebDriverWait

    WebDriverWait(browser, _PATIENCE, 0.05).until(lambda driver: driver.execute_script(f"return {condition}"))


def open_page(browser: Any, path: Path, charts: int) -> None:
    browser.get_log("performance")
    browser.get_log("browser")
    browser.get(path.as_uri())
    until(browser, f"document.querySelectorAll('.chart svg').length === {charts}")


def requests(browser: Any) -> list[str]:
    """What was asked for since the last look, without what stands in the page itself."""
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    sent = [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]
    return [url for url in sent if not url.startswith("data:")]


def screenshot(browser: Any, path: Path) -> None:
    size = browser.execute_cdp_cmd("Page.getLayoutMetrics", {})["cssContentSize"]
    clip = {"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1}
    shot = browser.execute_cdp_cmd("Page.captureScreenshot", {"captureBeyondViewport": True, "clip": clip})
    path.write_bytes(base64.b64decode(shot["data"]))


def drawn(browser: Any, chart: str) -> str:
    """The shapes of a chart."""
    found = browser.execute_script(
        "return [...document.querySelectorAll(`[data-chart='${arguments[0]}'] svg .mark-line path,"
        " [data-chart='${arguments[0]}'] svg .mark-rect path`)].map(p => p.getAttribute('d')).join()",
        chart,
    )
    assert isinstance(found, str)
    return found


def press(browser: Any, *keys: str) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    ActionChains(browser).send_keys(*keys).perform()


def focused(browser: Any) -> str:
    """The element that has the focus, by its id or its kind."""
    found = browser.execute_script("const a = document.activeElement; return a.id || a.tagName.toLowerCase()")
    return str(found)


def test_the_page_of_a_run_draws_without_asking_for_anything(browser: Any, tmp_path: Path) -> None:
    write(HOSTILE_SCENARIO)
    assert run("five.toml").exit_code == 0
    path = tmp_path / "run.html"
    write_page(report_run(load_run(Path("results/five"))), path)
    look(browser)
    open_page(browser, path, 7)
    for chart in ("demand", "signals", "averages", "convergence", "error", "cost", "shares"):
        marks = browser.execute_script(
            f"return document.querySelectorAll(`[data-chart='{chart}'] svg [class*=mark-] path[d]`).length"
        )
        assert marks > 3, chart
    assert browser.get_log("browser") == []
    assert requests(browser) == [path.as_uri()]
    assert browser.execute_script("return window.hacked") is None
    assert browser.execute_script("return document.querySelector('h1').textContent") == HOSTILE
    screenshot(browser, tmp_path / "run.png")
    before = drawn(browser, "demand")
    browser.execute_script("document.getElementById('window').focus()")
    press(browser, "\ue014")  # arrow to the right
    until(browser, "document.querySelector('output[for=window]').textContent === '30.6'")
    until(browser, "document.getElementById('window').getAttribute('aria-valuetext') === '30.6'")
    assert _changes(browser, "demand", before)


def _changes(browser: Any, chart: str, before: str) -> bool:
    from selenium.webdriver.support.ui import WebDriverWait

    return bool(WebDriverWait(browser, _PATIENCE, 0.05).until(lambda driver: drawn(driver, chart) != before))


def test_sliders_and_choices_move_the_charts_of_a_study(
    browser: Any, study_page: Path, tmp_path: Path
) -> None:
    from selenium.webdriver.support.ui import Select

    look(browser)
    open_page(browser, study_page, 4)
    before = {chart: drawn(browser, chart) for chart in ("line-utilisation", "line-misallocation", "map")}
    assert all(len(shapes) > 50 for shapes in before.values())
    assert browser.execute_script("return document.getElementById('axis0').disabled")
    browser.execute_script("document.getElementById('axis1').focus()")
    press(browser, "\ue014")
    until(browser, "document.querySelector('output[for=axis1]').textContent === '0.5'")
    assert _changes(browser, "line-utilisation", before["line-utilisation"])
    assert _changes(browser, "line-misallocation", before["line-misallocation"])
    # The map runs up that axis itself; another resource is another map.
    cells = "document.querySelectorAll(`[data-chart=map] .mark-rect.role-mark path`)"
    fills = f"[...{cells}].map(cell => cell.getAttribute('fill')).join()"
    colours = browser.execute_script(f"return {fills}")
    Select(browser.find_element("id", "of")).select_by_visible_text("disk")
    until(browser, f"{fills} !== {colours!r}")
    Select(browser.find_element("id", "along")).select_by_visible_text("loss")
    until(browser, "document.getElementById('axis1').disabled && !document.getElementById('axis0').disabled")
    # The same axis up as along would be a diagonal: another one takes its place.
    until(browser, f"{cells}.length === 6")
    until(
        browser, "document.querySelector('[data-chart=map]').textContent.includes('latency (up) over loss')"
    )
    assert browser.get_log("browser") == []
    assert requests(browser) == [study_page.as_uri()]
    assert browser.execute_script("return window.hacked") is None


def test_all_controls_are_reached_by_the_keyboard(browser: Any, study_page: Path) -> None:
    look(browser)
    open_page(browser, study_page, 4)
    reached = []
    for _ in range(20):
        press(browser, "\ue004")  # tabulator
        reached.append(focused(browser))
    assert reached[0] == "a"  # to the results
    controls = [name for name in reached if name in {"along", "axis1", "axis2", "up", "measure", "of"}]
    assert controls[:6] == ["along", "axis1", "axis2", "measure", "of", "up"]
    assert "summary" in reached
    assert "axis0" not in reached


def test_a_chart_is_saved_as_the_rows_that_it_draws(browser: Any, study_page: Path) -> None:
    look(browser)
    open_page(browser, study_page, 4)
    until(browser, "document.querySelectorAll('.save:not([hidden])').length === 4")
    browser.execute_script(
        "URL.createObjectURL = (blob) => { blob.text().then(text => { window.saved = text; }); return '#'; };"
        "document.querySelector('[data-save=line-utilisation] button').click()"
    )
    until(browser, "window.saved !== undefined")
    head, *rows = browser.execute_script("return window.saved").strip().split("\r\n")
    columns = "mean of Utilisation (% of the capacity),low of Utilisation (% of the capacity)"
    assert head.startswith(f"latency,loss,way,resource,{columns}")
    assert len(rows) == 24
    assert rows[0].startswith("0,0,tree,memory,")
    # A text with commas and quotes is quoted.
    assert all(row.startswith(("0,", "0.5,", "2,")) for row in rows)
    assert sum('""quoted""' in row for row in rows) == 12


def test_points_lead_to_their_rows_and_rows_to_their_runs(browser: Any, study_page: Path) -> None:
    look(browser)
    open_page(browser, study_page, 4)
    browser.execute_script("document.querySelector('main details').open = false; location.hash = '#point3'")
    until(browser, "document.activeElement.id === 'point3'")
    assert browser.execute_script("return document.querySelector('main details').open")
    button = "document.querySelector('#point3 button')"
    browser.execute_script(f"{button}.click()")
    runs = browser.execute_script(
        "return [...document.querySelectorAll('.listed li')].map(li => li.textContent)"
    )
    assert [run.split(":")[0] for run in runs] == ["replication 0", "replication 1"]
    assert browser.execute_script(f"return {button}.getAttribute('aria-expanded')") == "true"
    browser.execute_script(f"{button}.click()")
    assert browser.execute_script("return document.querySelectorAll('.listed').length") == 0


_CONTRAST = """
const parts = (text) => text.match(/[\\d.]+/g).slice(0, 3).map(Number);
const linear = (c) => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
const weights = [0.2126, 0.7152, 0.0722];
const light = (rgb) => rgb.reduce((sum, c, k) => sum + linear(c / 255) * weights[k], 0);
const ground = light(parts(getComputedStyle(document.body).backgroundColor));
const texts = document.querySelectorAll("h1, h2, dt, dd, figcaption, .meaning, .chart svg text");
return [...texts].map((element) => {
  const style = getComputedStyle(element);
  const ink = light(parts(element.closest("svg") ? style.fill : style.color));
  return (Math.max(ink, ground) + 0.05) / (Math.min(ink, ground) + 0.05);
});
"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [360, 390, 1200])
def test_pages_are_legible_in_any_window(
    browser: Any, study_page: Path, tmp_path: Path, width: int, scheme: str
) -> None:
    look(browser, width, scheme)
    open_page(browser, study_page, 4)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    contrasts = browser.execute_script(_CONTRAST)
    assert len(contrasts) > 40
    assert min(contrasts) >= 4.5  # what WCAG asks for
    screenshot(browser, tmp_path / f"{width}_{scheme}.png")


def test_pages_can_be_printed(browser: Any, study_page: Path) -> None:
    look(browser, scheme="dark")
    open_page(browser, study_page, 4)
    pdf = base64.b64decode(browser.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})["data"])
    assert pdf.startswith(b"%PDF")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    assert browser.execute_script("return getComputedStyle(document.body).color") == "rgb(0, 0, 0)"
    hidden = "return [...document.querySelectorAll('.controls, .save')].every(e => e.offsetParent === null)"
    assert browser.execute_script(hidden)
    # On paper charts are drawn anew, so wide that letters keep their size.
    browser.execute_script("window.dispatchEvent(new Event('beforeprint'))")
    until(browser, "Number(document.querySelector('.chart svg').getAttribute('width')) < 700")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
