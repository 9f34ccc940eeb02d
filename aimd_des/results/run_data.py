"""What a run hands over: signals, the account of copies, observations, and the problems in force."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aimd_des.problem.costs import Costs
from aimd_des.results.metrics import Overshoot, Stretch
from aimd_des.utils.validation import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Signals:
    """The capacity events of a run, in the order in which they were broadcast."""

    time: FloatArray  # (s,): time of the look that caused the broadcast
    resource: IntArray  # (s,): j
    number: IntArray  # (s,): b, counted from 0 for each resource

    def counts(self, n_resources: int) -> IntArray:
        """Count the signals of each resource, shape (m,)."""
        return np.bincount(self.resource, minlength=n_resources)


@dataclass(frozen=True, eq=False)
class Account:
    """What was communicated and how it was answered."""

    # (m, n): copies of the signals by what became of them: each broadcast makes one for each agent.
    delivered: IntArray
    lost: IntArray
    in_flight: IntArray
    duplicated: IntArray  # (m, n): duplicates that arrived besides
    # (m, n): decreases of each agent, and those of them whose response probability was cut off.
    responses: IntArray
    saturated: IntArray


@dataclass(frozen=True, eq=False)
class Observations:
    """What the observers saw."""

    demand_times: FloatArray  # (q,): when totals were kept
    # (q, m): sums over the agents of demand and of average, in units of the resources.
    total_demand: FloatArray
    total_average: FloatArray
    allocation_times: FloatArray  # (r,): when allocations were kept; the last is the end of the run
    # (r, m, n): of every agent, in units of the resources.
    demand: FloatArray
    average: FloatArray
    overshoot: Overshoot  # exact integrals over all that is measured
    # (m,): mean total demand in the second half of the run, or in all that is measured where the beginning is
    # left out, over the capacity in force; NaN if not integrated.
    second_half: FloatArray
    # The same between interventions; empty if overshoot was not integrated.
    stretches: tuple[Stretch, ...] = ()


class Rest(NamedTuple):
    """What has happened in a run since its measures began, where they leave its beginning out."""

    start: float  # since when, in units of time
    signals: IntArray  # (m,): how many were broadcast
    account: Account  # what became of their copies, and the responses since then
    average: FloatArray  # (n, m): averages over that time, in units of the resources


class Piece(NamedTuple):
    """The problem that is in force from one intervention to the next."""

    start: float  # since when, in units of time
    capacity: FloatArray  # (m,): C, in units of the resources
    present: BoolArray  # (n,): which agents take part
    costs: Costs  # the private costs of all agents
