r"""How a capacity signal is answered, in what it means for averages.

A signal that is received takes (1 - beta) lambda of the demand that it finds, in the mean, with

    lambda = Gamma f' / divisor.

The paper's rule divides by the average over time, and multiplies demand by beta with the probability lambda.
The divisor may be the demand that signals find.  The cut may be (1 - beta) lambda of the demand for certain,
or a full one after every 1 / lambda signals.  A full one finds demand at the agent's own peak, which is 2 /
(1 + beta) of the average, so that a signal takes (1 - beta) 2 Gamma f' / (1 + beta) in the mean.
"""

from typing import NamedTuple

import numpy as np

from aimd_des.problem.problem import Problem
from aimd_des.utils.validation import FloatArray

__all__ = ["PAPER", "Rule", "chance", "cuts_of", "probability"]


class Rule(NamedTuple):
    """What theory has to know of a response.

    Attributes
    ----------
    at_signals : bool
        Whether the slope is divided by the demand that signals find, instead of the average over time.
    certain : bool
        Whether a signal takes a part of the demand for certain.
    full : bool
        Whether full cuts come at regular numbers of signals.
    """

    at_signals: bool = False
    certain: bool = False
    full: bool = False


#: The paper's: demand is multiplied by beta with a probability that has the average over time below it.
PAPER = Rule()


def probability(problem: Problem, rule: Rule, average: FloatArray, tooth: FloatArray) -> FloatArray:
    """Compute lambda, (n, m), not cut off; signals find `tooth` more than the average."""
    below = average + tooth if rule.at_signals else average
    return np.asarray(problem.normalization * problem.costs.gradient(average) / below)


def chance(problem: Problem, rule: Rule, average: FloatArray, tooth: FloatArray) -> FloatArray:
    """Compute the part of 1 - beta that a received signal takes of what it finds in the mean, (n, m)."""
    wanted = probability(problem, rule, average, tooth)
    if rule.certain:
        return np.asarray(np.minimum(wanted, 1.0 / (1.0 - problem.decrease)))
    answered = np.minimum(wanted, 1.0)
    if rule.full:
        answered *= 2.0 * average / ((1.0 + problem.decrease) * (average + tooth))
    return answered


def cuts_of(
    problem: Problem, rule: Rule, part: FloatArray, loss: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Split what a signal takes into the size of a cut and its probability, both (n, m)."""
    if rule.certain:
        return (1.0 - problem.decrease) * part, np.broadcast_to(1.0 - loss, part.shape)
    return np.broadcast_to(1.0 - problem.decrease, part.shape), (1.0 - loss) * part
