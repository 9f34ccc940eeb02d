"""What a single resource comes to on either side of the critical loss: held, or run away."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.dynamics.demand import Dynamics
from aimd_des.problem.optimum import solve_optimum
from aimd_des.problem.problem import Problem
from aimd_des.theory.allocations import allocation_at
from aimd_des.theory.losses import critical_loss, runaway_multiplier
from aimd_des.theory.prediction import predict
from aimd_des.theory.signals import signal_rate
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray


class SteadyTotal(NamedTuple):
    """Where total demand of one resource comes to rest.

    Attributes
    ----------
    signals : float
        Per unit of time, or per step on the discrete clock.
    utilisation : float
        Mean total demand over the capacity, above 1 where demand runs away.
    """

    signals: float
    utilisation: float


def needed_rate(problem: Problem, *, capacity: npt.ArrayLike | None = None) -> FloatArray:
    """Compute rho, the signals that hold a capacity, at the optimum for it.

    Parameters
    ----------
    problem : Problem
        Its increases and decreases are the same for all agents.
    capacity : array_like, shape (m,), optional
        Capacities > 0 to use instead of the problem's: the totals that are used.

    Returns
    -------
    ndarray, shape (m,)
        Signals per unit of time of continuous agents, without loss: `signal_rate` at the multipliers.

    Raises
    ------
    InputError
        If increases or decreases differ from agent to agent, or the capacity is not positive.
    """
    for name, values in (("increase", problem.increase), ("decrease", problem.decrease)):
        if (values != values[0]).any():
            raise InputError.of(name, np.unique(values).tolist(), "the same for all agents", "see predict")
    mu = solve_optimum(problem, capacity=capacity).multipliers
    return signal_rate(problem.increase[0], problem.decrease[0], problem.normalization, mu)


def steady_total(
    problem: Problem,
    dynamics: Dynamics = "continuous",
    *,
    hold_off: float = 1.0,
    latency: float = 0.0,
    loss: float = 0.0,
    repeats: bool = False,
) -> SteadyTotal:
    """Predict signals and mean total demand, below the critical loss and beyond it.

    Parameters
    ----------
    problem : Problem
        One resource, with the same increase and decrease for all agents.
    dynamics : {"discrete", "continuous"}
        Agents that act at ticks of one common clock of period 1, or agents that grow all the time.
    hold_off : float
        r >= 0, the least time between two signals; 1 on the clock.
    latency, loss : float
        As of `predict`, the same for all agents.
    repeats : bool
        Whether `predict` is told of the hold-off, for continuous agents: signals that repeat then count.

    Returns
    -------
    SteadyTotal
        NaN where there is no formula: next to the critical loss, and where responses are cut off at 1.

    Raises
    ------
    InputError
        If an argument is outside its range, the problem has several resources, or agents differ.

    Notes
    -----
    Below the critical loss that is `predict`; beyond it the total of `allocation_at` for the
    `runaway_multiplier`, with a signal at each opportunity, at any latency.

    Examples
    --------
    >>> from aimd_des import PolynomialCosts, Resource
    >>> memory = Resource("memory", capacity=20.0, increase=0.02, decrease=0.5, normalization=0.1)
    >>> problem = Problem([memory], PolynomialCosts([2], [[[1.0]]] * 20))
    >>> [round(steady_total(problem, loss=p).utilisation, 2) for p in (0.0, 0.9)]
    [0.94, 2.0]
    """
    if problem.n_resources != 1:
        raise InputError.of("number of resources", problem.n_resources, "1", "take one at a time")
    hold_off = validation.number("hold_off", hold_off, low=0.0)
    if loss < critical_loss(needed_rate(problem), dynamics, hold_off=hold_off)[0]:
        known = hold_off if repeats else None
        try:
            expected = predict(problem, dynamics, latency=latency, loss=loss, hold_off=known)
        except InputError:  # so near the critical loss that signals do not suffice after all
            return SteadyTotal(np.nan, np.nan)
        if expected.signals[0] * hold_off >= 1.0:
            return SteadyTotal(np.nan, np.nan)
        return SteadyTotal(float(expected.signals[0]), float(expected.utilisation[0]))
    alpha, beta, gamma = problem.increase[0], problem.decrease[0], problem.normalization
    mu = runaway_multiplier(alpha, beta, gamma, loss, dynamics, hold_off=hold_off)
    held = allocation_at(problem, mu)
    cut_off = (gamma * mu / held > 1.0).any()
    return SteadyTotal(1.0 / hold_off, np.nan if cut_off else float(held.sum() / problem.capacity[0]))
