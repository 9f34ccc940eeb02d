"""What a run came to, in the sentence that its page begins with.

A run that cannot be judged says so first, and then nothing is judged: demand that never reached the capacity,
signals that were never sent or never arrived, answers that are cut off, averages that have not settled.
"""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import NamedTuple

from aimd_des.scenario.run_folder import Number, StoredRun
from aimd_des.utils.formatting import grouped, percent

# Of all responses: below it, cutting off answers changes nothing that could be seen.
_SATURATED = 0.01
# What counts as not settled: by theory, this part of the slowest deviation is left; where theory is silent,
# the averages have moved by this part of the capacity since half time, or signals were as few as this.
_LEFT, _MOVED, _FEW = 0.1, 0.02, 10
# With few signals and demand above the capacity for so much of the time, signals are what is missing.
_MOSTLY = 0.7
_MOST_NAMES = 3

Rows = Mapping[str, Mapping[str, Number]]


class Headline(NamedTuple):
    """The first words of a page."""

    sentence: str  # what the run came to
    more: str  # what else to know, or empty
    judged: bool  # whether use and shares mean something
    reached: bool = True  # whether total demand reached a capacity


class Settling(NamedTuple):
    """What tells whether averages have settled."""

    moved: Mapping[str, float]  # how far sums of averages have gone since half time, over the capacity
    band: Mapping[str, tuple[float, float]]  # in which theory expects 95 % of misallocations


def headline(run: StoredRun, settling: Settling) -> Headline:
    """Say what a run came to."""
    rows = run.measures
    for cause in (_run_away, _never_reached, _without_signal, _saturated, _unsettled):
        if found := cause(run, settling):
            return found
    missing = [name for name, row in rows.items() if not isfinite(row["utilisation"])]
    if missing:
        return Headline("No agent is here at the end of the run.", "", judged=False)
    return Headline(_held(rows, settling.band), _peaks(rows), judged=True)


def _never_reached(run: StoredRun, _settling: Settling) -> Headline | None:
    rows = run.measures
    never = [name for name, row in rows.items() if not row["signals"] and row["overshoot_peak"] < 1.0]
    if not never:
        return None
    peaks = _each({name: percent(rows[name]["overshoot_peak"]) for name in never}, "of")
    until = float(run.scenario["until"])
    if len(never) < len(rows):
        sentence = f"Demand for {_listed(never)} never reached its capacity: it peaked at {peaks}."
        others = _peaks({name: rows[name] for name in rows if name not in never})
        more = f"No signal was sent for it, so nothing is said of its use and shares. {others}"
        return Headline(sentence, more, judged=False)
    sentence = (
        f"Demand never reached the capacity in {grouped(until)} units of time: it peaked at {peaks}. No"
        " signal was sent, so the run says nothing of use and shares."
    )
    slowest = min(row["overshoot_peak"] for row in rows.values())
    more = ""
    if slowest > 0.0 and not run.scenario.get("interventions"):
        more = (
            f"At the growth so far it takes about {grouped(until / slowest, 2)} units of time until all"
            " capacities are reached."
        )
    return Headline(sentence, more, judged=False, reached=False)


def _without_signal(run: StoredRun, _settling: Settling) -> Headline | None:
    """Tell a run in which nothing held demand, since no signal was sent or none arrived."""
    rows = run.measures
    silent = [name for name, row in rows.items() if not row["signals"]]
    unheard = [name for name, row in rows.items() if row["signals"] and not row["delivered"]]
    rare = [name for name, row in rows.items() if row["signals"] < _FEW and row["overshoot_time"] > _MOSTLY]
    if silent:
        said = f"No signal was sent for {_listed(silent)}"
    elif unheard:
        said = f"No copy of a signal for {_listed(unheard)} arrived"
    elif rare:
        counts = _each({name: f"{rows[name]['signals']:,}" for name in rare}, "for")
        said = f"Signals were as few as {counts}"
    else:
        return None
    peaks = {name: rows[name]["overshoot_peak"] for name in silent or unheard or rare}
    known = {name: percent(peak) for name, peak in peaks.items() if isfinite(peak)}
    rest = f", and nothing held demand: it peaked at {_each(known, 'of the capacity of')}." if known else "."
    return Headline(said + rest, "", judged=False)


def _run_away(run: StoredRun, _settling: Settling) -> Headline | None:
    if not run.run_away:
        return None
    rows = {name: run.measures[name] for name in run.run_away if name in run.measures}
    means = " and ".join(percent(row["utilisation"]) for row in rows.values())
    if len(rows) > _MOST_NAMES:
        means = _span([row["utilisation"] for row in rows.values()])
    lost = sum(row["lost"] for row in rows.values())
    copies = lost + sum(row["delivered"] + row["in_flight"] for row in rows.values())
    cause = "Signals come too late, or take too little"
    if lost and copies:
        cause = f"{percent(lost / copies, 2)} of the copies of signals were lost"
    sentence = (
        f"Demand has run away from the capacity of {_listed(list(rows))}: mean demand is {means} of the"
        " capacity."
    )
    return Headline(sentence, f"{cause}.", judged=False)


def _saturated(run: StoredRun, _settling: Settling) -> Headline | None:
    shares = {
        name: row["saturated"] / row["responses"] for name, row in run.measures.items() if row["responses"]
    }
    cut = {name: percent(share, 2) for name, share in shares.items() if share >= _SATURATED}
    if not cut:
        return None
    sentence = (
        f"Answers are saturated: the probability of {_each(cut, 'of the responses for')} was above 1, and was"
        " cut off."
    )
    more = (
        "The normalization factor is too large for these costs, so averages need not settle at the optimum."
    )
    return Headline(sentence, more, judged=False)


def _unsettled(run: StoredRun, settling: Settling) -> Headline | None:
    rows = run.measures
    few = {name: row["signals"] for name, row in rows.items() if row["signals"] < _FEW}
    moved = {name: percent(part, 2) for name, part in settling.moved.items() if part > _MOVED}
    if run.unsettled is not None and run.unsettled > _LEFT:
        left = percent(run.unsettled, 2)
        cause = f"by theory {left} of the deviation that decays most slowly is left at its end"
    elif few:
        counts = _each({name: f"{count:,}" for name, count in few.items()}, "for")
        cause = f"the signals are too few ({counts})"
    elif run.unsettled is None and moved:
        shown = _each(moved, "of the capacity of")
        cause = f"in its second half the averages have still moved by {shown}"
    else:
        return None
    sentence = f"The run is too short to have settled: {cause}."
    return Headline(sentence, "Use and shares are those of the start, and are not judged.", judged=False)


def _held(rows: Rows, band: Mapping[str, tuple[float, float]]) -> str:
    """Say how much is used of capacities that hold demand, and how well it is shared."""
    used = {name: float(row["utilisation"]) for name, row in rows.items()}
    off = {name: float(row["misallocation"]) for name, row in rows.items()}
    if len(rows) > _MOST_NAMES:
        mean = f"Mean demand is {side(min(used.values()))} to {side(max(used.values()))} the capacities"
        error = _span(list(off.values()))
    else:
        mean = "Mean demand is " + " and ".join(
            f"{side(share)} the capacity of {name}" if place == 0 else f"{side(share)} that of {name}"
            for place, (name, share) in enumerate(used.items())
        )
        error = _joined([percent(share, 2) for share in off.values()])
    sentence = f"{mean}, and what is used is shared with an error of {error}"
    if band and all(name in band for name in off):
        above = [name for name, share in off.items() if share > band[name][1]]
        below = all(off[name] >= band[name][0] for name in off)
        if above:
            sentence += f", more than theory expects for {_listed(above)}"
        elif below:
            sentence += ", as theory expects at this length"
        else:
            sentence += ", no more than theory expects at this length"
    return f"{sentence}."


def side(share: float) -> str:
    """Say how far a share of the capacity is from all of it."""
    if percent(abs(share - 1.0), 2) == "0 %":
        return "at"
    return f"{percent(abs(share - 1.0), 2)} {'above' if share > 1.0 else 'below'}"


def _peaks(rows: Rows) -> str:
    peaks = {name: float(row["overshoot_peak"]) for name, row in rows.items()}
    if not all(map(isfinite, peaks.values())):
        return ""
    if len(peaks) > _MOST_NAMES:
        return f"Peak demand is {_span(list(peaks.values()))} of the capacity."
    return f"Peak demand is {_each({name: percent(peak) for name, peak in peaks.items()}, 'of')}."


def _span(shares: Sequence[float]) -> str:
    return f"{percent(min(shares))} to {percent(max(shares))}"


def _each(values: Mapping[str, str], word: str) -> str:
    """Say a value of each resource, such as "98 % of memory and 97 % of disk"."""
    return _joined([f"{value} {word} {name}" for name, value in values.items()])


def _listed(names: Sequence[str]) -> str:
    return _joined(list(names))


def _joined(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
