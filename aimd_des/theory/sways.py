r"""What a delay does to agents on the clock: all of them sway together.

Given when signals act, the mean of an agent's demand over its draws obeys

    x <- x + alpha  where none acts,   x <- (1 - kappa) x + p alpha  where one does,

and the total differs from the sum of these means by what the random cuts of all have added up to, of which
the next signals take their part as of all demand.  So no agent's draws are needed.

Signals come in bursts then, and how demand answers to kappa is followed beside it.  Its derivative D obeys
D <- (1 - kappa) D - x where a signal acts; a kick of the size x leaves D <- (1 - kappa) D + x.
"""

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.theory.prediction import Steady
from aimd_des.theory.setting import Following, Setting
from aimd_des.theory.totals import cuts
from aimd_des.utils.validation import FloatArray

# So many runs side by side, of so many steps besides those on the way to the steady state.
_RUNS = 12
_STEPS = 1500
_SETTLING = 300


class Sway(NamedTuple):
    """Demand at the signals that act, of agents that sway together."""

    found: FloatArray  # (m,): total above the threshold in the mean, in units of growth
    variance: FloatArray  # (n, m): of the mean of an agent's demand over its draws


class _Step(NamedTuple):
    """What a step finds, a row for each run of each resource."""

    counts: bool  # whether the way to the steady state is over
    acts: npt.NDArray[np.intp]  # rows in which a signal acts
    demand: FloatArray  # (rows, n)
    beyond: FloatArray  # (rows,): total above the threshold


def follow_sway(setting: Setting, steady: Steady, lag: int) -> Sway:
    """Follow all agents through the same delays; with the same random numbers at every call."""
    n, m = setting.problem.increase.shape
    count, beyond, once, twice = *np.zeros((2, _RUNS * m)), *np.zeros((2, _RUNS * m, n))
    for step in _steps(setting, steady, lag):
        if step.counts:
            met = step.demand[step.acts]
            count[step.acts] += 1.0
            once[step.acts] += met
            twice[step.acts] += met * met
            beyond[step.acts] += step.beyond[step.acts]
    count, once, twice, beyond = (_sum_of_runs(rows, m) for rows in (count, once, twice, beyond))
    mean = once / count
    growth = setting.problem.increase.sum(axis=0)
    return Sway((beyond / count)[:, 0] / growth, (twice / count - mean**2).T)


def follow_averages(setting: Setting, steady: Steady, lag: int) -> Following:
    """Follow how averages over time answer to what signals find, by the same steps.

    Notes
    -----
    Growth makes up for cuts, so that a signal finds c / kappa in the mean, and averages with the derivative
    E D by kappa follow at the rate -E D kappa / E y.  Kicks of the size x are added up over all time: with v
    the variance of what they have left of D, and w its covariance with the sum, the variance of the sum grows
    by 2 w + v a step.  It would be (E y / kappa)**2 / e, e being the share of steps with a signal, if signals
    were evenly spread.
    """
    n, m = setting.problem.increase.shape
    kappa = steady.keep * steady.hit
    stays = np.repeat(1.0 - kappa.T, _RUNS, axis=0)
    answer, variance, shared = np.zeros((3, *stays.shape))
    count, once, moved, scattered = np.zeros(_RUNS * m), *np.zeros((3, _RUNS * m, n))
    for step in _steps(setting, steady, lag):
        acts, met = step.acts, step.demand[step.acts]
        if step.counts:
            count[acts] += 1.0
            once[acts] += met
            moved += answer
            scattered += 2.0 * shared + variance
        shared += variance
        shared[acts] *= stays[acts]
        variance[acts] = stays[acts] ** 2 * variance[acts] + met**2
        answer[acts] = stays[acts] * answer[acts] - met
    count, once, moved, scattered = (_sum_of_runs(rows, m).T for rows in (count, once, moved, scattered))
    part, steps = kappa * count / once, _RUNS * _STEPS
    return Following(-part * moved / steps, part * np.sqrt(scattered * count) / steps)


def _sum_of_runs(rows: FloatArray, resources: int) -> FloatArray:
    return np.asarray(rows.reshape(resources, _RUNS, -1).sum(axis=1))


def _steps(setting: Setting, steady: Steady, lag: int) -> Iterator[_Step]:
    """Follow all runs step by step."""
    problem, kappa = setting.problem, steady.keep * steady.hit
    growth = problem.increase
    laws = cuts(steady.found, steady.keep, steady.hit)
    scatter = np.array([law.share * law.variation for law in laws]) * steady.found.sum(axis=0)
    forgotten = np.array([law.share for law in laws])
    rng = np.random.default_rng(0)
    n, m = growth.shape
    start = rng.standard_normal((_RUNS, 1, m))
    kicks = rng.standard_normal((_SETTLING + _STEPS, _RUNS, m)).transpose(0, 2, 1)
    # A row for each run of each resource.
    by_run = partial(np.repeat, repeats=_RUNS, axis=0)
    added, stays, lost = (by_run(columns.T) for columns in (growth, 1.0 - kappa, setting.loss * growth))
    demand = (steady.found * (1.0 + 0.1 * start)).transpose(2, 0, 1).reshape(-1, n)
    limit, scatter, kept = (by_run(row) for row in (problem.limit, scatter, 1.0 - forgotten))
    off = np.zeros(len(demand))
    flags = np.zeros((lag + 1, len(demand)), dtype=np.bool_)
    for step, drawn in enumerate(kicks.reshape(len(kicks), -1)):
        beyond = demand.sum(axis=1) + off - limit
        flags[step % (lag + 1)] = beyond > 0.0
        acts = np.flatnonzero(flags[(step + 1) % (lag + 1)])
        yield _Step(step >= _SETTLING, acts, demand, beyond)
        met = demand[acts]
        demand += added
        demand[acts] = stays[acts] * met + lost[acts]
        off[acts] = kept[acts] * off[acts] - scatter[acts] * drawn[acts]
