"""A run in progress: taken as far as one likes, looked at in between, and ended."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast, get_args

from aimd_des.channel import Channel
from aimd_des.dynamics.responses import Response
from aimd_des.engine.arguments import Arguments
from aimd_des.engine.control_unit import ControlUnit
from aimd_des.engine.declared import Intervention
from aimd_des.engine.fork import check_data, load, salted, take_over
from aimd_des.engine.observers import observer_of
from aimd_des.engine.run_file import read_run, save_run
from aimd_des.engine.system import System
from aimd_des.results.result import Result
from aimd_des.utils import validation
from aimd_des.utils.errors import SimulationError
from aimd_des.utils.formatting import grouped
from aimd_des.utils.shown import Shown, ShowsItself

if TYPE_CHECKING:
    import pandas as pd

Step = Literal["event", "signal"]


class Source(Arguments, Protocol):
    """A simulation as its runs see it: it begins others, also after some of its arguments were replaced."""

    def replace(self, **parts: Any) -> "Source":
        """Make the same simulation but for some of its arguments."""
        ...

    def begin(self, until: float, salts: tuple[int, ...] = (), like: "Run | None" = None) -> "Run":
        """Begin a run, which may be the fork of another one."""
        ...


class Run(ShowsItself):
    """A run of a simulation in progress, made by `Simulation.start`.

    It may be advanced in any number of pieces: the result is that of `Simulation.run`, to the last bit.

    Parameters
    ----------
    simulation : Simulation
        Of which it is a run.
    system : System
        What happens in the run, as processes of one's own see it.
    salts : tuple of int
        Of the forks that have led here and were given draws of their own.
    conclude : callable
        Gathers the result at the end.

    Examples
    --------
    >>> from aimd_des import Simulation
    >>> from models import smart_cameras
    >>> run = Simulation(smart_cameras(0), seed=0).start(until=100.0)
    >>> run.advance(to=40.0)
    >>> run
    Run at 40 of 100; 60 agents share memory, disk, bandwidth
    >>> run.time, run.peek()
    (40.0, 40.0)
    >>> run.totals().index.tolist()
    ['memory', 'disk', 'bandwidth']
    >>> run.result().until
    100.0
    """

    def __init__(
        self,
        simulation: Source,
        system: System,
        salts: tuple[int, ...],
        conclude: Callable[[], Result],
    ) -> None:
        self.simulation, self.system, self.salts = simulation, system, salts
        self._conclude = conclude
        self._result: Result | None = None
        self._failed = self._going = False

    def _shown(self) -> Shown:
        # Not what agents hold now: a fleet would have to be taken to the present for it.
        problem = self.system.problem
        shared = ", ".join(problem.resource_names)
        when = f"{grouped(self.time)} of {grouped(self.until)}"
        return Shown(f"Run at {when}; {problem.n_agents:,} agents share {shared}")

    @property
    def until(self) -> float:
        """The end of the run, in units of time."""
        return self.system.until

    @property
    def time(self) -> float:
        """The present: what is due before it has happened, in units of time."""
        return float(self.system.env.now)

    def peek(self) -> float:
        """Tell when the next event is due.

        Returns
        -------
        float
            In units of time; infinity if there is none before the end.  Compiled agents have no events of
            their own: the next look of their control unit is one.
        """
        due = self.system.env.upcoming[0]
        return due if due < self.until else math.inf

    def advance(self, to: float | None = None, watch: Callable[[float, int], None] | None = None) -> None:
        """Handle every event before a time, and none that is due at that time.

        Parameters
        ----------
        to : float, optional
            Not before the present and not after the end, in units of time; default: the end.
        watch : callable, optional
            As for `Simulation.run`.

        Raises
        ------
        InputError
            If the time is out of its range, or a part of one's own hands back what it cannot.
        SimulationError
            If simulated time cannot advance, or an earlier piece of the run has failed.
        """
        goal = self.until if to is None else validation.number("to", to, low=self.time, high=self.until)
        if watch is not None:
            function = cast(type, Callable)  # which annotations know, and `isinstance` does
            validation.instance("watch", watch, function, "a function of simulated time and number of events")
        self._go(goal, watch)

    def step(self, kind: Step = "event") -> bool:
        """Handle the next event, or all until the next signal has been broadcast.

        Parameters
        ----------
        kind : {"event", "signal"}
            What to go on to.  An event may change nothing: a look may find demand below its threshold.

        Returns
        -------
        bool
            Whether there was one before the end; if not, the run stands at its end.

        Raises
        ------
        InputError, SimulationError
            As for `advance`.
        """
        validation.choice("kind", kind, get_args(Step))
        sent = self.system.transmitter.numbers
        before = int(sent.sum())
        while self.peek() < math.inf:
            self._go(self.until, one=True)
            if kind == "event" or int(sent.sum()) > before:
                return True
        self._go(self.until)
        return False

    def totals(self) -> "pd.DataFrame":
        """Look at the whole of each resource as it is now; this changes nothing in the run.

        Returns
        -------
        DataFrame
            Indexed by resource: ``demand`` and ``average``, both summed over the agents, and ``capacity`` in
            force, in units of the resource, and the number of ``signals`` broadcast so far.
        """
        import pandas as pd

        demand, average = self.system.allocations()
        return pd.DataFrame(
            {
                "demand": demand.sum(axis=1),
                "average": average.sum(axis=1),
                "capacity": self.system.conditions.pieces[-1].capacity,
                "signals": self.system.transmitter.numbers.copy(),
            },
            index=pd.Index(self.system.problem.resource_names, name="resource"),
        )

    def fork(
        self,
        salt: int | None = None,
        *,
        channel: Channel | None = None,
        control_unit: ControlUnit | None = None,
        response: Response | None = None,
        interventions: Sequence[Intervention] = (),
    ) -> "Run":
        """Begin another run where this one stands, which goes on unaffected.

        With nothing given, it ends as this one does, to the last bit.  What has been recorded is shared.

        Parameters
        ----------
        salt : int, optional
            At least 0, for other draws from now on: of responses, losses, latencies, duplicates and samples.
            Clocks keep theirs, and so do copies that are on their way. Default: the same draws.
        channel : Channel, optional
            Carries what is sent from now on, and begins as in a new run.
        control_unit : ControlUnit, optional
            Takes over now, and knows nothing of hold-offs.
        response : Response, optional
            How agents answer from now on; what the one before has kept is gone.
        interventions : sequence of Intervention
            What changes besides; each from now on, or later.

        Returns
        -------
        Run
            At the same time, with the same end.

        Raises
        ------
        InputError
            If agents or other parts of the run are processes, or a part of one's own cannot say what it
            remembers. If an argument is none that `Simulation` takes, or would act before now.
        SimulationError
            If the run has failed, is over, or is being advanced.
        """
        self._refuse_going("a run that is forked")
        check_data(self)
        given = {"channel": channel, "control_unit": control_unit, "response": response}
        parts: dict[str, Any] = {name: part for name, part in given.items() if part is not None}
        if interventions:
            more = validation.instances("interventions", interventions, Intervention, "an intervention")
            parts["interventions"] = (*self.simulation.interventions, *more)
        simulation = self.simulation.replace(**parts) if parts else self.simulation
        fresh = simulation.begin(self.until, salted(self.salts, salt), self)
        take_over(fresh, self, parts)
        return fresh

    def begin_measures(self) -> None:
        """Leave what has been until now out of the measures of the result: a warm-up.

        Its frames hold the whole run.  Averages over all of the past are measured over the time since now;
        other averages forget by themselves, and are measured as they are.

        Raises
        ------
        SimulationError
            As `fork` does, and if the run stands at its end.
        """
        self._refuse_going("a run whose measures begin")
        if self.time >= self.until:
            raise SimulationError(f"the run is over at time {self.time!r}: nothing is left to be measured")
        observer_of(self.system).begin_measures()

    def save(self, path: str | Path) -> None:
        """Write to a file where the run stands: `lowlevel.resume` goes on from there, and so does the run.

        Parameters
        ----------
        path : str or Path
            The file; one that is there is replaced as a whole.

        Raises
        ------
        InputError
            If the file cannot be written, and as `fork` does.
        SimulationError
            As `fork` does.
        """
        self._refuse_going("a run that is saved")
        save_run(self, validation.path("path", path))

    def _refuse_going(self, what: str) -> None:
        if self._result is not None:
            raise SimulationError(f"the run is over at time {self.time!r}: {what} must be in progress")
        self._refuse_moving(what)

    def _refuse_moving(self, what: str) -> None:
        if self._going:
            raise SimulationError(f"the run is being advanced: {what} must be stopped, between two pieces")
        if self._failed:
            raise SimulationError(f"the run has failed at time {self.time!r}: start another one")

    def result(self) -> Result:
        """Go on to the end, and give what `Simulation.run` gives.

        Returns
        -------
        Result
            The same object whenever it is asked for.

        Raises
        ------
        InputError, SimulationError
            As for `advance`.
        """
        if self._result is None:
            self._go(self.until)
            self._result = self._conclude()
        return self._result

    def _go(
        self, until: float, watch: Callable[[float, int], None] | None = None, *, one: bool = False
    ) -> None:
        """Let events happen, but none after one of them has failed: others may be missing since then."""
        self._refuse_moving("a run that goes on")
        self._failed = self._going = True
        try:
            self.system.env.run_to(until, watch, one=one)
        finally:
            self._going = False
        self._failed = False


def completed(run: Run, watch: Callable[[float, int], None] | None, progress: bool) -> Result:
    """Advance a run to its end, and show how far it is if that is wanted."""
    if progress:
        from aimd_des.utils.progress import RunProgress, both  # rich is slow to import

        with RunProgress(run.until) as shown:
            run.advance(watch=both(shown.update, watch))
    else:
        run.advance(watch=watch)
    return run.result()


def resume(path: str | Path, simulation: Source) -> "Run":
    """Go on with a run that `Run.save` has written to a file.

    Parameters
    ----------
    path : str or Path
        The file.
    simulation : Simulation
        Of which it was a run, made anew of the same arguments: the file holds what has happened, and not
        what the parts are.  Functions of one's own are compared by their names alone.

    Returns
    -------
    Run
        At the time at which it was saved; it ends as that run does, to the last bit.

    Raises
    ------
    InputError
        If the file cannot be read, is damaged or of another version, or the simulation is another one.
    """
    until, salts, state = read_run(validation.path("path", path), simulation)
    fresh = simulation.begin(until, salts)
    load(fresh, state, set())
    return fresh
