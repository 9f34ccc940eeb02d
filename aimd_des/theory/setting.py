"""What a prediction is asked for, checked once: a problem, its agents, its control unit and its channel."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.problem.problem import Problem
from aimd_des.theory.arguments import Dynamics, check_dynamics
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

__all__ = ["Setting", "check_setting"]

_MOST_ON_THE_WAY = 100


class Setting(NamedTuple):
    """What stays the same over the rounds.

    Attributes
    ----------
    problem : Problem
        What is shared.
    discrete : bool
        Whether agents act at ticks.
    latency, period : float
        As given to `predict`.
    loss : ndarray, shape (n, 1)
        As given to `predict`, one for each agent.
    hold_off : float, optional
        As given to `predict`.
    mean, found : ndarray, shape (m,)
        Total demand above its threshold, in units of growth: the mean over time, and at the signals that
        act.  At first what they are where nearly every look has a signal.
    """

    problem: Problem
    discrete: bool
    latency: float
    period: float
    loss: FloatArray
    hold_off: float | None
    mean: FloatArray
    found: FloatArray

    @property
    def crossing(self) -> bool:
        """Whether one exact crossing is one signal."""
        return not self.discrete and self.period == 0.0 and self.hold_off is None


def check_setting(
    problem: Problem,
    dynamics: Dynamics,
    *,
    latency: float,
    period: float,
    loss: npt.ArrayLike,
    hold_off: float | None,
) -> Setting:
    """Check the arguments of `predict`."""
    validation.instance("problem", problem, Problem, "a Problem")
    check_dynamics(dynamics)
    delay = validation.number("latency", latency, low=0.0)
    look = validation.number("period", period, low=0.0)
    if dynamics == "discrete" and look not in (0.0, 1.0):
        raise InputError.of("period", look, "left out on the discrete clock, where it is 1")
    if hold_off is not None:
        hold_off = validation.number("hold_off", hold_off, low=0.0)
        if dynamics == "discrete" or look > 0.0:
            raise InputError.of("hold_off", hold_off, "left out for a control unit that samples")
        if delay > _MOST_ON_THE_WAY * hold_off:
            remedy = "the control unit would repeat its signal many times before the first arrives"
            raise InputError.of("hold_off", hold_off, f"at least latency / {_MOST_ON_THE_WAY}", remedy)
    lost = validation.per_agent("loss", loss, low=0.0, high=1.0, high_open=True)
    validation.fits("loss", lost, problem.n_agents)
    column = np.full((problem.n_agents, 1), lost) if np.ndim(lost) == 0 else np.reshape(lost, (-1, 1))
    discrete = dynamics == "discrete"
    start = np.full(problem.n_resources, _offset(discrete, delay, look))
    return Setting(problem, discrete, delay, look, np.asarray(column), hold_off, start, start)


def _offset(discrete: bool, latency: float, period: float) -> float:
    """Compute how far the total is above its threshold where a signal acts, if nearly every look has one."""
    if discrete:
        return 0.5 * (math.ceil(latency) + 1)
    lag = max(math.ceil(latency / period) - 1, 0) if period > 0.0 else 0
    return latency - 0.5 * lag * period
