r"""What a delay does to agents on the clock: all of them sway together.

Given when signals act, the mean of an agent's demand over its draws obeys

    x <- x + alpha  where none acts,   x <- (1 - kappa) x + p alpha  where one does,

and the total differs from the sum of these means by what the random cuts of all have added up to, of which
the next signals take their part as of all demand.  So no agent's draws are needed.

Nor is every agent: x / alpha is a smooth function of kappa, and linear in p.  So a few kinds of agents are
followed, at Chebyshev points of log kappa and p, and polynomials through them say what all others hold.

Signals come in bursts then, and how demand answers to kappa is followed beside it.  Its derivative D obeys
D <- (1 - kappa) D - x where a signal acts; a kick of the size x leaves D <- (1 - kappa) D + x.
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from aimd_des.theory.prediction import Steady
from aimd_des.theory.setting import Following, Setting
from aimd_des.theory.totals import cuts
from aimd_des.utils.validation import FloatArray

# So many runs side by side, of so many steps besides those on the way to the steady state.
_RUNS = 24
_STEPS = 900
_SETTLING = 300
# Points of log kappa, and of p, in which variances are of the second degree.
_KAPPAS, _LOSSES = 8, 3
# Half of the least distance of points, so that agents may all be of one kind.
_NARROWEST = 1e-2

# Part of the demand that is missing at the start, at most.
_LOWEST = 0.5


class Sway(NamedTuple):
    """Demand at the signals that act, of agents that sway together."""

    found: FloatArray  # (m,): total above the threshold in the mean, in units of growth
    variance: FloatArray  # (n, m): of the mean of an agent's demand over its draws


class _Kinds(NamedTuple):
    """Agents that stand for all others; demand is over the growth in a step."""

    kappa: FloatArray  # (m, 1, q)
    loss: FloatArray  # (m, 1, q)
    shares: FloatArray  # (m, n, q): what agents are made of

    def of_agents(self, values: FloatArray) -> FloatArray:
        """Interpolate from kinds, (m, q), to agents, (n, m)."""
        return np.asarray(np.einsum("jiq,jq->ij", self.shares, values))


class _Runs(NamedTuple):
    """What steps find in the runs of each resource, those on the way to the steady state included."""

    acts: FloatArray  # (steps, m, runs, 1): 1 where a signal acts
    demand: FloatArray  # (steps, m, runs, q)
    beyond: FloatArray  # (steps, m, runs, 1): total above the threshold


def follow_sway(setting: Setting, steady: Steady, lag: int) -> Sway:
    """Follow all agents through the same delays; with the same random numbers at every call."""
    kinds = _kinds(setting, steady)
    acts, demand, beyond = (part[_SETTLING:] for part in _runs(setting, steady, lag, kinds))
    met, over = acts * demand, (0, 2)
    count = acts.sum(axis=over)
    variance = (met * demand).sum(axis=over) / count - (met.sum(axis=over) / count) ** 2
    growth = setting.problem.increase
    above = ((acts * beyond).sum(axis=over) / count)[:, 0] / growth.sum(axis=0)
    return Sway(above, growth**2 * kinds.of_agents(variance))


def follow_averages(setting: Setting, steady: Steady, lag: int) -> Following:
    """Follow how averages over time answer to what signals find, by the same steps.

    Notes
    -----
    Growth makes up for cuts, so that a signal finds c / kappa in the mean, and averages with the
    derivative E D by kappa follow at the rate -E D kappa / E y.  Kicks of the size x are added up over
    all time. With v the variance of what they have left of D, and w its covariance with the sum, the
    variance of the sum grows by 2 w + v a step.  It would be (E y / kappa)**2 / e, e being the share of
    steps with a signal, if signals were evenly spread.
    """
    kinds = _kinds(setting, steady)
    acts, demand, _ = _runs(setting, steady, lag, kinds)
    met, stays = acts * demand, 1.0 - acts * kinds.kappa
    answer, variance, shared, moved, scattered = np.zeros((5, *demand.shape[1:]))
    for step, (lost, held, stay) in enumerate(zip(met, met * demand, stays, strict=True)):
        if step >= _SETTLING:
            moved += answer
            scattered += 2.0 * shared + variance
        shared = stay * (shared + variance)
        variance = stay * stay * variance + held
        answer = stay * answer - lost
    count, once = (part[_SETTLING:].sum(axis=(0, 2)) for part in (acts, met))
    part, steps = kinds.kappa[:, 0] * count / once, _RUNS * _STEPS
    mean, noise = -part * moved.sum(axis=1), part * np.sqrt(scattered.sum(axis=1) * count)
    return Following(kinds.of_agents(mean / steps), kinds.of_agents(noise / steps))


def follow_sums(setting: Setting, steady: Steady, lag: int) -> FloatArray:
    """Follow sums of deviations of demand from its mean, in as many parts as kinds of agents: (r, n, m)."""
    kinds = _kinds(setting, steady)
    demand = _runs(setting, steady, lag, kinds).demand[_SETTLING:]
    sums = np.cumsum(demand - demand.mean(axis=0), axis=0)
    off = sums - sums.mean(axis=0)
    square = np.einsum("smrp,smrq->mpq", off, off) / (len(off) * _RUNS)
    values, vectors = np.linalg.eigh(square)
    parts = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return np.asarray(setting.problem.increase * np.einsum("jiq,jqr->rij", kinds.shares, parts))


def _kinds(setting: Setting, steady: Steady) -> _Kinds:
    """Choose the kinds of agents that are followed for each resource."""
    loss = setting.loss[:, 0]
    # Where all lose as much one kind will do.
    losses, by_loss = _points(loss, _LOSSES if np.ptp(loss) > 0.0 else 1)
    columns = [_points(np.log(kappa), _KAPPAS) for kappa in (steady.keep * steady.hit).T]
    return _Kinds(
        np.stack([np.repeat(np.exp(points), len(losses)) for points, _ in columns])[:, None],
        np.tile(losses, (len(columns), 1, _KAPPAS)),
        np.stack([(by[:, :, None] * by_loss[:, None, :]).reshape(len(loss), -1) for _, by in columns]),
    )


def _points(values: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Choose points among values, (q,), and say how polynomials through them make up the values, (n, q)."""
    middle, half = 0.5 * (values.max() + values.min()), 0.5 * np.ptp(values) + _NARROWEST
    points = chebyshev.chebpts1(count)
    back = np.linalg.inv(chebyshev.chebvander(points, count - 1))
    return middle + half * points, chebyshev.chebvander((values - middle) / half, count - 1) @ back


def _runs(setting: Setting, steady: Steady, lag: int, kinds: _Kinds) -> _Runs:
    """Follow all runs step by step."""
    growth = setting.problem.increase.T  # (m, n)
    laws = cuts(steady.found, steady.keep, steady.hit)
    scatters = np.array([law.share * law.variation for law in laws]) * steady.found.sum(axis=0)
    # All further arrays broadcast to (m, runs, q).
    scatter, limit = scatters[:, None, None], setting.problem.limit[:, None, None]
    forgotten = np.array([law.share for law in laws])[:, None, None]
    weights = np.einsum("ji,jiq->jq", growth, kinds.shares)[:, :, None]
    rng = np.random.default_rng(0)
    # Runs begin below the threshold, so that bursts come at different times in them.
    cycle = 2.0 * (lag + 1) / steady.signals * growth.sum(axis=1) / steady.found.sum(axis=0)
    below = np.minimum(cycle, _LOWEST)[:, None, None] * rng.random((len(growth), _RUNS, 1))
    kicks = scatter * rng.standard_normal((_SETTLING + _STEPS, len(growth), _RUNS, 1))
    balance = 1.0 / steady.signals[:, None, None] - 1.0 + kinds.loss
    demand = balance / kinds.kappa * (1.0 - below)
    less = 1.0 - kinds.loss
    off = np.zeros((len(growth), _RUNS, 1))
    signals, beyond = np.zeros((2, lag + len(kicks), *off.shape))
    demands = np.empty((len(kicks), *demand.shape))
    for step, drawn in enumerate(kicks):
        demands[step] = demand
        beyond[step] = demand @ weights + off - limit
        signals[step + lag] = beyond[step] > 0.0
        acts = signals[step]
        demand = demand + 1.0 - acts * (kinds.kappa * demand + less)
        off = off - acts * (forgotten * off + drawn)
    return _Runs(signals[: len(kicks)], demands, beyond[: len(kicks)])
