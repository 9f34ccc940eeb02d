"""The paper's section III: everybody responds, as the theory of synchronised agents has it."""

import numpy as np
import pytest

from aimd_des import InputError, Recording, Result, run_synchronous, theory
from aimd_des.scenario.models import model_parameters, named_model
from models import classic_aimd

STEPS = 20_000


@pytest.fixture(scope="module")
def run() -> Result:
    """No seed matters where every response is certain; growth over a step is 0.7 % of the capacity."""
    return run_synchronous(classic_aimd(), steps=STEPS, seed=0, lag=0, recording=Recording(allocations=1.0))


def at_signals(run: Result) -> np.ndarray:
    """What every agent holds at capacity events, (events, n), after the first ten."""
    return run.observations.demand[run.signals_sent.time.astype(int), 0][10:]


def test_everybody_responds_to_every_signal_and_nobody_counts_as_saturated(run: Result) -> None:
    # The probability is 1.0 exactly: below it, draws next to 1 would miss; above it, the run would warn.
    assert (run.account.responses == len(run.signals)).all()
    assert run.account.saturated.sum() == 0
    problem = classic_aimd()
    for average in np.random.default_rng(0).uniform(0.0, 10.0, (1000, 4, 1)):
        assert (problem.normalization * problem.costs.gradient(average) / average == 1.0).all()


def test_shares_at_events_are_in_proportion_to_increase_over_one_minus_decrease(run: Result) -> None:
    # Exact in the mean, whatever the overshoot of a step is, up to what the ends of the sample leave: one
    # event in 350.
    problem, shares = run.problem, at_signals(run).mean(axis=0)
    expected = theory.event_mean(shares.sum(), problem.increase[:, 0], problem.decrease[:, 0])
    assert shares == pytest.approx(expected, rel=1 / len(at_signals(run)))
    # Negative control: neither in proportion to the increases alone nor equal, which would be the optimum.
    alone = shares.sum() * problem.increase[:, 0] / problem.increase.sum()
    for wrong in (alone, np.full(4, shares.mean())):
        assert np.abs(shares / wrong - 1).max() > 0.2


def test_period_and_utilisation(run: Result) -> None:
    problem = run.problem
    growth = problem.increase.sum() / problem.capacity[0]
    # On the clock an event comes up to a step of growth above the capacity, and takes a step itself.
    period = theory.event_interval(problem.capacity, problem.increase, problem.decrease)
    gaps = np.diff(run.signals_sent.time[10:])
    assert gaps.mean() - 1 == pytest.approx(period[0], rel=growth)
    used = run.average_at_end.sum() / problem.capacity[0]
    assert used == pytest.approx(
        theory.synchronised_utilisation(problem.increase, problem.decrease)[0], abs=growth
    )


def test_a_late_signal_makes_everybody_respond_twice() -> None:
    late = run_synchronous(classic_aimd(), steps=STEPS, seed=0, lag=1, recording=Recording(allocations=1.0))
    assert (late.account.responses == len(late.signals)).all()
    times = late.signals_sent.time
    assert (times[1::2] - times[::2] == 1).all()
    first = late.observations.demand[times[::2].astype(int), 0][10:].mean(axis=0)
    problem = late.problem
    twice = theory.event_mean(first.sum(), problem.increase[:, 0], problem.decrease[:, 0] ** 2)
    once = theory.event_mean(first.sum(), problem.increase[:, 0], problem.decrease[:, 0])
    assert np.abs(first / twice - 1).max() < 0.03 < np.abs(first / once - 1).max()


def test_agents_that_are_alike_stay_alike() -> None:
    run = run_synchronous(classic_aimd([0.01] * 5, 0.5, capacity=5.0), steps=5000, seed=3, lag=0)
    assert len(set(run.demand_at_end[:, 0])) == 1
    assert run.average_at_end.sum() / 5.0 == pytest.approx(0.75, abs=0.01)


def test_it_is_registered_with_defaults() -> None:
    assert named_model("models.classic_aimd") is classic_aimd
    parameters = model_parameters("models.classic_aimd", {"capacity": 2.0}, seed=0)
    assert classic_aimd(**parameters).capacity == [2.0]


def test_wrong_parameters_are_refused_by_name() -> None:
    for wrong, name in (
        ({"increase": [0.0, 1.0]}, r"increase\[0\]"),
        ({"increase": 0.1}, "increase"),
        ({"decrease": 1.0}, "decrease"),
        ({"decrease": [0.5]}, "decrease"),
        ({"capacity": -1.0}, "capacity"),
    ):
        with pytest.raises(InputError, match=name):
            classic_aimd(**wrong)  # type: ignore[arg-type]
