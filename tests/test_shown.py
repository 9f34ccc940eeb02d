"""Objects show themselves: at most five lines, no arrays, escaped tables, and no optimum solved for them."""

from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aimd_des import (
    BroadcastChannel,
    Clocks,
    InputError,
    PolynomialCosts,
    Problem,
    Recording,
    Result,
    Sampled,
    Simulation,
    Study,
    averaging,
    compensation,
    interventions,
    latency,
    load_scenario,
    loss,
    run_synchronous,
    solve_optimum,
    topology,
)
from aimd_des.study.results import StudyResults
from aimd_des.study.run_tables import plan_schema
from aimd_des.study.store import Store
from aimd_des.utils.shown import Shown, as_html, as_text, brief_value
from tests.conftest import INLINE, resource

N = 40
PROBLEM = Problem(
    [resource(name=f"<r{j}>", capacity=4.0 + j, unit="10 GB" if j else "GB") for j in range(6)],
    PolynomialCosts([2], np.ones((N, 6, 1))),
)
LATE = BroadcastChannel(latency=latency.Exponential(np.linspace(0.1, 0.2, N)), loss=[0.1] * N)
SCENARIO = {"until": 5.0, "model": "models.smart_cameras", "title": "Mine"}


def stored(study: Study) -> StudyResults:
    return StudyResults(Store(Path("nowhere")), study, plan_schema(study).empty_table().to_pandas())


def simulation(**changes: Any) -> Simulation:
    return Simulation(PROBLEM, channel=LATE, seed=3, **changes)


def run() -> Result:
    return run_synchronous(PROBLEM, steps=30, seed=2)


STUDY = Study(scenario=SCENARIO, axes=[{"key": "channel.loss", "linspace": [0.0, 0.5, 30]}], title="Losses")
# What each shows, and some of the words that must be there.
THINGS: list[tuple[Callable[[], Any], list[str]]] = [
    (lambda: PROBLEM, ["Problem: 40 agents, PolynomialCosts", "<r1>", "5 × 10 GB", "4 GB", "... and 4 more"]),
    (lambda: solve_optimum(PROBLEM), ["Optimum: 40 agents", "multiplier", "0.1"]),
    (simulation, ["Simulation: 40 agents share <r0> 4 GB", "and 3 more; discrete, seed 3", "AgentProcess"]),
    (
        run,
        ["Result: discrete, seed 2, until 30", "40 agents share", "utilisation", "time above the"],
    ),
    (lambda: STUDY, ["Study: Losses; 1 replications", "0 to 0.5 (30 values)"]),
    (lambda: stored(STUDY), ["Study results: Losses; 0 of 0 runs", "channel.loss", "nowhere"]),
    (lambda: LATE, ["BroadcastChannel(latency=Exponential(mean=<40 values, 0.1 to 0.2>)"]),
    (lambda: topology.tree(topology.grid(4, 10)), ["TreeChannel(routes=<39 agents"]),
    (lambda: loss.Combined(0.1, loss.Trace([True] * 9, repeat=True)), ["Combined(Bernoulli", "<9 values>"]),
    (lambda: latency.Empirical(np.arange(99.0)), ["Empirical(values=<99 values, 0 to 98>, scale=1.0)"]),
    (lambda: Sampled(2.0), ["Sampled(period=2.0"]),
    (lambda: Clocks(phase=np.linspace(0.0, 0.9, N)), ["Clocks(period=1.0, phase=<40 values, 0 to 0.9>"]),
    (lambda: resource(increase=np.full(N, 0.01)), ["Resource(", "increase=<40 values, 0.01>"]),
    (lambda: Recording(list(range(50))), ["Recording(demand=<50 values, 0 to 49>"]),
    (lambda: compensation.KnownLoss(np.full(N, 0.5)), ["KnownLoss(", "<40 values, 0.5>"]),
]


@pytest.mark.parametrize(("make", "words"), THINGS, ids=[words[0][:12] for _, words in THINGS])
def test_an_object_shows_what_it_is_in_five_lines(make: Callable[[], Any], words: list[str]) -> None:
    text = repr(make())
    assert all(word in text for word in words), text
    assert "array(" not in text
    lines = text.splitlines()
    assert len(lines) <= 5
    assert str(make()) == text


class Table(HTMLParser):
    """Collects tags and texts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, list[tuple[str, str | None]]]] = []
        self.texts: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, attrs))

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


@pytest.mark.parametrize(("make", "words"), THINGS, ids=[words[0][:12] for _, words in THINGS])
def test_a_notebook_shows_a_small_table(make: Callable[[], Any], words: list[str]) -> None:
    thing = make()
    if isinstance(thing, loss.Combined):
        assert not hasattr(thing, "_repr_html_")  # its one line is all there is
        return
    found = Table(thing._repr_html_())
    assert {tag for tag, _ in found.tags} <= {"div", "p", "strong", "table", "tr", "th", "td"}
    # No colour, no script, no handler of events: nothing but the class that keeps formulas away.
    assert {attribute for _, given in found.tags for attribute in given} == {("class", "tex2jax_ignore")}
    assert found.texts[0].startswith(words[0].partition("(")[0][:12])


def test_names_of_others_are_escaped_and_steer_no_terminal() -> None:
    shown = Shown("a\n\x1b[31m<b>", rows=[["<script>alert(1)</script>", "x" * 300]])
    assert as_text(shown).splitlines()[0] == r"a \x1b[31m<b>"
    assert max(map(len, as_text(shown).splitlines())) < 160
    page = as_html(shown)
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert "<r0>" not in PROBLEM._repr_html_()


def test_a_simulation_names_the_parts_that_are_not_the_usual_ones() -> None:
    assert "besides" not in repr(simulation())
    step = interventions.CapacityStep(0, at=1.0, capacity=3.0)
    text = repr(simulation(averaging=averaging.Forgetting(20.0), interventions=[step]))
    assert "besides       averaging Forgetting(time_constant=20.0), interventions 1" in text


def test_a_result_solves_for_no_optimum_until_it_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    result = run()
    with monkeypatch.context() as patch:
        patch.setattr("aimd_des.problem.optimum.optimum.follow_central_path", None)
        assert "misallocation" not in repr(result)
    measured = result.measures(names=["misallocation"])["misallocation"][0]
    assert f"{100.0 * measured:.3g} %" in repr(result)


def test_a_result_says_that_demand_has_run_away() -> None:
    result = run()
    result.run_away = np.arange(6) < 2
    assert "until 30; demand has run away from <r0>, <r1>; 40 agents" in repr(result)


def test_a_scenario_shows_its_data_and_builds_no_model(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(INLINE)
    text = repr(load_scenario(path))
    assert text.startswith("Scenario: five agents, two resources; discrete, seed 4, until 60\n")
    assert "written out, 2 resources" in text
    assert "kind sampled, period 1" in text
    unknown = load_scenario(path).model_copy(update={"model": "nowhere.model"})
    assert "nowhere.model" in repr(unknown)


def test_a_refusal_names_an_object_in_one_line() -> None:
    with pytest.raises(InputError, match=r"^problem = Problem: 40 agents, PolynomialCosts: must be") as said:
        raise InputError.of("problem", PROBLEM, "another one")
    assert "\n" not in str(said.value)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.array([True] * 6), "<6 values>"),
        (np.arange(7), "<7 values, 0 to 6>"),
        ((1, 2), "(1, 2)"),
        (np.float64(0.5), repr(np.float64(0.5))),
    ],
)
def test_values_are_written_in_a_few_signs(value: Any, words: str) -> None:
    assert brief_value(value) == words
