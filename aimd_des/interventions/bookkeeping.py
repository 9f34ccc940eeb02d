"""The books that every change keeps: the log, and the problems that are in force one after another."""

from aimd_des.engine.planned_changes import Planned
from aimd_des.engine.system import System
from aimd_des.results.event_log import Entry
from aimd_des.results.run_data import Piece
from aimd_des.utils import validation
from aimd_des.utils.locked_arrays import locked


class BeginsAt(Planned):
    """An intervention that begins at a time; to be derived from by data classes."""

    at: float

    def __post_init__(self) -> None:
        at = validation.number(f"{type(self).__name__}.at", self.at, low=0.0)
        object.__setattr__(self, "at", at)

    @property
    def begins(self) -> float:
        """When it first changes something, in units of time."""
        return self.at


def note(system: System, entry: Entry, resource: int = -1, agent: int = -1, value: float = 0.0) -> None:
    """Enter a change in the log."""
    if system.log is not None:
        system.log.add(system.env.now, entry, resource, agent, -1, value)


def end_piece(system: System) -> None:
    """Close the records of the problem that has been in force."""
    system.settle()
    for close in system.conditions.on_piece:
        close()


def begin_piece(system: System) -> None:
    """Note the problem that is in force from now on; what has been so for no time is forgotten."""
    conditions, now = system.conditions, float(system.env.now)
    if conditions.pieces[-1].start == now:
        conditions.pieces.pop()
    piece = Piece(now, locked(system.parameters.capacity.copy()), locked(~conditions.away), conditions.costs)
    conditions.pieces.append(piece)
