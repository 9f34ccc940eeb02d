"""One agent as one SimPy process: the reference, to be read and to be extended."""

from aimd_des.environment import Kind
from aimd_des.population import State
from aimd_des.response import accumulated_over_ticks, answered, marginal_cost
from aimd_des.system import ProcessGenerator, System

__all__ = ["Camera"]

_NO_SIGNAL = -1


class Camera:
    """An agent that ticks on the system's clock and works on its own column of the state.

    Between its ticks it has a one-bit latch for each resource, which the first signal to arrive
    sets.  A tick without a latch set is plain growth and needs no event.

    Parameters
    ----------
    agent : int
        i, its index.
    system : System
        The run in progress.
    """

    def __init__(self, agent: int, system: System) -> None:
        self.agent = agent
        self.system = system
        self.latch = [_NO_SIGNAL] * system.problem.n_resources
        self.marginal_cost = marginal_cost(system.problem.costs, agent)
        self.separable = system.problem.costs.separable
        # Views of the shared arrays that hand out Python floats: several times faster than NumPy's.
        self.state = State(*(memoryview(array) for array in system.state))
        self.increase = system.law.increase[:, agent].tolist()
        self.decrease = system.law.decrease[:, agent].tolist()
        self.normalization = system.law.normalization.tolist()
        self._waiting = True
        self._latched = system.env.event()

    def receive(self, resource: int, number: int) -> None:
        """Set the latch for resource j unless it is set already.

        Parameters
        ----------
        resource : int
            j.
        number : int
            b, the number of the broadcast that arrives.
        """
        if self.latch[resource] == _NO_SIGNAL:
            self.latch[resource] = number
            if self._waiting:
                self._waiting = False
                self.system.env.fire(self._latched)

    def process(self) -> ProcessGenerator:
        """Wait for a latch to be set, then for the next tick, and act.

        Yields
        ------
        simpy.Event
            The first signal since the last tick; then the tick.
        """
        env, clock = self.system.env, self.system.clock
        while True:
            yield self._latched
            tick = clock.next_tick(env.now)
            yield env.at(clock.time(tick), Kind.ACT, self.agent)
            self.act(tick)
            self._waiting = True
            self._latched = env.event()

    def averages(self, tick: int, needed: list[int]) -> list[float]:
        """Compute the averages at a tick, the present demand included.

        Parameters
        ----------
        tick : int
            Its index k.
        needed : list of int
            The resources whose averages are needed.

        Returns
        -------
        list of float, length m
            In units of the resources; 0 where not needed.
        """
        state, i = self.state, self.agent
        averages = [0.0] * len(self.latch)
        for j in needed:
            ticks = tick - state.anchor[j, i]
            folded = accumulated_over_ticks(
                state.accumulated[j, i], state.demand[j, i], self.increase[j], ticks
            )
            averages[j] = folded / (tick + 1.0)
        return averages

    def act(self, tick: int) -> None:
        """Answer the signals that are latched: Algorithm 2 at tick k.

        Parameters
        ----------
        tick : int
            Its index k.
        """
        state, i = self.state, self.agent
        latched = [j for j, number in enumerate(self.latch) if number != _NO_SIGNAL]
        # Averages are taken before any answer: coupled costs read all of them.
        averages = self.averages(tick, latched if self.separable else list(range(len(self.latch))))
        for j in latched:
            demand, accumulated, decreases, certain = answered(
                state.demand[j, i],
                state.accumulated[j, i],
                tick - state.anchor[j, i],
                self.increase[j],
                self.decrease[j],
                self.normalization[j],
                self.marginal_cost(averages, j),
                averages[j],
                self.system.response_draws(j, self.latch[j])[i],
            )
            self.latch[j] = _NO_SIGNAL
            state.demand[j, i], state.accumulated[j, i] = demand, accumulated
            state.anchor[j, i] = tick
            state.responses[j, i] += decreases
            state.saturated[j, i] += certain
