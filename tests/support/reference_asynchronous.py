"""A reference simulator, written from docs/model.md and docs/disturbances.md, to hold the framework against.

It is plain and slow: every tick is an event, all demands are brought forward at every event, and a heap of
(time, kind, order) says what comes next.  With the framework it shares nothing but the numbers of a problem
and of its costs, and functions of the user's.  Random numbers are drawn by NumPy, at addresses that are
written here again.
"""

import heapq
import math
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cache, partial
from operator import setitem
from typing import Any

import numpy as np

from aimd_des import Problem
from tests.conftest import reference_derivative, reference_draws

# What is due at one instant happens in this order; what leaves the control unit meets partitions in force.
INTERVENE, DEPART, DELIVER, SENSE, OBSERVE, ACT = range(6)

# Where random numbers stand: the spawn keys of their purposes, and the lane of second copies.
RESPONSE, LOSS, LATENCY, CLOCK, DUPLICATION, SENSING = 1, 2, 3, 4, 5, 6
SECOND_LATENCY, SECOND_RESPONSE = 1 << 32, 1
TICKS, PHASES = 0, 1  # of clocks, in place of a resource

# Time, kind, order among equals, order of scheduling, and what is done.
Event = tuple[float, int, tuple[int, ...], int, Callable[[], None]]

# How far compensation goes where an agent hardly grows; below what share of the total a fall is rounding.
LARGEST_FACTOR, ROUNDING = 20.0, 1e-9


@dataclass
class Setting:
    """One run as plain numbers; lists have a value for each agent."""

    problem: Problem
    seed: int
    until: float
    #: (period, phase, drift, jitter), as `tick_times` takes them; None for continuous agents.
    clocks: tuple[Any, Any, Any, Any] | None
    #: ("sampled", period, phase, delay), ("early", period, phase, delay, low, high), ("own", period, phase,
    #: delay, probability) or ("crossing", hold-off, longest, delay).
    unit: tuple[Any, ...]
    #: ("constant", values), ("uniform", low, high) or ("exponential", means).
    latency: tuple[Any, ...] = ("constant", 0.0)
    #: ("chance", probabilities) or ("bursts", mean losses, mean bursts).
    loss: tuple[Any, ...] = ("chance", 0.0)
    duplication: Any = 0.0
    fifo: bool = False
    #: ("all",), ("window", length, parts), ("forgetting", time constant) or ("gain", a).
    average: tuple[Any, ...] = ("all",)
    #: What lambda divides by ("average", "signals", "cuts", or a function in its place), and what becomes of
    #: demand ("drawn", "fractional", "full"); how many numbers the function keeps, and what it reads.
    response: tuple[Any, str, int, tuple[str, ...]] = ("average", "drawn", 0, ())
    #: None, ("known", losses) or ("estimated",).
    compensation: tuple[Any, ...] | None = None
    #: What changes from outside: names of methods of `_Run` that begin with `begin_`, and their arguments.
    changes: Sequence[tuple[Any, ...]] = ()
    #: When totals and allocations are looked at, besides the end.
    looks: Sequence[float] = ()


@dataclass
class Piece:
    """The problem in force since `start`, and what total demand did; lists have a value for each resource."""

    start: float
    capacity: list[float]
    present: list[bool]
    costs: Any
    weights: list[float]
    peak: list[float]
    above: list[float]
    excess: list[float]
    used: list[float]


@dataclass
class Outcome:
    """What a run did; lists of lists are by resource and agent."""

    #: (time, resource, number)
    signals: list[tuple[float, int, int]]
    #: (time, resource, agent, number, by how much demand fell or None)
    answers: list[tuple[float, int, int, int, float | None]]
    delivered: list[list[int]]
    lost: list[list[int]]
    duplicated: list[list[int]]
    responses: list[list[int]]
    saturated: list[list[int]]
    #: (time, demands, averages), the last at the end
    seen: list[tuple[float, list[list[float]], list[list[float]]]]
    pieces: list[Piece]
    #: How near a decision was to the other one: below 1e-9 it may hang on the last bits of a float.
    margin: float = math.inf


class Average:
    """The average of one agent's demand for one resource."""

    def __init__(self, kind: tuple[Any, ...]) -> None:
        self.kind, self.numbers = kind[0], kind[1:]
        self.sum, self.weight, self.age = 0.0, 0.0, 0.0
        self.marks: dict[int, float] = {}

    def line(self, demand: float, slope: float, age: float) -> None:
        """Demand has been a line up to an age."""
        span = age - self.age
        if self.kind == "forgetting":
            (constant,) = self.numbers
            grown = -constant * math.expm1(-span / constant)
            kept = math.exp(-span / constant)
            self.sum = self.sum * kept + demand * grown + slope * constant * (span - grown)
            self.weight = self.weight * kept + grown
        elif self.kind == "gain":  # the integral of a s^(a-1) times the line
            (a,) = self.numbers
            weight = age**a - self.age**a
            moment = a / (a + 1.0) * (age ** (a + 1.0) - self.age ** (a + 1.0))
            self.sum += demand * weight + slope * (moment - self.age * weight)
            self.weight = age**a
        else:
            if self.kind == "window":
                part = self.numbers[0] / self.numbers[1]
                for mark in range(int(self.age / part) + 1, int(age / part) + 1):
                    since = mark * part - self.age
                    self.marks[mark] = self.sum + demand * since + 0.5 * slope * since**2
            self.sum += demand * span + 0.5 * slope * span**2
            self.weight = age
        self.age = age

    def tick(self, demand: float) -> None:
        """A tick has folded in a demand."""
        if self.kind == "gain":
            self.age += 1.0
            newest = min(1.0, self.numbers[0] / self.age)
            self.sum, self.weight = (1.0 - newest) * self.sum + newest * demand, 1.0
            return
        kept = math.exp(-1.0 / self.numbers[0]) if self.kind == "forgetting" else 1.0
        self.sum, self.weight, self.age = self.sum * kept + demand, self.weight * kept + 1.0, self.age + 1.0
        if self.kind == "window" and self.age % (self.numbers[0] / self.numbers[1]) == 0.0:
            self.marks[round(self.age / (self.numbers[0] / self.numbers[1]))] = self.sum

    def value(self) -> float:
        """The average in force; a window begins at the oldest mark that is younger than its length."""
        if self.kind == "window":
            part = self.numbers[0] / self.numbers[1]
            first = int(self.age / part) - self.numbers[1] + 1
            if first >= 1:
                return (self.sum - self.marks[first]) / (self.age - first * part)
        return self.sum / self.weight if self.weight > 0.0 else 0.0

    def with_tick(self, demand: float) -> float:
        """What it will be when the next tick has folded in the demand at hand."""
        following = deepcopy(self)
        following.tick(demand)
        return following.value()


class Answer:
    """How one agent answers signals of one resource: lambda, and what is left of its demand."""

    def __init__(self, setting: Setting) -> None:
        self.divisor, self.cut, numbers, self.reads = setting.response
        kind, *parameters = setting.average
        if kind == "window":  # in parts of whole signals
            length, parts = parameters
            parameters = [math.ceil(length / parts) * parts, parts]
        self.found, self.sum, self.memory = Average((kind, *parameters)), 0.0, np.zeros(numbers)

    def chance(self, **inputs: float) -> float:
        """What lambda is."""
        demand, average = inputs["demand"], inputs["average"]
        if callable(self.divisor):
            given = [inputs[name] for name in self.reads if name != "memory"]
            kept = [self.memory] if "memory" in self.reads else []
            return float(self.divisor(*given, *kept)) if average > 0.0 else 0.0
        if self.divisor == "signals":
            self.found.tick(demand)
            average = self.found.value()
        elif self.divisor == "cuts" and self.found.age:
            average = 0.5 * (1.0 + inputs["decrease"]) * self.found.value()
        return inputs["normalization"] * inputs["slope"] / average if average > 0.0 else 0.0

    def kept(self, demand: float, beta: float, chance: float, draw: float) -> tuple[float, float]:
        """What demand is multiplied by, and how far the decision was from the other one."""
        if self.cut == "fractional":
            return max(0.0, 1.0 - (1.0 - beta) * chance), abs(chance * (1.0 - beta) - 1.0)
        if self.cut == "drawn":
            return beta if draw < chance else 1.0, min(abs(draw - chance), abs(chance - 1.0))
        self.sum += min(1.0, chance)
        margin = min(abs(self.sum - 1.0), abs(chance - 1.0))
        if self.sum < 1.0:
            return 1.0, margin
        self.sum -= 1.0
        if self.divisor == "cuts":
            self.found.tick(demand)
        return beta, margin


def above(begin: float, end: float, capacity: float, span: float) -> tuple[float, float]:
    """For how long a line was above the capacity, and the integral of what exceeded it."""
    low, high = sorted((begin, end))
    if high <= capacity:
        return 0.0, 0.0
    if low >= capacity:
        return span, span * (0.5 * (low + high) - capacity)
    time = span * (high - capacity) / (high - low)
    return time, 0.5 * time * (high - capacity)


def tick_times(
    seed: int, until: float, n: int, period: Any, phase: Any, drift: Any, jitter: Any
) -> list[list[float]]:
    """All ticks of all agents before the end; a number for all agents or one for each, or a random phase."""
    own = [_of(period, i) * (1.0 + _of(drift, i)) for i in range(n)]
    if isinstance(phase, str):
        phase = [p * u for p, u in zip(own, reference_draws(seed, CLOCK, PHASES, 0, n).tolist(), strict=True)]
    last = math.ceil(until / min(own))  # phases are at least 0
    rows = [reference_draws(seed, CLOCK, TICKS, tick, n).tolist() for tick in range(last + 1)]
    late = [_of(jitter, i) for i in range(n)]
    ticks = [[_of(phase, i) + q * own[i] + late[i] * row[i] for q, row in enumerate(rows)] for i in range(n)]
    return [[time for time in times if time < until] for times in ticks]


class _Run:
    """The state of everything, and what happens."""

    def __init__(self, setting: Setting) -> None:
        self.setting, self.problem = setting, setting.problem
        self.n, self.m = setting.problem.n_agents, setting.problem.n_resources
        self.agents, self.resources = range(self.n), range(self.m)
        self.alpha, self.beta = setting.problem.increase.tolist(), setting.problem.decrease.tolist()
        self.capacity: list[float] = setting.problem.capacity.tolist()
        self.continuous = setting.clocks is None
        self.now, self.scheduled = 0.0, 0
        self.heap: list[Event] = []
        # Agents.
        self.demand = [[0.0] * self.m for _ in self.agents]
        self.average = [[Average(setting.average) for _ in self.resources] for _ in self.agents]
        self.answers = [[Answer(setting) for _ in self.resources] for _ in self.agents]
        self.away, self.left, self.origin = [False] * self.n, [0.0] * self.n, [0.0] * self.n
        self.latch: list[dict[int, tuple[int, int]]] = [{} for _ in self.agents]
        self.late: list[list[tuple[int, int]]] = [[] for _ in self.agents]
        self.answered = [[0] * self.m for _ in self.agents]
        self.heard: list[list[list[int]]] = [[[] for _ in self.resources] for _ in self.agents]
        self.costs: Any = setting.problem.costs
        self.factors: list[list[float]] = [[] for _ in self.agents]
        # Control unit and channel.
        self.threshold = setting.problem.threshold.tolist()
        self.number, self.failed, self.cut = [0] * self.m, 0, [0] * self.n
        self.hold_off = [setting.unit[1]] * self.m
        self.held_until, self.fallen = [-1.0] * self.m, [0.0] * self.m
        self.latest, self.bad = [0.0] * self.n, [(-math.inf, 0.0)] * self.n
        counts: list[list[list[int]]] = [[[0] * self.n for _ in self.resources] for _ in range(5)]
        self.outcome = Outcome([], [], *counts, seen=[], pieces=[])
        self.begin_piece()

    # -- time ----------------------------------------------------------------------------------------------

    def at(self, time: float, kind: int, order: tuple[int, ...], action: Callable[[], None]) -> None:
        """Schedule; equal events keep the order in which they were scheduled."""
        self.scheduled += 1
        heapq.heappush(self.heap, (time, kind, order, self.scheduled, action))

    def run(self) -> Outcome:
        """Do all that is due before the end, and look there once more."""
        setting = self.setting
        for place, (name, *arguments) in enumerate(setting.changes):
            getattr(self, f"begin_{name}")(place, *arguments)
        for look in setting.looks:
            self.at(look, OBSERVE, (), self.observe)
        if setting.clocks is not None:
            for agent, times in enumerate(tick_times(setting.seed, setting.until, self.n, *setting.clocks)):
                for time in times:
                    self.at(time, ACT, (agent,), partial(self.tick, agent))
        if setting.unit[0] != "crossing":
            self.at(setting.unit[2], SENSE, (), partial(self.look, 0))
        while due := [event for event in (*self.heap[:1], *self.crossings()) if event[0] < setting.until]:
            following = min(due)
            self.near(*(event[0] - following[0] for event in due if event[0] > following[0]))
            if following in self.heap[:1]:
                heapq.heappop(self.heap)
            self.advance(following[0])
            following[-1]()
        self.advance(setting.until)
        self.observe()
        return self.outcome

    def near(self, *differences: float) -> None:
        """Note how far what is compared is apart."""
        self.outcome.margin = min([self.outcome.margin, *map(abs, differences)])

    def advance(self, now: float) -> None:
        """Bring all demands and averages forward, and measure total demand on the way."""
        span, piece = now - self.now, self.outcome.pieces[-1]
        before = [self.total(j) for j in self.resources]
        if self.continuous:
            for i in self.agents:
                for j in () if self.away[i] else self.resources:
                    self.average[i][j].line(self.demand[i][j], self.alpha[i][j], now - self.origin[i])
                    self.demand[i][j] += self.alpha[i][j] * span
        self.now = now
        for j in self.resources if span > 0.0 else ():
            total = self.total(j)
            time, excess = above(before[j], total, piece.capacity[j], span)
            piece.peak[j] = max(piece.peak[j], before[j], total)
            piece.above[j] += time
            piece.excess[j] += excess
            piece.used[j] += 0.5 * (before[j] + total) * span

    def observe(self) -> None:
        """Note demands and averages; a discrete agent's include the demand at hand."""
        averages = [[self.average[i][j].value() for i in self.agents] for j in self.resources]
        if not self.continuous:
            for i in self.agents:
                for j in () if self.away[i] else self.resources:
                    averages[j][i] = self.average[i][j].with_tick(self.demand[i][j])
        demands = [[self.demand[i][j] for i in self.agents] for j in self.resources]
        self.outcome.seen.append((self.now, demands, averages))

    def total(self, j: int) -> float:
        """What all agents hold."""
        return sum(self.demand[i][j] for i in self.agents)

    @cache  # noqa: B019 - a run is thrown away after its end
    def draws(self, purpose: int, j: int, number: int, lane: int = 0) -> list[float]:
        """Uniform numbers of all agents."""
        drawn: list[float] = reference_draws(self.setting.seed, purpose, j, number, self.n, lane).tolist()
        return drawn

    # -- agents --------------------------------------------------------------------------------------------

    def tick(self, i: int) -> None:
        """Fold in all demands, then answer what is latched or grow."""
        if self.away[i]:
            return
        for j in self.resources:
            self.average[i][j].tick(self.demand[i][j])
        for j in self.resources:
            if j in self.latch[i]:
                self.answer(i, j, *self.latch[i][j])
            else:
                self.demand[i][j] += self.alpha[i][j]
        for j, number in self.late[i]:
            self.heard[i][j].append(number)
        self.latch[i], self.late[i] = {}, []

    def land(self, i: int, j: int, number: int, copy: int) -> None:
        """A copy arrives."""
        if self.away[i]:
            self.outcome.lost[j][i] += 1 - copy
            return
        (self.outcome.duplicated if copy else self.outcome.delivered)[j][i] += 1
        if self.continuous:
            self.answer(i, j, number, copy)
        elif j not in self.latch[i]:
            self.latch[i][j] = (number, copy)
        elif not copy:
            self.late[i].append((j, number))

    def answer(self, i: int, j: int, number: int, copy: int) -> None:
        """Respond, or hold; a continuous agent that holds grows on."""
        averages = [self.average[i][k].value() for k in self.resources]
        slope = math.prod(self.factors[i]) * reference_derivative(self.costs, i, averages, j)
        demand, beta = self.demand[i][j], self.beta[i][j]
        chance = self.answers[i][j].chance(
            normalization=float(self.problem.normalization[j]),
            slope=slope,
            average=averages[j],
            demand=demand,
            increase=self.alpha[i][j],
            decrease=beta,
            age=self.average[i][j].age,
            agent=float(i),
            resource=float(j),
        )
        chance *= self.factor(i, j, number, copy)
        draw = self.draws(RESPONSE, j, number, SECOND_RESPONSE if copy else 0)[i]
        kept, margin = self.answers[i][j].kept(demand, beta, chance, draw)
        self.near(margin)
        fall: float | None = None
        if kept < 1.0:
            fall = demand - demand * kept
            self.demand[i][j] = demand * kept
            self.fallen[j] += fall
            self.outcome.responses[j][i] += 1
            most = 1.0 / (1.0 - beta) if self.answers[i][j].cut == "fractional" else 1.0
            self.outcome.saturated[j][i] += bool(chance > most)
        self.outcome.answers.append((self.now, j, i, number, fall))

    def factor(self, i: int, j: int, number: int, copy: int) -> float:
        """What makes good for lost signals."""
        if self.setting.compensation is None:
            return 1.0
        self.answered[i][j] += 1
        if self.setting.compensation[0] == "known":
            loss = self.setting.compensation[1][i]
        else:
            if not copy:
                self.heard[i][j].append(number)
            loss = self.missing(self.heard[i][j])
        if self.continuous or loss == 0.0:
            return float(1.0 / (1.0 - loss))
        silent = 1.0 - self.answered[i][j] / self.average[i][j].age
        return float(silent / (silent - loss)) if silent - loss > silent / LARGEST_FACTOR else LARGEST_FACTOR

    def missing(self, heard: list[int]) -> float:
        """The share of signals that were not heard since the first; those before it count for nothing."""
        later = [number - heard[0] for number in heard if number > heard[0]]
        return (max(later) - len(later)) / max(later) if later else 0.0

    # -- control unit and channel ----------------------------------------------------------------------------

    def limit(self, j: int) -> float:
        """The total demand at which signals are due."""
        return float(self.threshold[j] * self.capacity[j])

    def look(self, look: int) -> None:
        """Look on the clock, and again."""
        _, period, phase, _, *shares = self.setting.unit
        self.at(phase + (look + 1) * period, SENSE, (), partial(self.look, look + 1))
        due = []
        for j in self.resources:
            # The probability of a signal must be above a draw, or total demand above the threshold.
            load, draw = self.total(j) / self.limit(j), float(self.draws(SENSING, j, look)[0])
            if not shares:
                excess = load - 1.0
            elif callable(shares[0]):
                excess = shares[0](self.total(j), self.limit(j), self.now, look, j) - draw
            else:
                low, high = shares
                excess = load - (low + draw * (high - low))
            self.near(excess)
            if not self.failed and excess > 0.0:
                due.append(j)
        for j in due:
            self.broadcast(j)

    def crossings(self) -> Iterator[Event]:
        """When thresholds are reached next, if nothing happens before."""
        if self.setting.unit[0] != "crossing" or self.failed:
            return
        for j in self.resources:
            growth = sum(self.alpha[i][j] for i in self.agents if not self.away[i])
            total, limit = self.total(j), self.limit(j)
            earliest = max(self.now, self.held_until[j])
            if total + growth * (earliest - self.now) >= limit:
                yield earliest, SENSE, (j,), 0, partial(self.cross, j)
            elif growth > 0.0:
                yield self.now + (limit - total) / growth, SENSE, (j,), 0, partial(self.cross, j)

    def cross(self, j: int) -> None:
        """Signal, and hold off: longer if nobody has answered the last one, shorter if it did not suffice."""
        _, shortest, longest, _ = self.setting.unit
        if self.now == self.held_until[j]:
            answered = self.fallen[j] > ROUNDING * self.total(j)
            shorter, longer = max(self.hold_off[j] / 2, shortest), min(self.hold_off[j] * 2, longest)
            self.hold_off[j] = shorter if answered else longer
        self.held_until[j], self.fallen[j] = self.now + self.hold_off[j], 0.0
        self.broadcast(j)

    def broadcast(self, j: int) -> None:
        """Signal: what the channel does to copies is drawn now, and they leave after the sensing delay."""
        number, order, delay = self.number[j], len(self.outcome.signals), self.setting.unit[3]
        self.number[j] += 1
        self.outcome.signals.append((self.now, j, number))
        lost = self.lost(j, number, self.now + delay)
        for i in self.agents:
            self.outcome.lost[j][i] += lost[i]
        leaving = [i for i in self.agents if not lost[i]]
        if delay:
            self.at(self.now + delay, DEPART, (order,), partial(self.depart, j, number, order, leaving))
        else:
            self.depart(j, number, order, leaving)

    def depart(self, j: int, number: int, order: int, leaving: list[int]) -> None:
        """Let copies leave; what is cut now is lost, and holds nothing back."""
        late, later = (self.late_by(j, number, lane) for lane in (0, SECOND_LATENCY))
        doubled = self.draws(DUPLICATION, j, number)
        for i in leaving:
            if self.cut[i] or self.failed:
                self.outcome.lost[j][i] += 1
                continue
            latencies = [late[i], later[i]] if doubled[i] < _of(self.setting.duplication, i) else [late[i]]
            for copy, latency in enumerate(latencies):
                arrival = self.now + latency
                if self.setting.fifo:
                    self.latest[i] = arrival = max(arrival, self.latest[i])
                self.at(arrival, DELIVER, (order, copy, i), partial(self.land, i, j, number, copy))

    def lost(self, j: int, number: int, departure: float) -> list[bool]:
        """Which copies the channel loses; links that are good or bad are followed from signal to signal."""
        kind, probability, *more = self.setting.loss
        uniform = self.draws(LOSS, j, number)
        if kind == "chance":
            return [uniform[i] < _of(probability, i) for i in self.agents]
        for i in self.agents:
            mean, burst = _of(probability, i), _of(more[0], i)
            before, state = self.bad[i]
            known = math.exp(-(departure - before) / (burst * (1.0 - mean)))
            self.bad[i] = departure, float(uniform[i] < mean + (state - mean) * known)
        return [state == 1.0 for _, state in self.bad]

    def late_by(self, j: int, number: int, lane: int) -> list[float]:
        """Latencies of all copies."""
        kind, *numbers = self.setting.latency
        if kind == "constant":
            return [_of(numbers[0], i) for i in self.agents]
        uniform = self.draws(LATENCY, j, number, lane)
        if kind == "uniform":
            low, high = ([_of(bound, i) for i in self.agents] for bound in numbers)
            return [low[i] + (high[i] - low[i]) * uniform[i] for i in self.agents]
        return [-_of(numbers[0], i) * math.log1p(-uniform[i]) for i in self.agents]

    # -- changes from outside: each schedules what it does, by its place in the list -------------------------

    def begin_piece(self) -> None:
        """Another problem is in force; what was so for no time is forgotten."""
        pieces, present = self.outcome.pieces, [not gone for gone in self.away]
        if pieces and pieces[-1].start == self.now:
            pieces.pop()
        weights = [math.prod(own) for own in self.factors]
        zeros = [[0.0] * self.m for _ in range(4)]
        pieces.append(Piece(self.now, list(self.capacity), present, self.costs, weights, *zeros))

    def change(self, place: int, time: float | None, change: Callable[[], None]) -> None:
        """Change the problem at some time, or never."""
        if time is not None:
            self.at(time, INTERVENE, (place,), lambda: (change(), self.begin_piece()))

    def begin_step(self, place: int, j: int, at: float, capacity: float) -> None:
        self.change(place, at, partial(setitem, self.capacity, j, capacity))

    def begin_threshold(self, place: int, at: float, threshold: float, resource: int | None) -> None:
        for j in self.resources if resource is None else [resource]:
            self.change(place, at, partial(setitem, self.threshold, j, threshold))

    def begin_ramp(self, place: int, j: int, start: float, end: float, capacity: float, steps: int) -> None:
        def begin() -> None:
            before = self.capacity[j]  # what it is when the ramp begins
            for step in range(1, steps + 1):
                time = end if step == steps else start + step / steps * (end - start)
                self.begin_step(place, j, time, before + step / steps * (capacity - before))

        self.at(start, INTERVENE, (place,), begin)

    def begin_profile(self, place: int, j: int, times: Any, values: Any, period: float | None) -> None:
        for cycle in range(1 if period is None else math.ceil(self.setting.until / period)):
            for time, value in zip(times, values, strict=True):
                self.begin_step(place, j, cycle * (period or 0.0) + time, value)

    def begin_demand(self, place: int, at: float, i: int, j: int, demand: float) -> None:
        def set_demand() -> None:
            if not self.away[i]:
                self.demand[i][j] = demand

        self.at(at, INTERVENE, (place,), set_demand)

    def begin_absence(self, place: int, i: int, at: float, until: float | None, anew: bool) -> None:
        self.change(place, at, partial(self.leave, i))
        self.change(place, until, partial(self.join, i, anew))

    def leave(self, i: int) -> None:
        """Release what is held, and forget what is latched."""
        self.demand[i], self.away[i], self.left[i] = [0.0] * self.m, True, self.now
        self.latch[i], self.late[i] = {}, []

    def join(self, i: int, anew: bool) -> None:
        """Come back, with or without the past; the time in between counts for nothing, nor do its signals."""
        self.away[i] = False
        self.origin[i] += self.now - self.left[i]
        self.heard[i] = [[] for _ in self.resources]
        if anew:
            self.origin[i], self.answered[i] = self.now, [0] * self.m
            self.average[i] = [Average(self.setting.average) for _ in self.resources]
            self.answers[i] = [Answer(self.setting) for _ in self.resources]

    def begin_activity(self, place: int, i: int, at: float, until: float | None, weight: float) -> None:
        self.change(place, at, partial(self.factors[i].append, weight))
        self.change(place, until, partial(self.factors[i].remove, weight))

    def begin_prices(self, place: int, every: float, draw: Callable[[int], Any]) -> None:
        for k in range(1, math.ceil(self.setting.until / every)):
            self.change(place, k * every, partial(setattr, self, "costs", draw(k)))

    def begin_failover(self, place: int, at: float, duration: float) -> None:
        self.at(at, INTERVENE, (place,), lambda: setattr(self, "failed", self.failed + 1))
        self.at(at + duration, INTERVENE, (place,), self.recover)

    def recover(self) -> None:
        """Take over, if all faults are over: the new unit knows of no hold-off."""
        self.failed -= 1
        if not self.failed:
            self.hold_off, self.held_until = [self.setting.unit[1]] * self.m, [-1.0] * self.m

    def begin_partition(self, place: int, at: float, duration: float, agents: list[int]) -> None:
        for time, by in ((at, 1), (at + duration, -1)):
            for i in agents:
                self.at(time, INTERVENE, (place,), lambda i=i, by=by: setitem(self.cut, i, self.cut[i] + by))


def _of(numbers: Any, agent: int) -> float:
    """The value of an agent, of one for all or one for each."""
    return float(numbers if np.ndim(numbers) == 0 else numbers[agent])


def simulate(setting: Setting) -> Outcome:
    """Run the reference simulator."""
    return _Run(setting).run()
