"""The fluid of the agents: what they do in the mean, with chance averaged out.

Between signals all agents grow; at the level that holds the total, signals take away what grows beyond it,
from each agent in proportion to its response probability and its demand,

    x_i' = alpha_i - h (1 - beta_i) lambda_i(average_i) x_i,    h such that the total stays at its level,

and below the level h = 0.  The averages follow the demand with their memory.  Interventions act as in a run.
Neglects that averages scatter, and that they and the demand of an agent go together.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from aimd_des import Problem
from aimd_des.averaging import Averaging, Cumulative, Forgetting, Window
from aimd_des.interventions import Absence, Crash, UnusualActivity
from aimd_des.lowlevel import FloatArray, agent_indices

Change = Absence | Crash | UnusualActivity


class Flow(NamedTuple):
    """What the fluid does."""

    time: FloatArray  # (q,): in units of time
    # (q, n): Of each agent, in units of the resource.
    demand: FloatArray
    average: FloatArray


class _Memory:
    """Sums and weights of what each agent has held, as its way of averaging has it."""

    def __init__(self, averaging: Averaging, n: int, step: float) -> None:
        self.step, self.kept, self.part, self.parts = step, 1.0, 0, 0
        self.sum, self.weight = np.zeros(n), np.zeros(n)
        if isinstance(averaging, Forgetting):
            self.kept = float(np.exp(-step / averaging.time_constant))
        elif isinstance(averaging, Window):
            self.parts, self.part = averaging.parts, round(averaging.length / averaging.parts / step)
        self.past = [self.sum]  # of a window: the sum at every step

    def add(self, demand: FloatArray, here: FloatArray) -> None:
        kept = np.where(here > 0.0, self.kept, 1.0)  # the past of those who are away stands still
        self.sum = kept * self.sum + here * demand * self.step
        self.weight = kept * self.weight + here * self.step
        if self.parts:
            self.past.append(self.sum)

    def average(self) -> FloatArray:
        total, weight = self.sum, self.weight
        if self.parts:  # the window slides by parts
            begin = max((len(self.past) - 1) // self.part - self.parts + 1, 0) * self.part
            total, weight = total - self.past[begin], weight - begin * self.step
        return np.asarray(total / np.maximum(weight, 1e-300))


def flow(
    problem: Problem,
    level: float,
    until: float,
    averaging: Averaging | None = None,
    interventions: Sequence[Change] = (),
    step: float = 0.25,
) -> Flow:
    """Let the fluid of a single resource flow from nothing, with signals that hold the total at a level.

    Agents average over all of the past unless it is said; over a window only where nobody is ever away.
    The flow is kept at every step of time, the start and the end included.
    """
    n, alpha, gamma = problem.n_agents, problem.increase[:, 0], float(problem.normalization[0])
    cut = 1.0 - problem.decrease[:, 0]
    demand, here, weights = np.zeros(n), np.ones(n), np.ones(n)
    memory = _Memory(Cumulative() if averaging is None else averaging, n, step)
    times: FloatArray = np.asarray(np.arange(round(until / step) + 1) * step, dtype=np.float64)
    changes = _changes(problem, interventions)
    demands, averages = [demand], [np.zeros(n)]
    for time in times[:-1]:
        while changes and changes[0][0] <= time:
            _, change, agents, begins = changes.pop(0)
            if isinstance(change, UnusualActivity):
                weights[agents] = change.weight if begins else 1.0
                continue
            here[agents] = 0.0 if begins else 1.0
            if isinstance(change, Crash):
                memory.sum[agents], memory.weight[agents] = 0.0, 0.0
        average = memory.average()
        slope = weights * problem.costs.gradient(average[:, None])[:, 0]
        chance = np.minimum(gamma * slope / np.where(average > 0.0, average, np.inf), 1.0)
        grown = here * (demand + alpha * step)
        taken = here * cut * chance * demand
        excess = max(float(grown.sum()) - level, 0.0)
        later = np.maximum(grown - (excess / taken.sum() * taken if excess else 0.0), 0.0)
        memory.add(0.5 * (here * demand + later), here)
        demand = later
        demands.append(demand)
        averages.append(memory.average())
    return Flow(times, np.array(demands), np.array(averages))


def _changes(
    problem: Problem, interventions: Sequence[Change]
) -> list[tuple[float, Change, list[int], bool]]:
    """List what begins and what ends, by time."""
    found: list[tuple[float, Change, list[int], bool]] = []
    for change in interventions:
        agents = agent_indices(problem, change.agents)
        found.append((change.at, change, agents, True))
        if change.until is not None:
            found.append((change.until, change, agents, False))
    return sorted(found, key=lambda entry: entry[0])
