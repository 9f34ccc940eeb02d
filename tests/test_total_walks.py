"""The compiled walks of the total are the rules of one walk, to the last bit."""

import math
from collections import deque
from collections.abc import Iterator

import numpy as np
import pytest

from aimd_des.theory import totals
from aimd_des.theory.totals import Cuts, Levels, walk_by_crossings, walk_by_looks

WALKS, SIGNALS, SETTLING = 9, 14, 5

# Cuts that are skewed to either side, and not; one in which a signal may take all or nothing.
LAWS = [
    Cuts(0.05, 0.5, 0.6, 0.05, 0.95),
    Cuts(0.05, 0.5, -0.4, 0.0, 0.95),
    Cuts(0.3, 2.0, 0.0, 0.4, 0.5),
]


@pytest.fixture(autouse=True)
def _few_walks(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, size in (("_WALKS", WALKS), ("_SIGNALS", SIGNALS), ("_SETTLING", SETTLING), ("_BATCH", 7)):
        monkeypatch.setattr(totals, name, size)


class Takers:
    """What signals take in each walk: numbers are drawn for all walks at every step."""

    def __init__(self, law: Cuts) -> None:
        self.law, self.rng = law, np.random.default_rng(0)
        self.sway = self.rng.standard_normal(WALKS)

    def steps(self) -> Iterator[tuple[list[float], list[float]]]:
        law = self.law
        while True:
            if law.skewness == 0.0:
                standard = self.rng.standard_normal(WALKS)
            else:
                shape = 4.0 / law.skewness**2
                sign = math.copysign(1.0, law.skewness)
                standard = (self.rng.standard_gamma(shape, WALKS) - shape) * (sign / math.sqrt(shape))
            fresh = math.sqrt(1.0 - law.memory**2) * self.rng.standard_normal(WALKS)
            yield standard.tolist(), fresh.tolist()

    def left(self, limit: float, peak: float, walk: int, standard: float, fresh: float) -> float:
        law = self.law
        self.sway[walk] = law.memory * self.sway[walk] + fresh
        part = law.share * (1.0 + law.variation * standard + law.sway * self.sway[walk])
        return float(peak - (limit + peak) * min(max(part, 0.0), 1.0))


def looks(limit: float, law: Cuts, period: float, latency: float, lost: float | None) -> Levels:
    """Every walk for itself, look by look; pieces in the order of the looks, and of the walks at each."""
    takers = Takers(law)
    lag = math.ceil(latency / period) if lost is not None else max(math.ceil(latency / period) - 1, 0)
    offset = latency - lag * period if lost is None else 0.0
    levels = (-takers.rng.random(WALKS) * period).tolist()
    due = [deque([False] * lag) for _ in range(WALKS)]
    rows: list[list[tuple[float, float, float]]] = []
    found: list[list[float]] = []
    for (standard, fresh), _ in zip(takers.steps(), range((SIGNALS + SETTLING) * (2 + lag)), strict=False):
        first, second, peaks = [], [], []
        for walk, level in enumerate(levels):
            waits = level <= 0.0 and not any(due[walk])
            steps = math.floor(-level / period) + 1.0 if waits else 1.0
            due[walk].append(level > 0.0)
            acts = due[walk].popleft()
            peak = left = level + offset
            if acts:
                peaks.append(peak)
                left = takers.left(limit, peak, walk, standard[walk], fresh[walk])
            if lost is None:
                levels[walk] = left + (steps * period - offset)
                first.append((level, peak, peak - level))
                second.append((left, levels[walk], levels[walk] - left))
            else:
                levels[walk] = left + (lost if acts else steps)
                first.append((level, level + steps - 1.0, steps))
        rows.append(first + second)
        found.append(peaks)
    return gathered(rows, found, SETTLING * (2 + lag))


def crossings(limit: float, law: Cuts, hold_off: float, latency: float) -> Levels:
    """Every walk for itself, event by event."""
    takers = Takers(law)
    levels, times, free = (-takers.rng.random(WALKS)).tolist(), [0.0] * WALKS, [0.0] * WALKS
    coming: list[deque[float]] = [deque() for _ in range(WALKS)]
    rows: list[list[tuple[float, float, float]]] = []
    found: list[list[float]] = []
    for (standard, fresh), _ in zip(takers.steps(), range(2 * (SIGNALS + SETTLING)), strict=False):
        row, peaks = [], []
        for walk, level in enumerate(levels):
            leaves = max(free[walk], times[walk] + max(-level, 0.0))
            acts = bool(coming[walk]) and coming[walk][0] <= leaves
            now = coming[walk].popleft() if acts else leaves
            peak = level + (now - times[walk])
            row.append((level, peak, peak - level))
            levels[walk], times[walk] = peak, now
            if acts:
                peaks.append(peak)
                levels[walk] = takers.left(limit, peak, walk, standard[walk], fresh[walk])
            else:
                coming[walk].append(now + latency)
                free[walk] = now + hold_off
        rows.append(row)
        found.append(peaks)
    return gathered(rows, found, 2 * SETTLING)


def gathered(rows: list[list[tuple[float, float, float]]], found: list[list[float]], settled: int) -> Levels:
    bottom, top, duration = np.array([piece for row in rows[settled:] for piece in row]).T
    total = 0.0
    for peaks in found[settled:]:
        total += float(np.array(peaks).sum())
    return Levels(bottom, top, duration, total / sum(len(peaks) for peaks in found[settled:]))


def assert_same(ours: Levels, plain: Levels) -> None:
    for one, other in zip(ours, plain, strict=True):
        assert np.array_equal(one, other)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("period", "latency", "lost"),
    [(1.0, 0.0, None), (0.7, 0.3, None), (0.7, 2.5, None), (1.0, 0.0, 0.2), (1.0, 1.0, 0.0), (1.0, 3.0, 0.1)],
)
def test_walks_by_looks_are_those_of_one_after_the_other(
    law: Cuts, period: float, latency: float, lost: float | None
) -> None:
    assert_same(walk_by_looks(20.0, law, period, latency, lost), looks(20.0, law, period, latency, lost))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("hold_off", "latency"), [(1.0, 0.0), (1.0, 0.4), (0.3, 2.0)])
def test_walks_by_crossings_are_those_of_one_after_the_other(
    law: Cuts, hold_off: float, latency: float
) -> None:
    assert_same(walk_by_crossings(20.0, law, hold_off, latency), crossings(20.0, law, hold_off, latency))
