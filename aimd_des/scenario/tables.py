"""The tables of a scenario without a kind: each checks itself by making the object that it describes."""

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from aimd_des.channel import BroadcastChannel, Channel
from aimd_des.channel.loss import Combined, Loss
from aimd_des.dynamics.clocks import Clocks
from aimd_des.problem.problem import Resource
from aimd_des.results.recording import Recording
from aimd_des.scenario.kind_tables import KindTable, one_of, stands_as
from aimd_des.scenario.strict_table import MadeTable, Table

Times = Literal["auto", "end"] | float | list[float]

if TYPE_CHECKING:
    LatencyTable = float | list[float] | KindTable
    LossTable = float | list[float] | KindTable | list[KindTable]
    NetworkSettings = KindTable
else:
    LatencyTable = one_of("latency", plain=True)
    LossTable = one_of("loss", plain=True, several=True)
    NetworkSettings = one_of("network")


class ResourceSettings(MadeTable):
    """One of ``[[resources]]``: see `Resource`.

    Attributes
    ----------
    name, unit : str
        For frames and figures.
    capacity, normalization, threshold : float
        C, Gamma and gamma.
    increase, decrease : float or list of float
        alpha and beta, of all agents or of each.
    """

    name: str
    capacity: float
    increase: float | list[float]
    decrease: float | list[float]
    normalization: float
    threshold: float = 1.0
    unit: str = ""

    def make(self) -> Resource:
        """Make the object that the table describes."""
        return Resource(**dict(self))


class ResourceChange(Table):
    """One of ``[resources.0]`` and so on: what is other than the model has it.

    Attributes
    ----------
    capacity, normalization, threshold : float, optional
        C, Gamma and gamma.
    increase, decrease : float or list of float, optional
        alpha and beta, of all agents or of each.
    """

    capacity: float | None = None
    increase: float | list[float] | None = None
    decrease: float | list[float] | None = None
    normalization: float | None = None
    threshold: float | None = None

    def of(self, resource: Resource) -> Resource:
        """Change a resource of a model."""
        return replace(resource, **{name: value for name, value in self if value is not None})


class ChannelSettings(MadeTable):
    """``[channel]``: see `BroadcastChannel`, or a network.

    Attributes
    ----------
    latency : float, list of float or table
        Constant, of all agents or of each, or a kind of latency with its parameters.
    loss : float, list of float, table or list of tables
        Probability, of all agents or of each, or a kind of loss with its parameters, or several.
    duplication : float or list of float
        Probability that a copy arrives twice, of all agents or of each.
    fifo : bool
        Whether links keep the order.
    network : table, optional
        A kind of network with its parameters, in place of all of these.
    """

    latency: LatencyTable = 0.0
    loss: LossTable = 0.0
    duplication: float | list[float] = 0.0
    fifo: bool = False
    network: NetworkSettings | None = None

    def build_to_check(self) -> None:
        """Refuse, by making it, what cannot be made."""
        if self.network is None:  # which has checked itself
            self.build()

    def idle(self) -> tuple[str, ...]:
        """Name the keys that have no meaning over a network."""
        return () if self.network is None else ("latency", "loss", "duplication", "fifo")

    def build(self) -> Channel:
        """Give the channel; a network is kept by its own table, if at all."""
        made: Channel = self.make() if self.network is not None else super().build()
        return made

    def make(self) -> Channel:
        """Make the object that the table describes."""
        if self.network is not None:
            made: Channel = self.network.build()
            return made
        latency = self.latency.build() if isinstance(self.latency, KindTable) else self.latency
        return BroadcastChannel(latency, self._losses(), self.duplication, self.fifo)

    def _losses(self) -> Loss | float | list[float]:
        """Tell numbers, one table and several tables apart."""
        given = self.loss
        if isinstance(given, KindTable):
            made: Loss = given.build()
            return made
        if isinstance(given, list):
            tables = [part for part in given if isinstance(part, KindTable)]
            numbers = [part for part in given if not isinstance(part, KindTable)]
            return Combined(*(table.build() for table in tables)) if tables else numbers
        return given


# As what a change of the channel names it.
stands_as(Channel, ChannelSettings)


class ClocksSettings(MadeTable):
    """``[clocks]``: see `Clocks`.

    Attributes
    ----------
    period, phase, drift, jitter : float or list of float
        Of all agents or of each; the phase may be "random".
    """

    period: float | list[float] = 1.0
    phase: Literal["random"] | float | list[float] = 0.0
    drift: float | list[float] = 0.0
    jitter: float | list[float] = 0.0

    def make(self) -> Clocks:
        """Make the object that the table describes."""
        return Clocks(**dict(self))


class RecordingSettings(MadeTable):
    """``[recording]``: see `Recording`.

    Attributes
    ----------
    demand, allocations : "auto", "end", float or list of float
        When to keep totals, and every agent.
    tail : int
        Over how many of the last units of time both are kept at every unit.
    overshoot : bool
        Whether to integrate total demand.
    events : bool
        Whether to keep the event log.
    """

    demand: Times = "auto"
    allocations: Times = "auto"
    tail: int = 100
    overshoot: bool = True
    events: bool = False

    def make(self) -> Recording:
        """Make the object that the table describes."""
        return Recording(**dict(self))
