"""What a control unit is to a run, and the tables by which compiled code takes its samples."""

from collections.abc import Callable
from typing import NamedTuple, Protocol, runtime_checkable

from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.system import System
from aimd_des.utils import returned_values, validation
from aimd_des.utils.errors import InputError

#: When something happened that has not yet: no instant of a run, which begins at 0.
NEVER = -1.0

#: The probability of a signal from (total, threshold, time, look, resource).
Probability = Callable[[float, float, float, int, int], float]


@runtime_checkable
class ControlUnit(Protocol):
    """Anything that decides when capacity signals are broadcast.

    One with a method ``table()`` besides, which gives a `SampledTable` or a `CrossingTable`, is served by
    compiled code where agents are a `Fleet`; ``table()`` must then say the same as ``process(system)``.
    """

    def process(self, system: System) -> ProcessGenerator:
        """Live: the SimPy process of the control unit."""
        ...


class SampledTable(NamedTuple):
    """A control unit that samples at ``phase + q * period``, and signals at each sample with a probability.

    The probability is 0 up to `low` times the threshold, rises linearly, and is 1 from `high` times the
    threshold on.  If `low` and `high` are equal, it is 1 above it and 0 at it.

    Attributes
    ----------
    period, phase : float
        Time between two samples, greater than 0, and time of the first sample, at least 0.
    sensing_delay : float
        How long after a look its signals leave the control unit, at least 0.
    low, high : float
        Shares of the threshold; ``0 <= low <= high``.
    probability : callable, optional
        In place of `low` and `high`: ``probability(total, threshold, time, look, resource)`` is the
        probability of a signal.  Total demand and threshold are in units of the resource, the time is in
        units of time, and the look is q.  Compiled code calls a function that ``numba.njit`` has compiled.
    """

    period: float
    phase: float = 0.0
    sensing_delay: float = 0.0
    low: float = 1.0
    high: float = 1.0
    probability: Probability | None = None


class CrossingTable(NamedTuple):
    """A control unit that senses the instant at which total demand reaches its threshold.

    Attributes
    ----------
    hold_off, longest_hold_off : float
        Bounds of the hold-off, at least 0; if they are equal, it does not adapt.
    sensing_delay : float
        How long after a crossing its signal leaves the control unit, at least 0.
    """

    hold_off: float
    longest_hold_off: float
    sensing_delay: float = 0.0


def table_of(control_unit: object) -> SampledTable | CrossingTable | None:
    """Return the table of a control unit, checked; None if it has none."""
    table = getattr(control_unit, "table", None)
    given = table() if callable(table) else None
    field = returned_values.said_by(control_unit, "table")
    if given is None:
        return None
    if isinstance(given, CrossingTable):
        lows = {"hold_off": 0.0, "longest_hold_off": given.hold_off, "sensing_delay": 0.0}
        return CrossingTable(**{name: _number(field, given, name, low) for name, low in lows.items()})
    looks = returned_values.instance(field, given, SampledTable, "a SampledTable or a CrossingTable")
    period = validation.number(f"{field}.period", looks.period, low=0.0, low_open=True)
    names = ("phase", "sensing_delay", "low")
    phase, sensing_delay, low = (_number(field, looks, name, 0.0) for name in names)
    high = _number(field, looks, "high", low)
    own: object = looks.probability
    if own is not None and not callable(own):
        raise InputError.of(
            f"{field}.probability", own, "a function of (total, threshold, time, look, resource)"
        )
    return SampledTable(period, phase, sensing_delay, low, high, looks.probability)


def _number(field: str, table: SampledTable | CrossingTable, name: str, low: float) -> float:
    return validation.number(f"{field}.{name}", getattr(table, name), low=low)
