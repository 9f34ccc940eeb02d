r"""What keeps total demand below the capacity: a threshold below it, chosen from what the latency costs.

Peaks stand above the threshold by what all agents grow until a signal acts, and by more where one cut is not
enough or signals are random.  `safe_threshold` lets the total alone (`aimd_des.theory.totals`) run under the
threshold, reads off the level that it exceeds for a given share of the time, and lowers the threshold by
that; as cuts depend on what is used, that is repeated until it rests.
"""

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from aimd_des.dynamics.demand import Dynamics
from aimd_des.problem.problem import Problem
from aimd_des.theory.prediction import check_enough, follow, settle, walked
from aimd_des.theory.setting import Setting, check_setting
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError, SimulationError
from aimd_des.utils.old_keywords import keywords
from aimd_des.utils.validation import FloatArray

# Walks meet long runs of the paper's system to within a fifth of the share of time above a level, the start
# of a run included, so theory aims lower than it may.
_AIM = 0.75
_ROUNDS = 30
_RESTS = 2e-4
_FULL_STEPS = 5


@keywords("refractory")
def safe_threshold(
    problem: Problem,
    dynamics: Dynamics = "discrete",
    *,
    latency: float = 0.0,
    period: float = 0.0,
    hold_off: float | None = None,
    loss: npt.ArrayLike = 0.0,
    exceedance: float = 0.01,
) -> FloatArray:
    """Find the largest threshold with which total demand hardly ever exceeds the capacity.

    Parameters
    ----------
    problem : Problem
        What is shared; its own thresholds do not matter.
    dynamics : {"discrete", "continuous"}
        Agents that act at ticks of one common clock of period 1, or agents that grow all the time.
    latency : float
        d >= 0, common to all agents; on the clock it counts in whole steps, rounded up.
    period : float
        Time between two samples of a control unit that samples, for continuous agents.
    hold_off : float, optional
        Hold-off of a control unit that senses crossings, for continuous agents: this or `period` must be
        given.  It may be shorter than the latency, but not 0 then.
    loss : float or array_like, shape (n,)
        Probability that a signal is lost on an agent, independent of all else.
    exceedance : float
        Share of the time for which total demand may be above the capacity, between 0 and 0.5.

    Returns
    -------
    ndarray, shape (m,)
        gamma, at most 1.

    Raises
    ------
    InputError
        If an argument is outside its range; if signals do not suffice at the capacity or at a threshold that
        is low enough; or if the latency is so long that no threshold is.
    SimulationError
        If the iteration does not come to rest.

    Notes
    -----
    Aims at three quarters of `exceedance`, which leaves room for what is neglected: the start of a run,
    averages that still wander, and latencies that differ.  Near rho * hold_off = 1 (or rho * period), and
    with few agents, that is more: 15 cameras at 0.72 were above the capacity for up to 1.3 % instead of 1 %.
    What the threshold costs is the `utilisation` that `predict` has for a problem with it.

    It bears little error, as nearly every peak is at the capacity: a latency that is longer by 0.2 puts the
    memory of the paper's system above it for 4.4 % of the time.  So give the longest latency that may come,
    and the largest loss; and a hold-off between the bounds of `hold_off_bounds`.

    A hold-off shorter than the latency is taken into account. But a total whose cuts hardly vary can then
    keep to one of several rhythms for long. So single runs may be further below the capacity than
    necessary.

    Examples
    --------
    >>> from aimd_des import PolynomialCosts, Resource
    >>> memory = Resource("memory", capacity=20.0, increase=0.02, decrease=0.5, normalization=0.1)
    >>> problem = Problem([memory], PolynomialCosts([2], [[[1.0]]] * 20))
    >>> [safe_threshold(problem, latency=latency).round(2).tolist() for latency in (0, 1, 2)]
    [[0.98], [0.96], [0.94]]
    """
    share = validation.number("exceedance", exceedance, low=0.0, low_open=True, high=0.5)
    setting = _checked(problem, dynamics, latency, period, hold_off, loss)
    threshold = np.ones(problem.n_resources)
    for turn in range(_ROUNDS):
        setting = setting._replace(problem=_with(problem, threshold))
        expected = settle(setting)
        if turn > 0:
            check_enough(setting, expected.signals)
        walks = follow(setting, expected)
        setting = walked(setting, walks)
        peaks = np.array([walk.level_exceeded(_AIM * share) for walk in walks])
        wanted = np.minimum(1.0 - peaks * problem.increase.sum(axis=0) / problem.capacity, 1.0)
        if (wanted <= 0.0).any():
            raise InputError.of(
                "latency",
                setting.latency,
                "short enough for some threshold to be low enough",
                "all agents together grow by more than the capacity before a signal acts",
            )
        # Shorter and shorter steps, since the walks are not quite a smooth function of the threshold.
        step = (wanted - threshold) / (1 + turn // _FULL_STEPS)
        if (np.abs(step) <= _RESTS).all():
            return np.asarray(wanted)
        threshold = threshold + step
    raise SimulationError(f"no threshold: it does not settle, last {threshold.tolist()}")


def time_above(
    problem: Problem,
    levels: npt.ArrayLike,
    dynamics: Dynamics = "discrete",
    *,
    latency: float = 0.0,
    period: float = 0.0,
    hold_off: float | None = None,
    loss: npt.ArrayLike = 0.0,
) -> FloatArray:
    """Predict the share of time for which total demand is above levels.

    Parameters
    ----------
    problem : Problem
        What is shared, with its thresholds.
    levels : array_like, shape (q,)
        Over the capacity.
    dynamics : {"discrete", "continuous"}
        As of `safe_threshold`, and so are the other parameters.
    latency, period : float
        In units of time.
    hold_off : float, optional
        Of continuous agents, in units of time.
    loss : float or array_like, shape (n,)
        Probability of loss.

    Returns
    -------
    ndarray, shape (q, m)
        0 to 1.  Shares below 1e-4 are of few of the 60,000 signals that are followed, and 0 of none.

    Raises
    ------
    InputError
        If an argument is outside its range, or signals do not suffice.
    SimulationError
        If the iteration does not come to rest.

    Notes
    -----
    Of the total alone, as for `safe_threshold`, with what is neglected there.

    Examples
    --------
    >>> from aimd_des import PolynomialCosts, Resource
    >>> memory = Resource("memory", capacity=20.0, increase=0.02, decrease=0.5, normalization=0.1)
    >>> problem = Problem([memory], PolynomialCosts([2], [[[1.0]]] * 20))
    >>> time_above(problem, [1.0, 1.05], latency=1.0).round(2).ravel().tolist()
    [0.17, 0.0]
    """
    ratios = validation.array("levels", levels, ("n_levels",))
    setting = _checked(problem, dynamics, latency, period, hold_off, loss)
    expected = settle(setting)
    check_enough(setting, expected.signals)
    # Above the threshold, in units of growth: a row for each level.
    above = (ratios[:, None] - problem.threshold) * problem.capacity / problem.increase.sum(axis=0)
    walks = follow(setting, expected)
    found = [
        [walk.time_above(level) for walk, level in zip(walks, row, strict=True)] for row in above.tolist()
    ]
    return np.asarray(found).reshape(above.shape)


def _checked(
    problem: Problem,
    dynamics: Dynamics,
    latency: float,
    period: float,
    hold_off: float | None,
    loss: npt.ArrayLike,
) -> Setting:
    """Check what walks are made of."""
    setting = check_setting(problem, dynamics, latency=latency, period=period, loss=loss, hold_off=hold_off)
    if not setting.discrete and setting.period == 0.0 and hold_off is None:
        raise InputError.of("hold_off", hold_off, "given, or else the period, for continuous agents")
    return setting


def _with(problem: Problem, threshold: FloatArray) -> Problem:
    """Make the same problem with other thresholds."""
    resources = [
        dataclasses.replace(resource, threshold=value)
        for resource, value in zip(problem.resources, threshold.tolist(), strict=True)
    ]
    return Problem(resources, problem.costs, agent_names=problem.agent_names)


@keywords("refractory")
def partition_runaway(
    problem: Problem,
    duration: float,
    latency: float = 0.0,
    *,
    period: float = 0.0,
    hold_off: float = 0.0,
) -> FloatArray:
    r"""Bound how far total demand runs above its threshold while no agent hears anything.

    .. math::

        \sum_i \alpha_i\,(\mathrm{duration} + \mathrm{latency} + \mathrm{hold\ off})

    Parameters
    ----------
    problem : Problem
        All its agents grow.
    duration : float
        How long no signal gets through, in units of time.
    latency : float
        The longest of the agents' latencies; on the clock in whole steps, rounded up.
    period : float
        Time between two samples of a control unit that samples, 1 on the clock; 0 for one that senses the
        crossing.
    hold_off : float
        Its hold-off then: the first signal after the partition may leave so much later.

    Returns
    -------
    ndarray, shape (m,)
        In units of the resources; with sampling the duration counts in whole periods, rounded up, and a
        period more.

    Raises
    ------
    InputError
        If an argument is outside its range, or both a period and a hold-off are given.

    Notes
    -----
    An upper bound of the total at the first signal that acts after the partition, for signals lost when
    sent or on arrival. It assumes that crossings before were answered by enough. It is met if the
    threshold is crossed just as signals begin to be lost, and the hold-off has just begun as the
    partition ends. With sampling it is met if the crossing comes just after a sample, so that the
    partition takes as many samples as it can.  To come back takes as many signals as runaway / (n (1 -
    beta) Gamma mu) or so; if each takes hardly more than the growth over a hold-off, the total may rise
    further meanwhile.
    """
    validation.instance("problem", problem, Problem, "a Problem")
    silent = validation.number("duration", duration, low=0.0)
    delay = validation.number("latency", latency, low=0.0)
    look = validation.number("period", period, low=0.0)
    hold_off = validation.number("hold_off", hold_off, low=0.0)
    if look > 0.0 and hold_off > 0.0:
        raise InputError.of("hold_off", hold_off, "left out for a control unit that samples")
    if look > 0.0:
        # However short, a partition may take a look, and the crossing may just have missed the one before.
        silent = (math.ceil(silent / look) + 1) * look
    return np.asarray(problem.increase.sum(axis=0) * (silent + delay + hold_off))
