r"""What a run will come to, from the problem alone: the closed forms, made consistent with each other.

How much of the capacity is used depends on the derivative mu at the averages, which depends on how much is
used.  `predict` iterates the two.  In the balance of growth and cuts

- a signal finds agent i with y_i, and takes kappa_i y_i of it in the mean, kappa_i = (1 - p_i) (1 - beta_i)
  lambda_i, which is what the agent has added since the last one: rho kappa_i y_i = alpha_i;
- all y_i add up to what signals find in all, the threshold if the crossing is the signal, and rho follows;
- averages are below the y_i by half the height of the sawtooth, h_i = alpha_i / (2 rho) (1 + V / D^2), for
  sawtooths of mean height D with the variance V = sum_i (1 - beta_i)^2 q_i (1 - q_i) E y_i^2, q_i = (1 - p_i)
  lambda_i.

For few agents the last is replaced by exact moments (`aimd_des.theory.moments`).  Where the control unit
samples, or holds off, the total alone is followed (`aimd_des.theory.totals`), for what signals find in all
and for its mean over time, and moments are those of exact crossings at these signals.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.dynamics.demand import Dynamics
from aimd_des.dynamics.responses import Response
from aimd_des.problem.optimum import solve_optimum
from aimd_des.problem.problem import Problem
from aimd_des.theory.moments import averages_between, averages_on_the_clock, moments_at_signals
from aimd_des.theory.response_rule import chance, cuts_of
from aimd_des.theory.setting import Setting, check_setting
from aimd_des.theory.totals import Levels, cuts, walk_by_crossings, walk_by_looks
from aimd_des.utils.errors import InputError, SimulationError
from aimd_des.utils.old_keywords import keywords
from aimd_des.utils.validation import FloatArray

_TOLERANCE = 1e-9
# Agents whose marginal cost hardly rises move slowly: some systems take 1,500 rounds.
_MAX_ROUNDS = 5_000
# Rounds from one look at the exact moments to the next.
_BETWEEN = 6
# The total alone is followed anew until its mean has settled to this share of the capacity, or so often.
_ENOUGH = 3e-4
_MAX_WALKS = 12
# What needs signals at more of the looks has run away: demand comes to rest where all of them have one.
_NEARLY_ALL = 0.99


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
        Response probabilities at these averages, cut off at 1; of `responses.Derandomised` the parts of
        1 - beta that a signal takes.
    """

    signals: FloatArray
    utilisation: FloatArray
    allocation: FloatArray
    probability: FloatArray


class Steady(NamedTuple):
    """The balance of growth and cuts."""

    signals: FloatArray  # (m,): per unit of time, or per step
    # (n, m): demand in the mean over time; its square, and itself, in the mean over the signals that act.
    average: FloatArray
    square: FloatArray
    found: FloatArray
    part: FloatArray  # (n, m): part of 1 - beta that a received signal takes of the demand in the mean
    # (n, m): size of a cut, and with what probability a signal that is sent makes one.
    keep: FloatArray
    hit: FloatArray


@keywords("refractory")
def predict(
    problem: Problem,
    dynamics: Dynamics = "discrete",
    *,
    latency: float = 0.0,
    period: float = 0.0,
    loss: npt.ArrayLike = 0.0,
    hold_off: float | None = None,
    response: Response | None = None,
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
        `run_synchronous`, anything up to 1 its ``lag=1``.
    period : float
        Time between two samples of a control unit that samples, for continuous agents; 0 for one that
        senses the exact crossing, whose hold-off must then be at least `latency` unless it is given.
    loss : float or array_like, shape (n,)
        Probability that a signal is lost on an agent, independent of all else.
    hold_off : float, optional
        Hold-off of a control unit that senses crossings, for continuous agents; shorter than the latency
        if you like, but not 0 then.  Signals that repeat are taken into account if it is given.
    response : Response, optional
        How agents answer signals; default: `responses.Randomised`, the paper's rule.

    Returns
    -------
    Prediction
        Signals, utilisation, averages and response probabilities.

    Raises
    ------
    InputError
        If an argument is outside its range, or if more signals are necessary than there can be (the loss
        is beyond the critical one, or the period or hold-off too long).
    SimulationError
        If the iteration does not come to rest.

    Notes
    -----
    Exact for exact crossings and up to 200 agents, with three exceptions: averages take long to settle,
    response probabilities wander with them, and a hold-off counts only if it is given. Without it ``rho *
    hold_off`` must be below 1; the nearer it comes to 1, the more often total demand stays above the
    capacity for a while. With more agents the correlation between the cuts of an agent and of the others
    is neglected: the order 1 / n.

    For sampling, and where a hold-off is given, the total is followed as a walk, which takes tenths of a
    second.  It knows of agents only what they take together, so with less than ten of them it is rough.

    Not covered are control units that draw whether they signal (`EarlyDetection`): they signal below the
    threshold, at a level that depends on how demand spreads around it, and here signals come where it is
    passed.

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
        problem, dynamics, latency=latency, period=period, loss=loss, hold_off=hold_off, response=response
    )
    expected = steady_state(setting)
    used = expected.average.sum(axis=0) / problem.capacity
    return Prediction(expected.signals, used, expected.average, expected.part)


def steady_state(setting: Setting) -> Steady:
    """Let signals, use of the capacity and the walk of the total settle on each other."""
    expected = settle(setting)
    for _ in range(0 if setting.crossing else _MAX_WALKS):
        setting = walked(setting, follow(setting, expected))
        before, expected = expected, settle(setting, expected.average)
        moved = (expected.average - before.average).sum(axis=0) / setting.problem.capacity
        if (np.abs(moved) <= _ENOUGH).all():
            break
    check_enough(setting, expected.signals)
    return expected


def walked(setting: Setting, walks: list[Levels]) -> Setting:
    """Take in where the total was."""
    mean, found = np.array([(walk.mean, walk.found) for walk in walks]).T
    return setting._replace(mean=mean, found=found)


def follow(setting: Setting, expected: Steady) -> list[Levels]:
    """Follow the total alone, with the cuts of the agents in their steady state."""
    problem = setting.problem
    law = cuts(expected.found, expected.keep, expected.hit)
    growth = problem.increase.sum(axis=0)
    lost = ((setting.loss * problem.increase).sum(axis=0) / growth).tolist()
    walks = []
    for j, limit in enumerate((problem.limit / growth).tolist()):
        if setting.discrete:
            walks.append(walk_by_looks(limit, law[j], 1.0, setting.latency, lost[j]))
        elif setting.hold_off is None:
            walks.append(walk_by_looks(limit, law[j], setting.period, setting.latency))
        else:
            walks.append(walk_by_crossings(limit, law[j], setting.hold_off, setting.latency))
    return walks


def check_enough(setting: Setting, signals: FloatArray) -> None:
    """Refuse what would need more signals than there can be."""
    if setting.discrete and not setting.loss.any():
        return  # on the clock no agent grows in a step whose signal arrives, so that there are always enough
    least = 1.0 if setting.discrete else max(setting.period, setting.hold_off or 0.0)
    if (signals * least >= _NEARLY_ALL).any():
        name, value = ("loss", setting.loss.max()) if setting.loss.any() else ("period", setting.period)
        if setting.hold_off is not None:
            name, value = "hold_off", setting.hold_off
        raise InputError.of(
            name,
            float(value),
            "small enough for one signal at every look to suffice",
            "demand runs away from the capacity: see critical_loss and runaway_multiplier",
        )


def settle(setting: Setting, start: FloatArray | None = None) -> Steady:
    """Let signals and use of the capacity settle on each other."""
    problem = setting.problem
    average = solve_optimum(problem, capacity=problem.limit).allocation if start is None else start
    tooth = more = np.zeros_like(average)
    for moves in range(_MAX_ROUNDS):
        gradient = problem.costs.gradient(average)
        balance, sways = _balance(setting, chance(problem, setting.response, average, tooth))
        wanted = balance.average + more
        rests = (np.abs(wanted - average) <= _TOLERANCE * average).all()
        if rests and not setting.exact:
            return balance
        # Exact moments take long, and differ from the first order by what hardly changes.
        if setting.exact and (rests or moves % _BETWEEN == _BETWEEN - 1):
            exact = _exact(setting, balance, sways)
            if rests and (np.abs(exact.average - wanted) <= _TOLERANCE * average).all():
                return exact
            wanted, more = exact.average, exact.average - balance.average
        # The steeper the costs the more agents answer to their own averages: a whole step would swing.
        curvature = np.abs(problem.costs.hessian(average) * average[:, None, :]).sum(axis=2)
        steepness = np.where(balance.part < 1.0, np.maximum(curvature / gradient, 1.0), 1.0)
        average = average * np.clip(wanted / average, 0.5, 2.0) ** (1.0 / steepness)
        tooth = balance.found - wanted
    used = average.sum(axis=0) / problem.capacity
    raise SimulationError(
        f"no prediction: utilisation does not settle, last {used.tolist()}; one signal takes too large a part"
        " of the capacity, so make Gamma or 1 - beta smaller"
    )


def found_by_signals(setting: Setting, kappa: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Balance growth and cuts: signals as in `Steady`, (m,), and what they find with agents, (n, m)."""
    problem = setting.problem
    total = problem.limit + problem.increase.sum(axis=0) * setting.found
    per_growth = problem.increase / kappa
    if not setting.discrete:
        growth = total / per_growth.sum(axis=0)
        return 1.0 / growth, growth * per_growth
    # An agent that loses a signal grows in its step; where no cuts are left then, no share will do.
    growth = np.maximum(total - (setting.loss * per_growth).sum(axis=0), 0.0) / per_growth.sum(axis=0)
    return 1.0 / (1.0 + growth), (growth + setting.loss) * per_growth


def _balance(setting: Setting, part: FloatArray) -> tuple[Steady, FloatArray | float]:
    """Compute the steady state for signals that always take the same part; with what swaying adds to it."""
    problem = setting.problem
    keep, hit = cuts_of(problem, setting.response, part, setting.loss)
    signals, found = found_by_signals(setting, keep * hit)
    square = found**2 * (2.0 - keep * hit) / (2.0 - keep)
    square += lost_steps(setting, keep * hit, found) / (keep * hit * (2.0 - keep))
    if setting.sway is not None:
        columns = problem.increase, keep, hit, found, square + setting.sway, signals, setting.loss
        return Steady(signals, averages_on_the_clock(*columns), square, found, part, keep, hit), 0.0
    tooth = _half_height(setting, signals, found, keep, hit)
    sways = _swayed(setting, tooth, found)
    average = found - problem.increase * tooth + sways
    return Steady(signals, average, square, found, part, keep, hit), sways


def _half_height(
    setting: Setting, signals: FloatArray, found: FloatArray, keep: FloatArray, hit: FloatArray
) -> FloatArray:
    """Compute half the height of the sawtooth in units of growth, (m,), were it the same for all agents."""
    spread = np.array([law.variation for law in cuts(found, keep, hit)])
    if setting.discrete:  # it stays where it is in the step of a signal
        return np.asarray(0.5 * (1.0 / signals - 1.0) * (1.0 + spread**2 * (1.0 - signals)))
    return np.asarray(0.5 / signals * (1.0 + spread**2))


def _swayed(setting: Setting, tooth: FloatArray, found: FloatArray) -> FloatArray | float:
    """Compute what is added to averages, (n, m), where the total sways: signals come late or are held off."""
    if setting.mean is None:
        return 0.0
    # All agents sway by as much as they grow (theory.md, Delay).
    increase = setting.problem.increase
    share = increase**2 / found
    sway = increase.sum(axis=0) * (tooth - setting.found + setting.mean)
    return np.asarray(sway * share / share.sum(axis=0))


def lost_steps(setting: Setting, kappa: FloatArray, found: FloatArray) -> FloatArray:
    """Compute the variance, (n, m), that comes on the clock from growth in the step of a lost signal."""
    if not setting.discrete:
        return np.zeros_like(found)
    growth, loss = setting.problem.increase, setting.loss
    return np.asarray(loss * growth * (growth * (1.0 - loss) + 2.0 * kappa * found))


def _exact(setting: Setting, balance: Steady, sways: FloatArray | float) -> Steady:
    """Take averages and mean squares of what signals find from exact moments."""
    signals, found, keep, hit = balance.signals, balance.found, balance.keep, balance.hit
    average, square = np.empty((2, *found.shape))
    more = lost_steps(setting, keep * hit, found)
    for j, growth in enumerate(setting.problem.increase.T):
        column = growth, keep[:, j], hit[:, j], found[:, j]
        moments = moments_at_signals(*column, more[:, j])
        square[:, j] = found[:, j] ** 2 + np.diag(moments.covariance)
        if setting.sway is None:
            average[:, j] = averages_between(*column, moments)
        else:
            met = square[:, j] + setting.sway[:, j]
            average[:, j] = averages_on_the_clock(*column, met, signals[j], setting.loss[:, 0])
    return balance._replace(average=average + sways, square=square)
