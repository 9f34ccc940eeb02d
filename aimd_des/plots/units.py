"""How amounts of several resources, each in its own unit, share one axis."""

from typing import NamedTuple

import numpy as np

from aimd_des.problem.problem import Problem
from aimd_des.utils.validation import FloatArray

# Beyond this ratio of the largest to the smallest, curves do not share an axis in their own units.
_COMPARABLE = 10.0
_LONGEST_UNIT = 32


class Scale(NamedTuple):
    """How the amounts of several resources share one axis."""

    divisor: FloatArray  # (m,): what amounts are divided by, in units of the resources or 1
    unit: str  # what the axis then shows, in words


def comparable(values: FloatArray) -> bool:
    """Tell whether one linear axis can show all of these."""
    return bool(values.min() > 0 and values.max() / values.min() <= _COMPARABLE)


def scale_for_totals(problem: Problem) -> Scale:
    """Choose the scale for sums over all agents."""
    if comparable(problem.capacity):
        return Scale(np.ones(problem.n_resources), units_of(problem))
    return Scale(problem.capacity, "share of the capacity")


def scale_for_agents(problem: Problem) -> Scale:
    """Choose the scale for amounts of single agents."""
    if comparable(problem.capacity):
        return Scale(np.ones(problem.n_resources), units_of(problem))
    return Scale(problem.capacity / problem.n_agents, "multiples of capacity / agents")


def units_of(problem: Problem, otherwise: str = "units as in the legend") -> str:
    """List the units of the resources for the label of an axis that they share."""
    units = dict.fromkeys(resource.unit for resource in problem.resources if resource.unit)
    text = ", ".join(units)
    return text if len(text) <= _LONGEST_UNIT else otherwise
