"""One run in progress: what the control unit, the channel, the agents and observers share."""

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from aimd_des.channel import Channel, CompiledLink, Link
from aimd_des.channel.memory import memory_of, remember
from aimd_des.dynamics.averaging import Averaging, age_at, folded_at, keep_parts
from aimd_des.dynamics.clocks import Clocks
from aimd_des.dynamics.demand import CONTINUOUS, DISCRETE
from aimd_des.dynamics.loss_compensation import Compensation
from aimd_des.dynamics.responses import Response
from aimd_des.dynamics.state import AgentParameters, State, agent_parameters, own_parameters, start
from aimd_des.engine.conditions import Conditions
from aimd_des.engine.delivery import Agent, Carrier, Collective, ResponseDraws, Signal
from aimd_des.engine.environment import OrderedEnvironment
from aimd_des.engine.system_view import Readings
from aimd_des.engine.transmitter import Transmitter
from aimd_des.problem.lookup import agent_index, resource_index
from aimd_des.problem.problem import Problem
from aimd_des.results.event_log import Entry, EventLog
from aimd_des.utils import returned_values, rng, validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.locked_arrays import carry_over, put
from aimd_des.utils.rng import Key, Purpose

if TYPE_CHECKING:
    import pandas as pd


class Part(Protocol):
    """What keeps something of a run."""

    def state(self) -> dict[str, Any]:
        """Return what it keeps: arrays, numbers, strings, and collections of them."""
        ...

    def resume(self, state: Any) -> None:
        """Go on from what `state` has returned in another run; nothing of it may be written to."""
        ...


class _Agents(NamedTuple):
    """The state of all agents, and the parameters of their rule that interventions can change."""

    held: State
    parameters: AgentParameters

    def state(self) -> dict[str, Any]:
        """Return both."""
        return {"held": self.held[:-1], "memory": self.held.memory, "parameters": self.parameters[:5]}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        names = self.held._fields
        for name, array, kept in zip(names, self.held, (*state["held"], state["memory"]), strict=True):
            if name in ("anchor", "pause"):
                array[...] = kept
            # What another response has kept is of no use to one that is new, and begins with nothing.
            elif kept is not None:
                carry_over(kept, array)
        for rows, kept in zip(self.parameters[:5], state["parameters"], strict=True):
            put(rows, slice(None), kept)


class _Link(NamedTuple):
    """The channel in force, which may be the user's own."""

    system: "System"

    def state(self) -> dict[str, Any]:
        """Return which it is, and what it remembers."""
        return {"channel": self.system.channel, "memory": memory_of(self.system.link)}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        # Another one than the run began with, where an intervention has changed it.
        if state["channel"] is not self.system.channel:
            self.system.change_channel(state["channel"])
        remember(self.system.link, state["memory"])


def keys_of(seed: int, salts: tuple[int, ...] = ()) -> dict[Purpose, Key]:
    """Derive what the draws of a run are made with, a key for each purpose."""
    # Clocks keep their draws: how many ticks are over must not change when a run is forked.
    return {purpose: rng.key(seed, purpose, () if purpose is Purpose.CLOCK else salts) for purpose in Purpose}


class System(Readings):
    """What the parts of one run share.

    Parameters
    ----------
    problem : Problem
        What is shared, by how many.
    channel : Channel
        Carries the broadcasts.
    clocks : Clocks, optional
        The clocks of discrete agents; continuous agents have none.
    seed : int
        The run's seed.
    until : float
        The end of the run.
    log : EventLog, optional
        Where every event is written.
    averaging : Averaging, optional
        How agents average their demand; default: over all of their past.
    compensation : Compensation, optional
        What they do about losses; default: nothing.
    response : Response, optional
        How they answer signals; default: by the paper's rule.
    keys : mapping of Purpose to Key, optional
        What draws are made with; default: as the seed has it.
    like : System, optional
        Of a run of the same problem and rule, of which this one is a fork: what stays as it is is shared.

    Attributes
    ----------
    agents : dict of int to Agent
        The agents that are processes of their own, by their index.
    conditions : Conditions
        What interventions change.
    channel : Channel
        Carries what is sent now.
    transmitter : Transmitter
        Sends the signals and keeps the account of them.
    collective : Collective or None
        The agents that are advanced together, if there are any.
    response_draws : callable
        Gives, for a signal, what decides how each agent responds to it: n uniform numbers.
    on_response, on_intervention : list of callable
        Called with (time, resource, change) when an agent has responded to a signal, and when a
        demand has been set from outside.
    on_break : list of callable
        Called with (agent) when its demand goes on as a new line for another reason than its own answer.
    parts : dict of str to Part
        What keeps something of this run, by a name; a run that is forked goes on from what they return.
    """

    def __init__(
        self,
        problem: Problem,
        channel: Channel,
        clocks: Clocks | None,
        seed: int,
        until: float,
        log: EventLog | None = None,
        averaging: Averaging | None = None,
        compensation: Compensation | None = None,
        response: Response | None = None,
        keys: Mapping[Purpose, Key] | None = None,
        like: "System | None" = None,
    ) -> None:
        n, m = problem.n_agents, problem.n_resources
        # A key for each purpose: what one of them draws moves no number of another.
        self.keys = keys_of(seed) if keys is None else keys
        self.channel, self.link = channel, self._opened(channel, n, like)
        self.response = response
        tick_weight = CONTINUOUS if clocks is None else DISCRETE
        # Arrays of this run: interventions write them, so nothing of the problem's may be among them.
        if like is not None and response is like.response:
            parameters = own_parameters(like.parameters)
        else:
            parameters = agent_parameters(problem, tick_weight, averaging, compensation, response)
        own = None if clocks is None else clocks.start(n, self.keys[Purpose.CLOCK])
        super().__init__(
            problem,
            OrderedEnvironment(),
            own,
            start(m, n, tick_weight, parameters),
            parameters,
            tick_weight,
        )
        self.until = until
        self.log = log
        self.conditions = Conditions.at_start(problem)
        self.agents: dict[int, Agent] = {}
        self.on_response: list[Callable[[float, int, float], None]] = []
        self.on_intervention: list[Callable[[float, int, float], None]] = []
        self.on_break: list[Callable[[int], None]] = []
        self.collective: Collective | None = None
        carrier = Carrier(self.env, self.agents, self.conditions.away, log)
        self.transmitter = Transmitter(self.env, self.link, m, self.conditions, until, carrier, log)
        draws = ResponseDraws(self.keys[Purpose.RESPONSE], n)
        self.response_draws: Callable[[Signal], list[float]] = draws.__getitem__
        self.parts: dict[str, Part] = {
            "agents": _Agents(self.state, self.parameters),
            "conditions": self.conditions,
            "transmitter": self.transmitter,
            "link": _Link(self),
        }
        if log is not None:
            self.parts["log"] = log

    def _opened(self, channel: Channel, n_agents: int, like: "System | None" = None) -> Link:
        """Let a channel begin, which may be the user's own, or that of another run."""
        if like is not None and channel is like.channel and isinstance(like.link, CompiledLink):
            return like.link.anew(self.keys)
        said = returned_values.said_by(channel, "open")
        with returned_values.calling(said):
            link = channel.open(n_agents, self.keys)
        returned_values.having(said, link, ["transmit"])
        return link

    def change_channel(self, channel: Channel) -> None:
        """Let signals go over another channel from now on; what has been sent arrives as it would have.

        Parameters
        ----------
        channel : Channel
            It begins now: it knows of no signal that was sent before.

        Raises
        ------
        InputError
            If it does not fit the number of agents, or its link has no ``transmit``.
        """
        link = self._opened(channel, self.problem.n_agents)
        self.settle()
        self.channel = channel
        self.link = self.transmitter.link = link
        returned_values.attach(link, self)
        for tell in self.conditions.on_channel:
            tell()

    def events(self, since: int = 0) -> "pd.DataFrame":
        """Read the event log as far as it goes, or the entries since it was read last.

        Parameters
        ----------
        since : int
            How many entries are left out, from the first on: those that are known already.

        Returns
        -------
        DataFrame
            The rows that `Result.events` will have, numbered from 0.

        Raises
        ------
        InputError
            If the run keeps no log.
        """
        if self.log is None:
            raise InputError("events: the run keeps no log; run it with Recording(events=True)")
        first = validation.integer("since", since, low=0)
        return self.log.frame(self.problem.resource_names, self.problem.agent_names, first)

    def set_demand(self, agent: str | int, resource: str | int, demand: float) -> None:
        """Set one agent's demand for one resource, from which it grows on.

        Parameters
        ----------
        agent, resource : str or int
            Their names, or i and j.
        demand : float
            At least 0, in units of the resource.

        Raises
        ------
        InputError
            If there is no such agent or resource, the agent is away, or the demand is negative or not
            finite.
        """
        demand = validation.number("demand", demand, low=0.0)
        i, j = self._here(agent), resource_index(self.problem, resource)
        # Reading it settles: copies that were due before are answered from what was held then.
        before = self.demand(i, j)
        self.break_line(i, j, demand)
        if self.log is not None:
            self.log.add(self.env.now, Entry.CHANGE, j, i, -1, demand - before)
        for tell in self.on_intervention:
            tell(self.env.now, j, demand - before)
        # A lower demand can only delay a crossing, and a look that comes too early finds nothing.
        if demand > before:
            self.tighten(j)

    def respond(
        self,
        agent: str | int,
        resource: str | int,
        factor: float,
        signal: Signal | None = None,
        *,
        saturated: bool = False,
    ) -> None:
        """Let an agent of one's own respond: multiply its demand, and count and log the response.

        Parameters
        ----------
        agent, resource : str or int
            Their names, or i and j.
        factor : float
            What its demand is multiplied by, from 0 to 1.
        signal : Signal, optional
            The signal that it answers, whose number the log names.
        saturated : bool
            Whether its response probability was above 1, which is counted, too.

        Raises
        ------
        InputError
            If there is no such agent or resource, the agent is away, or the factor is outside its range.
        """
        factor = validation.number("factor", factor, low=0.0, high=1.0)
        i, j = self._here(agent), resource_index(self.problem, resource)
        before = self.demand(i, j)
        kept = before * factor
        self.break_line(i, j, kept)
        self.state.responses[j, i] += 1
        self.state.saturated[j, i] += validation.flag("saturated", saturated)
        for tell in self.on_response:
            tell(self.env.now, j, kept - before)
        if self.log is not None:
            number = -1 if signal is None else signal.number
            self.log.add(self.env.now, Entry.RESPOND, j, i, number, before - kept)

    def _here(self, agent: str | int) -> int:
        """Return the index of an agent, which must not be away."""
        i = agent_index(self.problem, agent)
        if self.conditions.away[i]:
            name = self.problem.agent_names[i]
            raise InputError.of("agent", name, "one that is here", "let it join first")
        return i

    def break_line(self, agent: int, resource: int, demand: float) -> None:
        """Let one agent's demand for one resource go on as a new line, without telling other parts.

        Parameters
        ----------
        agent, resource : int
            i and j.
        demand : float
            From which it grows on, in units of the resource.
        """
        i, j, rows, averaging = agent, resource, self.rows, self.parameters.averaging
        held, folded, anchor = rows.demand[j], rows.accumulated[j], rows.anchor[j]
        # A tick folds in the demand at hand, so what is set now stands just before the next tick.
        last = self.moment(i) - self.tick_weight
        # Alpha as it is now, not the problem's: while the agent was away, its line did not grow.
        line = folded[i], held[i], float(self.parameters.increase[j, i])
        keep_parts(
            averaging, self.state.parts, j, i, *line, anchor[i], rows.origin[j][i], last, self.tick_weight
        )
        before = age_at(anchor[i], rows.origin[j][i], self.tick_weight)
        folded[i] = folded_at(averaging, *line, last - anchor[i], before, self.tick_weight)
        held[i], anchor[i] = demand, last
        for tell in self.on_break:
            tell(i)

    def tighten(self, resource: int) -> None:
        """Let it be known that a threshold may be reached sooner than it looked.

        Parameters
        ----------
        resource : int
            j.
        """
        for tell in self.conditions.on_tightening:
            tell(self.env.now, resource)

    def settle(self) -> None:
        """Bring agents that are advanced together to where events have come; reading does it, too."""
        if self.collective is not None:
            self.collective.settle()

    def forget(self, agent: int, *, lost: bool) -> None:
        """Drop what an agent has been sent and has not acted on yet.

        Parameters
        ----------
        agent : int
            i.
        lost : bool
            Whether it is lost, since the agent was away; if not, it was delivered.
        """
        # An agent belongs to one of the two; one that is no member, or has no such method, is not concerned.
        if self.collective is not None:
            self.collective.forget(agent, lost=lost)
        own = getattr(self.agents.get(agent), "forget", None)  # an agent need not have it
        if own is not None:
            own()

    def finish(self) -> None:
        """Settle what is due by the end, and take note of what landed at agents that were away."""
        self.settle()
        # Copies that wait for a tick of an agent that is away are still counted as delivered.
        for agent in np.flatnonzero(self.conditions.away).tolist():
            self.forget(agent, lost=True)

    def join(self, collective: Collective) -> None:
        """Let agents that are advanced together take part.

        Parameters
        ----------
        collective : Collective
            There is one at most.
        """
        self.collective = self.transmitter.collective = collective
        # Asked for by collectives alone, and every event pays for it.
        self.env.tracking = True
        # Their entries are written when they settle: before any later one, so that the log is in order.
        if self.log is not None:
            self.log.lead(collective.settle)

    def broadcast(self, resource: str | int, delay: float = 0.0) -> None:
        """Send a capacity signal for one resource to all agents.

        Parameters
        ----------
        resource : str or int
            Its name, or j.
        delay : float
            How long after now it leaves the control unit, at least 0 and in units of time; a partition, or a
            fault of the control unit, cuts it where it lasts when it leaves.

        Raises
        ------
        InputError
            If there is no such resource, the delay is negative or not finite, or the channel says
            anything but a time for each agent that is not before the departure.
        """
        j = resource_index(self.problem, resource)
        delay = validation.number("delay", delay, low=0.0)
        # What is due before now is answered first: once something is sent, nothing is settled in this event.
        self.settle()
        # The log alone tells it; a control unit that has just read it sends by the transmitter itself.
        total = math.nan if self.log is None else self.total(j)
        self.transmitter.send(j, self.env.now, delay, total)
