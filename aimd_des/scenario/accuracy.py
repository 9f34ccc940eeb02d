"""How near a run has come to the optimum, and how near theory expects it to come."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from aimd_des.results import metrics
from aimd_des.results.frames import categorical
from aimd_des.results.looks import looks
from aimd_des.results.misallocation import misallocation
from aimd_des.results.result import Result
from aimd_des.results.tracking import piece_problem
from aimd_des.scenario.expected import expected_of
from aimd_des.scenario.scenario import Scenario
from aimd_des.theory.accuracy import Convergence, Expected
from aimd_des.theory.accuracy_words import accuracy_words
from aimd_des.utils.errors import InputError, SimulationError
from aimd_des.utils.validation import FloatArray

__all__ = ["Accuracy", "accuracy_of"]

_LOOKS = 16
# Of many agents fewer looks are taken: each is an optimum to be solved.
_BUDGET = 100_000
_FEWEST_LOOKS = 4
# With so many a prediction takes seconds, and more than 100 MB.
_MOST_AGENTS = 10_000


class Accuracy(NamedTuple):
    """What the folder of a run tells of its accuracy."""

    # time, resource, misallocation, relative_error and cost_ratio (of all resources together, repeated), and
    # the expected misallocation, low and high, which are NaN where nothing is expected
    frame: pd.DataFrame
    expected: FloatArray | None  # (m,): misallocation at the end, in the mean over runs
    words: list[str]  # what is expected, in sentences
    reason: str = ""  # why nothing is
    # What is left at the end of the deviation that decays most slowly, where theory knows.
    left: float | None = None


def accuracy_of(scenario: Scenario, result: Result) -> Accuracy:
    """Measure the misallocation of a run over time, and ask theory what it should be."""
    problem, seen = result.problem, result.observations
    count = int(np.clip(_BUDGET // problem.n_agents, _FEWEST_LOOKS, _LOOKS))
    shown = looks(seen.allocation_times, count, log=True)
    times, m = seen.allocation_times[shown], problem.n_resources
    measured, error, cost, mean, low, high = np.full((6, len(times), m), np.nan)
    for row, (look, time) in enumerate(zip(shown.tolist(), times.tolist(), strict=True)):
        piece = result.piece_at(time)
        if piece.present.any():
            average = seen.average[look].T[piece.present]
            in_force = piece_problem(problem, piece)
            measured[row] = misallocation(in_force, average)
            best = result.optimum_of(piece)
            assert best is not None  # noqa: S101 - somebody is here
            error[row] = metrics.relative_error(average, best.allocation)
            cost[row] = metrics.cost_ratio(in_force.costs, average, best.allocation)
    words, reason, at_end, left = list[str](), "", None, None
    try:
        expected = _expected(scenario, problem.n_agents)
        mean, low, high = expected.misallocation(times)
        left = float(expected.left(result.until))
        at_end = mean[-1]
        words = accuracy_words(expected, result.until, Expected(at_end, low[-1], high[-1]))
    except (InputError, SimulationError, ArithmeticError, np.linalg.LinAlgError) as refusal:
        reason = str(refusal)
    frame = pd.DataFrame(
        {
            "time": np.repeat(times, m),
            "resource": categorical(np.tile(np.arange(m), len(times)), problem.resource_names),
            "misallocation": measured.ravel(),
            "relative_error": error.ravel(),
            "cost_ratio": cost.ravel(),
            "expected": mean.ravel(),
            "low": low.ravel(),
            "high": high.ravel(),
        }
    )
    return Accuracy(frame, at_end, words, reason, left)


def _expected(scenario: Scenario, n_agents: int) -> Convergence:
    if n_agents > _MOST_AGENTS:
        remedy = "aimd-des validate --accuracy predicts it; that takes a while"
        raise InputError.of("n_agents", n_agents, f"at most {_MOST_AGENTS}", remedy)
    return expected_of(scenario, n_agents)
