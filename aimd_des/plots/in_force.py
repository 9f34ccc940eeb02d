"""Samples of a run, each compared with the problem and the optimum that were in force at the time."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.problem.optimum import Optimum
from aimd_des.problem.problem import Problem
from aimd_des.results.misallocation import optimum_for_used
from aimd_des.results.result import Result
from aimd_des.results.tracking import piece_problem
from aimd_des.utils.validation import BoolArray, FloatArray

#: What a panel says that would show the agents that are here at the end.
NOBODY = "No agent is here at the end of the run."
#: What a panel over time says that has no number to show.
NEVER = "No agent was here at the samples of this panel."


class Observation(NamedTuple):
    """The agents that are here at a time, and what they are compared with."""

    problem: Problem  # in force, for the agents that are here
    present: BoolArray  # (n,): which agents they are
    average: FloatArray  # (k, m): their averages, in units of the resources
    best: Optimum  # of the problem in force

    @property
    def for_used(self) -> Optimum | None:
        """The optimum for what averages use; None where that is nothing."""
        return optimum_for_used(self.problem, self.average)


def measured(
    result: Result,
    shown: npt.NDArray[np.intp],
    optimum: Optimum | None,
    measure: Callable[[Observation], npt.ArrayLike],
    *shape: int,
) -> FloatArray:
    """Measure the averages at some samples."""
    seen, found = result.observations, np.full((len(shown), *shape), np.nan)
    for row, look in enumerate(shown.tolist()):
        piece = result.piece_at(float(seen.allocation_times[look]))
        best = result.optimum_of(piece, optimum)
        if best is not None:
            average = seen.average[look].T[piece.present]
            found[row] = measure(
                Observation(piece_problem(result.problem, piece), piece.present, average, best)
            )
    return found
