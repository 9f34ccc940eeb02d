"""Tables of the studies: a row for each point and measure, with mean, standard error and theory."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import t as student

from aimd_des import study
from aimd_des.lowlevel import FloatArray

_THEORY = "theory of "


def summarise(rows: Sequence[Mapping[str, Any]], labels: Sequence[str]) -> pd.DataFrame:
    """Reduce rows of single replications, labels and numbers, to means: a measure after the other."""
    frame = pd.DataFrame(rows)
    measures = [name for name in frame.columns if name not in labels]
    table = study.summarise(frame, labels, measures).drop(columns=["low", "high"])
    place = table["measure"].astype(str).map(measures.index)
    return table.iloc[np.argsort(place, kind="stable")].reset_index(drop=True)


def summarise_draws(rows: Sequence[Mapping[str, Any]] | pd.DataFrame, labels: Sequence[str]) -> pd.DataFrame:
    """Reduce rows of single runs, labels, `draw` and numbers, to means over draws: a measure after the other.

    The standard error is that of a mean over draws; `spread` is the standard deviation of draws' means, and
    `within` the standard error of one.
    """
    frame = pd.DataFrame(rows)
    measures = [name for name in frame.columns if name not in {*labels, "draw"}]
    table = study.summarise(frame, labels, measures, draws="draw").drop(columns=["low", "high"])
    place = table["measure"].astype(str).map(measures.index)
    return table.iloc[np.argsort(place, kind="stable")].reset_index(drop=True)


def theory_of(measure: str) -> str:
    """Name what theory has for a measure, where that is measured as well: of a draw, or of a run."""
    return f"{_THEORY}{measure}"


def with_theory(table: pd.DataFrame, labels: Sequence[str]) -> pd.DataFrame:
    """Put measures that are called "theory of" another beside that, as a column, and leave out empty rows."""
    known = table["measure"].str.startswith(_THEORY)
    expected = table[known].assign(measure=table["measure"].str.removeprefix(_THEORY))
    expected = expected[[*labels, "measure", "mean"]].rename(columns={"mean": "theory"})
    found = table[~known & table["mean"].notna()]
    return found.merge(expected, "left", [*labels, "measure"]).reset_index(drop=True)


def table_of(
    pairs: Iterable[tuple[Any, Iterable[Iterable[Mapping[str, float]]]]],
    labels: Sequence[str],
    first: int = 0,
    theory: Callable[[Any, int], Mapping[str, float]] | None = None,
) -> pd.DataFrame:
    """Summarise what `run_draws` gives, over draws that are counted from `first` on.

    Labels are fields of the cases, and outcomes map measures to numbers.  So does theory, a function of case
    and draw, where it has something for them.
    """
    rows = []
    for case, found in pairs:
        own = {name: getattr(case, name) for name in labels}
        for draw, outcomes in enumerate(found, first):
            known = {} if theory is None else theory(case, draw)
            expected = {theory_of(measure): value for measure, value in known.items()}
            rows += [{**own, "draw": draw, **outcome, **expected} for outcome in outcomes]
    return with_theory(summarise_draws(rows, labels), labels)


def estimate(
    labels: Mapping[str, Any], measure: str, found: tuple[Any, Any], count: int, theory: float | None = None
) -> dict[str, Any]:
    """Make a row of a table from the mean of replications and its error, each a number or an array of one."""
    mean, error = (float(np.ravel(part)[0]) for part in found)
    row = {**labels, "measure": measure, "mean": mean, "standard_error": error, "replications": count}
    return row if theory is None else {**row, "theory": theory}


def pick(table: pd.DataFrame, **wanted: object) -> pd.DataFrame:
    """Take the rows that have these labels; NaN is a label, too."""
    chosen = np.ones(len(table), dtype=np.bool_)
    for name, value in wanted.items():
        column = table[name]
        chosen &= (column.isna() if value != value else column == value).to_numpy()  # noqa: PLR0124 - NaN
    rows: pd.DataFrame = table.loc[chosen]
    return rows


def numbers(table: pd.DataFrame, column: str = "mean", **wanted: object) -> FloatArray:
    """Take a column of the rows that have these labels."""
    return pick(table, **wanted)[column].to_numpy(dtype=np.float64)


def number(table: pd.DataFrame, column: str = "mean", **wanted: object) -> float:
    """Look up one number: of the first row that has these labels."""
    return float(numbers(table, column, **wanted)[0])


def reached(places: FloatArray, values: FloatArray, level: float) -> float:
    """Find where values come to a level for the first time, interpolated; NaN if they never do."""
    above = np.flatnonzero(values >= level)
    if len(above) == 0 or above[0] == 0:
        return np.nan if len(above) == 0 else float(places[0])
    k = int(above[0])
    slope = (values[k] - values[k - 1]) / (places[k] - places[k - 1])
    return float(places[k - 1] + (level - values[k - 1]) / slope)


def said(table: pd.DataFrame, scale: float = 1.0, digits: int = 2, **wanted: object) -> str:
    """Say a mean, and in brackets what theory has for it."""
    row = pick(table, **wanted).iloc[0]
    expected = "" if np.isnan(row["theory"]) else f" (theory {scale * row['theory']:.{digits}f})"
    return f"{scale * row['mean']:.{digits}f}{expected}"


def over_draws(table: pd.DataFrame, scale: float = 1.0, digits: int = 2, **wanted: object) -> str:
    """Say a mean over draws with its 95 % interval, and in brackets how much single draws scatter."""
    row = pick(table, **wanted).iloc[0]
    reach = float(student.ppf(0.975, row["draws"] - 1)) * row["standard_error"]
    mean, half, spread = (f"{scale * value:.{digits}f}" for value in (row["mean"], reach, row["spread"]))
    return f"{mean} ± {half} (± {spread} over draws)"


def beside_theory(table: pd.DataFrame, scale: float = 1.0, digits: int = 2, **wanted: object) -> str:
    """Say the same, and what theory has for it, if it has anything."""
    known = scale * number(table, "theory", **wanted)
    found = over_draws(table, scale, digits, **wanted)
    return found if np.isnan(known) else f"{found}, theory {known:.{digits}f}"


def shown(table: pd.DataFrame, labels: Sequence[str], form: str = ".4f") -> pd.DataFrame:
    """Write the rows that have a mean for readers: labels, theory, and mean ± standard error."""
    rows = table[table["mean"].notna()]
    text = pd.DataFrame({name.replace("_", " "): [_label(value) for value in rows[name]] for name in labels})
    text["theory"] = ["" if np.isnan(value) else f"{value:{form}}" for value in rows["theory"]]
    pairs = zip(rows["mean"], rows["standard_error"], strict=True)
    return text.assign(
        simulation=[f"{mean:{form}}" + ("" if np.isnan(e) else f" ± {e:{form}}") for mean, e in pairs]
    )


def _label(value: Any) -> str:
    if isinstance(value, str):
        return value.replace("_", " ")
    return "" if np.isnan(value) else f"{value:g}"
