"""The steady state of a system in which agents come and go, in closed form but for one root."""

from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from aimd_des.problem.problem import Problem
from aimd_des.theory.allocations import solve_increasing
from aimd_des.theory.steady import needed_rate
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError, SimulationError
from aimd_des.utils.validation import FloatArray

# Signals between which there is an answer, over those that hold the capacity without churn.
_FEWEST, _MOST = 1e-4, 5.0


class Churn(NamedTuple):
    """What is expected where agents come and go.

    Attributes
    ----------
    signals : float
        h, per unit of time.
    utilisation : float
        Mean total demand over the capacity.
    share : ndarray, shape (n,)
        Mean demand of an agent while it is present, in units of the resource.
    """

    signals: float
    utilisation: float
    share: FloatArray


def churn(problem: Problem, stay: float, present: float, latency: float = 0.0) -> Churn:
    """Predict the steady state where continuous agents come and go, by balance of each and of the total.

    Parameters
    ----------
    problem : Problem
        One resource, with the same increase and decrease for all agents.
    stay : float
        T > 0, the mean time for which an agent is present, in units of time; may be infinite.
    present : float
        Share of the agents that are present in the mean, above 0 and at most 1.
    latency : float
        Common to all agents, in units of time.

    Returns
    -------
    Churn
        Signals, utilisation, and shares.

    Raises
    ------
    InputError
        If an argument is outside its range, the problem has several resources, or agents differ.
    SimulationError
        If one signal takes so much of the capacity that no number of signals is in balance.

    Notes
    -----
    An agent gains alpha, and loses h (1 - beta) lambda x by signals and x / T by going. It tends to f'(x)
    + c x = alpha / k with k = h (1 - beta) Gamma and c = 1 / (k T), as if a square were added to all
    costs.  The total lies below the capacity as the work in a queue: by what signals take (with
    vacations), and by what agents take along that leave (Pollaczek and Khinchine).

    For exponential stays and absences, and averages that are kept.  Neglects that the number of those present
    wanders, and that it takes a while to learn an average.

    Examples
    --------
    Agents that leave before they can fill the capacity, 20 * 0.02 * 25 of 20, hardly need signals:

    >>> from aimd_des import PolynomialCosts, Resource
    >>> memory = Resource("memory", capacity=20.0, increase=0.02, decrease=0.5, normalization=0.1)
    >>> problem = Problem([memory], PolynomialCosts([2], [[[1.0]]] * 20))
    >>> [round(churn(problem, stay, 1.0).utilisation, 2) for stay in (25.0, float("inf"))]
    [0.48, 0.94]
    """
    if problem.n_resources != 1:
        raise InputError.of("number of resources", problem.n_resources, "1", "take one at a time")
    if stay != np.inf:
        validation.number("stay", stay, low=0.0, low_open=True)
    validation.number("present", present, low=0.0, low_open=True, high=1.0)
    validation.number("latency", latency, low=0.0)
    rho = float(needed_rate(problem)[0])
    excess = partial(_excess, problem, stay, present, latency)
    ends = np.log(_FEWEST * rho), np.log(_MOST * rho)
    if excess(ends[1]) > 0.0:
        raise SimulationError(
            "no steady state: one signal takes too large a part of the capacity, so make Gamma or 1 - beta"
            " smaller"
        )
    signals = float(np.exp(brentq(excess, *ends, xtol=1e-12)))
    share = _balance(problem, stay, present, latency, signals)[1]
    return Churn(signals, float(present * share.sum() / problem.capacity[0]), share)


def _excess(problem: Problem, stay: float, present: float, latency: float, log_signals: float) -> float:
    """Compute how far agents are above the level that so many signals leave: more signals, less."""
    level, share = _balance(problem, stay, present, latency, float(np.exp(log_signals)))
    return float(present * share.sum() - level)


def _balance(
    problem: Problem, stay: float, present: float, latency: float, signals: float
) -> tuple[float, FloatArray]:
    """Compute where the total would be with so many signals, and what agents tend to."""
    alpha, cut, leaving = problem.increase[:, 0], 1.0 - problem.decrease[:, 0], 1.0 / stay
    k = signals * cut * problem.normalization[0]

    def lost(x: FloatArray) -> FloatArray:
        return np.asarray((k * problem.costs.gradient(x[:, None])[:, 0] + leaving * x) / alpha)

    x = solve_increasing(lost, 1.0, np.full(problem.n_agents, problem.capacity[0] / problem.n_agents))
    answers = (alpha / x - leaving) / cut  # h lambda
    square = 2.0 * alpha * x / (answers * (1.0 - (1.0 - cut) ** 2) + leaving)
    chance = answers / signals
    taken = present * (cut * chance * x).sum()
    spread = present * (chance * cut**2 * square - (chance * cut * x) ** 2).sum()
    growth = present * alpha.sum()
    below = 0.5 * (taken + spread / taken) - growth * latency
    spare = growth - leaving * present * x.sum()
    below += 0.5 * leaving * present * square.sum() / max(spare, 1e-12)
    return float(problem.capacity[0] - below), x
