r"""What a run will come to, from the problem alone: the closed forms, made consistent with each other.

How much of the capacity is used depends on the derivative mu at the averages, which depends on how much is
used.  `predict` iterates the two, and takes the balance of growth and cuts to the next order:

- a signal finds agent i with y_i = x_i + h_i, h_i = alpha_i / (2 rho), half a saw tooth above its average;
- so all cuts of a signal, sum_i kappa_i (x_i + h_i) with kappa_i = (1 - p_i) (1 - beta_i) lambda_i, make up
  for all growth since the last one, which is linear in rho or, on the clock, in the share e;
- teeth of D in the mean are random, and their variance V = sum_i (1 - beta_i)^2 q_i (1 - q_i) E y_i^2 with
  q_i = (1 - p_i) lambda_i costs V / (2 D) of the capacity more; E y^2 = (E y)^2 (2 - kappa) / (1 + beta).

Where a hold-off is given, what is used is the mean of the total alone (`aimd_des.theory.totals`) instead.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aimd_des.checks import FloatArray
from aimd_des.errors import InputError, SimulationError
from aimd_des.optimum import Optimum, solve_optimum
from aimd_des.problem import Problem
from aimd_des.theory.allocations import reweighted_optimum
from aimd_des.theory.arguments import Dynamics
from aimd_des.theory.setting import Setting, check_setting
from aimd_des.theory.signals import clock_offset
from aimd_des.theory.totals import Levels, cuts, walk_by_crossings, walk_by_looks

__all__ = ["Prediction", "follow", "predict", "settle"]

_TOLERANCE = 1e-9
_MAX_ROUNDS = 500
# Less used makes mu smaller and so lets more be used: half a step damps what would swing.
_DAMPING = 0.5
# The total alone is followed anew until its mean has settled to this share of the capacity, or so often.
_ENOUGH = 1e-4
_MAX_WALKS = 8


@dataclass(frozen=True, eq=False)
class Prediction:
    """What theory expects of a run.

    Attributes
    ----------
    signals : ndarray, shape (m,)
        Broadcasts per unit of time, or per step on the discrete clock.
    utilisation : ndarray, shape (m,)
        Sum of the averages over the capacity.
    allocation : ndarray, shape (n, m)
        Averages, in units of the resources.
    probability : ndarray, shape (n, m)
        Response probabilities at these averages, cut off at 1.
    """

    signals: FloatArray
    utilisation: FloatArray
    allocation: FloatArray
    probability: FloatArray


def predict(
    problem: Problem,
    dynamics: Dynamics = "discrete",
    *,
    latency: float = 0.0,
    period: float = 0.0,
    loss: npt.ArrayLike = 0.0,
    refractory: float | None = None,
) -> Prediction:
    """Predict signals, utilisation and averages of a long run.

    Parameters
    ----------
    problem : Problem
        What is shared; alpha and beta may differ from agent to agent.
    dynamics : {"discrete", "continuous"}
        Agents that act at ticks of one common clock of period 1, or agents that grow all the time.
    latency : float
        d >= 0, common to all agents.  On the clock it counts in whole steps, rounded up: 0 is ``lag=0`` of
        `run_discrete`, anything up to 1 its ``lag=1``.
    period : float
        Time between two looks of a control unit that samples, for continuous agents; 0 for one that
        senses the exact crossing, whose hold-off must then be at least `latency` unless it is given.
    loss : float or array_like, shape (n,)
        Probability that a signal is lost on an agent, independent of all else.
    refractory : float, optional
        Hold-off of a control unit that senses crossings, for continuous agents; shorter than the latency
        if you like, but not 0 then.  Signals that repeat are taken into account if it is given.

    Returns
    -------
    Prediction
        Signals, utilisation, averages and response probabilities.

    Raises
    ------
    InputError
        If an argument is outside its range; if more signals are necessary than there can be (the loss
        is beyond the critical one, or the period or hold-off too long); or if weights would differ from
        resource to resource for costs other than `PolynomialCosts`.
    SimulationError
        If the iteration does not come to rest.

    Notes
    -----
    Neglects how cuts of an agent and of the others go together, which is of the order 1 / n, what the long
    way to the averages costs, and, unless it is given, the hold-off of a control unit that senses crossings:
    it must hold rho * refractory < 1, and the nearer it comes to 1 the more often total demand stays above
    the capacity for a while.  Averages are the optimum for what is used, of costs weighted by what loss and
    differing alpha and beta make of them: the half saw tooth is left out of the shares.

    Examples
    --------
    >>> from aimd_des import PolynomialCosts, Resource
    >>> memory = Resource("memory", capacity=20.0, increase=0.02, decrease=0.5, normalization=0.1)
    >>> problem = Problem([memory], PolynomialCosts([2], [[[1.0]]] * 20))
    >>> expected = predict(problem, latency=1)
    >>> bool(0.17 < expected.signals[0] < 0.18), bool(0.92 < expected.utilisation[0] < 0.94)
    (True, True)
    """
    setting = check_setting(
        problem, dynamics, latency=latency, period=period, loss=loss, refractory=refractory
    )
    expected = settle(setting)
    if setting.refractory is None:
        return expected
    for _ in range(_MAX_WALKS):
        setting = setting._replace(offset=np.array([walk.mean for walk in follow(setting, expected)]))
        before, expected = expected, settle(setting)
        if (np.abs(expected.utilisation - before.utilisation) <= _ENOUGH).all():
            break
    return expected


def follow(setting: Setting, expected: Prediction) -> list[Levels]:
    """Follow the total alone, with the cuts that the prediction makes of the agents.

    Parameters
    ----------
    setting : Setting
        Of the run.
    expected : Prediction
        What is known of it.

    Returns
    -------
    list of Levels
        One for each resource.
    """
    problem = setting.problem
    teeth = _teeth(setting, expected.signals)
    law = cuts(problem, expected.allocation, expected.probability, teeth, setting.loss)
    growth = problem.increase.sum(axis=0)
    lost = ((setting.loss * problem.increase).sum(axis=0) / growth).tolist()
    walks = []
    for j, limit in enumerate((problem.limit / growth).tolist()):
        if setting.discrete:
            walks.append(walk_by_looks(limit, law[j], 1.0, setting.latency, lost[j]))
        elif setting.refractory is None:
            walks.append(walk_by_looks(limit, law[j], setting.period, setting.latency))
        else:
            walks.append(walk_by_crossings(limit, law[j], setting.refractory, setting.latency))
    return walks


def settle(setting: Setting) -> Prediction:
    """Let signals and use of the capacity settle on each other.

    Parameters
    ----------
    setting : Setting
        Of the run.

    Returns
    -------
    Prediction
        As of `predict`.

    Raises
    ------
    InputError
        If more signals are necessary than there can be.
    SimulationError
        If they do not settle.
    """
    problem = setting.problem
    signals, used = np.zeros(problem.n_resources), np.array(problem.limit)
    for _ in range(_MAX_ROUNDS):
        allocation = _settled(setting, signals, used).allocation
        gradient = problem.costs.gradient(allocation)
        probability = np.minimum(problem.normalization * gradient / allocation, 1.0)
        new_signals = _signals(setting, allocation, probability)
        new_used = _used(setting, allocation, probability, new_signals)
        moved = np.maximum(np.abs(new_used / used - 1.0), np.abs(signals / new_signals - 1.0))
        signals, used = new_signals, used + _DAMPING * (new_used - used)
        if (used <= 0.0).any():
            break
        if (moved <= _TOLERANCE).all():
            _check_enough(setting, signals)
            return Prediction(signals, used / problem.capacity, allocation, probability)
    raise SimulationError(
        f"no prediction: utilisation does not settle, last {(used / problem.capacity).tolist()}; one signal"
        " takes too large a part of the capacity, so make Gamma or 1 - beta smaller"
    )


def _settled(setting: Setting, signals: FloatArray, used: FloatArray) -> Optimum:
    """Find the averages that agents tend to when `signals` are sent and `used` is what they hold together."""
    problem = setting.problem
    # An agent without loss never grows where every step has a signal: on the way there may be such rounds.
    silent = np.minimum(signals, 1.0 - _TOLERANCE) * (1.0 - setting.loss) if setting.discrete else 0.0
    weights = (1.0 - setting.loss) * (1.0 - problem.decrease) / (problem.increase * (1.0 - silent))
    weights = weights / weights[0]  # exactly 1 where agents are alike
    if (weights == 1.0).all():
        return solve_optimum(problem, capacity=used)
    # Where resources differ in alpha alone, rounding may leave a last digit between their weights.
    if (np.abs(weights - weights[:, :1]) <= 1e-12 * weights[:, :1]).all():
        weights = weights[:, 0]
    return reweighted_optimum(problem, weights, capacity=used)


def _signals(setting: Setting, allocation: FloatArray, probability: FloatArray) -> FloatArray:
    """Balance growth and cuts of all agents: signals per unit of time, or the share of steps with one."""
    alpha = setting.problem.increase
    kappa = (1.0 - setting.loss) * (1.0 - setting.problem.decrease) * probability
    growth = (alpha * (1.0 - 0.5 * kappa)).sum(axis=0)
    cuts = (kappa * allocation).sum(axis=0)
    if not setting.discrete:
        return np.asarray(growth / cuts)
    # Agents on which a signal is lost grow in that step; where nothing is left of the cuts, no share will do.
    net = cuts + growth - (setting.loss * alpha).sum(axis=0)
    return np.asarray(growth / np.maximum(net, growth))


def _used(
    setting: Setting, allocation: FloatArray, probability: FloatArray, signals: FloatArray
) -> FloatArray:
    """Compute the mean of total demand, (m,), in units of the resources."""
    problem = setting.problem
    growth = problem.increase.sum(axis=0)
    if setting.offset is not None:
        return np.asarray(problem.limit + growth * setting.offset)
    if setting.discrete:
        mean = growth * clock_offset(np.clip(signals, _TOLERANCE, 1.0), int(np.ceil(setting.latency)))
    elif setting.period > 0.0:
        mean = growth * _sampled_offset(setting, signals)
    else:
        mean = growth * (setting.latency - 0.5 / signals)
    teeth = _teeth(setting, signals)
    law = cuts(problem, allocation, probability, teeth, setting.loss)
    deviation = np.array([one.variation * one.share for one in law]) * (allocation + teeth).sum(axis=0)
    return np.asarray(problem.limit + mean - 0.5 * deviation**2 * signals / growth)


def _teeth(setting: Setting, signals: FloatArray) -> FloatArray:
    """Compute how much more than its average a signal finds with an agent: half a saw tooth, (n, m)."""
    steps = 1.0 - signals if setting.discrete else 1.0  # on the clock those in which it grows
    return np.asarray(0.5 * setting.problem.increase * steps / signals)


def _sampled_offset(setting: Setting, signals: FloatArray) -> FloatArray:
    """Compute the mean offset of continuous agents from the threshold, in units of growth per unit of time.

    Seen at the looks they are on a clock, with cuts that are smaller by the growth of the same
    period; between the looks they have grown half a period, and are cut only after the latency.
    """
    look = setting.period
    lag = max(int(np.ceil(setting.latency / look)) - 1, 0)
    share = np.clip(signals * look, _TOLERANCE, 1.0)
    return np.asarray(look * (clock_offset(share, lag) + setting.latency / look - lag - 0.5))


def _check_enough(setting: Setting, signals: FloatArray) -> None:
    """Refuse what would need more signals than there can be."""
    least = 1.0 if setting.discrete else max(setting.period, setting.refractory or 0.0)
    if (signals * least >= 1.0).any():
        name, value = ("loss", setting.loss.max()) if setting.loss.any() else ("period", setting.period)
        if setting.refractory is not None:
            name, value = "refractory", setting.refractory
        raise InputError.of(
            name,
            float(value),
            "small enough for one signal at every look to suffice",
            "demand runs away from the capacity: see critical_loss and runaway_multiplier",
        )
