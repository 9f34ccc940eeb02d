"""The paper's Algorithms 1 and 2 in plain Python, step by step, to hold the synchronous algorithm against."""

import math
from dataclasses import dataclass, field

from aimd_des import Problem
from aimd_des.utils.rng import Purpose
from tests.conftest import reference_derivative, reference_draws


@dataclass
class Stepped:
    """What the paper's algorithms do, taken literally."""

    signals: list[tuple[float, int, int]] = field(default_factory=list)
    demand: list[list[list[float]]] = field(default_factory=list)  # x(k)[i][j]
    average: list[list[list[float]]] = field(default_factory=list)  # x-bar(k)[i][j]
    responses: int = 0
    saturated: int = 0
    margin: float = math.inf  # how near a decision was to the other one


def step_by_step(problem: Problem, steps: int, seed: int, lag: int) -> Stepped:
    """Algorithms 1 and 2 in plain Python; only the uniform draws are shared with the program."""
    n, m = problem.n_agents, problem.n_resources
    run = Stepped()
    x = [[0.0] * m for _ in range(n)]
    average = [[0.0] * m for _ in range(n)]
    signal, used = [False] * m, [0] * m
    for k in range(steps):
        run.demand.append([list(row) for row in x])
        run.average.append([list(row) for row in average])
        limits = [problem.threshold[j] * problem.capacity[j] for j in range(m)]
        totals = [sum(row[j] for row in x) for j in range(m)]
        run.margin = min(run.margin, *(abs(t / limit - 1) for t, limit in zip(totals, limits, strict=True)))
        due = [total > limit for total, limit in zip(totals, limits, strict=True)]
        run.signals += [(float(k), j, used[j] + (lag and signal[j])) for j in range(m) if due[j]]
        if lag == 0:
            signal = due
        draws = {j: reference_draws(seed, Purpose.RESPONSE, j, used[j], n) for j in range(m) if signal[j]}
        before = [list(row) for row in average]
        for i in range(n):
            for j in range(m):
                if signal[j]:
                    slope = reference_derivative(problem.costs, i, before[i], j)
                    probability = problem.normalization[j] * slope / before[i][j] if before[i][j] > 0 else 0.0
                    run.margin = min(run.margin, abs(probability - draws[j][i]), abs(probability - 1))
                    if draws[j][i] < probability:
                        x[i][j] = problem.decrease[i, j] * x[i][j]
                        run.responses += 1
                        run.saturated += probability > 1
                else:
                    x[i][j] += problem.increase[i, j]
                average[i][j] = (k + 1) / (k + 2) * average[i][j] + 1 / (k + 2) * x[i][j]
        for j in range(m):
            used[j] += signal[j]
        signal = due
    run.demand.append(x)
    run.average.append(average)
    return run
