"""What is observed in compiled code: totals, and overshoot, which wants answers in the order of time."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.engine.observers import fold_change, keep_line, line_of
from aimd_des.fleet.arrays import LAST, Answers
from aimd_des.fleet.radix_heap import time_of
from aimd_des.utils.jit import deferred, formula, kernel
from aimd_des.utils.records import record
from aimd_des.utils.validation import FloatArray

IntArray = npt.NDArray[np.int64]

# So few answers are sorted by counting, for each, those before it: all against all, without a branch.
_COUNTED = 64

# Comparisons that are made side by side, of which there must be no remainder: it would take as long.
_BLOCK = 32

# Runs of this length are sorted by insertion before they are merged, which is faster for so few.
_SHORT = 16

# How many moves are left for each answer once all are roughly in order: many more take longer than to merge.
_MOVES = 8


@record
class FleetOvershoot(NamedTuple):
    """What total demand beyond capacity is integrated with."""

    # Whether demand is measured as a line between answers, or as constant between common ticks.
    lines: bool
    steps: bool
    # (m,): C, and growth of the total in units of the resource per unit of time.
    capacity: FloatArray
    slope: FloatArray
    running: FloatArray  # (m, 6): of lines: as in `observers.LinearPieces`
    # Of steps: as in `observers.ConstantPieces`; (m,) each, `measured` (1,).
    peak: FloatArray
    above: FloatArray
    excess: FloatArray
    used: FloatArray
    measured: FloatArray
    tick: IntArray  # (1,): of steps: index of the next tick that closes an interval
    # (a,): working memory of sorting.
    order: IntArray
    spare: IntArray


@record
class ObservedTotals(NamedTuple):
    """Where totals are kept, as in `observers.Observer`."""

    times: FloatArray  # (q,): when; ascending
    # (q, m): receive the sums.
    demand: FloatArray
    average: FloatArray
    row: IntArray  # (1,): index of the next; those before are kept, or waiting
    taken: IntArray  # (m,): index of the next of each resource, of those that wait
    values: FloatArray  # working memory of `observe_totals`


@formula
def _before(answers: Answers, one: int, other: int) -> bool:
    # Times as their bits, which are in the same order; at one instant copies are answered as they land.
    if answers.key[one] == answers.key[other]:
        return bool(answers.rank[one] < answers.rank[other])
    return bool(answers.key[one] < answers.key[other])


@formula
def _spread(answers: Answers, order: IntArray, spare: IntArray) -> None:
    """Put answers roughly in the order of time: into intervals of equal length, as many as answers."""
    count, earliest, latest = answers.held[0], answers.key[0], answers.key[0]
    for row in range(count):
        earliest, latest = min(earliest, answers.key[row]), max(latest, answers.key[row])
    begin, length = time_of(earliest), time_of(latest) - time_of(earliest)
    # Below 1, so that the latest falls into the last interval.
    scale = (1.0 - 1e-9) * count / length if length > 0.0 else 0.0
    for place in range(count):
        spare[place] = 0
    for row in range(count):
        interval = int((time_of(answers.key[row]) - begin) * scale)
        answers.interval[row] = interval
        spare[interval] += 1
    first = 0
    for place in range(count):
        held = spare[place]
        spare[place] = first
        first += held
    for row in range(count):
        interval = answers.interval[row]
        order[spare[interval]] = row
        spare[interval] += 1


@formula
def _insert(answers: Answers, order: IntArray, low: int, high: int, moves: int) -> bool:
    """Sort a run that is short or nearly sorted; tell whether that has taken no more moves than allowed."""
    for end in range(low + 1, high):
        row, place = order[end], end
        while place > low and _before(answers, row, order[place - 1]):
            order[place] = order[place - 1]
            place -= 1
        order[place] = row
        moves -= end - place
        if moves < 0:
            return False
    return True


@formula
def _count(answers: Answers, order: IntArray) -> bool:
    """Sort few answers, if there is room behind them and no two are of one instant; tell whether it is so."""
    count, key = answers.held[0], answers.key
    end = -(-count // _BLOCK) * _BLOCK
    if end > key.shape[0]:
        return False
    for row in range(count, end):
        key[row] = LAST
    for place in range(count):
        order[place] = -1
    for row in range(count):
        own, place = key[row], 0
        for other in range(end):
            place += key[other] < own
        if order[place] >= 0:
            return False
        order[place] = row
    return True


@formula
def _merge(answers: Answers, source: IntArray, low: int, middle: int, high: int, target: IntArray) -> None:
    """Merge two sorted runs."""
    one, other = low, middle
    for place in range(low, high):
        if one < middle and (other >= high or not _before(answers, source[other], source[one])):
            target[place] = source[one]
            one += 1
        else:
            target[place] = source[other]
            other += 1


@deferred
def _sort_many(answers: Answers, order: IntArray, spare: IntArray) -> None:
    """Sort any number of answers, at any times."""
    # Not NumPy's sort: it would allocate, which compiled code here cannot do.
    count = answers.held[0]
    for row in range(count):
        order[row] = row
    if count > _SHORT:
        # Times between two looks are spread well enough, mostly, that few are not in their place then.
        _spread(answers, order, spare)
        if _insert(answers, order, 0, count, _MOVES * count):
            return
    # A merge sort, which is fast for all times.
    for low in range(0, count, _SHORT):
        _insert(answers, order, low, min(low + _SHORT, count), _SHORT * _SHORT)
    width = _SHORT
    while width < count:
        for low in range(0, count, 2 * width):
            middle = min(low + width, count)
            _merge(answers, order, low, middle, min(low + 2 * width, count), spare)
        for place in range(count):
            order[place] = spare[place]
        width *= 2


@kernel
def _sort(answers: Answers, order: IntArray, spare: IntArray) -> None:
    """Put answers in the order of events, into `order`."""
    # Small fleets never have many, so the others' way is not even compiled for them.
    if answers.held[0] > _COUNTED or not _count(answers, order):
        _sort_many(answers, order, spare)


@deferred
def fold_answers(answers: Answers, integrals: FleetOvershoot) -> None:
    """Fold the answers in memory into the integrals, and forget them."""
    # Agents were answered in the order of chains, but the total is a line from each answer to the next.
    # Since the last time only later ones have come, so what is folded in need not be opened again.
    _sort(answers, integrals.order, integrals.spare)
    j = answers.resource[0]
    line = line_of(integrals.running, j)
    for place in range(answers.held[0]):
        row = integrals.order[place]
        if answers.resource[row] != j:
            keep_line(line, integrals.running, j)
            j = answers.resource[row]
            line = line_of(integrals.running, j)
        time, change = time_of(answers.key[row]), answers.change[row]
        line = fold_change(line, time, change, integrals.slope[j], integrals.capacity[j])
    keep_line(line, integrals.running, j)
    answers.held[0] = 0
