"""Every public constructor and function is given wrong kinds of things, and right ones in other dress."""

from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
import pandas as pd
import pytest
from scipy import stats

from aimd_des import (
    BroadcastChannel,
    Clocks,
    Crossing,
    CustomCosts,
    InputError,
    Optimum,
    PolynomialCosts,
    Problem,
    Recording,
    Resource,
    Sampled,
    Simulation,
    Study,
    averaging,
    interventions,
    latency,
    loss,
    run_study,
    run_synchronous,
)
from tests.conftest import refusal
from tests.wrong_kinds import CALLS, PROBLEM, TAKEN, WRONG

OWN_FUNCTIONS = {
    ("topology.tree", "latency"),
    ("topology.tree", "loss"),
    ("Simulation.run", "watch"),
    ("interventions.Prices", "draw"),
}


@pytest.fixture
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that the readers of `CALLS` find in the working directory."""
    monkeypatch.chdir(tmp_path)
    Path("delays.csv").write_text("delay\n1\n2\n")
    Path("losses.csv").write_text("lost\n1\n0\n")
    Path("net.csv").write_text("source,target,latency,loss\nr,a,1,0\nr,b,1,0\n")
    graph = nx.Graph()
    graph.add_edge("r", "a", latency=1.0, loss=0.0)
    nx.write_graphml(graph, "net.graphml")


@pytest.mark.usefixtures("_files")
@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_kind_of_thing_is_refused_by_name(name: str) -> None:
    """With an `InputError`, never another exception, and with nothing of where objects lie in memory."""
    call, right = CALLS[name]
    call(**right)
    taken: dict[str, set[str]] = {}
    sentences = []
    for argument in right:
        for what, wrong in WRONG.items():
            if callable(wrong) and (name, argument) in OWN_FUNCTIONS:
                continue  # what a function of one's own raises is its own
            try:
                call(**{**right, argument: wrong})
            except InputError as refused:
                sentences.append(str(refused))
            else:
                taken.setdefault(argument, set()).add(what)
    assert taken == TAKEN.get(name, {})
    assert [sentence for sentence in sentences if " at 0x" in sentence] == []


LISTS = {
    "tuple": tuple,
    "array": np.array,
    "array of half the width": lambda values: np.array(values).astype(f"{np.array(values).dtype.kind}4"),
    "series": pd.Series,
    "series that may have gaps": lambda values: pd.Series(values).convert_dtypes(),
    "index": pd.Index,
    "list of arrays without axes": lambda values: [np.array(value) for value in values],
}


def plain(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


@pytest.mark.usefixtures("_files")
@pytest.mark.parametrize("name", CALLS)
def test_numpys_numbers_and_what_holds_several_are_taken(name: str) -> None:
    """A number may be NumPy's own, or an array without axes; what takes a list takes its like."""
    call, right = CALLS[name]
    for argument, value in right.items():
        if name.startswith("topology.") and argument in ("root", "agents"):
            continue  # nodes are called as the graph calls them
        if plain(value):
            for dressed in (np.array(value), np.array([value])[0]):
                call(**{**right, argument: dressed})
            several = [value, value]
        elif isinstance(value, list) and value and all(map(plain, value)):
            several = value
        else:
            continue
        try:
            call(**{**right, argument: several})
        except InputError:
            assert plain(value)
            continue
        for dress in LISTS.values():
            call(**{**right, argument: dress(several)})


def test_a_run_is_the_same_in_whatever_dress_its_numbers_come() -> None:
    def run(number: Any, several: Any) -> str:
        memory = Resource(
            "memory", number(1.0), several([0.05, 0.1]), several([0.5, 0.7]), number(0.1), number(0.9)
        )
        channel = BroadcastChannel(several([0.5, 0.25]), several([0.125, 0.25]), number(0.5))
        simulation = Simulation(
            Problem(
                several([memory]) if several is list else [memory], PolynomialCosts([2], [[[1.0]], [[2.0]]])
            ),
            clocks=Clocks(number(1.0), several([0.0, 0.25]), several([0.0, 0.5])),
            control_unit=Sampled(number(0.5)),
            channel=channel,
            recording=Recording(demand=several([1.0, 2.0]), allocations=number(4.0)),
            seed=7 if number is float else np.array(7),
        )
        return simulation.run(number(40.0)).digest

    plainly = run(float, list)
    assert run(np.array, pd.Series) == plainly
    assert run(np.float64, np.array) == plainly


REFUSALS: dict[str, tuple[Any, str]] = {
    "a class of control units": (
        lambda: Simulation(PROBLEM, dynamics="continuous", control_unit=Crossing, seed=1),
        (
            "control_unit = <class 'aimd_des.engine.control_unit.crossing.Crossing'>: must be a control "
            "unit, such as Sampled(1.0) or Crossing(1.0); make an object of it: Crossing(...)"
        ),
    ),
    "a class for an optimum": (
        lambda: run_synchronous(PROBLEM, steps=5, seed=1).summary(Optimum),
        (
            "optimum = <class 'aimd_des.problem.optimum.optimum.Optimum'>: must be an Optimum, such as "
            "solve_optimum(problem); make an object of it: Optimum(...)"
        ),
    ),
    "a class for a study": (
        lambda: run_study(Study, "nowhere"),
        (
            "study = <class 'aimd_des.study.study.Study'>: must be a Study, such as read_study(path); "
            "make an object of it: Study(...)"
        ),
    ),
    "a latency for a channel": (
        lambda: Simulation(PROBLEM, channel=latency.Constant(1.0), seed=1),
        (
            "channel = Constant(value=1.0): must be a channel, such as BroadcastChannel or "
            "topology.tree(graph); models of latency and loss go into one: BroadcastChannel(latency=..., "
            "loss=...)"
        ),
    ),
    "a word for an averaging": (
        lambda: Simulation(PROBLEM, averaging="window", seed=1),
        "averaging = 'window': must be an averaging, such as averaging.Window(100.0)",
    ),
    "the same where nothing is event-driven": (
        lambda: run_synchronous(PROBLEM, steps=5, averaging=averaging.Window, seed=1),
        (
            "averaging = <class 'aimd_des.dynamics.averaging.Window'>: must be an averaging, such as "
            "averaging.Window(100.0); make an object of it: Window(...)"
        ),
    ),
    "a dict for a recording": (
        lambda: Simulation(PROBLEM, recording={"events": True}, seed=1),
        "recording = {'events': True}: must be a Recording, such as Recording(events=True)",
    ),
    "an intervention that is no list": (
        lambda: Simulation(PROBLEM, interventions=interventions.Failover(1.0, 2.0), seed=1),
        "interventions = Failover(at=1.0, duration=2.0): must be a list, each of it an intervention",
    ),
    "a word for a latency": (
        lambda: BroadcastChannel(latency="exponential"),
        (
            "latency = 'exponential': must be a number, one for each agent, or a model of latency such as "
            "latency.Exponential(0.5)"
        ),
    ),
    "a loss for a latency": (
        lambda: BroadcastChannel(latency=loss.Bernoulli(0.1)),
        "latency = Bernoulli(probability=0.1): must be a number, one for each agent, or a model of latency",
    ),
    "a distribution of another library": (
        lambda: BroadcastChannel(latency=stats.expon(0.5)),
        (
            "latency = <scipy.stats._distn_infrastructure.rv_continuous_frozen object>: must be a number, "
            "one for each agent, or a model of latency"
        ),
    ),
    "yes": (lambda: Recording(events="yes"), "recording.events = 'yes': must be True or False"),
    "a control unit that makes agents": (
        lambda: Simulation(PROBLEM, agents=Crossing, seed=1),
        (
            "agents = <class 'aimd_des.engine.control_unit.crossing.Crossing'>: "
            "must be a class or function that makes an agent"
        ),
    ),
    "two interventions after the end": (
        lambda: Simulation(
            PROBLEM,
            interventions=[
                interventions.CapacityStep(0, 5.0, 2.0),
                interventions.Failover(10.0, 1.0),
                interventions.CapacityRamp(0, 1.0, 20.0, 2.0, 4),
                interventions.Absence([0], 12.0),
            ],
            seed=1,
        ).run(10.0),
        (
            "interventions[1], interventions[3] = [Failover(at=10.0, duration=1.0), Absence(agents=[0], "
            "at=12.0, until=None)]: must be such that they begin before 10, the end of the run; leave them "
            "out, or let the run last longer"
        ),
    ),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_a_refusal_says_what_is_allowed_before_anything_runs(case: str) -> None:
    make, sentence = REFUSALS[case]
    assert refusal(make).startswith(sentence)


def test_who_comes_back_after_the_end_is_none_of_these() -> None:
    """A return, or a join, that is due later leaves an agent away; the run has its end without it."""
    late = [interventions.Join([0], 20.0), interventions.Absence([1], 5.0, 30.0)]
    result = Simulation(PROBLEM, interventions=late, seed=1).run(10.0)
    assert result.demand_at_end.tolist() == [[0.0], [0.0]]


def test_functions_of_ones_own_for_costs_are_refused_by_what_they_return() -> None:
    def costs(value: Any, gradient: Any) -> Any:

        return lambda: Problem(
            PROBLEM.resources, CustomCosts(2, 1, lambda i, x: value, lambda i, x: gradient)
        )

    assert refusal(costs(1.0, None)).startswith("gradient(agent=0) = None: must be numbers of shape (1,)")
    assert refusal(costs(1.0, [1.0, 2.0])) == "shape of gradient(agent=0) = (2,): must be (1,)"
    assert refusal(costs("much", [1.0])) == "value(agent=0) = 'much': must be a number"
