"""Panels show what the result holds, with units, for any number of agents, however it was recorded."""

from collections.abc import Callable

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aimd_des import (
    InputError,
    PolynomialCosts,
    Problem,
    Recording,
    Resource,
    Result,
    run_synchronous,
    solve_optimum,
)
from aimd_des.plots import (
    absolute_error,
    average_allocations,
    capacity_events,
    colour,
    cost_ratio,
    derivatives,
    error_histogram,
    instantaneous_allocations,
    paper_figures,
    relative_error,
    sum_of_averages,
    sum_of_demand,
)
from aimd_des.plots.selection import typical_agents, window
from aimd_des.problem.optimum import Optimum
from aimd_des.results.looks import looks
from tests.forks import forks

UNITS = ("GB", "10 GB", "Mbps", "kW", "litres", "km")
FULL = Recording("auto", "auto", tail=100)
END = Recording("end", "end")

OVER_TIME: list[Callable[[Axes, Result, Optimum], Axes]] = [
    average_allocations,
    derivatives,
    absolute_error,
    relative_error,
    cost_ratio,
    lambda axes, result, _: instantaneous_allocations(axes, result),
    lambda axes, result, _: sum_of_averages(axes, result),
    lambda axes, result, _: sum_of_demand(axes, result),
]


def problem(n: int, m: int, spread: float = 1.0, units: tuple[str, ...] = UNITS) -> Problem:
    """Costs of the same shape for every resource; capacities grow by the factor `spread`."""
    capacity = 4.0 * spread ** np.arange(m)
    share = capacity / n
    factors = np.random.default_rng([n, m]).uniform(1.0, 3.0, (n, m, 2))
    costs = PolynomialCosts([2, 4], factors * np.stack([share**-2, share**-4], axis=-1))
    resources = [
        Resource(f"resource {j}", capacity[j], share[j] / 20, 0.7, share[j] ** 2 / 60, unit=units[j])
        for j in range(m)
    ]
    return Problem(resources, costs)


def drawn(n: int, m: int, steps: int, recording: Recording = FULL, **kind: object) -> tuple[Result, Optimum]:
    shared = problem(n, m, **kind)  # type: ignore[arg-type]
    return run_synchronous(shared, steps=steps, seed=1, recording=recording), solve_optimum(shared)


def empty_axes() -> Axes:
    return Figure(figsize=(4.0, 3.5)).add_subplot()


def curves(axes: Axes, of: str) -> list[np.ndarray]:
    """What is drawn in one colour as solid lines, without what only stands in the legend."""
    return [
        np.asarray(line.get_xydata())
        for line in axes.get_lines()
        if line.get_color() == of and line.get_linestyle() == "-" and len(line.get_xydata()) > 1
    ]


def dashed(axes: Axes) -> list[float]:
    """Heights of the dashed horizontal lines."""
    lines = [line for line in axes.get_lines() if line.get_linestyle() == "--" and len(line.get_xydata())]
    return [float(line.get_ydata()[0]) for line in lines]


@pytest.fixture(scope="module")
def run() -> tuple[Result, Optimum]:
    return drawn(30, 3, 2000)


def test_averages_end_where_the_run_ends_beside_their_optima(run: tuple[Result, Optimum]) -> None:
    result, optimum = run
    axes = average_allocations(empty_axes(), result, optimum, agents=[4, 7])
    for j in range(3):
        ends = [curve[-1].tolist() for curve in curves(axes, colour(j))]
        assert ends == [[2000.0, result.average_at_end[i, j]] for i in (4, 7)]
    assert sorted(dashed(axes)) == sorted(optimum.allocation[[4, 7]].ravel().tolist())


def test_demand_of_the_last_steps_is_that_of_every_step(run: tuple[Result, Optimum]) -> None:
    result, _ = run
    axes = instantaneous_allocations(empty_axes(), result, last=50, agents=[3])
    (curve,) = curves(axes, colour(2))
    assert curve[:, 0].tolist() == list(range(1950, 2001))
    assert curve[:, 1].tolist() == result.observations.demand[-51:, 2, 3].tolist()


def test_derivatives_show_mean_and_spread_over_all_agents(run: tuple[Result, Optimum]) -> None:
    result, optimum = run
    axes = derivatives(empty_axes(), result, optimum)
    gradient = result.problem.costs.gradient(result.average_at_end)
    for j, container in enumerate(axes.containers):
        line, _, (bars,) = container
        assert line.get_ydata()[-1] == pytest.approx(gradient[:, j].mean(), rel=1e-12)
        low, high = bars.get_segments()[-1][:, 1]
        assert high - low == pytest.approx(2 * gradient[:, j].std(), rel=1e-12)
    assert dashed(axes) == optimum.multipliers.tolist()


def test_errors_end_at_the_measures_of_the_summary(run: tuple[Result, Optimum]) -> None:
    result, optimum = run
    summary = result.summary(optimum)
    axes = relative_error(empty_axes(), result, optimum)
    ends = [float(curves(axes, colour(j))[0][-1, 1]) for j in range(3)]
    assert ends == pytest.approx(summary["relative_error"].tolist(), rel=1e-12)
    (curve,) = curves(cost_ratio(empty_axes(), result, optimum), "black")
    assert curve[-1, 1] == pytest.approx(summary["cost_ratio"].iloc[0], rel=1e-12)
    middle = curves(absolute_error(empty_axes(), result, optimum), colour(1))[0][-1, 1]
    assert middle == np.quantile(np.abs(result.average_at_end - optimum.allocation)[:, 1], 0.5)


def test_another_optimum_gives_another_error(run: tuple[Result, Optimum]) -> None:
    """The negative control of the test above: a wrong reference must show."""
    result, _ = run
    wrong = solve_optimum(result.problem, capacity=1.01 * result.problem.capacity)
    axes = relative_error(empty_axes(), result, wrong)
    ends = [float(curves(axes, colour(j))[0][-1, 1]) for j in range(3)]
    assert ends != pytest.approx(result.summary()["relative_error"].tolist(), rel=1e-6)
    (curve,) = curves(cost_ratio(empty_axes(), result, wrong), "black")
    right = result.summary()["cost_ratio"].iloc[0]
    assert curve[-1, 1] != pytest.approx(right, rel=1e-6)


def test_every_agent_is_in_the_histogram(run: tuple[Result, Optimum]) -> None:
    result, optimum = run
    for j in range(3):
        axes = error_histogram(empty_axes(), result, optimum, j)
        assert sum(bar.get_height() for bar in axes.patches) == 30
        assert axes.get_xlabel() == f"|average − optimum| of resource {j} ({UNITS[j]})"


def test_totals_end_at_those_of_the_run_beside_the_capacities(run: tuple[Result, Optimum]) -> None:
    result, _ = run
    for draw, recorded in (
        (sum_of_averages, result.observations.total_average),
        (sum_of_demand, result.observations.total_demand),
    ):
        axes = draw(empty_axes(), result)
        assert [curves(axes, colour(j))[0][-1, 1] for j in range(3)] == recorded[-1].tolist()
        assert dashed(axes) == result.problem.capacity.tolist()


def test_capacity_events_are_counted_for_every_run(run: tuple[Result, Optimum]) -> None:
    result, _ = run
    other = run_synchronous(result.problem, steps=2000, seed=2)
    axes = capacity_events(empty_axes(), [result, other])
    for j in range(3):
        last = sorted(float(curve[-1, 1]) for curve in curves(axes, colour(j)))
        assert last == sorted(float((r.signals_sent.resource == j).sum()) for r in (result, other))


def test_runs_with_other_resources_are_refused(run: tuple[Result, Optimum]) -> None:
    result, optimum = run
    other, _ = drawn(5, 2, 50)
    with pytest.raises(InputError, match="runs with the same resources"):
        capacity_events(empty_axes(), [result, other])
    with pytest.raises(InputError, match="at least one run"):
        paper_figures([], optimum)


def test_every_axis_has_a_label_and_amounts_have_units(run: tuple[Result, Optimum]) -> None:
    result, optimum = run
    figures = paper_figures([result, result], optimum)
    assert list(figures) == ["figure1", "figure2", "figure3", "figure4"]
    for figure in figures.values():
        assert len(figure.axes) == 3
        assert all(
            axes.get_xlabel() and axes.get_ylabel() and axes.get_title(loc="left") for axes in figure.axes
        )
    with_units = [*figures["figure1"].axes, figures["figure2"].axes[0], *figures["figure4"].axes[:2]]
    assert all("GB, 10 GB, Mbps)" in axes.get_ylabel() for axes in with_units)
    legend = [text.get_text() for text in figures["figure1"].legends[0].get_texts()]
    optima = ["optimum", "optimum for what is used"]
    assert legend == ["resource 0 (GB)", "resource 1 (10 GB)", "resource 2 (Mbps)", *optima]


@pytest.mark.parametrize(
    ("n", "m", "spread", "steps"),
    [
        (1, 1, 1.0, 30),
        (2, 1, 1.0, 400),
        (7, 2, 1000.0, 400),
        (12, 4, 1.5, 60),
        (9, 6, 20.0, 300),
        (3, 3, 1.0, 1),
    ],
)
def test_any_number_of_agents_and_resources(n: int, m: int, spread: float, steps: int) -> None:
    figures = paper_figures(*drawn(n, m, steps, spread=spread))
    assert len(figures["figure3"].axes) == m
    for figure in figures.values():
        figure.canvas.draw()


def test_resources_that_differ_too_much_are_shown_in_shares() -> None:
    result, optimum = drawn(7, 2, 400, spread=1000.0)
    axes = sum_of_demand(empty_axes(), result)
    assert axes.get_ylabel() == "sum of allocations\n(share of the capacity)"
    assert dashed(axes) == [1.0, 1.0]
    assert "multiples of capacity / agents" in average_allocations(empty_axes(), result, optimum).get_ylabel()


def test_resources_without_units_need_none() -> None:
    result, optimum = drawn(4, 2, 200, units=("", ""))
    assert sum_of_averages(empty_axes(), result).get_ylabel() == "sum of averages"
    assert derivatives(empty_axes(), result, optimum).get_ylabel() == "derivative of cost"


@pytest.mark.parametrize("draw", OVER_TIME)
def test_what_was_not_recorded_is_said(draw: Callable[[Axes, Result, Optimum], Axes]) -> None:
    axes = draw(empty_axes(), *drawn(6, 2, 200, END))
    (text,) = axes.texts
    assert "Too little of the run was recorded" in text.get_text()
    assert "Recording(" in text.get_text()
    assert not axes.get_lines()
    assert axes.get_ylabel()


def test_without_a_tail_the_last_looks_are_shown_as_dots() -> None:
    result, _ = drawn(6, 2, 20_000, Recording("auto", "auto"))
    axes = instantaneous_allocations(empty_axes(), result)
    marks = [line for line in axes.get_lines() if line.get_marker() == "."]
    assert [len(line.get_xdata()) for line in marks] == [101, 101]
    assert marks[0].get_xdata()[-1] == 20_000.0


def test_of_very_many_agents_few_are_drawn() -> None:
    result, optimum = drawn(20_000, 2, 40, Recording("auto", np.arange(0.0, 40.0, 4.0)))
    axes = average_allocations(empty_axes(), result, optimum)
    assert len(curves(axes, colour(0))) == 3
    for figure in paper_figures(result, optimum).values():
        figure.canvas.draw()


def test_typical_agents_span_what_agents_hold(run: tuple[Result, Optimum]) -> None:
    result, _ = run
    ranks = np.argsort(np.argsort(result.average_at_end, axis=0), axis=0)
    chosen = typical_agents(result)
    assert [ranks[agents, j].tolist() for j, agents in enumerate(chosen)] == [[5, 15, 25]] * 3


def test_looks_are_spread_and_end_with_the_last() -> None:
    times = np.arange(0.0, 10_001.0)
    assert times[looks(times, 5)].tolist() == [0.0, 2500.0, 5000.0, 7500.0, 10_000.0]
    assert times[looks(times, 5, log=True)].tolist() == [1.0, 10.0, 100.0, 1000.0, 10_000.0]
    assert looks(np.array([0.0]), 5, log=True).size == 0
    assert looks(np.array([0.0, 3.0]), 5).tolist() == [0, 1]
    assert looks(np.array([7.0]), 5, log=True).tolist() == [0]


def test_a_window_falls_back_on_the_last_looks() -> None:
    sparse, dense = np.arange(0.0, 1000.0, 10.0), np.arange(0.0, 1000.0)
    assert dense[window(dense, 40)].tolist() == list(range(959, 1000))
    assert len(window(sparse, 40)) == 41
    assert window(np.array([5.0]), 40).tolist() == [0]


def test_figures_leave_the_global_state_of_matplotlib_alone() -> None:
    # In a process that has imported what commands import, beside the figures.
    code = "import sys, aimd_des.plots; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert forks().run(code).returncode == 0
