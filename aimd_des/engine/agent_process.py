"""One agent as one SimPy process: the reference, to be read and to be extended."""

from collections.abc import Sequence

from aimd_des.dynamics.averaging import (
    CUMULATIVE,
    WINDOW,
    age_at,
    average_at,
    folded_at,
    keep_parts,
)
from aimd_des.dynamics.custom_response import called_plainly
from aimd_des.dynamics.loss_compensation import (
    ESTIMATED,
    KNOWN,
    NOTHING,
    compensation_factor,
    estimated_loss,
    read_number,
)
from aimd_des.dynamics.responses import (
    AVERAGE,
    DRAWN,
    OWN,
    OWN_COLUMNS,
    cut_factor,
    is_saturated,
    probability_of,
)
from aimd_des.engine.delivery import ProcessGenerator, Signal
from aimd_des.engine.environment import EventKind, Mailbox
from aimd_des.engine.system import System
from aimd_des.problem.costs import Costs, marginal_cost
from aimd_des.results.event_log import Entry
from aimd_des.utils.validation import FloatArray

# An enumeration is asked by way of its class, which takes as long as half an answer.
_RESPOND, _HOLD = float(Entry.RESPOND), float(Entry.HOLD)

# Views of the rows of demand, accumulated, anchor and origin for one resource; alpha, beta and Gamma.
_Row = tuple[FloatArray, FloatArray, FloatArray, FloatArray, float, float, float]


class AgentProcess:
    """An agent that works on its own column of the system's state.

    A discrete agent has a one-bit latch for each resource, which the first signal to arrive sets;
    it answers at its next tick.  A tick without a latch set is plain growth and needs no event.
    A continuous agent answers a signal when it arrives.  `Camera`, as the paper calls it, is the same class.

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
    increase, decrease, normalization : tuple of float, length m
        alpha, beta and Gamma as they are now.
    """

    def __init__(self, agent: int, system: System) -> None:
        self.agent = agent
        self.system = system
        self.marginal_cost = marginal_cost(system.conditions.costs, agent)
        self.separable = system.problem.costs.separable
        system.conditions.on_costs.append(self._reprice)
        self._discrete = system.clocks is not None
        # Whether a signal is answered when it arrives, by itself and as here, not as a derived class has it.
        own = type(self).answer is AgentProcess.answer
        self._at_once = own and self.separable and not self._discrete
        self._mailbox = Mailbox(system.env)
        # The first signal for each resource since the last tick, and those that came after it: one bit cannot
        # be set twice, but an agent that estimates losses reads their numbers.
        self._latch: dict[int, Signal] = {}
        self._late: list[Signal] = []
        self._averages = [0.0] * system.problem.n_resources
        parameters, rows = system.parameters, system.rows
        self.resources = range(system.problem.n_resources)
        self._take_parameters()
        system.conditions.on_parameters.append(self._take_parameters)
        self._responses, self._saturated = rows.responses, rows.saturated
        self._averaging, self._compensation = parameters.averaging, parameters.compensation
        self._cumulative = parameters.averaging.kind == CUMULATIVE
        self._response, self._memory = parameters.response, system.state.memory
        self._papers = self._response.cut == DRAWN and self._response.divisor == AVERAGE
        given, owned = system.response, self._response.divisor == OWN
        self._own = called_plainly(given, self._response) if owned and given is not None else None
        self._compensates = parameters.compensation.rule != NOTHING
        self._env, self._tick_weight, self._log = system.env, system.tick_weight, system.log
        self._on_response = system.on_response

    def _take_parameters(self) -> None:
        """Put at hand what an answer needs, as it is now: most of a run is spent there."""
        parameters, rows, i = self.system.parameters, self.system.rows, self.agent
        # Among the parameters, alpha is 0 while the agent is away.
        self.increase: tuple[float, ...] = tuple(self.system.conditions.increase[:, i].tolist())
        self.decrease: tuple[float, ...] = tuple(parameters.decrease[:, i].tolist())
        self.normalization: tuple[float, ...] = tuple(parameters.normalization.tolist())
        lines = rows.demand, rows.accumulated, rows.anchor, rows.origin
        own = self.increase, self.decrease, self.normalization
        self._rows: list[_Row] = list(zip(*lines, *own, strict=True))

    def receive(self, signal: Signal) -> None:
        """Take note of a capacity signal that arrives now; a continuous agent answers it at once."""
        if self._at_once:
            self._answer(signal, self._env.instant)
        elif not self._discrete:
            self.answer((signal,), self._env.now)
        elif signal.resource in self._latch:
            self._late.append(signal)
        else:
            # The process waits for the mailbox only while nothing is latched; then it waits for its tick.
            waiting = not self._latch
            self._latch[signal.resource] = signal
            if waiting:
                self._mailbox.hand(signal)

    def respond(
        self, resource: str | int, factor: float, signal: Signal | None = None, *, saturated: bool = False
    ) -> None:
        """Respond otherwise than by the rule: multiply the demand by a factor, count and log the response.

        Parameters
        ----------
        resource : str or int
            Its name, or j.
        factor : float
            From 0 to 1.
        signal : Signal, optional
            The signal that is answered, whose number the log names.
        saturated : bool
            Whether the response probability was above 1, which is counted, too.
        """
        self.system.respond(self.agent, resource, factor, signal, saturated=saturated)

    def forget(self) -> None:
        """Clear what is latched: the agent goes away."""
        # Its process, if it waits for a tick, finds nothing there and waits for a signal again.
        self._latch.clear()
        self._late.clear()

    def process(self) -> ProcessGenerator:
        """Live: wait for a latch to be set, then for the next tick, and answer what is latched."""
        clocks = self.system.clocks
        while clocks is not None:
            yield self._mailbox
            # A tick at this very instant counts unless it is over: signals are delivered before agents act.
            tick = clocks.next_tick(self.agent, self.system.clock_time(self.agent))
            yield self._env.at(clocks.time(self.agent, tick), EventKind.ACT, self.agent)
            # By resource, not by arrival: the order of a tick's entries in the log, however agents are run.
            self.answer(sorted(self._latch.values()), tick)
            if self._compensation.rule == ESTIMATED:
                for signal in self._late:  # a latch is answered once, but the numbers are read
                    self._read_number(signal)
            self.forget()

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
        for signal in signals:
            self._answer(signal, moment)

    def _answer(self, signal: Signal, moment: float) -> None:
        """Answer one signal, all averages that its cost reads being known but its own."""
        i, j, weight = self.agent, signal[0], self._tick_weight
        demand, accumulated, anchor, origin, increase, factor, normalization = self._rows[j]
        held, since = demand[i], moment - anchor[i]
        # Formulas that kernels compile, too: rearranging one changes the bits of both.  Those of the
        # paper's average and rule are written out, which spares most runs five calls for every answer.
        if self._cumulative:
            folded = accumulated[i] + (since * held + increase * (0.5 * since * (since - weight)))
            age = (moment - origin[i]) + weight
            average = folded / age if age > 0.0 else 0.0
        else:
            folded, average = self._fold(j, moment)
        self._averages[j] = average
        slope = self.marginal_cost(self._averages, j)
        if self._papers:
            probability = normalization * slope / average if average > 0.0 else 0.0
            if self._compensates:
                probability *= self._factor(signal, moment)
            responds = self.system.response_draws(signal)[i] < probability
        else:
            present = held + increase * (since - weight)
            probability, factor = self._drawn(signal, slope, average, present, moment)
            responds = factor < 1.0
        if responds:
            self._respond(signal, moment, folded, held + increase * (since - weight), factor, probability)
            return
        # A tick that holds is a tick without growth; a continuous agent just grows on.
        if self._discrete:
            self._break_line(j, held + increase * (since - weight), folded, moment)
        if self._log is not None:
            now = self._env.now if self._discrete else moment
            self._log.add(now, _HOLD, j, i, signal.number, 0.0)

    def _respond(
        self, signal: Signal, moment: float, folded: float, present: float, factor: float, probability: float
    ) -> None:
        """Respond: go on from a share of what is held, and let others know."""
        i, j, kept = self.agent, signal[0], present * factor
        now = self._env.now if self._discrete else moment
        self._break_line(j, kept, folded, moment)
        self._responses[j][i] += 1
        # Draws are below 1, so that an agent with more than 1 responds, and is counted.
        if probability > 1.0:
            self._saturated[j][i] += is_saturated(self._response, probability, self.decrease[j])
        # Listeners are told when the new line has begun, so what they read is what is so now.
        for tell in self._on_response:
            tell(now, j, kept - present)
        if self._log is not None:
            self._log.add(now, _RESPOND, j, i, signal.number, present - kept)

    def _drawn(
        self, signal: Signal, slope: float, average: float, present: float, moment: float
    ) -> tuple[float, float]:
        """Return lambda, and what demand is multiplied by, for any response to signals."""
        j = signal.resource
        probability = self._probability(j, slope, average, present, moment)
        if self._compensates:
            probability *= self._factor(signal, moment)
        uniform = self.system.response_draws(signal)[self.agent]
        return probability, self._cut(j, probability, uniform, present)

    def _probability(
        self, resource: int, slope: float, average: float, demand: float, moment: float
    ) -> float:
        """Return lambda, for any response to signals."""
        i, j, row, response, memory = self.agent, resource, self._rows[resource], self._response, self._memory
        age = age_at(moment, row[3][i], self._tick_weight)
        found = (row[6], slope, average, demand, row[4], row[5], age)
        if self._own is not None:
            own = memory[j, i, OWN_COLUMNS:]
            return self._own((*found, float(i), float(j)), own) if average > 0.0 else 0.0
        return float(probability_of(response, self._averaging, memory, j, i, *found))

    def _cut(self, resource: int, probability: float, uniform: float, demand: float) -> float:
        """Return what demand is multiplied by, where no draw alone decides."""
        found = (probability, uniform, demand, self.decrease[resource])
        place = (self._memory, resource, self.agent)
        return float(cut_factor(self._response, self._averaging, *place, *found))

    def _break_line(self, resource: int, demand: float, folded: float, moment: float) -> None:
        """Begin a new line with what is held now."""
        i, row = self.agent, self._rows[resource]
        # While the line that ends is still there: what lies on it within the window is known from it alone.
        if self._averaging.kind == WINDOW:
            line = row[1][i], row[0][i], row[4], row[2][i], row[3][i]
            parts = self.system.state.parts
            keep_parts(self._averaging, parts, resource, i, *line, moment, self._tick_weight)
        row[0][i], row[1][i], row[2][i] = demand, folded, moment

    def _fold(self, resource: int, moment: float) -> tuple[float, float]:
        """Compute what is accumulated, and the average, for any way of averaging."""
        i, averaging, tick_weight = self.agent, self._averaging, self._tick_weight
        demand, accumulated, anchor, origin, increase, _, _ = self._rows[resource]
        line = accumulated[i], demand[i], increase
        before = age_at(anchor[i], origin[i], tick_weight)
        folded = folded_at(averaging, *line, moment - anchor[i], before, tick_weight)
        parts, span = self.system.state.parts, (anchor[i], origin[i], moment, tick_weight)
        return folded, average_at(averaging, parts, resource, i, folded, *line, *span)

    def _take_averages(self, moment: float) -> None:
        """Compute all averages before anything is answered: costs that couple resources read them."""
        for j in self.resources:
            _, self._averages[j] = self._fold(j, moment)

    def _read_number(self, signal: Signal) -> None:
        """Count a signal that has been heard, by its running number; a duplicate is known by it."""
        if signal.copy:
            return
        rows, i, j, period = self.system.rows, self.agent, signal.resource, self._compensation.period
        heard, first, latest = rows.heard[j], rows.first[j], rows.latest[j]
        heard[i], first[i], latest[i] = read_number(signal.number, heard[i], first[i], latest[i], period)

    def _factor(self, signal: Signal, moment: float) -> float:
        """Return what compensates for the signals that the agent loses, or estimates that it loses."""
        # The answer at hand is one of those that the factor is computed from.
        rows, i, j = self.system.rows, self.agent, signal.resource
        rows.answered[j][i] += 1
        if self._compensation.rule == KNOWN:
            loss = float(self._compensation.loss[i])
        else:
            # Before the estimate, which counts this signal among those heard; late ones follow the answers.
            self._read_number(signal)
            loss = estimated_loss(rows.heard[j][i], rows.first[j][i], rows.latest[j][i])
        age = age_at(moment, rows.origin[j][i], self._tick_weight)
        return compensation_factor(loss, rows.answered[j][i], age, self._tick_weight)

    def _reprice(self, costs: Costs) -> None:
        """Take in new private costs."""
        self.marginal_cost = marginal_cost(costs, self.agent)


#: The name that the paper gives it.
Camera = AgentProcess
