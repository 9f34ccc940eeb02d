r"""What a latency that is long against the hold-off does: total demand runs through a limit cycle.

The control unit knows nothing of signals on their way.  From a crossing on it repeats its signal, once in
a hold-off r, until the total is seen below the threshold; the first acts d later, and those that are on
their way then act for d more.  That is relay feedback with a delay, and with many signals in a row chance
evens out:

- an agent whose signals find it with y grows by alpha r from one to the next, and each takes kappa y of it in
  the mean, so that over a row of them y falls towards alpha r / kappa, by the factor q = 1 - kappa at each;
- after N signals it grows for M besides: y starts the next row at alpha r / kappa + alpha M / (1 - q^N);
- all these starts add up to the threshold and the growth over the latency, which gives M;
- N is the number that were sent before the total had fallen: ceil(d / r), and the m - 1 that follow until the
  m-th brings it below the threshold.

Given when signals act, the mean of an agent's demand is exactly that, however its cuts are drawn.  What is
neglected is that the times themselves are random.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from aimd_des.problem.optimum import solve_optimum
from aimd_des.problem.problem import Problem
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError, SimulationError
from aimd_des.utils.validation import FloatArray

_TOLERANCE = 1e-9
_MAX_ROUNDS = 500
# Latencies of whole hold-offs are counted as such for any last bit of their ratio.
_WHOLE = 1e-9
_LONGEST_ROW = 1e7


@dataclass(frozen=True, eq=False)
class LimitCycle:
    """How demand comes and goes behind a latency.

    Attributes
    ----------
    signals : ndarray, shape (m,)
        Broadcasts per unit of time.
    row : ndarray, shape (m,)
        N, signals in a row.
    period : ndarray, shape (m,)
        Of the cycle, in units of time.
    lowest, highest : ndarray, shape (m,)
        Of total demand, over the capacity.
    utilisation : ndarray, shape (m,)
        Sum of the averages over the capacity.
    allocation : ndarray, shape (n, m)
        Averages, in units of the resources.
    """

    signals: FloatArray
    row: FloatArray
    period: FloatArray
    lowest: FloatArray
    highest: FloatArray
    utilisation: FloatArray
    allocation: FloatArray


class _Cycle(NamedTuple):
    """One resource."""

    row: float
    period: float
    low: FloatArray  # (n,): after the row
    high: FloatArray  # (n,): before it
    average: FloatArray  # (n,): over the period


def limit_cycle(
    problem: Problem, hold_off: float, latency: float, *, loss: npt.ArrayLike = 0.0
) -> LimitCycle:
    """Predict the swing of total demand, and what it does to the shares, where signals are on their way.

    Parameters
    ----------
    problem : Problem
        What is shared, by continuous agents with the paper's response.
    hold_off : float
        r > 0, of a control unit that senses crossings, in units of time.
    latency : float
        d >= 0, common to all, in units of time.
    loss : float or array_like, shape (n,)
        Probability that a signal is lost on an agent, independent of all else.

    Returns
    -------
    LimitCycle

    Raises
    ------
    InputError
        If an argument is outside its range, or signals do not suffice: then demand runs away.
    SimulationError
        If averages and cycle do not settle on each other.

    Notes
    -----
    Signals on their way take about X = (d / r) n alpha / (rho C) of the capacity, for any demand when
    they act: the lowest total is that much below the capacity, less what grows meanwhile.  All agents
    swing alike, by as much as they grow, so those with small shares swing most and get too much. So the
    bias that averages over time have without latency first shrinks and then changes its sign.

    Neglects that cuts are random, which matters where rows are short. For r >= d it has one signal for
    each crossing, as `predict` has without a hold-off. Near rho r = 1 it has too few signals and too much
    demand.

    Examples
    --------
    >>> from aimd_des import PolynomialCosts, Resource
    >>> memory = Resource("memory", capacity=20.0, increase=0.02, decrease=0.5, normalization=0.1)
    >>> problem = Problem([memory], PolynomialCosts([2], [[[1.0]]] * 20))
    >>> [limit_cycle(problem, r, latency=5.0).lowest.round(2).tolist() for r in (0.1, 1.0)]
    [[0.03], [0.71]]
    """
    validation.instance("problem", problem, Problem, "a Problem")
    least = validation.number("hold_off", hold_off, low=0.0, low_open=True)
    delay = validation.number("latency", latency, low=0.0)
    lost = validation.per_agent("loss", loss, low=0.0, high=1.0, high_open=True)
    validation.fits("loss", lost, problem.n_agents)
    part = (1.0 - problem.decrease) * np.reshape(1.0 - lost, (-1, 1))
    average = solve_optimum(problem, capacity=problem.limit).allocation
    for _ in range(_MAX_ROUNDS):
        gradient = problem.costs.gradient(average)
        kappa = part * np.minimum(problem.normalization * gradient / average, 1.0)
        cycles = [
            _cycle(float(problem.limit[j]), problem.increase[:, j], kappa[:, j], least, delay)
            for j in range(problem.n_resources)
        ]
        wanted = np.column_stack([cycle.average for cycle in cycles])
        if (np.abs(wanted - average) <= _TOLERANCE * average).all():
            return _made(problem, cycles, wanted)
        # The steeper the costs the more agents answer to their own averages: a whole step would swing.
        curvature = np.abs(problem.costs.hessian(average) * average[:, None, :]).sum(axis=2)
        steepness = np.maximum(curvature / gradient, 1.0)
        average = average * np.clip(wanted / average, 0.5, 2.0) ** (1.0 / steepness)
    raise SimulationError("no limit cycle: averages and cycle do not settle on each other")


def _made(problem: Problem, cycles: list[_Cycle], average: FloatArray) -> LimitCycle:
    row, period = (np.array([getattr(cycle, name) for cycle in cycles]) for name in ("row", "period"))
    lowest, highest = (
        np.array([getattr(cycle, name).sum() for cycle in cycles]) / problem.capacity
        for name in ("low", "high")
    )
    used = average.sum(axis=0) / problem.capacity
    return LimitCycle(row / period, row, period, lowest, highest, used, average)


def _cycle(limit: float, alpha: FloatArray, kappa: FloatArray, hold_off: float, latency: float) -> _Cycle:
    """Find the cycle for given cuts."""
    keep, floor = 1.0 - kappa, alpha * hold_off / kappa
    growth, sent = alpha.sum(), max(math.ceil(latency / hold_off - _WHOLE), 1)
    top, step = limit + growth * latency, growth * hold_off
    if floor.sum() >= limit + step:
        remedy = "demand runs away from the capacity: see critical_loss and runaway_multiplier"
        raise InputError.of("hold_off", hold_off, "short enough for its signals to suffice", remedy)

    def high(row: float) -> tuple[float, FloatArray]:
        per_growth = alpha / (1.0 - keep**row)
        rest = (top - floor.sum()) / per_growth.sum()
        return rest, floor + rest * per_growth

    def left(count: float) -> float:
        """Total above the threshold after `count` signals, by half a cut too early in the mean."""
        found = high(sent - 1.0 + count)[1] - floor
        return float((floor + found * keep ** (count - 0.5)).sum() - step - limit)

    count = 1.0
    if left(count) > 0.0:
        most = 2.0
        while left(most) > 0.0 and most < _LONGEST_ROW:
            most *= 2.0
        count = brentq(left, count, most)
    row = sent - 1.0 + count
    rest, before = high(row)
    low = before - alpha * rest
    period = row * hold_off + rest
    # The sawtooth between signals, each period below its end by half of what it grows, and then the growth.
    ends = row * floor + (before - floor) * keep * (1.0 - keep**row) / kappa
    area = hold_off * (ends - 0.5 * row * alpha * hold_off) + rest * (low + 0.5 * alpha * rest)
    return _Cycle(row, period, low, before, area / period)
