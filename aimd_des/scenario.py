"""One run as data: complete, frozen, read from TOML and written beside every result."""

from collections.abc import Callable
from typing import Any, Literal, Self

import tomli_w
from pydantic import BaseModel, ConfigDict, Field, model_validator

from aimd_des import checks
from aimd_des.channel import BroadcastChannel
from aimd_des.clock import Clock
from aimd_des.control_unit import Sampled
from aimd_des.costs import PolynomialCosts
from aimd_des.discrete import run_discrete
from aimd_des.errors import InputError
from aimd_des.problem import Problem, Resource
from aimd_des.recording import Recording
from aimd_des.registry import model_parameters, named_model
from aimd_des.results import Result
from aimd_des.simulation import Simulation

__all__ = ["Scenario"]

_Times = Literal["auto", "end"] | float | list[float]


class _Table(BaseModel):
    """A table of the file: every key is known, every value has its type, nothing changes."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=True)


class ResourceTable(_Table):
    """One of ``[[resources]]``: see `Resource`."""

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
        """Make the object that the table describes."""
        return Resource(**dict(self))


class CostsTable(_Table):
    """``[costs]``: see `PolynomialCosts`."""

    exponents: list[int]
    coefficients: list[list[list[float]]]

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.build()
        return self

    def build(self) -> PolynomialCosts:
        """Make the object that the table describes."""
        return PolynomialCosts(self.exponents, self.coefficients)


class ControlUnitTable(_Table):
    """``[control_unit]``: see `Sampled`."""

    period: float = 1.0
    phase: float = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.build()
        return self

    def build(self) -> Sampled:
        """Make the object that the table describes."""
        return Sampled(self.period, self.phase)


class ChannelTable(_Table):
    """``[channel]``: see `BroadcastChannel`."""

    latency: float | list[float] = 0.0
    loss: float | list[float] = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.build()
        return self

    def build(self) -> BroadcastChannel:
        """Make the object that the table describes."""
        return BroadcastChannel(latency=self.latency, loss=self.loss)  # type: ignore[arg-type]


class ClockTable(_Table):
    """``[clock]``: see `Clock`."""

    period: float = 1.0
    phase: float = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.build()
        return self

    def build(self) -> Clock:
        """Make the object that the table describes."""
        return Clock(self.period, self.phase)


class RecordingTable(_Table):
    """``[recording]``: see `Recording`."""

    demand: _Times = "auto"
    allocations: _Times = "auto"
    tail: int = 100

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.build()
        return self

    def build(self) -> Recording:
        """Make the object that the table describes."""
        return Recording(self.demand, self.allocations, self.tail)


# What has a meaning in an event-driven run only.
_ASYNCHRONOUS = ("agents", "control_unit", "channel", "clock")


class Scenario(_Table):
    """One run as data.

    Attributes
    ----------
    title : str
        What the run is about, for people.
    until : float
        The end of the run, in units of time (steps of the synchronous algorithm).
    seed : int
        Decides everything random, at least 0.
    model : str, optional
        A registered model, such as "models.smart_cameras"; or the problem is written out.
    parameters : dict
        Of the model; defaults are filled in, ``seed`` with the scenario's own.
    resources, costs : optional
        The problem written out: a table for each resource, and polynomial costs.
    dynamics : {"discrete", "synchronous"}
        "discrete": event-driven, agents on their clocks behind a channel; "synchronous":
        Algorithms 1 and 2 without events.
    lag : {1, 0}
        For "synchronous": whether a signal acts one step after the excess, or in the same step.
    agents : {"process"}
        How agents are represented: a SimPy process each.
    control_unit, channel, clock
        Parts of the event-driven system.
    recording
        What is kept.

    Raises
    ------
    pydantic.ValidationError
        If anything is missing, unknown, of a wrong type or outside its range.
    """

    title: str = ""
    until: float
    seed: int = 0
    dynamics: Literal["discrete", "synchronous"] = "discrete"
    lag: Literal[0, 1] = 1
    agents: Literal["process"] = "process"
    model: str | None = None
    parameters: dict[str, Any] = Field(default_factory=dict)
    control_unit: ControlUnitTable = Field(default_factory=ControlUnitTable)
    channel: ChannelTable = Field(default_factory=ChannelTable)
    clock: ClockTable = Field(default_factory=ClockTable)
    recording: RecordingTable = Field(default_factory=RecordingTable)
    costs: CostsTable | None = None
    resources: list[ResourceTable] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        checks.number("until", self.until, low=0.0, low_open=True)
        checks.integer("seed", self.seed, low=0)
        inline = [name for name in ("resources", "costs") if getattr(self, name) is not None]
        if (self.model is not None and inline) or (self.model is None and len(inline) < 2):
            given = [*(["model"] if self.model is not None else []), *inline]
            raise InputError.of("the problem", given, "either a model, or resources together with costs")
        if self.model is None and self.parameters:
            raise InputError.of("parameters", self.parameters, "left out where there is no model")
        idle = _ASYNCHRONOUS if self.dynamics == "synchronous" else ("lag",)
        for name in idle:
            if name in self.model_fields_set:
                raise InputError(f"{name}: has no meaning with dynamics = {self.dynamics!r}; leave it out")
        return self

    def resolved(self) -> "Scenario":
        """Fill in every parameter of the model.

        Returns
        -------
        Scenario
            Running it gives the same result whatever the defaults become.
        """
        if self.model is None:
            return self
        parameters = model_parameters(self.model, self.parameters, self.seed)
        return self.model_copy(update={"parameters": parameters})

    def to_toml(self) -> str:
        """Write the scenario as TOML, every value spelled out.

        Returns
        -------
        str
            Reading it gives an equal scenario.
        """
        idle = _ASYNCHRONOUS if self.dynamics == "synchronous" else ("lag",)
        return tomli_w.dumps(self.model_dump(exclude_none=True, exclude=set(idle)))

    def problem(self) -> Problem:
        """Build the problem that is shared.

        Returns
        -------
        Problem
            From the model, or as written out.

        Raises
        ------
        InputError
            If there is no such model, or its parameters or the costs are refused.
        """
        if self.model is not None:
            parameters = model_parameters(self.model, self.parameters, self.seed)
            return named_model(self.model)(**parameters)
        assert self.resources is not None and self.costs is not None  # noqa: S101 - _check saw to it
        return Problem([table.build() for table in self.resources], self.costs.build())

    def run(self, watch: Callable[[float, int], None] | None = None) -> Result:
        """Run the scenario.

        Parameters
        ----------
        watch : callable, optional
            Called with (simulated time, events handled) every few thousand events.

        Returns
        -------
        Result
            A pure function of the scenario.

        Raises
        ------
        InputError
            If the problem is refused, or a length does not fit the number of agents.
        """
        problem, recording = self.problem(), self.recording.build()
        if self.dynamics == "synchronous":
            if self.until % 1.0:
                raise InputError.of("until", self.until, "a whole number of steps")
            return run_discrete(
                problem, steps=int(self.until), seed=self.seed, lag=self.lag, recording=recording
            )
        simulation = Simulation(
            problem,
            control_unit=self.control_unit.build(),
            channel=self.channel.build(),
            clock=self.clock.build(),
            seed=self.seed,
            recording=recording,
        )
        return simulation.run(self.until, watch)
