r"""What agents can do about signals that they lose: respond more often to those that they hear.

An agent that loses a share p of the signals and answers with lambda times

    continuous      1 / (1 - p)
    discrete clock  (1 - h) / (1 - p - h)

gives back, in the mean, what it would without loss.  On the clock a lost signal also costs the agent its
hold; h is the share of its own ticks in which it answered a signal, which it can count.

Where p is not known it can be estimated, if signals carry a running number: of those since the first one
that was heard, which are missing?  The number costs bits, and a field of w bits counts modulo 2**w, so that
an agent is mistaken once it has lost half of that in a row.

The formulas are compiled into kernels, and called as they stand by processes.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from aimd_des.utils import validation
from aimd_des.utils.jit import formula
from aimd_des.utils.parts import built_in
from aimd_des.utils.records import record
from aimd_des.utils.shown import brief
from aimd_des.utils.validation import FloatArray

#: What an agent knows of its loss.
NOTHING, KNOWN, ESTIMATED = 0, 1, 2

# Where hardly a tick is left without a signal there is no bound to the factor; this is the largest.
_MOST = 20.0
_LEAST_GROWTH = 1.0 / _MOST

_MOST_BITS = 62


@record
class CompensationParameters(NamedTuple):
    """How agents compensate for losses, for formulas."""

    rule: int  # `NOTHING`, `KNOWN` or `ESTIMATED`
    loss: FloatArray  # (n,): what they know
    period: int  # running numbers are sent modulo this; 0 if none are sent


@runtime_checkable
class Compensation(Protocol):
    """A way of making good for losses."""

    @property
    def bits(self) -> int:
        """How many bits a signal has besides the one."""
        ...

    def parameters(self, n_agents: int) -> CompensationParameters:
        """Return what the formulas need, for n agents."""
        ...


def no_compensation(n_agents: int) -> CompensationParameters:
    """Return what the formulas need where agents do nothing about loss."""
    return CompensationParameters(NOTHING, np.zeros(n_agents), 0)


@built_in("compensation", "known")
@brief
@dataclass(frozen=True, eq=False)
class KnownLoss:
    """Every agent knows the probability with which signals are lost on it.

    Parameters
    ----------
    loss : float or array_like, shape (n,)
        p of all agents or of each, at least 0 and less than 1.
    """

    loss: npt.ArrayLike

    def __post_init__(self) -> None:
        remedy = "an agent that hears nothing cannot answer"
        clean = validation.per_agent(
            "KnownLoss.loss", self.loss, low=0.0, high=1.0, high_open=True, remedy=remedy
        )
        object.__setattr__(self, "loss", clean)

    @property
    def bits(self) -> int:
        """How many bits a signal has besides the one: none."""
        return 0

    def parameters(self, n_agents: int) -> CompensationParameters:
        """Return what the formulas need."""
        validation.fits("KnownLoss.loss", self.loss, n_agents)
        return CompensationParameters(
            KNOWN, np.array(np.broadcast_to(self.loss, (n_agents,)), dtype=np.float64), 0
        )


@built_in("compensation", "estimated")
@dataclass(frozen=True)
class EstimatedLoss:
    """Every agent estimates its loss from the running numbers of the signals that it hears.

    Parameters
    ----------
    number_bits : int
        Width of the field with the running number, 2 to 62: what a signal costs besides its one bit.
    """

    number_bits: int = 8

    def __post_init__(self) -> None:
        bits = validation.integer("EstimatedLoss.number_bits", self.number_bits, low=2, high=_MOST_BITS)
        object.__setattr__(self, "number_bits", bits)

    @property
    def bits(self) -> int:
        """How many bits a signal has besides the one."""
        return self.number_bits

    def parameters(self, n_agents: int) -> CompensationParameters:
        """Return what the formulas need."""
        return CompensationParameters(ESTIMATED, np.zeros(n_agents), 1 << self.number_bits)


@formula
def read_number(number: int, heard: int, first: int, latest: int, period: int) -> tuple[int, int, int]:
    """Count a signal that has been heard."""
    received = number % period
    if heard == 0:
        return 1, received, received
    ahead = (received - latest) % period
    meant = latest + (ahead if 2 * ahead <= period else ahead - period)
    if meant <= first:
        return heard, first, latest
    return heard + 1, first, max(latest, meant)


@formula
def estimated_loss(heard: int, first: int, latest: int) -> float:
    """Estimate the share of signals that are lost on an agent."""
    if heard < 2:
        return 0.0
    between = latest - first - 1
    missing = between - (heard - 2)
    # Numbers that were misread can make it look as if more had been heard than were sent.
    return max(missing, 0) / (between + 1.0) if between > 0 else 0.0


@formula
def compensation_factor(loss: float, answered: int, age: float, tick_weight: float) -> float:
    """Return what an agent multiplies its response probability by.

    Parameters
    ----------
    loss : float
        p, below 1.
    answered : int
        In how many of its ticks a discrete agent has answered a signal, this one included.
    age : float
        How many ticks it has had.
    tick_weight : float
        Tick weight.

    Returns
    -------
    float
        1 without loss.
    """
    if tick_weight == 0.0 or loss == 0.0:
        return 1.0 / (1.0 - loss)
    silent = 1.0 - answered / age
    grown = silent - loss
    return silent / grown if grown > _LEAST_GROWTH * silent else _MOST
