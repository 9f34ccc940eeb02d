"""Results draw and save themselves, and folders are read back, whatever wrote them."""

import inspect
import pickle
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Clocks,
    Fleet,
    InputError,
    Recording,
    Result,
    Sampled,
    Simulation,
    Study,
    averaging,
    compensation,
    interventions,
    latency,
    loss,
    plots,
    run_study,
    run_synchronous,
)
from aimd_des.plots.overview import _PANELS
from aimd_des.responses import EventNormalised
from aimd_des.scenario import StoredRun, validate_scenario
from aimd_des.scenario.from_simulation import scenario_of
from aimd_des.study import StudyResults, load
from tests.conftest import as_custom, quadratic_problem, quietly
from tests.reports import results_of, study_of

PROBLEM = quadratic_problem([1.0, 2.0, 3.0], capacity=2.0, increase=0.05)
PARTS: dict[str, Any] = {
    "seed": 3,
    "control_unit": Sampled(2.0),
    "channel": BroadcastChannel(
        latency.Exponential([0.1, 0.2, 0.3]), loss.Combined(0.1, loss.CommonMode(0.05)), duplication=0.1
    ),
    "clocks": Clocks(phase=[0.0, 0.25, 0.5]),
    "averaging": averaging.Forgetting(20.0),
    "compensation": compensation.KnownLoss(0.1),
    "interventions": [interventions.CapacityStep(0, at=10.0, capacity=1.5)],
    "recording": Recording("auto", "auto", events=True),
}


def simulated(**parts: Any) -> Result:
    return quietly(Simulation(PROBLEM, **{**PARTS, **parts}).run, 40.0)


@pytest.fixture(scope="module")
def result() -> Result:
    return simulated()


def _own_agent(index: int, system: Any) -> AgentProcess:
    return AgentProcess(index, system)


# -- figures -----------------------------------------------------------------------------------------------


def test_the_overview_has_four_panels_and_is_shown_by_notebooks(result: Result) -> None:
    figure = result.plot()
    assert isinstance(figure, Figure)
    assert len(figure.axes) == 4
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    assert len(plots.overview(result).axes) == 4


def test_a_panel_is_drawn_by_its_name(result: Result) -> None:
    (axes,) = result.plot("demand_and_signals", start=5.0, end=20.0).axes
    assert axes.get_xlim()[0] >= 4.0
    (axes,) = result.plot("error_histogram", resource=0).axes
    assert axes.get_xlabel()


@pytest.mark.parametrize(
    ("kind", "others"),
    [
        ("error_histogram", {}),
        ("averages_against_optimum", {}),
        ("copies", {}),
        ("score", {"agents": ["1", "2"]}),
        ("signal_raster", {"agents": ["1", "2"]}),
        ("agent_timeline", {"agent": "1"}),
    ],
)
def test_panels_take_names_as_well_as_indices(result: Result, kind: str, others: dict[str, Any]) -> None:
    names = result.problem.resource_names
    by_name = result.plot(kind, resource=names[0], **others)
    indices = {
        key: int(value) if isinstance(value, str) else list(map(int, value)) for key, value in others.items()
    }
    assert by_name._repr_png_() == result.plot(kind, resource=0, **indices)._repr_png_()  # type: ignore[attr-defined]
    for wrong in ("nothing", -1, 1.5):
        with pytest.raises(InputError, match=r"^resource = "):
            result.plot(kind, resource=wrong, **others)


def test_every_panel_of_a_run_is_a_kind() -> None:
    takes = {
        name
        for name in plots.__all__
        if callable(found := getattr(plots, name))
        and list(inspect.signature(found).parameters)[:2] in (["axes", "result"], ["axes", "results"])
    }
    assert takes == set(_PANELS)


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        ("overvew", {}, "kind = 'overvew': must be one of overview, .*; did you mean 'overview'"),
        ("overview", {"start": 1.0}, "option of plot.*'start'"),
        ("demand_and_signals", {"begin": 1.0}, "'begin': must be one of start, end"),
        ("signal_raster", {}, "needs resource; give it"),
    ],
)
def test_kinds_and_options_that_there_are_not_are_refused(
    result: Result, kind: str, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        result.plot(kind, **options)


def test_a_study_draws_a_measure_along_one_axis_or_over_two(tmp_path: Path) -> None:
    axes: dict[str, list[Any]] = {"latency": [0.0, 0.5, 2.0], "loss": [0.0, 0.5]}
    results = results_of(study_of(axes), tmp_path)
    maps = results.plot()
    assert maps._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    panels = [panel for panel in maps.axes if panel.get_title(loc="left")]
    assert [panel.get_title(loc="left") for panel in panels] == ["memory", "disk"]
    assert {(panel.get_xlabel(), panel.get_ylabel()) for panel in panels} == {("loss", "latency")}
    (lines,) = results.plot("misallocation", by=["latency"]).axes
    assert lines.get_ylabel().replace("\n", " ") == "Misallocation (% of what is used)"
    runs = results.runs
    for name, drawn in zip(("memory", "disk"), lines.containers, strict=True):
        x, y = drawn.lines[0].get_data()
        means = runs[runs["resource"] == name].groupby("latency")["misallocation"].mean()
        assert x.tolist() == means.index.tolist()
        assert y.tolist() == pytest.approx((100.0 * means).tolist(), rel=1e-12)


def test_an_axis_of_words_beside_one_of_numbers_has_a_line_for_each(tmp_path: Path) -> None:
    """A map of few columns, with means that differ little, shows neither which is better nor how surely."""
    axes: dict[str, list[Any]] = {"way": ["tree", "flood"], "loss": [0.0, 0.25, 0.5]}
    results = results_of(study_of(axes), tmp_path)
    panels = results.plot("utilisation").axes
    assert [(panel.get_title(loc="left"), panel.get_xlabel()) for panel in panels] == [
        ("memory", "loss"),
        ("disk", "loss"),
    ]
    runs = results.runs[results.runs["resource"] == "memory"]
    for way, drawn in zip(("tree", "flood"), panels[0].containers, strict=True):
        assert drawn.get_label() == way
        means = runs[runs["way"] == way].groupby("loss")["utilisation"].mean()
        x, y = drawn.lines[0].get_data()
        assert x.tolist() == means.index.tolist()
        assert y.tolist() == pytest.approx((100.0 * means).tolist(), rel=1e-12)
    legend = panels[0].get_legend()
    assert legend is not None
    assert legend.get_title().get_text() == "way"
    (lines,) = results.plot("utilisation", by="loss").axes
    assert lines.get_xlabel() == "loss"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"measure": "utilization"}, "measure = 'utilization': must be one of .*did you mean 'utilisation'"),
        ({"by": ["los"]}, "by = 'los': must be one of latency, loss, way; did you mean 'loss'"),
        ({}, "needs one or two axes with several values, not latency, loss, way"),
        ({"by": []}, "needs one or two axes with several values, not none"),
    ],
)
def test_figures_of_a_study_that_there_are_not_are_refused(
    tmp_path: Path, given: dict[str, Any], words: str
) -> None:
    axes: dict[str, list[Any]] = {"latency": [0.0, 0.5], "loss": [0.0, 0.5], "way": ["tree", "flood"]}
    with pytest.raises(InputError, match=words):
        results_of(study_of(axes), tmp_path).plot(**given)
    empty = results_of(study_of(axes), tmp_path / "empty", done=False)
    with pytest.raises(InputError, match="has no run yet"):
        empty.plot(by=["loss"])


# -- folders -----------------------------------------------------------------------------------------------


def test_a_run_in_python_is_saved_as_the_command_saves_it(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / "run")
    stored = load(tmp_path / "run")
    assert isinstance(stored, StoredRun)
    assert stored.digest == result.digest
    again = validate_scenario(stored.scenario, "again")
    assert quietly(again.run).digest == result.digest
    with pytest.raises(InputError, match="new or empty"):
        result.save(tmp_path / "run")
    result.save(tmp_path / "run", overwrite=True)
    text = repr(stored)
    assert text.startswith(f"Run in {tmp_path}"[:20])
    assert "utilisation  misallocation  peak demand" in text


def test_a_scenario_is_saved_with_its_result(tmp_path: Path) -> None:
    scenario = scenario_of(Simulation(PROBLEM, seed=1), 20.0).model_copy(update={"title": "Mine"})
    quietly(scenario.run).save(tmp_path / "run")
    stored = load(tmp_path / "run")
    assert isinstance(stored, StoredRun)
    assert stored.scenario["title"] == "Mine"


@pytest.mark.parametrize(
    "parts",
    [
        {"response": EventNormalised(), "compensation": None, "clocks": None},
        {"channel": BroadcastChannel(0.5, loss.GilbertElliott(0.1, 5.0)), "agents": Fleet},
        {"interventions": [interventions.Absence(["1"], at=1.0, until=2.0)]},
    ],
    ids=["response", "bursts", "absence"],
)
def test_what_files_can_name_becomes_a_scenario(parts: dict[str, Any]) -> None:
    simulation = Simulation(PROBLEM, **{**PARTS, **parts})
    assert scenario_of(simulation, 40.0).seed == 3


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"special": {0: AgentProcess}}, "special"),
        ({"processes": [lambda system: iter(())]}, "processes"),
        ({"agents": _own_agent}, "agents"),
        ({"problem": PROBLEM.replace(agent_names=["a", "b", "c"])}, "agent_names"),
        ({"problem": PROBLEM.replace(costs=as_custom(PROBLEM.costs))}, "costs = .*to be saved"),
    ],
)
def test_what_no_file_can_say_is_refused_by_name(parts: dict[str, Any], words: str) -> None:
    problem = parts.pop("problem", PROBLEM)
    with pytest.raises(InputError, match=words):
        scenario_of(Simulation(problem, **{**PARTS, **parts}), 40.0)


def test_a_result_whose_beginning_is_not_known_is_refused(result: Result, tmp_path: Path) -> None:
    pieces = quietly(Simulation(PROBLEM, seed=1).start, 10.0)
    synchronous = quietly(run_synchronous, PROBLEM, steps=10, seed=0)
    for unknown in (quietly(pieces.result), synchronous, pickle.loads(pickle.dumps(result))):
        with pytest.raises(InputError, match="what was run = None: must be known"):
            unknown.save(tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_the_folder_of_a_study_is_loaded_as_one(tmp_path: Path) -> None:
    data = scenario_of(Simulation(PROBLEM, seed=1), 5.0).spoken()
    study = Study(scenario={key: value for key, value in data.items() if key not in ("seed", "recording")})
    study = study.model_copy(update={"scenario": {**study.scenario, "agents": "process"}})
    quietly(run_study, study, tmp_path / "study", workers=1)
    found = load(tmp_path / "study")
    assert isinstance(found, StudyResults)
    assert "1 of 1 runs" in repr(found)
    with pytest.raises(InputError, match="it has no"):
        load(tmp_path)


# -- words for agents --------------------------------------------------------------------------------------


def test_the_words_of_files_stand_for_agents() -> None:
    assert Simulation(PROBLEM, seed=0, agents="fleet").agents is Fleet
    assert Simulation(PROBLEM, seed=0, agents="process").agents is AgentProcess
    with pytest.raises(InputError, match="'fleets': must be one of process, fleet; did you mean 'fleet'"):
        Simulation(PROBLEM, seed=0, agents="fleets")  # type: ignore[arg-type]
