"""What a result shows of itself: what was run, and the measures that need no optimum."""

from aimd_des.problem.problem import Problem, shared_words
from aimd_des.results.measures import SHOWN, shown_measures
from aimd_des.utils.shown import Shown
from aimd_des.utils.validation import BoolArray, FloatArray

#: What is shown and takes no optimum to be solved.
UNSOLVED = [name for name in SHOWN if name != "misallocation"]


def shown_result(
    run: str,
    problem: Problem,
    run_away: BoolArray,
    known: dict[str, FloatArray],
    misallocation: FloatArray | None,
) -> Shown:
    """Show a result, with its misallocation where that has been measured."""
    if misallocation is not None:
        known = {**known, "misallocation": misallocation}
    names = problem.resource_names
    away = [name for name, gone in zip(names, run_away, strict=True) if gone]
    words = [
        f"Result: {run}",
        *([f"demand has run away from {', '.join(away)}"] if away else []),
        shared_words(problem),
    ]
    return Shown("; ".join(words), *shown_measures(names, known))
