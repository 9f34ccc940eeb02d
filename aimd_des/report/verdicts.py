"""The numbers that matter, and what they say in words."""

from collections.abc import Callable, Collection, Mapping
from math import isfinite
from typing import NamedTuple

from aimd_des.report.html_page import Verdict
from aimd_des.results.measures import MEASURES
from aimd_des.utils.formatting import percent


class Judgement(NamedTuple):
    """How the page judges a measure."""

    more: str  # what to know besides its meaning
    badness: Callable[[float], float]  # is the larger the worse a value is
    words: Callable[[float], str]  # says a value of it, as a share


def _used(share: float) -> str:
    if share > 1.0:
        return f"Mean demand is {percent(share - 1.0)} above the capacity."
    if share >= 0.9:
        return "Nearly all of the capacity is used."
    return (
        "A part of the capacity is left unused." if share >= 0.7 else "Much of the capacity is left unused."
    )


def _shared(share: float) -> str:
    if share < 0.02:
        return "What is used is shared almost as it is best."
    return "What is used is shared about as it is best." if share < 0.1 else "What is used is shared wrongly."


def _exceeded(peak: float) -> str:
    if peak <= 1.0:
        return "Demand never exceeded the capacity."
    if peak < 1.15:
        return "Demand exceeded the capacity by a little."
    return "Demand exceeded the capacity by much."


#: The three of the verdict, in its order.
JUDGED = {
    "utilisation": Judgement(
        "Demand swings below the capacity like the teeth of a saw, so even a run without fault does not use"
        " all of it.",
        lambda share: abs(share - 1.0),
        _used,
    ),
    "misallocation": Judgement("Half of it would have to change hands.", abs, _shared),
    "overshoot_peak": Judgement(
        "It is what signals that come late, or not at all, let happen.", abs, _exceeded
    ),
}


def verdict(
    name: str, values: Mapping[str, float], among: str, run_away: Collection[str] = ()
) -> Verdict | None:
    """Say the worst of several values in words."""
    measure, judgement = MEASURES[name], JUDGED[name]
    known = {of: value for of, value in values.items() if isfinite(value)}
    if not known:
        return None
    worst = max(known, key=lambda of: (of in run_away, judgement.badness(known[of])))
    others = [value for of, value in known.items() if of != worst]
    words = [judgement.words(known[worst])]
    if worst in run_away:
        words.append("In the second half of the run demand has run away from it.")
    if others:
        low, high = percent(min(others)), percent(max(others))
        span = low if low == high else f"{low} to {high}"
        words.append(f"This is the worst of the {among}: {worst}. The others: {span}.")
    else:
        words.append(f"This is {worst}.")
    return Verdict(
        measure.title, percent(known[worst]), " ".join(words), f"{measure.meaning} {judgement.more}"
    )
