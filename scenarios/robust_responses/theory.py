"""Closed forms for `robust_responses`: what agents believe they lose, and what hold-offs come to."""

from functools import lru_cache

import numpy as np

from aimd_des import Problem, theory
from aimd_des.checks import FloatArray
from aimd_des.compensation import compensation_factor
from scenarios.common.measure import distance
from scenarios.common.systems import memory_alone

MEMORY = memory_alone()

# With so many bits who loses half of the signals is mistaken at one in a billion of them.
_NEVER_MISTAKEN = 6


@lru_cache
def believed_loss(loss: float, bits: int) -> float:
    """Find what an agent takes its loss for in the long run, if signals carry a number of so many bits.

    Exact for signals that arrive in their order.  A Markov chain: how far the latest number that the agent
    has read is behind, modulo the period.  What is more than half a period ahead looks like an old number,
    and is counted as heard without a step ahead.
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
    """Predict how far averages are from the optimum, (m,), if agents make good for believed losses.

    Loss and belief have shape (n,); the share is that of steps with a signal, 0 for continuous agents.
    """
    factor = [
        compensation_factor(own, share * (1.0 - p), 1.0, float(share > 0.0))
        for own, p in zip(believed.tolist(), loss.tolist(), strict=True)
    ]
    weights = theory.loss_weights(loss, share) * factor
    best = theory.reweighted_optimum(problem, weights, capacity=problem.capacity)
    return distance(problem, best.allocation)
