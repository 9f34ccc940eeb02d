"""Puts control unit, channel, agents and observers together and runs them: wiring, no rules."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast, get_args

from aimd_des.channel import BroadcastChannel, Channel
from aimd_des.dynamics.averaging import Averaging, Cumulative
from aimd_des.dynamics.clocks import Clocks
from aimd_des.dynamics.demand import CONTINUOUS, DISCRETE, Dynamics
from aimd_des.dynamics.loss_compensation import Compensation
from aimd_des.dynamics.responses import Response
from aimd_des.dynamics.state import rule_parameters
from aimd_des.engine.agent_process import AgentProcess
from aimd_des.engine.control_unit import ControlUnit, CrossingTable, Sampled, table_of
from aimd_des.engine.declared import Intervention, check_absences, check_end, check_hold_offs
from aimd_des.engine.delivery import Agent, ProcessGenerator
from aimd_des.engine.environment import Maker as ProcessMaker
from aimd_des.engine.observers import Observer, observer_of
from aimd_des.engine.planned_changes import Agenda, Planned, is_planned
from aimd_des.engine.run_in_progress import Run, completed
from aimd_des.engine.system import System, keys_of
from aimd_des.problem.problem import Problem, shared_words
from aimd_des.results.event_log import EventLog
from aimd_des.results.recording import Recording
from aimd_des.results.result import Result
from aimd_des.results.run_data import Account
from aimd_des.utils import returned_values, validation
from aimd_des.utils.actions import registered
from aimd_des.utils.errors import InputError
from aimd_des.utils.replaced import replaced
from aimd_des.utils.shown import Shown, ShowsItself

if TYPE_CHECKING:
    from aimd_des.theory import Convergence

Maker = Callable[[int, System], Agent]


class Population(Protocol):
    """All agents of a run, but for the special ones, in a representation of their own, such as `Fleet`."""

    def populate(
        self, system: System, absent: Collection[int], control_unit: ControlUnit, observer: Observer
    ) -> ProcessMaker:
        """Bring the agents into a run; say how the process of the control unit is made."""
        ...


_FUNCTION = cast(type, Callable)  # which annotations know, and `isinstance` does

# For each part its class, and what a refusal of another thing says: what is allowed, and a remedy.
_PARTS: dict[str, tuple[type, str, str]] = {
    "control_unit": (ControlUnit, "a control unit, such as Sampled(1.0) or Crossing(1.0)", ""),
    "channel": (
        Channel,
        "a channel, such as BroadcastChannel or topology.tree(graph)",
        "models of latency and loss go into one: BroadcastChannel(latency=..., loss=...)",
    ),
    "clocks": (Clocks, "Clocks", ""),
    "averaging": (Averaging, "an averaging, such as averaging.Window(100.0)", ""),
    "compensation": (Compensation, "a compensation, such as compensation.KnownLoss(0.1)", ""),
    "response": (Response, "a response, such as responses.EventNormalised()", ""),
    "recording": (Recording, "a Recording, such as Recording(events=True)", ""),
}


def _refuse_strangers(**parts: object) -> None:
    """Refuse parts that are another kind of thing; None stands for what holds unless it is given."""
    for name, part in parts.items():
        if part is not None:
            validation.instance(name, part, *_PARTS[name])


def _check_maker(field: str, maker: object) -> None:
    """Refuse what makes no agents; what a function returns is seen when it is called."""
    # A class can be asked for what its agents will have.
    if not callable(maker) or (isinstance(maker, type) and not hasattr(maker, "receive")):
        raise InputError.of(field, maker, "a class or function that makes an agent, such as AgentProcess")


def _known_agents(agents: Any) -> Any:
    """Take the words of scenario files for what they stand for, and refuse what makes no agents."""
    if isinstance(agents, str):
        validation.known("agents", agents, ("process", "fleet"))
        return registered("fleet") if agents == "fleet" else AgentProcess
    if not hasattr(agents, "populate"):
        _check_maker("agents", agents)
    return agents


class Simulation(ShowsItself):
    """A system of agents, a control unit and a channel, on SimPy.

    Parameters
    ----------
    problem : Problem
        What is shared, by how many, at what cost.
    dynamics : {"discrete", "continuous"}
        Discrete agents act at the ticks of their clocks; continuous ones grow all the time and
        answer a signal when it arrives.
    control_unit : ControlUnit, optional
        Default: `Sampled` with period 1.
    channel : Channel, optional
        Default: a perfect `BroadcastChannel` (no latency, no loss).
    agents : callable, Fleet, "process" or "fleet"
        Makes an agent from (index, system), by default `AgentProcess`; or `Fleet`: all agents in compiled
        code, with the same events.  The words of scenario files stand for these two.
    special : mapping of int to callable
        Agents that are not as the others: makes those with these indices from (index, system).
    clocks : Clocks, optional
        Of discrete agents. Default: tick q at time q for all.
    averaging : Averaging, optional
        How agents average their demand; default: `averaging.Cumulative`, the paper's.
    compensation : Compensation, optional
        What agents do about signals that they lose; default: nothing.
    response : Response, optional
        How agents answer signals; default: `responses.Randomised`, the paper's rule.
    interventions : sequence of Intervention
        What changes from outside while the run goes on, see `aimd_des.interventions`.
    seed : int
        At least 0.  Decides responses, losses, latencies and clocks, each from a stream of its own.
    recording : Recording, optional
        What to keep besides signals and end; default: totals at a thousand times.
    processes : sequence of callable
        Your own SimPy processes: each is called with the system and returns a generator.

    Raises
    ------
    InputError
        If an argument is outside its range, or a combination makes no sense.

    Notes
    -----
    With discrete agents, clocks in phase, no loss and latency in (0, period] a run equals
    `run_synchronous` to the last bit; with latency 0 it equals ``run_synchronous(lag=0)``.
    """

    def __init__(
        self,
        problem: Problem,
        *,
        dynamics: Dynamics = "discrete",
        control_unit: ControlUnit | None = None,
        channel: Channel | None = None,
        agents: Maker | Population | Literal["process", "fleet"] = AgentProcess,
        special: Mapping[int, Maker] | None = None,
        clocks: Clocks | None = None,
        averaging: Averaging | None = None,
        compensation: Compensation | None = None,
        response: Response | None = None,
        interventions: Sequence[Intervention] = (),
        seed: int,
        recording: Recording | None = None,
        processes: Sequence[Callable[[System], ProcessGenerator]] = (),
    ) -> None:
        # All that can be refused is refused here: `run` may be called in another process, hours later.
        validation.instance("problem", problem, Problem, "a Problem")
        validation.choice("dynamics", dynamics, get_args(Dynamics))
        _refuse_strangers(
            control_unit=control_unit,
            channel=channel,
            clocks=clocks,
            averaging=averaging,
            compensation=compensation,
            response=response,
            recording=recording,
        )
        if dynamics == "continuous" and clocks is not None:
            remedy = "leave clocks out, or choose discrete dynamics"
            raise InputError.of("clocks", clocks, "None with continuous agents, which have no ticks", remedy)
        if isinstance(table_of(control_unit), CrossingTable) and dynamics == "discrete":
            reason = "a Sampled with discrete agents: their demand jumps at ticks and crosses nothing"
            raise InputError.of("control_unit", control_unit, reason, "or choose continuous dynamics")
        agents = _known_agents(agents)
        self.seed = validation.integer("seed", seed, low=0)
        tick_weight = DISCRETE if dynamics == "discrete" else CONTINUOUS
        # And what does not fit the agents.
        rule_parameters(problem.n_agents, tick_weight, averaging, compensation, response)
        changes = validation.instances("interventions", interventions, Intervention, "an intervention")
        for intervention in changes:
            returned_values.check(intervention, problem)
        # After the others: it looks agents up, which must exist.
        check_absences(problem, changes)
        check_hold_offs(changes, control_unit)
        self.problem = problem
        self.dynamics: Dynamics = dynamics
        self.control_unit = Sampled() if control_unit is None else control_unit
        self.channel = BroadcastChannel() if channel is None else channel
        self.agents = agents
        self.special = self._checked(special)
        self._has_own_clocks = clocks is not None
        self.clocks = Clocks() if clocks is None and dynamics == "discrete" else clocks
        self.averaging = Cumulative() if averaging is None else averaging
        self.compensation, self.response = compensation, response
        self.interventions = changes
        self.recording = Recording() if recording is None else recording
        self.processes = validation.instances("processes", processes, _FUNCTION, "a function of the system")

    def _shown(self) -> Shown:
        given = {
            "averaging": repr(self.averaging),
            "response": repr(self.response),
            "compensation": repr(self.compensation),
            "special agents": f"{len(self.special):,}",
            "interventions": f"{len(self.interventions):,}",
            "processes": f"{len(self.processes):,}",
        }
        idle = {"None", "0", repr(Cumulative())}
        others = [f"{name} {words}" for name, words in given.items() if words not in idle]
        rows = [
            ["control unit", repr(self.control_unit)],
            ["channel", repr(self.channel)],
            ["agents", getattr(self.agents, "__name__", repr(self.agents))],
            *([["besides", ", ".join(others)]] if others else []),
        ]
        title = f"Simulation: {shared_words(self.problem)}; {self.dynamics}, seed {self.seed}"
        return Shown(title, rows=rows)

    def _checked(self, special: Mapping[int, Maker] | None) -> dict[int, Maker]:
        """Take in the special agents in the order of their index."""
        if special is None:
            return {}
        validation.instance("special", special, Mapping, "a dict of makers of agents by their index")
        for index, maker in special.items():
            validation.integer("index in special", index, low=0, high=self.problem.n_agents - 1)
            _check_maker(f"special[{index}]", maker)
        return dict(sorted(special.items()))

    def run(
        self,
        until: float,
        watch: Callable[[float, int], None] | None = None,
        *,
        progress: bool = False,
    ) -> Result:
        """Run over [0, until): what is due at `until` does not happen, but the last look is taken there.

        Parameters
        ----------
        until : float
            The end, greater than 0, in units of time.
        watch : callable, optional
            Called with (simulated time, events handled) every few thousand events.
        progress : bool
            Whether a bar with the time left is shown, for runs of a second or more.

        Returns
        -------
        Result
            The same for the same arguments, however often it is run.

        Raises
        ------
        InputError
            If the end is no positive number, or a time to be recorded or an intervention lies beyond it.
            If values for each agent are not n in number, or a part of one's own returns a value outside
            its range.
        SimulationError
            If simulated time cannot advance.

        Warns
        -----
        RuntimeWarning
            Once, if a response probability was above 1.
        OverloadWarning
            Once, if demand has run away from the capacity.
        """
        result = completed(self.start(until), watch, validation.flag("progress", progress))
        result.origin = self
        return result

    def start(self, until: float) -> Run:
        """Begin a run over [0, until), in which nothing has happened yet.

        Parameters
        ----------
        until : float
            The end, greater than 0, in units of time.

        Returns
        -------
        Run
            Advanced by its methods, as far as one likes.

        Raises
        ------
        InputError
            As for `run`.
        """
        return self.begin(validation.number("until", until, low=0.0, low_open=True))

    def begin(self, until: float, salts: tuple[int, ...] = (), like: Run | None = None) -> Run:
        """Begin a run as `start` does, with the draws of a fork.

        Parameters
        ----------
        until : float
            The end, checked.
        salts : tuple of int
            Of the forks that have led to the run.
        like : Run, optional
            Of which it is a fork: what depends on nothing that a fork may change is shared with it.

        Returns
        -------
        Run
            At time 0.
        """
        # Everything that changes is made here, so that one simulation can be run any number of times.
        check_end(self.interventions, until)
        log = EventLog() if self.recording.events else None
        whole = (self.problem, self.channel, self.clocks, self.seed, until, log)
        rule = (self.averaging, self.compensation, self.response)
        other = None if like is None else like.system
        keys = keys_of(self.seed, salts) if like is None or like.salts != salts else like.system.keys
        system = System(*whole, *rule, keys=keys, like=other)
        # The observer first: agents that are compiled take over a part of its work before anything begins.
        observer = Observer(system, self.recording, None if other is None else observer_of(other))
        self._populate(system, observer)
        returned_values.attach(system.link, system)
        for place, intervention in enumerate(self.interventions):
            name, make = _agenda(system, place, intervention)
            system.env.begin(name, make, place)
        for process in self.processes:
            system.env.process(_checked(process, "", process(system)))
        return Run(self, system, salts, lambda: self._result(system, observer))

    def replace(self, **parts: Any) -> "Simulation":
        """Make the same simulation but for some of its arguments.

        Parameters
        ----------
        **parts
            Arguments that are others.  Clocks that were not given follow the dynamics.

        Returns
        -------
        Simulation
            All other arguments are those of this one.

        Raises
        ------
        InputError
            If there is no such argument, or as the constructor does.

        Examples
        --------
        >>> from models import smart_cameras
        >>> simulation = Simulation(smart_cameras(0), seed=0)
        >>> simulation.replace(dynamics="continuous", seed=7).seed
        7
        """
        return replaced(self, parts if self._has_own_clocks else {"clocks": None, **parts})

    def _result(self, system: System, observer: Observer) -> Result:
        """Gather what has happened, at the end."""
        # Compiled agents have been brought to the last look, not to the end.
        system.finish()
        signals = system.transmitter.sent.signals()
        account = Account(
            delivered=system.transmitter.delivered,
            lost=system.transmitter.lost,
            in_flight=system.transmitter.in_flight,
            duplicated=system.transmitter.duplicated,
            responses=system.state.responses,
            saturated=system.state.saturated,
        )
        observations, rest = observer.finish(), observer.left_out.rest()
        # A control unit of the user's own need not say when it may signal.
        opportunities = getattr(self.control_unit, "opportunities", None)
        # And what ours says is no longer so where its hold-off has changed.
        if system.conditions.retimed:
            opportunities = None
        since = 0.5 * system.until if rest is None else rest.start
        return Result(
            self.problem,
            self.dynamics,
            self.seed,
            system.until,
            signals,
            observations,
            account,
            system.log,
            pieces=tuple(system.conditions.pieces),
            opportunities=opportunities(since, system.until) if opportunities else None,
            bits_per_signal=1 + (0 if self.compensation is None else self.compensation.bits),
            rest=rest,
        )

    def convergence(self) -> "Convergence":
        """Ask theory how near to the optimum the averages of this system come, and how fast.

        Returns
        -------
        Convergence
            Its `misallocation(until)` is what to expect of the measure of that name.

        Raises
        ------
        InputError
            If theory does not cover the system: interventions, processes and agents of one's own,
            compensation, own clocks, and control units other than `Sampled` and `Crossing`. Of channels
            it does not cover networks, latencies that are random or differ, losses that depend on each
            other, and duplicates. Also as `theory.convergence` does.
        SimulationError
            If the steady state is not found.
        """
        from aimd_des.engine.accuracy import convergence_of  # theory is slow to import

        return convergence_of(self)

    def _populate(self, system: System, observer: Observer) -> None:
        """Start the control unit, then the agents."""
        control_unit, populate = self.control_unit, getattr(self.agents, "populate", None)
        # Asked for by its method: this module need not know what is compiled, nor how.
        if populate is None:
            make_all = cast(Maker, self.agents)
            makers = {index: self.special.get(index, make_all) for index in range(self.problem.n_agents)}
            process = _checked(control_unit, "process", control_unit.process(system))
            system.env.process(process)
        else:
            make_process, makers = populate(system, self.special, control_unit, observer), self.special
            system.env.begin("control", lambda again: _checked(control_unit, "process", make_process(again)))
        for index, make in makers.items():
            agent = make(index, system)
            returned_values.having(returned_values.said_by(make), agent, ["receive", "process"])
            system.agents[index] = agent
            system.env.process(_checked(agent, "process", agent.process()))


def _agenda(system: System, place: int, intervention: Intervention) -> tuple[str, ProcessMaker]:
    """Name the process of an intervention, and say how it is made."""
    name = f"interventions[{place}]"
    if is_planned(intervention):
        agenda = Agenda(system, cast(Planned, intervention), name)
        system.parts[name] = agenda
        return name, lambda again: _checked(intervention, "changes", agenda.process(again))
    return name, lambda _: _checked(intervention, "process", intervention.process(system))


def _checked(part: object, method: str, process: ProcessGenerator) -> ProcessGenerator:
    """Refuse what is no process of a part, which may be the user's own."""
    said = returned_values.said_by(part, method)
    returned_values.generator(said, process)
    # Ours are resumed millions of times, and spared the step in between.
    is_own = not getattr(part, "__module__", "").startswith("aimd_des.")
    return returned_values.named(said, process) if is_own else process
