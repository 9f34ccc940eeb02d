"""How near a run has come to the optimum, and how near theory expects it to come."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from aimd_des.results.result import Result
from aimd_des.scenario.expected import expected_of
from aimd_des.scenario.scenario import Scenario
from aimd_des.theory.accuracy import Convergence, Expected
from aimd_des.theory.accuracy_words import accuracy_words
from aimd_des.utils.errors import InputError, SimulationError
from aimd_des.utils.validation import FloatArray

__all__ = ["Accuracy", "accuracy_of"]

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
    m = result.problem.n_resources
    measured = result.convergence()
    times = measured["time"].to_numpy()[::m]
    mean, low, high = np.full((3, len(times), m), np.nan)
    words, reason, at_end, left = list[str](), "", None, None
    try:
        expected = _expected(scenario, result.problem.n_agents)
        mean, low, high = expected.misallocation(times)
        left = float(expected.left(result.until))
        at_end = mean[-1]
        words = accuracy_words(expected, result.until, Expected(at_end, low[-1], high[-1]))
    except (InputError, SimulationError, ArithmeticError, np.linalg.LinAlgError) as refusal:
        reason = str(refusal)
    frame = measured.assign(expected=mean.ravel(), low=low.ravel(), high=high.ravel())
    return Accuracy(frame, at_end, words, reason, left)


def _expected(scenario: Scenario, n_agents: int) -> Convergence:
    if n_agents > _MOST_AGENTS:
        remedy = "aimd-des validate --accuracy predicts it; that takes a while"
        raise InputError.of("n_agents", n_agents, f"at most {_MOST_AGENTS}", remedy)
    return expected_of(scenario, n_agents)
