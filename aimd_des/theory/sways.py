r"""What a delay does to agents on the clock: all of them sway together.

Given when signals act, the mean of an agent's demand over its draws obeys

    x <- x + alpha  where none acts,   x <- (1 - kappa) x + p alpha  where one does,

and the total differs from the sum of these means by what the random cuts of all have added up to, of which
the next signals take their part as of all demand.  So no agent's draws are needed.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from aimd_des.theory.prediction import Steady
from aimd_des.theory.setting import Setting
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


def follow_sway(setting: Setting, steady: Steady, lag: int) -> Sway:
    """Follow all agents through the same delays; with the same random numbers at every call."""
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
    off, beyond = np.zeros((2, len(demand)))
    flags = np.zeros((lag + 1, len(demand)), dtype=np.bool_)
    count, once, twice = np.zeros(len(demand)), *np.zeros((2, *demand.shape))
    for step, drawn in enumerate(kicks.reshape(len(kicks), -1)):
        total = demand.sum(axis=1) + off
        flags[step % (lag + 1)] = total > limit
        acts = np.flatnonzero(flags[(step + 1) % (lag + 1)])
        met = demand[acts]
        if step >= _SETTLING:
            count[acts] += 1.0
            once[acts] += met
            twice[acts] += met * met
            beyond[acts] += total[acts] - limit[acts]
        demand += added
        demand[acts] = stays[acts] * met + lost[acts]
        off[acts] = kept[acts] * off[acts] - scatter[acts] * drawn[acts]
    count, once, twice, beyond = (
        rows.reshape(m, _RUNS, -1).sum(axis=1) for rows in (count, once, twice, beyond)
    )
    mean = once / count
    return Sway((beyond / count)[:, 0] / growth.sum(axis=0), (twice / count - mean**2).T)
