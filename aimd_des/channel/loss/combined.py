"""Several causes of loss at once."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.channel.loss.base import Loss, LossProcess
from aimd_des.channel.loss.independent import Bernoulli
from aimd_des.channel.loss.kernels import TabledLoss, join
from aimd_des.channel.loss.own_loss import draw_loss, start_loss
from aimd_des.channel.loss.trace import Trace
from aimd_des.channel.memory import memory_of, remember
from aimd_des.channel.parameters import model_of, scalar_or_row
from aimd_des.channel.random_draws import Draws
from aimd_des.utils import returned_values
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import BoolArray, FloatArray


class Combined:
    """A copy is lost if any of several models says so; they are independent of each other.

    Parameters
    ----------
    *losses : Loss, float or array_like, shape (n,)
        Models of loss, or probabilities of independent losses.

    Attributes
    ----------
    losses : tuple of Loss
        The models; those of a `Combined` among them one by one.

    Raises
    ------
    InputError
        If there is none, or a number is outside its range.
    """

    def __init__(self, *losses: Loss | npt.ArrayLike) -> None:
        if not losses:
            raise InputError.of("Combined.losses", losses, "at least one model of loss")
        parts: list[Loss] = []
        for position, given in enumerate(losses):
            if isinstance(given, Combined):
                parts += given.losses
            else:
                parts.append(model_of(f"Combined.losses[{position}]", given, Loss, Bernoulli))
        self.losses: tuple[Loss, ...] = tuple(parts)

    def __repr__(self) -> str:
        return f"Combined({', '.join(map(repr, self.losses))})"

    @property
    def mean(self) -> float | FloatArray:
        """Share of copies that are lost in the long run, 1 - (1 - p_1) * (1 - p_2) * ...

        Raises
        ------
        InputError
            If it is not known: of two traces, which may lose the same broadcasts, and of models
            that do not say their own.
        """
        if sum(isinstance(part, Trace) for part in self.losses) > 1:
            raise InputError("mean of Combined: two traces are not independent; join their records first")
        kept: Any = 1.0
        for part in self.losses:
            if not hasattr(part, "mean"):
                raise InputError(f"mean of Combined: {type(part).__name__} has no attribute `mean`")
            kept = kept * (1.0 - part.mean)
        return scalar_or_row(1.0 - kept)

    def start(self, n_agents: int) -> LossProcess:
        """Begin a run of every model."""
        processes = [start_loss(part, n_agents) for part in self.losses]
        tables = [process.table for process in processes if type(process) is TabledLoss]
        return TabledLoss(join(tables)) if len(tables) == len(processes) else _Parts(processes)


class _Parts:
    """The models of one run, side by side."""

    def __init__(self, processes: list[LossProcess]) -> None:
        self._processes = processes

    def attach(self, system: object) -> None:
        """Give the run in progress to the models that read it."""
        for process in self._processes:
            returned_values.attach(process, system)

    def state(self) -> dict[str, Any]:
        """Return what all of them remember."""
        return {"parts": [memory_of(process) for process in self._processes]}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        for process, kept in zip(self._processes, state["parts"], strict=True):
            remember(process, kept)

    def draw(self, draws: Draws) -> BoolArray:
        """Ask every model, also for copies that another one has lost: what it remembers must be kept up."""
        lost = np.zeros(draws.n_agents, dtype=np.bool_)
        for part, process in enumerate(self._processes):
            lost |= draw_loss(process, replace(draws, part=part))
        return lost
