"""One agent as one SimPy process: the reference, to be read and to be extended."""

from collections.abc import Sequence

from aimd_des.checks import FloatArray
from aimd_des.environment import Kind, Mailbox
from aimd_des.gradients import marginal_cost
from aimd_des.log import Entry
from aimd_des.response import accumulated_at, demand_at, response_probability, time_average
from aimd_des.system import System
from aimd_des.transport import ProcessGenerator, Signal

__all__ = ["Camera"]

# Views of the rows of demand, accumulated and anchor for one resource; alpha, beta and Gamma.
_Row = tuple[FloatArray, FloatArray, FloatArray, float, float, float]


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

    Attributes
    ----------
    resources : range
        Indices of the resources.
    marginal_cost : callable
        ``marginal_cost(averages, resource)``: the partial derivative of the agent's cost.
    increase, decrease, normalization : list of float, length m
        alpha, beta and Gamma.
    """

    def __init__(self, agent: int, system: System) -> None:
        self.agent = agent
        self.system = system
        self.marginal_cost = marginal_cost(system.problem.costs, agent)
        self.separable = system.problem.costs.separable
        self._discrete = system.clocks is not None
        self._mailbox = Mailbox(system.env)
        self._latch: dict[int, Signal] = {}
        self._averages = [0.0] * system.problem.n_resources
        # What an answer needs, at hand: most of a run is spent there.
        law, rows = system.law, system.rows
        self.resources = range(system.problem.n_resources)
        self.increase: list[float] = law.increase[:, agent].tolist()
        self.decrease: list[float] = law.decrease[:, agent].tolist()
        self.normalization: list[float] = law.normalization.tolist()
        self._rows: list[_Row] = list(
            zip(
                rows.demand,
                rows.accumulated,
                rows.anchor,
                self.increase,
                self.decrease,
                self.normalization,
                strict=True,
            )
        )
        self._responses, self._saturated = rows.responses, rows.saturated
        self._env, self._grain, self._log = system.env, system.grain, system.log
        self._on_response = system.on_response

    def receive(self, signal: Signal) -> None:
        """Take note of a capacity signal that arrives now; a continuous agent answers it at once.

        Parameters
        ----------
        signal : Signal
            The bit.
        """
        if not self._discrete:
            self.answer((signal,), self._env.now)
        elif self._latch:
            self._latch.setdefault(signal.resource, signal)
        else:
            self._latch[signal.resource] = signal
            self._mailbox.hand(signal)

    def process(self) -> ProcessGenerator:
        """Live: wait for a latch to be set, then for the next tick, and answer what is latched.

        Yields
        ------
        simpy.Event
            The first signal since the last tick; then the tick.  A continuous agent waits for
            nothing: its demand is a line until a signal arrives.
        """
        clocks = self.system.clocks
        while clocks is not None:
            yield self._mailbox
            tick = clocks.next_tick(self.agent, self.system.clock_time(self.agent))
            yield self._env.at(clocks.time(self.agent, tick), Kind.ACT, self.agent)
            self.answer(sorted(self._latch.values()), tick)
            self._latch.clear()

    def answer(self, signals: Sequence[Signal], moment: float) -> None:
        """Answer signals for different resources: Algorithm 2, the branch S = 1.

        Parameters
        ----------
        signals : sequence of Signal
            In the order of their resources.
        moment : float
            Index of the tick, or time.
        """
        if not self.separable:
            self._take_averages(moment)
        i, grain, averages = self.agent, self._grain, self._averages
        for signal in signals:
            j = signal.resource
            demand, accumulated, anchor, increase, decrease, normalization = self._rows[j]
            held, since = demand[i], moment - anchor[i]
            folded = accumulated_at(accumulated[i], held, increase, since, grain)
            averages[j] = average = time_average(folded, moment, grain)
            present = demand_at(held, increase, since, grain)
            probability = response_probability(normalization, self.marginal_cost(averages, j), average)
            if self.system.response_draws(signal)[i] < probability:
                kept = present * decrease
                demand[i], accumulated[i], anchor[i] = kept, folded, moment
                self._responses[j][i] += 1
                if probability > 1.0:
                    self._saturated[j][i] += 1
                for tell in self._on_response:
                    tell(self._env.now, j, kept - present)
                if self._log is not None:
                    entry = (j, i, signal.number, present - kept)
                    self._log.add((self._env.now, Entry.RESPOND, *entry))
            else:
                # A tick that holds is a tick without growth; a continuous agent just grows on.
                if self._discrete:
                    demand[i], accumulated[i], anchor[i] = present, folded, moment
                if self._log is not None:
                    self._log.add((self._env.now, Entry.HOLD, j, i, signal.number, 0.0))

    def _take_averages(self, moment: float) -> None:
        """Compute all averages before anything is answered: costs that couple resources read them."""
        i, grain = self.agent, self._grain
        for j, (demand, accumulated, anchor, increase, _, _) in enumerate(self._rows):
            folded = accumulated_at(accumulated[i], demand[i], increase, moment - anchor[i], grain)
            self._averages[j] = time_average(folded, moment, grain)
