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

    jobs: list[Callable[[int], Any]]  # Each takes a seed
    # Makes rows of the outcomes of all jobs, a list of replications for each.
    rows: Callable[[list[list[Any]]], list[Row]]


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


def by_formula(rows: Sequence[Row], order: Sequence[str] = ()) -> list[Row]:
    """Sort rows by formula: in the order that is given, or by when each comes first."""
    places = list(order) or list(dict.fromkeys(row.formula for row in rows))
    return sorted(rows, key=lambda row: places.index(row.formula))


def frame(rows: Sequence[Row]) -> pd.DataFrame:
    """Put rows into a table, with deviations and verdicts.

    The deviation in errors is NaN where the error is 0 or rounding; a claim is empty where a deviation is
    only shown, and holds is yes, no or empty.
    """
    table = []
    for row in rows:
        deviation = row.mean - row.predicted
        noisy = row.standard_error > 1e-12 * max(abs(row.mean), 1e-300)
        bound = row.rule is not None and row.rule.kind == "at least"
        verdict = "" if row.rule is None else "yes" if row.rule.holds(row.predicted, row.mean) else "no"
        table.append(
            {
                **{name: value for name, value in vars(row).items() if name != "rule"},
                "deviation": deviation,
                "relative_deviation": np.nan if bound or not row.predicted else deviation / row.predicted,
                "deviation_in_errors": deviation / row.standard_error if noisy and not bound else np.nan,
                "claim": "" if row.rule is None else row.rule.words,
                "holds": verdict,
            }
        )
    return pd.DataFrame(table)


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
