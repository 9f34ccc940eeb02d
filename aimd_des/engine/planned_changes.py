"""Interventions whose changes are listed beforehand: how far a run has come in the list is a number."""

from collections.abc import Callable, Hashable, Iterable, Mapping
from itertools import islice
from typing import Any

from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System

#: When something changes, and what is called then.
Change = tuple[float, Callable[[], object]]

#: What an agenda remembers: numbers, strings, and lists of them, by a name.
Memory = dict[str, Any]


class Planned:
    """An intervention that is a list of changes: to be derived from, with `check` and `changes`.

    Runs in which it is can be forked and saved, since where they stand in the list is a number.
    """

    def changes(self, system: System, memory: Memory) -> Iterable[Change]:
        """List what changes, and when.

        Parameters
        ----------
        system : System
            The run in progress.
        memory : dict
            For what a change finds and a later one needs: numbers, strings and lists of them.  It begins with
            ``"name"``, which no other intervention of the run has.

        Returns
        -------
        iterable of (float, callable)
            Times, in units of time and ascending, and what is called then without arguments.  It is listed
            again where a run is gone on with, and must be the same then: what depends on the run belongs into
            the functions.
        """
        raise NotImplementedError

    def process(self, system: System) -> ProcessGenerator:
        """Live: make the changes one after the other."""
        return Agenda(system, self, object()).process()  # no other has that name


def is_planned(intervention: object) -> bool:
    """Tell whether an intervention does what its list of changes says, and nothing else."""
    # A class that is derived from one of ours and has a process of its own does otherwise there.
    return isinstance(intervention, Planned) and type(intervention).process is Planned.process


class Agenda:
    """The list of changes of one intervention in one run, and how far it is done."""

    def __init__(self, system: System, planned: Planned, name: Hashable) -> None:
        self.system, self.planned, self.name = system, planned, name
        self.done = 0
        self.memory: Memory = {"name": name}

    def process(self, again: bool = False) -> ProcessGenerator:
        """Make the changes that are left."""
        for time, change in islice(self.planned.changes(self.system, self.memory), self.done, None):
            yield self.system.env.at(time, EventKind.INTERVENE)
            self.done += 1
            change()

    def state(self) -> dict[str, Any]:
        """Return how far it is, and what it remembers."""
        return {"done": self.done, "memory": dict(self.memory)}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        self.done, self.memory = state["done"], dict(state["memory"])
