"""Between which bounds a hold-off should lie, by the latency and by the signals that are necessary."""

import numpy as np

from aimd_des.problem.problem import Problem
from aimd_des.theory.steady import needed_rate
from aimd_des.utils import validation
from aimd_des.utils.validation import FloatArray


def hold_off_bounds(
    problem: Problem, latency: float, *, loss: float = 0.0, taken: float = 0.7
) -> tuple[FloatArray, FloatArray]:
    """Bound the hold-off from below by the latency, and from above by the signals that are necessary.

    Parameters
    ----------
    problem : Problem
        Its increases and decreases are the same for all agents.
    latency : float
        d >= 0, common to all, in units of time.
    loss : float
        Probability p that a signal is lost on an agent, the same for all.
    taken : float
        X > 0, the capacity that signals on their way may take, as a share of it; 1 and more is most of it.

    Returns
    -------
    shortest, longest : ndarray, shape (m,)
        In units of time: (1 - p) d n alpha / (rho C X), or d where that is shorter, and (1 - p) / rho with
        rho of `needed_rate`.

    Raises
    ------
    InputError
        If an argument is outside its range, or increases or decreases differ from agent to agent.

    Notes
    -----
    A crossing sends d / r signals before the first of them acts, and each takes n alpha (1 - p) / rho in the
    mean.  At X = 0.7 the shares of the paper's memory are about as right as without latency; at X = 1.5 they
    are 2.5 to 4.4 % off, for d from 20 down to 2, as `limit_cycle` says.  A hold-off of d or more has one
    signal for each crossing.  The longest is that of `critical_loss`: just below it demand is above the
    capacity for long.

    Where the shortest is above the longest, no hold-off is suitable. At any loss that is so where the
    growth over the latency, n alpha d, is more than X C.  Then all agents must grow more slowly.

    Examples
    --------
    >>> from aimd_des import PolynomialCosts, Resource
    >>> memory = Resource("memory", capacity=20.0, increase=0.02, decrease=0.5, normalization=0.1)
    >>> problem = Problem([memory], PolynomialCosts([2], [[[1.0]]] * 20))
    >>> shortest, longest = hold_off_bounds(problem, latency=5.0)
    >>> shortest.round(2).tolist(), longest.round(2).tolist()
    ([0.71], [5.0])
    """
    validation.instance("problem", problem, Problem, "a Problem")
    delay = validation.number("latency", latency, low=0.0)
    kept = 1.0 - validation.number("loss", loss, low=0.0, high=1.0, high_open=True)
    most = validation.number("taken", taken, low=0.0, low_open=True)
    longest = kept / needed_rate(problem)
    shortest = longest * delay * problem.increase.sum(axis=0) / (most * problem.limit)
    return np.minimum(shortest, delay), longest
