"""The keys of a scenario: what each holds, and what fits together."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from aimd_des.dynamics.averaging import Averaging
from aimd_des.dynamics.demand import CONTINUOUS, DISCRETE
from aimd_des.dynamics.responses import Response
from aimd_des.engine.control_unit import CrossingTable, table_of
from aimd_des.scenario.build import under
from aimd_des.scenario.error_messages import InSentences
from aimd_des.scenario.kind_tables import KindTable, kind_table, one_of
from aimd_des.scenario.old_keys import with_new_keys
from aimd_des.scenario.parameters import as_data, refuse_no_data
from aimd_des.scenario.prices import RedrawnPrices
from aimd_des.scenario.rare_event import RareEventSettings
from aimd_des.scenario.strict_table import Table
from aimd_des.scenario.tables import (
    ChannelSettings,
    ClocksSettings,
    RecordingSettings,
    ResourceChange,
    ResourceSettings,
)
from aimd_des.scenario.warm_up import WarmUpSettings
from aimd_des.utils import limits, validation
from aimd_des.utils.errors import InputError

# Keys that have no meaning with some dynamics.
_IDLE = {
    "synchronous": (
        *("agents", "control_unit", "channel", "clocks", "compensation"),
        *("interventions", "warm_up", "rare_event"),
    ),
    "discrete": ("lag",),
    "continuous": ("lag", "clocks"),
}

_LARGEST_SEED = 2**64 - 1  # as large as one can be that is drawn from 64 bits

if TYPE_CHECKING:
    ControlUnitTable = KindTable
    AveragingTable = KindTable
    CompensationTable = KindTable
    ResponseTable = KindTable
    CostsTable = KindTable
    InterventionTable = KindTable
else:
    ControlUnitTable = one_of("control_unit")
    AveragingTable = one_of("averaging")
    CompensationTable = one_of("compensation")
    ResponseTable = one_of("response")
    InterventionTable = one_of("intervention")
    CostsTable = one_of("costs")


class ScenarioKeys(Table, InSentences):
    """The data of a scenario, checked; `Scenario` says what each key means, and does things with them."""

    title: str = ""
    until: float
    seed: int = 0
    dynamics: Literal["discrete", "continuous", "synchronous"] = "discrete"
    lag: int = Field(default=1, ge=0, le=1)
    agents: Literal["process", "fleet"] = "process"
    model: str | None = None
    parameters: dict[str, Any] = Field(default_factory=dict)
    control_unit: ControlUnitTable = Field(default_factory=lambda: kind_table("control_unit", "sampled"))
    channel: ChannelSettings = Field(default_factory=ChannelSettings)
    clocks: ClocksSettings = Field(default_factory=ClocksSettings)
    averaging: AveragingTable = Field(default_factory=lambda: kind_table("averaging", "cumulative"))
    response: ResponseTable | None = None
    compensation: CompensationTable | None = None
    interventions: list[InterventionTable] = Field(default_factory=list)
    warm_up: WarmUpSettings | None = None
    rare_event: RareEventSettings | None = None
    recording: RecordingSettings = Field(default_factory=RecordingSettings)
    costs: CostsTable | None = None
    resources: list[ResourceSettings] | dict[str, ResourceChange] | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_python(cls, data: Any) -> Any:
        """Take arrays and series for lists, and NumPy's numbers for Python's, in all tables below."""
        data = as_data(data)
        return with_new_keys(data) if isinstance(data, dict) else data

    @field_validator("resources", mode="before")
    @classmethod
    def _in_brackets(cls, resources: Any) -> Any:
        """Refuse one table where a list of tables is due: each of its keys would be refused for itself."""
        known = ResourceSettings.model_fields
        if isinstance(resources, Mapping) and (keys := [key for key in resources if key in known]):
            lists = "[[resources]] where the problem is written out, or [resources.0] beside a model"
            raise ValueError(f"keys = {keys}: must be below {lists}")
        return resources

    @model_validator(mode="after")
    def _check(self) -> Self:
        limits.text("title", self.title, empty=True)
        validation.number("until", self.until, low=0.0, low_open=True)
        if self.dynamics == "synchronous" and self.until % 1.0:
            raise InputError.of("until", self.until, "a whole number of steps")
        if self.warm_up is not None:
            self.warm_up.check(self.until)
        validation.integer("seed", self.seed, low=0, high=_LARGEST_SEED)
        refuse_no_data("parameters", self.parameters)
        self._check_problem()
        if self.dynamics == "discrete" and self.control_unit.of.name == "crossing":
            reason = "one that samples with discrete dynamics: demand that jumps at ticks crosses nothing"
            raise InputError.of("control_unit.kind", "crossing", reason, "or set dynamics = 'continuous'")
        with under("averaging"):
            averaging: Averaging = self.averaging.build()
            averaging.parameters(CONTINUOUS if self.dynamics == "continuous" else DISCRETE)
        for number, table in enumerate(self.interventions):
            field = f"interventions.{number}.kind"
            if getattr(table.of.of.make, "of_hold_off", False) and not self._holds_off():
                allowed = "left out unless control_unit.kind is 'crossing': others have no hold-off"
                raise InputError.of(field, table.of.name, allowed)
            if table.of.of.make is RedrawnPrices and self.model is None:
                allowed = "left out where the problem is written out"
                raise InputError.of(field, "prices", allowed, "prices are drawn by a model")
        return self

    def _holds_off(self) -> bool:
        """Tell whether the control unit has a hold-off that can be changed."""
        return isinstance(table_of(self.control_unit.build()), CrossingTable)

    def _check_problem(self) -> None:
        given = [name for name in ("model", "resources", "costs") if getattr(self, name) is not None]
        changes = isinstance(self.resources, dict)
        if given not in (["model"], ["resources", "costs"], *([["model", "resources"]] if changes else [])):
            raise InputError.of("the problem", given, "either a model, or resources together with costs")
        if changes and self.model is None:
            allowed = "tables in a list, [[resources]], where the problem is written out"
            raise InputError.of("resources", list(self.resources or ()), allowed)

    def idle(self) -> tuple[str, ...]:
        """Name the keys that have no meaning with these dynamics, or with this problem.

        Returns
        -------
        tuple of str
            None of them may be given.
        """
        return (*_IDLE[self.dynamics], *(("parameters",) if self.model is None else ()))

    def rule(self) -> Response | None:
        """Build how agents answer signals.

        Returns
        -------
        Response or None
            None is the paper's rule.
        """
        made: Response | None = None if self.response is None else self.response.build()
        return made
