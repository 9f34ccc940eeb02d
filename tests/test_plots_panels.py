"""Panels about signals, the optimum, networks and studies: what is drawn is what was given."""

import io
from xml.etree import ElementTree as ET

import networkx as nx
import numpy as np
import pandas as pd
import pytest
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import LogNorm, TwoSlopeNorm, to_hex
from matplotlib.figure import Figure

from aimd_des import (
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    PolynomialCosts,
    Problem,
    Recording,
    Resource,
    Result,
    Simulation,
    interventions,
    latency,
    loss,
    run_synchronous,
    solve_optimum,
    topology,
)
from aimd_des.plots import (
    agent_timeline,
    averages_against_optimum,
    colour,
    consensus,
    copies,
    demand_and_signals,
    error_decay,
    heat_map,
    latencies,
    network_map,
    paper_figures,
    score,
    shared_legend,
    signal_raster,
    sum_of_demand,
    tracking_error,
    tracking_level,
)
from aimd_des.plots.paper import run_figures
from tests.test_plots import END, FULL, curves, drawn, empty_axes, problem

N, UNTIL = 12, 200.0


def simulated(until: float = UNTIL, **changes: object) -> Result:
    setting: dict[str, object] = {
        "dynamics": "continuous",
        "control_unit": Crossing(hold_off=0.5),
        "channel": BroadcastChannel(latency=latency.Exponential(0.2), loss=loss.Bernoulli(0.2)),
        "agents": Fleet,
        "recording": Recording(demand=0.1, allocations="auto", events=True),
        "seed": 3,
    }
    return Simulation(problem(N, 2), **(setting | changes)).run(until)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def run() -> Result:
    return simulated()


@pytest.fixture(scope="module")
def moved() -> Result:
    step = interventions.CapacityStep("resource 0", at=80.0, capacity=3.0)
    gone = interventions.Absence(["2", "5"], at=120.0, until=500.0)
    return simulated(interventions=[step, gone])


def marks(axes: Axes, marker: str, of: str) -> np.ndarray:
    (line,) = [
        line
        for line in axes.get_lines()
        if line.get_marker() == marker and line.get_color() == of and len(line.get_xdata())
    ]
    return np.asarray(line.get_xydata())


def spots(axes: Axes, label: str) -> np.ndarray:
    (found,) = [one for one in axes.collections if one.get_label() == label]
    assert isinstance(found, PathCollection)
    return np.asarray(found.get_offsets())


def said(axes: Axes) -> str:
    (text,) = axes.texts
    assert not axes.get_lines()
    assert not axes.collections
    return text.get_text()


def test_demand_and_signals_are_those_of_the_window(run: Result) -> None:
    given = empty_axes()
    axes = demand_and_signals(given, run, start=100.0, end=130.0)
    assert axes is given
    seen, sent = run.observations, run.signals_sent
    here = (seen.demand_times >= 100.0) & (seen.demand_times <= 130.0)
    for j in range(2):
        (curve,) = curves(axes, colour(j))
        assert curve.tolist() == np.column_stack([seen.demand_times, seen.total_demand[:, j]])[here].tolist()
        due = sent.time[(sent.resource == j) & (sent.time >= 100.0) & (sent.time <= 130.0)]
        assert due.size > 3
        assert marks(axes, "v", colour(j)).tolist() == [[time, run.problem.capacity[j]] for time in due]
    assert axes.get_ylabel() == "sum of demands (GB, 10 GB)"
    assert axes.get_xlabel() == "time"
    assert axes.get_xlim() == (100.0, 130.0)


def test_signals_stand_on_the_threshold_of_the_capacity_in_force(moved: Result) -> None:
    axes = demand_and_signals(empty_axes(), moved)
    times, levels = marks(axes, "v", colour(0)).T
    # 3 is an awkward number only for whoever forgets the intervention.
    assert set(levels[times < 80.0]) == {4.0}
    assert set(levels[times > 80.0]) == {3.0}
    for panel in (axes, sum_of_demand(empty_axes(), moved, last=150)):
        (dashes,) = [
            line
            for line in panel.get_lines()
            if line.get_linestyle() == "--" and line.get_color() == colour(0) and len(line.get_xdata())
        ]
        assert dashes.get_drawstyle() == "steps-post"
        assert list(dict.fromkeys(dashes.get_ydata())) == [4.0, 3.0]
        assert 80.0 in dashes.get_xdata()


def test_discrete_demand_is_drawn_in_steps() -> None:
    result = run_synchronous(problem(6, 1), steps=60, seed=1)
    (curve,) = [
        line for line in demand_and_signals(empty_axes(), result).get_lines() if line.get_ls() == "-"
    ][:1]
    assert curve.get_drawstyle() == "steps-post"


def test_a_window_with_too_few_looks_says_so(run: Result) -> None:
    assert "Fewer than two samples" in said(demand_and_signals(empty_axes(), run, start=10.01, end=10.05))


@pytest.mark.parametrize(
    ("window", "message"),
    [
        ({"start": -1.0}, "start = -1.0: must be a finite number at least 0"),
        ({"start": 200.0}, "less than 200"),
        ({"start": 50.0, "end": 50.0}, "end = 50.0: must be a finite number greater than 50"),
        ({"end": 201.0}, "at most 200, the end of the run"),
    ],
)
def test_windows_outside_the_run_are_refused(run: Result, window: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        demand_and_signals(empty_axes(), run, **window)
    with pytest.raises(InputError, match=message):
        signal_raster(empty_axes(), run, 0, **window)


def test_the_raster_is_the_log(run: Result) -> None:
    axes = signal_raster(empty_axes(), run, 1, start=50.0, end=90.0, agents=[7, 2, 5])
    events = run.events
    here = events[(events["resource"] == "resource 1") & events["time"].between(50.0, 90.0)]
    names = {"7": 0, "2": 1, "5": 2}
    for kind, label in (("deliver", "heard"), ("respond", "responded"), ("lost", "lost")):
        rows = here[(here["kind"] == kind) & here["agent"].isin(list(names))]
        expected = sorted(zip(rows["time"], rows["agent"].astype(str).map(names), strict=True))
        assert len(expected) > 3
        assert sorted(map(tuple, spots(axes, label).tolist())) == expected
    (lines,) = [one for one in axes.collections if one.get_label() == "broadcast"]
    assert isinstance(lines, LineCollection)
    sent = here[here["kind"] == "signal"]["time"].tolist()
    assert [path[0, 0] for path in lines.get_segments()] == sent
    assert [text.get_text() for text in axes.get_yticklabels()] == ["7", "2", "5"]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time", "agent")


def test_the_score_has_every_copy_from_its_signal_to_its_arrival(run: Result) -> None:
    axes = score(empty_axes(), run, 1, start=50.0, end=90.0, agents=[7, 2, 5])
    events, rows = run.events, {"7": 0, "2": 1, "5": 2}
    own = events[events["resource"] == "resource 1"]
    sent = own[own["kind"] == "signal"].set_index("number")["time"]
    copies = own[own["kind"].isin(["deliver", "lost"]) & own["agent"].isin(list(rows))]
    begun = sent.loc[copies["number"]].to_numpy()
    copies = copies.assign(begun=begun, row=copies["agent"].astype(str).map(rows))
    copies = copies[(copies["time"] >= 50.0) & (begun <= 90.0)]
    (ways,) = [one for one in axes.collections if one.get_label() == "on its way"]
    assert isinstance(ways, LineCollection)
    late = copies[copies["time"] > copies["begun"]]
    expected = sorted(zip(late["begun"], late["row"], late["time"], strict=True))
    drawn_ways = [(path[0, 0], path[0, 1], path[1, 0]) for path in ways.get_segments()]
    assert len(expected) > 10
    assert sorted(drawn_ways) == expected
    lost = copies[copies["kind"] == "lost"]
    assert sorted(map(tuple, spots(axes, "lost").tolist())) == sorted(
        zip(lost["time"], lost["row"], strict=True)
    )
    responded = own[(own["kind"] == "respond") & own["agent"].isin(list(rows))]
    answers = set(zip(responded["agent"], responded["number"], strict=True))
    heard = copies[copies["kind"] == "deliver"]
    number = sum(pair in answers for pair in zip(heard["agent"], heard["number"], strict=True))
    assert len(spots(axes, "arrives, responds")) == number > 3
    assert len(spots(axes, "arrives, holds")) == len(heard) - number


def test_the_line_of_an_agent_has_its_demand_and_its_copies(run: Result) -> None:
    axes = agent_timeline(empty_axes(), run, 3, 0, start=50.0, end=90.0)
    seen = run.observations
    inside = (seen.allocation_times >= 50.0) & (seen.allocation_times <= 90.0)
    (demand,) = [one for one in axes.get_lines() if one.get_label() == "demand"]
    assert np.asarray(demand.get_ydata()).tolist() == seen.demand[inside, 0, 3].tolist()
    (crosses,) = [one for one in axes.get_lines() if one.get_label() == "copy lost"]
    events = run.events
    own = events[(events["resource"] == "resource 0") & (events["agent"] == "3")]
    sent = events[(events["resource"] == "resource 0") & (events["kind"] == "signal")]
    times = sent.set_index("number")["time"].loc[own[own["kind"] == "lost"]["number"]]
    expected = times[(times >= 50.0) & (times <= 90.0)].tolist()
    assert len(expected) > 0
    assert np.asarray(crosses.get_xdata()).tolist() == expected
    with pytest.raises(InputError, match="agent = 12"):
        agent_timeline(empty_axes(), run, 12, 0)
    silent, _ = drawn(3, 1, 20)
    assert "Recording(events=True)" in said(agent_timeline(empty_axes(), silent, 0, 0))
    assert "Recording(events=True)" in said(score(empty_axes(), silent, 0))


def test_what_is_lost_has_another_colour_than_what_is_answered(run: Result) -> None:
    for j in range(2):
        axes = signal_raster(empty_axes(), run, j)
        of = {
            one.get_label(): to_hex(one.get_edgecolors()[0])
            for one in axes.collections
            if one.get_label() in {"responded", "lost"}
        }
        assert of["responded"] == colour(j).lower()
        assert of["lost"] != of["responded"]


def test_bars_are_the_shares_of_what_became_of_copies(run: Result) -> None:
    account = run.account
    parts = np.stack([account.delivered[1], account.in_flight[1], account.lost[1]])
    axes = copies(empty_axes(), run, 1)
    heights = np.array([[bar.get_height() for bar in group] for group in axes.containers])
    assert heights == pytest.approx(100.0 * parts / parts.sum(axis=0), rel=1e-12)
    assert parts.any(axis=1).all()
    assert [group.get_label() for group in axes.containers] == ["delivered", "in flight", "lost"]
    # The agents are named, as many as there is room for.
    assert [text.get_text() for text in axes.get_xticklabels()] == ["0", "2", "4", "6", "8", "10"]
    short = simulated(until=0.5)
    assert "No signal of resource 0 was sent" in said(copies(empty_axes(), short, 0))
    assert "No copy of a signal has arrived" in said(latencies(empty_axes(), short))
    silent, _ = drawn(3, 1, 20)
    assert "Recording(events=True)" in said(latencies(empty_axes(), silent))
    with pytest.raises(InputError, match="resource = 2"):
        copies(empty_axes(), run, 2)


def test_latencies_are_those_between_signal_and_arrival(run: Result) -> None:
    events = run.events
    keys = ["resource", "number"]
    sent = events[events["kind"] == "signal"].set_index(keys)["time"]
    came = events[(events["kind"] == "deliver") & (events["resource"] == "resource 1")]
    taken = np.sort(came["time"].to_numpy() - sent.loc[pd.MultiIndex.from_frame(came[keys])].to_numpy())
    axes = latencies(empty_axes(), run)
    (line,) = curves(axes, colour(1))
    assert line[:, 0].tolist() == taken.tolist()
    assert line[0, 1] == 100.0
    assert line[-1, 1] == pytest.approx(100.0 / len(taken))


def test_a_run_has_a_figure_of_its_channel_where_copies_are_late_or_lost(run: Result) -> None:
    titles = [axes.get_title(loc="left") for axes in run_figures(run)["channel"]().axes]
    assert titles == [
        "(a) Copies of signals of resource 0",
        "(b) Copies of signals of resource 1",
        "(c) Latency of all copies",
    ]
    perfect, _ = drawn(3, 1, 20)
    assert "channel" not in run_figures(perfect)


def test_a_raster_without_log_or_signals_says_so(run: Result) -> None:
    silent, _ = drawn(3, 1, 20)
    assert "Recording(events=True)" in said(signal_raster(empty_axes(), silent, 0))
    assert "No signal of resource 0" in said(signal_raster(empty_axes(), run, 0, end=0.01))
    with pytest.raises(InputError, match="resource = 2"):
        signal_raster(empty_axes(), run, 2)
    with pytest.raises(InputError, match="agent = 12"):
        signal_raster(empty_axes(), run, 0, agents=[3, 12])


def test_averages_stand_over_their_optima(run: Result) -> None:
    optimum = solve_optimum(run.problem)
    axes = averages_against_optimum(empty_axes(), run, optimum, 1)
    expected = np.column_stack([optimum.allocation[:, 1], run.average_at_end[:, 1]])
    assert np.array_equal(np.asarray(axes.collections[0].get_offsets()), expected)
    (line,) = [line for line in axes.get_lines() if line.get_linestyle() == "--"]
    assert np.array_equal(line.get_xdata(), line.get_ydata())
    assert axes.get_xlabel() == "optimal allocation (10 GB)"
    assert axes.get_ylabel() == "average (10 GB)"


def test_averages_are_of_those_who_are_here(moved: Result) -> None:
    piece = moved.history[-1]
    optimum = solve_optimum(problem(N, 2))
    with pytest.raises(InputError, match=r"shape of optimum.allocation = \(12, 2\): must be \(10, 2\)"):
        averages_against_optimum(empty_axes(), moved, optimum, 0)
    assert int(piece.present.sum()) == 10
    with pytest.raises(InputError, match="resource = 5"):
        averages_against_optimum(empty_axes(), moved, optimum, 5)


def test_when_nobody_is_left_it_is_said() -> None:
    everybody = [str(i) for i in range(N)]
    gone = simulated(
        interventions=[interventions.Absence(everybody, at=100.0, until=900.0)], recording=Recording("end")
    )
    text = said(averages_against_optimum(empty_axes(), gone, solve_optimum(gone.problem), 0))
    assert text == "No agent is here at the end of the run."


def test_consensus_shows_quantiles_in_multiples_of_the_multiplier(run: Result) -> None:
    optimum = solve_optimum(run.problem)
    axes = consensus(empty_axes(), run, optimum)
    gradient = run.problem.costs.gradient(run.average_at_end) / optimum.multipliers
    bands = list(axes.collections)
    for j in range(2):
        (curve,) = curves(axes, colour(j))
        assert curve[-1, 1] == pytest.approx(np.quantile(gradient[:, j], 0.5), rel=1e-12)
        heights = bands[j].get_paths()[0].vertices
        at_end = heights[heights[:, 0] == UNTIL][:, 1]
        assert [at_end.min(), at_end.max()] == pytest.approx(
            np.quantile(gradient[:, j], (0.05, 0.95)).tolist()
        )
    assert "multiples of the optimal multiplier" in axes.get_ylabel()


def test_error_decay_is_the_mean_of_the_runs_beside_the_slope() -> None:
    runs = [run_synchronous(problem(8, 2), steps=400, seed=seed, recording=FULL) for seed in (1, 2)]
    axes = error_decay(empty_axes(), runs, slope=-0.5)
    for j in range(2):
        expected = np.mean([run.summary()["misallocation"].iloc[j] for run in runs])
        assert curves(axes, colour(j))[0][-1, 1] == pytest.approx(expected, rel=1e-9)
    (reference,) = [line for line in axes.get_lines() if line.get_linestyle() == ":"]
    (x0, y0), (x1, y1) = reference.get_xydata()[[0, -1]]
    assert np.log(y1 / y0) / np.log(x1 / x0) == pytest.approx(-0.5, rel=1e-12)
    assert axes.get_xscale() == axes.get_yscale() == "log"
    other = error_decay(empty_axes(), runs[0], measure="relative_error")
    ends = [float(curves(other, colour(j))[0][-1, 1]) for j in range(2)]
    assert ends == pytest.approx(runs[0].summary()["relative_error"].tolist(), rel=1e-12)
    assert other.get_ylabel().startswith("relative error")


def test_error_decay_refuses_what_cannot_be_averaged() -> None:
    one, _ = drawn(5, 2, 50)
    two, _ = drawn(5, 2, 60)
    for wrong in ([], [one, two]):
        with pytest.raises(InputError, match="recorded alike"):
            error_decay(empty_axes(), wrong)
    with pytest.raises(InputError, match="measure = 'cost'"):
        error_decay(empty_axes(), one, measure="cost")  # type: ignore[arg-type]


def test_tracking_is_that_of_the_result(moved: Result) -> None:
    frame = moved.tracking
    for draw, column in ((tracking_error, "relative_error"), (tracking_level, "level")):
        axes = draw(empty_axes(), moved)
        for j in range(2):
            rows = frame[(frame["resource"] == f"resource {j}") & (frame["time"] > 0)]
            assert curves(axes, colour(j))[0].tolist() == rows[["time", column]].to_numpy().tolist()
        dotted = [
            line.get_xdata()[0] for line in axes.get_lines() if line.get_ls() == ":" and len(line.get_xdata())
        ]
        assert dotted == [80.0, 120.0]
        assert "in force" in axes.get_ylabel()


def test_panels_over_time_say_what_was_not_recorded() -> None:
    result, optimum = drawn(6, 2, 100, END)
    for axes in (
        consensus(empty_axes(), result, optimum),
        error_decay(empty_axes(), result),
        tracking_error(empty_axes(), result),
        tracking_level(empty_axes(), result),
    ):
        assert "Recording(" in said(axes)
        assert axes.get_ylabel()


FRAME = pd.DataFrame(
    {
        "loss": [0.0, 0.0, 0.1, 0.5, 0.0, 0.1, 0.5],
        "latency_mean": [1.0, 1.0, 1.0, 1.0, 10.0, 10.0, 10.0],
        "peak": [1.0, 3.0, 4.0, 5.0, 6.0, np.nan, 8.0],
    }
)


def test_a_heat_map_shows_means_over_equal_cells() -> None:
    units = {"latency_mean": "periods", "peak": "of the capacity"}
    axes = heat_map(empty_axes(), FRAME, "loss", "latency_mean", "peak", units=units)
    (mesh,) = axes.collections
    assert np.ma.filled(mesh.get_array(), -1.0).tolist() == [[2.0, 4.0, 5.0], [6.0, -1.0, 8.0]]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["0", "0.1", "0.5"]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["1", "10"]
    assert [text.get_text() for text in axes.texts] == ["2", "4", "5", "6", "8"]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("loss", "latency mean (periods)")
    assert axes.figure.axes[1].get_ylabel() == "peak (of the capacity)"
    assert mesh.get_cmap().name == "cividis"


def test_a_heat_map_diverges_only_from_a_middle() -> None:
    (mesh,) = heat_map(empty_axes(), FRAME, "loss", "latency_mean", "peak", middle=4.0).collections
    assert mesh.get_cmap().name == "PuOr_r"
    assert mesh.norm(4.0) == 0.5
    assert mesh.norm.vmax - 4.0 == 4.0 - mesh.norm.vmin == 4.0


def test_heat_maps_with_one_norm_share_its_colours_and_have_no_bar() -> None:
    axes = heat_map(empty_axes(), FRAME, "loss", "latency_mean", "peak", norm=LogNorm(4.0, 10.0))
    (mesh,) = axes.collections
    assert axes.figure.axes == [axes]
    assert np.ma.filled(mesh.get_array(), -1.0).tolist() == [[4.0, 4.0, 5.0], [6.0, -1.0, 8.0]]
    assert [text.get_text() for text in axes.texts] == ["2", "4", "5", "6", "8"]
    around = heat_map(empty_axes(), FRAME, "loss", "latency_mean", "peak", norm=TwoSlopeNorm(4.0, 0.0, 9.0))
    assert around.collections[0].get_cmap().name == "PuOr_r"


def test_the_curve_of_theory_stands_between_the_cells() -> None:
    boundary = ([0.0, 0.05, 0.3, 0.5, 0.9], [1.0, 1.0, 5.5, 10.0, 19.0])
    axes = heat_map(empty_axes(), FRAME, "loss", "latency_mean", "peak", boundary=boundary)
    (line,) = axes.get_lines()
    assert line.get_xdata() == pytest.approx([0.0, 0.5, 1.5, 2.0, 3.0])
    assert line.get_ydata() == pytest.approx([0.0, 0.0, 0.5, 1.0, 2.0])
    assert line.get_label() == "theory"


def test_words_are_welcome_on_an_axis_of_a_heat_map() -> None:
    frame = FRAME.assign(
        way=pd.Categorical(["tree"] * 4 + ["flood"] * 3, categories=["tree", "flood", "none"])
    )
    axes = heat_map(empty_axes(), frame, "loss", "way", "peak")
    assert [text.get_text() for text in axes.get_yticklabels()] == ["tree", "flood"]
    with pytest.raises(InputError, match="a curve over 'way'"):
        heat_map(empty_axes(), frame, "loss", "way", "peak", boundary=([0.0], [0.0]))


def test_heat_maps_refuse_what_is_no_frame_of_numbers() -> None:
    with pytest.raises(InputError, match="column = 'los'"):
        heat_map(empty_axes(), FRAME, "los", "latency_mean", "peak")
    with pytest.raises(InputError, match="a column of numbers"):
        heat_map(empty_axes(), FRAME.assign(peak="high"), "loss", "latency_mean", "peak")
    with pytest.raises(InputError, match="a norm of matplotlib"):
        heat_map(empty_axes(), FRAME, "loss", "latency_mean", "peak", norm="log")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="as many x as y"):
        heat_map(empty_axes(), FRAME, "loss", "latency_mean", "peak", boundary=([0.0, 0.1], [1.0]))
    assert said(heat_map(empty_axes(), FRAME[:0], "loss", "latency_mean", "peak")).startswith(
        "There is no run"
    )


def test_a_network_shows_latency_as_colour_and_loss_as_line() -> None:
    graph = topology.star(4, latency=[0.1, 0.2, 0.3, 0.4], loss=[0.0, 0.03, 0.03, 0.5])
    axes = network_map(empty_axes(), graph)
    collections = [one for one in axes.collections if isinstance(one, LineCollection)]
    assert [one.get_array().tolist() for one in collections] == [[0.1], [0.2, 0.3], [0.4]]
    assert [one.get_clim() for one in collections] == [(0.1, 0.4)] * 3
    legend = axes.get_legend_handles_labels()[1]
    assert legend == ["no loss", "loss up to 5 %", "loss above 20 %", "agent or relay", "control unit"]
    assert spots(axes, "control unit").tolist() == [[0.0, 0.0]]
    distance = np.hypot(*spots(axes, "agent or relay").T)
    assert distance == pytest.approx(np.ones(4))
    assert "units of time" in axes.figure.axes[1].get_ylabel()


@pytest.mark.parametrize(
    "graph",
    [
        topology.grid(3, 4, latency=0.1, loss=0.1),
        topology.balanced_tree(2, 3, latency=0.1),
        topology.random_geometric(30, 0.5, latency_per_distance=1.0, seed=1),
        topology.random_geometric(350, 0.2, latency_per_distance=1.0, seed=1),
    ],
    ids=["grid", "tree", "places", "many"],
)
def test_networks_are_always_drawn_alike(graph: "nx.Graph[object]") -> None:
    if len(graph) > 300:  # without places, so many need springs that are quick
        for data in dict(graph.nodes(data=True)).values():
            del data["pos"]
    first, second = (spots(network_map(empty_axes(), graph), "agent or relay") for _ in range(2))
    assert np.array_equal(first, second)
    assert len(np.unique(first.round(6), axis=0)) == len(graph) - 1


def test_both_directions_of_a_directed_network_are_seen() -> None:
    graph: nx.DiGraph[str] = nx.DiGraph(root="hub")
    graph.add_edge("hub", "north", latency=0.1, loss=0.0)
    graph.add_edge("north", "hub", latency=0.3, loss=0.0)
    (lines,) = [
        one for one in network_map(empty_axes(), graph).collections if isinstance(one, LineCollection)
    ]
    there, back = lines.get_segments()
    assert not np.allclose(there, back[::-1])
    assert there + back[::-1] == pytest.approx(2 * np.array([[0.0, 0.0], [0.0, 1.0]]), abs=1e-12)


def test_networks_that_cannot_be_drawn_are_refused() -> None:
    lonely: nx.Graph[str] = nx.Graph()
    lonely.add_node("hub")
    assert said(network_map(empty_axes(), lonely, root="hub")) == "This network has no edges."
    with pytest.raises(InputError, match="the graph names none"):
        network_map(empty_axes(), lonely)
    with pytest.raises(InputError, match="root = 'hob'"):
        network_map(empty_axes(), lonely, root="hob")
    ring: nx.Graph[int] = nx.cycle_graph(4)
    with pytest.raises(InputError, match="has no attributes and no 'latency'"):
        network_map(empty_axes(), ring, root=0)


# -- texts of users ------------------------------------------------------------------------------------------

# Formulas that are none, one that is, a label that a legend would leave out, and what needs no care.
WORDS = ("US$ (2020_$)", r"$\frac{1}{$", "$x^2$", "_hidden", r"\$5 & 100 %", "a_b^c")


def texts(figure: Figure) -> set[str]:
    """All words that a figure shows, as a reader sees them."""
    drawn = io.BytesIO()
    with rc_context({"svg.fonttype": "none"}):
        figure.savefig(drawn, format="svg")
    found = ET.fromstring(drawn.getvalue()).iter()
    return {"".join(element.itertext()).strip() for element in found if element.tag.endswith("}text")}


@pytest.fixture(scope="module")
def named() -> Result:
    """A run in which resources, units and agents have such names."""
    ordinary = {"capacity": 2.0, "increase": 0.05, "decrease": 0.5, "normalization": 0.05}
    resources = [Resource(word, **ordinary, unit=word[::-1]) for word in WORDS[:3]]  # type: ignore[arg-type]
    resources += [Resource(word, **ordinary) for word in WORDS[3:]]  # type: ignore[arg-type]
    costs = PolynomialCosts([2], np.ones((len(WORDS), len(WORDS), 1)))
    shared = Problem(resources, costs, agent_names=WORDS)
    return Simulation(shared, seed=0, recording=Recording(0.5, 0.5, events=True)).run(60.0)


def test_names_and_units_are_drawn_as_they_are_written(named: Result) -> None:
    labels = [f"{word} ({word[::-1]})" for word in WORDS[:3]] + [*WORDS[3:]]
    figures = paper_figures(named)
    for name in ("figure1", "figure2", "figure4"):
        assert set(labels) <= texts(figures[name])
    shown = texts(figures["figure3"])
    assert {f"|average − optimum| of {label}" for label in labels} <= shown
    assert {f"({'abcdef'[j]}) Errors at the end: {word}" for j, word in enumerate(WORDS)} <= shown


def test_panels_show_texts_as_they_are_written(named: Result) -> None:
    def shown(draw: object, *given: object, legend: bool = True, **options: object) -> set[str]:
        figure = Figure(layout="constrained")
        draw(figure.add_subplot(), *given, **options)  # type: ignore[operator]
        if legend:
            shared_legend(figure)
        return texts(figure)

    for draw in (demand_and_signals, tracking_error, tracking_level, consensus, error_decay):
        assert set(WORDS[3:]) <= shown(draw, named)
    for j, word in enumerate(WORDS):
        assert f"an agent's {word}" in shown(averages_against_optimum, named, None, j)
    assert set(WORDS) <= shown(signal_raster, named, 0)
    graph = nx.Graph([("root", word, {"latency": 1.0, "loss": 0.0}) for word in WORDS], root="root")
    # Names with an outline are drawn as shapes, so that no file has their words.
    names = {text.get_text().strip() for text in network_map(empty_axes(), graph).texts}
    assert names == {word.replace("$", r"\$") for word in WORDS}
    frame = pd.DataFrame({"$a$": WORDS, r"$\b{$": 1.0, "$": 2.0})
    assert {*WORDS, "$a$ ($c$)", r"$\b{$", "$"} <= shown(
        heat_map, frame, "$a$", r"$\b{$", "$", units={"$a$": "$c$"}, legend=False
    )
