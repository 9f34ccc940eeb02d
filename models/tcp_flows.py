r"""TCP flows through one bottleneck: AIMD that ends in proportional fairness, and the square-root law.

Flows with log utilities share the capacity so that sum_i w_i log x_i is largest. That is proportional
fairness (F. Kelly, A. Maulloo and D. Tan, Rate control for communication networks, Journal of the
Operational Research Society 49, 1998).  On one link that is w_i / x_i = nu for all flows, x_i = w_i C /
sum(w).  The negative of such a utility is no cost here, since it does not increase; none is needed.  AIMD
makes derivatives of costs agree, weighted by (1 - beta_i) / alpha_i, and costs whose weighted derivatives
agree where w_i / x_i does have the same solution.  Two ways to get there, both with beta = 1/2 as in TCP
Reno:

"proportional"
    f_i = x**2 / (2 w_i), the same alpha for all.  The response probability Gamma / w_i does not depend on
    the rate: congestion hits per unit of time.  In the mean this is Kelly's primal algorithm, dx_i/dt in
    proportion to w_i - price * x_i, with signals for a price.
"reno"
    alpha_i = w_i**2, where 1 / w_i is the round-trip time: a window that grows by one packet per round
    trip.  f_i = x**3 / 3, so that the response probability is Gamma x_i: a packet of one flow is as likely to
    be dropped as one of another, and Gamma C of them are dropped at a capacity event.  Rates settle where
    x_i**2 / alpha_i is the same for all.  That is the square-root law with the packet loss
    p = Gamma * (signals per unit of time), common to all, and again in proportion to w_i.

The unit of time is the round-trip time of a flow with weight 1; rates are in packets per unit of time.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from aimd_des import InputError, PolynomialCosts, Problem, Resource, checks, model
from aimd_des.lowlevel import FloatArray

__all__ = ["tcp_flows"]

_DECREASE = 0.5
_DEFAULT_WEIGHTS = (1.0, 1.25, 1.5, 1.75, 2.0) * 4


def _law(law: str, weights: FloatArray) -> tuple[PolynomialCosts, FloatArray]:
    """Choose costs and alpha of each flow."""
    if law == "proportional":
        return PolynomialCosts([2], (0.5 / weights)[:, None, None]), np.ones_like(weights)
    if law == "reno":
        return PolynomialCosts([3], np.full((len(weights), 1, 1), 1 / 3)), weights**2
    raise InputError.of("law", law, "'proportional' or 'reno'")


@model
def tcp_flows(
    weights: Sequence[float] = _DEFAULT_WEIGHTS,
    law: Literal["proportional", "reno"] = "proportional",
    capacity: float = 1000.0,
    responses: float = 2.0,
) -> Problem:
    """Build TCP flows that share a bottleneck link.

    Parameters
    ----------
    weights : sequence of float, shape (n,)
        w_i > 0, what flows would pay, or the inverse of their round-trip times; as many as flows.
    law : {"proportional", "reno"}
        Whether congestion hits a flow per unit of time or per packet.
    capacity : float
        C > 0, in packets per unit of time.
    responses : float
        How many flows respond to a capacity event in the mean, at the fair rates; 0 < responses <= n, and
        small enough for every response probability to be at most 1.

    Returns
    -------
    Problem
        One resource, "bandwidth".  With "proportional" its optimum is the proportionally fair allocation.
        With "reno" the increases differ and so it is the optimum with the weights 1 / alpha_i that is
        proportionally fair: see `theory.reweighted_optimum`.

    Raises
    ------
    InputError
        If an argument is outside its range.

    Examples
    --------
    >>> from aimd_des import solve_optimum, theory
    >>> fair = tcp_flows(weights=[1.0, 3.0], capacity=40.0, responses=1.0)
    >>> solve_optimum(fair).allocation.round(6).tolist()
    [[10.0], [30.0]]
    >>> reno = tcp_flows(weights=[1.0, 3.0], law="reno", capacity=40.0, responses=1.0)
    >>> theory.reweighted_optimum(reno, 1 / reno.increase).allocation.round(6).tolist()
    [[10.0], [30.0]]
    """
    shares = checks.array("weights", weights, ("n_flows",), low=0.0, low_open=True)
    total = checks.number("capacity", capacity, low=0.0, low_open=True)
    costs, increase = _law(law, shares)
    fair = (total * shares / shares.sum())[:, None]
    steepness = costs.gradient(fair) / fair
    most = float(steepness.sum() / steepness.max())
    wanted = checks.number(
        "responses",
        responses,
        low=0.0,
        low_open=True,
        high=most,
        remedy="more would take a response probability above 1",
    )
    normalization = wanted / float(steepness.sum())
    return Problem([Resource("bandwidth", total, increase, _DECREASE, normalization, unit="packets")], costs)
