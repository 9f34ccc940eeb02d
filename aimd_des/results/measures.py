"""What is measured of a run: the one table that results, studies, reports and the command line read.

`Measured` holds what the measures are taken of; each row of `MEASURES` takes one number for each resource
from it, or one for all resources together, repeated.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.problem.optimum import Optimum
from aimd_des.problem.problem import Problem
from aimd_des.results import metrics
from aimd_des.results.misallocation import misallocation
from aimd_des.results.run_data import Account, Piece
from aimd_des.results.tracking import piece_problem
from aimd_des.utils.formatting import percent
from aimd_des.utils.validation import FloatArray, IntArray

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Measured:
    """A run at its end, as the measures see it."""

    problem: Problem  # of the whole run
    last: Piece  # what is in force at the end
    everybody: FloatArray  # (n, m): averages at the end, in units of the resources
    signals: IntArray  # (m,): how many were broadcast
    bits_per_signal: int  # what a signal costs
    account: Account  # copies and responses
    overshoot: metrics.Overshoot  # over the whole run
    # Gives the optimum that the averages are held against, None where no agent is present.
    optimum: Callable[[], Optimum | None]
    recovery: Callable[[], FloatArray]  # gives the recovery times of the last change, (m,)

    @cached_property
    def average(self) -> FloatArray:
        """Averages of the agents that are here, shape (n_here, m)."""
        return self.everybody[self.last.present]

    @cached_property
    def in_force(self) -> Problem:
        """The problem at the end, for the agents that are here."""
        return piece_problem(self.problem, self.last)

    @cached_property
    def best(self) -> FloatArray:
        """What the agents that are here should hold, shape (n_here, m)."""
        found = self.optimum()
        assert found is not None  # noqa: S101 - asked for where an agent is present
        return found.allocation

    def cost_ratio(self) -> FloatArray:
        """Compare the cost of all resources together, and say it of each."""
        ratio = metrics.cost_ratio(self.in_force.costs, self.average, self.best)
        return np.full(len(self.signals), ratio)


class Measure(NamedTuple):
    """One column of the summary."""

    name: str  # of the column
    kind: Literal["integer", "number"]  # what it holds
    title: str  # its name for people
    unit: str  # what its numbers count, or are shares of
    meaning: str  # in one sentence
    function: Callable[[Measured], npt.NDArray[Any]]  # from a `Measured` to a value for each resource
    # Whether it is taken of the agents that are here at the end, and so is NaN where there are none.
    of_those_here: bool = False
    needs_optimum: bool = False  # whether it holds the averages against the optimum of the problem in force
    always: bool = True  # whether it is measured unless others are asked for

    def of(self, run: Measured) -> npt.NDArray[Any]:
        """Measure a run, shape (m,)."""
        if self.of_those_here and not run.last.present.any():
            return np.full(len(run.signals), np.nan)
        return self.function(run)


def _not_measured(run: Measured) -> FloatArray:
    """Say nothing: what a result alone does not know is put into the place by what asks for it."""
    return np.full(len(run.signals), np.nan)


#: The measures that an estimate of a rare event gives.
RARE = ("rare_event", "rare_event_low", "rare_event_high", "rare_event_error", "rare_event_gain")

#: The measure that theory gives.
EXPECTED = "expected_misallocation"

_TABLE = (
    Measure(
        "signals",
        "integer",
        "Signals",
        "signals",
        "Capacity signals that were broadcast.",
        lambda run: run.signals,
    ),
    Measure(
        "bits",
        "integer",
        "Bits",
        "bits",
        "What the signals cost: one bit each, and those of a running number where there is one.",
        lambda run: run.bits_per_signal * run.signals,
    ),
    Measure(
        "delivered",
        "integer",
        "Delivered",
        "copies",
        "Copies of signals that arrived, duplicates not counted.",
        lambda run: run.account.delivered.sum(axis=1),
    ),
    Measure(
        "lost",
        "integer",
        "Lost",
        "copies",
        "Copies of signals that the channel lost.",
        lambda run: run.account.lost.sum(axis=1),
    ),
    Measure(
        "in_flight",
        "integer",
        "In flight",
        "copies",
        "Copies of signals that were under way when the run ended.",
        lambda run: run.account.in_flight.sum(axis=1),
    ),
    Measure(
        "duplicated",
        "integer",
        "Duplicated",
        "copies",
        "Duplicates that arrived besides the copies.",
        lambda run: run.account.duplicated.sum(axis=1),
    ),
    Measure(
        "responses",
        "integer",
        "Responses",
        "responses",
        "Decreases of demand by which agents responded to signals.",
        lambda run: run.account.responses.sum(axis=1),
    ),
    Measure(
        "saturated",
        "integer",
        "Saturated",
        "responses",
        "Responses whose probability was cut off: at 1, or of a fractional cut at 1 / (1 - beta).",
        lambda run: run.account.saturated.sum(axis=1),
    ),
    Measure(
        "utilisation",
        "number",
        "Utilisation",
        "share of the capacity",
        "The sum of the averages over the capacity.",
        lambda run: metrics.utilisation(run.average, run.last.capacity),
        of_those_here=True,
    ),
    Measure(
        "relative_error",
        "number",
        "Relative error",
        "share of the optimum",
        "The sum of the absolute differences between averages and optimum, over the sum of the optimum.",
        lambda run: metrics.relative_error(run.average, run.best),
        of_those_here=True,
        needs_optimum=True,
    ),
    Measure(
        "misallocation",
        "number",
        "Misallocation",
        "share of what is used",
        "How far the averages are from the optimum for what is used: the sum of the absolute differences over"
        " the sum of that optimum.",
        lambda run: misallocation(run.in_force, run.average),
        of_those_here=True,
    ),
    Measure(
        "consensus_spread",
        "number",
        "Consensus spread",
        "share of the mean derivative",
        "The standard deviation of the derivatives of the costs across agents, over their mean.",
        lambda run: metrics.consensus_spread(run.in_force.costs, run.average),
        of_those_here=True,
    ),
    Measure(
        "cost_ratio",
        "number",
        "Cost ratio",
        "total cost over optimal cost",
        "The cost of all agents over that of the optimum, for all resources together: below 1 where capacity"
        " is left unused.",
        lambda run: run.cost_ratio(),
        of_those_here=True,
        needs_optimum=True,
    ),
    Measure(
        "overshoot_peak",
        "number",
        "Peak demand",
        "share of the capacity",
        "The highest total demand over the capacity in force; what it is for no time, between two events of"
        " one instant, does not count.",
        lambda run: run.overshoot.peak,
    ),
    Measure(
        "overshoot_time",
        "number",
        "Time above the capacity",
        "share of time",
        "The share of time for which total demand was above the capacity, integrated and not sampled.",
        lambda run: run.overshoot.time,
    ),
    Measure(
        "overshoot_mean",
        "number",
        "Mean excess",
        "share of the capacity",
        "The time average of what exceeds the capacity, over the capacity, integrated and not sampled.",
        lambda run: run.overshoot.mean,
    ),
    Measure(
        "recovery_time",
        "number",
        "Recovery time",
        "time",
        "Time from the last change of the problem until the sum of the averages stays within 5 % of the"
        " capacity; measured where it is asked for.",
        lambda run: run.recovery(),
        always=False,
    ),
    Measure(
        EXPECTED,
        "number",
        "Expected misallocation",
        "share of what is used",
        "What theory expects of the misallocation in the mean over runs; in studies that ask for it and in"
        " the folder of a run.",
        _not_measured,
        always=False,
    ),
    Measure(
        "rare_event",
        "number",
        "Probability of the rare event",
        "probability",
        "Estimate of the probability of the rare event that the scenario names.",
        _not_measured,
        always=False,
    ),
    Measure(
        "rare_event_low",
        "number",
        "Lower end of the probability",
        "probability",
        "Lower end of the 95 % confidence interval of the probability of the rare event.",
        _not_measured,
        always=False,
    ),
    Measure(
        "rare_event_high",
        "number",
        "Upper end of the probability",
        "probability",
        "Upper end of the 95 % confidence interval of the probability of the rare event.",
        _not_measured,
        always=False,
    ),
    Measure(
        "rare_event_error",
        "number",
        "Relative error of the probability",
        "share of the probability",
        "Standard error of the probability of the rare event over the probability.",
        _not_measured,
        always=False,
    ),
    Measure(
        "rare_event_gain",
        "number",
        "Gain of splitting",
        "work over work",
        "Work of plain runs for the same relative error over the work of the estimate.",
        _not_measured,
        always=False,
    ),
)

#: The columns of `Result.summary`, in their order.
MEASURED = tuple(measure.name for measure in _TABLE if measure.always)
#: And what is put beside them.
MEASURES = {measure.name: measure for measure in _TABLE}

#: What is shown where there is no room for all, the most telling first.
FIRST = (
    "utilisation",
    "misallocation",
    "cost_ratio",
    "overshoot_peak",
    "overshoot_time",
    "relative_error",
    "consensus_spread",
    "signals",
)


#: The five that a result, a stored run and a notebook show of a run.
SHOWN = ("signals", "utilisation", "misallocation", "overshoot_peak", "overshoot_time")


def shown_measures(resources: Sequence[str], of: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Put the measures that are shown, as far as they are there, into heads and a row for each resource."""
    names = [name for name in SHOWN if name in of]
    rows = [
        [resource, *(_shown_value(name, of[name][j]) for name in names)]
        for j, resource in enumerate(resources)
    ]
    return ["resource", *map(measure_words, names)], rows


def _shown_value(name: str, value: Any) -> str:
    return f"{int(value):,}" if MEASURES[name].kind == "integer" else percent(float(value))


def measure_words(name: str) -> str:
    """Write the name of a measure, or of a column of the user's own, for people."""
    return MEASURES[name].title.lower() if name in MEASURES else name.replace("_", " ")


def measures() -> "pd.DataFrame":
    """List the measures of a run.

    Returns
    -------
    DataFrame
        Index: name, as in summaries and studies.  Columns: title, unit, meaning, in_summary (whether it is
        measured unless others are asked for) and shown (whether it is among the five that a result shows).
    """
    import pandas as pd

    rows = [(one.title, one.unit, one.meaning, one.always, one.name in SHOWN) for one in MEASURES.values()]
    index = pd.Index(list(MEASURES), name="name")
    return pd.DataFrame(rows, index, ["title", "unit", "meaning", "in_summary", "shown"])


def summary_frame(values: Mapping[str, npt.NDArray[Any]], names: Sequence[str]) -> "pd.DataFrame":
    """Put measures into a frame with a row for each resource, and say their units and meanings."""
    import pandas as pd

    found = pd.DataFrame(values, index=pd.Index(names, name="resource"))
    found.attrs["units"] = {name: MEASURES[name].unit for name in MEASURED}
    found.attrs["meanings"] = {name: MEASURES[name].meaning for name in MEASURED}
    return found
