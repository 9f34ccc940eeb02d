"""Closed forms for `robust_responses`: what agents believe they lose, and what hold-offs come to."""

from aimd_des import Problem, theory
from aimd_des.compensation import compensation_factor
from aimd_des.lowlevel import FloatArray
from scenarios.common.measure import distance
from scenarios.common.systems import memory_alone

MEMORY = memory_alone()


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
