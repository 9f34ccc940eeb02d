"""What comes out of a run, as tidy pandas frames, and what it measures.

Frames are long: one row per time and resource (and agent).  Names are categoricals; demand and
average are in the units of the resource, times in steps or units of time.
"""

import math
import warnings
from bisect import bisect_right
from collections.abc import Sequence
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from aimd_des.problem.optimum import Optimum
from aimd_des.problem.problem import Problem
from aimd_des.results.convergence import convergence_frame
from aimd_des.results.event_log import EventLog
from aimd_des.results.frames import categorical
from aimd_des.results.measures import MEASURED, MEASURES, Measured, summary_frame
from aimd_des.results.overload import Opportunities, overload_words, run_away
from aimd_des.results.representation import UNSOLVED, shown_result
from aimd_des.results.run_data import Account, Observations, Piece, Rest, Signals
from aimd_des.results.tracking import Distance, PieceOptima, pieces_frame, recovery_frame, tracking_frame
from aimd_des.utils import validation
from aimd_des.utils.actions import registered
from aimd_des.utils.errors import InputError, OverloadWarning, level_outside
from aimd_des.utils.shown import Shown, ShowsItself
from aimd_des.utils.validation import FloatArray

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class Result(ShowsItself):
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
        The problems that were in force one after another; default: the one problem.
    bits_per_signal : int
        What a signal costs.
    opportunities : Opportunities, optional
        When the control unit may signal, in the second half of the run, or in the rest.
    rest : Rest, optional
        What the measures are taken of, where they leave the beginning out.

    Attributes
    ----------
    history : tuple of Piece
        The problems that were in force.
    run_away : ndarray of bool, shape (m,)
        Whether demand has run away from the capacity; False where that is not known.

    Warns
    -----
    RuntimeWarning
        Once, if a response probability was above 1: the normalization factor is too large for
        these costs and Theorem 1 of the paper does not hold.
    OverloadWarning
        Once, if demand has run away from a capacity.
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
        opportunities: Opportunities | None = None,
        rest: Rest | None = None,
    ) -> None:
        self.problem = problem
        self.dynamics = dynamics
        self.seed = seed
        self.until = until
        self.signals_sent = signals_sent
        self.observations = observations
        self.account = account
        self.log = log
        only = Piece(0.0, problem.capacity, np.ones(problem.n_agents, dtype=np.bool_), problem.costs)
        self.history = tuple(pieces) or (only,)
        self.bits_per_signal = bits_per_signal
        self.rest = rest
        #: What was run from the beginning, a simulation or a scenario, as far as it is known.
        self.origin: object = None
        # What has been measured and took an optimum, for the representation, which solves for none.
        self._misallocation: npt.NDArray[Any] | None = None
        mean = observations.second_half
        unknown = Opportunities(math.inf, 0.0)
        since = None if rest is None else rest.start
        self.run_away = run_away(signals_sent, mean, until, opportunities or unknown, since)
        if self.run_away.any():
            words = overload_words(problem.resource_names, mean, self.run_away, self.judged)
            warnings.warn(words, OverloadWarning, stacklevel=level_outside())
        saturated = int(account.saturated.sum())
        if saturated:
            warnings.warn(
                f"{saturated} of {int(account.responses.sum())} responses had a probability above 1, which "
                "was cut off: the normalization factor is too large for these costs",
                RuntimeWarning,
                stacklevel=level_outside(),
            )

    def __getstate__(self) -> dict[str, Any]:
        # What was run may hold functions that cannot be sent to another process.
        return {**self.__dict__, "origin": None}

    @property
    def judged(self) -> str:
        """The part of the run by which is judged whether demand has run away."""
        return "second half of the run" if self.rest is None else "run after its warm-up"

    @property
    def demand_at_end(self) -> FloatArray:
        """Demand of each agent at the end, shape (n, m), in units of the resources."""
        return np.asarray(self.observations.demand[-1].T)

    @property
    def average_at_end(self) -> FloatArray:
        """Long-term average of each agent at the end, shape (n, m), in units of the resources."""
        return np.asarray(self.observations.average[-1].T)

    @cached_property
    def signals(self) -> "pd.DataFrame":
        """Capacity events: time, resource, number (from 0 for each resource)."""
        import pandas as pd

        sent = self.signals_sent
        resource = categorical(sent.resource, self.problem.resource_names)
        return pd.DataFrame({"time": sent.time, "resource": resource, "number": sent.number})

    @cached_property
    def demand(self) -> "pd.DataFrame":
        """Sums over all agents: time, resource, total (demand), average (of the averages).

        Averages of agents that are away are in it as they were when they left; `tracking` leaves them out.
        """
        import pandas as pd

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
    def allocations(self) -> "pd.DataFrame":
        """Every agent: time, agent, resource, demand, average."""
        import pandas as pd

        seen, n, m = self.observations, self.problem.n_agents, self.problem.n_resources
        count = len(seen.allocation_times)
        resource = np.tile(np.repeat(np.arange(m), n), count)
        agent = np.tile(np.arange(n), count * m)
        return pd.DataFrame(
            {
                "time": np.repeat(seen.allocation_times, n * m),
                "agent": categorical(agent, self.problem.agent_names),
                "resource": categorical(resource, self.problem.resource_names),
                "demand": seen.demand.ravel(),
                "average": seen.average.ravel(),
            }
        )

    @cached_property
    def events(self) -> "pd.DataFrame":
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

    @property
    def optimum(self) -> Optimum | None:
        """The centralised solution in force at the end, for the agents that are here; None without any."""
        return self.optimum_of(self.history[-1])

    def piece_at(self, time: float) -> Piece:
        """Look up which problem was in force.

        Parameters
        ----------
        time : float
            When, from 0 on.

        Returns
        -------
        Piece
            One of the history.
        """
        return self.history[bisect_right(self.history, time, key=lambda piece: piece.start) - 1]

    def optimum_of(self, piece: Piece, at_end: Optimum | None = None) -> Optimum | None:
        """Give the optimum that a piece of the run is compared with, for all callers.

        Parameters
        ----------
        piece : Piece
            One of the history.
        at_end : Optimum, optional
            What stands for the optimum of the problem at the end, and of pieces with the same problem.

        Returns
        -------
        Optimum or None
            With the allocations of the agents that were here; None where there were none.

        Raises
        ------
        InputError
            If `at_end` is for another number of agents or resources.
        SimulationError
            If it is not found.
        """
        if at_end is None:
            return self._optima(piece)
        validation.instance("optimum", at_end, Optimum, "an Optimum, such as solve_optimum(problem)")
        last = self.history[-1]
        shape = (int(last.present.sum()), self.problem.n_resources)
        if at_end.allocation.shape != shape:
            allowed = f"{shape}, for the agents that are here at the end"
            remedy = "leave it out, and it is solved for"
            raise InputError.of("shape of optimum.allocation", at_end.allocation.shape, allowed, remedy)
        return at_end if PieceOptima.key(piece) == PieceOptima.key(last) else self._optima(piece)

    @cached_property
    def pieces(self) -> "pd.DataFrame":
        """What was in force from one intervention to the next, and what total demand did.

        Columns: start, end, resource, capacity, agents (that were here), multiplier and optimal_cost (of the
        optimum for these), utilisation (mean total demand over the capacity), overshoot_peak,
        overshoot_time and overshoot_mean (as in the summary).
        """
        return pieces_frame(self.problem, self.history, self._optima, self.until, self.observations)

    @cached_property
    def tracking(self) -> "pd.DataFrame":
        """The averages against the optimum in force, at the times at which allocations were recorded.

        Columns: time, resource, capacity, level (sum of the averages over the capacity), relative_error; of
        the agents that are here at the time, while `demand` sums over all.
        """
        return tracking_frame(self.problem, self.history, self._optima, self.observations)

    def convergence(self, looks: int | None = None) -> "pd.DataFrame":
        """Measure how near averages were to the optimum over time.

        Parameters
        ----------
        looks : int, optional
            At how many recorded times at most, evenly spread over the logarithm of time; default: 16, and
            fewer for more than 6,250 agents, since each is an optimum to be solved.

        Returns
        -------
        DataFrame
            Columns: time, resource, misallocation, relative_error, and cost_ratio (of all resources
            together, repeated); of the agents that are here at the time, against the problem in force.

        Raises
        ------
        InputError
            If `looks` is less than 1.

        Notes
        -----
        Unless allocations are recorded (``Recording(allocations="auto")``), there are rows of the end alone.

        See Also
        --------
        aimd_des.Simulation.convergence : What theory expects.
        """
        count = None if looks is None else validation.integer("looks", looks, low=1)
        return convergence_frame(self.problem, self.observations, self.piece_at, self.optimum_of, count)

    def recovery(
        self,
        measure: Distance = "level",
        within: float = 0.05,
        of: Literal["level", "change"] = "level",
    ) -> "pd.DataFrame":
        """Measure how long averages took to recover from each change of the problem.

        Parameters
        ----------
        measure : {"level", "relative_error", "misallocation"}
            What has to be small, of the agents that are present. With "level" it is the distance of the
            sum of the averages from the capacity, over the capacity. With "relative_error" it is the
            error against the optimum in force. With "misallocation" it is the error against the optimum
            for what is used, which is solved for at every recorded time.
        within : float
            How small, between 0 and 1.
        of : {"level", "change"}
            Whether `within` is the limit itself, a share of what averages should be, or a share of what the
            measure was when the problem changed.

        Returns
        -------
        DataFrame
            Columns: start and end (of what is in force), resource, recovery_time (since the start, in units
            of time), with rows for all problems but the first.  The time is 0 where averages were always
            within the limit, inf where they do not stay within until the end, and NaN where no agent is here
            or nothing was recorded.

        Notes
        -----
        Allocations must be recorded, such as with ``Recording(allocations=1.0)``.  Between two recorded times
        the distance is taken for a line.

        See Also
        --------
        aimd_des.theory.recovery_time : What to expect.
        """
        measures, parts = get_args(Distance), ("level", "change")
        validation.known("measure", measure, measures)
        validation.known("of", of, parts)
        near = validation.number("within", within, low=0.0, low_open=True, high=1.0, high_open=True)
        seen = self.observations
        return recovery_frame(self.problem, self.history, self._optima, self.until, seen, measure, near, of)

    def _last_recovery(self) -> FloatArray:
        if len(self.history) == 1:
            return np.full(self.problem.n_resources, np.nan)
        return self.recovery()["recovery_time"].to_numpy()[-self.problem.n_resources :]

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

    def summary(self, optimum: Optimum | None = None) -> "pd.DataFrame":
        """Measure the run, one row per resource.

        Where interventions have changed the problem, averages are held against the one in force at the end,
        for the agents that are here then: see `pieces` and `tracking` for the way there.

        Parameters
        ----------
        optimum : Optimum, optional
            The centralised solution of that problem; default: solved for.

        Returns
        -------
        DataFrame
            Index: resource.  Columns: the measures, whose units and meanings `metrics.measures()` lists, and
            so do ``attrs["units"]`` and ``attrs["meanings"]``.  What is measured of the agents that are here
            is NaN where there are none.

        Raises
        ------
        InputError
            If the optimum is for another number of agents.
        """
        return summary_frame(self.measures(optimum), self.problem.resource_names)

    def measures(
        self, optimum: Optimum | None = None, names: Sequence[str] | None = None
    ) -> dict[str, npt.NDArray[Any]]:
        """Measure the run: what `summary` puts into a frame.

        Parameters
        ----------
        optimum : Optimum, optional
            As for `summary`.
        names : sequence of str, optional
            Which measures; default: the columns of `summary`.  Those that are left out cost nothing.

        Returns
        -------
        dict of ndarray, shape (m,)
            A value for each resource.

        Raises
        ------
        InputError
            As `summary` does.
        """
        last, rest = self.history[-1], self.rest
        if optimum is not None:
            self.optimum_of(last, optimum)  # refuses one that does not fit, for any measure
        run = Measured(
            problem=self.problem,
            last=last,
            everybody=self.average_at_end if rest is None else rest.average,
            signals=self.signals_sent.counts(self.problem.n_resources) if rest is None else rest.signals,
            bits_per_signal=self.bits_per_signal,
            account=self.account if rest is None else rest.account,
            overshoot=self.observations.overshoot,
            optimum=lambda: self.optimum_of(last, optimum),
            recovery=self._last_recovery,
        )
        found = {name: MEASURES[name].of(run) for name in (MEASURED if names is None else names)}
        self._misallocation = found.get("misallocation", self._misallocation)
        return found

    def plot(self, kind: str = "overview", **options: Any) -> "Figure":
        """Draw a figure of the run.

        Parameters
        ----------
        kind : str
            "overview", or the name of a panel of `aimd_des.plots`, such as "demand_and_signals".
        **options
            What the panel takes besides axes and result, such as ``start=400.0`` or ``resource=0``.

        Returns
        -------
        Figure
            Of Matplotlib, which notebooks show; ``figure.savefig`` writes it.

        Raises
        ------
        InputError
            If there is no such kind, or it takes no such option, or needs another one.
        """
        figure: Figure = registered("plot")(self, kind, **options)
        return figure

    def save(self, folder: str | Path, *, overwrite: bool = False, figures: bool = False) -> None:
        """Write the folder of the run, as ``aimd-des run`` does; `aimd_des.study.load` reads it.

        Parameters
        ----------
        folder : str or Path
            New or empty.
        overwrite : bool
            Whether a folder that an earlier run wrote is replaced.
        figures : bool
            Whether to draw the figures, too.

        Raises
        ------
        InputError
            If the folder is taken, or a scenario file cannot describe the run. It cannot describe
            functions and parts of one's own that are not registered, pieces, forks and `run_synchronous`.
        """
        registered("save")(self, folder, overwrite=overwrite, figures=figures)

    def _shown(self) -> Shown:
        run = f"{self.dynamics}, seed {self.seed}, until {self.until:,g}"
        known = self.measures(names=UNSOLVED)
        return shown_result(run, self.problem, self.run_away, known, self._misallocation)
