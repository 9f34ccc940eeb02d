"""What a run hands over: signals, the account of copies, observations, and the problems in force."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.problem.costs import Costs
from aimd_des.results.metrics import Overshoot, Stretch
from aimd_des.utils.validation import FloatArray

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Signals:
    """The capacity events of a run, in the order in which they were broadcast.

    Attributes
    ----------
    time : ndarray, shape (s,)
        Time of the look that caused the broadcast.
    resource : ndarray of int, shape (s,)
        j.
    number : ndarray of int, shape (s,)
        b, counted from 0 for each resource.
    """

    time: FloatArray
    resource: npt.NDArray[np.int64]
    number: npt.NDArray[np.int64]

    def counts(self, n_resources: int) -> npt.NDArray[np.int64]:
        """Count the signals of each resource, shape (m,)."""
        return np.bincount(self.resource, minlength=n_resources)


@dataclass(frozen=True, eq=False)
class Account:
    """What was communicated and how it was answered.

    Attributes
    ----------
    delivered, lost, in_flight : ndarray of int, shape (m, n)
        Copies of the signals by what became of them: each broadcast makes one for each agent.
    duplicated : ndarray of int, shape (m, n)
        Duplicates that arrived besides.
    responses, saturated : ndarray of int, shape (m, n)
        Decreases of each agent, and those of them that had a response probability above 1.
    """

    delivered: IntArray
    lost: IntArray
    in_flight: IntArray
    duplicated: IntArray
    responses: IntArray
    saturated: IntArray


@dataclass(frozen=True, eq=False)
class Observations:
    """What the observers saw.

    Attributes
    ----------
    demand_times : ndarray, shape (q,)
        When totals were kept.
    total_demand, total_average : ndarray, shape (q, m)
        Sums over the agents of demand and of average, in units of the resources.
    allocation_times : ndarray, shape (r,)
        When allocations were kept; the last is the end of the run.
    demand, average : ndarray, shape (r, m, n)
        Of every agent, in units of the resources.
    overshoot : Overshoot
        Exact integrals over the whole run.
    second_half : ndarray, shape (m,)
        Mean total demand in the second half of the run over the capacity in force; NaN if not integrated.
    stretches : tuple of Stretch
        The same between interventions; empty if overshoot was not integrated.
    """

    demand_times: FloatArray
    total_demand: FloatArray
    total_average: FloatArray
    allocation_times: FloatArray
    demand: FloatArray
    average: FloatArray
    overshoot: Overshoot
    second_half: FloatArray
    stretches: tuple[Stretch, ...] = ()


class Piece(NamedTuple):
    """The problem that is in force from one intervention to the next.

    Attributes
    ----------
    start : float
        Since when, in units of time.
    capacity : ndarray, shape (m,)
        C, in units of the resources.
    present : ndarray of bool, shape (n,)
        Which agents take part.
    costs : Costs
        The private costs of all agents.
    """

    start: float
    capacity: FloatArray
    present: BoolArray
    costs: Costs
