r"""Classic AIMD, the paper's section III: one resource, and all agents respond to every capacity event.

With costs x**2 / 2 and Gamma = 1 the response probability is average / average, which is exactly 1 in
floating point, too. Every agent that has ever held something responds, and none counts as saturated. What
remains is synchronised AIMD (Chiu and Jain, 1989) with growth alpha_i and decrease beta_i of each agent.
From event to event x_i(k+1) = beta_i x_i(k) + alpha_i T(k), and shares at events tend to be in proportion
to alpha_i / (1 - beta_i).
"""

from collections.abc import Sequence

import numpy as np

from aimd_des import PolynomialCosts, Problem, Resource, checks, model

__all__ = ["classic_aimd"]


@model
def classic_aimd(
    increase: Sequence[float] = (0.004, 0.006, 0.008, 0.01),
    decrease: float | Sequence[float] = (0.8, 0.5, 0.7, 0.4),
    capacity: float = 4.0,
) -> Problem:
    """Build a system of agents that all respond to every signal.

    Parameters
    ----------
    increase : sequence of float, shape (n,)
        alpha_i > 0, what an agent adds per step or unit of time; as many as there are agents.
    decrease : float or sequence of float, shape (n,)
        beta_i, 0 <= beta_i < 1.
    capacity : float
        C > 0.

    Returns
    -------
    Problem
        One resource, "share".

    Raises
    ------
    InputError
        If an argument is outside its range, or there are not as many decreases as increases.

    Notes
    -----
    Costs only serve to make all agents respond.  Where alpha_i / (1 - beta_i) differs from agent to agent
    their optimum, equal shares, is not what the system tends to: hold it against `theory.event_mean`,
    `theory.event_interval` and `theory.synchronised_utilisation`.  On the discrete clock run it with
    ``lag=0``. If a signal acts a step late, the excess is signalled twice before any agent responds; all
    agents respond twice, and beta_i counts as its square.

    Examples
    --------
    >>> from aimd_des import theory
    >>> problem = classic_aimd(increase=[0.01, 0.03], decrease=0.5, capacity=1.0)
    >>> theory.event_mean(problem.capacity, problem.increase, problem.decrease).round(6).tolist()
    [[0.25], [0.75]]
    """
    alpha = checks.array("increase", increase, ("n_agents",), low=0.0, low_open=True)
    beta = checks.per_agent("decrease", decrease, low=0.0, high=1.0, high_open=True)
    costs = PolynomialCosts([2], np.full((len(alpha), 1, 1), 0.5))
    return Problem([Resource("share", capacity, alpha, beta, normalization=1.0)], costs)
