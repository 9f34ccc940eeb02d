"""Two studies, point by point: how much means differ, and how well that is known."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from aimd_des.cli.differences import HEADS, differences, print_differences
from aimd_des.cli.studies import chosen_measures
from aimd_des.cli.tables import interval, plus_minus, print_pairs, print_table
from aimd_des.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from aimd_des.study import Interval, StudyResults

__all__ = ["compare_studies"]


def compare_studies(first: Path, second: Path, measures: Sequence[str] = ()) -> None:
    """Print in which keys two studies differ, and the differences of means at the points that both have.

    Parameters
    ----------
    first, second : Path
        The folders.
    measures : sequence of str
        Which; the main ones unless given.

    Raises
    ------
    InputError
        If they have no point in common, or one does not keep a measure.
    """
    from aimd_des.study import load_study

    one, other = load_study(first), load_study(second)
    kept = chosen_measures(other.study, measures)
    names = [name for name in chosen_measures(one.study, measures) if name in kept]
    axes = _shared_axes(one, other)
    points = [*axes, "resource"]
    groups = (_by_point(one.runs, points), _by_point(other.runs, points))
    rows = list(_rows(*groups, names))
    if not rows:
        own = " and ".join(f"{len(group):,} in {folder}" for group, folder in zip(groups, HEADS, strict=True))
        raise InputError(f"{first} and {second}: no point with runs is in both (points and resources: {own})")
    print_pairs("Two studies", [(HEADS[0], str(first)), (HEADS[1], str(second))])
    click.echo()
    print_differences(differences(one.study.spoken(), other.study.spoken()), "The studies are the same.")
    click.echo()
    columns = [*points, "measure", *HEADS, f"difference {plus_minus()} half-width", "interval"]
    print_table("Second less first, with 95 % confidence intervals", columns, rows, labels=len(points) + 1)
    _print_unmatched(groups)


def _shared_axes(one: "StudyResults", other: "StudyResults") -> list[str]:
    """Take the axes that both have; one that only one has may have one value only."""
    axes = [{axis.name: len(axis.settings()) for axis in results.study.axes} for results in (one, other)]
    for own, its, results in ((axes[0], axes[1], one), (axes[1], axes[0], other)):
        for name, count in own.items():
            if name not in its and count > 1:
                raise InputError(
                    f"axis {name!r}: only {results.folder} has it, with {count} values, so that points match"
                    f" none of the other's, whose axes are {list(its)}"
                )
    return [name for name in axes[0] if name in axes[1]]


def _by_point(runs: "pd.DataFrame", points: list[str]) -> dict[tuple[Any, ...], "pd.DataFrame"]:
    groups = runs.groupby(points, observed=True, sort=False)
    return {tuple(labels): part.set_index("seed") for labels, part in groups}


def _rows(
    first: dict[tuple[Any, ...], "pd.DataFrame"],
    second: dict[tuple[Any, ...], "pd.DataFrame"],
    names: Sequence[str],
) -> Iterator[list[Any]]:
    """Compare at each point that both have."""
    import numpy as np

    for labels, one in first.items():
        if (other := second.get(labels)) is None:
            continue
        for name in names:
            values, others = (part[name][np.isfinite(part[name])] for part in (one, other))
            found, how = _difference(values, others)
            means = (float(values.mean()), float(others.mean()))
            shown = "" if found is None else interval(found.mean, found.half_width)
            yield [*map(str, labels), name.replace("_", " "), *means, shown, how]


def _difference(one: "pd.Series[float]", other: "pd.Series[float]") -> "tuple[Interval | None, str]":
    """Pair runs with equal seeds; without such runs, take both samples as independent."""
    from aimd_des.study import difference, paired_difference

    shared = one.index.intersection(other.index)
    if len(shared):
        how = "1 pair" if len(shared) == 1 else f"{len(shared)} pairs"
        return paired_difference(other[shared], one[shared]), how
    if len(one) == 0 or len(other) == 0:
        return None, "no values"
    return difference(other, one), f"Welch, {len(one)} and {len(other)}"


def _print_unmatched(groups: Sequence[dict[tuple[Any, ...], "pd.DataFrame"]]) -> None:
    """Say what is only in one of them."""
    for own, its, word in ((groups[0], groups[1], HEADS[0]), (groups[1], groups[0], HEADS[1])):
        alone = [", ".join(map(str, labels)) for labels in own if labels not in its]
        if alone:
            more = f"; and {len(alone) - 5} more" if len(alone) > 5 else ""
            click.echo(f"Only in the {word}: {'; '.join(alone[:5])}{more}")
