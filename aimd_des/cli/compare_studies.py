"""Two studies, point by point: how much means differ, and how well that is known."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aimd_des.cli.printing import say
from aimd_des.cli.scenario_diff import HEADS, differences, print_differences
from aimd_des.cli.study_tables import chosen_measures
from aimd_des.cli.terminal_tables import plus_minus, plus_or_minus, print_pairs, print_table
from aimd_des.utils.errors import InputError
from aimd_des.utils.formatting import given

if TYPE_CHECKING:
    import pandas as pd

    from aimd_des.study import StudyResults

_MOST_POINTS = 5


def compare_studies(first: Path, second: Path, measures: Sequence[str]) -> None:
    """Print in which keys two studies differ, and the differences of means at the points that both have."""
    from aimd_des.results.measures import measure_words
    from aimd_des.study import load_study

    one, other = load_study(first), load_study(second)
    kept = chosen_measures(other.study.columns(), measures)
    names = [name for name in chosen_measures(one.study.columns(), measures) if name in kept]
    axes = _shared_axes(one, other)
    points = [*axes, "resource"]
    groups = (_by_point(one.runs, points), _by_point(other.runs, points))
    shared = [labels for labels in groups[0] if labels in groups[1]]
    if not shared:
        raise InputError(f"{first} and {second}: no point at which there are runs is in both")
    print_pairs("Two studies", [(HEADS[0], str(first)), (HEADS[1], str(second))])
    say()
    print_differences(differences(one.study.spoken(), other.study.spoken()), "The studies are the same.")
    say()
    say(f"Second less first {plus_minus()} half-widths of 95 % confidence intervals")
    for name in names:
        rows = [[*labels, *_difference(*(group[labels][name] for group in groups))] for labels in shared]
        say()
        print_table(measure_words(name), [*points, *HEADS, "difference", "from"], rows, labels=len(points))
    _print_unmatched(groups, axes)


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


def _difference(first: "pd.Series[float]", second: "pd.Series[float]") -> list[Any]:
    """Give both means, their difference, and what it comes from.

    Runs with equal seeds are paired; without such runs, both samples are taken as independent.
    """
    import numpy as np

    from aimd_des.study import difference, paired_difference

    one, other = (values[np.isfinite(values)] for values in (first, second))
    shared = one.index.intersection(other.index)
    if len(shared):
        one, other = one[shared], other[shared]
        found, how = paired_difference(other, one), f"pairs: {len(shared)}"
    elif len(one) and len(other):
        found, how = difference(other, one), f"Welch: {len(one)}, {len(other)}"
    else:
        found, how = None, "no values"
    means = [float(one.mean()), float(other.mean())]
    return [*means, "" if found is None else plus_or_minus(found.mean, found.half_width), how]


def _print_unmatched(groups: Sequence[Mapping[tuple[Any, ...], "pd.DataFrame"]], axes: list[str]) -> None:
    """Say which points are only in one of them."""
    for own, its, word in ((groups[0], groups[1], HEADS[0]), (groups[1], groups[0], HEADS[1])):
        alone = list(dict.fromkeys(_point(labels, axes) for labels in own if labels not in its))
        if alone:
            more = f"; and {len(alone) - _MOST_POINTS} more" if len(alone) > _MOST_POINTS else ""
            say(f"\nOnly in the {word}: {'; '.join(alone[:_MOST_POINTS])}{more}")


def _point(labels: Sequence[Any], axes: Sequence[str]) -> str:
    """Name a point by its axes; where there are none, by the resource."""
    return ", ".join(
        f"{name} {given(value)}" for name, value in zip(axes or ["resource"], labels, strict=False)
    )
