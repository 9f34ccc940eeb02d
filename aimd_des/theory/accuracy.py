r"""How near to the optimum averages come, and when: rates, scatter and bias of all responses and averagings.

The averages of a run are the mean of many runs plus Gaussian noise.  The mean is where `mean_dynamics` leads,
in the end to a place that the balance of growth and cuts decides and that need not be the optimum (bias); the
covariance of the noise is that of `second_moments`.  Both decay like powers of the time, t**-s and t**-1/2.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.dynamics.averaging import Averaging, Cumulative, Forgetting, Polynomial, Window
from aimd_des.dynamics.demand import Dynamics
from aimd_des.dynamics.responses import Response
from aimd_des.problem.optimum.nearby_optima import optimal_allocations
from aimd_des.problem.problem import Problem
from aimd_des.theory.absolute_sum import absolute_interval, absolute_mean
from aimd_des.theory.mean_dynamics import MeanPath, Memory, first_signals
from aimd_des.theory.prediction import Steady, check_enough, settle, steady_state
from aimd_des.theory.response_rule import largest, probability
from aimd_des.theory.sawtooth import Sawtooth, sawtooth
from aimd_des.theory.second_moments import Modes, modes_of
from aimd_des.theory.setting import Setting, check_setting
from aimd_des.theory.sways import follow_averages, follow_sway
from aimd_des.utils import limits, validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

# Larger matrices take long, and one agent among so many has hardly a part in the total: 200 agents taken one
# by one have a mean misallocation up to 0.5 % larger, and an interval 1 % narrower to 7 % wider.
_TOGETHER, _LARGEST = 200, 1000
# Relative standard error of a predicted total of averages.
_TOTALS = 5e-4
# A wanted length is looked for in stretches up to a longest time.
_LONGEST = 1e15
# As near as other random numbers would lead.
_SWAYS, _RESTS = 8, 1e-3
_STRETCH = 10.0
_LOOKS = 9


class Expected(NamedTuple):
    """What to expect of a measure of one run.

    Attributes
    ----------
    mean, low, high : ndarray, shape (..., m)
        Mean over runs, and the interval that holds 95 % of them.
    """

    mean: FloatArray
    low: FloatArray
    high: FloatArray


class Needed(NamedTuple):
    """What an accuracy takes.

    Attributes
    ----------
    length : ndarray, shape (m,)
        Steps, or units of time; inf where bias keeps runs from it however long they are.
    signals : ndarray, shape (m,)
        Capacity signals in this time.
    """

    length: FloatArray
    signals: FloatArray


@dataclass(frozen=True, eq=False)
class Convergence:
    """What theory says about the accuracy of averages.

    Made by `convergence`.  Time is in steps on the discrete clock, in units of time else.

    Attributes
    ----------
    setting : Setting
        What was asked for.
    steady : Steady
        Where averages settle.
    memory : Memory
        How agents average.
    blocks : tuple of Modes
        Modes of each resource, or of all of them if costs couple them.
    """

    setting: Setting
    steady: Steady
    memory: Memory
    blocks: tuple[Modes, ...]

    @property
    def problem(self) -> Problem:
        """What is shared."""
        return self.setting.problem

    @property
    def signals(self) -> FloatArray:
        """Capacity signals per unit of time or step, shape (m,)."""
        return self.steady.signals

    @property
    def exponents(self) -> tuple[FloatArray, ...]:
        """Exponents s of each resource, or of all of them if costs couple them, ascending.

        A deviation that leaves the totals as they are decays like t**(-a s) if averages have the gain a (1
        over all of the past), and like exp(-s t / tau) with forgetting.
        """
        return tuple(np.sort(block.exponent.real, axis=None) for block in self.blocks)

    @property
    def slowest(self) -> float:
        """The smallest exponent."""
        return float(min(values[0] for values in self.exponents))

    @cached_property
    def bias(self) -> FloatArray:
        """Averages less the optimum for what they use, in the end: (n, m), in units of the resources."""
        (bias,), _ = self._bias_at(self.steady.average[None], used=True)
        return np.asarray(bias)

    @cached_property
    def _path(self) -> MeanPath:
        """The averages on their way, from demand 0 on."""
        return MeanPath(self.setting, self.steady, self.memory)

    @property
    def floor(self) -> FloatArray:
        """Misallocation that the bias leaves however long a run is, (m,): a pure number."""
        return np.asarray(np.abs(self.bias).sum(axis=0) / self.steady.average.sum(axis=0))

    def left(self, at: float) -> float:
        """Compute what is left of a deviation that decays with the smallest exponent.

        Parameters
        ----------
        at : float
            Time > 0.

        Returns
        -------
        float
            As a part of what it was when signals began, at most 1.
        """
        (time,) = _times([at]).tolist()
        begun = float(first_signals(self.setting, self.steady).max())
        turns = self.memory.turns(max(time, begun)) - self.memory.turns(begun)
        return float(np.exp(-self.slowest * turns))

    def average(self, at: npt.ArrayLike) -> FloatArray:
        """Compute the averages in the mean over runs.

        Parameters
        ----------
        at : float or array_like, shape (k,)
            Times > 0 since the start with demand 0.

        Returns
        -------
        ndarray, shape (n, m) or (k, n, m)
            In units of the resources.
        """
        times = _times(at)
        averages = self._path.at(times.ravel())
        return averages.reshape(*times.shape, *averages.shape[1:])

    def covariance(self, at: float) -> FloatArray:
        """Compute the covariance of the averages of a single run, for each resource.

        Parameters
        ----------
        at : float
            Time > 0.

        Returns
        -------
        ndarray, shape (m, n, n)
            In units of the resources squared; with 0 between agents where there are more than 200.  Times
            `at` it is constant for long runs if averages are over all of the past and exponents above 1/2.
        """
        (time,) = _times([at]).tolist()
        n, m = self.problem.n_agents, self.problem.n_resources
        limits.memory("agents of the problem", n, 8.0 * m * n * n, "a covariance of all agents")
        result = np.zeros((m, n, n))
        for columns, block in self._columns():
            own = block.covariance(self.memory, time)
            width = len(range(m)[columns])
            if len(own) == 1:
                joint = own.reshape(n, width, n, width)
                result[columns] = np.einsum("ijkj->jik", joint)
            else:
                result[columns, np.arange(n), np.arange(n)] = np.einsum("ijj->ji", own)
        return result

    def misallocation(self, at: npt.ArrayLike) -> Expected:
        """Say how far averages are from the optimum for what they use.

        Parameters
        ----------
        at : float or array_like, shape (k,)
            Times > 0.

        Returns
        -------
        Expected
            ``sum_i |average - optimum|`` over the total of each resource, (m,) or (k, m); a pure number.
        """
        return self._expected(at, used=True)

    def relative_error(self, at: npt.ArrayLike) -> Expected:
        """Say the same of the optimum for all of the capacity, the paper's measure.

        Parameters
        ----------
        at : float or array_like, shape (k,)
            As for `misallocation`.

        Returns
        -------
        Expected
            As of `misallocation`, but over the capacity.
            Where capacity that is not used makes up the error, as in long runs, runs hardly differ, and the
            interval is that of the prediction: totals of averages are predicted to 0.1 %.
        """
        return self._expected(at, used=False)

    def needed(self, accuracy: float) -> Needed:
        """Say how long a run has to be for its misallocation to be small in the mean.

        Parameters
        ----------
        accuracy : float
            Misallocation > 0 that is good enough, a pure number.

        Returns
        -------
        Needed
            Length and signals of each resource: inf where bias alone is more, or where it takes more than
            10^15 steps or units of time.
        """
        wanted = validation.number("accuracy", accuracy, low=0.0, low_open=True)
        length = np.full(self.problem.n_resources, np.inf)
        floor = self.floor
        begin = float(first_signals(self.setting, self.steady).max())
        while (np.isinf(length) & (floor < wanted)).any() and begin < _LONGEST:
            looks = _Looks(self._mean_at, begin * np.geomspace(1.0, _STRETCH, _LOOKS))
            for j in np.flatnonzero(np.isinf(length)).tolist():
                length[j] = looks.first_below(j, wanted)
            if np.allclose(looks.mean(-1), looks.mean(0), rtol=1e-6):
                break  # averages with a finite memory have come to rest
            begin = float(looks.times[-1])
        return Needed(length, length * self.signals)

    def _columns(self) -> list[tuple[slice, Modes]]:
        """Name the resources of each block."""
        if len(self.blocks) == self.problem.n_resources:
            return [(slice(j, j + 1), block) for j, block in enumerate(self.blocks)]
        return [(slice(0, self.problem.n_resources), self.blocks[0])]

    def _bias_at(self, average: FloatArray, used: bool) -> tuple[FloatArray, FloatArray]:
        """Compute mean deviations, (k, n, m), and what they are measured by, (k, m)."""
        problem = self.problem
        totals = average.sum(axis=1) if used else np.tile(problem.capacity, (len(average), 1))
        return average - optimal_allocations(problem, totals), totals

    def _moments(self, time: float) -> tuple[FloatArray, FloatArray | None]:
        """Compute the variance of each average, (n, m), and the covariances between agents, (m, n, n)."""
        if self.problem.n_agents > _TOGETHER:
            return self._variance(time), None
        covariance = self.covariance(time)
        variance = np.einsum("jii->ij", covariance).copy()
        np.einsum("jii->ji", covariance)[...] = 0.0
        return variance, covariance

    def _variance(self, time: float) -> FloatArray:
        n = self.problem.n_agents
        # Together all agents are one block, else each is one; the order is agents, then resources.
        return np.hstack([block.variance(self.memory, time).reshape(n, -1) for block in self.blocks])

    @cached_property
    def _sawtooth(self) -> Sawtooth:
        """What averages have of the present period."""
        return sawtooth(self.setting, self.steady)

    def _mean_at(self, time: float) -> FloatArray:
        """Compute the mean misallocation alone, (m,)."""
        bias, totals = self._bias_at(self.average([time]), used=True)
        own, _ = self._sawtooth.covariance(self.memory, time, used=True)
        spread = np.sqrt(self._variance(time) + own)
        return np.asarray(absolute_mean(bias[0], spread).sum(axis=0) / totals[0])

    def _expected(self, at: npt.ArrayLike, used: bool) -> Expected:
        times = _times(at)
        average = self.average(times.ravel())
        bias, totals = self._bias_at(average, used)
        rows = np.empty((3, *totals.shape))
        for k, time in enumerate(times.ravel().tolist()):
            variance, shared = self._moments(time)
            own, common = self._sawtooth.covariance(self.memory, time, used)
            variance = variance + own
            shared = None if shared is None else shared + common
            rows[0, k] = absolute_mean(bias[k], np.sqrt(variance)).sum(axis=0)
            for j in range(totals.shape[1]):
                others = None if shared is None else shared[j]
                common = 0.0 if used else _TOTALS * average[k, :, j]
                rows[1:, k, j] = absolute_interval(bias[k, :, j], variance[:, j], others, common)
        mean, low, high = (row.reshape(*times.shape, -1) for row in rows / totals)
        return Expected(mean, low, high)


class _Looks:
    """Mean misallocation at some times, found when it is asked for: most of them never are."""

    def __init__(self, mean_at: Callable[[float], FloatArray], times: FloatArray) -> None:
        self.times = times
        self.mean = lru_cache(lambda place: mean_at(float(times[place])))

    def first_below(self, resource: int, wanted: float) -> float:
        """Find from when on it stays below a level; inf if it does not."""
        last = len(self.times) - 1
        if self.mean(last)[resource] > wanted:
            return math.inf
        while last and self.mean(last - 1)[resource] <= wanted:
            last -= 1
        if not last:
            return float(self.times[0])
        pair = [last, last - 1]
        values = [self.mean(place)[resource] for place in pair]
        return float(np.exp(np.interp(np.log(wanted), np.log(values), np.log(self.times[pair]))))


def _times(at: npt.ArrayLike) -> FloatArray:
    """Check times."""
    if validation.axes(at) == 0:
        return np.array(validation.number("at", at, low=0.0, low_open=True))
    return validation.array("at", at, ["k"], low=0.0, low_open=True)


def convergence(
    problem: Problem,
    dynamics: Dynamics = "discrete",
    *,
    lag: int | None = None,
    latency: float = 0.0,
    period: float = 0.0,
    hold_off: float | None = None,
    loss: npt.ArrayLike = 0.0,
    averaging: Averaging | None = None,
    response: Response | None = None,
    exact: bool | None = None,
) -> Convergence:
    """Predict how near averages come to the optimum, and how fast.

    Parameters
    ----------
    problem : Problem
        What is shared; costs may couple resources, alpha and beta may differ from agent to agent.
    dynamics : {"discrete", "continuous"}
        Agents that act at ticks of one common clock of period 1, or agents that grow all the time.
    lag : int, optional
        Steps after which a signal acts on the clock; default: `latency` rounded up.
    latency : float
        d >= 0, common to all agents; on the clock in whole steps, rounded up.
    period : float
        Time between two samples of a control unit, for continuous agents; 0 for one that senses crossings.
    hold_off : float, optional
        Hold-off of a control unit that senses crossings, for continuous agents.  If it is given, signals that
        repeat are taken into account.
    loss : float or array_like, shape (n,)
        Probability that a signal is lost on an agent, independent of all else.
    averaging : Averaging, optional
        How agents average their demand. Default: over all of their past.
    response : Response, optional
        How agents answer signals; default: `responses.Randomised`, the paper's rule.
    exact : bool, optional
        Whether averages come from the exact moments of what signals find. By default they are used with up to
        200 agents; else the order 1 / n is neglected.

    Returns
    -------
    Convergence
        Exponents, bias and covariance, and what follows from them.

    Raises
    ------
    InputError
        If more signals are necessary than there can be, a response probability is above 1 where averages
        settle, or exact moments are asked for where there are none.
    SimulationError
        If the steady state is not found.

    Examples
    --------
    >>> from aimd_des import PolynomialCosts, Resource
    >>> memory = Resource("memory", capacity=30.0, increase=0.02, decrease=0.5, normalization=0.1)
    >>> costs = PolynomialCosts([2], [[[1.0]]] * 15 + [[[2.0]]] * 15)
    >>> expected = convergence(Problem([memory], costs))
    >>> round(expected.slowest, 3)
    1.0
    >>> bool(expected.misallocation(1e6).mean[0] < expected.misallocation(1e3).mean[0])
    True
    """
    if lag is not None:
        latency = _lag(lag, dynamics, latency)
    setting = check_setting(
        problem, dynamics, latency=latency, period=period, loss=loss, hold_off=hold_off, response=response
    )
    if exact and not setting.has_moments:
        known = "exact moments are known for up to 200 agents, and not for full cuts"
        raise InputError.of("exact", exact, "left out here", known)
    setting = setting._replace(exact=setting.has_moments and exact is not False)
    setting, steady = _on_the_clock(setting) if setting.discrete else (setting, steady_state(setting))
    check_enough(setting, steady.signals)
    _check_not_cut_off(setting, steady)
    n, m = problem.n_agents, problem.n_resources
    if problem.costs.separable:
        slices = [slice(j, j + 1) for j in range(m)]
        blocks = [modes_of(setting, steady, columns, n <= _TOGETHER) for columns in slices]
    else:
        blocks = [modes_of(setting, steady, slice(0, m), n <= _TOGETHER and n * m <= _LARGEST)]
    return Convergence(setting, steady, _memory(averaging), tuple(blocks))


def _lag(lag: int, dynamics: Dynamics, latency: float) -> float:
    """Check a lag; as a latency."""
    steps = validation.integer("lag", lag, low=0)
    if dynamics != "discrete" or latency:
        raise InputError.of("lag", lag, "left out for continuous agents, and where a latency is given")
    return float(steps)


def _on_the_clock(setting: Setting) -> tuple[Setting, Steady]:
    """Let averages and the sway that a delay makes settle on each other."""
    # Without a delay the step that crosses a threshold ends evenly spread over one step of growth above it.
    setting = setting._replace(sway=setting.problem.increase**2 / 12.0)
    steady = settle(setting)
    lag = math.ceil(setting.latency)
    if lag == 0 and not setting.loss.any():
        return setting, steady
    for _ in range(_SWAYS):
        sway = follow_sway(setting, steady, lag)
        setting = setting._replace(found=sway.found, sway=sway.variance)
        before, steady = steady, settle(setting, steady.average)
        if np.allclose(steady.average, before.average, rtol=_RESTS):
            break
    return setting._replace(following=follow_averages(setting, steady, lag)), steady


def _memory(averaging: Averaging | None) -> Memory:
    """Say what an averaging is to theory."""
    if averaging is None or isinstance(averaging, Cumulative):
        return Memory()
    if isinstance(averaging, Polynomial):
        return Memory(gain=averaging.gain)
    if isinstance(averaging, Window):
        return Memory(window=averaging.length)
    if isinstance(averaging, Forgetting):
        return Memory(time_constant=averaging.time_constant)
    allowed = "one of ours, such as averaging.Forgetting(100.0)"
    raise InputError.of("averaging", averaging, allowed, "theory does not know what others weigh")


def _check_not_cut_off(setting: Setting, steady: Steady) -> None:
    """Refuse what is cut off: what averages settle on then does not depend on the costs."""
    problem = setting.problem
    wanted = probability(problem, setting.response, steady.average, steady.found - steady.average)
    most = largest(problem, setting.response)
    if (wanted > most).any():
        agent, resource = (int(index) for index in np.argwhere(wanted > most)[0])
        raise InputError.of(
            f"response probability of agent {agent} for {problem.resource_names[resource]}",
            float(wanted[agent, resource]),
            f"at most {most[agent, resource]:.6g} where averages settle",
            "make the normalization smaller",
        )
