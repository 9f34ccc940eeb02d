r"""The agent's rule: how demand grows, what the average is, and how a capacity signal is answered.

Between two signals demand is a line, so nothing is stepped.  The state of an agent is kept at its
*anchor*, the last moment at which the line broke (a response, or a tick that held): the demand just
after it, and the demand accumulated up to it.  With c the moments since the anchor,

                 discrete, at tick k           continuous, at time t
    moment       k                             t
    demand       x + alpha * (c - 1)           x + alpha * c

and they differ in one number, the *tick weight*: 1 where a tick folds in a whole demand before it acts
(eq. (average_eqn) of the paper), 0 where the average is an integral.  A signal is answered with
probability lambda = Gamma * grad_j f(average) / average^j, eq. (prob_x), or as another of
`responses` has it.  The formulas are the rule, written once: kernels compile them, processes call them.
"""

from typing import Literal

from aimd_des.utils.jit import formula

#: Which agents: those that act at ticks, or those that grow all the time.
Dynamics = Literal["discrete", "continuous"]

#: The tick weight: what the moment at hand itself counts for in the average.
DISCRETE, CONTINUOUS = 1.0, 0.0


@formula
def demand_at(demand: float, increase: float, since: float, tick_weight: float) -> float:
    """Return the demand after growth."""
    return demand + increase * (since - tick_weight)
