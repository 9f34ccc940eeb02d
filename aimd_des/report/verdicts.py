"""The numbers that matter, and what they say in words."""

from collections.abc import Mapping, Sequence
from math import isfinite

from aimd_des.report.headline import Headline, Settling, side
from aimd_des.report.html_page import Verdict
from aimd_des.results.measures import MEASURES
from aimd_des.scenario.run_folder import Number, StoredRun
from aimd_des.utils.formatting import grouped, percent

#: The three of the verdict, in its order, and what to know of each besides its meaning.
JUDGED = {
    "utilisation": "Demand swings below the capacity in a sawtooth, so even a run without fault"
    " does not use all of it.",
    "misallocation": "Half of it would have to change hands.",
    "overshoot_peak": "100 % is the capacity itself. What is above comes of signals that are late or lost.",
}
_MOST_NAMES = 3
# From here on a cost is so many times another one, and not so many percent above it.
_TIMES = 2.0


def run_verdicts(run: StoredRun, found: Headline, settling: Settling) -> list[Verdict]:
    """Say the three numbers of each resource, of a run that never reached its capacity the peak alone."""
    words = {
        "utilisation": _cost(run.measures) if found.judged else "",
        "misallocation": _expected(settling) if found.judged else "",
        "overshoot_peak": _above(run.measures) if found.reached else "The capacity was never reached.",
    }
    names = list(JUDGED) if found.reached else ["overshoot_peak"]
    cards = [_card(name, run.measures, words[name]) for name in names]
    return [card for card in cards if card is not None]


def _card(name: str, rows: Mapping[str, Mapping[str, Number]], words: str) -> Verdict | None:
    values = {of: float(row[name]) for of, row in rows.items()}
    known = {of: value for of, value in values.items() if isfinite(value)}
    if not known:
        return None
    numbers = [(percent(value), of) for of, value in known.items()]
    if len(known) > _MOST_NAMES:
        low, high = min(known, key=known.__getitem__), max(known, key=known.__getitem__)
        numbers = [
            (percent(known[low]), f"{low}, the lowest"),
            (percent(known[high]), f"{high}, the highest"),
        ]
    return card(name, numbers, words)


def card(name: str, numbers: Sequence[tuple[str, str]], words: str) -> Verdict:
    """Make the card of a measure."""
    measure = MEASURES[name]
    return Verdict(measure.title, numbers, words, f"{measure.meaning} {JUDGED.get(name, '')}".strip())


def _cost(rows: Mapping[str, Mapping[str, Number]]) -> str:
    cost = float(next(iter(rows.values()))["cost_ratio"])
    if not isfinite(cost):
        return ""
    far = side(cost) if cost < _TIMES else f"{grouped(cost, 3)} times"
    return f"The total cost is {far} that of the optimum for all of the capacity."


def _expected(settling: Settling) -> str:
    if not settling.band:
        return ""
    bands = [f"{of} {percent(low, 2)} to {percent(high, 2)}" for of, (low, high) in settling.band.items()]
    return f"Theory expects 95 % of runs in: {', '.join(bands[:_MOST_NAMES])}."


def _above(rows: Mapping[str, Mapping[str, Number]]) -> str:
    """Say for how long, and by how much, demand was above the capacity."""
    parts = []
    for of, row in rows.items():
        if row["overshoot_time"] > 0.0:
            mean = percent(row["overshoot_mean"] / row["overshoot_time"], 2)
            parts.append(f"{of} {percent(row['overshoot_time'], 2)} of the time, then by {mean} in the mean")
    if not parts:
        return "Demand never exceeded the capacity."
    return f"Above the capacity: {'; '.join(parts[:_MOST_NAMES])}."
