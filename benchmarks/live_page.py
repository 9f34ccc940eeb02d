"""The live page in a browser: frames per second, and how long a slider takes to show.

Run it from the root of the checkout: ``python -m benchmarks.live_page``.  It needs Chromium and chromedriver.
"""

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.harness import add_options, console, machine, positive, table, write_json

__all__ = ["main"]

# What the page begins with, but for the number of cameras.
SCENARIO = """
model = "models.smart_cameras"
dynamics = "continuous"
until = 2000
seed = {seed}
agents = "fleet"
parameters.n_cameras = {agents}
control_unit = {{ kind = "crossing", hold_off = 0.5 }}
channel = {{ latency = {{ kind = "exponential", mean = 0.6 }}, loss = 0.1 }}
"""
SIZE = (1440, 1000)  # of the window
PATIENCE = 120.0  # seconds until a page must have begun
WATCHED = 4.0  # seconds for which frames are counted

READY = "return Boolean(window.live && live.tracks.a && live.tracks.a.frames.length)"
# Counts what the browser draws at, and what the page has drawn in it.
FRAMES = """
const done = arguments[1], end = performance.now() + 1000 * arguments[0], drawn = live.stats.frames;
let frames = 0, before = performance.now(), longest = 0;
const begin = before;
const count = (now) => {
  frames += 1;
  longest = Math.max(longest, now - before);
  before = now;
  if (performance.now() < end) requestAnimationFrame(count);
  else {
    const seconds = (performance.now() - begin) / 1000;
    done([frames / seconds, (live.stats.frames - drawn) / seconds, longest]);
  }
};
requestAnimationFrame(count);
"""
# From the event of a slider to data from the server, and to the frame that shows it.
SLIDER = """
const [value, done] = arguments, slider = document.getElementById("control-latency"), before = live.ids.a;
slider.value = value;
const at = performance.now();
slider.dispatchEvent(new Event("input", { bubbles: true }));
const look = () => {
  const picture = live.stats.pictures.a;
  if (live.ids.a > before && picture && picture.id === live.ids.a && picture.drawn) {
    done([picture.came - at, picture.drawn - at]);
  } else requestAnimationFrame(look);
};
look();
"""
COLUMNS = ("agents", "idle,\nframes/s", "playing,\nframes/s", "longest,\nms", "CPU ms a\npicture")
SLIDERS = ("data, ms\nbest", "median", "picture, ms\nbest", "median", "CPU ms,\nengine", "CPU ms,\nbrowser")
LEGEND = (
    "Longest: between two frames while playing.  Slider: from its event until data have come, and until the\n"
    "picture is drawn; the run begins anew and goes to the present time.  CPU: of all processes, which does\n"
    "not depend on what else the machine does; a picture of 60 a second may take 16.7 ms on each core."
)


class Seen(NamedTuple):
    """What one page does."""

    agents: int
    idle: float  # frames per second
    playing: float
    longest: float  # ms between two frames while playing
    picture: float  # CPU ms of the browser for each picture while playing
    sliders: list[tuple[float, float]]  # ms from a slider to data, and to the picture
    engine: float  # CPU ms of the server for each slider
    browser: float


def _cpu_ms(root: int) -> float:
    """Add up what a process and all that it has started have used; by Linux's /proc."""
    used, children = {}, defaultdict(list)
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:  # ended meanwhile
            continue
        pid = int(path.parent.name)
        children[int(fields[1])].append(pid)
        used[pid] = sum(map(int, fields[11:15]))  # its own and of ended children, user and system
    family = [root]
    for pid in family:
        family += children[pid]
    return 1000.0 * sum(used.get(pid, 0) for pid in family) / os.sysconf("SC_CLK_TCK")


@contextmanager
def _served(agents: int, seed: int, folder: Path) -> Iterator[tuple[str, int]]:
    """Start the command, and give the address at which it plays, and its process."""
    path = folder / f"cameras{agents}.toml"
    path.write_text(SCENARIO.format(agents=agents, seed=seed), encoding="utf-8")
    command = [sys.executable, "-u", "-m", "aimd_des", "live", str(path), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            said = server.stdout.readline()
            if not said:
                raise SystemExit("aimd-des live did not start; see its message above")
            yield said.split()[-1], server.pid  # Playing at ADDRESS
        finally:
            server.terminate()


@contextmanager
def _browser(folder: Path) -> Iterator[Any]:
    """Start Chromium without a window."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = str(shutil.which("chromium"))
    for switch in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={folder / 'browser'}",
    ):
        options.add_argument(switch)
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    driver.set_script_timeout(PATIENCE)
    driver.set_window_size(*SIZE)
    try:
        yield driver
    finally:
        driver.quit()


def _watch(driver: Any, address: str, server: int, agents: int, repeats: int) -> Seen:
    """Let a page begin, and measure it."""
    driver.get(address)
    begun = time.monotonic()
    while not driver.execute_script(READY):
        if time.monotonic() - begun > PATIENCE:
            raise SystemExit(f"the page of {agents} agents has not begun in {PATIENCE:g} s")
        time.sleep(0.1)
    time.sleep(WATCHED)  # until what begins once is over
    browser = driver.service.process.pid
    before = _cpu_ms(browser)
    playing, drawn, longest = driver.execute_async_script(FRAMES, WATCHED)
    picture = (_cpu_ms(browser) - before) / (drawn * WATCHED)
    driver.execute_script("document.getElementById('play').click()")
    idle, _, _ = driver.execute_async_script(FRAMES, WATCHED)
    before = np.array([_cpu_ms(server), _cpu_ms(browser)])
    sliders = [
        tuple(driver.execute_async_script(SLIDER, 0.5 + 0.05 * (place % 2))) for place in range(repeats)
    ]
    own = (np.array([_cpu_ms(server), _cpu_ms(browser)]) - before) / repeats
    return Seen(agents, idle, playing, longest, picture, sliders, *own.tolist())  # type: ignore[arg-type]


def _cells(seen: Seen) -> list[str]:
    data, picture = zip(*seen.sliders, strict=True)
    taken = [min(data), statistics.median(data), min(picture), statistics.median(picture)]
    numbers = [seen.idle, seen.playing, seen.longest, seen.picture, *taken, seen.engine, seen.browser]
    return [f"{seen.agents:,}", *(f"{one:.0f}" for one in numbers)]


def main(arguments: list[str] | None = None) -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.live_page", description="the live page")
    parser.add_argument("--agents", type=positive, nargs="+", default=[60, 1000], help="default: 60 and 1000")
    add_options(parser, repeats=20)
    options = parser.parse_args(arguments)
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        raise SystemExit("chromium and chromedriver: must be installed")
    out, host = console(), machine(("tornado", "selenium", "numpy", "numba"))
    out.print(", ".join(f"{name} {value}" for name, value in host.items()), soft_wrap=True)
    seen = []
    with tempfile.TemporaryDirectory() as place, _browser(Path(place)) as driver:
        for agents in options.agents:
            with _served(agents, options.seed, Path(place)) as (address, server):
                seen.append(_watch(driver, address, server, agents, options.repeats))
    out.print(table("The live page", (*COLUMNS, *SLIDERS), map(_cells, seen)))
    out.print(LEGEND, soft_wrap=True)
    if options.json:
        write_json(options.json, {"machine": host, "pages": [one._asdict() for one in seen]})


if __name__ == "__main__":
    main()
