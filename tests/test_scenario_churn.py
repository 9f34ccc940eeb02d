"""Cameras that come and go: seeds 0 to 5, and 0 to 15 for a group, against theory that does not know them."""

from functools import partial

import numpy as np
import pytest

from aimd_des.interventions import Absence, Crash, Join
from aimd_des.study import mean_and_error, replicate
from scenarios.churn.runs import (
    ALPHA,
    CRITICAL_STAY,
    FORGOT,
    GROUP,
    KEPT,
    N,
    Seen,
    Size,
    fluid,
    kinds,
    leave_together,
    measure,
    optimum,
    schedule,
    steady,
)

SIZE = Size((80.0, np.inf), 6, 150.0, 400.0, 16, 150.0, 200.0, 300.0, 10.0)
# By Student's t with 5 degrees of freedom, beyond once in 500 means.
Z = 6.0
# With 15, once in 900.
Z_GROUP = 4.0
# Theory is up to 1.6 points of use off under churn in the full study: it may be 2 here.
NEGLECTED = 0.02


@pytest.fixture(scope="module")
def runs() -> dict[float, list[Seen]]:
    jobs = [partial(measure, KEPT, stay, SIZE) for stay in SIZE.stays]
    return dict(zip(SIZE.stays, replicate(jobs, SIZE.replications, 0, workers=1), strict=True))


@pytest.mark.slow
def test_use_and_signals_under_churn_are_as_in_a_queue(runs: dict[float, list[Seen]]) -> None:
    for stay, found in runs.items():
        use, error = mean_and_error([seen.utilisation for seen in found])
        assert abs(use - steady(stay).utilisation) < Z * error + NEGLECTED
    # Cameras that leave do what signals else would: paired with the same seeds without churn.
    fewer = [still.signals - seen.signals for still, seen in zip(runs[np.inf], runs[80.0], strict=True)]
    mean, error = mean_and_error(fewer)
    assert abs(mean - (steady(np.inf).signals - steady(80.0).signals)) < Z * error
    assert mean > 0.05  # negative control: not as many as before


@pytest.mark.slow
def test_who_has_forgotten_takes_more_than_a_share_and_the_others_less() -> None:
    jobs = [partial(leave_together, name, SIZE) for name in FORGOT]
    kept, forgotten = replicate(jobs, SIZE.groups, 0, workers=1)
    since = SIZE.times - SIZE.back
    window = (since >= 50.0) & (since <= 100.0)
    _, steep, stayed = kinds().values()
    for agents, sign in ((steep, 1.0), (stayed, -1.0)):
        share = optimum()[agents].sum()
        held = [
            [run.demand[window][:, agents].sum(axis=1).mean() / share for run in part]
            for part in (kept, forgotten)
        ]
        mean, error = mean_and_error(np.subtract(held[1], held[0]))  # paired
        flow = [fluid(name, SIZE)[0][window][:, agents].sum(axis=1).mean() / share for name in FORGOT]
        assert abs(mean - (flow[1] - flow[0])) < Z_GROUP * error
        assert sign * mean > Z_GROUP * error  # negative control: averages do matter
    for one, other in zip(kept, forgotten, strict=True):
        assert one.again == other.again  # nobody has come back yet
    mean, error = mean_and_error([run.again - run.released for run in kept])
    assert abs(mean) < Z_GROUP * error + 1.0  # a signal that is on its way takes something besides


def test_the_schedule_has_addresses_and_is_that_of_the_long_run() -> None:
    slow, fast = (schedule(stay, 400.0, Crash, seed=3) for stay in (100.0, 50.0))
    first = {change.agents: change for change in slow if isinstance(change, Join)}
    for change in fast:
        if isinstance(change, Join) and change.agents in first:
            assert first[change.agents].at == pytest.approx(2.0 * change.at)
    assert {change.agents for change in fast if isinstance(change, Join)} == set(first)
    away = np.zeros(2000)
    grid = np.linspace(0.0, 400.0, 2000)
    for change in schedule(50.0, 400.0, Absence, seed=4):
        begin, end = (0.0, change.at) if isinstance(change, Join) else (change.at, change.until)
        away += (grid >= begin) & (grid < end)
    # A third of 60; their number forgets within 17 periods, so that the mean has an error of 1.1.
    assert abs(away.mean() - N / 3) < 5.0
    assert schedule(np.inf, 400.0, Absence, seed=4)[0].at == 0.0


def test_the_steady_state_at_its_ends() -> None:
    assert steady(CRITICAL_STAY / 4).utilisation == pytest.approx(0.25, rel=0.02)  # all that they can grow to
    assert steady(1e6).utilisation == pytest.approx(steady(np.inf).utilisation, abs=1e-4)
    assert steady(CRITICAL_STAY / 4).share == pytest.approx(np.full(N, ALPHA * CRITICAL_STAY / 4), rel=0.02)
    assert len(GROUP) == 15
