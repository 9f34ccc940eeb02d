"""Rows of the table of closed forms: prediction, measurement, and whether the one may be trusted."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from aimd_des.lowlevel import FloatArray
from aimd_des.study import mean_and_error


@dataclass(frozen=True)
class Size:
    """How much is run."""

    replications: int  # Of everything
    # Length of event-driven runs, and the time from which they are measured.
    until: float
    start: float
    steps: int  # Length of synchronous runs
    critical_until: float  # Length of runs in the search for the critical loss
    halvings: int  # Steps of that search
    agents: int  # In that search
    # Length of the runs whose accuracy is measured, and the misallocation that they are to come down to.
    long: float
    accuracy: float


@dataclass(frozen=True)
class Rule:
    """What is claimed of a formula."""

    kind: str  # Whether the deviation counts over the prediction or as it is, or the prediction is a bound
    tolerance: float  # Largest deviation
    words: str  # The same for readers

    def holds(self, predicted: float, mean: float) -> bool:
        """Say whether a measurement agrees; NaN does not."""
        if self.kind == "at least":
            return mean >= predicted
        scale = abs(predicted) if self.kind == "relative" else 1.0
        return abs(mean - predicted) <= self.tolerance * scale


@dataclass(frozen=True)
class Row:
    """One number of theory beside its measurement."""

    # What was predicted, for what, of which resource.
    formula: str
    setting: str
    resource: str
    # Gamma, and the least time between two signals.
    normalization: float
    hold_off: float
    # In the units of the quantity.
    predicted: float
    mean: float
    standard_error: float
    rule: Rule | None = None  # Without one the deviation is only shown


@dataclass(frozen=True, eq=False)
class Experiment:
    """Runs, and what to make of them."""

    # Each is a job, which takes a seed, and what makes rows of the outcomes of its replications.
    parts: list[tuple[Callable[[int], Any], Callable[[list[Any]], list[Row]]]]
    order: Sequence[str] = ()  # Of the formulas; default: by when each comes first

    @property
    def jobs(self) -> list[Callable[[int], Any]]:
        """What is run."""
        return [job for job, _ in self.parts]

    def rows(self, outcomes: Sequence[list[Any]]) -> list[Row]:
        """Make rows of the replications of every job, sorted by formula."""
        pairs = zip(self.parts, outcomes, strict=True)
        rows = [row for (_, make), found in pairs for row in make(found)]
        places = list(self.order) or list(dict.fromkeys(row.formula for row in rows))
        return sorted(rows, key=lambda row: places.index(row.formula))


def rows_of(
    found: tuple[FloatArray, FloatArray], predicted: Any, names: Sequence[str], **labels: Any
) -> list[Row]:
    """Make a row for each resource from means, errors and predictions; labels are the other fields."""
    parts = (np.broadcast_to(part, len(names)).astype(float).tolist() for part in (predicted, *found))
    return [
        Row(resource=name, predicted=wanted, mean=mean, standard_error=error, **labels)
        for name, wanted, mean, error in zip(names, *parts, strict=True)
    ]


def estimated(values: npt.ArrayLike, predicted: Any, names: Sequence[str], **labels: Any) -> list[Row]:
    """Make a row for each resource from values (r, m) of r replications."""
    return rows_of(mean_and_error(values), predicted, names, **labels)


def frame(rows: Sequence[Row]) -> pd.DataFrame:
    """Put rows into a table, with deviations and verdicts.

    The deviation in errors is NaN where the error is 0 or rounding; a claim is empty where a deviation is
    only shown, and holds is yes, no or empty.
    """
    table = pd.DataFrame([vars(row) for row in rows]).drop(columns="rule")
    predicted, mean, error = table["predicted"], table["mean"], table["standard_error"]
    bound = np.array([row.rule is not None and row.rule.kind == "at least" for row in rows])
    noisy = error > 1e-12 * mean.abs().clip(lower=1e-300)
    table["deviation"] = mean - predicted
    table["relative_deviation"] = (table["deviation"] / predicted).where(~bound & (predicted != 0.0))
    table["deviation_in_errors"] = (table["deviation"] / error).where(~bound & noisy)
    table["claim"] = ["" if row.rule is None else row.rule.words for row in rows]
    holds = ["" if row.rule is None else row.rule.holds(row.predicted, row.mean) for row in rows]
    return table.assign(holds=["" if held == "" else "yes" if held else "no" for held in holds])


_HEADER = ("setting", "Gamma", "hold-off", "of", "theory", "simulation", "deviation", "claim", "holds")


def _readable(table: pd.DataFrame) -> pd.DataFrame:
    """Write the numbers of the table for readers."""
    lines = []
    for row in table.to_dict("records"):
        relative, errors = row["relative_deviation"], row["deviation_in_errors"]
        parts = [
            f"{row['deviation']:+.4f}" if np.isnan(relative) else f"{100 * relative:+.2f} %",
            "" if np.isnan(errors) else f"({errors:+.1f} se)",
        ]
        bound = row["claim"].startswith("at least")
        cells = [
            row["formula"],
            row["setting"],
            f"1/{1 / row['normalization']:.4g}" if row["normalization"] > 0 else "",
            "" if np.isnan(row["hold_off"]) else f"{row['hold_off']:g}",
            row["resource"],
            f"{'≥ ' if bound else ''}{row['predicted']:.4f}",
            f"{row['mean']:.4f} ± {row['standard_error']:.4f}",
            "" if bound else " ".join(filter(None, parts)),
            row["claim"],
            row["holds"],
        ]
        lines.append(dict(zip(("formula", *_HEADER), cells, strict=True)))
    return pd.DataFrame(lines)


def digest(table: pd.DataFrame) -> pd.DataFrame:
    """Sum up the table, a line for each formula: its rows, least and largest deviation, claim and verdict."""
    lines = []
    for formula, rows in table.groupby("formula", sort=False):
        claim = " ".join(dict.fromkeys(filter(None, rows["claim"])))
        relative = rows["relative_deviation"]
        if claim.startswith("at least"):
            span = f"{rows['mean'].min():.1f} to {rows['mean'].max():.1f} times"
        elif relative.isna().any():
            span = f"{rows['deviation'].min():+.4f} to {rows['deviation'].max():+.4f}"
        else:
            span = f"{100 * relative.min():+.2f} to {100 * relative.max():+.2f} %"
        claimed = rows["holds"] != ""
        verdict = f"{(rows['holds'] == 'yes').sum()} of {claimed.sum()}" if claimed.any() else ""
        cells = (str(formula), str(len(rows)), span, claim, verdict)
        lines.append(dict(zip(("formula", "rows", "deviations", "claim", "holds"), cells, strict=True)))
    return pd.DataFrame(lines)


def markdown(table: pd.DataFrame) -> str:
    """Write the table as Markdown, a section for each formula."""
    lines = []
    for formula, rows in _readable(table).groupby("formula", sort=False):
        lines += [f"### {formula}", "", f"| {' | '.join(_HEADER)} |", "|---|" + "---:|" * (len(_HEADER) - 1)]
        lines += [f"| {' | '.join(cells)} |" for cells in rows[list(_HEADER)].itertuples(index=False)]
        lines.append("")
    return "\n".join(lines)
