r"""Averages with a finite memory: how fast they follow a change, and what the shorter memory costs in noise.

An average over all of a run, over a window of the last W, or with weights exp(-age / tau) keeps of a step of
what it averages, s after the step at run age t0,

    t0 / (t0 + s),        1 - s / W,        exp(-s / tau)        (the last two once the run is older)

and smooths demand whose autocovariance decays like exp(-kappa s), kappa = alpha / x, so that of its variance
remain

    2 / (kappa W) (1 - (1 - exp(-kappa W)) / (kappa W)),        1 / (1 + kappa tau).

Where the derivative of the costs is steeper than that of a square, agents answer to their own averages: with
e = x f'' / f' shares return e times as fast, and noise is damped.
"""

import math

import numpy as np
import numpy.typing as npt

from aimd_des.problem.problem import Problem
from aimd_des.theory.arguments import arguments
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

__all__ = ["averaging_spread", "recovery_time", "share_rates"]


def recovery_time(
    before: float,
    after: float,
    age: float,
    *,
    window: float | None = None,
    time_constant: float | None = None,
    within: float = 0.05,
) -> float:
    """Time until averages are near their new level after a step of the capacity.

    Parameters
    ----------
    before, after : float
        C0 and C1 > 0, the capacity before and after the step, in any unit.
    age : float
        t0 > 0, the age of the run at the step, in units of time.
    window : float, optional
        W > 0 of averages over a sliding window.
    time_constant : float, optional
        tau > 0 of averages that forget exponentially; without this and `window` averages are over all of the
        run.
    within : float
        How near, as a share of the new level, between 0 and 1.

    Returns
    -------
    float
        Time since the step, in units of time; 0 where the step is no larger than `within`.

    Raises
    ------
    InputError
        If an argument is outside its range, or both memories are given.

    Notes
    -----
    With ``w = within C1 / |C0 - C1|``, the part of the step that may be left: t0 (1 / w - 1) over all of the
    run, W (1 - w) for a window, tau log(1 / w) with forgetting.  A run that is younger than its memory has
    less to forget: a window is then an average over all of the run until it is full, and forgetting,
    normalised by the weights there are, takes tau log((1 - q + w q) / w) with q = exp(-t0 / tau).

    Exact for the total of the averages if total demand follows the capacity at once.  It needs the time
    ``|C0 - C1| / (n alpha)`` to rise and a few signals to fall; agents find their new shares of it with the
    rate alpha / x of AIMD; both are neglected, and assumed short in comparison.  Shares follow as the total
    does where costs are quadratic, since response probabilities do not depend on averages then.  For steeper
    ones see `share_rates`.

    Examples
    --------
    >>> [round(recovery_time(1.0, 0.5, 1000.0, **memory), 1) for memory in ({}, {"window": 200.0})]
    [19000.0, 190.0]
    """
    old, new = _positive("before", before), _positive("after", after)
    past = _positive("age", age)
    near = validation.number("within", within, low=0.0, low_open=True, high=1.0, high_open=True)
    if window is not None and time_constant is not None:
        raise InputError.of("window", window, "left out where time_constant is given")
    if abs(old - new) <= near * new:
        return 0.0
    left = near * new / abs(old - new)
    if time_constant is not None:
        tau = _positive("time_constant", time_constant)
        fresh = -math.expm1(-past / tau)  # 1 - q, also where the run is much younger than the memory
        return tau * math.log1p(fresh * (1.0 - left) / left)
    if window is not None:
        span = _positive("window", window)
        if past < left * span:  # there before the window is full
            return past * (1.0 / left - 1.0)
        return span * (1.0 - left)
    return past * (1.0 / left - 1.0)


def averaging_spread(
    average: npt.ArrayLike,
    increase: npt.ArrayLike,
    decrease: npt.ArrayLike,
    *,
    window: float | None = None,
    time_constant: float | None = None,
    elasticity: npt.ArrayLike = 1.0,
    probability: npt.ArrayLike = 0.0,
) -> FloatArray:
    """Coefficient of variation of an agent's average in the steady state.

    Parameters
    ----------
    average : array_like
        x, what the agent holds in the mean, in units of the resource.
    increase, decrease : array_like
        alpha and beta.  On the clock put alpha (1 - e), with e the share of steps with a signal.
    window : float, optional
        W > 0: of averages over a sliding window, or the age of the run for those over all of it.
    time_constant : float, optional
        tau > 0 of averages that forget exponentially; this or `window` must be given.
    elasticity : array_like
        e = x f'' / f' > 0, how steep the derivative of the agent's cost is; 1 for quadratic costs.  Others
        only with forgetting.
    probability : array_like
        lambda of the agent, for signals that come evenly.  0, as many signals with a small one each, makes
        its decreases a Poisson process.

    Returns
    -------
    ndarray
        Standard deviation over mean of its finite-memory average, a pure number.

    Raises
    ------
    InputError
        If an argument is outside its range or shapes do not fit; if not just one memory is given; or if an
        elasticity other than 1 meets a window.

    Notes
    -----
    With v = (1 - beta) / (1 + beta), the squared coefficient of variation of demand, and kappa = alpha / x,
    the rate at which it forgets, that of the average is v / (1 + kappa tau), or 2 v / (kappa W) (1 - (1 -
    exp(-kappa W)) / (kappa W)): for long memories as much for W = 2 tau.  With an elasticity the average
    acts back on the response probability, to the power e - 1, and what remains is, linearised,

        (1 - beta) / (2 e (1 + kappa tau) - (1 - beta) (1 + e kappa tau)),

    next to 1 / e of the above.  Where signals come evenly and are answered with lambda, what is certain
    makes no noise: a long memory sees (1 - lambda) / (1 - lambda (1 - beta) / 2)**2 of it, and a short
    one nearly so.

    Neglects that agents share one total: deviations of an agent are smaller by its own part of that.
    """
    x, alpha, beta, steep = arguments(
        average=average, increase=increase, decrease=decrease, elasticity=elasticity
    )
    chance = _chance(probability)
    kappa = alpha / x
    if time_constant is not None and window is None:
        memory = kappa * _positive("time_constant", time_constant)
        square = (1.0 - beta) / (2.0 * steep * (1.0 + memory) - (1.0 - beta) * (1.0 + steep * memory))
    elif window is not None and time_constant is None:
        if (steep != 1.0).any():
            raise InputError.of("elasticity", steep.tolist(), "1 for a window", "no closed form is known")
        memory = kappa * _positive("window", window)
        square = (1.0 - beta) / (1.0 + beta) * 2.0 / memory * (1.0 + np.expm1(-memory) / memory)
    else:
        raise InputError.of("window", window, "given if and only if time_constant is not")
    return np.asarray(np.sqrt(square * (1.0 - chance) / (1.0 - 0.5 * chance * (1.0 - beta)) ** 2))


def share_rates(problem: Problem, allocation: npt.ArrayLike) -> FloatArray:
    """Rates at which deviations of the shares die away, in units of 1 / tau.

    Parameters
    ----------
    problem : Problem
        The agents' costs, which must not couple resources.
    allocation : array_like, shape (n, m)
        Averages > 0 about which to linearise, such as those of `predict`, in units of the resources.

    Returns
    -------
    ndarray, shape (n - 1, m)
        Ascending for each resource: the slowest first.

    Raises
    ------
    InputError
        If costs couple resources, or the allocation has another shape or is not positive.

    Notes
    -----
    With averages that forget with time constant tau, a deviation that leaves the total as it is dies away
    like exp(-s t / tau) with these s; with averages over all of the run like t**-s.  They are the roots of
    sum_i x_i / (e_i - s) = 0, so there is one between any two neighbouring elasticities e_i = x_i f_i'' /
    f_i': costs of one and the same power q have all rates e = q - 1, and quadratic ones 1, the rate of the
    total itself.  A window has no such rates, but e - 1 is its feedback as well.

    Linear; for memories that are long against the time x_i / alpha_i in which agents find a new share, and
    agents of which none holds most of the total.  Weights that loss, alpha and beta give to the costs do not
    matter.
    """
    validation.instance("problem", problem, Problem, "a Problem")
    shape = problem.n_agents, problem.n_resources
    x = validation.array("allocation", allocation, shape, low=0.0, low_open=True)
    if not problem.costs.separable:
        raise InputError.of("costs", type(problem.costs).__name__, "such that they do not couple resources")
    curvature = np.einsum("ijj->ij", problem.costs.hessian(x))
    elasticity = x * curvature / problem.costs.gradient(x)
    rates = np.empty((shape[0] - 1, shape[1]))
    for j in range(shape[1]):
        # In deviations over sqrt(x_i) the system is symmetric: the elasticities, seen at right angles
        # to u = sqrt(x / sum x), which the common signals hold fixed.
        unit = np.sqrt(x[:, j] / x[:, j].sum())
        across = np.linalg.qr(np.column_stack([unit, np.eye(shape[0])]))[0][:, 1:]
        rates[:, j] = np.linalg.eigvalsh(across.T @ (elasticity[:, j, None] * across))
    return rates


def _positive(name: str, value: float) -> float:
    return validation.number(name, value, low=0.0, low_open=True)


def _chance(probability: npt.ArrayLike) -> FloatArray:
    """Check response probabilities, of which 0 is one here."""
    values = np.asarray(probability, dtype=np.float64)
    if not ((values >= 0.0) & (values <= 1.0)).all():
        raise InputError.of("probability", probability, "at least 0 and at most 1")
    return values
