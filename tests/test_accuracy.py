"""What theory expects of a run stands beside what is measured: in Python, folders, studies and commands."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aimd_des import (
    BroadcastChannel,
    Clocks,
    Crossing,
    Fleet,
    InputError,
    PolynomialCosts,
    Problem,
    Recording,
    Resource,
    Sampled,
    Simulation,
    averaging,
    compensation,
    interventions,
    latency,
    loss,
    plots,
    responses,
    topology,
)
from aimd_des.report import report_run
from aimd_des.results.measures import EXPECTED
from aimd_des.scenario import load_scenario
from aimd_des.scenario.accuracy import accuracy_of
from aimd_des.scenario.expected import expected_of
from aimd_des.scenario.run_folder import load_run
from aimd_des.study import Study, run_study
from aimd_des.theory import convergence
from aimd_des.theory.accuracy_words import accuracy_words, needed_words, settling_words
from tests.command_line import invoke, refusal, run, said, write
from tests.conftest import INLINE, quietly

pytestmark = pytest.mark.usefixtures("own_folder")

N = 12
LATE = INLINE.replace("seed = 4", "seed = 4\n[channel]\nlatency = { kind = 'exponential', mean = 0.5 }\n")


def problem() -> Problem:
    """Twelve agents whose costs differ in their scale."""
    shared = Resource("memory", capacity=12.0, increase=0.02, decrease=0.7, normalization=0.1)
    return Problem([shared], PolynomialCosts([2], [[[1.0 + i / N]] for i in range(N)]))


def simulation(**parts: Any) -> Simulation:
    return Simulation(problem(), seed=1, **parts)


@pytest.mark.parametrize(
    ("parts", "arguments"),
    [
        ({}, {"lag": 0}),
        ({"channel": BroadcastChannel(0.5, 0.1)}, {"lag": 1, "loss": 0.1}),
        ({"channel": BroadcastChannel(np.linspace(1.1, 1.9, N))}, {"lag": 2}),
        ({"control_unit": Sampled(sensing_delay=0.7), "channel": BroadcastChannel(0.7)}, {"lag": 2}),
        (
            {"dynamics": "continuous", "control_unit": Sampled(0.5, 0.1), "channel": BroadcastChannel(0.3)},
            {"dynamics": "continuous", "latency": 0.3, "period": 0.5},
        ),
        ({"dynamics": "continuous", "control_unit": Crossing(0.0)}, {"dynamics": "continuous"}),
        (
            {"dynamics": "continuous", "control_unit": Crossing(0.4, 0.2), "agents": Fleet},
            {"dynamics": "continuous", "hold_off": 0.4, "latency": 0.2},
        ),
        ({"averaging": averaging.Forgetting(500.0)}, {"lag": 0, "averaging": averaging.Forgetting(500.0)}),
        (
            {"averaging": averaging.Polynomial(2.0), "response": responses.EventNormalised()},
            {"lag": 0, "averaging": averaging.Polynomial(2.0), "response": responses.EventNormalised()},
        ),
    ],
)
def test_a_simulation_asks_theory_about_its_own_parts(
    parts: dict[str, Any], arguments: dict[str, Any]
) -> None:
    own = simulation(**parts).convergence()
    other = convergence(problem(), **arguments)
    for name in ("discrete", "latency", "period", "hold_off"):
        assert getattr(own.setting, name) == getattr(other.setting, name)
    assert own.setting.loss.tolist() == other.setting.loss.tolist()
    assert own.memory == other.memory
    assert own.floor.tolist() == other.floor.tolist()


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        (
            {"interventions": [interventions.Absence([0], at=5.0)]},
            r"interventions = \['Absence'\]: must be left out",
        ),
        ({"processes": [lambda system: iter(())]}, r"processes = \['<lambda>'\]"),
        ({"compensation": compensation.KnownLoss(0.1)}, r"compensation = \['KnownLoss'\]"),
        ({"channel": topology.tree(topology.star(N))}, "channel = '.*': must be a BroadcastChannel"),
        (
            {"channel": BroadcastChannel(latency.Uniform(0.0, 1.0))},
            "channel.latency = 'Uniform': must be constant",
        ),
        ({"channel": BroadcastChannel(np.linspace(0.5, 1.5, N))}, "must be the same for all agents"),
        (
            {"channel": BroadcastChannel(loss=loss.CommonMode(0.1))},
            "channel.loss = 'CommonMode': must be indep",
        ),
        ({"channel": BroadcastChannel(duplication=0.1)}, "channel.duplication = .*: must be 0"),
        ({"clocks": Clocks(phase="random")}, "clocks.phase = 'random': must be 0 for all agents"),
        ({"clocks": Clocks(drift=0.01)}, "clocks.drift"),
        (
            {"control_unit": Sampled(2.0)},
            r"control_unit = Sampled\(.*\): must be Sampled\(period=1, phase=0\)",
        ),
        (
            {"dynamics": "continuous", "control_unit": Crossing(0.1, longest_hold_off=1.0)},
            "control_unit.longest_hold_off = 1.0: must be left out",
        ),
        ({"response": responses.CustomResponse(lambda slope: 0.1 * slope)}, "response = "),
        ({"special": {0: lambda index, system: None}}, r"special = \['<lambda>'\]"),
        ({"agents": lambda index, system: None}, "agents = '<lambda>': must be AgentProcess or Fleet"),
    ],
)
def test_what_theory_does_not_cover_is_refused_with_the_reason(parts: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        simulation(**parts).convergence()


def test_a_scenario_of_the_synchronous_algorithm_has_its_lag() -> None:
    for lag in (0, 1):
        write(INLINE.replace("seed = 4", f'seed = 4\ndynamics = "synchronous"\nlag = {lag}'))
        scenario = load_scenario("five.toml")
        assert scenario.convergence().setting.latency == lag


def test_what_is_left_of_the_slowest_deviation_decays_with_its_exponent() -> None:
    # With a linear price that dominates, the elasticity of the derivative is small, and so is the exponent.
    shared = Resource("memory", capacity=20.0, increase=0.02, decrease=0.5, normalization=0.02)
    priced = [[[1.0, 0.01]]] * 10 + [[[1.0, 0.03]]] * 10
    slow = convergence(Problem([shared], PolynomialCosts([1, 2], priced)))
    assert slow.slowest < 0.1
    assert slow.left(1e6) / slow.left(1e4) == pytest.approx(100.0**-slow.slowest, rel=1e-12)
    assert slow.left(1.0) == 1.0
    (words,) = settling_words(slow, 1e4)
    assert words.startswith("Averages have not settled at this length: ")
    assert settling_words(convergence(problem()), 1e4) == []


def test_sentences_say_what_the_numbers_say() -> None:
    expected = convergence(problem())
    at_end = expected.misallocation(2e3)
    (sentence,) = accuracy_words(expected, 2e3, at_end)
    half = float(f"{0.5 * at_end.mean[0]:.1g}")
    times = float(expected.needed(half).length[0]) / 2e3
    assert f"{100 * half:g} % would take {times:.2g} times as long; the bias keeps it above" in sentence
    floor = float(expected.floor[0])
    (line,) = needed_words(expected, 2e3, 0.5 * floor)
    assert line.endswith(f"is never reached (bias alone {100 * floor:.2g} %)")
    forgetful = convergence(problem(), averaging=averaging.Forgetting(200.0))
    (sentence,) = accuracy_words(forgetful, 2e3, forgetful.misallocation(2e3))
    assert "no length gives" in sentence


def test_the_folder_of_a_run_holds_measured_and_expected_misallocation_side_by_side() -> None:
    write(INLINE.replace("until = 60", "until = 400"))
    outcome = run("five.toml")
    summary = pd.read_csv("results/five/summary.csv", index_col="resource")
    frame = pd.read_parquet("results/five/convergence.parquet")
    last = frame[frame["time"] == 400.0]
    assert last["misallocation"].tolist() == pytest.approx(summary["misallocation"].tolist(), rel=1e-12)
    assert last["expected"].tolist() == pytest.approx(summary[EXPECTED].tolist(), rel=1e-12)
    expected = load_scenario("five.toml").convergence().misallocation(400.0)
    assert summary[EXPECTED].tolist() == pytest.approx(expected.mean.tolist(), rel=1e-3)
    assert (frame["low"] <= frame["expected"]).all()
    assert list(summary).index(EXPECTED) == list(summary).index("misallocation") + 1
    (words,) = load_run("results/five").accuracy
    assert words in outcome.stdout
    assert "expected misallocation" in outcome.stdout


def test_where_theory_says_nothing_nothing_is_shown_and_the_report_says_why() -> None:
    write(LATE)
    assert "expected" not in run("five.toml").stdout
    folder = load_run("results/five")
    assert folder.accuracy == ()
    assert EXPECTED not in folder.measures["memory"]
    assert folder.frame("convergence")["expected"].isna().all()
    page = report_run(folder)
    (chart,) = (chart for chart in page.charts if chart.id == "convergence")
    assert "Dotted" not in chart.text
    assert [note for note in page.notes if "must be constant; theory covers nothing else" in note]


def test_the_chart_of_a_report_has_logarithmic_axes_and_the_band() -> None:
    write(INLINE.replace("until = 60", "until = 400"))
    run("five.toml")
    folder = load_run("results/five")
    (chart,) = (chart for chart in report_run(folder).charts if chart.id == "convergence")
    line, band, mean = chart.spec["layer"]
    assert (band["mark"]["type"], mean["mark"]["type"], line["mark"]["type"]) == ("area", "line", "line")
    scales = [line["encoding"][axis]["scale"]["type"] for axis in "xy"]
    assert scales == ["log", "log"]
    assert folder.accuracy[0] in chart.text
    Path("results/five/convergence.parquet").unlink()
    assert any(
        note.startswith("Misallocation over time: the folder has no") for note in report_run(folder).notes
    )


def test_so_many_agents_are_left_to_validate(monkeypatch: pytest.MonkeyPatch) -> None:
    write(INLINE)
    monkeypatch.setattr("aimd_des.scenario.accuracy._MOST_AGENTS", 4)
    scenario = load_scenario("five.toml")
    found = accuracy_of(scenario, quietly(scenario.run))
    assert found.expected is None
    assert "at most 4" in found.reason


def test_a_study_has_the_column_where_it_is_asked_for() -> None:
    write(INLINE)
    data = {
        "replications": 2,
        "measures": ["misallocation", EXPECTED],
        "scenario": {**load_scenario("five.toml").spoken(), "until": 200.0},
        "axes": [{"key": "channel.latency", "name": "late", "values": [0.5, 1.5]}],
    }
    del data["scenario"]["seed"]
    found = quietly(run_study, Study(**data), "study", workers=1).runs
    per_point = found.groupby(["late", "resource"], observed=True)[EXPECTED].nunique()
    assert (per_point == 1).all()
    scenario = load_scenario("five.toml", **{"channel.latency": 1.5, "until": 200.0})
    expected = scenario.convergence().misallocation(200.0).mean
    rows = found[(found["late"] == 1.5) & (found["replication"] == 0)]
    assert rows[EXPECTED].tolist() == pytest.approx(expected.tolist(), rel=1e-12)
    assert EXPECTED not in Study(**{**data, "measures": None}).columns()


def test_where_a_study_asks_and_theory_says_nothing_there_is_no_number() -> None:
    write(LATE)
    data = {"measures": [EXPECTED], "scenario": load_scenario("five.toml").spoken()}
    del data["scenario"]["seed"]
    assert quietly(run_study, Study(**data), "study", workers=1).runs[EXPECTED].isna().all()


def test_validate_says_what_is_expected_and_what_an_accuracy_takes() -> None:
    write()
    write(LATE, "late.toml")
    base = 'base = "five.toml"\n[[axes]]\nkey = "channel.loss"\nvalues = [0.0, 0.1]\n'
    write(base, "study.toml")
    ok, memory, disk = said("validate", "five.toml", "--accuracy").splitlines()[:3]
    assert ok == "five.toml: ok: 5 agents, 2 resources, discrete, until 60"
    assert memory.startswith("  memory: misallocation ")
    assert "; 1 % takes " in memory
    assert disk.startswith("  disk: misallocation ")
    lines = said("validate", "--accuracy", "0.005", "late.toml", "study.toml").splitlines()
    assert lines[1].startswith(
        "  no accuracy is predicted: channel.latency = 'Exponential': must be constant"
    )
    assert lines[3] == "channel.loss = 0.0 (replication 0)"
    assert "; 0.5 % is never reached (bias alone " in lines[4]
    words = "--accuracy = 0.0: must be a finite number greater than 0"
    assert refusal("validate", "five.toml", "--accuracy", "0") == words
    assert invoke("validate", "five.toml").stdout == f"{ok}\n"


@pytest.mark.parametrize(
    ("draw", "measure"), [(plots.error_decay, "misallocation"), (plots.relative_error, "relative_error")]
)
def test_panels_of_errors_draw_the_band(draw: Callable[..., Any], measure: str) -> None:
    from matplotlib.figure import Figure

    asked = Simulation(problem(), seed=1, recording=Recording(allocations=20.0))
    result, expected = asked.run(until=600), asked.convergence()
    axes = draw(Figure().add_subplot(), result, expected=expected)
    (band,) = axes.collections
    corners = band.get_paths()[0].vertices
    at_end = corners[corners[:, 0] == 600.0][:, 1]
    interval = getattr(expected, measure)(600.0)
    assert at_end.min() == pytest.approx(interval.low[0], rel=1e-3)
    assert at_end.max() == pytest.approx(interval.high[0], rel=1e-3)
    other = Resource("disk", capacity=12.0, increase=0.02, decrease=0.7, normalization=0.1)
    wrong = convergence(Problem([other], PolynomialCosts([2], [[[1.0]]] * N)))
    with pytest.raises(InputError, match="resources of expected"):
        draw(Figure().add_subplot(), result, expected=wrong)


def test_what_is_in_run_json_is_text() -> None:
    write(INLINE.replace("until = 60", "until = 400"))
    run("five.toml")
    stored = json.loads(Path("results/five/run.json").read_text(encoding="utf-8"))
    assert stored["unpredicted"] == ""
    assert [type(sentence) for sentence in stored["accuracy"]] == [str]


def test_theory_is_asked_once_for_scenarios_that_differ_in_seed_and_length(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write(INLINE)
    asked: list[float] = []
    own = type(load_scenario("five.toml")).convergence

    def counted(scenario: Any) -> Any:
        asked.append(scenario.until)
        return own(scenario)

    monkeypatch.setattr("aimd_des.scenario.scenario.Scenario.convergence", counted)
    gamma = {"resources.0.normalization": 0.0731}  # of no other test, so that nobody has asked yet
    for setting in ({"seed": 5}, {"seed": 6}, {"until": 90.0}, {"channel.latency": 1.5}):
        expected_of(load_scenario("five.toml", **{**gamma, **setting}), 5)
    assert len(asked) == 2
