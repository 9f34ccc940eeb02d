r"""The fluid of the agents: what they do in the mean, with chance averaged out.

Between signals all agents grow; at the level that holds the total, signals take away what grows beyond it,
from each agent in proportion to its response probability and its demand,

    x_i' = alpha_i - h (1 - beta_i) lambda_i(average_i) x_i,    h such that the total stays at its level,

and below the level h = 0.  The averages follow the demand with their memory.
"""

from collections.abc import Sequence
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from aimd_des.dynamics.averaging import Averaging, Cumulative, Forgetting, Window
from aimd_des.problem.problem import Problem
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.validation import FloatArray


class Flow(NamedTuple):
    """What the fluid does.

    Attributes
    ----------
    time : ndarray, shape (q,)
        In units of time.
    demand, average : ndarray, shape (q, n)
        Of each agent, in units of the resource.
    """

    time: FloatArray
    demand: FloatArray
    average: FloatArray


class Spell(NamedTuple):
    """A time in which some agents are away, or weigh their costs otherwise.

    Attributes
    ----------
    begin, end : float
        In units of time; an end of infinity is never reached.
    agents : sequence of int
        Which agents.
    weight : float, optional
        Factor > 0 of their costs in this time; without it they are away.
    forgets : bool
        Whether the averages of agents that are away begin anew.
    """

    begin: float
    end: float
    agents: Sequence[int]
    weight: float | None = None
    forgets: bool = False


class _Averages:
    """Sums and weights of what each agent has held, as its way of averaging has it."""

    def __init__(self, averaging: Averaging, n: int, step: float) -> None:
        self.step, self.kept, self.part, self.parts = step, 1.0, 0, 0
        self.sum, self.weight = np.zeros(n), np.zeros(n)
        if isinstance(averaging, Forgetting):
            self.kept = float(np.exp(-step / averaging.time_constant))
        elif isinstance(averaging, Window):
            self.parts, self.part = averaging.parts, round(averaging.length / averaging.parts / step)
        elif not isinstance(averaging, Cumulative):
            raise InputError.of("averaging", averaging, "Cumulative, Window or Forgetting")
        self.past = [self.sum]  # of a window: the sum at every step

    def add(self, demand: FloatArray, here: FloatArray) -> None:
        kept = np.where(here > 0.0, self.kept, 1.0)  # the past of agents that are away does not change
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
    spells: Sequence[Spell] = (),
    step: float = 0.25,
) -> Flow:
    """Follow the means of demand and averages from nothing, with signals that hold the total at a level.

    Parameters
    ----------
    problem : Problem
        One resource.
    level : float
        Mean total demand > 0 while signals hold it, as `predict` has it, in units of the resource.
    until : float
        Length > 0 of the run, in units of time.
    averaging : Cumulative, Window or Forgetting, optional
        Of all agents; default: over all of the past.  A window only where no agent is ever away.
    spells : sequence of Spell
        Which agents are away, or weigh their costs otherwise, and when.
    step : float
        Step > 0 of the solution, in units of time; a part of a window is a multiple of it.

    Returns
    -------
    Flow
        At every step, the start and the end included.

    Raises
    ------
    InputError
        If a number is outside its range, the problem has several resources, or agents average otherwise.

    Notes
    -----
    Neglects that averages scatter, and that averages and demand of an agent go together.  Explicit steps:
    what grows in a step is taken away at its end.

    Examples
    --------
    >>> from aimd_des import PolynomialCosts, Resource
    >>> memory = Resource("memory", capacity=20.0, increase=0.02, decrease=0.5, normalization=0.1)
    >>> problem = Problem([memory], PolynomialCosts([2], [[[1.0]]] * 20))
    >>> path = flow(problem, 19.0, 200.0, spells=[Spell(100.0, 150.0, [0, 1])])
    >>> path.demand.sum(axis=1)[[-1, 401]].round(2).tolist()
    [19.0, 17.19]
    """
    if problem.n_resources != 1:
        raise InputError.of("number of resources", problem.n_resources, "1", "take one at a time")
    for name, value in (("level", level), ("until", until), ("step", step)):
        validation.number(name, value, low=0.0, low_open=True)
    n, alpha, gamma = problem.n_agents, problem.increase[:, 0], float(problem.normalization[0])
    cut = 1.0 - problem.decrease[:, 0]
    demand, here, weights = np.zeros(n), np.ones(n), np.ones(n)
    memory = _Averages(Cumulative() if averaging is None else averaging, n, step)
    times: FloatArray = np.asarray(np.arange(round(until / step) + 1) * step, dtype=np.float64)
    changes = [(at, spell, at == spell.begin) for spell in spells for at in (spell.begin, spell.end)]
    changes.sort(key=itemgetter(0))
    demands, averages = [demand], [np.zeros(n)]
    for time in times[:-1]:
        while changes and changes[0][0] <= time:
            _, spell, begins = changes.pop(0)
            agents = list(spell.agents)
            if spell.weight is not None:
                weights[agents] = spell.weight if begins else 1.0
                continue
            here[agents] = 0.0 if begins else 1.0
            if spell.forgets:
                memory.sum[agents], memory.weight[agents] = 0.0, 0.0
        average = memory.average()
        slope = weights * problem.costs.gradient(average[:, None])[:, 0]
        chance = np.minimum(gamma * slope / np.where(average > 0.0, average, np.inf), 1.0)
        grown = here * (demand + alpha * step)
        taken = here * cut * chance * demand
        excess = max(float(grown.sum()) - level, 0.0)
        demand, before = np.maximum(grown - (excess / taken.sum() * taken if excess else 0.0), 0.0), demand
        memory.add(0.5 * (here * before + demand), here)
        demands.append(demand)
        averages.append(memory.average())
    return Flow(times, np.array(demands), np.array(averages))
