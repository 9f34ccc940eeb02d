"""One agent as one SimPy process: the reference, to be read and to be extended."""

from aimd_des.environment import Kind, Mailbox
from aimd_des.gradients import marginal_cost
from aimd_des.log import Entry
from aimd_des.response import accumulated_at, demand_at, response_probability, time_average
from aimd_des.system import System
from aimd_des.transport import ProcessGenerator, Signal

__all__ = ["Camera"]


class Camera:
    """An agent that works on its own column of the system's state.

    A discrete agent has a one-bit latch for each resource, which the first signal to arrive sets;
    it answers at its next tick.  A tick without a latch set is plain growth and needs no event.
    A continuous agent answers a signal when it arrives.

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
        self.resources = range(system.problem.n_resources)
        self.marginal_cost = marginal_cost(system.problem.costs, agent)
        self.separable = system.problem.costs.separable
        self.increase = system.law.increase[:, agent].tolist()
        self.decrease = system.law.decrease[:, agent].tolist()
        self.normalization = system.law.normalization.tolist()
        self._mailbox = Mailbox(system.env)
        self._latch: dict[int, Signal] = {}
        self._folded = [0.0] * len(self.resources)
        self._averages = [0.0] * len(self.resources)
        self._discrete = system.clocks is not None

    def receive(self, signal: Signal) -> None:
        """Take note of a capacity signal that arrives now.

        Parameters
        ----------
        signal : Signal
            The bit.
        """
        if not self._discrete:
            self._mailbox.hand(signal)
        elif self._latch:
            self._latch.setdefault(signal.resource, signal)
        else:
            self._latch[signal.resource] = signal
            self._mailbox.hand(signal)

    def process(self) -> ProcessGenerator:
        """Live: the SimPy process of the agent.

        Returns
        -------
        generator
            Of the events that the agent waits for.
        """
        return self._tick_on_own_clock() if self._discrete else self._answer_on_arrival()

    def _tick_on_own_clock(self) -> ProcessGenerator:
        """Wait for a latch to be set, then for the next tick, and answer what is latched."""
        env, clocks = self.system.env, self.system.clocks
        assert clocks is not None  # noqa: S101 - discrete agents have clocks
        while True:
            yield self._mailbox
            tick = clocks.next_tick(self.agent, self.system.clock_time())
            yield env.at(clocks.time(self.agent, tick), Kind.ACT, self.agent)
            self.answer(sorted(self._latch.values()), tick)
            self._latch.clear()

    def _answer_on_arrival(self) -> ProcessGenerator:
        """Answer each signal in the instant in which it arrives."""
        while True:
            signal = yield self._mailbox
            self.answer([signal], self.system.env.now)

    def answer(self, signals: list[Signal], moment: float) -> None:
        """Answer signals for different resources: Algorithm 2, the branch S = 1.

        Parameters
        ----------
        signals : list of Signal
            In the order of their resources.
        moment : float
            Index of the tick, or time.
        """
        demand, accumulated, anchor, responses, saturated = self.system.rows
        folded, averages, increase = self._folded, self._averages, self.increase
        system, i, log = self.system, self.agent, self.system.log
        now, grain = system.env.now, system.grain
        # Averages are taken before any answer: coupled costs read all of them.
        for j in [signal.resource for signal in signals] if self.separable else self.resources:
            since = moment - anchor[j][i]
            folded[j] = accumulated_at(accumulated[j][i], demand[j][i], increase[j], since, grain)
            averages[j] = time_average(folded[j], moment, grain)
        for signal in signals:
            j = signal.resource
            present = demand_at(demand[j][i], increase[j], moment - anchor[j][i], grain)
            gradient = self.marginal_cost(averages, j)
            probability = response_probability(self.normalization[j], gradient, averages[j])
            kept, decreases = present, system.response_draws(signal)[i] < probability
            if decreases:
                kept = present * self.decrease[j]
                responses[j][i] += 1
                saturated[j][i] += probability > 1.0
                for tell in system.on_response:
                    tell(now, j, kept - present)
            demand[j][i], accumulated[j][i], anchor[j][i] = kept, folded[j], moment
            if log is not None:
                kind = Entry.RESPOND if decreases else Entry.HOLD
                log.add((now, kind, j, i, signal.number, present - kept))
