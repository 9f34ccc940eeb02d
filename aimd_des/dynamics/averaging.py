"""The choice of an average: over all of the past, over a window, or with forgetting.

Where the problem changes, an average over all of the past adapts the more slowly the longer the run has
lasted.  A short memory adapts fast, and pays with averages that scatter: see `theory.recovery_time` and
`theory.averaging_spread`.  The formulas are in `memory`.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from aimd_des.dynamics.averaging_formulas import CUMULATIVE, FORGETTING, WINDOW, Memory
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.portable_math import expm1

__all__ = ["Averaging", "Cumulative", "Forgetting", "Window"]

# A finer window slides no better, and costs memory.
_MOST_PARTS = 1000


@runtime_checkable
class Averaging(Protocol):
    """A choice of averaging."""

    def memory(self, grain: float) -> Memory:
        """Return what the formulas need, for agents with this grain of time."""
        ...


@dataclass(frozen=True)
class Cumulative:
    """All of the past counts alike: the paper's average, eq. (average_eqn)."""

    def memory(self, grain: float) -> Memory:
        """Return what the formulas need.

        Parameters
        ----------
        grain : float
            Grain of time.

        Returns
        -------
        Memory
            The same for any grain.
        """
        del grain
        return Memory(CUMULATIVE, 0.0, 0.0, 0.0, 0)


@dataclass(frozen=True)
class Window:
    """Only the latest stretch of the past counts.

    The window slides by parts, so that it is between ``length - length / parts`` and ``length`` long.

    Parameters
    ----------
    length : float
        W > 0: in units of time for continuous agents; in ticks of its own clock for a discrete one, and then
        a multiple of the number of parts.
    parts : int
        How many sums of its past an agent keeps for each resource, 2 to 1000.

    Raises
    ------
    InputError
        If a value is outside its range.
    """

    length: float
    parts: int = 20

    def __post_init__(self) -> None:
        length = validation.number("Window.length", self.length, low=0.0, low_open=True)
        object.__setattr__(self, "length", length)
        object.__setattr__(
            self, "parts", validation.integer("Window.parts", self.parts, low=2, high=_MOST_PARTS)
        )

    def memory(self, grain: float) -> Memory:
        """Return what the formulas need.

        Parameters
        ----------
        grain : float
            Grain of time.

        Returns
        -------
        Memory
            Of this window.

        Raises
        ------
        InputError
            If agents tick, and the length is no multiple of the number of parts.
        """
        part = self.length / self.parts
        if grain > 0.0 and part % 1.0:
            raise InputError.of(
                "Window.length",
                self.length,
                f"a multiple of its {self.parts} parts, in ticks, for discrete agents",
                "choose another length or number of parts",
            )
        return Memory(WINDOW, 0.0, 0.0, part, self.parts)


@dataclass(frozen=True)
class Forgetting:
    """The past counts the less the longer ago it is: exp(-age / T).

    Parameters
    ----------
    time_constant : float
        T > 0: in units of time for continuous agents; in ticks of its own clock for a discrete one.

    Raises
    ------
    InputError
        If the value is outside its range.
    """

    time_constant: float

    def __post_init__(self) -> None:
        clean = validation.number("Forgetting.time_constant", self.time_constant, low=0.0, low_open=True)
        object.__setattr__(self, "time_constant", clean)

    def memory(self, grain: float) -> Memory:
        """Return what the formulas need.

        Parameters
        ----------
        grain : float
            Grain of time.

        Returns
        -------
        Memory
            Of this time constant.
        """
        rate = 1.0 / self.time_constant
        span = self.time_constant if grain == 0.0 else -1.0 / expm1(-rate)
        return Memory(FORGETTING, rate, span, 0.0, 0)
