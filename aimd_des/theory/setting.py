"""What a prediction is asked for, checked once: a problem, its agents, its control unit and its channel."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des import checks
from aimd_des.checks import FloatArray
from aimd_des.errors import InputError
from aimd_des.problem import Problem
from aimd_des.theory.arguments import Dynamics, check_dynamics

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
    refractory : float, optional
        As given to `predict`.
    offset : ndarray, shape (m,), optional
        Mean of total demand above its threshold, in units of growth, where it is known already.
    """

    problem: Problem
    discrete: bool
    latency: float
    period: float
    loss: FloatArray
    refractory: float | None
    offset: FloatArray | None = None


def check_setting(
    problem: Problem,
    dynamics: Dynamics,
    *,
    latency: float,
    period: float,
    loss: npt.ArrayLike,
    refractory: float | None,
) -> Setting:
    """Check the arguments of `predict`.

    Parameters
    ----------
    problem, dynamics, latency, period, loss, refractory
        As there.

    Returns
    -------
    Setting
        The same, clean.

    Raises
    ------
    InputError
        If one is outside its range, or two do not go together.
    """
    checks.instance("problem", problem, Problem, "a Problem")
    check_dynamics(dynamics)
    delay = checks.number("latency", latency, low=0.0)
    look = checks.number("period", period, low=0.0)
    if dynamics == "discrete" and look not in (0.0, 1.0):
        raise InputError.of("period", look, "left out on the discrete clock, where it is 1")
    if refractory is not None:
        refractory = checks.number("refractory", refractory, low=0.0)
        if dynamics == "discrete" or look > 0.0:
            raise InputError.of("refractory", refractory, "left out for a control unit that samples")
        if delay > _MOST_ON_THE_WAY * refractory:
            remedy = "the control unit would repeat its signal many times before the first arrives"
            raise InputError.of("refractory", refractory, f"at least latency / {_MOST_ON_THE_WAY}", remedy)
    lost = checks.per_agent("loss", loss, low=0.0, high=1.0, high_open=True)
    checks.fits("loss", lost, problem.n_agents)
    column = np.full((problem.n_agents, 1), lost) if np.ndim(lost) == 0 else np.reshape(lost, (-1, 1))
    return Setting(problem, dynamics == "discrete", delay, look, np.asarray(column), refractory)
