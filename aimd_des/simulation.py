"""Puts control unit, channel, agents and observers together and runs them: wiring, no rules."""

from collections.abc import Callable

import numpy as np

from aimd_des import checks, streams
from aimd_des.agents import Camera
from aimd_des.channel import BroadcastChannel, Channel
from aimd_des.checks import FloatArray
from aimd_des.clock import Clock
from aimd_des.control_unit import ControlUnit, Sampled
from aimd_des.environment import Kind
from aimd_des.errors import InputError
from aimd_des.metrics import Overshoot, fold_overshoot
from aimd_des.problem import Problem
from aimd_des.recording import Observations, Recording, Signals
from aimd_des.results import Account, Result
from aimd_des.streams import Purpose
from aimd_des.system import Agent, ProcessGenerator, System

__all__ = ["Simulation"]


class Simulation:
    """A system of agents, a control unit and a channel, on SimPy.

    Parameters
    ----------
    problem : Problem
        What is shared, by how many, at what cost.
    control_unit : ControlUnit
        `Sampled` with period 1 unless given.
    channel : Channel
        A perfect `BroadcastChannel` (no latency, no loss) unless given.
    agents : callable
        Makes an agent from (index, system); `Camera` unless given.
    clock : Clock
        The agents' clock; tick q at time q unless given.
    seed : int
        At least 0.  Decides responses, losses and latencies, each from a stream of its own.
    recording : Recording, optional
        What to keep besides signals and end; totals at a thousand times unless given.

    Raises
    ------
    InputError
        If an argument is outside its range.

    Notes
    -----
    With clocks in phase, no loss and latency in (0, period] a run equals `run_discrete` to the
    last bit; with latency 0 it equals ``run_discrete(lag=0)``.
    """

    def __init__(
        self,
        problem: Problem,
        *,
        control_unit: ControlUnit | None = None,
        channel: Channel | None = None,
        agents: Callable[[int, System], Agent] = Camera,
        clock: Clock | None = None,
        seed: int,
        recording: Recording | None = None,
    ) -> None:
        if not callable(agents):
            raise InputError.of("agents", agents, "a class or function that makes an agent, such as Camera")
        streams.key(seed, Purpose.RESPONSE)  # refuses a seed that is none before anything runs
        self.problem = problem
        self.control_unit = Sampled() if control_unit is None else control_unit
        self.channel = BroadcastChannel() if channel is None else channel
        self.agents = agents
        self.clock = Clock() if clock is None else clock
        self.seed = seed
        self.recording = Recording() if recording is None else recording

    def run(self, until: float, watch: Callable[[float, int], None] | None = None) -> Result:
        """Run over [0, until): what is due at `until` does not happen, but the last look is taken there.

        Parameters
        ----------
        until : float
            The end, greater than 0, in units of time.
        watch : callable, optional
            Called with (simulated time, events handled) every few thousand events.

        Returns
        -------
        Result
            The same for the same arguments, however often it is run.

        Raises
        ------
        InputError
            If the end is no positive number, or a time to be recorded lies beyond it.

        Warns
        -----
        RuntimeWarning
            Once, if a response probability was above 1.
        """
        until = checks.number("until", until, low=0.0, low_open=True)
        system = System(self.problem, self.channel, self.clock, self.seed)
        observer = _Observer(system, self.recording, until)
        system.env.process(self.control_unit.process(system))
        system.env.process(observer.watch_totals())
        system.env.process(observer.watch_allocations())
        system.env.process(observer.measure_overshoot())
        for index in range(self.problem.n_agents):
            agent = self.agents(index, system)
            system.agents.append(agent)
            system.env.process(agent.process())
        system.env.run_to(until, watch)
        return self._result(system, observer.close(), until)

    def _result(self, system: System, observations: Observations, until: float) -> Result:
        signals = Signals(
            time=np.array([signal.time for signal in system.sent], dtype=np.float64),
            resource=np.array([signal.resource for signal in system.sent], dtype=np.int64),
            number=np.array([signal.number for signal in system.sent], dtype=np.int64),
        )
        copies = signals.counts(self.problem.n_resources) * self.problem.n_agents
        account = Account(
            delivered=system.delivered,
            lost=system.lost,
            in_flight=copies - system.delivered - system.lost,
            responses=system.state.responses,
            saturated=system.state.saturated,
        )
        return Result(self.problem, "discrete", self.seed, until, signals, observations, account)


class _Observer:
    """Looks at the system at the times asked for, and integrates total demand exactly."""

    def __init__(self, system: System, recording: Recording, until: float) -> None:
        n, m = system.problem.n_agents, system.problem.n_resources
        self.system, self.until = system, until
        self.demand_times = recording.times("demand", until, whole=False)
        self.allocation_times = recording.times("allocations", until, whole=False)
        self.total_demand = np.zeros((len(self.demand_times), m))
        self.total_average = np.zeros((len(self.demand_times), m))
        self.demand = np.zeros((len(self.allocation_times), m, n))
        self.average = np.zeros((len(self.allocation_times), m, n))
        self.peak, self.above, self.excess = np.zeros(m), np.zeros(m), np.zeros(m)
        self.measured_to = 0.0

    def watch_totals(self) -> ProcessGenerator:
        """Keep the totals; the last look is left to `close`."""
        for row, time in enumerate(self.demand_times[:-1]):
            yield self.system.env.at(float(time), Kind.OBSERVE)
            self._keep_totals(row)

    def watch_allocations(self) -> ProcessGenerator:
        """Keep demand and average of every agent; the last look is left to `close`."""
        for page, time in enumerate(self.allocation_times[:-1]):
            yield self.system.env.at(float(time), Kind.OBSERVE)
            self.demand[page], self.average[page] = self.system.allocations()

    def measure_overshoot(self) -> ProcessGenerator:
        """Close, at every tick, the interval over which total demand was constant."""
        clock, tick = self.system.clock, 0
        while True:
            yield self.system.env.at(clock.time(tick), Kind.OBSERVE)
            self._measure()
            tick += 1

    def close(self) -> Observations:
        """Take the last look, at the end of the run."""
        self._measure()
        self._keep_totals(len(self.demand_times) - 1)
        self.demand[-1], self.average[-1] = self.system.allocations()
        capacity = self.system.problem.capacity
        overshoot = Overshoot(
            self.peak / capacity, self.above / self.until, self.excess / self.until / capacity
        )
        return Observations(
            self.demand_times,
            self.total_demand,
            self.total_average,
            self.allocation_times,
            self.demand,
            self.average,
            overshoot,
        )

    def _measure(self) -> None:
        now = self.system.env.now
        if now > self.measured_to:
            total, law = self.system.total_demand(), self.system.law
            fold_overshoot(
                total, law.capacity, now - self.measured_to, self.peak, self.above, self.excess
            )
            self.measured_to = now

    def _keep_totals(self, row: int) -> None:
        _, average = self.system.allocations()
        self.total_demand[row] = self.system.total_demand()
        self.total_average[row] = _index_order_sum(average)


def _index_order_sum(rows: FloatArray) -> FloatArray:
    """Sum along the agents one by one; `ndarray.sum` adds pairwise, in an order that may change."""
    return np.asarray(np.cumsum(rows, axis=1)[:, -1])
