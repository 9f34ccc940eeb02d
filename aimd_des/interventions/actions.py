"""Which agents take part and hear, changed during a run: functions of the system, called by processes.

What is changed holds from the present event on.  Call these at `EventKind.INTERVENE`, so that everything else
that happens at the same instant finds the new conditions.  What has begun twice ends when it has ended twice.
"""

import numpy as np

from aimd_des.engine.conditions import growth_of
from aimd_des.engine.system import System
from aimd_des.interventions.bookkeeping import begin_piece, end_piece, note
from aimd_des.problem.lookup import Agents, agent_index, agent_indices
from aimd_des.results.event_log import Entry
from aimd_des.utils.errors import InputError
from aimd_des.utils.locked_arrays import put
from aimd_des.utils.validation import FloatArray


def leave(system: System, agent: str | int) -> None:
    """Let an agent go away: what it holds is released in this instant, and it hears nothing.

    Its average stays constant.  A signal that has reached it and waits for its next tick is forgotten.

    Parameters
    ----------
    system : System
        The run in progress.
    agent : str or int
        Its name, or i.

    Raises
    ------
    InputError
        If there is no such agent, or it is away already.
    """
    i, conditions = agent_index(system.problem, agent), system.conditions
    if conditions.away[i]:
        raise InputError.of("agent", system.problem.agent_names[i], "one that is here", "it is away already")
    end_piece(system)
    for j in range(system.problem.n_resources):
        system.set_demand(i, j, 0.0)
    system.state.pause[:, i] = system.moment(i) - system.tick_weight
    _grow(system, i, 0.0)
    system.forget(i, lost=False)
    put(conditions.away, i, True)
    note(system, Entry.LEAVE, agent=i)
    begin_piece(system)


def join(system: System, agent: str | int, *, anew: bool = False) -> None:
    """Let an agent that is away come back; it begins with nothing in hand.

    Parameters
    ----------
    system : System
        The run in progress.
    agent : str or int
        Its name, or i.
    anew : bool
        Whether it has forgotten its past and averages from now on; if not, its average goes on from where it
        stood, and the time in between counts for nothing.

    Raises
    ------
    InputError
        If there is no such agent, or it is here.
    """
    i, conditions, state = agent_index(system.problem, agent), system.conditions, system.state
    if not conditions.away[i]:
        raise InputError.of("agent", system.problem.agent_names[i], "one that is away", "it is here already")
    end_piece(system)
    system.forget(i, lost=True)
    put(conditions.away, i, False)
    moment, last = system.moment(i), system.moment(i) - system.tick_weight
    if anew:
        state.origin[:, i], state.accumulated[:, i], state.answered[:, i] = moment, 0.0, 0
        state.memory[:, i] = 0.0
    else:
        state.origin[:, i] += last - state.pause[:, i]
    # Numbers that were sent while it was away are not lost signals.
    state.heard[:, i] = 0
    state.anchor[:, i], state.pause[:, i] = last, np.inf
    _grow(system, i, conditions.increase[:, i])
    note(system, Entry.JOIN, agent=i, value=float(anew))
    begin_piece(system)
    for j in range(system.problem.n_resources):
        system.tighten(j)


def _grow(system: System, agent: int, increase: float | FloatArray) -> None:
    put(system.parameters.increase, (slice(None), agent), increase)
    put(system.conditions.growth, slice(None), growth_of(system.parameters.increase))


def cut_off(system: System, agents: Agents) -> None:
    """Cut agents off: signals that leave from now on are lost on them; what is on its way arrives.

    Parameters
    ----------
    system : System
        The run in progress.
    agents : str, int or sequence of these
        Which agents are on the other side: names, or i.

    Raises
    ------
    InputError
        If there is no such agent, one is named twice, or none is named.
    """
    conditions = system.conditions
    for i in agent_indices(system.problem, agents):
        put(conditions.cuts, i, conditions.cuts[i] + 1)
        if not conditions.cut[i]:
            put(conditions.cut, i, True)
            note(system, Entry.CUT, agent=i)


def reconnect(system: System, agents: Agents) -> None:
    """Let signals that leave from now on get through again to agents that nothing else cuts off.

    Parameters
    ----------
    system : System
        The run in progress.
    agents : str, int or sequence of these
        Which agents: names, or i.

    Raises
    ------
    InputError
        If there is no such agent, one is not cut off, one is named twice, or none is named.
    """
    conditions, indices = system.conditions, agent_indices(system.problem, agents)
    for i in indices:
        if not conditions.cuts[i]:
            raise InputError.of("agent", system.problem.agent_names[i], "one that is cut off", "it hears")
    for i in indices:
        put(conditions.cuts, i, conditions.cuts[i] - 1)
        if not conditions.cuts[i]:
            put(conditions.cut, i, False)
            note(system, Entry.HEAL, agent=i)


def fail(system: System) -> None:
    """Let the control unit go down: it sends nothing until another one takes over.

    Parameters
    ----------
    system : System
        The run in progress.
    """
    conditions = system.conditions
    conditions.failures += 1
    if not conditions.failed[0]:
        put(conditions.failed, 0, True)
        note(system, Entry.FAIL)


def recover(system: System) -> None:
    """Let a control unit take over, if no other fault goes on.

    One that samples does so at its next look, one that senses crossings at once.

    Parameters
    ----------
    system : System
        The run in progress.

    Raises
    ------
    InputError
        If the control unit is not down.
    """
    conditions = system.conditions
    if not conditions.failures:
        raise InputError.of("control unit", "up", "down before it recovers", "let it fail first")
    conditions.failures -= 1
    if not conditions.failures:
        put(conditions.failed, 0, False)
        note(system, Entry.RECOVER)
        for tell in conditions.on_recovery:
            tell(float(system.env.now))
