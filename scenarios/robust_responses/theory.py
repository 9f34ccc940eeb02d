"""Closed forms for `robust_responses`: what agents believe they lose, and what hold-offs come to."""

from functools import lru_cache

import numpy as np

from aimd_des import theory
from aimd_des.checks import FloatArray
from aimd_des.compensation import compensation_factor
from aimd_des.errors import InputError
from aimd_des.optimum import solve_optimum
from aimd_des.problem import Problem
from scenarios.common.measure import distance
from scenarios.common.systems import memory_alone

__all__ = ["MEMORY", "critical", "estimate", "held", "misallocation", "rate"]

MEMORY = memory_alone()

# With so many bits who loses half of the signals is mistaken at one in a billion of them.
_NEVER_MISTAKEN = 6


@lru_cache
def estimate(loss: float, bits: int) -> float:
    """Find what an agent takes its loss for in the long run, if signals carry a running number.

    Parameters
    ----------
    loss : float
        What it loses.
    bits : int
        Width of the number.

    Returns
    -------
    float
        Exact for signals that arrive in their order.

    Notes
    -----
    A Markov chain: how far the latest number that the agent has read is behind, modulo the period.  What is
    more than half a period ahead looks like an old number, and is counted as heard without a step ahead.
    """
    if bits >= _NEVER_MISTAKEN:
        return loss
    period = 2**bits
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


def misallocation(problem: Problem, loss: FloatArray, believed: FloatArray, share: float) -> FloatArray:
    """Predict how far averages are from the optimum if agents make good for what they believe they lose.

    Parameters
    ----------
    problem : Problem
        What is shared.
    loss, believed : ndarray, shape (n,)
        What they lose, and what they believe.
    share : float
        Share of steps with a signal, on the clock; 0 for continuous agents.

    Returns
    -------
    ndarray, shape (m,)
        Sum of absolute deviations over the sum.
    """
    factor = [
        compensation_factor(own, share * (1.0 - p), 1.0, float(share > 0.0))
        for own, p in zip(believed.tolist(), loss.tolist(), strict=True)
    ]
    weights = theory.loss_weights(loss, share) * factor
    best = theory.reweighted_optimum(problem, weights, capacity=problem.capacity)
    return distance(problem, best.allocation)


@lru_cache
def rate() -> float:
    """Compute rho for memory alone: signals per unit of time that hold all of the capacity.

    Returns
    -------
    float
        Without loss.
    """
    mu = solve_optimum(MEMORY).multipliers
    return float(theory.signal_rate(MEMORY.increase[0], MEMORY.decrease[0], MEMORY.normalization, mu)[0])


def critical(hold_off: float) -> float:
    """Compute the loss up to which memory alone is held.

    Parameters
    ----------
    hold_off : float
        In units of time.

    Returns
    -------
    float
        0 where signals do not suffice even without loss.
    """
    return float(theory.critical_loss(rate(), refractory=hold_off))


@lru_cache
def held(hold_off: float, latency: float, loss: float) -> tuple[float, float]:
    """Predict signals per unit of time, and mean total demand over capacity, for a fixed hold-off.

    Parameters
    ----------
    hold_off, latency : float
        In units of time.
    loss : float
        The same for all.

    Returns
    -------
    tuple of float
        Also beyond the critical loss; NaN where there is no formula.
    """
    if loss < critical(hold_off):
        try:
            expected = theory.predict(MEMORY, "continuous", latency=latency, loss=loss, refractory=hold_off)
        except InputError:  # so near the critical loss that signals do not suffice after all
            return np.nan, np.nan
        return float(expected.signals[0]), float(expected.utilisation[0])
    gamma = MEMORY.normalization
    mu = theory.runaway_multiplier(MEMORY.increase[0], MEMORY.decrease[0], gamma, loss, refractory=hold_off)
    level = theory.allocation_at(MEMORY, mu)
    cut_off = (gamma * mu / level > 1.0).any()
    return 1.0 / hold_off, np.nan if cut_off else float(level.sum() / MEMORY.capacity[0])
