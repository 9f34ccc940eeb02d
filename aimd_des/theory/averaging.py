r"""How fast averages follow a change, and what a shorter memory costs in noise.

An average with gain a (1 over all of a run), over a window of the last W, or with weights exp(-age / tau)
keeps of a step of what it averages, s after the step at run age t0,

    (t0 / (t0 + s))**a,   1 - s / W,   exp(-s / tau)        (the last two once the run is older)

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


def recovery_time(
    before: float,
    after: float,
    age: float,
    *,
    window: float | None = None,
    time_constant: float | None = None,
    gain: float = 1.0,
    within: float = 0.05,
    ramp: float = 0.0,
    steps: int | None = None,
) -> float:
    """Time until averages are near their new level after a step or a ramp of the capacity.

    Parameters
    ----------
    before, after : float
        C0 and C1 > 0, the capacity before and after the step, in any unit.
    age : float
        t0 > 0, the age of the run at the step, or at the begin of the ramp, in units of time.
    window : float, optional
        W > 0 of averages over a sliding window.
    time_constant : float, optional
        tau > 0 of averages that forget exponentially.
    gain : float
        a > 0 of averages in which demand at age s weighs as s**(a - 1): 1 is over all of the run.
    within : float
        How near, as a share of the new level, between 0 and 1.
    ramp : float
        D >= 0, the time that the change takes, in units of time.
    steps : int, optional
        Number of equal steps of the ramp, as of `CapacityRamp`; without it the ramp is a line.

    Returns
    -------
    float
        Time since the step, or the begin of the ramp, in units of time; 0 where the change is no larger than
        `within`.

    Raises
    ------
    InputError
        If an argument is outside its range, or more than one memory is given.

    Notes
    -----
    With ``w = within C1 / |C0 - C1|``, the part of the step that may be left: t0 (w**(-1 / a) - 1) with a
    gain, W (1 - w) for a window, tau log(1 / w) with forgetting.  A run that is younger than its memory
    has less to forget. A window is then an average over all of the run until it is full. Forgetting,
    normalised by the weights there are, takes tau log((1 - q + w q) / w) with q = exp(-t0 / tau).

    A ramp is a step at its middle M, with three exceptions. A gain sees the power mean of its ages, (mean
    age**a)**(1 / a). Forgetting sees the average of an exponential and is tau log(sinh(D / 2 tau) / (D /
    2 tau)) later. A window may have left the first part of the ramp behind: then the rest of the ramp,
    squared, over 2 D W may be left, after W + 2 M - sqrt(4 M W w).

    Exact for the total of the averages if total demand follows the capacity at once.  It needs the time
    ``|C0 - C1| / (n alpha)`` to rise and a few signals to fall; agents find their new shares of it with the
    rate alpha / x of AIMD; both are neglected, and assumed short in comparison.  Shares follow as the total
    does where costs are quadratic, since response probabilities do not depend on averages then.  For steeper
    ones see `share_rates`.

    Examples
    --------
    >>> [round(recovery_time(1.0, 0.5, 1000.0, **memory), 1) for memory in ({}, {"window": 200.0})]
    [19000.0, 190.0]
    >>> round(recovery_time(1.0, 0.5, 1000.0, gain=5.0), 1)
    820.6
    """
    old, new = _positive("before", before), _positive("after", after)
    near = validation.number("within", within, low=0.0, low_open=True, high=1.0, high_open=True)
    length = validation.number("ramp", ramp, low=0.0)
    middle = 0.5 * length * (1.0 + (1.0 / validation.integer("steps", steps, low=1) if steps else 0.0))
    power = _positive("gain", gain)
    begin = _positive("age", age)
    past = _mean_age(begin, length, steps, power)
    if (window is not None) + (time_constant is not None) + (power != 1.0) > 1:
        given = {"window": window, "time_constant": time_constant, "gain": gain}
        raise InputError.of("memories", given, "one of them")
    if abs(old - new) <= near * new:
        return 0.0
    left = near * new / abs(old - new)
    if time_constant is not None:
        tau = _positive("time_constant", time_constant)
        shape = length / tau
        bend = 0.5 * shape + math.log(-math.expm1(-shape) / shape) if shape > 0.0 else 0.0
        late = middle + tau * bend  # log(sinh(D / 2 tau) / (D / 2 tau)), which does not overflow
        fresh = -math.expm1(-past / tau)  # 1 - q, also where the run is much younger than the memory
        return late + tau * math.log1p(fresh * (1.0 - left) / left)
    if window is None or past < left * _positive("window", window):  # there before a window is full
        return past * float(left ** (-1.0 / power)) - begin
    if length > 2.0 * window * left:
        return window + 2.0 * middle - math.sqrt(4.0 * middle * window * left)
    return middle + window * (1.0 - left)


def _mean_age(begin: float, ramp: float, steps: int | None, power: float) -> float:
    """Compute the power mean of the ages at which parts of a ramp come."""
    if ramp == 0.0:
        return begin
    if steps:
        ages = begin + ramp * np.arange(1, steps + 1) / steps
        return float(ages[-1] * np.mean((ages / ages[-1]) ** power) ** (1.0 / power))
    end, whole = begin + ramp, (begin / (begin + ramp)) ** (power + 1.0)
    return float(end * ((1.0 - whole) * end / ((power + 1.0) * ramp)) ** (1.0 / power))


def elasticity(problem: Problem, allocation: npt.ArrayLike) -> FloatArray:
    r"""Compute how steep the derivatives of the costs are.

    .. math::

        e = \frac{x f''}{f'}

    Parameters
    ----------
    problem : Problem
        The agents' costs.
    allocation : array_like, shape (n, m)
        x > 0, in units of the resources.

    Returns
    -------
    ndarray, shape (n, m)
        1 for quadratic costs, q - 1 for those of power q.

    Raises
    ------
    InputError
        If the allocation has another shape or is not positive.
    """
    validation.instance("problem", problem, Problem, "a Problem")
    shape = problem.n_agents, problem.n_resources
    x = validation.array("allocation", allocation, shape, low=0.0, low_open=True)
    return np.asarray(x * np.einsum("ijj->ij", problem.costs.hessian(x)) / problem.costs.gradient(x))


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
    r"""Coefficient of variation of an agent's average in the steady state.

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
    Demand has the squared coefficient of variation v = (1 - beta) / (1 + beta), and forgets at the rate
    kappa = alpha / x. That of the average is v / (1 + kappa tau) with forgetting. With a window it is 2 v
    / (kappa W) (1 - (1 - exp(-kappa W)) / (kappa W)): for long memories as much for W = 2 tau. With an
    elasticity the average acts back on the response probability, to the power e - 1, and what remains is,
    linearised,

    .. math::

        \frac{1 - \beta}{2 e (1 + \kappa \tau) - (1 - \beta)(1 + e \kappa \tau)},

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
    like exp(-s t / tau) with these s; with averages over all of the run like t**-s.  They are the roots
    of sum_i x_i / (e_i - s) = 0, so there is one between any two neighbouring elasticities e_i (see
    `elasticity`). Costs of one power q have all rates e = q - 1; quadratic ones have 1, the rate of the
    total itself.  A window has no such rates, but e - 1 is its feedback as well.

    Linear; for memories that are long against the time x_i / alpha_i in which agents find a new share, and
    agents of which none holds most of the total.  Weights that loss, alpha and beta give to the costs do not
    matter.
    """
    steep, x = elasticity(problem, allocation), np.asarray(allocation, dtype=np.float64)
    if not problem.costs.separable:
        raise InputError.of("costs", type(problem.costs).__name__, "such that they do not couple resources")
    n, m = x.shape
    rates = np.empty((n - 1, m))
    for j in range(m):
        # In deviations over sqrt(x_i) the system is symmetric: the elasticities, seen at right angles
        # to u = sqrt(x / sum x), which the common signals hold fixed.
        unit = np.sqrt(x[:, j] / x[:, j].sum())
        across = np.linalg.qr(np.column_stack([unit, np.eye(n)]))[0][:, 1:]
        rates[:, j] = np.linalg.eigvalsh(across.T @ (steep[:, j, None] * across))
    return rates


def _positive(name: str, value: float) -> float:
    return validation.number(name, value, low=0.0, low_open=True)


def _chance(probability: npt.ArrayLike) -> FloatArray:
    """Check response probabilities, of which 0 is one here."""
    values = np.asarray(probability, dtype=np.float64)
    if not ((values >= 0.0) & (values <= 1.0)).all():
        raise InputError.of("probability", probability, "at least 0 and at most 1")
    return values
