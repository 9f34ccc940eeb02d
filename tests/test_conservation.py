"""Nothing appears and nothing is lost: demand, averages and copies, added up from the event log alone.

The books are kept in plain Python from the log, the problem and the times of ticks; nothing of the
program's own arithmetic is used.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aimd_des import (
    BroadcastChannel,
    Clocks,
    Crossing,
    Recording,
    Result,
    Sampled,
    Simulation,
    averaging,
    latency,
    loss,
    run_synchronous,
)
from aimd_des.engine.environment import EventKind
from models import smart_cameras
from tests.conftest import quietly, random_problem
from tests.forks import forks
from tests.support.configurations import (
    Configuration,
    OwnLooks,
    SetDemands,
    averagings,
    configurations,
    plain_channels,
)
from tests.support.reference_asynchronous import tick_times

#: Whatever is drawn, with no other record than the log; books are kept up to the end of rather short runs.
ANY: dict[str, Any] = {
    "until": st.sampled_from([0.5, 7.0, 30.0, 43.21]),
    "recording": lambda problem, dynamics, until: st.just(Recording(demand="end", events=True)),
    # Books are kept of the paper's cut and of plain averages; test_responses has the others by hand.
    "averaging": lambda problem, dynamics, until: averagings().filter(
        lambda chosen: not isinstance(chosen, averaging.Polynomial)
    ),
    "response": lambda problem, dynamics, until: st.none(),
}


def ticks_of(configuration: Configuration) -> list[list[float]] | None:
    """The times of all ticks before the end, of discrete agents."""
    if configuration.parts["dynamics"] == "continuous":
        return None
    clocks = configuration.parts["clocks"] or Clocks()
    return tick_times(configuration.seed, configuration.until, configuration.problem.n_agents, **vars(clocks))


#: One entry of the log: time, kind, resource, agent, number, value.
Row = tuple[float, str, int, int, int, float]


def log_of(result: Result) -> list[Row]:
    """The log as plain tuples, with indices instead of names; agent -1 where an entry is about all."""
    events = result.events
    return list(
        zip(
            events["time"].tolist(),
            events["kind"].tolist(),
            events["resource"].cat.codes.tolist(),
            events["agent"].cat.codes.tolist(),
            events["number"].tolist(),
            events["value"].tolist(),
            strict=True,
        )
    )


def changes_of(result: Result, entries: int | None = None) -> dict[tuple[int, int], list[Row]]:
    """What the log, or its beginning, says about the demand of each agent for each resource."""
    n, m = result.problem.n_agents, result.problem.n_resources
    changes: dict[tuple[int, int], list[Row]] = {(i, j): [] for i in range(n) for j in range(m)}
    for row in log_of(result)[:entries]:
        if row[1] in ("respond", "hold", "change"):
            changes[row[3], row[2]].append(row)
        elif row[1] in ("leave", "join"):
            for j in range(m):
                changes[row[3], j].append(row)
    return changes


# -- demand ----------------------------------------------------------------------------------------------


@dataclass
class Books:
    """Demand of one agent for one resource as the log has it, and what each cut was a share of."""

    demand: float
    average: float
    increases: float
    decreases: float
    cuts: list[tuple[float, float]]


def full_parts(window: averaging.Window, age: float) -> float:
    """The age at which a window begins: that of its oldest mark."""
    part = window.length / window.parts
    return max(math.floor(age / part + 1e-9) - window.parts + 1, 0) * part


def average_of_lines(lines: list[tuple[float, float, float]], way: averaging.Averaging | None) -> float:
    """Average demand that was one line after another: duration, demand at the start, slope."""
    age = math.fsum(duration for duration, _, _ in lines)
    begin = full_parts(way, age) if isinstance(way, averaging.Window) else 0.0
    constant = way.time_constant if isinstance(way, averaging.Forgetting) else 0.0
    weighted, time = [], 0.0
    for duration, start, slope in lines:
        first, last = max(time, begin), time + duration
        if last > first:
            one, other = start + slope * (first - time), start + slope * duration
            if constant:  # by parts: the integral of (a + b s) exp((s - age) / T)
                early, late = math.exp((first - age) / constant), math.exp((last - age) / constant)
                weighted.append(
                    constant * (other * late - one * early) - constant**2 * slope * (late - early)
                )
            else:
                weighted.append(0.5 * (one + other) * (last - first))
        time = last
    total = constant * -math.expm1(-age / constant) if constant else age - begin
    return math.fsum(weighted) / total if age > 0.0 else 0.0


def average_of_ticks(demands: list[float], way: averaging.Averaging | None) -> float:
    """Average what was held at the ticks, one by one."""
    if isinstance(way, averaging.Window):
        demands = demands[int(full_parts(way, len(demands))) :]
    rate = 1.0 / way.time_constant if isinstance(way, averaging.Forgetting) else 0.0
    weights = [math.exp(-late * rate) for late in range(len(demands))]
    pairs = zip(demands[::-1], weights, strict=True)
    return math.fsum(held * weight for held, weight in pairs) / math.fsum(weights) if demands else 0.0


def keep_continuous(
    alpha: float, changes: list[Row], until: float, way: averaging.Averaging | None = None
) -> Books:
    """Add up lines between changes, for as long as the agent is here."""
    time = demand = active = 0.0
    cuts, lowered, here = [], [], True
    lines: list[tuple[float, float, float]] = []
    for at, kind, _, _, _, value in [*changes, (until, "hold", 0, 0, 0, 0.0)]:
        grown = demand
        if here:
            grown += alpha * (at - time)
            active += at - time
            lines.append((at - time, demand, alpha))
        time = at
        if kind == "respond":
            cuts.append((grown, value))
        change = {"respond": -value, "change": value}.get(kind, 0.0)
        demand = grown + change
        lowered.append(-change)
        if kind in ("leave", "join"):
            here = kind == "join"
            lines = [] if kind == "join" and value == 1.0 else lines
            assert abs(demand) <= 1e-9 * max(alpha * active, 1e-300), "nothing is kept by who leaves"
            demand = 0.0
    average = average_of_lines(lines, way)
    return Books(demand, average, alpha * active, math.fsum(lowered), cuts)


def keep_discrete(
    alpha: float, changes: list[Row], ticks: list[float], way: averaging.Averaging | None = None
) -> Books:
    """Go from tick to tick: fold in, then answer as the log says or add; for as long as the agent is here."""
    demand = 0.0
    added, cuts, lowered, here = 0, [], [], True
    held: list[float] = []
    answers = {row[0]: row for row in changes if row[1] in ("respond", "hold")}
    assert len(answers) == sum(row[1] in ("respond", "hold") for row in changes), (
        "one answer in a tick at most"
    )
    assert set(answers) <= set(ticks), "answers are given at ticks"
    interventions = [row for row in changes if row[1] not in ("respond", "hold")]
    for time in [*ticks, math.inf]:
        while interventions and interventions[0][0] <= time:
            _, kind, _, _, _, value = interventions.pop(0)
            if kind == "change":
                demand += value
                lowered.append(-value)
            else:
                here = kind == "join"
                held = [] if kind == "join" and value == 1.0 else held
                assert abs(demand) <= 1e-9 * max(alpha * (added + 1), 1e-300), "nothing is kept by who leaves"
                demand = 0.0
        if not here:
            assert time not in answers, "who is away answers nothing"
            continue
        held.append(demand)
        if time in answers:
            _, kind, _, _, _, value = answers[time]
            if kind == "respond":
                cuts.append((demand, value))
            demand -= value
            lowered.append(value)
        elif time < math.inf:
            demand += alpha
            added += 1
    return Books(demand, average_of_ticks(held, way), alpha * added, math.fsum(lowered), cuts)


def books_of(configuration: Configuration, result: Result) -> dict[tuple[int, int], Books]:
    ticks, changes = ticks_of(configuration), changes_of(result)
    increase, way = result.problem.increase.tolist(), configuration.parts.get("averaging")
    return {
        (i, j): keep_continuous(increase[i][j], rows, configuration.until, way)
        if ticks is None
        else keep_discrete(increase[i][j], rows, ticks[i], way)
        for (i, j), rows in changes.items()
    }


def assert_books_balance(configuration: Configuration, result: Result) -> None:
    for (i, j), books in books_of(configuration, result).items():
        # Where much was given back, what is left is a small difference of what was added and cut: hence
        # relative to the larger of the two.
        scale = max(books.increases, books.decreases, books.demand, 1e-300)
        left = result.demand_at_end[i, j]
        assert abs(left - (books.increases - books.decreases)) <= 1e-9 * scale, (i, j)
        assert abs(left - books.demand) <= 1e-9 * scale, (i, j)
        assert abs(result.average_at_end[i, j] - books.average) <= 1e-9 * scale, (i, j)
        beta = result.problem.decrease[i, j]
        for before, cut in books.cuts:
            assert abs(cut - (1.0 - beta) * before) <= 1e-9 * scale, (i, j)
        assert len(books.cuts) == result.account.responses[j, i]


@given(configurations(dynamics=("continuous",), **ANY))
def test_continuous_demand_is_what_was_added_less_what_was_cut(configuration: Configuration) -> None:
    assert_books_balance(configuration, configuration.run())


@given(configurations(dynamics=("discrete",), **ANY))
def test_discrete_demand_is_what_was_added_less_what_was_cut(configuration: Configuration) -> None:
    assert_books_balance(configuration, configuration.run())


# -- copies ----------------------------------------------------------------------------------------------


def assert_copies_are_accounted_for(result: Result) -> None:
    account, n, m = result.account, result.problem.n_agents, result.problem.n_resources
    signals = result.signals_sent.counts(m)
    total = account.delivered + account.lost + account.in_flight
    assert (total == signals[:, None]).all()  # for each receiver
    log = log_of(result)
    counted = Counter((kind, j, i, value) for _, kind, j, i, _, value in log if kind in ("deliver", "lost"))
    for kind, value, count in (
        ("deliver", 0.0, account.delivered),
        ("deliver", 1.0, account.duplicated),
        ("lost", 0.0, account.lost),
    ):
        assert [[counted[kind, j, i, value] for i in range(n)] for j in range(m)] == count.tolist(), kind
    assert {value for kind, _, _, value in counted if kind == "lost"} <= {0.0, 1.0}  # duplicates for nobody
    sent = [(time, j, number) for time, kind, j, _, number, _ in log if kind == "signal"]
    frame = result.signals_sent
    assert sent == list(zip(frame.time.tolist(), frame.resource.tolist(), frame.number.tolist(), strict=True))
    # Copies of different fates are of different broadcasts, and nothing arrives that was not sent.
    fates = [row[1:5] for row in log if row[1] in ("lost", "deliver") and row[5] == 0.0]
    assert max(Counter((j, i, number) for _, j, i, number in fates).values(), default=1) == 1
    assert {(j, number) for _, j, _, number in fates} <= {(j, number) for _, j, number in sent}


@given(configurations(**ANY))
def test_every_copy_is_delivered_lost_or_in_flight(configuration: Configuration) -> None:
    assert_copies_are_accounted_for(configuration.run())


def losing(lost: float) -> st.SearchStrategy[Configuration]:
    """Configurations in which nothing but the channel loses copies: with this probability."""
    return configurations(
        **ANY,
        interventions=lambda problem, dynamics, until: st.just([]),
        channel=lambda problem, dynamics, until: plain_channels(problem.n_agents).map(
            lambda channel: replace(channel, loss=lost, duplication=0.0)
        ),
    )


@given(losing(0.0))
def test_no_copy_is_lost_or_doubled_by_a_channel_that_does_neither(configuration: Configuration) -> None:
    account = configuration.run().account
    assert account.lost.sum() == account.duplicated.sum() == 0


@given(losing(1.0))
def test_nothing_is_delivered_by_a_channel_that_loses_everything(configuration: Configuration) -> None:
    account = configuration.run().account
    assert account.delivered.sum() == account.duplicated.sum() == 0
    assert account.in_flight.sum() == account.responses.sum() == 0


@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_a_copy_is_in_flight_when_it_arrives_at_the_end_or_later(delay: float) -> None:
    channel = BroadcastChannel(latency=[0.0, 2.0, 1000.0])
    control_unit = Crossing(0.5, sensing_delay=delay)
    problem = random_problem(1, 3, 2)
    parts = {"dynamics": "continuous", "control_unit": control_unit, "channel": channel, "seed": 3}
    result = quietly(Simulation(problem, **parts).run, 40.0)
    for j in range(2):
        times = result.signals_sent.time[result.signals_sent.resource == j]
        late = [int((times + delay + wait >= 40.0).sum()) for wait in (0.0, 2.0, 1000.0)]
        assert result.account.in_flight[j].tolist() == late
        assert late[1] > 0
        assert late[2] == len(times) > 10


# -- what a signal says ----------------------------------------------------------------------------------


@given(configurations(**ANY))
def test_a_signal_is_entered_with_the_total_that_caused_it(configuration: Configuration) -> None:
    result = configuration.run()
    log, ticks, problem = log_of(result), ticks_of(configuration), result.problem
    unit = configuration.parts["control_unit"]
    # The share of the threshold from which on it signals.
    least = getattr(unit, "low", 0.7 if isinstance(unit, OwnLooks) else 1.0)
    for turn, (now, kind, j, _, _, value) in enumerate(log):
        if kind != "signal":
            continue
        before = changes_of(result, turn)
        held = [
            keep_continuous(problem.increase[i, j], before[i, j], now).demand
            if ticks is None
            else keep_discrete(
                problem.increase[i, j], before[i, j], [time for time in ticks[i] if time < now]
            ).demand
            for i in range(problem.n_agents)
        ]
        assert value == pytest.approx(sum(held), rel=1e-9)
        limits = [row[5] * problem.threshold[j] for row in log[:turn] if row[1] == "capacity" and row[2] == j]
        assert value > least * [problem.limit[j], *limits][-1] * (1.0 - 1e-12)


# -- order -----------------------------------------------------------------------------------------------


INTERVENTIONS = ("change", "leave", "join", "capacity", "costs", "cut", "heal", "fail", "recover")


def place(
    row: Row, broadcast: dict[tuple[int, int], int], sent_at: dict[Any, float], delay: float
) -> tuple[float, ...]:
    """Where an entry stands among those of its instant."""
    time, kind, j, agent, number, value = row
    if kind in INTERVENTIONS:
        return (EventKind.INTERVENE,)
    # A copy that is lost on its way is so from the start; one that is cut, when it leaves, ahead of those
    # that arrive at once; one that finds nobody, when it lands.
    if kind == "deliver" or (kind == "lost" and sent_at[j, number] < time):
        leaves = kind == "lost" and time == sent_at[j, number] + delay
        return (EventKind.DELIVER, broadcast[j, number], -1.0 if leaves else value, agent)
    if kind in ("signal", "lost"):
        return (EventKind.SENSE, j, agent)
    return (EventKind.ACT, agent, j)


def without_answers(rows: Iterator[Row]) -> list[Row]:
    """Take out the answers of continuous agents: each stands just behind the copy that it answers."""
    kept = []
    for row in rows:
        kept.append(row)
        if row[1] == "deliver":
            answer = next(rows, row)
            assert answer[1] in ("respond", "hold")
            assert answer[2:5] == row[2:5]
    return kept


def assert_log_is_in_order(log: list[Row], dynamics: str, delay: float) -> None:
    """Hold the log to the rules: what is later in the order comes first only where it is the cause."""
    sent = [(row[2], row[4]) for row in log if row[1] == "signal"]
    broadcast = {signal: turn for turn, signal in enumerate(sent)}
    sent_at = {(row[2], row[4]): row[0] for row in log if row[1] == "signal"}
    assert all(one[0] <= other[0] for one, other in pairwise(log))
    away: set[int] = set()
    for time, rows in groupby(log, key=lambda row: row[0]):
        instant = list(rows)
        away |= {row[3] for row in instant if row[1] == "leave"}
        away -= {row[3] for row in instant if row[1] == "join"}
        if dynamics == "continuous":
            instant = without_answers(iter(instant))
        for one, other in pairwise(instant):
            if one[1] in INTERVENTIONS and other[1] in INTERVENTIONS:
                continue  # in the order in which they were declared
            if any(
                row[1] == "lost"
                and row[3] in away
                and time in (sent_at[row[2], row[4]], sent_at[row[2], row[4]] + delay)
                for row in (one, other)
            ):
                continue  # lost on its way or cut, or landed at once where nobody is: no entry tells which
            at_once = one[1] in ("signal", "lost") and other[1] == "deliver"
            caused = at_once and sent_at[other[2], other[4]] == time
            before, after = (place(row, broadcast, sent_at, delay) for row in (one, other))
            assert caused or before < after, (one, other)


@given(configurations(**ANY))
def test_no_entry_of_the_log_is_out_of_order(configuration: Configuration) -> None:
    parts = configuration.parts
    assert_log_is_in_order(
        log_of(configuration.run()), parts["dynamics"], parts["control_unit"].sensing_delay
    )


# -- the same run ----------------------------------------------------------------------------------------


def example(dynamics: str, control_unit: Any, late: Any, lost: Any, twice: float) -> Configuration:
    problem = random_problem(1, 5, 2, "coupled", per_agent=True, threshold=True)
    share = problem.capacity / 5
    planned = (
        (7.25, 0, 1, 0.5 * share[1]),
        (11.0, 3, 0, 0.0),
        (20.0, 4, 1, share[1]),
        (33.5, 0, 0, share[0]),
    )
    parts = {
        "dynamics": dynamics,
        "control_unit": control_unit,
        "clocks": Clocks(1.1, 0.25, -0.02, 0.9) if dynamics == "discrete" else None,
        "channel": BroadcastChannel(late, lost, duplication=twice),
        "processes": [SetDemands(planned)],
        "recording": Recording(demand="end", events=True),
    }
    return Configuration(problem, 1, 60.0, parts)


OFTEN = Sampled(0.5, 0.25, sensing_delay=0.3)
DELAYED = Crossing(0.4, sensing_delay=0.3)
BURSTS = loss.GilbertElliott(0.3, 2.0)
EXAMPLES = {
    "discrete": example("discrete", Sampled(), 0.0, 0.0, 0.0),
    "discrete, late": example("discrete", OFTEN, latency.Exponential(1.1), BURSTS, 0.4),
    "continuous, late": example("continuous", OFTEN, latency.LogNormal(0.5, 1.0), 0.3, 0.0),
    "crossing": example("continuous", Crossing(1.0), 0.0, 0.0, 0.4),
    "crossing, late": example("continuous", DELAYED, latency.Exponential(1.1), BURSTS, 0.4),
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_same_seed_is_the_same_run_and_another_seed_another(name: str) -> None:
    configuration = EXAMPLES[name]
    result = configuration.run()
    assert configuration.run().digest == result.digest
    kinds = Counter(row[1] for row in log_of(result))
    assert min(kinds[kind] for kind in ("signal", "deliver", "respond", "hold", "change")) >= 3
    problem, parts = result.problem, {"dynamics": result.dynamics, "recording": Recording(events=True)}
    digests = {quietly(Simulation(problem, seed=seed, **parts).run, 60.0).digest for seed in range(20)}
    assert len(digests) == 20  # the problem is the same: it is the luck that differs


def of_cameras() -> list[str]:
    """Two runs of a model: by events, and by the synchronous algorithm."""
    problem = smart_cameras(seed=3, n_cameras=7)
    channel = BroadcastChannel(latency=1.5, loss=0.2)
    results = (
        Simulation(problem, channel=channel, seed=8).run(600),
        run_synchronous(problem, steps=600, seed=8),
    )
    assert all(len(result.signals) > 100 for result in results)
    return [result.digest for result in results]


def test_another_process_gives_the_same_digests() -> None:
    program = """
from tests.test_conservation import EXAMPLES, of_cameras
print(*[configuration.run().digest for configuration in EXAMPLES.values()], *of_cameras())
"""
    outcome = forks().run(program)  # there, words have other hashes
    assert outcome.returncode == 0, outcome.stderr
    own = [configuration.run().digest for configuration in EXAMPLES.values()]
    assert outcome.stdout.split() == own + of_cameras()


# -- the books themselves --------------------------------------------------------------------------------


def test_the_books_see_what_they_look_for() -> None:
    """A response too many, and two entries in the wrong order, are found."""
    row = (4.0, "respond", 0, 0, 0, 2.0)
    assert keep_continuous(1.0, [row], 8.0) == Books(6.0, 3.0, 8.0, 2.0, [(4.0, 2.0)])
    assert keep_discrete(1.0, [row], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]) == Books(
        3.0, 15.0 / 7, 5.0, 2.0, [(4.0, 2.0)]
    )
    for name, configuration in EXAMPLES.items():
        result, log = configuration.run(), log_of(configuration.run())
        assert_books_balance(configuration, result)
        result.account.responses[0, 0] += 1
        with pytest.raises(AssertionError):
            assert_books_balance(configuration, result)
        if "late" not in name:
            continue  # two looks of one instant may then be told apart by nothing
        dynamics, delay = result.dynamics, configuration.parts["control_unit"].sensing_delay
        same = [at for at, (one, other) in enumerate(pairwise(log)) if one[0] == other[0]]
        assert len(same) > 20
        for at in same[:: len(same) // 20]:
            swapped = [*log[:at], log[at + 1], log[at], *log[at + 2 :]]
            with pytest.raises(AssertionError):
                assert_log_is_in_order(swapped, dynamics, delay)
