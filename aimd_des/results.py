"""What comes out of a run, as tidy pandas frames, and what it measures.

Frames are long: one row per time and resource (and agent).  Names are categoricals; demand and
average are in the units of the resource, times in steps or units of time.
"""

import warnings
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256

import numpy as np
import numpy.typing as npt
import pandas as pd

from aimd_des import metrics
from aimd_des.checks import FloatArray
from aimd_des.optimum import Optimum, solve_optimum
from aimd_des.problem import Problem
from aimd_des.recording import Observations, Signals

__all__ = ["Account", "Result"]

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Account:
    """What was communicated and how it was answered.

    Attributes
    ----------
    delivered, lost, in_flight : ndarray of int, shape (m,)
        Copies of the signals: each broadcast makes one for each agent.
    responses, saturated : ndarray of int, shape (m, n)
        Decreases of each agent, and those of them that had a response probability above 1.
    """

    delivered: IntArray
    lost: IntArray
    in_flight: IntArray
    responses: IntArray
    saturated: IntArray


class Result:
    """The outcome of one run.

    Parameters
    ----------
    problem : Problem
        What was shared.
    dynamics : str
        "discrete" or "continuous".
    seed : int
        The run's seed.
    until : float
        The end of the run.
    signals_sent : Signals
        The capacity events.
    observations : Observations
        What the observers saw.
    account : Account
        Copies and responses.

    Warns
    -----
    RuntimeWarning
        Once, if a response probability was above 1: the normalization factor is too large for
        these costs and Theorem 1 of the paper does not hold.
    """

    def __init__(
        self,
        problem: Problem,
        dynamics: str,
        seed: int,
        until: float,
        signals_sent: Signals,
        observations: Observations,
        account: Account,
    ) -> None:
        self.problem = problem
        self.dynamics = dynamics
        self.seed = seed
        self.until = until
        self.signals_sent = signals_sent
        self.observations = observations
        self.account = account
        saturated = int(account.saturated.sum())
        if saturated:
            warnings.warn(
                f"{saturated} of {int(account.responses.sum())} responses had a probability above 1 and were "
                "certain: the normalization factor is too large for these costs",
                RuntimeWarning,
                stacklevel=3,
            )

    @property
    def demand_at_end(self) -> FloatArray:
        """Demand of each agent at the end, shape (n, m), in units of the resources."""
        return self.observations.demand[-1].T

    @property
    def average_at_end(self) -> FloatArray:
        """Long-term average of each agent at the end, shape (n, m), in units of the resources."""
        return self.observations.average[-1].T

    def _category(self, codes: npt.NDArray[np.intp], names: tuple[str, ...]) -> pd.Categorical:
        return pd.Categorical.from_codes(codes, categories=list(names))

    @cached_property
    def signals(self) -> pd.DataFrame:
        """Capacity events: time, resource, number (from 0 for each resource)."""
        sent = self.signals_sent
        resource = self._category(sent.resource, self.problem.resource_names)
        return pd.DataFrame({"time": sent.time, "resource": resource, "number": sent.number})

    @cached_property
    def demand(self) -> pd.DataFrame:
        """Sums over the agents: time, resource, total (demand), average (of the averages)."""
        seen, m = self.observations, self.problem.n_resources
        count = len(seen.demand_times)
        return pd.DataFrame(
            {
                "time": np.repeat(seen.demand_times, m),
                "resource": self._category(np.tile(np.arange(m), count), self.problem.resource_names),
                "total": seen.total_demand.ravel(),
                "average": seen.total_average.ravel(),
            }
        )

    @cached_property
    def allocations(self) -> pd.DataFrame:
        """Every agent: time, camera, resource, demand, average."""
        seen, n, m = self.observations, self.problem.n_agents, self.problem.n_resources
        count = len(seen.allocation_times)
        resource = np.tile(np.repeat(np.arange(m), n), count)
        camera = np.tile(np.arange(n), count * m)
        return pd.DataFrame(
            {
                "time": np.repeat(seen.allocation_times, n * m),
                "camera": self._category(camera, self.problem.agent_names),
                "resource": self._category(resource, self.problem.resource_names),
                "demand": seen.demand.ravel(),
                "average": seen.average.ravel(),
            }
        )

    @cached_property
    def digest(self) -> str:
        """SHA-256 over signals, responses of every agent, and its demand and average at the end."""
        seen, sent = self.observations, self.signals_sent
        digest = sha256()
        for floats in (sent.time, seen.demand[-1], seen.average[-1]):
            digest.update(np.ascontiguousarray(floats, dtype="<f8").tobytes())
        for integers in (sent.resource, sent.number, self.account.responses, self.account.saturated):
            digest.update(np.ascontiguousarray(integers, dtype="<i8").tobytes())
        return digest.hexdigest()

    def summary(self, optimum: Optimum | None = None) -> pd.DataFrame:
        """Measure the run, one row per resource.

        Parameters
        ----------
        optimum : Optimum, optional
            The centralised solution of the run's problem; solved for unless given.

        Returns
        -------
        DataFrame
            Index: resource.  Columns: signals (bits broadcast), delivered, lost, in_flight
            (copies), responses, saturated (responses with probability above 1), utilisation,
            relative_error, misallocation (relative error against the optimum for the capacities
            actually used), consensus_spread, cost_ratio (of all resources together, repeated),
            overshoot_peak, overshoot_time, overshoot_mean (over the capacity, over all time, and
            over the capacity).
        """
        problem, account, average = self.problem, self.account, self.average_at_end
        best = solve_optimum(problem) if optimum is None else optimum
        used = average.sum(axis=0)
        reachable = solve_optimum(problem, capacity=used) if (used > 0).all() else None
        overshoot = self.observations.overshoot
        columns = {
            "signals": self.signals_sent.counts(problem.n_resources),
            "delivered": account.delivered,
            "lost": account.lost,
            "in_flight": account.in_flight,
            "responses": account.responses.sum(axis=1),
            "saturated": account.saturated.sum(axis=1),
            "utilisation": metrics.utilisation(average, problem.capacity),
            "relative_error": metrics.relative_error(average, best.allocation),
            "misallocation": np.full(problem.n_resources, np.nan)
            if reachable is None
            else metrics.relative_error(average, reachable.allocation),
            "consensus_spread": metrics.consensus_spread(problem.costs, average),
            "cost_ratio": metrics.cost_ratio(problem.costs, average, best.allocation),
            "overshoot_peak": overshoot.peak,
            "overshoot_time": overshoot.time,
            "overshoot_mean": overshoot.mean,
        }
        return pd.DataFrame(columns, index=pd.Index(problem.resource_names, name="resource"))
