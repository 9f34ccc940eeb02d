"""A broadcast is one bit to all agents; the channel decides when, and whether, each copy arrives."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol, cast, runtime_checkable

import numpy as np
import numpy.typing as npt

from aimd_des.channel.latency import Constant, Latency
from aimd_des.channel.latency.kernels import LatencyTable
from aimd_des.channel.latency.own_latency import compiled_latency, draw_latency
from aimd_des.channel.loss import Bernoulli, Loss, LossProcess
from aimd_des.channel.loss.kernels import LossTable, TabledLoss
from aimd_des.channel.loss.own_loss import draw_loss, start_loss
from aimd_des.channel.memory import memory_of, remember
from aimd_des.channel.parameters import model_of
from aimd_des.channel.random_draws import Draws
from aimd_des.channel.transmit_kernel import (
    ChannelTable,
    channel_table,
    forgotten,
    put_in_order,
    refuse,
    transmit,
)
from aimd_des.utils import returned_values, validation
from aimd_des.utils.direct_calls import direct
from aimd_des.utils.locked_arrays import carry_over
from aimd_des.utils.rng import Key, Purpose
from aimd_des.utils.shown import brief
from aimd_des.utils.validation import FloatArray


def compiled_models(
    latency: Latency, loss: LossProcess, n_links: int, keys: Mapping[Purpose, Key]
) -> tuple[LatencyTable, LossTable] | None:
    """Lay out the models of a channel for compiled code, if there are formulas for both."""
    if type(loss) is not TabledLoss:
        return None
    table = compiled_latency(latency, n_links, keys)
    return None if table is None else (table, loss.table)


class Broadcast(NamedTuple):
    """One capacity signal on its way from the control unit to all agents.

    Attributes
    ----------
    resource : int
        j: which of the m one-bit signals is set.
    number : int
        b, counted from 0 for each resource; the address of its random numbers, not sent.
    time : float
        Time of the look, or the crossing, that caused it; not sent.
    """

    resource: int
    number: int
    time: float


class Copies(NamedTuple):
    """What becomes of a broadcast.

    Attributes
    ----------
    arrival : ndarray, shape (n,)
        When each agent's copy arrives; inf where it is lost.
    second : ndarray, shape (n,), or None
        When a duplicate arrives as well; inf where there is none.
    """

    arrival: FloatArray
    second: FloatArray | None = None


class Link(Protocol):
    """A channel in one run; it may remember what was before.

    If its runs can be forked and saved, it has two more methods. ``state()`` returns what it remembers: a
    dict of numbers, strings, lists and arrays. ``resume(state)`` reads that at the start of another run,
    without writing to it.
    """

    def transmit(self, broadcast: Broadcast, departure: float) -> Copies:
        """Say what becomes of a broadcast that leaves the control unit at `departure`."""
        ...


class DrawnLink:
    """A link whose copies may be cut after they are drawn and before they take their place behind others.

    Attributes
    ----------
    latest : ndarray, shape (n,), or None
        The last arrival on each link; None where links need not keep the order.
    """

    latest: FloatArray | None

    def draw(self, broadcast: Broadcast, departure: float) -> Copies:
        """Draw when copies arrive if nothing is in their way."""
        raise NotImplementedError

    def keep_order(self, copies: Copies) -> None:
        """Keep copies that leave now from overtaking others on their links.

        Parameters
        ----------
        copies : Copies
            Times of arrival, changed in place.
        """
        if self.latest is not None:
            for arrival in copies:
                if arrival is not None:
                    put_in_order(self.latest, arrival)

    def transmit(self, broadcast: Broadcast, departure: float) -> Copies:
        """Say what becomes of a broadcast where nothing is cut."""
        copies = self.draw(broadcast, departure)
        self.keep_order(copies)
        return copies


@runtime_checkable
class Channel(Protocol):
    """Anything that carries broadcasts."""

    def open(self, n_agents: int, keys: Mapping[Purpose, Key]) -> Link:
        """Begin a run with n agents and the run's keys of random numbers; refuse what does not fit n."""
        ...


@brief
@dataclass(frozen=True, eq=False)
class BroadcastChannel:
    """A channel that gives each agent's copy a latency, loses some and duplicates some.

    Parameters
    ----------
    latency : Latency, float or array_like, shape (n,)
        A model of latency, or a constant one in units of time; default: 0.
    loss : Loss, float or array_like, shape (n,)
        A model of loss, or the probability of independent losses; default: 0.
    duplication : float or array_like, shape (n,)
        Probability that a copy which is not lost arrives twice, with a latency of its own each time.
    fifo : bool
        Whether each agent's link keeps the order of what is sent over it: a copy that would
        overtake another arrives together with it, just after it.

    Raises
    ------
    InputError
        If a number is outside its range, or something is neither numbers nor a model.
    """

    latency: Latency | npt.ArrayLike = field(default_factory=lambda: Constant(0.0))
    loss: Loss | npt.ArrayLike = field(default_factory=lambda: Bernoulli(0.0))
    duplication: npt.ArrayLike = 0.0
    fifo: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "latency", model_of("latency", self.latency, Latency, Constant))
        object.__setattr__(self, "loss", model_of("loss", self.loss, Loss, Bernoulli))
        object.__setattr__(self, "fifo", validation.flag("fifo", self.fifo))
        duplication = validation.per_agent("duplication", self.duplication, low=0.0, high=1.0)
        object.__setattr__(self, "duplication", duplication)

    def open(self, n_agents: int, keys: Mapping[Purpose, Key]) -> Link:
        """Begin a run."""
        latency, loss_model = cast(Latency, self.latency), cast(Loss, self.loss)  # __post_init__ saw to it
        returned_values.check(latency, n_agents)
        validation.fits("duplication", self.duplication, n_agents)
        duplication, loss = np.asarray(self.duplication, dtype=np.float64), start_loss(loss_model, n_agents)
        if tables := compiled_models(latency, loss, n_agents, keys):
            return CompiledLink(channel_table(*tables, duplication, self.fifo, keys))
        latest = np.zeros(n_agents) if self.fifo else None
        return _OpenChannel(latency, loss, duplication, latest, n_agents, keys)


class CompiledLink(DrawnLink):
    """A channel of built-in models in one run."""

    def __init__(self, table: ChannelTable) -> None:
        self.table = table
        self.latest = table.latest if table.fifo else None
        self._spare = np.empty(len(table.duplication))  # where seconds would be, where there are none
        self._transmit: Callable[..., int] | None = None

    def draw(self, broadcast: Broadcast, departure: float) -> Copies:
        """Draw loss, latency and duplication of every copy."""
        arrival, doubled = np.empty(len(self._spare)), self.table.duplicates
        second = np.empty(len(self._spare)) if doubled else self._spare
        # One's own parts may say 0 for 0.0: machine code for whole numbers would round the times that follow.
        given = (self.table, broadcast.resource, broadcast.number, float(departure), arrival, second)
        if self._transmit is None:
            self._transmit = direct(transmit, *given)
        code = self._transmit(*given)
        if code:
            raise refuse(self.table, code, broadcast.resource, departure)
        return Copies(arrival, second if doubled else None)

    def state(self) -> dict[str, Any]:
        """Return what it remembers."""
        return {"loss": TabledLoss(self.table.loss).state(), "latest": self.table.latest}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        TabledLoss(self.table.loss).resume(state["loss"])
        carry_over(state["latest"], self.table.latest)

    def anew(self, keys: Mapping[Purpose, Key]) -> "CompiledLink":
        """Begin another run over the same channel, with keys of its own; models are shared, memory is not."""
        return CompiledLink(forgotten(self.table, keys))

    def renew(self) -> None:
        """Forget all that has been sent, as if the run began now."""
        self.table.loss.time[:] = np.nan
        self.table.loss.row[:] = 0
        self.table.loss.memory[:] = 0.0
        self.table.latest[:] = 0.0


@dataclass(eq=False)
class _OpenChannel(DrawnLink):
    """A `BroadcastChannel` with the user's own models."""

    latency: Latency
    loss: LossProcess
    duplication: FloatArray
    latest: FloatArray | None
    n_agents: int
    keys: Mapping[Purpose, Key]

    def attach(self, system: object) -> None:
        """Give the run in progress to a loss that reads it."""
        returned_values.attach(self.loss, system)

    def state(self) -> dict[str, Any]:
        """Return what it remembers."""
        return {"loss": memory_of(self.loss), "latest": self.latest}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        remember(self.loss, state["loss"])
        if self.latest is not None:
            self.latest[:] = state["latest"]

    def draw(self, broadcast: Broadcast, departure: float) -> Copies:
        """Draw loss, latency and duplication of every copy."""
        draws = Draws(self.keys, broadcast.resource, broadcast.number, departure, self.n_agents)
        lost = draw_loss(self.loss, draws)
        arrival = departure + draw_latency(self.latency, draws)
        arrival[lost] = np.inf
        second = None
        if self.duplication.any():
            doubled = ~lost & (draws.uniforms(Purpose.DUPLICATION) < self.duplication)
            late = departure + draw_latency(self.latency, replace(draws, copy=1))
            second = np.where(doubled, late, np.inf)
        return Copies(arrival, second)
