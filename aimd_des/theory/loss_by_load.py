r"""Loss that grows with the load: signals that are lost to the excess that they report.

Let l be total demand over the capacity.  Beyond the capacity the control unit signals once in a hold-off r,
and a signal that finds the load l is lost with probability p(l).  Of the total it takes the share
n alpha / (rho C), with rho the signals that hold the capacity, so long as averages are what they were.  So
demand comes back by itself while cuts outweigh growth,

    (1 - p(l)) l > rho r,

and runs on from the load at which that ends.  In the long run averages follow demand, and it rests where

    1 - p(l) = rho(l) r,

rho(l) being the signals that hold l times the capacity; costs whose derivatives grow like x^e have rho / l^e.
So where 1 - p(l) falls like l^-s there is no such rest beyond the capacity for s <= e, and for s <= 1 no load
from which demand runs on.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from aimd_des.problem.problem import Problem
from aimd_des.theory.steady import needed_rate
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

_POINTS = 50


class Congestion(NamedTuple):
    """What becomes of total demand where loss grows with the load; demand is over the capacity.

    Attributes
    ----------
    turning : float
        The load from which on demand does not come back by itself; 1 where signals do not suffice at the
        capacity, inf where it always comes back.
    rests : tuple of float
        Loads beyond the capacity at which demand comes to rest in the long run, the lowest first.
    """

    turning: float
    rests: tuple[float, ...]


def congestion(
    problem: Problem, loss: Callable[[float], float], *, hold_off: float, highest: float = 20.0
) -> Congestion:
    """Find the load from which demand does not come back, and where it rests, if loss grows with the load.

    Parameters
    ----------
    problem : Problem
        One resource, with the same increase and decrease for all agents.
    loss : callable
        Probability that a signal is lost on an agent, of the load: total demand over the capacity.
    hold_off : float
        r > 0, the least time between two signals.
    highest : float
        The highest load that is looked at, above 1.

    Returns
    -------
    Congestion
        Of continuous agents without latency, as a fluid.

    Raises
    ------
    InputError
        If a number is outside its range, the problem has several resources, or agents differ.

    Notes
    -----
    Loads are those that signals find.  Chance is left out: demand that is often near the turning load passes
    it some time.  Holds while no response probability passes 1.

    Examples
    --------
    >>> from aimd_des import PolynomialCosts, Resource
    >>> memory = Resource("memory", capacity=20.0, increase=0.02, decrease=0.5, normalization=0.02)
    >>> problem = Problem([memory], PolynomialCosts([2], [[[1.0]]] * 20))
    >>> found = congestion(problem, lambda load: min(load - 0.8, 0.9), hold_off=0.4)
    >>> round(found.turning, 2), [round(rest, 2) for rest in found.rests]
    (1.54, [4.0])
    """
    if problem.n_resources != 1:
        raise InputError.of("number of resources", problem.n_resources, "1", "take one at a time")
    hold_off = validation.number("hold_off", hold_off, low=0.0, low_open=True)
    highest = validation.number("highest", highest, low=1.0, low_open=True)
    capacity = problem.capacity
    needed = float(needed_rate(problem)[0]) * hold_off

    def now(load: float) -> float:
        return (1.0 - loss(load)) * load - needed

    def later(load: float) -> float:
        return 1.0 - loss(load) - float(needed_rate(problem, capacity=load * capacity)[0]) * hold_off

    falls = [root for root, rises in _roots(now, highest) if not rises]
    turning = 1.0 if now(1.0) <= 0.0 else min(falls, default=math.inf)
    return Congestion(turning, tuple(root for root, rises in _roots(later, highest) if rises))


def _roots(function: Callable[[float], float], highest: float) -> list[tuple[float, bool]]:
    """Find where a function of the load changes its sign beyond 1, and whether it rises there."""
    loads = np.geomspace(1.0, highest, _POINTS).tolist()
    values = [function(load) for load in loads]
    ends = zip(loads[:-1], loads[1:], values[:-1], values[1:], strict=True)
    return [
        (float(brentq(function, low, high)), before <= 0.0)
        for low, high, before, after in ends
        if (before <= 0.0) != (after <= 0.0)
    ]
