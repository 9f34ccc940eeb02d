"""Two runs that differ in the channel alone share their luck, and a comparison of them is sharper for it.

How much sharper is said of the ratio of two variances: that of the difference between two channels with the
same seed, over that with different seeds. With N independent differences of each kind, of about normal
distribution, the ratio of the estimates is F(N - 1, N - 1) times the true ratio; so the estimate times
the 99 % quantile of F bounds the true ratio from above with 99 % confidence. Its standard error is about
the ratio times sqrt(4 / (N - 1)).
"""

from typing import Any, Literal

import numpy as np
import pytest
from scipy import stats

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    latency,
    loss,
)
from aimd_des.engine.delivery import Signal
from aimd_des.engine.system import System
from aimd_des.utils.rng import Purpose
from aimd_des.utils.validation import FloatArray
from tests.conftest import quadratic_problem, quietly, random_problem, reference_draws

Dynamics = Literal["discrete", "continuous"]
UNITS: dict[Dynamics, Sampled | Crossing] = {"discrete": Sampled(), "continuous": Crossing(1.0)}

# Seeds 0 to 27 behind both channels; 28 to 55 for differences between different seeds.
PAIRS = 28
QUANTILE = float(stats.f.ppf(0.99, PAIRS - 1, PAIRS - 1))


def run(
    problem: Problem, dynamics: Dynamics, seed: int, until: float, channel: dict[str, Any], **parts: Any
) -> Result:
    simulation = Simulation(
        problem,
        dynamics=dynamics,
        control_unit=UNITS[dynamics],
        channel=BroadcastChannel(**channel),
        seed=seed,
        **parts,
    )
    return quietly(simulation.run, until)


def measures(dynamics: Dynamics, channel: dict[str, Any], seeds: range) -> dict[str, FloatArray]:
    """Signals, and what the first agent gets on average, of one run for each seed."""
    problem = quadratic_problem(
        np.linspace(1.0, 3.0, 8).tolist(), capacity=4.0, increase=0.02, decrease=0.7, normalization=0.1
    )
    recording = Recording(demand="end", overshoot=False)
    results = [run(problem, dynamics, seed, 400.0, channel, recording=recording) for seed in seeds]
    assert min(len(result.signals_sent.time) for result in results) > 80
    return {
        "signals": np.array([len(result.signals_sent.time) for result in results], dtype=np.float64),
        "average of agent 0": np.array([result.average_at_end[0, 0] for result in results]),
    }


def bound(common: FloatArray, different: FloatArray) -> float:
    """The ratio of variances, bounded from above with 99 % confidence."""
    return float(common.var(ddof=1) / different.var(ddof=1) * QUANTILE)


CHANNELS = [
    ({"latency": latency.Exponential(0.5)}, {"latency": latency.Exponential(1.0)}),
    ({"latency": 0.5, "loss": 0.1}, {"latency": 0.5, "loss": 0.15}),
]


@pytest.mark.parametrize("channels", CHANNELS, ids=["latency", "loss"])
@pytest.mark.parametrize("dynamics", UNITS)
def test_the_variance_of_a_difference_is_at_most_half_with_a_common_seed(
    dynamics: Dynamics, channels: tuple[dict[str, Any], dict[str, Any]]
) -> None:
    one = measures(dynamics, channels[0], range(PAIRS))
    other = measures(dynamics, channels[1], range(PAIRS))
    elsewhere = measures(dynamics, channels[1], range(PAIRS, 2 * PAIRS))
    for name in ("signals", "average of agent 0"):
        different = one[name] - elsewhere[name]
        assert bound(one[name] - other[name], different) <= 0.5, name
        # Each seed beside the next one: nothing is gained, and the bound says so.
        assert bound(np.roll(one[name], 1) - other[name], different) > 0.5, name


# -- why: draws have addresses ---------------------------------------------------------------------------


class Watched(AgentProcess):
    """A camera that keeps every draw it is given, by address."""

    def __init__(self, agent: int, system: System, draws: dict[tuple[int, ...], float]) -> None:
        super().__init__(agent, system)
        self.draws = draws

    def answer(self, signals: list[Signal], moment: float) -> None:
        for signal in signals:
            address = (self.agent, signal.resource, signal.number, signal.copy)
            self.draws[address] = self.system.response_draws(signal)[self.agent]
        super().answer(signals, moment)


VARIED = [
    {},
    {"latency": 0.9},
    {"latency": latency.Pareto(1.5, 0.2), "loss": 0.3},
    {"latency": latency.Exponential(2.0), "fifo": True, "duplication": 0.3},
    {"loss": loss.GilbertElliott(0.4, 5.0), "duplication": 0.3},
]


@pytest.mark.parametrize("dynamics", UNITS)
def test_the_draws_for_responses_are_the_same_whatever_the_channel(dynamics: Dynamics) -> None:
    problem = random_problem(2, 5, 2)
    drawn: list[dict[tuple[int, ...], float]] = []
    for channel in VARIED:
        draws: dict[tuple[int, ...], float] = {}
        result = run(
            problem, dynamics, 3, 60.0, channel, agents=lambda i, system, kept=draws: Watched(i, system, kept)
        )
        assert result.account.responses.sum() > 30
        drawn.append(draws)
    for draws in drawn:
        for (agent, j, number, copy), draw in draws.items():
            if copy == 0:
                assert draw == reference_draws(3, Purpose.RESPONSE, j, number, 5)[agent]
    # A duplicate has a draw of its own, and it too is the same behind another channel.
    for one, other in ((drawn[0], drawn[1]), (drawn[1], drawn[2]), (drawn[3], drawn[4])):
        shared = set(one) & set(other)
        assert len(shared) > 50
        assert all(one[address] == other[address] for address in shared)
    if dynamics == "continuous":
        twice = [address for address in set(drawn[3]) & set(drawn[4]) if address[3] == 1]
        assert len(twice) > 5
        assert all(drawn[3][address] != drawn[3][(*address[:3], 0)] for address in twice)


@pytest.mark.parametrize("dynamics", UNITS)
def test_more_loss_loses_what_less_loss_loses_and_more(dynamics: Dynamics) -> None:
    problem = random_problem(2, 5, 2)

    def lost(probability: float) -> tuple[set[tuple[Any, ...]], int]:
        recording = Recording(events=True)
        events = run(problem, dynamics, 3, 60.0, {"loss": probability}, recording=recording).events
        rows = events[events["kind"] == "lost"][["resource", "number", "agent"]]
        fewest = events[events["kind"] == "signal"]["resource"].value_counts().min()
        return set(rows.itertuples(index=False, name=None)), int(fewest)

    (some, sent), (more, sent_more) = lost(0.1), lost(0.3)
    common = min(sent, sent_more)
    both = [{row for row in rows if row[1] < common} for rows in (some, more)]
    assert len(both[0]) > 10
    assert both[0] < both[1]


def test_the_latency_of_a_copy_scales_with_the_model_and_keeps_its_place() -> None:
    # An exponential twice as long: every copy of every broadcast that both have takes twice as long.
    problem = random_problem(2, 5, 2)
    waits = []
    for mean in (0.25, 0.5):
        recording = Recording(events=True)
        events = run(
            problem, "continuous", 3, 60.0, {"latency": latency.Exponential(mean)}, recording=recording
        ).events
        sent = events[events["kind"] == "signal"].set_index(["resource", "number"])["time"]
        landed = events[events["kind"] == "deliver"].set_index(["resource", "number", "agent"])["time"]
        waits.append((landed - sent.reindex(landed.index.droplevel("agent")).to_numpy()).to_dict())
    shared = set(waits[0]) & set(waits[1])
    assert len(shared) > 100
    for address in shared:
        assert waits[1][address] == pytest.approx(2.0 * waits[0][address], abs=1e-12)
