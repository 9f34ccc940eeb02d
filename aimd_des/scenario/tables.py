"""The tables of a scenario file: each checks itself by making the object that it describes."""

from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, model_validator

from aimd_des.channel import BroadcastChannel
from aimd_des.channel.loss import Combined, Loss
from aimd_des.channel.named import named_latency, named_loss
from aimd_des.clock import Clocks
from aimd_des.control_unit import ControlUnit, Crossing, Sampled
from aimd_des.costs import PolynomialCosts
from aimd_des.errors import InputError
from aimd_des.problem import Resource
from aimd_des.recording import Recording

__all__ = [
    "ChannelTable",
    "ClocksTable",
    "ControlUnitTable",
    "CostsTable",
    "RecordingTable",
    "ResourceTable",
    "Table",
]

Times = Literal["auto", "end"] | float | list[float]


class Table(BaseModel):
    """A table of the file: every key is known, every value has its type, nothing is ignored."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    def idle(self) -> tuple[str, ...]:
        """Name the keys that have no meaning beside the others.

        Returns
        -------
        tuple of str
            None of them may be given.
        """
        return ()

    @model_validator(mode="after")
    def _nothing_ignored(self) -> Self:
        for name in self.idle():
            if name in self.model_fields_set:
                raise InputError(f"{name}: has no meaning beside the other settings; leave it out")
        return self

    def spoken(self) -> dict[str, Any]:
        """Spell out every key that has a meaning.

        Returns
        -------
        dict
            Ready to be written as TOML.
        """
        idle = self.idle()
        return {name: _spoken(value) for name, value in self if value is not None and name not in idle}


def _spoken(value: Any) -> Any:
    if isinstance(value, Table):
        return value.spoken()
    if isinstance(value, dict):  # TOML has no word for None
        return {key: _spoken(item) for key, item in value.items() if item is not None}
    return [_spoken(item) for item in value] if isinstance(value, list) else value


class ResourceTable(Table):
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

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.build()
        return self

    def build(self) -> Resource:
        """Make the object that the table describes.

        Returns
        -------
        Resource
            Checked.
        """
        return Resource(**dict(self))


class CostsTable(Table):
    """``[costs]``: see `PolynomialCosts`.

    Attributes
    ----------
    exponents : list of int
        The powers.
    coefficients : list of list of list of float
        For each agent, resource and power.
    """

    exponents: list[int]
    coefficients: list[list[list[float]]]

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.build()
        return self

    def build(self) -> PolynomialCosts:
        """Make the object that the table describes.

        Returns
        -------
        PolynomialCosts
            Checked.
        """
        return PolynomialCosts(self.exponents, self.coefficients)


class ControlUnitTable(Table):
    """``[control_unit]``: see `Sampled` and `Crossing`.

    Attributes
    ----------
    kind : {"sampled", "crossing"}
        Which of the two.
    period, phase : float
        Of "sampled".
    refractory : float
        Of "crossing".
    sensing_delay : float
        Of both.
    """

    kind: Literal["sampled", "crossing"] = "sampled"
    period: float = 1.0
    phase: float = 0.0
    refractory: float = 1.0
    sensing_delay: float = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.build()
        return self

    def idle(self) -> tuple[str, ...]:
        """Name the keys that belong to the other kind.

        Returns
        -------
        tuple of str
            None of them may be given.
        """
        return ("refractory",) if self.kind == "sampled" else ("period", "phase")

    def build(self) -> ControlUnit:
        """Make the object that the table describes.

        Returns
        -------
        ControlUnit
            Checked.
        """
        if self.kind == "sampled":
            return Sampled(self.period, self.phase, self.sensing_delay)
        return Crossing(self.refractory, self.sensing_delay)


class ChannelTable(Table):
    """``[channel]``: see `BroadcastChannel`.

    Attributes
    ----------
    latency : float, list of float or table
        Constant, of all agents or of each; or a kind of latency with its parameters.
    loss : float, list of float, table or list of tables
        Probability, of all agents or of each; or a kind of loss with its parameters, or several.
    duplication : float or list of float
        Of all agents or of each.
    fifo : bool
        Whether links keep the order.
    """

    latency: float | list[float] | dict[str, Any] = 0.0
    loss: float | list[float] | dict[str, Any] | list[dict[str, Any]] = 0.0
    duplication: float | list[float] = 0.0
    fifo: bool = False

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.build()
        return self

    def build(self) -> BroadcastChannel:
        """Make the object that the table describes.

        Returns
        -------
        BroadcastChannel
            Checked.
        """
        latency = named_latency(self.latency) if isinstance(self.latency, dict) else self.latency
        return BroadcastChannel(latency, self._losses(), self.duplication, self.fifo)

    def _losses(self) -> Loss | float | list[float]:
        """Tell numbers, one table and several tables apart."""
        given = self.loss
        if isinstance(given, dict):
            return named_loss(given)
        if isinstance(given, list):
            tables = [part for part in given if isinstance(part, dict)]
            numbers = [part for part in given if not isinstance(part, dict)]
            return Combined(*map(named_loss, tables)) if tables else numbers
        return given


class ClocksTable(Table):
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

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.build()
        return self

    def build(self) -> Clocks:
        """Make the object that the table describes.

        Returns
        -------
        Clocks
            Checked.
        """
        return Clocks(**dict(self))


class RecordingTable(Table):
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

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.build()
        return self

    def build(self) -> Recording:
        """Make the object that the table describes.

        Returns
        -------
        Recording
            Checked.
        """
        return Recording(**dict(self))
