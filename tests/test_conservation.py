"""Nothing appears and nothing is lost: demand, averages and copies, added up from the event log alone.

The books are kept in plain Python from the log, the problem and the times of ticks; nothing of the
program's own arithmetic is used.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import groupby, pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aimd_des import (
    BroadcastChannel,
    Clocks,
    Crossing,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    averaging,
    latency,
    loss,
    run_synchronous,
)
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.interventions import (
    Absence,
    CapacityRamp,
    CapacityStep,
    Crash,
    Failover,
    Intervention,
    Join,
    Partition,
    UnusualActivity,
)
from aimd_des.latency import Latency
from aimd_des.loss import Loss
from models import smart_cameras
from tests.conftest import python, quietly, random_problem
from tests.test_camera import tick_times

LATENCIES: dict[str, float | Latency] = {
    "none": 0.0,
    "constant": 0.7,
    "exponential": latency.Exponential(1.1),
    "lognormal": latency.LogNormal(0.5, 1.0),
}
LOSSES: dict[str, float | Loss] = {
    "none": 0.0,
    "some": 0.3,
    "bursts": loss.GilbertElliott(0.3, 2.0),
    "everything": 1.0,
}
CLOCKS: dict[str, dict[str, Any]] = {
    "in phase": {"period": 1.0, "phase": 0.0, "drift": 0.0, "jitter": 0.0},
    "phase": {"period": 1.0, "phase": "random", "drift": 0.0, "jitter": 0.0},
    "drift": {"period": 0.9, "phase": "random", "drift": 0.02, "jitter": 0.0},
    "jitter": {"period": 1.1, "phase": 0.25, "drift": -0.02, "jitter": 0.9},
}
AVERAGES: dict[str, averaging.Averaging] = {
    "cumulative": averaging.Cumulative(),
    "window": averaging.Window(12.0, parts=4),
    "forgetting": averaging.Forgetting(8.0),
}
CONTROL_UNITS: dict[str, Sampled | Crossing] = {
    "sampled": Sampled(),
    "sampled often": Sampled(0.5, 0.25, sensing_delay=0.3),
    "crossing": Crossing(1.0),
    "crossing, delayed": Crossing(0.4, sensing_delay=0.3),
    "crossing, adaptive": Crossing(0.25, longest_hold_off=4.0),
}


@dataclass(frozen=True)
class Configuration:
    """A run in words and numbers, so that another process can make the same."""

    seed: int
    n: int
    m: int
    family: str
    per_agent: bool
    threshold: bool
    dynamics: str
    control_unit: str
    clocks: str
    latency: str
    loss: str
    duplication: float
    fifo: bool
    interventions: bool
    until: float
    averaging: str = "cumulative"
    disturbances: bool = False

    def ticks(self) -> list[list[float]] | None:
        """The times of all ticks before the end, of discrete agents."""
        if self.dynamics == "continuous":
            return None
        return tick_times(self.seed, self.until, self.n, **CLOCKS[self.clocks])

    def intervene(self, system: System) -> ProcessGenerator:
        """Set a demand now and then: at ticks, between them, up and down."""
        rng = np.random.default_rng(self.seed)
        quarters = np.arange(0.0, self.until, 0.25)
        for time in sorted(rng.permutation(quarters)[:3].tolist()):
            yield system.env.at(time, EventKind.INTERVENE)
            agent, j = int(rng.integers(self.n)), int(rng.integers(self.m))
            if not system.conditions.away[agent]:
                system.set_demand(agent, j, float(rng.uniform(0.0, 2.0)) * system.demand(agent, j))

    def declared(self, problem: Problem) -> list[Intervention]:
        """Agents that come, go, crash and come back, capacities and costs that change, and faults."""
        if not self.disturbances:
            return []
        rng = np.random.default_rng([self.seed, 7])
        at = [float(time) for time in rng.choice([0.0, 1.0, 2.75, 4.0, 6.1, 9.0], 6)]
        long = [float(span) for span in rng.choice([0.5, 2.0, 3.3, 8.0], 6)]
        absences: list[Intervention] = [
            Absence(0, at[0], at[0] + long[0]),
            *([Crash(1, at[1], at[1] + long[1])] if self.n > 1 else []),
            *([Join(2, at[2] + 0.5)] if self.n > 2 else []),
        ]
        declared = [
            *absences,
            CapacityStep(0, at[3], 0.6 * float(problem.capacity[0])),
            CapacityRamp(self.m - 1, at[4], at[4] + long[4], 1.3 * float(problem.capacity[-1]), steps=3),
            UnusualActivity(0, at[5], at[5] + long[5], 0.3),
            Partition(at[1], long[3], [self.n - 1]),
            Failover(at[4], long[2]),
        ]
        return [one for one in declared if getattr(one, "begins", 0.0) < self.until]

    def run(self, **recording: Any) -> Result:
        problem = random_problem(
            self.seed, self.n, self.m, self.family, per_agent=self.per_agent, threshold=self.threshold
        )
        discrete = self.dynamics == "discrete"
        simulation = Simulation(
            problem,
            dynamics="discrete" if discrete else "continuous",
            control_unit=CONTROL_UNITS[self.control_unit],
            clocks=Clocks(**CLOCKS[self.clocks]) if discrete else None,
            channel=BroadcastChannel(
                LATENCIES[self.latency], LOSSES[self.loss], duplication=self.duplication, fifo=self.fifo
            ),
            processes=[self.intervene] if self.interventions else [],
            interventions=self.declared(problem),
            averaging=AVERAGES[self.averaging],
            recording=Recording(**{"demand": "end", "events": True, **recording}),
            seed=self.seed,
        )
        return quietly(simulation.run, self.until)


def configurations(dynamics: str) -> st.SearchStrategy[Configuration]:
    units = [name for name in CONTROL_UNITS if dynamics == "continuous" or name.startswith("sampled")]
    return st.builds(
        Configuration,
        seed=st.integers(0, 2**32),
        n=st.integers(1, 6),
        m=st.integers(1, 3),
        family=st.sampled_from(["polynomial", "coupled"]),
        per_agent=st.booleans(),
        threshold=st.booleans(),
        dynamics=st.just(dynamics),
        control_unit=st.sampled_from(units),
        clocks=st.sampled_from(list(CLOCKS)),
        latency=st.sampled_from(list(LATENCIES)),
        loss=st.sampled_from(["none", "none", "some", "some", "bursts", "everything"]),
        duplication=st.sampled_from([0.0, 0.0, 0.4]),
        fifo=st.booleans(),
        interventions=st.booleans(),
        until=st.sampled_from([0.5, 7.0, 30.0, 43.21]),
        averaging=st.sampled_from(list(AVERAGES)),
        disturbances=st.booleans(),
    )


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


def changes_of(log: list[Row], n: int, m: int) -> dict[tuple[int, int], list[Row]]:
    """What the log says about the demand of each agent for each resource."""
    changes: dict[tuple[int, int], list[Row]] = {(i, j): [] for i in range(n) for j in range(m)}
    for row in log:
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


def average_of_lines(lines: list[tuple[float, float, float]], way: str) -> float:
    """Average demand that was one line after another: duration, demand at the start, slope."""
    age = math.fsum(duration for duration, _, _ in lines)
    begin = 0.0
    if way == "window":
        begin = max(math.floor(age / 3.0) - 3, 0) * 3.0  # four parts of 3
    weighted, time = [], 0.0
    for duration, start, slope in lines:
        first, last = max(time, begin), time + duration
        if last > first:
            one, other = start + slope * (first - time), start + slope * duration
            if way == "forgetting":  # by parts: the integral of (a + b s) exp((s - age) / T)
                early, late = math.exp((first - age) / 8.0), math.exp((last - age) / 8.0)
                weighted.append(8.0 * (other * late - one * early) - 64.0 * slope * (late - early))
            else:
                weighted.append(0.5 * (one + other) * (last - first))
        time = last
    total = 8.0 * -math.expm1(-age / 8.0) if way == "forgetting" else age - begin
    return math.fsum(weighted) / total if age > 0.0 else 0.0


def average_of_ticks(demands: list[float], way: str) -> float:
    """Average what was held at the ticks, one by one."""
    age = len(demands)
    if way == "window":
        demands = demands[max(age // 3 - 3, 0) * 3 :]
    weights = [math.exp(-late / 8.0) if way == "forgetting" else 1.0 for late in range(len(demands))]
    pairs = zip(demands[::-1], weights, strict=True)
    return math.fsum(held * weight for held, weight in pairs) / math.fsum(weights) if demands else 0.0


def keep_continuous(alpha: float, changes: list[Row], until: float, way: str = "cumulative") -> Books:
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


def keep_discrete(alpha: float, changes: list[Row], ticks: list[float], way: str = "cumulative") -> Books:
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
    ticks, changes = configuration.ticks(), changes_of(log_of(result), configuration.n, configuration.m)
    increase, way = result.problem.increase, configuration.averaging
    return {
        (i, j): keep_continuous(float(increase[i, j]), changes[i, j], configuration.until, way)
        if ticks is None
        else keep_discrete(float(increase[i, j]), changes[i, j], ticks[i], way)
        for i in range(configuration.n)
        for j in range(configuration.m)
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


@given(configurations("continuous"))
def test_continuous_demand_is_what_was_added_less_what_was_cut(configuration: Configuration) -> None:
    assert_books_balance(configuration, configuration.run())


@given(configurations("discrete"))
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


@given(st.one_of(configurations("continuous"), configurations("discrete")))
def test_every_copy_is_delivered_lost_or_in_flight(configuration: Configuration) -> None:
    result = configuration.run()
    assert_copies_are_accounted_for(result)
    if configuration.loss == "none" and not configuration.disturbances:
        assert result.account.lost.sum() == 0
    if configuration.loss == "everything":
        assert result.account.delivered.sum() == result.account.duplicated.sum() == 0
        assert result.account.in_flight.sum() == result.account.responses.sum() == 0
    if configuration.duplication == 0.0:
        assert result.account.duplicated.sum() == 0


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


@given(st.one_of(configurations("continuous"), configurations("discrete")))
def test_a_signal_is_entered_with_the_total_that_caused_it(configuration: Configuration) -> None:
    result = configuration.run()
    log, ticks, problem = log_of(result), configuration.ticks(), result.problem
    for turn, (now, kind, j, _, _, value) in enumerate(log):
        if kind != "signal":
            continue
        before = changes_of(log[:turn], configuration.n, configuration.m)
        held = [
            keep_continuous(problem.increase[i, j], before[i, j], now).demand
            if ticks is None
            else keep_discrete(
                problem.increase[i, j], before[i, j], [time for time in ticks[i] if time < now]
            ).demand
            for i in range(configuration.n)
        ]
        assert value == pytest.approx(sum(held), rel=1e-9)
        limits = [row[5] * problem.threshold[j] for row in log[:turn] if row[1] == "capacity" and row[2] == j]
        assert value > [problem.limit[j], *limits][-1] * (1.0 - 1e-12)


# -- order -----------------------------------------------------------------------------------------------


INTERVENTIONS = ("change", "leave", "join", "capacity", "costs", "cut", "heal", "fail", "recover")


def place(row: Row, broadcast: dict[tuple[int, int], int], sent_at: dict[Any, float]) -> tuple[float, ...]:
    """Where an entry stands among those of its instant."""
    time, kind, j, agent, number, value = row
    if kind in INTERVENTIONS:
        return (EventKind.INTERVENE,)
    # A copy that is lost on its way is so from the start; one that finds nobody, when it lands.
    if kind == "deliver" or (kind == "lost" and sent_at[j, number] < time):
        return (EventKind.DELIVER, broadcast[j, number], value, agent)
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


def assert_log_is_in_order(log: list[Row], dynamics: str) -> None:
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
                row[1] == "lost" and row[3] in away and sent_at[row[2], row[4]] == time
                for row in (one, other)
            ):
                continue  # lost on its way, or landed at once where nobody is: no entry tells which
            at_once = one[1] in ("signal", "lost") and other[1] == "deliver"
            caused = at_once and sent_at[other[2], other[4]] == time
            before, after = (place(row, broadcast, sent_at) for row in (one, other))
            assert caused or before < after, (one, other)


@given(st.one_of(configurations("continuous"), configurations("discrete")))
def test_no_entry_of_the_log_is_out_of_order(configuration: Configuration) -> None:
    assert_log_is_in_order(log_of(configuration.run()), configuration.dynamics)


# -- the same run ----------------------------------------------------------------------------------------

_ORDINARY = {
    "seed": 1,
    "n": 5,
    "m": 2,
    "family": "coupled",
    "per_agent": True,
    "threshold": True,
    "fifo": False,
    "interventions": True,
    "until": 60.0,
    "clocks": "jitter",
}
EXAMPLES = [
    Configuration(
        **{**_ORDINARY, "dynamics": dynamics, "control_unit": unit},
        latency=late,
        loss=lost,
        duplication=twice,
    )
    for dynamics, unit, late, lost, twice in (
        ("discrete", "sampled", "none", "none", 0.0),
        ("discrete", "sampled often", "exponential", "bursts", 0.4),
        ("continuous", "sampled often", "lognormal", "some", 0.0),
        ("continuous", "crossing", "none", "none", 0.4),
        ("continuous", "crossing, delayed", "exponential", "bursts", 0.4),
    )
]


def digest(**configuration: Any) -> str:
    return Configuration(**configuration).run().digest


@pytest.mark.parametrize(
    "configuration", EXAMPLES, ids=lambda example: f"{example.dynamics} {example.latency}"
)
def test_the_same_seed_is_the_same_run_and_another_seed_another(configuration: Configuration) -> None:
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
    program = f"""
from tests.test_conservation import digest, of_cameras
for configuration in {[asdict(example) for example in EXAMPLES]!r}:
    print(digest(**configuration))
print(*of_cameras())
"""
    outcome = python("-c", program, PYTHONHASHSEED="321")
    assert outcome.returncode == 0, outcome.stderr
    assert outcome.stdout.split() == [example.run().digest for example in EXAMPLES] + of_cameras()


# -- the books themselves --------------------------------------------------------------------------------


def test_the_books_see_what_they_look_for() -> None:
    """A response too many, and two entries in the wrong order, are found."""
    row = (4.0, "respond", 0, 0, 0, 2.0)
    assert keep_continuous(1.0, [row], 8.0) == Books(6.0, 3.0, 8.0, 2.0, [(4.0, 2.0)])
    assert keep_discrete(1.0, [row], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]) == Books(
        3.0, 15.0 / 7, 5.0, 2.0, [(4.0, 2.0)]
    )
    for example in EXAMPLES:
        result, log = example.run(), log_of(example.run())
        assert_books_balance(example, result)
        result.account.responses[0, 0] += 1
        with pytest.raises(AssertionError):
            assert_books_balance(example, result)
        if example.latency == "none":
            continue  # two looks of one instant may then be told apart by nothing
        same = [at for at, (one, other) in enumerate(pairwise(log)) if one[0] == other[0]]
        assert len(same) > 20
        for at in same[:: len(same) // 20]:
            with pytest.raises(AssertionError):
                assert_log_is_in_order([*log[:at], log[at + 1], log[at], *log[at + 2 :]], example.dynamics)
