"""What the channel does to copies of a signal: loses them at random, or lets them arrive later."""

import math
import re
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aimd_des import InputError, Problem, Result
from aimd_des.channel import Broadcast, BroadcastChannel, Draws
from aimd_des.channel.broadcast import CompiledLink
from aimd_des.engine.simulation import Simulation
from aimd_des.latency import Constant, Uniform
from aimd_des.loss import Bernoulli, GilbertElliott, Trace
from aimd_des.utils.rng import Purpose, key
from models import smart_cameras
from tests.conftest import quadratic_problem, quietly, random_problem, reference_draws


def run(problem: Problem, until: float, **channel: Any) -> Result:
    return quietly(Simulation(problem, channel=BroadcastChannel(**channel), seed=21).run, until)


def copies(summary: pd.DataFrame, n: int) -> pd.Series:
    """Every broadcast makes a copy for each agent, and each copy has one fate."""
    total = summary["signals"] * n
    assert (summary["delivered"] + summary["lost"] + summary["in_flight"] == total).all()
    return total


@pytest.fixture(scope="module")
def lossy() -> Result:
    """60 cameras over 1500 steps: some 90,000 copies."""
    return run(smart_cameras(seed=1), 1500.0, loss=0.25)


def loss_scores(result: Result, probability: float) -> pd.Series:
    """The rate of loss of each resource beside a probability, in standard errors sqrt(p (1 - p) / copies)."""
    summary = result.summary()
    total = copies(summary, result.problem.n_agents)
    error = np.sqrt(probability * (1 - probability) / total)
    return (summary["lost"] / total - probability) / error


def test_losses_have_the_probability_that_is_said(lossy: Result) -> None:
    assert (copies(lossy.summary(), 60) > 20_000).all()
    assert (loss_scores(lossy, 0.25).abs() < 4).all()


@pytest.mark.parametrize("wrong", [0.23, 0.27])
def test_the_score_finds_a_probability_that_is_a_little_wrong(lossy: Result, wrong: float) -> None:
    assert (loss_scores(lossy, wrong).abs() > 4).all()


def test_the_copies_that_are_lost_are_those_with_a_draw_below_the_probability(lossy: Result) -> None:
    lost = [
        sum(int((reference_draws(21, Purpose.LOSS, j, b, 60) < 0.25).sum()) for b in range(sent))
        for j, sent in enumerate(lossy.summary()["signals"])
    ]
    assert lossy.summary()["lost"].tolist() == lost


class OwnLatency:
    """Not among those that there are formulas for in compiled code."""

    def check(self, n_agents: int) -> None:
        pass

    def draw(self, draws: Draws) -> Any:
        return np.zeros(draws.n_agents)


@pytest.mark.parametrize("latency", [Constant(0.0), OwnLatency()], ids=["compiled", "of one's own"])
def test_whether_a_copy_is_doubled_has_nothing_to_do_with_losses(latency: Any) -> None:
    """With the numbers of losses for it, no copy that arrives would be doubled here."""
    keys = {purpose: key(3, purpose) for purpose in Purpose}
    link = BroadcastChannel(latency, loss=0.5, duplication=0.5).open(200, keys)
    for number in range(3):
        copies = link.transmit(Broadcast(1, number, 0.0), 0.0)
        kept = reference_draws(3, 2, 1, number, 200) >= 0.5
        doubled = reference_draws(3, 5, 1, number, 200) < 0.5
        assert copies.second is not None
        assert np.array_equal(np.isfinite(copies.arrival), kept)
        assert np.array_equal(np.isfinite(copies.second), kept & doubled)
        assert (kept & doubled).any()


@pytest.mark.parametrize("loss", [0.3, GilbertElliott(0.5, 10.0), Trace([0, 1, 1], repeat=False)])
def test_a_link_that_is_renewed_or_begun_anew_has_forgotten_what_was_sent(loss: Any) -> None:
    keys = {purpose: key(4, purpose) for purpose in Purpose}
    channel = BroadcastChannel(Uniform(0.0, 9.0), loss=loss, fifo=True)
    used, fresh = channel.open(50, keys), channel.open(50, keys)
    assert isinstance(used, CompiledLink)
    for number in range(3):
        used.transmit(Broadcast(0, number, 100.0 + number), 100.0 + number)
    anew, salted = used.anew(keys), used.anew({purpose: key(5, purpose) for purpose in Purpose})
    assert np.shares_memory(anew.table.loss.probability, used.table.loss.probability)
    used.renew()
    differ = False
    for number in range(3):
        expected, *found = (
            link.transmit(Broadcast(0, number, float(number)), float(number)).arrival
            for link in (fresh, used, anew, salted)
        )
        assert np.array_equal(found[0], expected)
        assert np.array_equal(found[1], expected)
        differ |= not np.array_equal(found[2], expected)
    assert differ


def test_where_everything_is_lost_nobody_ever_responds() -> None:
    problem = random_problem(5, 4, 2)
    result = run(problem, 200.0, loss=1.0)
    summary = result.summary()
    assert (summary["signals"] > 100).all()
    assert summary["lost"].tolist() == copies(summary, 4).tolist()
    assert result.account.responses.sum() == 0
    np.testing.assert_allclose(result.demand_at_end, 200 * problem.increase, rtol=1e-12)


def test_where_nothing_is_lost_everything_arrives() -> None:
    summary = run(random_problem(5, 4, 2), 200.0, loss=0.0).summary()
    assert summary["delivered"].tolist() == copies(summary, 4).tolist()


def test_each_agent_may_have_its_own_probability_of_loss() -> None:
    result = run(quadratic_problem([1.0, 1.0, 1.0], capacity=2.0), 400.0, loss=[1.0, 0.0, 1.0])
    responses = result.account.responses[0]
    assert responses[0] == responses[2] == 0 < responses[1]
    summary = result.summary()
    assert (summary["lost"] == 2 * summary["signals"]).all()


def test_copies_on_their_way_at_the_end_are_in_flight() -> None:
    latency = [0.0, 2.5, 1000.0]
    result = run(quadratic_problem([1.0, 1.0, 1.0], capacity=2.0), 100.0, latency=latency)
    times = result.signals_sent.time
    arrived = [int((times + each < 100.0).sum()) for each in latency]
    assert len(times) == arrived[0] > arrived[1] > arrived[2] == 0
    assert result.summary()["delivered"].tolist() == [sum(arrived)]
    assert copies(result.summary(), 3).tolist() == [3 * len(times)]
    assert result.account.responses[0, 2] == 0


@pytest.mark.parametrize(("latency", "first"), [(0.0, 9), (1.0, 10), (1.5, 11), (2.0, 11), (7.25, 17)])
def test_a_latency_delays_the_first_response(latency: float, first: int) -> None:
    # Totals are 1, 2, ...; the look at 9 is the first above 8.  Those who are told at tick k act at k.
    problem = quadratic_problem([1.0] * 4, capacity=8.0, increase=0.25, decrease=0.0, normalization=0.75)
    result = run(problem, first + 1.0, latency=latency)
    assert result.signals_sent.time[0] == 9.0
    assert result.demand_at_end.tolist() == [[0.0]] * 4
    earlier = run(problem, float(first), latency=latency)
    assert earlier.demand_at_end.tolist() == [[0.25 * first]] * 4


def test_numbers_stand_for_the_simplest_models() -> None:
    spelled = {"latency": Constant([0.5, 1.5, 0.0, 3.0]), "loss": Bernoulli(0.2)}
    short = {"latency": np.array([0.5, 1.5, 0.0, 3.0]), "loss": 0.2}
    problem = random_problem(6, 4, 2)
    assert run(problem, 60.0, **short).digest == run(problem, 60.0, **spelled).digest
    assert run(problem, 60.0).digest == run(problem, 60.0, latency=0, loss=0).digest


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"latency": -0.5}, "latency = -0.5: must be a finite number at least 0"),
        ({"latency": math.nan}, "latency = nan: must be a finite number at least 0"),
        ({"latency": math.inf}, "latency = inf: must be a finite number at least 0"),
        (
            {"latency": "1"},
            "latency = '1': must be a number, one for each agent, or a model of",
        ),
        ({"latency": None}, "latency = None: must be a number, one for each agent, or a model"),
        ({"latency": [0.0, -1.0]}, "latency[1] = -1.0: must be a finite number at least 0"),
        ({"latency": [[0.0]]}, "shape of latency = (1, 1): must be (n_agents,)"),
        ({"loss": -0.1}, "loss = -0.1: must be a finite number at least 0 and at most 1"),
        ({"loss": 1.1}, "loss = 1.1: must be a finite number at least 0 and at most 1"),
        ({"loss": math.nan}, "loss = nan: must be a finite number at least 0 and at most 1"),
        ({"loss": True}, "loss = True: must be a finite number at least 0 and at most 1"),
        ({"loss": [0.0, 2.0]}, "loss[1] = 2.0: must be a finite number at least 0 and at most 1"),
    ],
)
def test_a_channel_refuses_by_name(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        BroadcastChannel(**options)


@pytest.mark.parametrize("name", ["latency", "loss"])
def test_a_value_for_each_agent_must_be_one_for_each(name: str) -> None:
    problem = quadratic_problem([1.0] * 3, capacity=1.0)
    message = rf"^shape of {name} = \(2,\): must be \(3,\); give one number for all agents or one for each$"
    with pytest.raises(InputError, match=message):
        run(problem, 100.0, **{name: [0.5, 0.5]})
