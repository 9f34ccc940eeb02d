"""A broadcast is one bit to all agents; the channel decides when, and whether, each copy arrives."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from aimd_des.channel.draws import Draws
from aimd_des.channel.latency import Constant, Latency
from aimd_des.channel.loss import Bernoulli, Loss
from aimd_des.checks import FloatArray

__all__ = ["Broadcast", "BroadcastChannel", "Channel"]


@dataclass(frozen=True)
class Broadcast:
    """One capacity signal: the bit itself says nothing more than which resource it is about.

    Attributes
    ----------
    resource : int
        j.
    time : float
        Time of the look, or the crossing, that caused it.
    number : int
        b, counted from 0 for each resource; bookkeeping, not sent.
    """

    resource: int
    time: float
    number: int


class Channel(Protocol):
    """Anything that carries broadcasts."""

    def transmit(self, broadcast: Broadcast, draws: Draws) -> FloatArray:
        """Return when each agent's copy arrives, shape (n,); inf where it is lost."""
        ...


@dataclass(frozen=True, eq=False)
class BroadcastChannel:
    """A channel that gives each agent's copy a latency and loses some.

    Parameters
    ----------
    latency : Latency, float or array_like, shape (n,)
        A model of latency, or a constant one in units of time; 0 unless said.
    loss : Loss, float or array_like, shape (n,)
        A model of loss, or the probability of independent losses; 0 unless said.

    Raises
    ------
    InputError
        If a number is outside its range.
    """

    latency: Latency = field(default_factory=lambda: Constant(0.0))
    loss: Loss = field(default_factory=lambda: Bernoulli(0.0))

    def __post_init__(self) -> None:
        for name, model in (("latency", Constant), ("loss", Bernoulli)):
            value = getattr(self, name)
            if not hasattr(value, "draw"):
                object.__setattr__(self, name, model(value))

    def transmit(self, broadcast: Broadcast, draws: Draws) -> FloatArray:
        """Send one broadcast on its way.

        Parameters
        ----------
        broadcast : Broadcast
            The signal.
        draws : Draws
            Its random numbers.

        Returns
        -------
        ndarray, shape (n,)
            When each agent's copy arrives; inf where it is lost.
        """
        arrival = broadcast.time + self.latency.draw(draws)
        return np.where(self.loss.draw(draws), np.inf, arrival)
