"""The axes of a study as charts have them: where positions stand, and what they are called."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import pandas as pd

from aimd_des.study import StudyResults
from aimd_des.utils.formatting import short

# A logarithmic axis begins to pay where the largest value is so many times the smallest.
_SPREAD = 20.0


class Along(NamedTuple):
    """An axis of the study; axes that vary together are one."""

    name: str  # for people
    labels: tuple[str, ...]  # what positions are called
    places: tuple[float, ...]  # where they stand: values, their logarithms, or the numbers of words
    joined: bool  # whether there is something between two positions
    log: bool = False  # whether places are logarithms
    columns: tuple[str, ...] = ()  # of the frames of the study
    positions: tuple[tuple[Any, ...], ...] = ()  # the values of the columns

    def place(self, value: float) -> float:
        """Say where a number between positions stands."""
        return math.log10(value) if self.log else value

    @property
    def edges(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Give the lower and the upper ends of cells around the positions."""
        # Positions need not be in order.
        order = sorted(range(len(self.places)), key=self.places.__getitem__)
        sorted_places = [self.places[k] for k in order]
        middles = [0.5 * (low + high) for low, high in pairwise(sorted_places)]
        first, last = sorted_places[0], sorted_places[-1]
        low = [2.0 * first - middles[0], *middles] if middles else [first - 0.5]
        high = [*middles, 2.0 * last - middles[-1]] if middles else [first + 0.5]
        lows, highs = [0.0] * len(order), [0.0] * len(order)
        for rank, k in enumerate(order):
            lows[k], highs[k] = low[rank], high[rank]
        return tuple(lows), tuple(highs)


def axes_of(results: StudyResults) -> list[Along]:
    """List the axes that can be moved along, the longest first: it is what charts run along."""
    groups: dict[str, list[Any]] = {}
    for number, axis in enumerate(results.study.axes):
        groups.setdefault(axis.zip or f"\0{number}", []).append(axis)
    found = []
    for group in groups.values():
        columns = tuple(axis.name for axis in group)
        positions = tuple(zip(*([value for value, _ in axis.settings()] for axis in group), strict=True))
        if len(positions) > 1:
            found.append(_along(columns, positions))
    return sorted(found, key=lambda one: -len(one.positions))


def _along(columns: tuple[str, ...], positions: tuple[tuple[Any, ...], ...]) -> Along:
    labels = tuple(", ".join(map(short, one)) for one in positions)
    values = [one[0] for one in positions]
    numbers = len(columns) == 1 and all(
        isinstance(value, int | float) and not isinstance(value, bool) for value in values
    )
    name = ", ".join(columns)
    if not numbers:
        places = tuple(float(k) for k in range(len(positions)))
        return Along(name, labels, places, joined=False, columns=columns, positions=positions)
    log = _logarithmic(values)
    places = tuple(math.log10(value) if log else float(value) for value in values)
    return Along(name, labels, places, joined=True, log=log, columns=columns, positions=positions)


def _logarithmic(values: Sequence[float]) -> bool:
    """Tell whether values are spread over decades, at steps that grow."""
    ordered = sorted(values)
    if ordered[0] <= 0.0 or ordered[-1] < _SPREAD * ordered[0] or len(ordered) < 3:
        return False
    return ordered[-1] - ordered[-2] > 3.0 * (ordered[1] - ordered[0])


def placed(table: pd.DataFrame, axes: Sequence[Along]) -> pd.DataFrame:
    """Give rows their position along each axis, in columns i0, i1 and so on."""
    found = pd.DataFrame(index=table.index)
    for number, axis in enumerate(axes):
        place = {position: k for k, position in enumerate(axis.positions)}
        rows = table[list(axis.columns)].itertuples(index=False, name=None)
        found[f"i{number}"] = [place[row] for row in rows]
    return found.assign(resource=table["resource"].astype(str))
