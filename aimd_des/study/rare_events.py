"""How likely it is that total demand, or another measure, exceeds a level that it hardly ever reaches."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, Self, get_args

import numpy as np

from aimd_des.engine.observers import ConstantPieces, LinearPieces
from aimd_des.problem.lookup import resource_index
from aimd_des.results.misallocation import misallocation
from aimd_des.results.recording import Recording
from aimd_des.study.splitting import Estimate, SplitPath, find_levels, fixed_effort, restart
from aimd_des.study.statistics.intervals import Interval, mean_interval
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError, SimulationError

if TYPE_CHECKING:
    from aimd_des.engine.run_in_progress import Run
    from aimd_des.engine.simulation import Simulation

Method = Literal["fixed_effort", "restart"]
Measure = Literal["demand", "misallocation"]

# No more steps in the time within which the level may be reached.
_FINEST = 1_000_000


@dataclass(frozen=True)
class RareEvent:
    """A small probability, how well it is known, and what that has cost.

    Attributes
    ----------
    probability : float
        That the level is reached within the time; unbiased.
    standard_error : float
        Of the probability, from independent repetitions.
    low, high : float
        Ends of the confidence interval.
    confidence : float
        Probability with which such an interval holds the truth.
    repetitions : int
        How many there were.
    levels : tuple of float
        At which paths were split, ascending; the last is the event.
    shares : tuple of float
        Of the trials from the level before, those that reach each, in the mean of the repetitions that have
        come to the last level but one; empty by RESTART.
    reached : tuple of Interval
        The probability that each level is reached, unbiased; the last is that of the event; empty by RESTART.
    work, pilot_work : float
        What was simulated for the estimate, and to choose the levels, in units of time.
    run_length : float
        What one plain run simulates, in units of time.
    """

    probability: float
    standard_error: float
    low: float
    high: float
    confidence: float
    repetitions: int
    levels: tuple[float, ...]
    shares: tuple[float, ...]
    reached: tuple[Interval, ...]
    work: float
    pilot_work: float
    run_length: float

    @property
    def relative_error(self) -> float:
        """The standard error over the probability; not a number where no path has reached the level."""
        return self.standard_error / self.probability if self.probability > 0.0 else math.nan

    @property
    def gain(self) -> float:
        """What plain runs would simulate for the same relative error, over what was simulated.

        A plain run reaches the level or not: the relative error of the share of N runs that do is
        sqrt((1 - p) / (p N)), which gives N.  The pilot is counted as work.
        """
        if not 0.0 < self.probability < 1.0 or not self.standard_error > 0.0:
            return math.nan
        runs = (1.0 - self.probability) / (self.probability * self.relative_error**2)
        return runs * self.run_length / (self.work + self.pilot_work)


def rare_event(
    simulation: "Simulation",
    *,
    level: float,
    within: float,
    resource: str | int | None = None,
    after: float = 0.0,
    measure: "Measure | Callable[[Run], float]" = "demand",
    method: Method = "fixed_effort",
    trials: int = 100,
    repetitions: int = 20,
    step: float = 0.25,
    confidence: float = 0.95,
    via: Sequence[float] = (),
) -> RareEvent:
    """Estimate the probability that a level is reached, by multilevel splitting.

    Parameters
    ----------
    simulation : Simulation
        With a fleet, and with nothing that cannot be forked (see `Run.fork`).  What it records does not
        matter.
    level : float
        Of total demand over the capacity in force, such as 1.2; of the misallocation; or of a function of
        yours.
    within : float
        Greater than 0: how long after `after` it may be reached, in units of time.
    resource : str or int, optional
        Whose demand or misallocation. Default: the largest of all resources.
    after : float
        From when on it counts, at least 0, in units of time: leave out the start, or averages that have yet
        to settle.
    measure : "demand", "misallocation" or callable
        Total demand is followed exactly, at every moment.  Misallocation and a function of the run in
        progress that gives a finite number are looked at after every step.
    method : {"fixed_effort", "restart"}
        The same number of trials at each level; or splitting each time that a level is passed upwards.
    trials : int
        At least 10: paths from each level; by RESTART, paths from the start.
    repetitions : int
        At least 2: independent estimates, which the interval is made of.
    step : float
        Greater than 0, in units of time: how soon after it has passed a level a path is split.  By fixed
        effort, paths of continuous demand are split when they pass it, or within a step where an intervention
        has changed how fast demand grows.
    confidence : float
        Between 0 and 1.
    via : sequence of float
        Lower levels, ascending, whose probabilities are wanted as well: they are among the levels, with
        fixed effort at no further cost.

    Returns
    -------
    RareEvent
        The same for the same arguments.

    Raises
    ------
    InputError
        If an argument is outside its range, the simulation cannot be forked, or a function of yours gives
        back what is no finite number.
    SimulationError
        If the pilot or all repetitions do not come to the level: it is out of reach, or needs more trials.

    Notes
    -----
    Clocks and costs are those of the simulation: the probability is that for this system, over its random
    responses, losses and latencies.  Splitting saves time where paths reach a level step by step, and a
    tenth to a half of them pass each level in between. It does not where one draw decides, such as one
    long outage of the channel.

    Examples
    --------
    >>> from aimd_des import BroadcastChannel, Crossing, Fleet, Simulation, latency
    >>> from aimd_des.study import rare_event
    >>> from models import smart_cameras
    >>> late = Simulation(
    ...     smart_cameras(0),
    ...     dynamics="continuous",
    ...     control_unit=Crossing(1.0),
    ...     agents=Fleet,
    ...     seed=0,
    ...     channel=BroadcastChannel(latency.Exponential(0.5), 0.2),
    ... )
    >>> found = rare_event(
    ...     late, level=1.02, within=10.0, after=50.0, resource="disk", trials=10, repetitions=2
    ... )
    >>> found.low <= found.probability <= found.high
    True
    """
    number = validation.number
    until = number("after", after, low=0.0) + number("within", within, low=0.0, low_open=True)
    wanted = _ascending(via, number("level", level))
    step = number("step", step, low=within / _FINEST, high=within, low_open=True)
    trials = validation.integer("trials", trials, low=10)
    repetitions = validation.integer("repetitions", repetitions, low=2)
    number("confidence", confidence, low=0.0, high=1.0, low_open=True, high_open=True)
    validation.choice("method", method, get_args(Method))
    if not callable(measure):
        validation.choice("measure", measure, get_args(Measure))
    if resource is not None:
        resource_index(simulation.problem, resource)
    bare = simulation.replace(recording=Recording(demand="end", overshoot=True))
    spent = _Work()

    def root(salt: int) -> "_DemandPath | _MeasuredPath":
        # Nothing has happened in it: each path from here has a start of its own.
        run = bare.start(until).fork(salt)
        if measure == "demand":
            return _DemandPath(run, _Sight(after, step, spent), _one(resource, run))
        return _MeasuredPath(run, _Sight(after, step, spent), _function(measure, resource))

    levels, found = find_levels(root(0), wanted, trials)
    if not found:
        best = levels[-1] if levels else math.nan
        reason = f"the pilot of {trials} paths a level came to {best:.6g} and not to level = {level!r}"
        raise SimulationError(f"{reason}: raise trials, or the level is out of reach within {within!r}")
    pilot_work, spent.time = spent.time, 0.0
    estimates = [_estimate(root(salt), levels, method, trials, salt) for salt in range(1, repetitions + 1)]
    if not any(each.probability for each in estimates):
        # An interval from 0 to 0 would not hold the truth: the pilot has seen that it is more.
        reason = f"no path of {repetitions} repetitions came to level = {levels[-1]!r}, but the pilot did"
        raise SimulationError(f"{reason}: raise trials or repetitions")
    reached = _reached(estimates, len(levels), confidence) if method == "fixed_effort" else ()
    return _gathered(estimates, levels, reached, confidence, work=(spent.time, pilot_work), run_length=until)


def _reached(estimates: Sequence[Estimate], n_levels: int, confidence: float) -> tuple[Interval, ...]:
    """Estimate the probability of each level."""
    # By repetition and level; shares that are missing follow one that is 0.
    products = np.zeros((len(estimates), n_levels))
    for row, each in zip(products, estimates, strict=True):
        row[: len(each.shares)] = np.cumprod(each.shares)
    return tuple(_within_range(mean_interval(column, confidence)) for column in products.T)


def _gathered(
    estimates: Sequence[Estimate],
    levels: tuple[float, ...],
    reached: tuple[Interval, ...],
    confidence: float,
    *,
    work: tuple[float, float],
    run_length: float,
) -> RareEvent:
    """Put the estimates of the repetitions together."""
    whole = _within_range(mean_interval([each.probability for each in estimates], confidence))
    shares = np.array([each.shares for each in estimates if len(each.shares) == len(levels)])
    return RareEvent(
        probability=whole.mean,
        standard_error=whole.standard_error,
        low=whole.low,
        high=whole.high,
        confidence=confidence,
        repetitions=len(estimates),
        levels=levels,
        shares=tuple(shares.mean(axis=0).tolist()) if shares.size else (),
        reached=reached,
        work=work[0],
        pilot_work=work[1],
        run_length=run_length,
    )


def _ascending(via: Sequence[float], level: float) -> list[float]:
    """List the levels whose probabilities are wanted."""
    wanted = [*validation.array("via", via, ("n_levels",)).tolist(), level]
    if sorted(set(wanted)) != wanted:
        raise InputError.of("via", list(via), f"ascending, and below level = {level!r}")
    return wanted


def _within_range(found: Interval) -> Interval:
    """Cut the interval of a probability off at 0 and 1."""
    return replace(found, low=max(0.0, found.low), high=min(1.0, found.high))


def _estimate(root: SplitPath, levels: tuple[float, ...], method: Method, trials: int, salt: int) -> Estimate:
    """Make one repetition, from a root of its own."""
    if method == "fixed_effort":
        return fixed_effort(root, levels, trials, np.random.default_rng(salt))
    found = restart(root, levels, trials)
    if found is None:
        raise SimulationError("RESTART splits without end: choose method='fixed_effort', or a longer step")
    return found


@dataclass
class _Work:
    """What has been simulated, in units of time."""

    time: float = 0.0


@dataclass(frozen=True)
class _Sight:
    """From when on paths are looked at, how often, and what that has cost."""

    after: float
    step: float
    spent: _Work


def _overshoot(run: "Run") -> ConstantPieces | LinearPieces:
    """Return what measures total demand in a run."""
    measured = run.system.parts["overshoot"]
    assert isinstance(measured, ConstantPieces | LinearPieces)  # noqa: S101 - its recording asks for it
    return measured


class _RunPath:
    """A run in progress as a path."""

    def __init__(self, run: "Run", sight: _Sight) -> None:
        self.run, self._sight = run, sight

    def advance(self, to: float) -> None:
        """Go on to a time, but not beyond the end."""
        goal = min(self.run.until, to)
        self._sight.spent.time += goal - self.run.time
        self.run.advance(to=goal)

    @property
    def over(self) -> bool:
        """Whether it stands at its end."""
        return self.run.time >= self.run.until


class _DemandPath(_RunPath):
    """Whose importance is the peak of total demand, over the capacity in force."""

    def __init__(self, run: "Run", sight: _Sight, resource: int | slice) -> None:
        super().__init__(run, sight)
        self._resource = resource

    @property
    def reached(self) -> float:
        """The peak so far; nothing before it counts."""
        if self.run.time < self._sight.after:
            return -math.inf
        return float(np.max(_overshoot(self.run).peak_load()[self._resource]))

    def fork(self, salt: int | None) -> Self:
        """Fork the run."""
        return type(self)(self.run.fork(salt), self._sight, self._resource)

    def _begin(self) -> None:
        """Leave the start behind."""
        if self.run.time < self._sight.after:
            self.advance(self._sight.after)
            _overshoot(self.run).forget_peaks()

    def reach(self, level: float) -> bool:
        """Go on to when total demand comes to the level, before anything else happens at that moment."""
        self._begin()
        while self.reached < level:
            if self.over:
                return False
            self.advance(self._soonest(level))
        return True

    def _soonest(self, level: float) -> float:
        """When total demand can come to the level by growth alone."""
        system, now = self.run.system, self.run.time
        lacking = level * system.parameters.capacity - system.allocations()[0].sum(axis=1)
        with np.errstate(divide="ignore"):  # it takes for ever where no agent is present
            wait = float(np.min((lacking / system.conditions.growth)[self._resource]))
        # A path that is split later has been cut already, and so have all that come of it.  Demand of agents
        # that tick is constant in between.
        if isinstance(_overshoot(self.run), ConstantPieces):
            wait = max(wait, self._sight.step)
        elif self.run.simulation.interventions:  # which may let it grow faster, or begin to grow
            wait = min(wait, self._sight.step)
        return max(now + wait, math.nextafter(now, math.inf))

    def step(self) -> float | None:
        """Go on by one step, and return the peak within it."""
        if self.over:
            return None
        self._begin()
        _overshoot(self.run).forget_peaks()
        self.advance(self.run.time + self._sight.step)
        return self.reached


class _MeasuredPath(_RunPath):
    """Whose importance is a function of the run, looked at after every step."""

    def __init__(
        self, run: "Run", sight: _Sight, function: "Callable[[Run], float]", reached: float = -math.inf
    ) -> None:
        super().__init__(run, sight)
        self._function = function
        self.reached = reached

    def fork(self, salt: int) -> Self:
        """Fork the run."""
        return type(self)(self.run.fork(salt), self._sight, self._function, self.reached)

    def reach(self, level: float) -> bool:
        """Go on step by step."""
        while self.reached < level:
            if self.step() is None:
                return False
        return True

    def step(self) -> float | None:
        """Go on by one step, and look."""
        if self.over:
            return None
        self.advance(max(self.run.time, self._sight.after) + self._sight.step)
        seen = validation.number("what measure gives back", self._function(self.run))
        self.reached = max(self.reached, seen)
        return seen


def _one(resource: str | int | None, run: "Run") -> int | slice:
    """Return which of the resources to look at."""
    return slice(None) if resource is None else resource_index(run.simulation.problem, resource)


def _function(
    measure: "Measure | Callable[[Run], float]", resource: str | int | None
) -> "Callable[[Run], float]":
    """Return the importance of a run in progress."""
    if callable(measure):
        return measure

    def off(run: "Run") -> float:
        _, average = run.system.allocations()
        found = misallocation(run.simulation.problem, average.T)[_one(resource, run)]
        return float(np.nanmax(found)) if np.isfinite(found).any() else 0.0

    return off
