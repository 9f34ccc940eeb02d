"""What every model of loss does."""

from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from aimd_des.channel.draws import Draws

__all__ = ["BoolArray", "Loss", "LossProcess"]

BoolArray = npt.NDArray[np.bool_]


class LossProcess(Protocol):
    """The losses of one run; it may remember what was before."""

    def draw(self, draws: Draws) -> BoolArray:
        """Return whether each agent's copy is lost, shape (n,); broadcasts come in the order of time."""
        ...


@runtime_checkable
class Loss(Protocol):
    """A model of loss, which starts afresh with every run."""

    def start(self, n_agents: int) -> LossProcess:
        """Begin a run with n agents."""
        ...
