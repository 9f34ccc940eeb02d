"""The rare event of a scenario file, estimated, and as columns of a study."""

import logging
import math
from typing import Any

from aimd_des.problem.lookup import resource_index
from aimd_des.problem.problem import Problem
from aimd_des.results.measures import RARE
from aimd_des.scenario import Scenario
from aimd_des.scenario.simulations import simulation_of
from aimd_des.study.rare_events import RareEvent, rare_event
from aimd_des.utils.errors import InputError, SimulationError

_LOGGER = logging.getLogger("aimd_des")


def estimated(scenario: Scenario, problem: Problem | None = None) -> RareEvent:
    """Estimate the probability of the rare event that a scenario names in its table ``[rare_event]``."""
    if scenario.rare_event is None:
        raise InputError.of("rare_event", None, "a table of the scenario")
    if scenario.warm_up is not None:
        allowed, remedy = "left out where there is a rare event", "give rare_event.after"
        raise InputError.of("warm_up.until", scenario.warm_up.until, allowed, remedy)
    problem = scenario.problem() if problem is None else problem
    fleet = scenario.model_copy(update={"agents": "fleet"})
    simulation = simulation_of(fleet, problem, scenario.changes(problem))
    return rare_event(simulation, **dict(scenario.rare_event))


def rare_columns(scenario: Scenario, problem: Problem) -> dict[str, list[Any]]:
    """Give the estimate as measures: of its resource, or of all; NaN where the level is out of reach."""
    numbers = [math.nan] * len(RARE)
    try:
        found = estimated(scenario, problem)
        numbers = [found.probability, found.low, found.high, found.relative_error, found.gain]
    except SimulationError as refusal:
        _LOGGER.warning("no probability is estimated: %s", refusal)
    wanted = None if scenario.rare_event is None else scenario.rare_event.resource
    own = None if wanted is None else resource_index(problem, wanted)
    return {
        name: [number if own in (None, j) else math.nan for j in range(problem.n_resources)]
        for name, number in zip(RARE, numbers, strict=True)
    }


def in_words(found: RareEvent, scenario: Scenario) -> str:
    """Say what was found, in one sentence."""
    event = scenario.rare_event
    assert event is not None  # noqa: S101 - it was estimated
    what = "demand" if event.measure == "demand" else "misallocation"
    of = "a resource" if event.resource is None else event.resource
    return (
        f"Rare event: {what} of {of} reaches {event.level:g} within {event.within:g} with a probability of"
        f" {found.probability:.3g} ({found.low:.3g} to {found.high:.3g}); work is {found.gain:.3g} times less"
        " than by plain runs"
    )
