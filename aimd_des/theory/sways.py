r"""What a delay does to agents on the clock: all of them sway together.

Given when signals act, the mean of an agent's demand over its draws obeys

    x <- x + alpha  where none acts,   x <- (1 - kappa) x + p alpha  where one does,

and the total differs from the sum of these means by what the random cuts of all have added up to, of which
the next signals take their part as of all demand.  So no agent's draws are needed.
"""

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
    growth, limit = problem.increase, problem.limit
    laws = cuts(steady.found, steady.keep, steady.hit)
    scatter = np.array([law.share * law.variation for law in laws]) * steady.found.sum(axis=0)
    forgotten = np.array([law.share for law in laws])
    rng = np.random.default_rng(0)
    demand = steady.found * (1.0 + 0.1 * rng.standard_normal((_RUNS, 1, problem.n_resources)))
    off = np.zeros((_RUNS, problem.n_resources))
    flags = np.zeros((lag + 1, *off.shape), dtype=np.bool_)
    count, once, twice = np.zeros(problem.n_resources), *np.zeros((2, *growth.shape))
    beyond = np.zeros(problem.n_resources)
    for step in range(_SETTLING + _STEPS):
        total = demand.sum(axis=1) + off
        flags[step % (lag + 1)] = total > limit
        acts = flags[(step + 1) % (lag + 1)]
        kicks = rng.standard_normal(off.shape)
        if step >= _SETTLING:
            count += acts.sum(axis=0)
            met = np.where(acts[:, None, :], demand, 0.0)
            once += met.sum(axis=0)
            twice += (met * met).sum(axis=0)
            beyond += np.where(acts, total - limit, 0.0).sum(axis=0)
        demand = demand + np.where(acts[:, None, :], setting.loss * growth - kappa * demand, growth)
        off = off - np.where(acts, forgotten * off + scatter * kicks, 0.0)
    mean = once / count
    return Sway(beyond / count / growth.sum(axis=0), twice / count - mean**2)
