"""The scenario: a model or a problem written out, the parts of the system, and what is kept."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import tomli_w

from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.simulation import Simulation
from aimd_des.engine.system import System
from aimd_des.interventions import Intervention
from aimd_des.problem.problem import Problem
from aimd_des.results.result import Result
from aimd_des.scenario.build import built_by, changes_of, under, with_resources
from aimd_des.scenario.canonical import canonical_form, typed_parameters
from aimd_des.scenario.error_messages import Place, checked
from aimd_des.scenario.keys import ScenarioKeys
from aimd_des.scenario.models import model_parameters, named_model, takes_seed
from aimd_des.scenario.parameters import as_data, refuse_no_data
from aimd_des.scenario.representation import shown_scenario
from aimd_des.scenario.simulations import run_with_warm_up, simulation_of
from aimd_des.synchronous.synchronous import run_synchronous
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.shown import Shown, ShowsItself

if TYPE_CHECKING:
    from aimd_des.theory import Convergence


class Scenario(ShowsItself, ScenarioKeys):
    """One run as data.

    Attributes
    ----------
    title : str
        What the run is about, for people.
    until : float
        The end of the run, in units of time (steps of the synchronous algorithm).
    seed : int
        Decides everything random, at least 0.
    model : str, optional
        A registered model, such as "models.smart_cameras", unless the problem is written out.
    parameters : dict
        Of the model; defaults are filled in, `seed` with the scenario's own.
    resources, costs : optional
        The problem written out, in place of a model: a table for each resource, and costs of a kind.  With a
        model, `resources` has tables by the numbers of its resources: what is other than the model has it.
    dynamics : {"discrete", "continuous", "synchronous"}
        "discrete": event-driven, agents on their clocks behind a channel; "continuous":
        event-driven, agents that grow all the time; "synchronous": Algorithms 1 and 2.
    lag : {1, 0}
        For "synchronous": whether a signal acts one step after the excess, or in the same step.
    agents : {"process", "fleet"}
        How agents are represented, which changes no result: a SimPy process each, or all of them in
        compiled code.
    control_unit : table
        When capacity signals are broadcast. Default: after a sample at every unit of time.
    channel : table
        How late copies of a signal arrive, and which are lost. Default: at once and none.
    clocks : table
        When discrete agents act. Default: at every whole unit of time.
    averaging : table
        How agents average their demand. Default: over all of their past.
    response : table, optional
        How agents answer signals. Default: by the paper's rule.
    compensation : table, optional
        What agents do about signals that they lose; default: nothing.
    interventions : list of tables
        What changes from outside while the run goes on.
    warm_up, rare_event : table, optional
        The beginning, which measures leave out, and an event whose probability is estimated.
    recording : table
        What is kept besides signals and end.

    Raises
    ------
    InputError
        If anything is missing, unknown, of a wrong type or outside its range.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        # Tables with a kind are classes that no module has by name: data are sent in their place.
        return type(self).model_validate, (self.spoken(),)

    def _shown(self) -> Shown:
        return shown_scenario(self)

    def resolved(self) -> "Scenario":
        """Fill in every parameter of the model.

        Returns
        -------
        Scenario
            Running it gives the same result even if the defaults change.

        Raises
        ------
        InputError
            If there is no such model, or a default of it cannot be written to a file.
        """
        if self.model is None:
            return self
        parameters = as_data(model_parameters(self.model, self.parameters, self.seed))
        refuse_no_data("parameters", parameters)
        return self.model_copy(update={"parameters": parameters})

    def to_toml(self) -> str:
        """Write the scenario as TOML, every value spelled out.

        Returns
        -------
        str
            Reading it gives an equal scenario.
        """
        return tomli_w.dumps(self.spoken())

    def canonical(self) -> bytes:
        """Write the scenario in a form for hashing: equal bytes mean equal results.

        Returns
        -------
        bytes
            JSON with sorted keys of the resolved scenario; 1 and 1.0 are the same where a number is meant.
            Title and `agents`, which change no result, are left out.  Files that tables name, or that a
            parameter of the model names whose type is a `Path`, stand there by the SHA-256 of what they hold.

        Raises
        ------
        InputError
            If there is no such model, or a file cannot be read.
        """
        return self.canonical_at()(self.seed)

    def canonical_at(self) -> Callable[[int], bytes]:
        """Write the canonical form as a function of the seed, for many runs that differ in it alone.

        Returns
        -------
        callable
            Takes a seed, and gives what `canonical` gives with it.

        Raises
        ------
        InputError
            As `canonical` does.
        """
        spoken = self.resolved().spoken()
        if self.model is not None:
            spoken["parameters"] = typed_parameters(named_model(self.model), spoken["parameters"])
        return canonical_form(spoken, own_seed=self.has_own_seed())

    def has_own_seed(self) -> bool:
        """Tell whether the seed is handed on to the model, whose parameters name no other.

        Returns
        -------
        bool
            Whether another seed makes another problem.
        """
        return self.model is not None and takes_seed(self.model, self.parameters)

    def problem(self) -> Problem:
        """Build the problem that is shared, and hold against it what refers to it.

        Returns
        -------
        Problem
            From the model, or as written out.

        Raises
        ------
        InputError
            If there is no such model, or its parameters or the costs are refused. If an intervention
            names an agent or resource that is not there, or a number of values is not that of the agents.
        """
        return self.built()[0]

    def built(self) -> tuple[Problem, list[Intervention]]:
        """Build the problem that is shared, and what changes it.

        Returns
        -------
        Problem
            As `problem` returns it.
        list of Intervention
            In the order of the file.

        Raises
        ------
        InputError
            As `problem` does.
        """
        problem = self._problem()
        return problem, self.changes(problem)

    def _problem(self) -> Problem:
        if self.model is not None:
            problem = built_by(self.model, self.parameters, self.seed)
            if isinstance(self.resources, dict):
                problem = with_resources(problem, self.resources)
        else:
            assert isinstance(self.resources, list)  # noqa: S101 - _check saw to it
            assert self.costs is not None  # noqa: S101
            problem = Problem([table.build() for table in self.resources], self.costs.build())
        return problem

    def changes(self, problem: Problem) -> list[Intervention]:
        """Build what changes the problem, and hold against it what refers to it.

        Parameters
        ----------
        problem : Problem
            As `problem` returns it.

        Returns
        -------
        list of Intervention
            In the order of the file.

        Raises
        ------
        InputError
            If there is no agent or resource as an intervention names, or a number of values is not that of
            the agents.
        """
        if self.compensation is not None:
            with under("compensation"):
                self.compensation.build().parameters(problem.n_agents)
        return changes_of(self.interventions, problem, self.model, self.parameters, self.seed)

    def run(
        self,
        watch: Callable[[float, int], None] | None = None,
        processes: Sequence[Callable[[System], ProcessGenerator]] = (),
        *,
        problem: Problem | None = None,
        progress: bool = False,
    ) -> Result:
        """Run the scenario.

        Parameters
        ----------
        watch : callable, optional
            Called with (simulated time, events handled) every few thousand events.
        processes : sequence of callable
            SimPy processes that take part, as `Simulation` takes them.
        problem : Problem, optional
            What `problem` returns, for runs that share it; default: it is built.
        progress : bool
            As for `Simulation.run`; the synchronous algorithm, which takes no time, shows none.

        Returns
        -------
        Result
            A pure function of the scenario.

        Raises
        ------
        InputError
            If the problem is refused, or a length does not fit the number of agents.
        """
        if problem is None:
            problem = self._problem()
        else:
            validation.instance("problem", problem, Problem, "a Problem")
        interventions = self.changes(problem)
        if self.dynamics == "synchronous":
            if processes:
                allowed = "'discrete' or 'continuous' for processes such as one that watches the run"
                raise InputError.of("dynamics", self.dynamics, allowed)
            result = run_synchronous(
                problem,
                steps=int(self.until),
                seed=self.seed,
                lag=self.lag,
                averaging=self.averaging.build(),
                response=self.rule(),
                recording=self.recording.build(),
            )
        elif self.warm_up is not None:
            result = run_with_warm_up(self, problem, interventions, processes, watch, progress)
        else:
            system = simulation_of(self, problem, interventions, processes)
            result = system.run(self.until, watch, progress=progress)
        result.origin = self
        return result

    def simulation(self) -> Simulation:
        """Put the system together, to be run piece by piece: ``scenario.simulation().start(scenario.until)``.

        Returns
        -------
        Simulation
            What `run` runs.

        Raises
        ------
        InputError
            If the problem is refused, or dynamics are synchronous or there is a warm-up, which are not one
            simulation.
        """
        self._refuse_warm_up()
        if self.dynamics == "synchronous":
            raise InputError.of("dynamics", self.dynamics, "'discrete' or 'continuous' for a simulation")
        return simulation_of(self, *self.built())

    def convergence(self) -> "Convergence":
        """Ask theory how near to the optimum the averages come, and how fast.

        Returns
        -------
        Convergence
            Its ``misallocation(scenario.until)`` is what to expect of the measure of that name.

        Raises
        ------
        InputError
            If the problem is refused, or theory does not cover it: as `Simulation.convergence` does.
        SimulationError
            If the steady state is not found.
        """
        self._refuse_warm_up()
        problem, interventions = self.built()
        if self.dynamics == "synchronous":
            from aimd_des.theory import convergence  # slow to import, and not for a run

            return convergence(problem, lag=self.lag, averaging=self.averaging.build(), response=self.rule())
        return simulation_of(self, problem, interventions).convergence()

    def _refuse_warm_up(self) -> None:
        if self.warm_up is not None:
            allowed = "left out here: what follows a warm-up is another run"
            raise InputError.of("warm_up.until", self.warm_up.until, allowed)


def validate_scenario(
    data: Mapping[str, Any], source: str, lines: Mapping[Place, int] | None = None
) -> Scenario:
    """Make a scenario of data, or say what is wrong with them.

    Parameters
    ----------
    data : mapping
        Tables and lists, as read from TOML or JSON.
    source : str
        Where they come from, to begin each sentence with.
    lines : mapping, optional
        The line of each key and table there, as far as it is known.

    Returns
    -------
    Scenario
        Checked, not resolved.

    Raises
    ------
    InputError
        One line for each error: source, line, key, what is wrong, and the nearest known word.

    Examples
    --------
    >>> validate_scenario({"until": 5, "model": "models.smart_cameras", "sede": 3}, "mine")
    Traceback (most recent call last):
    aimd_des.InputError: mine: sede: unknown key 'sede'; did you mean 'seed'?
    """
    return checked(Scenario, data, source, lines)
