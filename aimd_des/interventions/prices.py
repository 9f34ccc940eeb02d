"""Private costs that change while a run goes on; called by processes as the functions of `changes` are."""

from collections.abc import Hashable

import numpy as np

from aimd_des.engine.system import System
from aimd_des.interventions.bookkeeping import begin_piece, end_piece, note
from aimd_des.problem.costs import Costs, family, weighted_costs
from aimd_des.problem.lookup import Agents, agent_indices
from aimd_des.problem.problem import Problem
from aimd_des.results.event_log import Entry
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.locked_arrays import locked


def set_costs(system: System, costs: Costs) -> None:
    """Change the private costs of all agents; weights that are in force stay.

    Parameters
    ----------
    system : System
        The run in progress.
    costs : Costs
        Of any family that couples resources if and only if those of the problem do, and for as many agents
        and resources.

    Raises
    ------
    InputError
        If the costs couple resources where those before do not, or the other way round, or are of another
        shape, or not convex and increasing.
    """
    redraw(system, costs, "")


def redraw(system: System, costs: Costs, by: tuple[str, int] | str) -> None:
    """Change the private costs, and note what has drawn them."""
    checked_costs(system.problem, costs)
    conditions = system.conditions
    conditions.base_costs = costs
    conditions.recipes.append((costs, by, None))
    _reprice(system)


def checked_costs(problem: Problem, costs: Costs) -> None:
    """Refuse costs that cannot take the place of a problem's."""
    before = problem.costs
    if family(costs).separable != before.separable:
        allowed = f"{before.separable}, as of the costs of the problem"
        raise InputError.of(f"separable of {type(costs).__name__}", costs.separable, allowed)
    if (costs.n_agents, costs.n_resources) != (before.n_agents, before.n_resources):
        allowed = f"for {before.n_agents} agents and {before.n_resources} resources"
        raise InputError.of("shape of costs", (costs.n_agents, costs.n_resources), allowed)
    Problem(problem.resources, costs)  # refuses what is not convex or not increasing


def weigh(system: System, agents: Agents, weight: float, *, by: Hashable = None) -> None:
    """Multiply the private costs of agents by a weight: below 1 they ask for more, above for less.

    Parameters
    ----------
    system : System
        The run in progress.
    agents : str, int or sequence of these
        Whose: names, or i.
    weight : float
        Greater than 0; 1 is as without.
    by : hashable, optional
        The source of the weight.  Of one source, the latest weight of an agent counts. Weights of several
        sources are multiplied; a weight of 1 removes that of its source.

    Raises
    ------
    InputError
        If there is no such agent, one is named twice, none is named, or the weight is not positive.
    """
    value = validation.number("weight", weight, low=0.0, low_open=True)
    indices, conditions = agent_indices(system.problem, agents), system.conditions
    weighing = conditions.weighing
    own = weighing.setdefault(by, np.ones(system.problem.n_agents))
    own[indices] = value
    if (own == 1.0).all():
        del weighing[by]
    # Multiplied anew in the order in which they began: dividing would leave a rounding error.
    weights = np.ones(system.problem.n_agents)
    for each in weighing.values():
        weights *= each
    conditions.weights = locked(weights)
    _reprice(system)


def _reprice(system: System) -> None:
    conditions = system.conditions
    end_piece(system)
    plain = bool((conditions.weights == 1.0).all())
    base = conditions.base_costs
    if plain:
        conditions.costs = base
    else:
        conditions.costs = weighted_costs(base, conditions.weights)
        drawn = next((by for costs, by, _ in conditions.recipes if costs is base), None)
        conditions.recipes.append((conditions.costs, drawn, conditions.weights))
    for tell in conditions.on_costs:
        tell(conditions.costs)
    note(system, Entry.COSTS)
    begin_piece(system)
