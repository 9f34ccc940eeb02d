"""Statistics over the runs of a study, as tidy frames: a row for each point, resource and measure."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype

from aimd_des.results.measures import MEASURES
from aimd_des.study.columns import LABELS
from aimd_des.study.statistics.intervals import quantile
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray

_PAIR = "replication"
_AT_BASELINE = " at the baseline"


def summarise(
    frame: pd.DataFrame,
    by: str | Sequence[str] | None = None,
    measures: str | Sequence[str] | None = None,
    confidence: float = 0.95,
    *,
    draws: str | None = None,
) -> pd.DataFrame:
    """Estimate the mean of every measure at every point.

    Parameters
    ----------
    frame : DataFrame
        A row for each run and resource, such as `StudyResults.runs`.
    by : str or sequence of str, optional
        Columns that make a point, so that each replication has one row there; default: all that are neither a
        measure nor the name of a run.
    measures : str or sequence of str, optional
        Columns to estimate; default: those of `Result.summary` that are there.
    confidence : float
        Between 0 and 1.
    draws : str, optional
        Column that says which draw of a random problem, or network, a run belongs to.  Then the mean is that
        of draws, each counted once however many replications it has, and its error what their scatter makes.

    Returns
    -------
    DataFrame
        The columns of `by`, then measure, mean, standard_error, low, high, replications; by Student's t.
        Runs without a number for a measure do not count for it: look at `replications` before you compare.
        With `draws` three more: spread, the standard deviation of draws' means; within, the standard error of
        one draw's mean, as replications have it (NaN where no draw has two); and draws, their number.

    Raises
    ------
    InputError
        If there is no such column, a measure holds no numbers, or the confidence is not between 0 and 1.
        If a replication has several rows at a point: they share random numbers, and would count as
        independent.
    """
    columns = _columns(frame, measures)
    if draws is None:
        points = _points(frame, by, columns)
        if _PAIR in frame.columns:
            _one_row_each(frame, points, _PAIR, columns)
        return _summary(frame, points, columns, confidence)
    validation.known("draws", draws, list(frame.columns))
    points = [name for name in _points(frame, by, columns) if name != draws]
    if _PAIR in frame.columns:
        _one_row_each(frame, [*points, draws], _PAIR, columns)
    return _summary_of_draws(frame, points, columns, confidence, draws)


def means_by_point(
    table: pd.DataFrame, points: Sequence[str]
) -> Iterator[tuple[list[Any], int, dict[str, tuple[float, float]]]]:
    """Yield each point of a summary: labels, replications, and mean and half-width of each measure."""
    found: dict[tuple[Any, ...], tuple[int, dict[str, tuple[float, float]]]] = {}
    columns = (table["measure"], table["mean"], (table["high"] - table["low"]) / 2.0, table["replications"])
    labels = table[list(points)].itertuples(index=False, name=None)
    for at, measure, mean, half_width, count in zip(labels, *map(pd.Series.tolist, columns), strict=True):
        most, means = found.get(at, (0, {}))
        found[at] = max(most, count), {**means, measure: (mean, half_width)}
    for at, (most, means) in found.items():
        yield list(at), most, means


def whole_replications(runs: pd.DataFrame, points: Sequence[str], measures: Sequence[str]) -> pd.DataFrame:
    """Take one number of each replication: runs of one replication may have the same seed."""
    groups = runs.groupby([*points, "replication"], observed=True, sort=False)
    sizes = groups.size()
    return groups[list(measures)].mean()[sizes == sizes.max()].reset_index()


def _summary(frame: pd.DataFrame, points: list[str], columns: list[str], confidence: float) -> pd.DataFrame:
    groups = frame.groupby(points, observed=True, sort=False, dropna=False)[columns] if points else None
    if groups is None:
        found = {name: frame[columns].agg(name).to_frame().T for name in ("mean", "std", "count")}
    else:
        found = {"mean": groups.mean(), "std": groups.std(), "count": groups.count()}
    long = {name: part.stack(future_stack=True) for name, part in found.items()}  # noqa: PD013 - measures in order
    table = pd.DataFrame(
        {
            "mean": long["mean"],
            "standard_error": long["std"] / np.sqrt(long["count"].clip(lower=1)),
            "replications": long["count"].astype(np.int64),
        }
    )
    return _with_ends(table, points, confidence)


def _summary_of_draws(
    frame: pd.DataFrame, points: list[str], columns: list[str], confidence: float, draws: str
) -> pd.DataFrame:
    # Draws are the replications now: each counts by its mean, in the order of the frame.
    single = _summary(frame, [*points, draws], columns, confidence)
    single["variance"] = single["standard_error"] ** 2
    groups = single.groupby([*points, "measure"], observed=True, sort=False, dropna=False)
    found = groups.agg(
        mean=("mean", "mean"),
        spread=("mean", "std"),
        within=("variance", "mean"),
        draws=("mean", "count"),
        replications=("replications", "sum"),
    )
    found["standard_error"] = found["spread"] / np.sqrt(found["draws"].clip(lower=1))
    off = _reach(confidence, found["draws"], found["standard_error"])
    found = found.assign(low=found["mean"] - off, high=found["mean"] + off, within=np.sqrt(found["within"]))
    table = found.reset_index()
    order = ["mean", "standard_error", "low", "high", "replications", "spread", "within", "draws"]
    return table[[*points, "measure", *order]]


def compare(
    frame: pd.DataFrame,
    baseline: Mapping[str, Any],
    by: str | Sequence[str] | None = None,
    measures: str | Sequence[str] | None = None,
    confidence: float = 0.95,
    *,
    pair: str = _PAIR,
) -> pd.DataFrame:
    """Estimate how much every measure differs from a baseline point, replication by replication.

    Parameters
    ----------
    frame : DataFrame
        A row for each run and resource.
    baseline : mapping
        Values of axes that name the point of reference, such as ``{"loss": 0.0}``. Points are compared
        with those that agree with them in all other columns of `by`.
    by, measures, confidence
        As for `summarise`.
    pair : str
        The column in which runs with the same random numbers agree.

    Returns
    -------
    DataFrame
        As `summarise` gives it, for the differences to the baseline.  Its own rows are left out, and so is
        what has no partner there; `replications` counts pairs.

    Raises
    ------
    InputError
        As `summarise` does; and if there is no such point, or nothing has a partner there.

    Notes
    -----
    With the same random numbers at all points (``paired = true``, the default), the random error that a
    replication has at both cancels, and intervals are the narrower for it.
    """
    columns = _columns(frame, measures)
    validation.known("pair", pair, list(frame.columns))
    if not isinstance(baseline, Mapping):
        raise InputError.of("baseline", baseline, "a mapping of axes to values, such as {'loss': 0.0}")
    points = [name for name in _points(frame, by, columns) if name != pair]
    for name in baseline:
        validation.known("baseline", name, points)
    _one_row_each(frame, points, pair, columns)
    is_base = np.ones(len(frame), dtype=bool)
    for name, value in baseline.items():
        is_base &= (frame[name] == value).to_numpy()
    if not is_base.any():
        raise InputError.of("baseline", dict(baseline), "a point of the study", "see its axes for the values")
    matched = [*(name for name in points if name not in baseline), pair]
    reference = frame.loc[is_base, [*matched, *columns]]
    others = frame.loc[~is_base, [*points, pair, *columns]]
    both = others.merge(reference, on=matched, suffixes=("", _AT_BASELINE))
    if both.empty and not others.empty:
        allowed = f"a point that agrees with others in {matched}"
        raise InputError.of("baseline", dict(baseline), allowed, "name all axes that differ from it")
    differences = both[[*points, pair]].copy()
    for name in columns:
        differences[name] = both[name].astype(np.float64) - both[f"{name}{_AT_BASELINE}"]
    return _summary(differences, points, columns, confidence)


def _reach(confidence: float, count: pd.Series, error: pd.Series) -> FloatArray:
    """Compute half the width of the intervals of means of so many values; infinite for one."""
    reach = quantile(confidence, count.to_numpy() - 1)
    return np.where(np.isinf(reach), np.inf, reach * error.to_numpy())


def _with_ends(table: pd.DataFrame, points: list[str], confidence: float) -> pd.DataFrame:
    off = _reach(confidence, table["replications"], table["standard_error"])
    table.insert(2, "low", table["mean"] - off)
    table.insert(3, "high", table["mean"] + off)
    table.index = table.index.set_names([*points, "measure"] if points else [None, "measure"])
    flat = table.reset_index()
    return flat if points else flat.drop(columns=flat.columns[0])


def _points(frame: pd.DataFrame, by: str | Sequence[str] | None, columns: list[str]) -> list[str]:
    """Take the columns that make a point: by default the axes, and the resource."""
    if by is None:
        others = {*LABELS, *MEASURES, *columns} - {"resource"}
        return [name for name in frame.columns if name not in others]
    by = one_or_more(by)
    for name in by:
        validation.known("by", name, list(frame.columns))
    return by


def one_or_more(names: str | Sequence[str]) -> list[str]:
    """Take a name on its own for a list of it, and not for one of letters."""
    return [names] if isinstance(names, str) else list(names)


def _columns(frame: pd.DataFrame, measures: str | Sequence[str] | None) -> list[str]:
    if measures is None:
        names = [name for name in frame.columns if name in MEASURES]
    else:
        names = one_or_more(measures)
    if not names:
        raise InputError.of("measures", names, f"some of {', '.join(map(str, frame.columns))}")
    for name in names:
        validation.known("measures", name, list(frame.columns))
        if not is_numeric_dtype(frame[name]):
            raise InputError.of("measures", name, "a column of numbers")
    return names


def _one_row_each(frame: pd.DataFrame, points: list[str], pair: str, columns: list[str]) -> None:
    """Refuse points at which a replication has several rows: they are no independent replications."""
    if frame.duplicated([*points, pair]).any():
        rest = [name for name in _points(frame, None, columns) if name not in {*points, pair}]
        raise InputError.of(
            "by", points, f"columns that leave one row for each {pair}", f"add some of {rest}, or choose rows"
        )
