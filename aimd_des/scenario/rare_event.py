"""A rare event in a scenario file: what is to be estimated, as data."""

from typing import Literal, Self

from pydantic import model_validator

from aimd_des.scenario.strict_table import Table
from aimd_des.utils import validation


class RareEventSettings(Table):
    """``[rare_event]``: the event whose probability is estimated, see `aimd_des.study.rare_event`.

    Attributes
    ----------
    level : float
        Of total demand over the capacity, or of the misallocation.
    within : float
        How long after `after` it may be reached, greater than 0 and in units of time.
    after : float
        From when on it counts.
    resource : str, optional
        Of which resource; default: the largest of all.
    measure : {"demand", "misallocation"}
        What reaches the level.
    method : {"fixed_effort", "restart"}
        How paths are split.
    trials, repetitions : int
        Paths from each level, and independent estimates.
    step : float
        How soon after it has passed a level a path is split, in units of time; by fixed effort, paths of
        continuous demand are split at once.
    """

    level: float
    within: float
    after: float = 0.0
    resource: str | None = None
    measure: Literal["demand", "misallocation"] = "demand"
    method: Literal["fixed_effort", "restart"] = "fixed_effort"
    trials: int = 100
    repetitions: int = 20
    step: float = 0.25

    @model_validator(mode="after")
    def _check(self) -> Self:
        validation.number("rare_event.level", self.level)
        validation.number("rare_event.within", self.within, low=0.0, low_open=True)
        validation.number("rare_event.after", self.after, low=0.0)
        validation.integer("rare_event.trials", self.trials, low=10)
        validation.integer("rare_event.repetitions", self.repetitions, low=2)
        validation.number("rare_event.step", self.step, low=0.0, low_open=True, high=self.within)
        return self
