"""Control units that look at times of their own clock, and signal at each look with a probability."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from aimd_des.dynamics.clocks import Clock
from aimd_des.engine.control_unit.base import SampledTable, table_of
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.results.overload import Opportunities
from aimd_des.utils import returned_values, validation
from aimd_des.utils.jit import formula
from aimd_des.utils.parts import built_in
from aimd_des.utils.rng import Key, Purpose, uniform_at
from aimd_des.utils.shown import brief


@formula
def signal_probability(low: float, high: float, total: float, limit: float) -> float:
    """Return the probability of a signal at a look, which rises between two shares of the threshold."""
    # A unit with one threshold signals strictly above it: a quotient could be rounded to 1 there.
    if low == high:
        return 1.0 if total > low * limit else 0.0
    return min(max((total / limit - low) / (high - low), 0.0), 1.0)


@formula
def signals(probability: float, key: Key, resource: int, look: int) -> bool:
    """Tell whether a look signals; its draw has the resource and the look for an address."""
    # Draws lie in [0, 1): what is certain needs none, and costs none.
    if probability <= 0.0 or probability >= 1.0:
        return probability > 0.0
    return uniform_at(key, resource, look, 0, 0) < probability


class SampledUnit:
    """A control unit that does what its ``table()`` says: to be derived from, with that method alone.

    Raises
    ------
    InputError
        When a run begins, if the table is outside its range; during it, if a probability is.
    """

    def table(self) -> SampledTable:
        """Say when the unit samples, and with which probability it signals.

        Returns
        -------
        SampledTable
            The same at every call.
        """
        raise NotImplementedError

    def opportunities(self, start: float, end: float) -> Opportunities:
        """Count when it may signal.

        Parameters
        ----------
        start, end : float
            From when to when.

        Returns
        -------
        Opportunities
            Its sampling instants.
        """
        table = self.table()
        clock = Clock(table.period, table.phase)
        return Opportunities(clock.next_tick(end) - clock.next_tick(start), table.period)

    def process(self, system: System) -> ProcessGenerator:
        """Look, and broadcast with the probability that total demand gives."""
        return Looks(self, system).process()


class Looks:
    """The sampling instants of a control unit in one run."""

    def __init__(self, control_unit: SampledUnit, system: System) -> None:
        table = table_of(control_unit)
        assert isinstance(table, SampledTable)  # noqa: S101 - the run has checked it
        self.system, self.table = system, table
        self.field = returned_values.said_by(control_unit, "table")
        self.look = 0

    def process(self, again: bool = False) -> ProcessGenerator:
        """Look for as long as the run lasts."""
        system, table, clock = self.system, self.table, Clock(self.table.period, self.table.phase)
        if not again:
            self.look = clock.next_tick(system.env.now)
        while True:
            look = self.look
            yield system.env.at(clock.time(look), EventKind.SENSE)
            self.look = look + 1
            if not system.conditions.failed[0]:
                # All resources are decided on before anything is sent, which could be answered at once.
                for resource, total in list(_due(system, table, look, self.field)):
                    system.transmitter.send(resource, system.env.now, table.sensing_delay, total)

    def state(self) -> dict[str, Any]:
        """Return which look is next."""
        return {"look": self.look}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` has returned."""
        self.look = state["look"]


def _due(system: System, table: SampledTable, look: int, field: str) -> Iterator[tuple[int, float]]:
    """Yield the resources for which a look signals, with their totals."""
    key = system.keys[Purpose.SENSING]
    totals, limits = system.totals().tolist(), system.parameters.limit.tolist()
    for resource, (total, limit) in enumerate(zip(totals, limits, strict=True)):
        if table.probability is None:
            chance = signal_probability(table.low, table.high, total, limit)
        else:
            chance = asked(table, field, total, limit, system.env.now, look, resource)
        if signals(chance, key, resource, look):
            yield resource, total


def asked(
    table: SampledTable, field: str, total: float, limit: float, time: float, look: int, resource: int
) -> float:
    """Ask a function of the user's own for the probability of a signal, and check what it gives."""
    assert table.probability is not None  # noqa: S101 - asked only where there is one
    given = table.probability(total, limit, time, look, resource)
    call = f"{field}.probability(total={total!r}, threshold={limit!r}, time={time!r}, ...)"
    return validation.number(call, given, low=0.0, high=1.0)


@built_in("control_unit", "sampled")
@brief
@dataclass(frozen=True)
class Sampled(SampledUnit):
    """A control unit that samples at ``phase + q * period``, and signals where demand is above its threshold.

    Parameters
    ----------
    period : float
        Time between two samples, greater than 0.
    phase : float
        Time of the first look, at least 0.
    sensing_delay : float
        How long after a look its signals leave the control unit, at least 0; a partition, or a fault of the
        control unit, cuts those that leave while it lasts.
    """

    period: float = 1.0
    phase: float = 0.0
    sensing_delay: float = 0.0

    def __post_init__(self) -> None:
        clock = Clock(self.period, self.phase)
        object.__setattr__(self, "period", clock.period)
        object.__setattr__(self, "phase", clock.phase)
        delay = validation.number("sensing_delay", self.sensing_delay, low=0.0)
        object.__setattr__(self, "sensing_delay", delay)

    def table(self) -> SampledTable:
        """Say when the unit samples; the probability is 1 above the threshold."""
        return SampledTable(self.period, self.phase, self.sensing_delay)
