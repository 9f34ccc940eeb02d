"""What to expect of a run's accuracy, in sentences for people."""

import math

import numpy as np

from aimd_des.theory.accuracy import Convergence, Expected
from aimd_des.utils.formatting import grouped, percent

__all__ = ["accuracy_words", "needed_words", "settling_words"]

# So much of a deviation at the start must have decayed for averages to count as settled.
_SETTLED = 0.1


def accuracy_words(expected: Convergence, until: float, at_end: Expected) -> list[str]:
    """Say what misallocation is to be expected of the worst resource, and what half of it would take."""
    names, mean = expected.problem.resource_names, at_end.mean
    worst = int(np.argmax(mean))
    half = float(f"{0.5 * mean[worst]:.1g}")
    length = float(expected.needed(half).length[worst])
    low, high = (percent(float(end[worst]), 2) for end in (at_end.low, at_end.high))
    sentence = (
        f"At this length a misallocation of {percent(float(mean[worst]), 2)} is to be expected for"
        f" {names[worst]} (95 % of runs: {low} to {high})"
    )
    floor = f"the bias keeps it above {percent(float(expected.floor[worst]), 2)}"
    if math.isfinite(length):
        more = f"{percent(half)} would take {_rounded(length / until, 2)} times as long; {floor}"
    else:
        more = f"no length gives {percent(half)}: {floor}, and what averages forget keeps them scattered"
        if expected.floor[worst] >= half:
            more = f"no length gives {percent(half)}: {floor}"
    return [f"{sentence}; {more}.", *settling_words(expected, until)]


def settling_words(expected: Convergence, until: float) -> list[str]:
    """Warn, from the exponents alone, of averages that have not settled at the end."""
    left = expected.left(until)
    if left <= _SETTLED:
        return []
    slowest = f"{percent(left, 2)} of the deviation that decays most slowly is left"
    return [f"Averages have not settled at this length: {slowest} (exponent {expected.slowest:.2g})."]


def _rounded(value: float, digits: int) -> str:
    """Write so many digits, without powers of ten."""
    return grouped(float(f"{value:.{digits}g}"), 15)


def needed_words(expected: Convergence, until: float, accuracy: float) -> list[str]:
    """Say of each resource what is to be expected, and what a wanted accuracy takes."""
    at_end, needed = expected.misallocation(until), expected.needed(accuracy)
    lines = []
    for j, name in enumerate(expected.problem.resource_names):
        mean, low, high = (percent(float(one[j]), 2) for one in at_end)
        if math.isfinite(needed.length[j]):
            takes = f"takes {_rounded(needed.length[j], 3)} ({_rounded(needed.signals[j], 3)} signals)"
        else:
            takes = f"is never reached (bias alone {percent(float(expected.floor[j]), 2)})"
        said = f"misallocation {mean} at {grouped(until)} (95 % of runs: {low} to {high})"
        lines.append(f"{name}: {said}; {percent(accuracy)} {takes}")
    return [*lines, *settling_words(expected, until)]
