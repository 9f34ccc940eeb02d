"""What is expected where cameras come and go, or a quarter of them leaves and comes back."""

from functools import lru_cache

import numpy as np

from aimd_des import solve_optimum, theory
from aimd_des.interventions import Crash
from aimd_des.lowlevel import FloatArray
from scenarios.churn.runs import ALPHA, CAPACITY, FORGOT, GROUP, LATENCY, PRESENT, PROBLEM, N, Size
from scenarios.common.systems import alike

#: Of those who are present on average: what they can grow to before they go is the capacity.
CRITICAL_STAY = CAPACITY / (PRESENT * N * ALPHA)


@lru_cache
def steady(stay: float) -> theory.Churn:
    """Predict the steady state with a mean stay."""
    return theory.churn(PROBLEM, stay, PRESENT, LATENCY)


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
    return {
        "returning, quadratic costs": [i for i in alike(PROBLEM, 1.0) if i in GROUP],
        "returning, costs of power 6": [i for i in alike(PROBLEM, 5.0) if i in GROUP],
        "those who stayed": [i for i in range(N) if i not in GROUP],
    }


@lru_cache
def fluid(name: str, size: Size) -> tuple[FloatArray, FloatArray]:
    """Compute what the fluid does where a quarter leaves together: demand and averages, (q, n)."""
    away = theory.Spell(size.leave, size.back, GROUP, forgets=FORGOT[name] is Crash)
    path = theory.flow(PROBLEM, _level(), size.end, spells=[away])
    # Observers look just after an intervention.
    at = np.minimum(np.searchsorted(path.time, size.times) + 1, len(path.time) - 1)
    return path.demand[at], path.average[at]
