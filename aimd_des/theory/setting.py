"""What a prediction is asked for, checked once: a problem, its agents, its control unit and its channel."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.dynamics.demand import Dynamics
from aimd_des.dynamics.responses import FULL, Response, ResponseParameters
from aimd_des.problem.problem import Problem
from aimd_des.theory.arguments import check_dynamics
from aimd_des.theory.response_rule import check_response
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

_MOST_ON_THE_WAY = 100
# The exact moments of so many agents take tenths of a second; with more the first order misses little.
_FEW = 200


class Following(NamedTuple):
    """How averages over time follow what signals find where all agents sway together, both (n, m)."""

    mean: FloatArray  # derivative of the one by the other
    noise: FloatArray  # the same for draws, as a root of the mean square: not all signals find alike


class Setting(NamedTuple):
    """What stays the same over the rounds."""

    problem: Problem  # what is shared
    discrete: bool  # whether agents act at ticks
    # As given to `predict`.
    latency: float
    period: float
    loss: FloatArray  # (n, 1): as given to `predict`, one for each agent
    hold_off: float | None  # as given to `predict`
    # (m,): total demand above its threshold at the signals that act, in units of growth.  At first what it is
    # where nearly every look has a signal.
    found: FloatArray
    mean: FloatArray | None  # (m,): the same in the mean over time; none where signals do not come late
    response: ResponseParameters  # how a signal is answered
    exact: bool  # whether averages come from exact moments
    # (n, m): on the clock: variance of the mean of an agent's demand over its draws, at the signals that act.
    sway: FloatArray | None = None
    following: Following | None = None  # where that is not 1 because agents sway

    @property
    def crossing(self) -> bool:
        """Whether one exact crossing is one signal."""
        return not self.discrete and self.period == 0.0 and self.hold_off is None

    @property
    def has_moments(self) -> bool:
        """Whether exact moments are known, and do not take long."""
        # Full cuts at regular numbers of signals are not drawn anew at each of them, as the moments have it.
        return self.problem.n_agents <= _FEW and self.response.cut != FULL


def check_setting(
    problem: Problem,
    dynamics: Dynamics,
    *,
    latency: float,
    period: float,
    loss: npt.ArrayLike,
    hold_off: float | None,
    response: Response | None = None,
) -> Setting:
    """Check the arguments of `predict`."""
    validation.instance("problem", problem, Problem, "a Problem")
    how = check_response(response)
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
    setting = Setting(
        problem, discrete, delay, look, np.asarray(column), hold_off, start, start, how, exact=False
    )
    if discrete:
        return setting
    exact = setting._replace(exact=setting.has_moments)
    return exact._replace(mean=None) if setting.crossing else exact


def _offset(discrete: bool, latency: float, period: float) -> float:
    """Compute how far the total is above its threshold where a signal acts, if nearly every look has one."""
    if discrete:
        return 0.5 * (math.ceil(latency) + 1)
    lag = max(math.ceil(latency / period) - 1, 0) if period > 0.0 else 0
    return latency - 0.5 * lag * period
