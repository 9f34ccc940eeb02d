"""One point of a map: how far a latency or a loss may rise before demand or shares are off by too much."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Literal, NamedTuple

import pandas as pd
from matplotlib.axes import Axes
from scipy.optimize import brentq

from aimd_des import BroadcastChannel
from scenarios.common import figures
from scenarios.common.measure import distance, late, run_late
from scenarios.common.systems import lowered, memory_alone
from scenarios.common.tables import pick

#: What is usable: at most this share of the time above the capacity, and this distance from the optimum.
MOST = {"above": 0.01, "misallocation": 0.05}
# Where an edge is looked for first, as a part of the range.
_FIRST = 0.125
#: Rows of the table: how far each of the limits is kept, and both.
BOTH = "both"


class Setting(NamedTuple):
    """Memory of the paper's system by itself, with continuous cameras."""

    hold_off: float
    threshold: float = 1.0
    latency: float = 0.0
    loss: float = 0.0


class Case(NamedTuple):
    """What rises, and in which setting."""

    rises: Literal["latency", "loss"]
    most: float  # up to where it is looked for
    exact: float  # how exactly it is located
    setting: Setting
    until: float  # length of a run, of which the first fifth is cut off
    draws: int = 10  # of the costs


class Seen(NamedTuple):
    """How far each limit is kept: 0 where it never is, and `most` where it always is."""

    above: float
    misallocation: float

    @property
    def both(self) -> float:
        """How far both are kept."""
        return min(self)


@dataclass(frozen=True)
class Map:
    """A map: its cases, what theory has for each, and what is made of the table."""

    name: str  # what rises
    cases: Callable[[bool], Sequence[Case]]  # of the quick size, or of the full one
    expected: Callable[[Case], Seen]
    draw: Callable[[Sequence[Axes], pd.DataFrame], None]  # two panels
    findings: Callable[[pd.DataFrame], list[str]]


def search(case: Case, draw: int, seed: int) -> Seen:
    """Locate where each limit is passed, in runs that share their seed."""
    measured = cache(partial(_measure, case, draw, seed))
    return Seen(*(_edge(case, partial(_beyond, measured, name)) for name in MOST))


def _beyond(measured: Callable[[float], dict[str, float]], name: str, value: float) -> float:
    return measured(value)[name] - MOST[name]


def _edge(case: Case, beyond: Callable[[float], float]) -> float:
    if beyond(0.0) > 0.0:
        return 0.0
    # What lies far beyond takes most signals, and so most time: it is looked at last.
    low, high = 0.0, _FIRST * case.most
    while beyond(high) <= 0.0:
        if high == case.most:
            return case.most
        low, high = high, min(2.0 * high, case.most)
    return float(brentq(beyond, low, high, xtol=case.exact))


def _measure(case: Case, draw: int, seed: int, value: float) -> dict[str, float]:
    setting = case.setting._replace(**{case.rises: value})
    problem = lowered(memory_alone(draw=draw), setting.threshold)
    channel = BroadcastChannel(latency=setting.latency, loss=setting.loss)
    span = (0.2 * case.until, case.until)
    seen = late(run_late(problem, setting.hold_off, channel, span, seed, "end"), span[0])
    return {"above": seen.time_above, "misallocation": float(distance(problem, seen.average)[0])}


def draw_edges(axes: Axes, table: pd.DataFrame, measure: str, longer: str) -> None:
    """Draw how far a limit is kept, over hold-offs: each threshold beside theory, and longer runs."""
    short = pick(table, measure=measure, until=table["until"].min())
    for place, threshold in enumerate(thresholds(table)):
        rows = pick(short, threshold=threshold)
        figures.points(axes, rows["hold_off"], rows, place, f"threshold {threshold:g}")
        figures.theory(axes, rows["hold_off"], rows, place)
    rows = pick(table, measure=measure, until=table["until"].max())
    axes.plot(rows["hold_off"], rows["mean"], "x", color="black", label=f"{longer}, runs longer")
    figures.named(axes, "theory")


def thresholds(table: pd.DataFrame) -> list[float]:
    """List the thresholds of a map, the highest first."""
    return sorted(table["threshold"].unique(), reverse=True)
