"""Events of one instant: interventions, arrivals, the control unit, observers, agents; in no other order."""

import math
from collections.abc import Callable, Generator
from itertools import pairwise, permutations
from typing import Any

import pytest
import simpy
from hypothesis import given
from hypothesis import strategies as st

from aimd_des import InputError, SimulationError
from aimd_des.engine.environment import EventKind, Mailbox, OrderedEnvironment

Log = list[Any]


@pytest.fixture
def env() -> OrderedEnvironment:
    return OrderedEnvironment()


def note(log: Log, what: object) -> Callable[[simpy.Event], None]:
    return lambda event: log.append(what)


def call_at(
    env: OrderedEnvironment,
    time: float,
    kind: EventKind,
    callback: Callable[[simpy.Event], None],
    order: int | None = None,
) -> None:
    env.at(time, kind, order).callbacks.append(callback)


def test_the_order_is_the_one_of_the_model() -> None:
    assert [kind.name for kind in sorted(EventKind)] == ["INTERVENE", "DELIVER", "SENSE", "OBSERVE", "ACT"]
    assert min(EventKind) > 1  # SimPy itself uses 0 and 1


@pytest.mark.parametrize(("first", "second"), list(permutations(EventKind, 2)), ids=lambda kind: kind.name)
def test_of_two_kinds_the_lower_is_first_however_they_were_scheduled(
    env: OrderedEnvironment, first: EventKind, second: EventKind
) -> None:
    log: Log = []
    for kind in (first, second):
        call_at(env, 1.0, kind, note(log, kind))
    env.run_to(2.0)
    assert log == sorted([first, second])


@given(st.data())
def test_shuffled_events_are_handled_by_time_kind_and_turn(data: st.DataObject) -> None:
    events = [(time, kind, copy) for time in (0.0, 0.1, 7.0) for kind in EventKind for copy in range(2)]
    shuffled = data.draw(st.permutations(events))
    env, log = OrderedEnvironment(), Log()
    for event in shuffled:
        call_at(env, event[0], event[1], note(log, event))
    env.run_to(8.0)
    assert log == sorted(shuffled, key=lambda event: event[:2])  # sorted is stable: turns are kept


@given(st.permutations(range(6)))
def test_agents_act_in_the_order_of_their_index(indices: list[int]) -> None:
    env, log = OrderedEnvironment(), Log()
    for index in indices:
        call_at(env, 1.0, EventKind.ACT, note(log, index), order=index)
    env.run_to(2.0)
    assert log == [0, 1, 2, 3, 4, 5]


def test_agents_come_before_what_acts_without_an_index(env: OrderedEnvironment) -> None:
    log: Log = []
    call_at(env, 1.0, EventKind.ACT, note(log, "no index"))
    call_at(env, 1.0, EventKind.ACT, note(log, "agent"), order=10**9)
    env.run_to(2.0)
    assert log == ["agent", "no index"]


def test_reserved_numbers_keep_the_turn_in_which_they_were_reserved(env: OrderedEnvironment) -> None:
    log: Log = []
    first = env.reserve(3)
    call_at(env, 1.0, EventKind.DELIVER, note(log, "afterwards"))
    for position in (2, 0, 1):
        call_at(env, 1.0, EventKind.DELIVER, note(log, position), order=first + position)
    env.run_to(2.0)
    assert log == [0, 1, 2, "afterwards"]


def test_events_scheduled_during_an_instant_take_their_place_in_it(env: OrderedEnvironment) -> None:
    log: Log = []

    def look(event: simpy.Event) -> None:
        log.append("look")
        call_at(env, env.now, EventKind.DELIVER, note(log, "arrives at once"))

    call_at(env, 1.0, EventKind.ACT, note(log, "tick"))
    call_at(env, 1.0, EventKind.OBSERVE, note(log, "observe"))
    call_at(env, 1.0, EventKind.SENSE, look)
    env.run_to(2.0)
    assert log == ["look", "arrives at once", "observe", "tick"]


def test_processes_see_the_times_and_the_order(env: OrderedEnvironment) -> None:
    log: Log = []

    def live(name: str, kind: EventKind) -> Generator[simpy.Event, Any, None]:
        for q in range(3):
            yield env.at(q * 0.1, kind)
            log.append((name, env.now))

    for name, kind in (("agent", EventKind.ACT), ("control unit", EventKind.SENSE)):
        env.process(live(name, kind))
    env.run_to(0.2)
    assert log == [("control unit", 0.0), ("agent", 0.0), ("control unit", 0.1), ("agent", 0.1)]
    env.run_to(math.nextafter(0.2, 1.0))
    assert log[4:] == [("control unit", 0.2), ("agent", 0.2)]


def test_times_are_absolute(env: OrderedEnvironment) -> None:
    # SimPy's own timeouts would miss these: now + (t - now) is not t.
    seen: list[float] = []
    times = [0.1 * 3.7**q for q in range(20)]

    def live() -> Generator[simpy.Event, Any, None]:
        for time in times:
            yield env.at(time, EventKind.ACT)
            seen.append(env.now)

    env.process(live())
    env.run_to(1e12)
    assert seen == times
    assert any(now + (time - now) != time for now, time in pairwise(times))


@pytest.mark.parametrize("time", [math.nan, math.inf, -math.inf, -1.0, 4.999])
def test_a_time_that_is_past_or_none_is_refused(env: OrderedEnvironment, time: float) -> None:
    env.run_to(5.0)
    with pytest.raises(
        InputError, match=rf"^time = {time!r}: must be finite and not before the present, 5\.0$"
    ):
        env.at(time, EventKind.ACT)


def test_the_present_is_not_past(env: OrderedEnvironment) -> None:
    log: Log = []
    env.run_to(5.0)
    call_at(env, 5.0, EventKind.ACT, note(log, "now"))
    env.run_to(5.5)
    assert log == ["now"]


def test_what_is_due_at_the_end_does_not_happen(env: OrderedEnvironment) -> None:
    log: Log = []
    for time in (0.0, math.nextafter(3.0, 0.0), 3.0, 4.0):
        call_at(env, time, EventKind.INTERVENE, note(log, time))
    env.run_to(3.0)
    assert log == [0.0, math.nextafter(3.0, 0.0)]
    assert env.now == 3.0


def test_the_clock_stands_at_the_end_even_if_nothing_happened(env: OrderedEnvironment) -> None:
    assert env.now == 0.0
    env.run_to(2.5)
    assert env.now == 2.5


def test_a_mailbox_resumes_who_waits_within_the_present_event(env: OrderedEnvironment) -> None:
    log: Log = []
    mailbox = Mailbox(env)

    def wait() -> Generator[simpy.Event, Any, None]:
        while True:
            letter = yield mailbox
            log.append((letter, env.now))

    def hand(event: simpy.Event) -> None:
        log.append("before")
        mailbox.hand("first")
        mailbox.hand("second")
        log.append("after")

    env.process(wait())
    call_at(env, 1.0, EventKind.DELIVER, hand)
    call_at(env, 1.0, EventKind.DELIVER, note(log, "next event"))
    call_at(env, 2.5, EventKind.DELIVER, lambda event: mailbox.hand("third"))
    env.run_to(3.0)
    assert log == ["before", ("first", 1.0), ("second", 1.0), "after", "next event", ("third", 2.5)]


def test_an_event_of_simpy_would_queue_behind_others_of_its_instant(env: OrderedEnvironment) -> None:
    log: Log = []
    letter = env.event()
    letter.callbacks.append(note(log, "letter"))

    def hand(event: simpy.Event) -> None:
        letter.succeed()
        log.append("after")

    call_at(env, 1.0, EventKind.DELIVER, hand)
    env.run_to(2.0)
    assert log == ["after", "letter"]


def test_the_clock_advances_within_an_event_until_something_else_is_due(env: OrderedEnvironment) -> None:
    log: Log = []

    def go_on(_: simpy.Event) -> None:
        due = [
            (1.5, EventKind.DELIVER, 7),
            (2.0, EventKind.DELIVER, 7),
            (2.0, EventKind.SENSE, 5),
            (2.0, EventKind.SENSE, 7),
        ]
        for time, kind, order in due:
            log.append((time, kind.name, order, env.advance(time, kind, order), env.now))

    call_at(env, 1.0, EventKind.DELIVER, go_on)
    call_at(env, 2.0, EventKind.SENSE, note(log, "look"), order=6)
    env.run_to(5.0)
    assert log == [
        (1.5, "DELIVER", 7, True, 1.5),
        (2.0, "DELIVER", 7, True, 2.0),
        (2.0, "SENSE", 5, True, 2.0),
        (2.0, "SENSE", 7, False, 2.0),
        "look",
    ]


def test_what_is_upcoming_is_plain_numbers(env: OrderedEnvironment) -> None:
    """Compiled code that is given an EventKind would be compiled once more."""
    assert [type(part) for part in env.upcoming] == [float, int, int]
    env.at(1.0, EventKind.SENSE)
    assert env.upcoming[:2] == (1.0, EventKind.SENSE)
    assert [type(part) for part in env.upcoming] == [float, int, int]


def test_whose_turn_is_over(env: OrderedEnvironment) -> None:
    """That of who acts now, and of all before; of everybody when somebody without an index has acted."""
    seen: Log = []

    def look(_: simpy.Event) -> None:
        seen.append([env.has_acted(agent) for agent in (1, 2, 3, None)])

    for kind, order in ((EventKind.OBSERVE, None), (EventKind.ACT, 2), (EventKind.ACT, None)):
        call_at(env, 1.0, kind, look, order=order)
    call_at(env, 2.0, EventKind.OBSERVE, look)
    env.run_to(3.0)
    assert seen == [[False] * 4, [True, True, False, False], [True] * 4, [False] * 4]


def test_an_error_in_a_process_ends_the_run_with_its_own_message(env: OrderedEnvironment) -> None:
    def fail() -> Generator[simpy.Event, Any, None]:
        yield env.at(1.0, EventKind.ACT)
        raise SimulationError("at 1: memory: nobody can respond")

    env.process(fail())
    with pytest.raises(SimulationError, match=r"^at 1: memory: nobody can respond$"):
        env.run_to(2.0)
    assert env.now == 1.0


def test_a_watcher_hears_every_few_thousand_events_and_the_end(env: OrderedEnvironment) -> None:
    heard: list[tuple[float, int]] = []
    for q in range(10_000):
        call_at(env, float(q), EventKind.ACT, note([], q))
    env.run_to(9_999.5, lambda now, handled: heard.append((now, handled)))
    assert heard[-1] == (9_999.5, 10_000)
    assert [handled for _, handled in heard[:-1]] == [4096, 8192]
    assert [now for now, _ in heard[:-1]] == [4095.0, 8191.0]


def test_the_clock_is_set_by_nobody_and_read_by_simpy(env: OrderedEnvironment) -> None:
    with pytest.raises(AttributeError, match="now"):
        env.now = 1.0  # type: ignore[misc]
    log: Log = []
    call_at(env, 2.0, EventKind.SENSE, lambda _: log.append(env.timeout(0.5)))
    env.run_to(2.25)
    # One of SimPy's own events counts from where the clock stood when it was made.
    assert [(env.now, env.peek())] == [(2.25, 2.5)]
    assert log[0].callbacks == []
