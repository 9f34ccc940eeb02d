r"""How an agent averages its demand: over all of its past, over a window, with forgetting, or with a gain.

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

With gain a the newest of N ticks weighs min(1, a / N), and in continuous time demand at age s weighs as
s^(a-1).  What is accumulated is the average y itself.  From age L to age N = L + c it moves to

    y + D (x - y) + alpha (a c - D (L + g)) / (a + 1),    D = 1 - P(L) / P(N)

where P(N) is N^a, or Gamma(N + 1) / Gamma(N + 1 - a) where time has ticks: both telescope.

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
from aimd_des.utils.portable_math import exp, expm1, log1p
from aimd_des.utils.records import record
from aimd_des.utils.validation import FloatArray

# A finer window slides no better, and costs memory.
_MOST_PARTS = 1000

#: Kinds of averaging.
CUMULATIVE, WINDOW, FORGETTING, POLYNOMIAL = 0, 1, 2, 3

# A larger gain averages over less than a hundredth of the past.
_MOST_GAIN = 100.0

# Ticks that are taken one by one: beyond, the series of the Gamma function is as exact, and costs as much.
_MOST_STEPS = 64


@record
class AveragingParameters(NamedTuple):
    """A way of averaging, for formulas."""

    kind: int  # `CUMULATIVE`, `WINDOW`, `FORGETTING` or `POLYNOMIAL`
    # Of forgetting: one over the time constant, and the sum of all weights.
    rate: float
    span: float
    part: float  # of a window: the length of a part
    parts: int  # of a window: how many; 0 else
    gain: float = 1.0  # a, by which the newest weighs more than in the average over all of the past


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
def _log_gamma_tail(middle: float, gain: float) -> float:
    """Return a log(w) - log P, where w is N + (1 - a) / 2: a series in powers of 1 / w."""
    # The Bernoulli polynomials of degree 3, 5 and 7 at (1 + a) / 2, over w to the power of 2, 4 and 6.
    u, z = 0.5 * gain, 1.0 / (middle * middle)
    square = u * u
    third = u * (square - 0.25)
    fifth = u * (square * (square - 5.0 / 6.0) + 7.0 / 48.0)
    seventh = u * (square * (square * (square - 1.75) + 49.0 / 48.0) - 31.0 / 192.0)
    return z * (third / 3.0 + z * (fifth / 10.0 + z * (seventh / 21.0)))


@formula
def _newer_share(gain: float, before: float, since: float, tick_weight: float) -> float:
    """Return D, what the latest stretch weighs among all that is averaged."""
    age = before + since
    if tick_weight == 0.0:
        return -expm1(gain * log1p(-since / age)) if before > 0.0 else 1.0
    stepped = since if since <= _MOST_STEPS else min(since, max(0.0, 100.0 + 50.0 * gain - before))
    newer, tick = 0.0, before
    for _ in range(int(stepped)):
        tick += 1.0
        newer += (1.0 - newer) * (gain / tick)
    if stepped < since:
        shift = 0.5 * (1.0 - gain)
        low, high = before + stepped + shift, age + shift
        ratio = gain * log1p(-(since - stepped) / high)
        ratio -= _log_gamma_tail(low, gain) - _log_gamma_tail(high, gain)
        newer -= (1.0 - newer) * expm1(ratio)
    return newer


@formula
def _with_gain(
    gain: float,
    average: float,
    demand: float,
    increase: float,
    before: float,
    since: float,
    tick_weight: float,
) -> float:
    """Return the average with a gain, of an agent whose age at the anchor was `before`."""
    if since <= 0.0:
        return average
    # While N <= a, the newest tick has all of the weight.
    skipped = float(int(gain)) - before if tick_weight > 0.0 else 0.0
    if skipped > 0.0:
        passed = min(skipped, since)
        average = demand + increase * (passed - 1.0)
        demand, before, since = demand + increase * passed, before + passed, since - passed
        if since <= 0.0:
            return average
    newer = _newer_share(gain, before, since, tick_weight)
    grown = (gain * since - newer * (before + tick_weight)) / (gain + 1.0)
    return average + (newer * (demand - average) + increase * grown)


@formula
def folded_at(
    averaging: AveragingParameters,
    accumulated: float,
    demand: float,
    increase: float,
    since: float,
    before: float,
    tick_weight: float,
) -> float:
    """Return what is accumulated at the moment at hand; `before` is the agent's age at the anchor."""
    if averaging.kind >= FORGETTING and accumulated == 0.0 and demand == 0.0 and since <= tick_weight:
        return 0.0  # a tick that folds in nothing; the rounding of what follows would be taken for demand
    if averaging.kind == POLYNOMIAL:
        return _with_gain(averaging.gain, accumulated, demand, increase, before, since, tick_weight)
    if averaging.kind == FORGETTING:
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
    if averaging.kind == POLYNOMIAL:
        return folded
    if averaging.kind == FORGETTING:
        # The sum of all weights, which is 0 at the least of ages.
        return time_average(folded, averaging.span * -expm1(-averaging.rate * age))
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
    """All of the past counts alike: the paper's average, equation (average_eqn)."""

    def parameters(self, tick_weight: float) -> AveragingParameters:
        """Return what the formulas need."""
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
        """Return what the formulas need."""
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
    """

    time_constant: float

    def __post_init__(self) -> None:
        clean = validation.number("Forgetting.time_constant", self.time_constant, low=0.0, low_open=True)
        object.__setattr__(self, "time_constant", clean)

    def parameters(self, tick_weight: float) -> AveragingParameters:
        """Return what the formulas need."""
        rate = 1.0 / self.time_constant
        span = self.time_constant if tick_weight == 0.0 else -1.0 / expm1(-rate)
        return AveragingParameters(FORGETTING, rate, span, 0.0, 0)


@built_in("averaging", "polynomial")
@dataclass(frozen=True)
class Polynomial:
    """The latest demand weighs more, by a gain that is constant: demand at age s weighs as s^(a-1).

    On ticks the newest of N has the weight min(1, a / N) in the average.  A cost that grows slowly above its
    minimum needs a gain above 1, see `theory.convergence`; more gain than that adds noise.

    Parameters
    ----------
    gain : float
        a, 1 to 100; with 1 all of the past counts alike, as with `Cumulative`.
    """

    gain: float

    def __post_init__(self) -> None:
        clean = validation.number("Polynomial.gain", self.gain, low=1.0, high=_MOST_GAIN)
        object.__setattr__(self, "gain", clean)

    def parameters(self, tick_weight: float) -> AveragingParameters:
        """Return what the formulas need."""
        if self.gain == 1.0:
            return Cumulative().parameters(tick_weight)
        return AveragingParameters(POLYNOMIAL, 0.0, 0.0, 0.0, 0, self.gain)
