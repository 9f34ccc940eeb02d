"""Watching changes nothing: the same digest as an unwatched run, whatever is shown, and how it is shown."""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.cells import cell_len
from rich.console import Console

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    Recording,
    Result,
    Simulation,
    interventions,
    latency,
    loss,
)
from aimd_des.scenario import load_scenario
from aimd_des.watch import LiveView, Monitor, PlainView, Snapshot, last_snapshot
from aimd_des.watch.terminal import sparkline
from tests.command_line import digest, invoke, refusal, run, write
from tests.conftest import INLINE, assert_same_run, random_problem

UNTIL = 40.0
PROBLEM = random_problem(3, 6, 2)
CONTINUOUS = {"dynamics": "continuous", "control_unit": Crossing(hold_off=0.3)}


def simulated(looker: Monitor | None = None, **changes: Any) -> Result:
    setting: dict[str, Any] = {
        "channel": BroadcastChannel(latency=latency.Exponential(0.2), loss=loss.Bernoulli(0.1)),
        "recording": Recording(demand=0.7, allocations=0.7, events=True),
        "seed": 5,
        "processes": [] if looker is None else [looker.process],
    }
    return Simulation(PROBLEM, **(setting | changes)).run(UNTIL)


def looks(interval: float, **changes: Any) -> tuple[list[Snapshot], Result]:
    seen: list[Snapshot] = []
    return seen, simulated(Monitor(seen.append, interval), **changes)


@pytest.mark.parametrize("dynamics", [{}, CONTINUOUS], ids=["discrete", "continuous"])
@pytest.mark.parametrize("agents", [AgentProcess, Fleet])
def test_watching_changes_no_bit(dynamics: dict[str, Any], agents: Any) -> None:
    seen, watched = looks(0.31, agents=agents, **dynamics)
    assert len(seen) == 130
    assert_same_run(watched, simulated(agents=agents, **dynamics))


def test_a_process_that_meddles_is_not_overlooked() -> None:
    """The negative control of the test above."""

    def meddle(system: Any) -> Iterator[Any]:
        yield system.env.timeout(1.0)
        system.set_demand(0, 0, 0.0)

    assert simulated(processes=[meddle]).digest != simulated().digest


def test_looks_see_what_a_recording_keeps() -> None:
    seen, result = looks(0.7, agents=Fleet, **CONTINUOUS)
    kept, sent = result.observations, result.signals_sent
    # A recorder adds up in the order of the agents, a look as NumPy likes.
    for look, demand, average in zip(seen, kept.total_demand, kept.total_average, strict=False):
        assert look.demand == pytest.approx(demand, rel=1e-12)
        assert look.utilisation == pytest.approx(average / PROBLEM.capacity, rel=1e-12)
        assert look.capacity is PROBLEM.capacity
        expected = [np.count_nonzero((sent.time <= look.time) & (sent.resource == j)) for j in range(2)]
        assert look.signals.tolist() == expected
    assert np.isnan(seen[0].misallocation).all()
    last = last_snapshot(result)
    assert last.misallocation == pytest.approx(result.summary()["misallocation"].to_numpy(), rel=1e-9)
    assert last.utilisation == pytest.approx(result.summary()["utilisation"].to_numpy(), rel=1e-12)
    assert last.signals.tolist() == result.summary()["signals"].tolist()
    assert last.time == UNTIL


def test_looks_follow_interventions() -> None:
    step = interventions.CapacityStep(0, at=10.0, capacity=0.5 * PROBLEM.capacity[0])
    gone = interventions.Absence(PROBLEM.agent_names, at=20.0, until=900.0)
    seen, result = looks(5.0, interventions=[step, gone], agents=Fleet, **CONTINUOUS)
    assert [look.capacity[0] / PROBLEM.capacity[0] for look in seen] == [1.0, 1.0] + [0.5] * 6
    assert seen[4].demand.tolist() == [0.0, 0.0]
    assert np.isnan(last_snapshot(result).misallocation).all()
    assert np.isnan(last_snapshot(result).utilisation).all()


class Clock:
    """Real time that passes only when somebody waits, or reads the clock."""

    def __init__(self, tick: float = 0.0) -> None:
        self.now, self.tick, self.slept = 100.0, tick, 0.0

    def __call__(self) -> float:
        self.now += self.tick
        return self.now

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0.0
        self.now += seconds
        self.slept += seconds


def test_the_run_keeps_pace_with_real_time() -> None:
    clock, times = Clock(), []
    looker = Monitor(
        lambda look: times.append((look.time, clock.now - 100.0)), 2.0, 4.0, clock=clock, sleep=clock.sleep
    )
    simulated(looker, agents=Fleet)
    assert times == [(2.0 * k, 0.5 * k) for k in range(20)]
    assert looker.reached == 38.0


def test_a_run_that_is_late_does_not_wait() -> None:
    clock = Clock(tick=10.0)
    simulated(Monitor(lambda _: None, 2.0, 4.0, clock=clock, sleep=clock.sleep), agents=Fleet)
    assert clock.slept == 0.0


def test_measuring_takes_a_small_part_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Measuring takes a second, looking at the clock another one: of 40 looks the first and one 20 later."""
    for sparing, expected in ((True, 2), (False, 40)):
        measured: list[int] = []
        monkeypatch.setattr(
            "aimd_des.watch.monitor._misallocation", lambda *_, to=measured: to.append(1) or PROBLEM.capacity
        )
        simulated(Monitor(lambda _: None, 1.0, sparing=sparing, clock=Clock(tick=1.0)), agents=Fleet)
        assert len(measured) == expected


# -- views -----------------------------------------------------------------------------------------------


def look(time: float = 5.0, share: float = 0.9) -> Snapshot:
    return Snapshot(
        time,
        share * PROBLEM.capacity,
        PROBLEM.capacity,
        np.array([1234, 5]),
        np.array([0.5, 0.25]),
        np.array([0.0312, np.nan]),
    )


def live(
    width: int = 80, encoding: str = "utf-8", title: str = "", clock: Any = None
) -> tuple[LiveView, Any]:
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding, write_through=True)
    console = Console(file=stream, force_terminal=True, width=width, height=30, color_system=None)
    view = LiveView(PROBLEM, 10.0, title, console, *([] if clock is None else [clock]))
    return view, lambda: raw.getvalue().decode(encoding)


def test_a_picture_shows_demand_signals_and_measures() -> None:
    view, shown = live(title="A [bold]title[/bold] of its own")
    with view:
        view.show(look())
        view.end(look(10.0, 1.1))
    assert "A [bold]title[/bold] of its own" in shown()
    for word in (
        "time 5 of 10",
        "time 10 of 10",
        "resource 0",
        "90.0 %",
        "110.0 %",
        "1,234",
        "3.1 %",
        "┃",
        "▁█",
    ):
        assert word in shown(), word


@pytest.mark.parametrize("width", [40, 58, 66, 80, 200])
def test_a_picture_fits_its_terminal(width: int) -> None:
    view, shown = live(width)
    with view:
        for k in range(30):
            view.show(look(k / 3, 0.03 * k + 0.5))
    lines = shown().replace("\x1b[2K", "").replace("\x1b[1A", "").splitlines()
    assert max(cell_len(line) for line in lines) <= width + 20  # what hides and shows the cursor


def test_a_terminal_without_unicode_gets_ascii() -> None:
    view, shown = live(encoding="ascii")
    with view:
        view.show(look())
        view.end(look(10.0, 0.8))
    assert "####" in shown()
    assert "|" in shown()


def test_pictures_are_drawn_ten_times_a_second() -> None:
    clock = Clock()
    view, shown = live(clock=clock)
    with view:
        for k in range(101):
            clock.now = 100.0 + 0.01 * k
            view.show(look(k / 20))
    assert 10 <= shown().count("last looks") <= 13


def test_a_view_that_saw_nothing_shows_nothing() -> None:
    view, shown = live()
    with view:
        pass
    assert "resource" not in shown()


def test_views_say_how_often_they_look() -> None:
    view, _ = live()
    assert view.interval(None) == 10.0 / 1000
    assert view.interval(20.0) == 2.0
    assert PlainView(PROBLEM, 10.0, print).interval(20.0) == 0.5


def test_a_line_says_everything() -> None:
    lines: list[str] = []
    with PlainView(load_scenario(write()).problem(), 1e4, lines.append) as view:
        view.show(look(5000.0)._replace(demand=np.array([2.7, 1.8]), capacity=np.array([3.0, 2.0])))
    (line,) = lines
    assert line == (
        "time 5,000 of 10,000: memory (GB) 2.7 of 3, 1,234 signals, used 50.0 %, misallocation 3.1 %; "
        "disk 1.8 of 2, 5 signals, used 25.0 %, misallocation -"
    )


def test_sparklines_span_what_they_show() -> None:
    assert sparkline([0.0, 0.5, 1.0]) == "▁▅█"
    assert sparkline([2.0, 2.0]) == "▅▅"
    assert sparkline([0.0, 1.0], plain=True) == "_@"


# -- the command -----------------------------------------------------------------------------------------

pytestmark = pytest.mark.usefixtures("own_folder")


def test_watch_prints_lines_and_the_digest_of_run() -> None:
    write()
    outcome = invoke("watch", "five.toml")
    assert outcome.exit_code == 0, outcome.output
    *lines, last = outcome.stdout.splitlines()
    assert [line.split(":")[0] for line in lines] == [f"time {3 * k} of 60" for k in range(21)]
    assert run("five.toml", "--out", "there").exit_code == 0
    assert last == f"digest {digest('there')}"


def test_watch_takes_settings() -> None:
    write()
    changed = invoke("watch", "five.toml", "--until", "30", "--seed", "8", "--set", "channel.loss=0.5")
    assert run("five.toml", "--set", "until=30", "--seed", "8", "--set", "channel.loss=0.5").exit_code == 0
    assert changed.stdout.splitlines()[-1] == f"digest {digest('results/five')}"


def test_a_terminal_gets_a_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    write()
    monkeypatch.setenv("FORCE_COLOR", "1")
    outcome = invoke("watch", "five.toml", "--until", "30", "--speed", "1000")
    assert outcome.exit_code == 0
    assert "five agents, two resources" in outcome.stdout
    assert "last looks" in outcome.stdout


@pytest.mark.parametrize("terminal", [False, True])
def test_ctrl_c_ends_with_the_state_so_far(terminal: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    write()
    measured: list[float] = []

    def interrupted(*_: Any) -> np.ndarray:
        measured.append(1.0)
        if len(measured) == 5:
            raise KeyboardInterrupt
        return np.zeros(2)

    monkeypatch.setattr("aimd_des.watch.monitor._misallocation", interrupted)
    if terminal:
        monkeypatch.setenv("FORCE_COLOR", "1")
    outcome = invoke("watch", "five.toml")
    assert outcome.exit_code == 130
    assert "of 60." in outcome.stderr
    assert outcome.stderr.startswith("Stopped at time ")
    assert "memory" in outcome.stdout
    assert "digest" not in outcome.stdout
    assert "Traceback" not in outcome.output


def test_watch_refuses_what_it_cannot_show() -> None:
    write(INLINE.replace("seed = 4", 'seed = 4\ndynamics = "synchronous"'), "steps.toml")
    assert "dynamics = 'synchronous': must be 'discrete' or 'continuous'" in refusal("watch", "steps.toml")
    write()
    assert "0.0 is not in the range x>0.0" in refusal("watch", "five.toml", "--speed", "0")
    assert "until" in refusal("watch", "five.toml", "--until", "-3")
    with pytest.raises(InputError, match="for processes such as one that watches"):
        load_scenario(Path("steps.toml")).run(processes=[Monitor(print, 1.0).process])
