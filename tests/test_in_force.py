"""Measures, figures and reports are held against the optimum in force, of those who are here."""

import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import (
    InputError,
    Recording,
    Result,
    Simulation,
    Study,
    interventions,
    load_study,
    plots,
    run_study,
    solve_optimum,
)
from aimd_des.report import report_run
from aimd_des.report.html_page import render
from aimd_des.scenario import load_scenario
from aimd_des.scenario.run_folder import load_run
from tests.command_line import invoke, run, said, write
from tests.conftest import quietly, random_problem
from tests.reports import values

pytestmark = pytest.mark.usefixtures("own_folder")

# Two devices with costs x^2 and 2 x^2: by hand the optimum is (2, 1) before the step and (1, 0.5) after it.
STEP = """\
until = 20000
agents = "fleet"
[costs]
exponents = [2]
coefficients = [[[1.0]], [[2.0]]]
[[resources]]
name = "r"
capacity = 3.0
increase = 0.01
decrease = 0.5
normalization = 0.05
[[interventions]]
kind = "capacity_step"
resource = "r"
at = 10.0
capacity = 1.5
"""

FIVE = """\
until = {until}
seed = 0
agents = "fleet"
[channel]
latency = 0.5
loss = 0.1
[costs]
exponents = [2, 4]
coefficients = [
    [[1.0, 0.0], [2.0, 1.0]],
    [[2.0, 0.0], [1.0, 1.0]],
    [[3.0, 0.5], [2.0, 2.0]],
    [[1.0, 1.0], [2.0, 0.0]],
    [[2.0, 2.0], [4.0, 1.0]],
]
[[resources]]
name = "memory"
unit = "GB"
capacity = 4.0
increase = 0.02
decrease = 0.7
normalization = 0.02
[[resources]]
name = "bandwidth"
unit = "Mbps"
capacity = 3.0
increase = 0.02
decrease = 0.8
normalization = 0.02
"""
STEP_AND_WEIGHT = (
    FIVE.format(until=3000)
    + """\
[[interventions]]
kind = "capacity_step"
resource = "memory"
at = 500.0
capacity = 2.0
[[interventions]]
kind = "unusual_activity"
agents = [0]
at = 500.0
weight = 0.1
"""
)
EVERYBODY = [0, 1, 2, 3, 4]


def leaving(kind: str, agents: list[int], at: float, until: str = "") -> str:
    return (
        f'{FIVE.format(until=200)}[[interventions]]\nkind = "{kind}"\nagents = {agents}\nat = {at}\n{until}\n'
    )


def summary_of(folder: str = "results/five") -> pd.DataFrame:
    return pd.read_csv(f"{folder}/summary.csv", index_col="resource")


def in_python(text: str) -> Result:
    write(text, "again.toml")
    return quietly(load_scenario(Path("again.toml")).run)


# -- one optimum, whoever asks -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "error", "ratio"),
    [(STEP, [0.1332], 0.7524), (STEP_AND_WEIGHT, [0.2910, 0.03256], 1.177)],
    ids=["step", "step and weight"],
)
def test_a_run_is_held_against_the_optimum_after_its_interventions(
    text: str, error: list[float], ratio: float
) -> None:
    assert run(str(write(text))).exit_code == 0
    summary = summary_of()
    assert summary["relative_error"].tolist() == pytest.approx(error, rel=3e-4)
    assert summary["cost_ratio"].tolist() == pytest.approx([ratio] * len(error), rel=5e-4)
    result = in_python(text)
    pd.testing.assert_frame_equal(summary, result.summary(), rtol=1e-15)
    page = report_run(load_run("results/five"))
    # After the name a column for each resource, and then the unit and the meaning.
    cells = {row[0]: list(row[1 : 1 + len(error)]) for row in page.tables[0].rows}
    assert cells["relative error"] == [f"{value:.4g}" for value in summary["relative_error"]]
    assert cells["cost ratio"] == [f"{value:.4g}" for value in summary["cost_ratio"]]


def test_prices_that_change_move_the_optimum() -> None:
    text = (
        'until = 300\nagents = "fleet"\nmodel = "models.smart_cameras"\n[parameters]\nn_cameras = 4\n'
        '[[interventions]]\nkind = "prices"\nevery = 100.0\n'
    )
    assert run(str(write(text))).exit_code == 0
    result = in_python(text)
    pd.testing.assert_frame_equal(summary_of(), result.summary(), rtol=1e-15)
    before = result.summary(solve_optimum(result.problem))
    assert (before["relative_error"] / result.summary()["relative_error"] - 1.0).abs().min() > 1e-3


def test_the_optimum_by_hand(tmp_path: Path) -> None:
    result = in_python(STEP)
    assert result.optimum is not None
    assert result.optimum.allocation[:, 0].tolist() == pytest.approx([1.0, 0.5], rel=1e-9)
    first, last = result.history
    assert result.piece_at(9.9) is first
    assert result.piece_at(10.0) is last
    assert result.piece_at(20_000.0) is last
    before = result.optimum_of(first)
    assert before is not None
    assert before.allocation[:, 0].tolist() == pytest.approx([2.0, 1.0], rel=1e-9)
    # One's own stands for the problem at the end alone.
    own = solve_optimum(result.problem)
    assert result.optimum_of(last, own) is own
    assert result.optimum_of(first, own) is before


def test_the_report_shows_demand_over_the_capacity_in_force_and_the_optimum_at_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("aimd_des.report.run_charts._LOOKS_A_TOOTH", 0)  # looks are drawn one by one
    assert run(str(write(STEP))).exit_code == 0
    capacity = pd.read_parquet("results/five/capacity.parquet")
    assert capacity.astype({"resource": str}).to_numpy().tolist() == [[0.0, "r", 3.0], [10.0, "r", 1.5]]
    charts = {chart.id: chart.spec for chart in report_run(load_run("results/five")).charts}
    demand = pd.read_parquet("results/five/demand.parquet").set_index("time")["total"]
    rows = [row for row in values(charts["demand"]) if row.get("time") in demand.index]
    assert len(rows) > 100
    for row in rows:
        in_force = 3.0 if row["time"] < 10.0 else 1.5
        assert row["level"] == pytest.approx(100.0 * demand[row["time"]] / in_force, rel=1e-4)
    # In multiples of equal shares: (1, 0.5) over 0.75, for as much as is used.
    best, used = [row["best"] for row in values(charts["shares"])], float(summary_of()["utilisation"].iloc[0])
    assert best == pytest.approx([4 / 3 * used, 2 / 3 * used], rel=1e-4)


# -- fewer agents, or none ---------------------------------------------------------------------------------

GONE = {
    "crash": leaving("crash", [0], 50.0),
    "back at the end": leaving("absence", [0], 50.0, "until = 200.0"),
    "back after it": leaving("absence", [0], 50.0, "until = 1000.0"),
}
NOBODY = {
    "crash": leaving("crash", EVERYBODY, 50.0),
    "never come": leaving("join", EVERYBODY, 200.0),
    "come too late": leaving("absence", EVERYBODY, 0.0, "until = 400.0"),
}


@pytest.mark.parametrize("text", GONE.values(), ids=GONE)
def test_a_run_that_ends_with_fewer_agents_gives_all_of_its_results(text: str) -> None:
    assert run(str(write(text))).exit_code == 0
    summary = summary_of()
    assert summary["relative_error"].tolist() == pytest.approx([0.2818, 0.2403], abs=5e-5)
    assert not summary.isna().any(axis=None)
    best = pd.read_parquet("results/five/optimum.parquet")
    assert best["agent"].astype(int).tolist() == [1, 2, 3, 4] * 2
    assert best.groupby("resource", observed=True)["allocation"].sum().tolist() == pytest.approx([4.0, 3.0])
    page = report_run(load_run("results/five"))
    (shares,) = (chart.spec for chart in page.charts if chart.id == "shares")
    held: dict[str, list[float]] = {"memory": [], "bandwidth": []}
    for row in values(shares):
        held[row["resource"]].append(row["held"])
    average = in_python(text).average_at_end[1:]
    assert held["memory"] == pytest.approx((average[:, 0] / (4.0 / 4)).tolist(), rel=1e-4)
    assert held["bandwidth"] == pytest.approx((average[:, 1] / (3.0 / 4)).tolist(), rel=1e-4)


@pytest.mark.parametrize("text", NOBODY.values(), ids=NOBODY)
def test_a_run_that_ends_with_nobody_gives_all_that_there_is(text: str) -> None:
    assert run(str(write(text))).exit_code == 0
    summary = summary_of()
    missing = ["utilisation", "relative_error", "misallocation", "consensus_spread", "cost_ratio"]
    assert summary.columns[summary.isna().any()].tolist() == missing
    assert (summary["signals"] > 0).all() == ("crash" in text)
    page = report_run(load_run("results/five"))
    assert page.notes[0].startswith("What theory expects of the misallocation: interventions = ")
    assert page.notes[1:] == ["Averages against the optimum: no agent is here at the end."]
    assert "shares" not in {chart.id for chart in page.charts}
    assert "Utilisation" not in [found.name for found in page.verdicts]
    assert "no agent is here" in render(page)
    said("show", "results/five")
    said("compare", "results/five", "results/five")


def test_an_agent_that_comes_too_late_has_no_share() -> None:
    assert run(str(write(leaving("join", [0], 200.0)))).exit_code == 0
    result = in_python(leaving("join", [0], 200.0))
    assert result.average_at_end[0].tolist() == [0.0, 0.0]
    assert not result.history[-1].present[0]
    assert not summary_of().isna().any(axis=None)


def test_a_sweep_measures_runs_in_which_agents_are_gone() -> None:
    crashes = {
        name: {"interventions": [{"kind": "crash", "agents": agents, "at": 50.0}]}
        for name, agents in (("one", [0]), ("all", EVERYBODY))
    }
    scenario = {key: value for key, value in tomllib.loads(FIVE.format(until=200)).items() if key != "seed"}
    design = {"scenario": scenario, "axes": [{"name": "who", "cases": crashes}], "replications": 2}
    with ThreadPoolExecutor(1) as executor:
        run_study(Study.model_validate(design), Path("out"), executor, 1)
    runs = load_study(Path("out")).runs.set_index("who")
    assert len(runs) == 4 * 2
    assert runs.loc["one", "relative_error"].tolist() == [
        value
        for seed in runs.loc["one", "seed"].unique()
        for value in in_python(GONE["crash"].replace("seed = 0", f"seed = {seed}")).summary()[
            "relative_error"
        ]
    ]
    assert runs.loc["all", ["utilisation", "relative_error"]].isna().all(axis=None)
    assert (runs.loc["all", "signals"] > 0).all()
    assert invoke("report", "out").exit_code == 0
    assert invoke("show", "out").exit_code == 0


def test_watching_a_run_in_which_nobody_is_left() -> None:
    outcome = invoke("watch", str(write(NOBODY["crash"])))
    assert outcome.exit_code == 0, outcome.output
    assert "used -, misallocation -" in outcome.stdout.splitlines()[-2]


# -- figures -----------------------------------------------------------------------------------------------

N = 6


def changed(*declared: Any) -> Result:
    problem = random_problem(3, N, 2)
    recording = Recording(allocations=2.0, demand=2.0)
    simulation = Simulation(problem, seed=1, recording=recording, interventions=declared)
    return quietly(simulation.run, 400.0)


@pytest.fixture(scope="module")
def moved() -> Result:
    """A capacity falls at 100, and an agent leaves at 200."""
    first = random_problem(3, N, 2).resources[0]
    return changed(
        interventions.CapacityStep(first.name, 100.0, 0.5 * first.capacity), interventions.Crash([2], 200.0)
    )


def panel() -> Axes:
    return Figure().add_subplot()


def lines(axes: Axes, style: str = "-") -> list[np.ndarray]:
    found = [np.asarray(line.get_xydata()) for line in axes.get_lines() if line.get_linestyle() == style]
    return [line for line in found if len(line) > 1]


def test_errors_over_time_are_those_of_tracking(moved: Result) -> None:
    tracking = moved.tracking.set_index(["time", "resource"])["relative_error"].unstack()  # noqa: PD010
    for j, line in enumerate(lines(plots.relative_error(panel(), moved))):
        assert line[:, 1] == pytest.approx(tracking.loc[line[:, 0]].to_numpy()[:, j], rel=1e-12)
    for j, line in enumerate(lines(plots.error_decay(panel(), moved, measure="relative_error"))[:2]):
        assert line[:, 1] == pytest.approx(tracking.loc[line[:, 0]].to_numpy()[:, j], rel=1e-12)


def test_panels_end_at_the_measures_of_the_summary(moved: Result) -> None:
    summary = moved.summary()
    assert lines(plots.cost_ratio(panel(), moved))[0][-1, 1] == pytest.approx(summary["cost_ratio"].iloc[0])
    decay = lines(plots.error_decay(panel(), moved))
    assert [line[-1, 1] for line in decay[:2]] == pytest.approx(summary["misallocation"].tolist())
    best = moved.optimum
    assert best is not None
    distance = np.abs(np.delete(moved.average_at_end, 2, axis=0) - best.allocation)
    medians = [line[-1, 1] for line in lines(plots.absolute_error(panel(), moved))]
    scale = plots.units.scale_for_agents(moved.problem).divisor
    assert medians == pytest.approx((np.median(distance, axis=0) / scale).tolist())
    histogram = plots.error_histogram(panel(), moved, None, 0)
    assert sum(bar.get_height() for bar in histogram.patches) == N - 1
    offsets = plots.averages_against_optimum(panel(), moved, None, 0).collections[0].get_offsets()
    assert np.asarray(offsets)[:, 0].tolist() == best.allocation[:, 0].tolist()


def test_dashed_lines_step_to_the_optimum_in_force_and_end_with_the_agent(moved: Result) -> None:
    first, second, third = (moved.optimum_of(piece) for piece in moved.history)
    assert first is not None
    assert second is not None
    assert third is not None
    scale = plots.units.scale_for_agents(moved.problem).divisor[0]
    axes = plots.average_allocations(panel(), moved, agents=[2, 3])
    gone, stays = lines(axes, "--")[:2]
    for time, of in ((90.0, first), (150.0, second)):
        for line, agent in ((gone, 2), (stays, 3)):
            assert np.interp(time, *line.T) == pytest.approx(of.allocation[agent, 0] / scale, rel=1e-9)
    assert np.isnan(gone[-1, 1])
    assert stays[-1, 1] == third.allocation[2, 0] / scale
    multipliers = lines(plots.derivatives(panel(), moved), "--")
    assert [line[0, 1] for line in multipliers[:2]] == first.multipliers.tolist()
    assert [line[-1, 1] for line in multipliers[:2]] == third.multipliers.tolist()


@pytest.mark.parametrize("at", [0.0, 200.0])
def test_figures_of_a_run_with_nobody_can_be_drawn(at: float) -> None:
    gone = changed(interventions.Crash(list(range(N)), at))
    for figure in plots.paper_figures(gone).values():
        figure.canvas.draw()
    for draw in (plots.consensus, plots.error_decay, plots.tracking_error, plots.tracking_level):
        figure = Figure()
        draw(figure.add_subplot(), gone)
        figure.canvas.draw()
    for draw_one in (plots.error_histogram, plots.averages_against_optimum):
        (text,) = draw_one(panel(), gone, None, 0).texts
        assert text.get_text() == "No agent is here at the end of the run."


def test_figures_of_a_run_in_which_nobody_is_left_are_written() -> None:
    outcome = invoke("run", str(write(NOBODY["crash"])))
    assert outcome.exit_code == 0, outcome.output
    # Four of every run, one of demand against a capacity that changes and of agents that leave, and one of
    # the copies that they lose.
    names = {path.stem for path in Path("results/five").glob("*.png")}
    assert names == {"figure1", "figure2", "figure3", "figure4", "figure5", "channel"}


def test_the_optimum_of_other_agents_is_refused_and_told_to_be_left_out(moved: Result) -> None:
    old = solve_optimum(moved.problem)
    sentence = (
        r"^shape of optimum.allocation = \(6, 2\): must be \(5, 2\), for the agents that are here at the end"
        r"; leave it out, and it is solved for$"
    )
    for ask in (moved.summary, lambda optimum: moved.measures(optimum, ["signals"])):
        with pytest.raises(InputError, match=sentence):
            ask(old)
    with pytest.raises(InputError, match=sentence):
        plots.paper_figures(moved, old)
