"""Watching changes nothing: the same digest as an unwatched run, whatever is shown, and how it is shown."""

import io
import os
import sys
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
from aimd_des.watch import LiveView, Monitor, NoKeys, PlainView, Snapshot, keyboard, last_snapshot
from aimd_des.watch.monitor import WatchedAgent
from aimd_des.watch.terminal import sparkline, tall_curve
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
    }
    simulation = Simulation(PROBLEM, **(setting | changes))
    return simulation.run(UNTIL) if looker is None else looker.play(simulation.start(UNTIL))


class Typed:
    """Keys that are pressed one after another, each at the next look; waiting passes the time of a clock."""

    def __init__(self, *keys: str, clock: "Clock | None" = None) -> None:
        self.keys, self.clock = list(keys), clock

    def read(self, seconds: float) -> str:
        if self.keys:
            return self.keys.pop(0)
        if self.clock is not None:
            self.clock.sleep(seconds)
        return ""


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
    # A sample shows what was until its instant: the change at 10 is in the one at 15.
    assert [look.capacity[0] / PROBLEM.capacity[0] for look in seen] == [1.0, 1.0, 1.0] + [0.5] * 5
    assert seen[4].demand.tolist() != [0.0, 0.0]
    assert seen[5].demand.tolist() == [0.0, 0.0]
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
    seen = Typed(clock=clock)
    looker = Monitor(
        lambda look: times.append((look.time, clock.now - 100.0)), 2.0, 4.0, clock=clock, keys=seen
    )
    simulated(looker, agents=Fleet)
    assert times == [(2.0 * k, 0.5 * k) for k in range(20)]
    assert looker.reached == 38.0


def test_a_run_that_is_late_does_not_wait() -> None:
    clock = Clock(tick=10.0)
    simulated(Monitor(lambda _: None, 2.0, 4.0, clock=clock, keys=Typed(clock=clock)), agents=Fleet)
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


# -- keys ------------------------------------------------------------------------------------------------


def pressed(*keys: str, **changes: Any) -> list[Snapshot]:
    """What is seen of a run in which keys are pressed, from the first look on."""
    seen: list[Snapshot] = []
    watched = simulated(Monitor(seen.append, 2.0, keys=Typed(*keys)), **changes)
    assert watched.digest == simulated(**changes).digest
    return seen


def test_a_pause_ends_with_the_same_key() -> None:
    seen = pressed(" ", " ")
    assert [look.paused for look in seen[:4]] == [True, False, False, False]
    assert [look.time for look in seen[:4]] == [0.0, 0.0, 0.0, 2.0]


def test_a_step_is_one_event_and_the_next_signal_is_come_to() -> None:
    seen = pressed("s", "n", "n", " ", **CONTINUOUS)
    assert [look.paused for look in seen[:5]] == [True, True, True, False, False]
    assert [look.signals.sum() for look in seen[1:4]] == [1, 2, 2]
    # From where the keys have led, looks are as far apart as before.
    assert np.diff([look.time for look in seen[4:]]) == pytest.approx(2.0)
    assert seen[4].time == seen[3].time


def test_a_step_past_the_end_ends_the_run() -> None:
    assert pressed(*["n"] * 500, **CONTINUOUS)[-1].time == UNTIL


def test_agents_are_chosen_by_tab_and_by_number() -> None:
    seen = pressed("\t", "\t", "\x1b[Z", "5", "9", "0", "\x1b[Z")
    assert [look.agent.number for look in seen[:7] if look.agent] == [1, 2, 1, 5, 5, 0, 5]
    agent = seen[-1].agent
    assert agent is not None
    assert agent.demand.shape == agent.average.shape == (2,)


def test_digits_that_follow_each_other_are_one_number() -> None:
    monitor = Monitor(print, 1.0)
    for digits, expected in (("1", 1), ("2", 12), ("9", 9), ("", 9), ("3", 3)):
        monitor._choose(digits, 20)
        assert monitor._agent == expected


def test_plus_and_minus_change_the_speed() -> None:
    clock, times = Clock(), []
    keys = Typed("+", "-", "-", "-", clock=clock)
    show = Monitor(lambda look: times.append((look.time, clock.now)), 2.0, 4.0, clock=clock, keys=keys)
    simulated(show)
    # From 4 to 8, and down to 1: two units of time take two seconds.
    assert np.diff([now for _, now in times[4:]]).tolist() == pytest.approx([2.0] * 19)
    slowed = Monitor(print, 2.0, None, clock=clock, keys=keys)
    slowed._press("+", simulation_in_progress())
    assert slowed._speed is None
    slowed._press("-", simulation_in_progress())
    assert slowed._speed == pytest.approx(UNTIL / 60.0)


def simulation_in_progress() -> Any:
    return Simulation(PROBLEM, seed=0).start(UNTIL)


def test_copies_in_flight_are_counted() -> None:
    seen, result = looks(0.7, channel=BroadcastChannel(latency=latency.Constant(0.3)), **CONTINUOUS)
    sent = result.signals_sent
    for look in seen:
        under_way = (sent.time < look.time) & (look.time < sent.time + 0.3)
        expected = [6 * np.count_nonzero(under_way & (sent.resource == j)) for j in range(2)]
        assert look.in_flight is not None
        assert look.in_flight.tolist() == expected
    assert any(look.in_flight is not None and look.in_flight.any() for look in seen)


@pytest.mark.skipif(sys.platform == "win32", reason="terminals of POSIX")
def test_the_keyboard_of_a_terminal_is_read_and_left_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    import pty
    import termios

    other, own = pty.openpty()
    before = termios.tcgetattr(own)
    with os.fdopen(own) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        with keyboard() as keys:
            assert keys.read(0.0) == ""
            os.write(other, b"n")
            assert keys.read(5.0) == "n"
        assert termios.tcgetattr(own) == before
    os.close(other)
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    with keyboard() as keys:
        assert isinstance(keys, NoKeys)


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
    assert 10 <= shown().count("last samples") <= 13


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


def test_a_full_terminal_has_tall_curves_the_agent_and_the_keys() -> None:
    raw = io.StringIO()
    sizes = {"width": 100, "height": 40}
    console = Console(file=raw, force_terminal=True, color_system="standard", legacy_windows=False, **sizes)
    view = LiveView(PROBLEM, 10.0, "A title", console, full=True)
    agent = WatchedAgent(1, np.array([0.5, 0.25]), np.array([0.4, 0.2]))
    seen = look()._replace(in_flight=np.array([7, 8]), agent=agent, paused=True)
    for height in (40, 20, 8):  # the terminal is made smaller
        console.size = (100, height)
        view._past.append(seen)
        lines = console.render_lines(view._page())
        assert height - 6 <= len(lines) <= height or height == 8
        text = "\n".join("".join(part.text for part in line) for line in lines)
        assert "agent 1: resource 0 0.5 (average 0.4), resource 1 0.25 (average 0.2)" in text
        assert "PAUSED  space: pause" in text
        assert "in flight" in text
    styles = {view._style(j) for j in range(7)}
    assert len(styles) == 7


def test_tall_curves_fill_from_below() -> None:
    assert tall_curve([0.0, 0.6, 1.2, 9.0], 2, 1.2) == ["  ██", " ███"]
    assert tall_curve([0.3], 2, 1.2) == [" ", "▄"]
    assert tall_curve([0.6, 1.2], 2, 1.2, plain=True) == [" #", "##"]


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
    assert "last samples" in outcome.stdout


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
        load_scenario(Path("steps.toml")).run(processes=[print])
