"""Your own parts: the examples of docs/extending.md do what the page says of them."""

import contextlib
import io
import math
import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Clocks,
    Crossing,
    CustomCosts,
    Fleet,
    InputError,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    run_synchronous,
)
from aimd_des.channel import Copies
from aimd_des.engine.delivery import ProcessGenerator, Signal
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.utils.parts import REGISTERED
from aimd_des.utils.rng import Purpose, uniforms
from tests.conftest import assert_same_run, random_problem
from tests.test_doctests import ROOT, python_blocks

PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")


class Names(dict[str, Any]):
    """What the page defines, as attributes."""

    __getattr__ = dict.__getitem__


@pytest.fixture(scope="module")
def page() -> Iterator[Names]:
    """The page, played once; what it registers is forgotten again."""
    names = Names(__name__="__page__")
    with contextlib.redirect_stdout(io.StringIO()):
        for line, source, _ in python_blocks(PAGE):
            exec(compile("\n" * (line - 1) + source, "docs/extending.md", "exec"), names)
    yield names
    REGISTERED.pop("__page__", None)


def times_of(result: Result, kind: str, **which: Any) -> list[float]:
    events = result.events[result.events["kind"] == kind]
    for column, value in which.items():
        events = events[events[column] == value]
    return [float(time) for time in events["time"]]


# -- what the tables say ---------------------------------------------------------------------------------


def names_in_table(heading: str) -> list[str]:
    table = PAGE.split(heading)[1].split("\n\n")[2]
    cells = [line.split("|")[1] for line in table.splitlines()[2:]]
    return [re.split(r"[(`]", name)[0] for cell in cells for name in re.findall(r"`([\w.]+[^`]*)`", cell)]


def test_the_system_has_what_the_page_lists(page: Names) -> None:
    names = names_in_table("## What a part finds in the system")
    assert len(names) == 18
    assert {"env.now", "total", "set_demand", "parameters.decrease"} < set(names)
    seen: list[bool] = []

    def look(system: System) -> ProcessGenerator:
        yield system.env.at(1.0, EventKind.OBSERVE)
        for name in names:
            part: Any = system
            for step in name.split("."):
                part = getattr(part, step)
            seen.append(part is not None)

    recording = Recording(events=True)  # whose log can be read, too
    Simulation(page.problem, processes=[look], seed=0, recording=recording).run(2.0)
    assert seen == [True] * 18


def test_every_part_of_the_first_table_has_an_example() -> None:
    parts = [line.split("|")[1].strip() for line in PAGE.split("\n\n")[2].splitlines()[2:]]
    code = "\n".join(source for _, source, _ in python_blocks(PAGE))
    examples = {
        "private costs": "CustomCosts(",
        "process": "processes=[watch]",
        "intervention": "Exodus(",
        "agent": "Selfish(",
        "control unit": "Gentle(",
        "channel": "Relay(",
        "latency model": "Distance(",
    }
    assert all(example in code for example in examples.values())
    assert parts == [*examples, "loss model"]  # described by the last, as it is of the same form


# -- interventions ---------------------------------------------------------------------------------------


def test_an_intervention_of_ones_own_changes_the_optimum_with_it(page: Names) -> None:
    pieces = page.emptied.pieces
    assert pieces["start"].tolist() == [0.0, 100.0, 150.0]
    assert pieces["agents"].tolist() == [5, 4, 3]
    with pytest.raises(ValueError, match="must be less than n = 5"):
        Simulation(page.problem, interventions=[page.Exodus(at=1.0, count=5, gap=1.0)], seed=0)


# -- processes -------------------------------------------------------------------------------------------


def test_a_process_that_looks_leaves_no_trace(page: Names) -> None:
    parts = {"dynamics": "continuous", "control_unit": Crossing(hold_off=1.0), "seed": 1}
    alone = Simulation(page.problem, **parts).run(until=300)
    assert_same_run(page.calm, alone)


def test_the_watcher_sees_what_a_recording_sees(page: Names) -> None:
    recording = Recording(demand=0.25)
    parts = {"dynamics": "continuous", "control_unit": Crossing(hold_off=1.0), "seed": 1}
    seen = Simulation(page.problem, recording=recording, **parts).run(until=300).demand
    crowded = seen["time"][(seen["total"] > 0.99 * 4.0) & (seen["time"] < 300.0)]
    assert page.crowded == crowded.tolist()
    assert len(page.crowded) > 100


def test_false_alarms_are_signals_like_any_other(page: Names) -> None:
    false = [100.0 + q for q in range(200)]
    sent = times_of(page.jammed, "signal")
    assert [time for time in sent if time in set(false)] == false
    # Up to then it is the calm run, with the same draws.
    before = [time for time in page.calm.signals["time"] if time < 100.0]
    assert [time for time in sent if time < 100.0] == before
    answered = times_of(page.jammed, "respond")
    assert len(set(answered) & set(false)) > 100
    assert len(page.jammed.signals) > len(page.calm.signals)
    used = page.jammed.average_at_end.sum(), page.calm.average_at_end.sum()
    assert used[0] < 0.8 * used[1]


def test_a_demand_that_is_set_stands_in_the_log(page: Names) -> None:
    changes = page.jammed.events[page.jammed.events["kind"] == "change"]
    assert changes["time"].tolist() == [200.0]
    assert changes["agent"].tolist() == ["0"]
    assert changes["value"].iloc[0] < -0.02  # it held something, which is gone
    recording = Recording(demand="end", allocations=[math.nextafter(200.0, 0.0), 200.0, 200.5])
    parts = {"dynamics": "continuous", "control_unit": Crossing(hold_off=1.0), "seed": 1}
    again = Simulation(page.problem, processes=[page.jam, page.restart], recording=recording, **parts)
    held = again.run(until=201.0).observations.demand[:3, 0, 0].tolist()
    assert held[0] + changes["value"].iloc[0] == pytest.approx(0.0, abs=1e-9)
    # Whatever the alarm of that instant does to it, 0 stays 0.
    assert held[1:] == [0.0, 0.01]


# -- agents ----------------------------------------------------------------------------------------------


def test_the_selfish_agent_takes_all_and_the_rest_is_pushed_back(page: Names) -> None:
    result = page.one_selfish
    assert result.demand_at_end[0, 0] == pytest.approx(6.0, rel=1e-12)
    assert result.average_at_end[0, 0] == pytest.approx(3.0, rel=1e-12)
    assert result.account.responses[0, 0] == 0
    # From 200 on its own 4 fill the capacity: a signal at the end of every hold-off.
    late = [time for time in result.signals["time"] if time >= 201.0]
    assert len(late) in (98, 99)
    assert all(other - one == pytest.approx(1.0) for one, other in pairwise(late))
    # An agent then adds 0.02 from signal to signal and loses 0.3 lambda of what it holds, on average: it
    # holds 0.02 / (0.3 lambda) just before one.  Among cameras only it would hold more.
    probability = 0.1 * np.array(page.factors[1:])
    before_a_signal = 0.02 / (0.3 * probability)
    assert (before_a_signal < 0.85 * page.calm.average_at_end[1:, 0]).all()
    recording = Recording(demand="end", allocations=1.0)
    parts = {"dynamics": "continuous", "control_unit": Crossing(hold_off=1.0), "recording": recording}
    agents = {"agents": lambda i, system: page.Selfish(i, system) if i == 0 else AgentProcess(i, system)}
    held = Simulation(page.problem, seed=1, **parts, **agents).run(until=2200).observations.demand
    mean = held[300:2200, 0, 1:].mean(axis=0)
    # Its deviation is 0.4 of that at most, and it forgets a share of 0.3 lambda from look to look: 1900 looks
    # are worth 1900 * 0.3 lambda / 2 independent ones.  A look anywhere between two signals sees 0.01 less,
    # or up to 0.01 more or less than that.
    standard_error = 0.4 * before_a_signal / np.sqrt(1900 * 0.3 * probability / 2.0)
    assert (abs(mean - (before_a_signal - 0.01)) <= 3.5 * standard_error + 0.01).all()


def test_the_punctual_agent_answers_its_share_of_signals_exactly(page: Names) -> None:
    result = page.mixed
    heard = result.account.delivered[0]
    assert heard.min() > 100
    for i in (1, 3):
        share = 0.1 * page.factors[i]  # lambda = 2 Gamma c, whatever the average
        cuts = len(times_of(result, "respond", agent=str(i)))
        assert cuts == result.account.responses[0, i]
        # It always owes less than one: the count is behind by less than one, and never ahead.
        assert share * heard[i] - 1.0 - 1e-9 < cuts <= share * heard[i] + 1e-9
    # Responses are counted like those of the others, in the log and in the summary.
    assert result.account.responses.min() > 0
    assert result.summary()["responses"].iloc[0] == len(times_of(result, "respond"))
    parts = {"dynamics": "continuous", "control_unit": Crossing(1.0), "agents": Fleet, "seed": 1}
    beside = Simulation(
        page.problem, special=dict.fromkeys((1, 3), page.Punctual), recording=Recording(events=True), **parts
    ).run(300)
    assert beside.digest == result.digest
    assert (beside.account.responses == result.account.responses).all()


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_an_agent_that_does_nothing_grows_by_itself(page: Names, dynamics: Any) -> None:
    control_unit = Sampled() if dynamics == "discrete" else Crossing(1.0)
    parts = {"dynamics": dynamics, "control_unit": control_unit, "agents": page.Selfish, "seed": 1}
    result = Simulation(page.problem, **parts).run(until=250.0)
    np.testing.assert_allclose(result.demand_at_end, 250 * 0.02, rtol=1e-12)
    assert result.signals["time"].iloc[0] == pytest.approx(41.0 if dynamics == "discrete" else 40.0)


def test_an_agent_may_wait_for_events_of_its_own() -> None:
    # It takes what it wants for one unit of time in every five, and nothing in between.
    class Shift:
        def __init__(self, agent: int, system: System) -> None:
            self.agent, self.system = agent, system

        def receive(self, signal: Signal) -> None: ...

        def process(self) -> ProcessGenerator:
            for q in range(100):
                for time, wanted in ((5.0 * q, 1.0), (5.0 * q + 1.0, 0.0)):
                    yield self.system.env.at(time, EventKind.INTERVENE)
                    self.system.set_demand(self.agent, 0, wanted)

    problem = random_problem(2, 1, 1)
    alpha = problem.increase[0, 0]
    parts = {"dynamics": "continuous", "agents": Shift, "control_unit": Sampled(1.0, 1e6), "seed": 0}
    result = Simulation(problem, **parts).run(500.0)
    mean = (1.0 + 0.5 * alpha + 4.0 * 2.0 * alpha) / 5.0
    assert result.average_at_end[0, 0] == pytest.approx(mean, rel=1e-12)
    assert result.demand_at_end[0, 0] == pytest.approx(4.0 * alpha, rel=1e-9)


# -- a control unit --------------------------------------------------------------------------------------


def test_a_unit_that_signals_early_keeps_demand_below_capacity_at_the_cost_of_use(page: Names) -> None:
    overshoot = [result.observations.overshoot for result in (page.early, page.late)]
    assert overshoot[0].time[0] < 0.2 * overshoot[1].time[0]
    assert overshoot[0].peak[0] < overshoot[1].peak[0]
    used = [result.average_at_end.sum() for result in (page.early, page.late)]
    assert used[0] < used[1]
    totals = page.early.events[page.early.events["kind"] == "signal"]["value"]
    assert totals.min() > 0.8 * 4.0
    assert (totals < 4.0).sum() > 50
    assert page.late.events[page.late.events["kind"] == "signal"]["value"].min() > 4.0


def test_it_signals_as_often_as_it_says(page: Names) -> None:
    # Nobody responds and demand is held: from 0.8 to 1 of the threshold the chance goes from 0 to 1.
    for load, chance in ((0.75, 0.0), (0.85, 0.0625), (0.95, 0.5625), (1.0, 1.0)):

        def fill(system: System, level: float = 4.0 * load) -> ProcessGenerator:
            for look in range(2000):
                yield system.env.at(float(look), EventKind.INTERVENE)
                for agent in range(5):
                    system.set_demand(agent, 0, level / 5)

        parts = {"control_unit": page.Gentle(), "channel": BroadcastChannel(loss=1.0)}
        sent = len(Simulation(page.problem, processes=[fill], seed=0, **parts).run(2000.0).signals)
        # 2000 looks: a standard error of at most sqrt(2000 / 4) = 22.4.
        assert abs(sent - 2000 * chance) <= 4 * math.sqrt(2000 * chance * (1 - chance)) + 1e-9


def test_a_part_that_begins_its_luck_anew_can_be_run_again(page: Names) -> None:
    class Spoilt:
        """A generator that is made with the part: what the page warns of."""

        def __init__(self) -> None:
            self.rng = np.random.default_rng(2)

        def process(self, system: System) -> ProcessGenerator:
            for look in range(10**9):
                yield system.env.at(float(look), EventKind.SENSE)
                if self.rng.random() < (system.total(0) / 4.0 - 0.8) / 0.2:
                    system.broadcast(0)

    class Restless:
        """Samples once in every unit of time, at an instant from numbers with an address."""

        def process(self, system: System) -> ProcessGenerator:
            key = system.keys[Purpose.SENSING]
            for look in range(10**9):
                yield system.env.at(look + uniforms(key, 0, look, 1)[0], EventKind.SENSE)
                for j in np.flatnonzero(system.totals() > system.parameters.limit):
                    system.broadcast(int(j))

    digests = []
    for unit in (page.Gentle(), Restless(), Spoilt()):
        simulation = Simulation(page.problem, control_unit=unit, seed=1)
        digests.append(simulation.run(until=300).digest == simulation.run(until=300).digest)
    assert digests == [True, True, False]


def test_a_control_unit_of_ones_own_can_be_the_ordinary_one(page: Names) -> None:
    class Plain:
        def process(self, system: System) -> Iterator[Any]:
            for look in range(10**9):
                yield system.env.at(float(look), EventKind.SENSE)
                for j, total in enumerate(system.totals()):
                    if total > system.parameters.limit[j]:
                        system.broadcast(j)

    problem = random_problem(2, 5, 2)
    parts = {"channel": BroadcastChannel(0.5), "seed": 1}
    mine = Simulation(problem, control_unit=Plain(), **parts).run(until=200)
    assert_same_run(mine, Simulation(problem, **parts).run(until=200))


# -- channels --------------------------------------------------------------------------------------------


def test_the_relay_loses_what_leaves_while_it_sleeps(page: Names) -> None:
    result = page.relayed
    times = result.signals_sent.time
    asleep = sum(5.0 <= time % 10.0 < 10.0 for time in times.tolist())
    assert 30 < asleep < len(times) - 30
    assert result.account.lost.tolist() == [[0, 0, asleep, asleep, asleep]]
    on_the_way = sum(time + 1.0 >= 300.0 and time % 10.0 < 5.0 for time in times.tolist())
    assert result.account.in_flight.tolist() == [[0, 0, *[on_the_way] * 3]]
    assert (result.account.delivered + result.account.lost + result.account.in_flight == len(times)).all()


def test_a_channel_of_ones_own_can_be_the_ordinary_one(page: Names) -> None:
    class Late:
        def open(self, n_agents: int, keys: Any) -> "Late":
            self.n_agents = n_agents
            return self

        def transmit(self, broadcast: Any, departure: float) -> Copies:
            return Copies(np.full(self.n_agents, departure + 1.0))

    problem = random_problem(2, 5, 2)
    mine = Simulation(problem, channel=Late(), seed=1).run(until=200)
    assert_same_run(mine, Simulation(problem, channel=BroadcastChannel(1.0), seed=1).run(until=200))
    assert mine.digest == run_synchronous(problem, steps=200, seed=1).digest


def test_far_agents_hear_late(page: Names) -> None:
    result = page.spread
    sent = result.events[result.events["kind"] == "signal"].set_index("number")["time"]
    for i, distance in enumerate([0.1, 0.2, 0.4, 0.8, 1.6]):
        landed = result.events[(result.events["kind"] == "deliver") & (result.events["agent"] == str(i))]
        waits = landed["time"].to_numpy() - sent[landed["number"]].to_numpy()
        assert len(waits) > 80
        assert distance - 1e-9 <= waits.min() < 1.01 * distance
        assert 1.09 * distance < waits.max() <= 1.1 * distance + 1e-9
    assert result.account.lost.sum() > 30


def test_a_loss_model_of_ones_own(page: Names) -> None:
    class EveryOther:
        """Loses every other broadcast on all links; begins anew in every run."""

        def start(self, n_agents: int) -> "EveryOther":
            self.n_agents, self.sent = n_agents, 0
            return self

        def draw(self, draws: Any) -> Any:
            self.sent += 1
            return np.full(draws.n_agents, self.sent % 2 == 0)

    parts = {"dynamics": "continuous", "control_unit": Crossing(1.0), "seed": 1}
    simulation = Simulation(page.problem, channel=BroadcastChannel(loss=EveryOther()), **parts)
    result = simulation.run(until=300)
    assert result.account.lost.tolist() == [[len(result.signals) // 2] * 5]
    assert simulation.run(until=300).digest == result.digest


# -- names and indices -----------------------------------------------------------------------------------


def test_agents_and_resources_are_given_by_name_or_by_index() -> None:
    problem, seen = random_problem(2, 3, 2), []
    name = problem.resource_names[1]

    def named(system: System) -> ProcessGenerator:
        yield system.env.at(2.0, EventKind.INTERVENE)
        system.set_demand("2", name, 0.5)
        system.broadcast(name)
        yield system.env.at(3.0, EventKind.OBSERVE)
        for resource, agent in ((name, "2"), (1, 2), (np.int64(1), np.int64(2))):
            values = system.total(resource), system.demand(agent, resource), system.average(agent, resource)
            seen.append(values)

    result = Simulation(problem, processes=[named], recording=Recording(events=True), seed=0).run(4.0)
    assert seen[0] == seen[1] == seen[2]
    assert min(seen[0]) > 0.0
    events = result.events[result.events["time"] == 2.0]
    told = dict(zip(events["kind"], events["resource"], strict=True))
    assert told["change"] == told["signal"] == name


# -- what a part may do wrong ----------------------------------------------------------------------------


def meddling(act: Any) -> dict[str, Any]:
    def process(system: System) -> ProcessGenerator:
        yield system.env.at(3.0, EventKind.INTERVENE)
        act(system)

    return {"processes": [process]}


class Saying:
    """A channel that says the same of every broadcast."""

    def __init__(self, arrival: list[float]) -> None:
        self.arrival = np.array(arrival)

    def open(self, n_agents: int, keys: Any) -> "Saying":
        return self

    def transmit(self, broadcast: Any, departure: float) -> Copies:
        return Copies(self.arrival)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (meddling(lambda system: system.set_demand(0, 0, math.nan)), "demand = nan: must be "),
        (meddling(lambda system: system.set_demand(0, 0, -1.0)), "demand = -1.0: must be "),
        (meddling(lambda system: system.respond(0, 0, 1.5)), "factor = 1.5: must be "),
        (meddling(lambda system: system.set_demand(-1, 0, 1.0)), "agent = -1: must be "),
        (meddling(lambda system: system.set_demand(0, 1, 1.0)), "resource = 1: must be "),
        (meddling(lambda system: system.broadcast(-1)), "resource = -1: must be "),
        (meddling(lambda system: system.broadcast(1)), "resource = 1: must be "),
        (meddling(lambda system: system.broadcast(0, delay=-1.0)), "delay = -1.0: must be "),
        (meddling(lambda system: system.demand(-1, 0)), "agent = -1: must be "),
        (meddling(lambda system: system.demand(0, -1)), "resource = -1: must be "),
        (meddling(lambda system: system.average(5, 0)), "agent = 5: must be "),
        (meddling(lambda system: system.demand("five", 0)), "agent = 'five': must be one of 0, 1, 2, 3, 4"),
        (meddling(lambda system: system.total(True)), "resource = True: must be "),
        (
            meddling(lambda system: system.total("memroy")),
            "resource = 'memroy': must be one of memory; did you mean 'memory'?",
        ),
        ({"channel": Saying([50.0])}, r"shape of Saying\.transmit\(\)\.arrival = \(1,\): must be \(5,\)"),
        (
            {"channel": Saying([50.0, math.nan, 50.0, 50.0, 50.0])},
            r"Saying\.transmit\(\)\.arrival\[1\] = nan: must be ",
        ),
    ],
)
def test_what_a_part_does_wrong_is_refused_by_name(page: Names, parts: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}"):
        Simulation(page.problem, seed=0, **parts).run(60.0)


# -- costs -----------------------------------------------------------------------------------------------


def test_exponential_prices_are_shared_as_the_optimum_says(page: Names) -> None:
    summary = page.priced.summary(page.optimum)
    assert page.optimum.kkt_residual < 1e-6
    # The derivatives agree far better than equal shares would have it, or those of quadratic costs.
    assert summary["consensus_spread"].iloc[0] < 0.15
    equal = np.full((5, 1), 0.8)
    derivatives = page.costs.gradient(equal)[:, 0]
    assert derivatives.std() / derivatives.mean() > 0.3


def test_a_wrong_gradient_is_refused_before_anything_runs(page: Names) -> None:
    wrong = CustomCosts(
        5, 1, value=page.costs.agent_value, gradient=lambda i, x: [page.factors[i] * np.exp(x[0])]
    )
    with pytest.raises(InputError, match="gradient"):
        Problem(page.problem.resources, wrong)


def test_parts_are_put_together_freely(page: Names) -> None:
    """Own agents, own control unit, own latency and own process in one run, on clocks of their own."""

    def make(i: int, system: System) -> Any:
        return page.Selfish(i, system) if i == 0 else AgentProcess(i, system)

    simulation = Simulation(
        page.exponential,
        control_unit=page.Gentle(),
        channel=BroadcastChannel(page.Distance([0.1, 0.2, 0.4, 0.8, 1.6]), loss=0.1, duplication=0.1),
        agents=make,
        clocks=Clocks(1.0, "random", 0.01, 0.3),
        processes=[page.jam],
        recording=Recording(events=True),
        seed=1,
    )
    result = simulation.run(until=150)
    assert simulation.run(until=150).digest == result.digest
    assert set(times_of(result, "signal")) >= {100.0 + q for q in range(50)}
    assert result.account.responses[0, 0] == 0 < result.account.responses[0, 1:].min()
