"""What a result shows of itself: what was run, and the measures that need no optimum."""

from typing import TYPE_CHECKING

from aimd_des.problem.problem import shared_words
from aimd_des.results.measures import SHOWN, shown_measures
from aimd_des.utils.shown import Shown
from aimd_des.utils.validation import FloatArray

if TYPE_CHECKING:
    from aimd_des.results.result import Result


def shown_result(result: "Result", misallocation: FloatArray | None) -> Shown:
    """Show a result, with its misallocation where that has been measured."""
    known = result.measures(names=[name for name in SHOWN if name != "misallocation"])
    if misallocation is not None:
        known["misallocation"] = misallocation
    names = result.problem.resource_names
    away = [name for name, gone in zip(names, result.run_away, strict=True) if gone]
    words = [
        f"Result: {result.dynamics}, seed {result.seed}, until {result.until:,g}",
        *([f"demand has run away from {', '.join(away)}"] if away else []),
        shared_words(result.problem),
    ]
    return Shown("; ".join(words), *shown_measures(names, known))
