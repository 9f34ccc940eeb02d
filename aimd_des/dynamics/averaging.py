r"""How an agent averages its demand: over all of its past, over a window, or with forgetting.

Where the problem changes, an average over all of the past adapts the more slowly the longer the run has
lasted.  A short memory adapts fast, and pays with averages that scatter: see `theory.recovery_time` and
`theory.averaging_spread`.

Between two signals demand is a line, so averages are not stepped either.  With c the moments since the
anchor, x and s the demand and what had been accumulated there, and the tick weight g (1 where demand counts
tick by tick, 0 where it is integrated), what is accumulated at the moment at hand is

    cumulative, window    s + c x + alpha c (c - g) / 2
    forgetting            s E + x G + alpha L (c - G),    E = exp(-c r),    G = L (1 - E)

with r one over the time constant T and L the sum of all weights: T where time is continuous,
1 / (1 - exp(-1 / T)) where it has ticks.  Divided by the sum of the weights so far, L (1 - exp(-r age)), that
is the average from the first moment on: what is not there yet weighs nothing.

A window slides by parts: an agent keeps what it had accumulated at the last few multiples of length / parts,
and subtracts the oldest that lies within the window.  A small device can hold that, and it is exact.

The age of an agent is the time for which it has been active: absences count for nothing.  The formulas
are compiled into kernels, and called as they stand by processes.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.jit import formula
from aimd_des.utils.parts import built_in
from aimd_des.utils.portable_math import exp, expm1
from aimd_des.utils.validation import FloatArray

__all__ = [
    "CUMULATIVE",
    "FORGETTING",
    "WINDOW",
    "Averaging",
    "AveragingParameters",
    "Cumulative",
    "Forgetting",
    "Window",
    "accumulated_at",
    "age_at",
    "average_at",
    "folded_at",
    "keep_parts",
    "time_average",
]

# A finer window slides no better, and costs memory.
_MOST_PARTS = 1000

#: Kinds of averaging.
CUMULATIVE, WINDOW, FORGETTING = 0, 1, 2


class AveragingParameters(NamedTuple):
    """A way of averaging, for formulas.

    Attributes
    ----------
    kind : int
        `CUMULATIVE`, `WINDOW` or `FORGETTING`.
    rate, span : float
        Of forgetting: one over the time constant, and the sum of all weights.
    part : float
        Of a window: the length of a part.
    parts : int
        Of a window: how many; 0 else.
    """

    kind: int
    rate: float
    span: float
    part: float
    parts: int


@formula
def age_at(moment: float, origin: float, tick_weight: float) -> float:
    """Return for how long an agent has been active, the moment at hand included where it counts."""
    return (moment - origin) + tick_weight


@formula
def accumulated_at(
    accumulated: float, demand: float, increase: float, since: float, tick_weight: float
) -> float:
    """Return the demand accumulated so far: a sum over ticks, or an integral over time."""
    return accumulated + (since * demand + increase * (0.5 * since * (since - tick_weight)))


@formula
def time_average(accumulated: float, age: float) -> float:
    """Return the average over all of the past, 0 where no time has passed."""
    return accumulated / age if age > 0.0 else 0.0


@formula
def folded_at(
    averaging: AveragingParameters,
    accumulated: float,
    demand: float,
    increase: float,
    since: float,
    tick_weight: float,
) -> float:
    """Return what is accumulated at the moment at hand, as the way of averaging has it."""
    if averaging.kind == FORGETTING:
        if accumulated == 0.0 and demand == 0.0 and since <= tick_weight:
            return 0.0  # a tick that folds in nothing; the rounding of what follows would be taken for demand
        kept = exp(-averaging.rate * since)
        grown = averaging.span * -expm1(-averaging.rate * since)
        return accumulated * kept + (demand * grown + increase * (averaging.span * (since - grown)))
    return accumulated_at(accumulated, demand, increase, since, tick_weight)


@formula
def _part_of(averaging: AveragingParameters, age: float) -> int:
    """Return how many parts of a window fit into an age."""
    return int(age / averaging.part)


@formula
def average_at(
    averaging: AveragingParameters,
    parts: FloatArray,
    resource: int,
    agent: int,
    folded: float,
    accumulated: float,
    demand: float,
    increase: float,
    anchor: float,
    origin: float,
    moment: float,
    tick_weight: float,
) -> float:
    """Return an agent's average at the moment at hand, 0 where no time has passed."""
    age = age_at(moment, origin, tick_weight)
    if averaging.kind == CUMULATIVE or age <= 0.0:
        return time_average(folded, age)
    if averaging.kind == FORGETTING:
        return folded / (averaging.span * -expm1(-averaging.rate * age))
    first = _part_of(averaging, age) - averaging.parts + 1
    if first < 1:
        return folded / age
    begin, before = first * averaging.part, age_at(anchor, origin, tick_weight)
    if first > _part_of(averaging, before):  # the window begins on the present line
        earlier = accumulated_at(accumulated, demand, increase, begin - before, tick_weight)
    else:
        earlier = parts[resource, agent, first % averaging.parts]
    return float((folded - earlier) / (age - begin))


@formula
def keep_parts(
    averaging: AveragingParameters,
    parts: FloatArray,
    resource: int,
    agent: int,
    accumulated: float,
    demand: float,
    increase: float,
    anchor: float,
    origin: float,
    moment: float,
    tick_weight: float,
) -> None:
    """Note what had been accumulated at the boundaries of parts on the line that ends now."""
    if averaging.kind == WINDOW:
        before, last = (
            age_at(anchor, origin, tick_weight),
            _part_of(averaging, age_at(moment, origin, tick_weight)),
        )
        boundary = max(_part_of(averaging, before) + 1, last - averaging.parts + 1)
        while boundary <= last:
            since = boundary * averaging.part - before
            parts[resource, agent, boundary % averaging.parts] = accumulated_at(
                accumulated, demand, increase, since, tick_weight
            )
            boundary += 1


@runtime_checkable
class Averaging(Protocol):
    """A choice of averaging."""

    def parameters(self, tick_weight: float) -> AveragingParameters:
        """Return what the formulas need, for agents with this tick weight."""
        ...


@built_in("averaging", "cumulative")
@dataclass(frozen=True)
class Cumulative:
    """All of the past counts alike: the paper's average, eq. (average_eqn)."""

    def parameters(self, tick_weight: float) -> AveragingParameters:
        """Return what the formulas need.

        Parameters
        ----------
        tick_weight : float
            1 where agents tick, 0 in continuous time.

        Returns
        -------
        Memory
            The same for any tick weight.
        """
        del tick_weight
        return AveragingParameters(CUMULATIVE, 0.0, 0.0, 0.0, 0)


@built_in("averaging", "window")
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

    def parameters(self, tick_weight: float) -> AveragingParameters:
        """Return what the formulas need.

        Parameters
        ----------
        tick_weight : float
            1 where agents tick, 0 in continuous time.

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
        if tick_weight > 0.0 and part % 1.0:
            raise InputError.of(
                "Window.length",
                self.length,
                f"a multiple of its {self.parts} parts, in ticks, for discrete agents",
                "choose another length or number of parts",
            )
        return AveragingParameters(WINDOW, 0.0, 0.0, part, self.parts)


@built_in("averaging", "forgetting")
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

    def parameters(self, tick_weight: float) -> AveragingParameters:
        """Return what the formulas need.

        Parameters
        ----------
        tick_weight : float
            1 where agents tick, 0 in continuous time.

        Returns
        -------
        Memory
            Of this time constant.
        """
        rate = 1.0 / self.time_constant
        span = self.time_constant if tick_weight == 0.0 else -1.0 / expm1(-rate)
        return AveragingParameters(FORGETTING, rate, span, 0.0, 0)
