"""What can be changed while a run goes on: each is one function of the system, to be called by a process.

What is changed holds from the present event on.  Call these at `Kind.INTERVENE`, so that everything else that
happens at the same instant finds the new conditions.
"""

from collections.abc import Sequence

import numpy as np

from aimd_des import checks
from aimd_des.conditions import growth_of
from aimd_des.errors import InputError
from aimd_des.interventions.books import begin_piece, end_piece, known_agent, note
from aimd_des.log import Entry
from aimd_des.system import System

__all__ = ["cut_off", "fail", "join", "leave", "reconnect", "recover", "set_capacity"]


def set_capacity(system: System, resource: int, capacity: float) -> None:
    """Change the capacity of a resource, and its threshold in proportion.

    Parameters
    ----------
    system : System
        The run in progress.
    resource : int
        j.
    capacity : float
        C > 0, in units of the resource.

    Raises
    ------
    InputError
        If there is no such resource, or the capacity is not positive.
    """
    j = checks.integer("resource", resource, low=0, high=system.problem.n_resources - 1)
    value = checks.number("capacity", capacity, low=0.0, low_open=True)
    end_piece(system)
    lower = value < system.law.capacity[j]
    system.law.capacity[j] = value
    system.law.limit[j] = system.problem.threshold[j] * value
    note(system, Entry.CAPACITY, resource=j, value=value)
    begin_piece(system)
    if lower:
        system.tighten(j)


def leave(system: System, agent: int) -> None:
    """Let an agent go away: what it holds is released in this instant, and it hears nothing.

    Its average stands still.  A signal that has reached it and waits for its next tick is forgotten.

    Parameters
    ----------
    system : System
        The run in progress.
    agent : int
        i.

    Raises
    ------
    InputError
        If there is no such agent, or it is away already.
    """
    i, conditions = known_agent(system, agent), system.conditions
    if conditions.away[i]:
        raise InputError.of("agent", system.problem.agent_names[i], "one that is here", "it is away already")
    end_piece(system)
    for j in range(system.problem.n_resources):
        system.set_demand(i, j, 0.0)
    system.state.pause[:, i] = system.moment(i) - system.grain
    system.law.increase[:, i] = 0.0
    conditions.growth[:] = growth_of(system.law.increase)
    system.forget(i, lost=False)
    conditions.away[i] = True
    note(system, Entry.LEAVE, agent=i)
    begin_piece(system)


def join(system: System, agent: int, *, anew: bool = False) -> None:
    """Let an agent that is away come back; it begins with nothing in hand.

    Parameters
    ----------
    system : System
        The run in progress.
    agent : int
        i.
    anew : bool
        Whether it has forgotten its past and averages from now on; if not, its average goes on from where it
        stood, and the time in between counts for nothing.

    Raises
    ------
    InputError
        If there is no such agent, or it is here.
    """
    i, conditions, state = known_agent(system, agent), system.conditions, system.state
    if not conditions.away[i]:
        raise InputError.of("agent", system.problem.agent_names[i], "one that is away", "it is here already")
    end_piece(system)
    system.forget(i, lost=True)
    conditions.away[i] = False
    moment, last = system.moment(i), system.moment(i) - system.grain
    if anew:
        state.origin[:, i], state.accumulated[:, i], state.answered[:, i] = moment, 0.0, 0
    else:
        state.origin[:, i] += last - state.pause[:, i]
    # Numbers that were sent while it was away are not lost signals.
    state.heard[:, i] = 0
    state.anchor[:, i], state.pause[:, i] = last, np.inf
    system.law.increase[:, i] = system.problem.increase[i]
    conditions.growth[:] = growth_of(system.law.increase)
    note(system, Entry.JOIN, agent=i, value=float(anew))
    begin_piece(system)
    for j in range(system.problem.n_resources):
        system.tighten(j)


def cut_off(system: System, agents: Sequence[int]) -> None:
    """Cut agents off: signals that are sent from now on are lost on them; what is on its way arrives.

    Parameters
    ----------
    system : System
        The run in progress.
    agents : sequence of int
        Who is on the other side.

    Raises
    ------
    InputError
        If there is no such agent.
    """
    _cut(system, agents, cut=True)


def reconnect(system: System, agents: Sequence[int]) -> None:
    """Let signals that are sent from now on get through to agents again.

    Parameters
    ----------
    system : System
        The run in progress.
    agents : sequence of int
        Who.

    Raises
    ------
    InputError
        If there is no such agent.
    """
    _cut(system, agents, cut=False)


def _cut(system: System, agents: Sequence[int], *, cut: bool) -> None:
    for agent in agents:
        i = known_agent(system, agent)
        system.conditions.cut[i] = cut
        note(system, Entry.CUT if cut else Entry.HEAL, agent=i)


def fail(system: System) -> None:
    """Let the control unit go down: it sends nothing until another one takes over.

    Parameters
    ----------
    system : System
        The run in progress.
    """
    system.conditions.failed[0] = True
    note(system, Entry.FAIL)


def recover(system: System) -> None:
    """Let a control unit take over: one that samples at its next look, one that senses crossings at once.

    Parameters
    ----------
    system : System
        The run in progress.
    """
    system.conditions.failed[0] = False
    note(system, Entry.RECOVER)
    for tell in system.conditions.on_recovery:
        tell(float(system.env.now))
