r"""How a capacity signal is answered, in what it means for averages.

A signal that is received takes (1 - beta) lambda of the demand that it finds, in the mean, with

    lambda = Gamma f' / divisor.

The paper's response divides by the average over time, and multiplies demand by beta with the probability
lambda.  The divisor may be the demand that signals find.  The cut may be (1 - beta) lambda of the demand for
certain, or a full one after every 1 / lambda signals.  A full one finds demand at the agent's own peak, which
is 2 / (1 + beta) of the average, so that a signal takes (1 - beta) 2 Gamma f' / (1 + beta) in the mean,
whether lambda has the average below it or (1 + beta) / 2 of the peak.
"""

import numpy as np

from aimd_des.dynamics.responses import (
    AT_SIGNALS,
    FRACTIONAL,
    FULL,
    OWN,
    Randomised,
    Response,
    ResponseParameters,
)
from aimd_des.problem.problem import Problem
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray


def check_response(response: Response | None) -> ResponseParameters:
    """Refuse what is no response, or one that theory knows nothing of; default: the paper's."""
    given = Randomised() if response is None else response
    validation.instance("response", given, Response, "a response, such as responses.EventNormalised()")
    parameters = given.parameters(1.0)
    if parameters.divisor == OWN:
        allowed = "one of ours, such as responses.Derandomised()"
        raise InputError.of("response", response, allowed, "theory cannot look into a function of one's own")
    return parameters


def probability(
    problem: Problem, response: ResponseParameters, average: FloatArray, tooth: FloatArray
) -> FloatArray:
    """Compute lambda, (n, m), not cut off; signals find `tooth` more than the average."""
    below = average + tooth if response.divisor == AT_SIGNALS else average
    return np.asarray(problem.normalization * problem.costs.gradient(average) / below)


def largest(problem: Problem, response: ResponseParameters) -> FloatArray:
    """Compute the largest lambda that the cut can follow, (n, m)."""
    if response.cut == FRACTIONAL:
        return np.asarray(1.0 / (1.0 - problem.decrease))
    return np.ones_like(problem.decrease)


def chance(
    problem: Problem, response: ResponseParameters, average: FloatArray, tooth: FloatArray
) -> FloatArray:
    """Compute the part of 1 - beta that a received signal takes of what it finds in the mean, (n, m)."""
    part = np.minimum(probability(problem, response, average, tooth), largest(problem, response))
    if response.cut == FULL:
        part = part * 2.0 * average / ((1.0 + problem.decrease) * (average + tooth))
    return np.asarray(part)


def cuts_of(
    problem: Problem, response: ResponseParameters, part: FloatArray, loss: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Split what a signal takes into the size of a cut and its probability, both (n, m)."""
    if response.cut == FRACTIONAL:
        return (1.0 - problem.decrease) * part, np.broadcast_to(1.0 - loss, part.shape)
    return np.broadcast_to(1.0 - problem.decrease, part.shape), (1.0 - loss) * part
