"""The steady state of a system in which cameras come and go, in closed form but for one root."""

from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from aimd_des import PolynomialCosts, Problem, solve_optimum, theory
from aimd_des.lowlevel import FloatArray
from scenarios.churn.runs import ALPHA, CAPACITY, GROUP, LATENCY, PRESENT, PROBLEM, N, Size, together_event
from scenarios.common.fluid import flow
from scenarios.common.systems import elasticity

#: Of those who are present on average: what they can grow to before they go is the capacity.
CRITICAL_STAY = CAPACITY / (PRESENT * N * ALPHA)

# Signals per unit of time between which there is an answer.
_FEWEST, _MOST = 1e-4, 3.0
# Elasticities of costs that are as steep as each other.
_ALIKE = 1e-6


class Steady(NamedTuple):
    """What is expected."""

    signals: float  # h, per unit of time
    utilisation: float  # mean total demand over the capacity
    share: FloatArray  # (n,): mean demand of a camera while it is present, in units of the resource


@lru_cache
def steady(stay: float) -> Steady:
    """Predict the steady state under churn, by balance of each camera and of the total.

    A camera gains alpha and loses h (1 - beta) lambda x by signals and x / T by going: it tends to
    f'(x) + c x = alpha / k with k = h (1 - beta) Gamma and c = 1 / (k T).  The total lies below the capacity
    as the work in a queue: by what signals take (with vacations), and by what those take away who
    leave (Pollaczek and Khinchine).

    Neglects that the number of those present wanders, and that it takes a while to learn an average.
    The stay is T, the mean time for which a camera is there, and may be infinite.
    """
    excess = partial(_excess, stay=stay)
    signals = float(np.exp(brentq(excess, np.log(_FEWEST), np.log(_MOST), xtol=1e-12)))
    share = _balance(signals, stay)[1]
    return Steady(signals, float(PRESENT * share.sum() / CAPACITY), share)


def _excess(log_signals: float, stay: float) -> float:
    """Compute how far those present are above the level that so many signals leave: more signals, less."""
    level, share = _balance(float(np.exp(log_signals)), stay)
    return float(PRESENT * share.sum() - level)


def _balance(signals: float, stay: float) -> tuple[float, FloatArray]:
    """Compute where the total would be with so many signals, and what the cameras tend to."""
    cut, gamma = 1.0 - float(PROBLEM.decrease[0, 0]), float(PROBLEM.normalization[0])
    k = signals * cut * gamma
    x = theory.allocation_at(_with_churn(1.0 / (k * stay)), np.array([ALPHA / k]))[:, 0]
    leaving = 1.0 / stay
    answers = (ALPHA / x - leaving) / cut  # h lambda
    square = 2.0 * ALPHA * x / (answers * (1.0 - (1.0 - cut) ** 2) + leaving)
    chance = answers / signals
    taken = PRESENT * (cut * chance * x).sum()
    spread = PRESENT * (chance * cut**2 * square - (chance * cut * x) ** 2).sum()
    growth = PRESENT * N * ALPHA
    below = 0.5 * (taken + spread / taken) - growth * LATENCY
    spare = growth - leaving * PRESENT * x.sum()
    below += 0.5 * leaving * PRESENT * square.sum() / max(spare, 1e-12)
    return CAPACITY - below, x


@lru_cache
def _with_churn(weight: float) -> Problem:
    """Add weight x^2 / 2 to all costs."""
    costs = PROBLEM.costs
    assert isinstance(costs, PolynomialCosts)  # noqa: S101 - the model's costs are
    coefficients = costs.coefficients.copy()
    coefficients[:, :, list(costs.exponents).index(2)] += 0.5 * weight
    return Problem(PROBLEM.resources, PolynomialCosts(costs.exponents, coefficients))


@lru_cache
def _level() -> float:
    return float(theory.predict(PROBLEM, "continuous", latency=LATENCY).utilisation[0]) * CAPACITY


@lru_cache
def optimum() -> FloatArray:
    """Compute the optimum of all cameras for what is used without churn, (n,)."""
    return np.asarray(solve_optimum(PROBLEM, capacity=np.array([_level()])).allocation[:, 0])


@lru_cache
def kinds() -> dict[str, list[int]]:
    """Sort cameras by who comes back, with which costs, and who has stayed."""
    steep = elasticity(PROBLEM, solve_optimum(PROBLEM).allocation)[:, 0]
    return {
        "returning, quadratic costs": [i for i in GROUP if steep[i] < 1.0 + _ALIKE],
        "returning, costs of power 6": [i for i in GROUP if steep[i] > 5.0 - _ALIKE],
        "those who stayed": [i for i in range(N) if i not in GROUP],
    }


@lru_cache
def fluid(name: str, size: Size) -> tuple[FloatArray, FloatArray]:
    """Compute what the fluid does where a quarter leaves together: demand and averages, (q, n)."""
    path = flow(PROBLEM, _level(), size.end, interventions=[together_event(name, size)])
    # Observers look just after an intervention.
    at = np.minimum(np.searchsorted(path.time, size.times) + 1, len(path.time) - 1)
    return path.demand[at], path.average[at]
