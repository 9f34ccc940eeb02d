"""What every model of loss does."""

from typing import Protocol, runtime_checkable

from aimd_des.channel.random_draws import Draws
from aimd_des.utils.validation import BoolArray


class LossProcess(Protocol):
    """The losses of one run; it may remember what was before.

    If its runs can be forked and saved, it has two more methods. ``state()`` returns what it remembers: a
    dict of numbers, strings, lists and arrays. ``resume(state)`` reads that at the start of another run,
    without writing to it.
    """

    def draw(self, draws: Draws) -> BoolArray:
        """Return whether each agent's copy is lost, shape (n,); broadcasts come in the order of time."""
        ...


@runtime_checkable
class Loss(Protocol):
    """A model of loss, which starts afresh with every run."""

    def start(self, n_agents: int) -> LossProcess:
        """Begin a run with n agents; refuse parameters that are given for each and do not number n."""
        ...
