r"""Random convex problems of any size, made around an optimum that is known.

With y^j = x^j / s^j, the demand of a resource in multiples of a scale s^j, agent i has the cost

    f_i = sum_jp c_ijp (y^j)^p + y' Q_i y / 2 + g_i2 z^2 + g_i3 z^3,   p in {2, 3, 4}, z = w_i . y.

What is drawn first is where the optimum shall be: y_i^j uniform on 0.4 to 1.6.  Then an interaction is
drawn for each agent, a quadratic form Q = B B' and a convex function of a weighted sum. Each is scaled so
that the largest of its derivatives at y_i is 0.1 to 0.4.  Last come powers of each demand by itself, in
random parts, and make up what is lacking to

    df_i / dy^j = 1   at y_i, for every agent and resource.

These are the Karush-Kuhn-Tucker conditions with multipliers nu^j = 1 / s^j, if the capacities are the sums
of what was drawn.  Costs are strictly convex, so this is the one optimum; no agent is at a bound there.
Response probabilities at it are Gamma^j nu^j / x_i^j: they differ by a factor of four at most.
"""

import numpy as np

from aimd_des import CoupledCosts, InputError, PolynomialCosts, Problem, Resource, checks, lowlevel, model
from aimd_des.lowlevel import FloatArray, Purpose

__all__ = ["random_convex", "random_optimum"]

_EXPONENTS = (2, 3, 4)
_SUM_EXPONENTS = (2, 3)
_OPTIMUM = (0.4, 1.6)
# Two kinds of interaction: together at most 0.8 of a derivative, so that 0.2 at least is left to add.
_INTERACTION = (0.1, 0.4)
# No part vanishes: the square keeps the cost strictly convex, the others keep it from being quadratic.
_PARTS = (0.1, 1.0)
# Scales span two powers of ten, so that nothing gets by with units near 1.
_LOG_SCALE = (-1.0, 1.0)
_STEPS = (0.75, 1.25)
_DECREASE = (0.4, 0.7)


def _between(bounds: tuple[float, float], uniform: FloatArray) -> FloatArray:
    return np.asarray(bounds[0] + (bounds[1] - bounds[0]) * uniform)


def _draw(seed: int, n: int, m: int) -> tuple[FloatArray, FloatArray]:
    """Draw uniform numbers: three rows for the resources, (3, m), then one row for each agent.

    Rows of agents come last, so that the first of them stay when more are added.
    """
    generator = lowlevel.generator(seed, Purpose.PROBLEM)
    of_resources = generator.random((3, m))
    return of_resources, generator.random((n, 5 * m + 3 + m * m))


def _quadratic(optimum: FloatArray, factors: FloatArray, size: FloatArray) -> FloatArray:
    """Make positive semidefinite forms whose largest derivative at the optimum is `size`: (n, m, m)."""
    n, m = optimum.shape
    roots = factors.reshape(n, m, m)
    forms = roots @ roots.transpose(0, 2, 1)
    largest = np.einsum("ijk,ik->ij", forms, optimum).max(axis=1)
    return np.asarray(forms * (size / largest)[:, None, None])


def _of_sum(
    optimum: FloatArray, weights: FloatArray, part: FloatArray, size: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Make weights with a largest of 1, and g2 z^2 + g3 z^3 with the slope `size` at the optimum."""
    normed = weights / weights.max(axis=1, keepdims=True)
    z = (normed * optimum).sum(axis=1)
    coefficients = [size * part / (2.0 * z), size * (1.0 - part) / (3.0 * z**2)]
    return normed, np.stack(coefficients, axis=1)


def _separable(optimum: FloatArray, parts: FloatArray, slope: FloatArray) -> FloatArray:
    """Make powers of each demand with derivatives `slope`, (n, m), at the optimum: (n, m, 3)."""
    shares = parts / parts.sum(axis=2, keepdims=True)
    unit = np.stack([p * optimum ** (p - 1) for p in _EXPONENTS], axis=2)
    return np.asarray(slope[:, :, None] * shares / unit)


def _costs(draws: FloatArray, scale: FloatArray, coupled: bool) -> PolynomialCosts | CoupledCosts:
    """Make costs of one row of uniform numbers an agent."""
    n, m = len(draws), len(scale)
    where, parts, weights, sizes, factors = np.split(draws, np.cumsum([m, 3 * m, m, 3]), axis=1)
    optimum = _between(_OPTIMUM, where)
    own = _between(_PARTS, parts).reshape(n, m, 3)
    powers = np.stack([scale**p for p in _EXPONENTS], axis=1)
    if not coupled:
        return PolynomialCosts(_EXPONENTS, _separable(optimum, own, np.ones((n, m))) / powers)
    size = _between(_INTERACTION, sizes[:, :2])
    forms = _quadratic(optimum, factors, size[:, 0])
    weighing, of_sum = _of_sum(optimum, _between(_PARTS, weights), sizes[:, 2], size[:, 1])
    slope = 1.0 - np.einsum("ijk,ik->ij", forms, optimum) - weighing * size[:, 1:]
    return CoupledCosts(
        PolynomialCosts(_EXPONENTS, _separable(optimum, own, slope) / powers),
        quadratic=forms / np.outer(scale, scale),
        weights=weighing / scale,
        sum_exponents=_SUM_EXPONENTS,
        sum_coefficients=of_sum,
    )


@model
def random_convex(
    seed: int = 0,
    n_agents: int = 20,
    n_resources: int = 2,
    coupled: bool = True,
    probability: float = 0.25,
    steps: float = 60.0,
) -> Problem:
    """Draw a convex problem.

    Parameters
    ----------
    seed : int
        Decides everything that is drawn, at least 0.
    n_agents : int
        n.  The first agents stay as they are when more are added, and so does everything except the
        capacities.
    n_resources : int
        m.  Each number of resources is another draw.
    coupled : bool
        Whether resources interact within a cost (`CoupledCosts`) or not (`PolynomialCosts`).  The optimum
        is the same.
    probability : float
        0 < probability <= 1: up to this response probabilities go at the optimum, the least being about a
        quarter of it.  It leads to Gamma.
    steps : float
        About how many steps, or units of time, go by until the capacities are reached for the first time;
        at least 1.  Each resource takes 0.75 to 1.25 times as many, and for few agents up to 1.6 times.

    Returns
    -------
    Problem
        Resources "resource 0" and so on, without a unit. Capacities are about 0.1 to 10 per agent, and
        0.4 <= beta < 0.7. As alpha and beta are the same for all agents, averages tend to the optimum.

    Raises
    ------
    InputError
        If an argument is outside its range.

    See Also
    --------
    random_optimum : The optimum, by which the problem is made.

    Notes
    -----
    A signal takes (1 - beta) Gamma nu off every agent in the mean, so there are about 1 / (0.4
    probability (1 - beta) steps) signals per unit of time. With the defaults that is at most 0.74, few
    enough for a control unit that samples once per unit.  Smaller arguments may ask for more than there
    can be.

    Examples
    --------
    >>> from aimd_des import solve_optimum
    >>> problem = random_convex(seed=1, n_agents=50, n_resources=3, probability=0.25)
    >>> known = random_optimum(seed=1, n_agents=50, n_resources=3)
    >>> bool(np.allclose(solve_optimum(problem).allocation, known))
    True
    >>> chance = problem.normalization * problem.costs.gradient(known) / known
    >>> bool(0.0625 < chance.min() < 0.07), bool(0.23 < chance.max() < 0.25)
    (True, True)
    """
    n, m = _sizes(n_agents, n_resources)
    if not isinstance(coupled, bool | np.bool_):
        raise InputError.of("coupled", coupled, "True or False")
    largest = checks.number("probability", probability, low=0.0, high=1.0, low_open=True)
    duration = checks.number("steps", steps, low=1.0)
    of_resources, draws = _draw(seed, n, m)
    scale = 10.0 ** _between(_LOG_SCALE, of_resources[0])
    increase = scale / (duration * _between(_STEPS, of_resources[1]))
    decrease = _between(_DECREASE, of_resources[2])
    # The largest lambda is Gamma nu / x with nu = 1 / s and x = 0.4 s.
    normalization = largest * _OPTIMUM[0] * scale**2
    capacity = (_between(_OPTIMUM, draws[:, :m]) * scale).sum(axis=0)
    resources = [
        Resource(f"resource {j}", capacity[j], increase[j], decrease[j], normalization[j]) for j in range(m)
    ]
    return Problem(resources, _costs(draws, scale, bool(coupled)))


def random_optimum(seed: int = 0, n_agents: int = 20, n_resources: int = 2) -> FloatArray:
    """Say where the optimum of a random problem is, without solving for it.

    Parameters
    ----------
    seed, n_agents, n_resources : int
        As for `random_convex`.

    Returns
    -------
    ndarray, shape (n, m)
        x*, in units of the resources; exact but for rounding.

    Raises
    ------
    InputError
        If an argument is outside its range.
    """
    of_resources, draws = _draw(seed, *_sizes(n_agents, n_resources))
    optimum = _between(_OPTIMUM, draws[:, : of_resources.shape[1]])
    return np.asarray(optimum * 10.0 ** _between(_LOG_SCALE, of_resources[0]))


def _sizes(n_agents: int, n_resources: int) -> tuple[int, int]:
    return checks.integer("n_agents", n_agents, low=1), checks.integer("n_resources", n_resources, low=1)
