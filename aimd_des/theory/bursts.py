r"""Losses that are not independent: bursts, on links of their own or all together, and what agents believe.

**Bursts.** A signal that agent i hears finds it with E[x_i | good] = x_i - p alpha_i B, exactly, if signals
come evenly: B is the mean length of a burst, and x_i the average.  So the balance is that of costs with the
derivative f_i'(x) (1 - p alpha_i B / x): where costs are quadratic, each agent gets p alpha_i B, and a share
of the rest.

**Bursts in common.** Total demand y grows at u = n alpha in a burst, of mean length B = 1 / b; else each
signal, one in a hold-off r, takes the share c of it.  With bursts at the rate a, and k = -log(1 - c) / r, the
densities of y above the capacity are, in bursts and between them,

    f(y) ~ exp(-b (y - C) / u) ((k y - u) / (k C - u))^(a / k),        g(y) = u f(y) / (k y - u).

For short bursts that is a queue with one on-off source: exponential, with the mean n alpha B p (1 - p) /
(1 - p - rho r) over all time.

**Running numbers.** What an agent that counts gaps in numbers modulo 2**w takes its loss for is a Markov
chain: how far the latest number that it has read is behind.  What is more than half a period ahead is taken
for an old number, and is counted as heard without a step ahead.
"""

import math
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from aimd_des.problem.optimum import solve_optimum
from aimd_des.problem.problem import Problem
from aimd_des.theory.arguments import arguments
from aimd_des.theory.signals import signal_rate
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

_HALVINGS = 40
_TEETH = 3

# Points and mean bursts of growth of a density, and how often and how closely the mean demand is settled.
_POINTS, _REACH = 4_000, 40.0
_ROUNDS, _RESTS = 50, 1e-4

# With so many bits an agent that loses half of the signals is mistaken at one in a billion of them.
_NEVER_MISTAKEN = 6


def burst_shares(problem: Problem, loss: float, burst: float) -> tuple[FloatArray, float]:
    """Averages, and signals per unit of time, where each link has bursts of loss of its own.

    Parameters
    ----------
    problem : Problem
        One resource.
    loss : float
        p, the share of the time in which a link is bad.
    burst : float
        B, the mean length of a burst, in units of time; 0 for independent losses.

    Returns
    -------
    allocation : ndarray, shape (n, 1)
        Averages of continuous agents, in units of the resource.
    signals : float
        Per unit of time.  Both are NaN where links that are bad hold more than the capacity.

    Raises
    ------
    InputError
        If a number is outside its range, or the problem has several resources.

    Notes
    -----
    Of what a sawtooth below the capacity uses.  To the next order, signals find agents with more than
    their mean, by half the height of a sawtooth; p alpha B then counts as smaller.  Signals are those of
    agents that all have the increase and decrease of the first.
    """
    loss, burst = _checked(problem, loss, burst)
    increase, capacity = problem.increase[:, 0], float(problem.capacity[0])
    if loss * burst * increase.sum() >= capacity:
        return np.full((problem.n_agents, 1), np.nan), np.nan
    mu, used = float(solve_optimum(problem).multipliers[0]), capacity
    for _ in range(_TEETH):
        signals = float(signal_rate(increase[0], problem.decrease[0, 0], problem.normalization[0], mu, loss))
        tooth = 0.5 * increase / signals
        lump, used = loss * burst * increase - tooth, capacity - float(tooth.sum())
        unused = partial(_unused, problem, lump, used)
        mu = math.exp(brentq(unused, math.log(1e-9 * mu), math.log(1e3 * mu), xtol=1e-6))
    return _held(problem, lump, mu)[:, None], signals


def _held(problem: Problem, lump: FloatArray, mu: float) -> FloatArray:
    """Find x with f_i'(x) (1 - lump_i / x) = mu, shape (n,)."""
    low = np.maximum(lump, 0.0)
    high = low + 2.0 * problem.capacity[0]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        short = problem.costs.gradient(middle[:, None])[:, 0] * (1.0 - lump / middle) < mu
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return low


def _unused(problem: Problem, lump: FloatArray, used: float, log_mu: float) -> float:
    return float(_held(problem, lump, math.exp(log_mu)).sum() - used)


class BurstRunaway(NamedTuple):
    """What total demand does where bursts of loss are common to all links; demand is over the capacity.

    Attributes
    ----------
    utilisation : float
        Mean of total demand.
    time_above, excess : float
        Share of time above the capacity, and mean of what is above it.
    run_away_peak, excursion : float
        Mean excess at the end of the bursts in which demand is above the capacity, and mean duration of
        excursions above it, in units of time.
    peak : float
        Mean of the highest total demand in the span that is asked for.
    allocation : ndarray, shape (n, 1)
        Averages, in units of the resource.
    """

    utilisation: float
    time_above: float
    excess: float
    run_away_peak: float
    excursion: float
    peak: float
    allocation: FloatArray


def burst_runaway(
    problem: Problem, loss: float, burst: float, *, hold_off: float, span: float
) -> BurstRunaway | None:
    """Predict what total demand does where all links have their bursts of loss together.

    Parameters
    ----------
    problem : Problem
        One resource, with the same increase and decrease for all agents.
    loss : float
        p, the share of the time in which the links are bad, above 0 and below 1.
    burst : float
        B > 0, the mean length of a burst, in units of time, long against the hold-off.
    hold_off : float
        r > 0 of a control unit that senses crossings, in units of time.
    span : float
        How long the run is whose peak is asked for, in units of time.

    Returns
    -------
    BurstRunaway or None
        Nothing where signals do not suffice between bursts.

    Raises
    ------
    InputError
        If a number is outside its range, or the problem has several resources.

    Notes
    -----
    Iterates on the mean of demand, on which the share c that a signal takes depends.  A burst that finds
    total demand held, evenly spread over one period of the sawtooth, crosses the capacity with probability
    phi.  All agents grow alike in a burst, and fall in proportion after it: what is used is shared as without
    loss.  Neglects that cuts are random and, for the peak, that bursts follow each other.
    """
    loss, burst = _checked(problem, loss, burst)
    for name, value in (("loss", loss), ("burst", burst), ("hold_off", hold_off), ("span", span)):
        validation.number(name, value, low=0.0, low_open=True)
    capacity, keep = float(problem.capacity[0]), 1.0 - float(problem.decrease[0, 0])
    u, b = float(problem.increase.sum()) / capacity, 1.0 / burst
    a, used = b * loss / (1.0 - loss), 1.0
    w = np.linspace(0.0, _REACH * u * burst, _POINTS)
    for _ in range(_ROUNDS):
        mu = float(solve_optimum(problem, capacity=np.array([used * capacity])).multipliers[0])
        cut = problem.n_agents * keep * float(problem.normalization[0]) * mu / (used * capacity)
        k, tooth = -np.log1p(-cut) / hold_off, cut / u
        if k <= u:
            return None
        f = np.exp(-b * w / u) * (1.0 + k * w / (k - u)) ** (a / k)
        g = u * f / (k * (1.0 + w) - u)
        phi = -np.expm1(-b * tooth) / (b * tooth)
        weight = loss / (np.trapezoid(f, w) + u * burst * (1.0 - phi) / phi)
        inside, between = (weight * float(np.trapezoid(density, w)) for density in (f, g))
        excess, above = weight * float(np.trapezoid(w * (f + g), w)), inside + between
        mean = 1.0 + excess - 0.5 * cut * (1.0 - above)
        moved = mean - used
        used += 0.5 * moved
        if abs(moved) < _RESTS:
            break
    summed = np.append(0.0, np.cumsum(0.5 * (f[1:] + f[:-1])))
    below = np.clip(summed / summed[-1], 0.0, 1.0)
    return BurstRunaway(
        utilisation=mean,
        time_above=above,
        excess=excess,
        run_away_peak=weight * float(np.trapezoid(w * f, w)) / inside,
        excursion=above / (u * weight),
        peak=1.0 + float(np.trapezoid(1.0 - below ** (span * (u * weight + a * between)), w)),
        allocation=solve_optimum(problem, capacity=np.array([used * capacity])).allocation,
    )


def _checked(problem: Problem, loss: float, burst: float) -> tuple[float, float]:
    """Check what bursts of both kinds are given."""
    if problem.n_resources != 1:
        raise InputError.of("number of resources", problem.n_resources, "1", "take one at a time")
    loss = validation.number("loss", loss, low=0.0, high=1.0, high_open=True)
    return loss, validation.number("burst", burst, low=0.0)


def believed_loss(loss: npt.ArrayLike, number_bits: int) -> FloatArray:
    """Loss that an agent with `EstimatedLoss` believes in, in the long run.

    Parameters
    ----------
    loss : array_like
        p_i, what it loses, independently.
    number_bits : int
        w, the width of the running number, at least 2.

    Returns
    -------
    ndarray
        Estimated probabilities of loss.

    Notes
    -----
    Exact for signals that arrive in their order, but for w of 6 and more, where it is p_i: a number is then
    misread once in 2**32 signals at a loss of a half.
    """
    (p,) = arguments(loss=loss)
    width = validation.integer("number_bits", number_bits, low=2)
    if width >= _NEVER_MISTAKEN:
        return np.asarray(p)
    return np.array([_believed(value, 2**width) for value in p.ravel().tolist()]).reshape(p.shape)


def _believed(loss: float, period: int) -> float:
    behind = np.arange(period)
    ahead = (behind + 1) % period
    understood = 2 * ahead <= period
    move = np.zeros((period, period))
    move[behind, ahead] = np.where(understood, loss, 1.0)
    move[:, 0] += np.where(understood, 1.0 - loss, 0.0)
    balance = move.T - np.eye(period)
    balance[-1] = 1.0
    share = np.linalg.solve(balance, np.eye(period)[-1])
    steps = (1.0 - loss) * (share * np.where(understood, ahead, 0)).sum()
    return max(float(1.0 - (1.0 - loss) / steps), 0.0)
