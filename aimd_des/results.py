"""What comes out of a run, as tidy pandas frames, and what it measures.

Frames are long: one row per time and resource (and agent).  Names are categoricals; demand and
average are in the units of the resource, times in steps or units of time.
"""

import warnings
from collections.abc import Callable, Sequence
from functools import cache, cached_property
from hashlib import sha256
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from aimd_des import metrics
from aimd_des.checks import FloatArray
from aimd_des.conditions import Piece
from aimd_des.errors import InputError
from aimd_des.frames import categorical
from aimd_des.log import EventLog
from aimd_des.optimum import Optimum, solve_optimum
from aimd_des.problem import Problem
from aimd_des.recording import Account, Observations, Signals
from aimd_des.tracking import PieceOptima, piece_problem, pieces_frame, tracking_frame

__all__ = ["Result"]


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
    log : EventLog, optional
        Every event, if it was asked for.
    pieces : sequence of Piece
        The problems that were in force one after another; the one problem unless given.
    bits_per_signal : int
        What a signal costs.

    Attributes
    ----------
    history : tuple of Piece
        The problems that were in force.

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
        log: EventLog | None = None,
        *,
        pieces: Sequence[Piece] = (),
        bits_per_signal: int = 1,
    ) -> None:
        self.problem = problem
        self.dynamics = dynamics
        self.seed = seed
        self.until = until
        self.signals_sent = signals_sent
        self.observations = observations
        self.account = account
        self.log = log
        everybody = np.ones(problem.n_agents, dtype=np.bool_)
        only = Piece(0.0, problem.capacity, everybody, problem.costs)
        self.history = tuple(pieces) or (only,)
        self.bits_per_signal = bits_per_signal
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
        return np.asarray(self.observations.demand[-1].T)

    @property
    def average_at_end(self) -> FloatArray:
        """Long-term average of each agent at the end, shape (n, m), in units of the resources."""
        return np.asarray(self.observations.average[-1].T)

    @cached_property
    def signals(self) -> pd.DataFrame:
        """Capacity events: time, resource, number (from 0 for each resource)."""
        sent = self.signals_sent
        resource = categorical(sent.resource, self.problem.resource_names)
        return pd.DataFrame({"time": sent.time, "resource": resource, "number": sent.number})

    @cached_property
    def demand(self) -> pd.DataFrame:
        """Sums over all agents: time, resource, total (demand), average (of the averages).

        Averages of those who are away are in it as they stood when they left; `tracking` leaves them out.
        """
        seen, m = self.observations, self.problem.n_resources
        count = len(seen.demand_times)
        return pd.DataFrame(
            {
                "time": np.repeat(seen.demand_times, m),
                "resource": categorical(np.tile(np.arange(m), count), self.problem.resource_names),
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
                "camera": categorical(camera, self.problem.agent_names),
                "resource": categorical(resource, self.problem.resource_names),
                "demand": seen.demand.ravel(),
                "average": seen.average.ravel(),
            }
        )

    @cached_property
    def events(self) -> pd.DataFrame:
        """The event log: time, kind, resource, agent, number, value.

        Raises
        ------
        InputError
            If the run kept none.
        """
        if self.log is None:
            raise InputError("events: the run kept no log; run it with Recording(events=True)")
        return self.log.frame(self.problem.resource_names, self.problem.agent_names)

    @cached_property
    def _optima(self) -> PieceOptima:
        return PieceOptima(self.problem)

    @cached_property
    def pieces(self) -> pd.DataFrame:
        """What was in force from one intervention to the next, and what total demand did.

        Columns: start, end, resource, capacity, agents (who were here), multiplier and optimal_cost (of the
        optimum for these), utilisation (mean total demand over the capacity), overshoot_peak,
        overshoot_time and overshoot_mean (as in the summary).
        """
        return pieces_frame(self.problem, self.history, self._optima, self.until, self.observations)

    @cached_property
    def tracking(self) -> pd.DataFrame:
        """The averages against the optimum in force, at the times at which allocations were recorded.

        Columns: time, resource, capacity, level (sum of the averages over the capacity), relative_error; of
        those who are here at the time, while `demand` sums over all.
        """
        return tracking_frame(self.problem, self.history, self._optima, self.observations)

    @cached_property
    def digest(self) -> str:
        """SHA-256 over signals, responses, demands and averages at the end, and the log if it was kept.

        It says nothing about how a run was done: the synchronous algorithm and an event-driven
        run that equals it have the same digest.
        """
        seen, sent = self.observations, self.signals_sent
        digest = sha256()
        for floats in (sent.time, seen.demand[-1], seen.average[-1]):
            digest.update(np.ascontiguousarray(floats, dtype="<f8").tobytes())
        for integers in (sent.resource, sent.number, self.account.responses, self.account.saturated):
            digest.update(np.ascontiguousarray(integers, dtype="<i8").tobytes())
        if self.log is not None:
            time, entry, value = self.log.columns()
            for column, kind in ((time, "<f8"), (entry, "<i8"), (value, "<f8")):
                digest.update(np.ascontiguousarray(column, dtype=kind).tobytes())
        return digest.hexdigest()

    def summary(self, optimum: Optimum | None = None) -> pd.DataFrame:
        """Measure the run, one row per resource.

        Where interventions have changed the problem, averages are held against the one in force at the end,
        for those who are here then: see `pieces` and `tracking` for the way there.

        Parameters
        ----------
        optimum : Optimum, optional
            The centralised solution of that problem; solved for unless given.

        Returns
        -------
        DataFrame
            Index: resource.  Columns: signals, bits (what they cost), delivered, lost, in_flight
            and duplicated (copies), responses, saturated (responses with probability above 1), utilisation,
            relative_error, misallocation (relative error against the optimum for the capacities
            actually used), consensus_spread, cost_ratio (of all resources together, repeated),
            overshoot_peak, overshoot_time, overshoot_mean (over the capacity, over all time, and
            over the capacity).

        Raises
        ------
        InputError
            If nobody is here at the end, or the optimum is for another number of agents.
        """
        return pd.DataFrame(
            self.measures(optimum), index=pd.Index(self.problem.resource_names, name="resource")
        )

    def measures(
        self, optimum: Optimum | None = None, names: Sequence[str] | None = None
    ) -> dict[str, npt.NDArray[Any]]:
        """Measure the run: what `summary` puts into a frame.

        Parameters
        ----------
        optimum : Optimum, optional
            As for `summary`.
        names : sequence of str, optional
            Which of its columns; all unless given.  Those that are left out cost nothing.

        Returns
        -------
        dict of ndarray, shape (m,)
            A value for each resource.

        Raises
        ------
        InputError
            As `summary` does.
        """
        here = self.history[-1].present
        if not here.any():
            raise InputError("summary: nobody is here at the end of the run; see pieces and tracking instead")
        problem, account = piece_problem(self.problem, self.history[-1]), self.account
        average, overshoot = self.average_at_end[here], self.observations.overshoot
        if optimum is not None and optimum.allocation.shape != average.shape:
            allowed = f"{average.shape}, for those who are here at the end"
            raise InputError.of("shape of optimum.allocation", optimum.allocation.shape, allowed)
        counts = self.signals_sent.counts(problem.n_resources)

        @cache
        def best() -> FloatArray:
            return (solve_optimum(problem) if optimum is None else optimum).allocation

        def misallocation() -> FloatArray:
            used = average.sum(axis=0)
            if not (used > 0).all():
                return np.full(problem.n_resources, np.nan)
            return metrics.relative_error(average, solve_optimum(problem, capacity=used).allocation)

        ways: dict[str, Callable[[], Any]] = {
            "signals": lambda: counts,
            "bits": lambda: self.bits_per_signal * counts,
            "delivered": lambda: account.delivered.sum(axis=1),
            "lost": lambda: account.lost.sum(axis=1),
            "in_flight": lambda: account.in_flight.sum(axis=1),
            "duplicated": lambda: account.duplicated.sum(axis=1),
            "responses": lambda: account.responses.sum(axis=1),
            "saturated": lambda: account.saturated.sum(axis=1),
            "utilisation": lambda: metrics.utilisation(average, problem.capacity),
            "relative_error": lambda: metrics.relative_error(average, best()),
            "misallocation": misallocation,
            "consensus_spread": lambda: metrics.consensus_spread(problem.costs, average),
            "cost_ratio": lambda: np.full(
                problem.n_resources, metrics.cost_ratio(problem.costs, average, best())
            ),
            "overshoot_peak": lambda: overshoot.peak,
            "overshoot_time": lambda: overshoot.time,
            "overshoot_mean": lambda: overshoot.mean,
        }
        return {name: ways[name]() for name in (ways if names is None else names)}
