"""Whole random runs are held against a reference simulator that shares no code with the framework."""

import inspect
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from aimd_des import (
    BroadcastChannel,
    Clocks,
    Crossing,
    CustomCosts,
    Recording,
    Result,
    Sampled,
    averaging,
    compensation,
    interventions,
    latency,
    loss,
    responses,
)
from aimd_des.control_units import EarlyDetection
from aimd_des.problem.costs import Costs
from aimd_des.utils.errors import OverloadWarning
from tests.conftest import FAMILIES, problems, random_problem
from tests.support import reference_asynchronous
from tests.support.configurations import (
    PARTS,
    Configuration,
    OwnLooks,
    SetDemands,
    compensations,
    configurations,
    plain_channels,
    rising,
)
from tests.support.reference_asynchronous import Outcome, Setting, simulate

# -- a configuration in plain numbers ----------------------------------------------------------------------


def numbers_of(part: Any) -> tuple[Any, ...]:
    """The parameters of a part."""
    return tuple(vars(part).values())


def change_of(change: Any, n: int) -> tuple[Any, ...]:
    """A change from outside in the words of the reference simulator."""
    match change:
        case interventions.Absence() | interventions.Crash():
            return "absence", *numbers_of(change), isinstance(change, interventions.Crash)
        case interventions.Join():
            return "absence", change.agents, 0.0, change.at, True
        case interventions.ChangeThreshold():
            return "threshold", *numbers_of(change)
        case interventions.Partition():
            agents = range(n) if change.agents is None else change.agents
            return "partition", change.at, change.duration, agents
    names = {
        interventions.CapacityStep: "step",
        interventions.CapacityRamp: "ramp",
        interventions.CapacityProfile: "profile",
        interventions.UnusualActivity: "activity",
        interventions.Prices: "prices",
        interventions.Failover: "failover",
    }
    return names[type(change)], *numbers_of(change)


NAMES: dict[type, str] = {
    latency.Constant: "constant",
    latency.Uniform: "uniform",
    latency.Exponential: "exponential",
    loss.Bernoulli: "chance",
    loss.GilbertElliott: "bursts",
    averaging.Cumulative: "all",
    averaging.Window: "window",
    averaging.Forgetting: "forgetting",
    averaging.Polynomial: "gain",
    compensation.KnownLoss: "known",
}


def response_of(response: Any) -> tuple[Any, str, int, tuple[str, ...]]:
    """A response in the words of the reference simulator."""
    match response:
        case responses.EventNormalised():
            return "signals", "drawn", 0, ()
        case responses.Derandomised():
            events = "cuts" if response.full else "signals"
            divisor = "average" if response.divisor == "average" else events
            return divisor, "full" if response.full else "fractional", 0, ()
        case responses.CustomResponse():
            function = response.probability.py_func  # type: ignore[attr-defined]
            return function, response.cut, response.memory, tuple(inspect.signature(function).parameters)
    return "average", "drawn", 0, ()


def setting_of(configuration: Configuration) -> Setting:
    """The run in plain numbers; a part that the reference simulator does not know is a `KeyError`."""

    def named(part: Any) -> tuple[Any, ...]:
        return NAMES[type(part)], *numbers_of(part)

    parts, n, until = configuration.parts, configuration.problem.n_agents, configuration.until
    unit, channel, answers = parts["control_unit"], parts["channel"], parts["compensation"]
    if isinstance(unit, Crossing):
        numbers: tuple[Any, ...] = (
            "crossing",
            unit.hold_off,
            unit.longest_hold_off or unit.hold_off,
            unit.sensing_delay,
        )
    else:
        shares: tuple[Any, ...] = (unit.low, unit.high) if isinstance(unit, EarlyDetection) else ()
        shares = (rising,) if isinstance(unit, OwnLooks) else shares
        kind = ("sampled", "own", "early")[len(shares)]
        numbers = (kind, unit.period, unit.phase, unit.sensing_delay, *shares)
    if isinstance(answers, compensation.EstimatedLoss):
        answered: Any = ("estimated",)
    else:
        answered = answers and ("known", np.broadcast_to(answers.loss, n))
    set_later = [("demand", *change) for process in parts["processes"] for change in process.changes]
    return Setting(
        problem=configuration.problem,
        seed=configuration.seed,
        until=until,
        clocks=numbers_of(parts["clocks"] or Clocks()) if parts["dynamics"] == "discrete" else None,
        unit=numbers,
        latency=named(channel.latency),
        loss=named(channel.loss),
        duplication=channel.duplication,
        fifo=channel.fifo,
        average=named(parts["averaging"] or averaging.Cumulative()),
        response=response_of(parts["response"]),
        compensation=answered,
        changes=[*(change_of(change, n) for change in parts["interventions"]), *set_later],
        looks=parts["recording"].demand,
    )


def looks(until: float) -> st.SearchStrategy[Recording]:
    """Totals and allocations are looked at a few times."""
    found = [look for look in (0.0, 2.5, 10.0, until - 3.0) if 0.0 <= look < until]
    return st.just(Recording(demand=sorted(found), allocations=sorted(found), events=True))


#: What the reference simulator knows: it reads numbers of signals as a whole, and not their last bits.
KNOWN: dict[str, Any] = {
    "channel": lambda problem, dynamics, until: plain_channels(problem.n_agents),
    "compensation": lambda problem, dynamics, until: compensations(problem.n_agents).filter(
        lambda drawn: getattr(drawn, "number_bits", 8) == 8
    ),
    "recording": lambda problem, dynamics, until: looks(until),
}


def plain_configurations(dynamics: str) -> st.SearchStrategy[Configuration]:
    """Whatever the reference simulator knows."""
    return configurations(
        problem=problems(FAMILIES),
        dynamics=(dynamics,),
        until=st.sampled_from([0.5, 7.0, 30.0, 43.21]),
        **{**PARTS, **KNOWN},
    )


# -- both are held against each other ------------------------------------------------------------------------


def close(one: Any, other: Any, what: str, scale: float = 1.0) -> None:
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * scale, err_msg=what)


def assert_same_events(result: Result, second: Outcome) -> None:
    """Signals and answers agree one by one, and so do all counts."""
    sent = result.signals_sent
    signals = list(zip(sent.resource.tolist(), sent.number.tolist(), strict=True))
    assert signals == [signal[1:] for signal in second.signals]
    close(sent.time, [signal[0] for signal in second.signals], "times of signals")
    assert result.log is not None
    time, entry, value = result.log.columns()
    ours = np.flatnonzero((entry[:, 0] == 3) | (entry[:, 0] == 4))
    answers = [tuple(row) for row in entry[ours].tolist()]
    assert answers == [(4 if fall is None else 3, j, i, b) for _, j, i, b, fall in second.answers]
    close(time[ours], [answer[0] for answer in second.answers], "times of answers")
    close(value[ours], [answer[4] or 0.0 for answer in second.answers], "falls of demand")
    for name in ("delivered", "lost", "duplicated", "responses", "saturated"):
        assert getattr(result.account, name).tolist() == getattr(second, name), name
    sent_to_each = np.bincount([signal[1] for signal in second.signals], minlength=len(second.delivered))
    in_flight = sent_to_each[:, None] - np.array(second.delivered) - np.array(second.lost)
    assert np.array_equal(result.account.in_flight, in_flight)


def assert_same_state(result: Result, second: Outcome) -> None:
    """Demands and averages agree whenever somebody looks, and what total demand did in each piece."""
    seen = result.observations
    close(seen.allocation_times, [time for time, _, _ in second.seen], "times of looks")
    close(seen.demand, [demands for _, demands, _ in second.seen], "demands")
    close(seen.average, [averages for _, _, averages in second.seen], "averages")
    close(seen.total_demand, [np.sum(demands, axis=1) for _, demands, _ in second.seen], "totals")
    close(seen.total_average, [np.sum(averages, axis=1) for _, _, averages in second.seen], "averages")
    assert len(result.history) == len(seen.stretches) == len(second.pieces)
    for ours, stretch, piece in zip(result.history, seen.stretches, second.pieces, strict=True):
        assert ours.present.tolist() == piece.present
        assert ours.start == stretch.start == piece.start
        close(ours.capacity, piece.capacity, "capacities")
        for name in ("peak", "above", "excess", "used"):
            close(getattr(stretch, name), getattr(piece, name), name)


def best(costs: Costs, present: Any, weights: Any, capacity: Any) -> Any:
    """The optimum of separable costs, by bisection: all who are here have the same derivative."""

    def allocation(multiplier: Any) -> Any:
        low, high = np.zeros((2, *present.shape, len(capacity)))
        high[present] = capacity
        for _ in range(60):
            middle = 0.5 * (low + high)
            steep = weights[:, None] * costs.gradient(middle) > multiplier
            low, high = np.where(steep, low, middle), np.where(steep, middle, high)
        return 0.5 * (low + high)

    most = np.zeros((*present.shape, len(capacity)))
    most[present] = capacity
    low, high = np.full(len(capacity), 1e-300), (weights[:, None] * costs.gradient(most)).max(axis=0)
    # By orders of magnitude: derivatives at all of a capacity may be many above that of the optimum.
    for _ in range(64):
        middle = np.sqrt(low) * np.sqrt(high)
        enough = allocation(middle).sum(axis=0) > capacity
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return allocation(np.sqrt(low) * np.sqrt(high))


def measures(until: float, second: Outcome) -> dict[str, Any]:
    """The figures of a summary, from the definitions."""
    piece, (_, _, average) = second.pieces[-1], second.seen[-1]
    here, weights, capacity = np.array(piece.present), np.array(piece.weights), np.array(piece.capacity)
    x = np.where(here, average, 0.0).T
    used = x.sum(axis=0)
    gradient = (weights[:, None] * piece.costs.gradient(x))[here]
    found = {
        "utilisation": used / capacity,
        "consensus_spread": gradient.std(axis=0) / gradient.mean(axis=0),
        "overshoot_peak": np.max([np.divide(part.peak, part.capacity) for part in second.pieces], axis=0),
        "overshoot_time": np.sum([part.above for part in second.pieces], axis=0) / until,
        "overshoot_mean": np.sum([np.divide(part.excess, part.capacity) for part in second.pieces], axis=0)
        / until,
    }
    if piece.costs.separable and not isinstance(piece.costs, CustomCosts):  # whose functions are slow
        optimum, for_used = (best(piece.costs, here, weights, limits) for limits in (capacity, used))
        found["relative_error"] = np.abs(x - optimum).sum(axis=0) / capacity
        found["misallocation"] = np.abs(x - for_used).sum(axis=0) / used
        value, least = ((weights * piece.costs.value(held))[here].sum() for held in (x, optimum))
        found["cost_ratio"] = np.full(len(capacity), value / least)
    return found


def assert_same_run(configuration: Configuration, second: Outcome) -> None:
    """Hold the framework to the reference simulator."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OverloadWarning)  # random runs may lose all that they send
        result = configuration.run()
    assert_same_events(result, second)
    assert_same_state(result, second)
    if any(second.pieces[-1].present) and (result.average_at_end.sum(axis=0) > 0.0).all():
        found = measures(configuration.until, second)
        for name, values in result.measures(names=list(found)).items():
            np.testing.assert_allclose(values, found[name], rtol=1e-6, atol=1e-6, err_msg=name)


def with_one_channel(configuration: Configuration) -> Configuration:
    """Leave out what the reference simulator does not know: a channel that takes the place of another one."""
    changes = configuration.parts["interventions"]
    kept = [change for change in changes if not isinstance(change, interventions.ChangeChannel)]
    return replace(configuration, parts={**configuration.parts, "interventions": kept})


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
@settings(max_examples=15)
@given(data=st.data())
def test_the_framework_does_what_the_reference_does(dynamics: str, data: st.DataObject) -> None:
    configuration = with_one_channel(data.draw(plain_configurations(dynamics)))
    outcome = simulate(setting_of(configuration))
    assume(outcome.margin > 1e-9)  # no decision hangs on the last bits of a float
    assert_same_run(configuration, outcome)


def example(**changes: Any) -> Configuration:
    """A run in which every kind of draw decides something."""
    parts = {
        "dynamics": "discrete",
        "channel": BroadcastChannel(latency.Exponential(1.3), 0.2, duplication=0.5),
        "control_unit": Sampled(0.5, 0.25),
        "clocks": Clocks(1.0, "random", jitter=0.4),
        "averaging": None,
        "response": None,
        "compensation": None,
        "interventions": [],
        "processes": [],
        "recording": Recording(demand=[10.0], allocations=[10.0], events=True),
        **changes,
    }
    return Configuration(random_problem(2, 5, 2), 1, 30.0, parts)


EXAMPLES = [
    example(),
    example(dynamics="continuous", clocks=None, control_unit=Crossing(0.3, sensing_delay=0.4)),
    example(processes=[SetDemands(((2.5, 0, 1, 3.0), (7.0, 4, 0, 0.0)))], averaging=averaging.Window(6.0, 3)),
]


@pytest.mark.parametrize("configuration", EXAMPLES)
def test_the_examples_respond(configuration: Configuration) -> None:
    """Were there no signals and responses, the tests here would show little."""
    outcome = simulate(setting_of(configuration))
    assert_same_run(configuration, outcome)
    assert outcome.margin > 1e-9
    assert len(outcome.signals) > 10
    for counts in (outcome.lost, outcome.delivered, outcome.duplicated, outcome.responses):
        assert min(sum(of_resource) for of_resource in counts) > 3


NUMBERS = ["RESPONSE", "LOSS", "LATENCY", "CLOCK", "DUPLICATION", "TICKS", "PHASES"]


@pytest.mark.parametrize("number", [*NUMBERS, "SECOND_LATENCY", "SECOND_RESPONSE"])
def test_another_address_of_random_numbers_would_be_seen(
    number: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reference_asynchronous, number, 7)
    with pytest.raises(AssertionError):
        assert_same_run(EXAMPLES[0], simulate(setting_of(EXAMPLES[0])))
