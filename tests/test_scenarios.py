"""The studies: quick sizes end to end against stored tables, and at larger sizes what they are to show."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from aimd_des import theory
from aimd_des.engine.control_unit import Crossing
from aimd_des.study import mean_and_error, replicate
from aimd_des.utils.folders import check_folder
from models.smart_cameras import smart_cameras
from scenarios import paper
from scenarios.common import figures
from scenarios.common.command import Finding, write
from scenarios.common.measure import Measures, Run, measure, run_draws
from scenarios.common.systems import memory_alone, spread
from scenarios.common.tables import over_draws, summarise, summarise_draws, table_of
from scenarios.theory_table import accuracy as accuracy_rows
from scenarios.theory_table import losses
from scenarios.theory_table import signals as signal_rows
from scenarios.theory_table.rows import Row, Rule, Size, digest, frame, markdown
from tests.conftest import picture_size, python

STORED = Path(__file__).parent / "data"
NAMES = [
    "burst_loss",
    "capacity_drop",
    "churn",
    "city",
    "clocks",
    "congested_channel",
    "continuous_vs_discrete",
    "convergence",
    "cures",
    "delay",
    "delay_loss",
    "ev_day",
    "loss",
    "mesh",
    "outage",
    "rare",
    "responses",
    "robust_responses",
    "theory_table",
    "unequal_delays",
    "unusual_activity",
    "usable",
]

# What stands beside the tables of those that do not write one figure with their name.
FIGURES = {
    "convergence": {"convergence.md", "convergence.png"},
    "delay_loss": {f"delay_loss_{resource}.png" for resource in ("memory", "disk", "bandwidth")},
    "theory_table": {"theory_table.md", "theory_table.png"},
}

# The claims at a tenth of the size of the table in the docs: seeds 0 to 3.
SMALL = Size(4, 400.0, 130.0, 2000, critical_until=300.0, halvings=6, agents=240, long=1e5, accuracy=0.01)
# Standard errors by which a mean may lie beyond a bound on which the truth itself lies: by Student's t
# with 3 degrees of freedom, once in 200.
Z = 6.0


def differences(ours: pd.DataFrame, stored: pd.DataFrame) -> list[str]:
    """Where two tables differ: words and whole numbers at all, other numbers by more than 1e-9."""
    if list(ours) != list(stored) or len(ours) != len(stored):
        return ["rows or columns"]
    found = []
    for column in stored:
        one, other = ours[column], stored[column]
        if not (pd.api.types.is_float_dtype(one) and pd.api.types.is_float_dtype(other)):
            wrong = np.array(
                [a != b and not (pd.isna(a) and pd.isna(b)) for a, b in zip(one, other, strict=True)]
            )
        else:
            gap = (one - other).abs() > 1e-9 * other.abs().clip(lower=1.0)
            wrong = (gap | (one.isna() != other.isna())).to_numpy()
        found += [f"{column} of row {row}" for row in np.flatnonzero(wrong)]
    return found


def read(path: Path) -> pd.DataFrame:
    return pd.read_csv(path, keep_default_na=False, na_values=[""])


@pytest.mark.parametrize("name", NAMES)
def test_the_command_writes_figure_and_stored_table(name: str, tmp_path: Path) -> None:
    main = import_module(f"scenarios.{name}").main
    out = tmp_path / "results" / name
    # Kept runs, so that the table is made of what has been written down.
    done = CliRunner().invoke(main, ["--quick", "--out", str(out), "--runs", str(tmp_path / "runs")])
    assert done.exit_code == 0, done.output
    figures = FIGURES.get(name, {f"{name}.png"})
    assert {path.name for path in out.iterdir()} == {f"{name}.json", "table.csv"} | figures
    assert [path.name for path in out.parent.iterdir()] == [name]  # nothing temporary is left
    for path in out.glob("*.png"):
        width, height = picture_size(path)
        assert width > 2000
        assert height > 600
    assert differences(read(out / "table.csv"), read(STORED / f"{name}_quick.csv")) == []
    provenance = json.loads((out / f"{name}.json").read_text(encoding="utf-8"))
    assert (provenance["scenario"], provenance["seed"]) == (name, 0)
    assert provenance["findings"]
    again = CliRunner().invoke(main, ["--quick", "--out", str(out)])
    assert again.exit_code == 2
    assert "--overwrite" in again.output


def test_a_figure_that_fails_takes_no_number_along(tmp_path: Path) -> None:
    def fail() -> Figure:
        assert (out / "table.csv").is_file()
        raise MemoryError("no room")

    out, table = tmp_path / "found", pd.DataFrame({"mean": [1.0]})
    found = Finding("made", {"seed": 0}, table, table, ["One."], {"one": fail, "two": Figure})
    with pytest.warns(RuntimeWarning, match=r"one\.png: is missing \(MemoryError: no room\); all numbers"):
        write(found, check_folder(out, overwrite=False, mark="made.json"))
    assert {path.name for path in out.iterdir()} == {"made.json", "table.csv", "two.png"}


@pytest.mark.parametrize("name", NAMES)
def test_the_comparison_of_tables_sees_one_part_in_a_hundred_million(name: str) -> None:
    stored = read(STORED / f"{name}_quick.csv")
    assert differences(stored, stored) == []
    column = "mean" if "mean" in stored else "value"
    row = int(stored[column].notna().to_numpy().argmax())
    wrong = stored.copy()
    wrong.loc[row, column] += 1e-8 * max(1.0, abs(wrong.loc[row, column]))
    assert differences(wrong, stored) == [f"{column} of row {row}"]
    assert differences(stored.iloc[1:], stored) == ["rows or columns"]


def test_the_studies_are_listed_with_their_questions() -> None:
    listed = python("-m", "scenarios")
    assert listed.returncode == 0, listed.stderr
    assert (paper.__doc__ or "").splitlines()[0] in listed.stdout
    assert "python -m scenarios.paper" in listed.stdout
    assert "common" not in listed.stdout
    for name in NAMES:
        line = next(line for line in listed.stdout.splitlines() if f"scenarios.{name} " in line)
        assert line.endswith("?")


@pytest.mark.slow
def test_a_pool_gives_the_same_bits_as_one_process() -> None:
    run = Run(memory_alone(), 60.0, 20.0, "continuous", Crossing(0.5), loss=0.2)
    alone, shared = (replicate([partial(measure, run)], 3, seed=0, workers=count) for count in (1, 2))
    for one, other in zip(alone[0], shared[0], strict=True):
        for field, others in zip(one, other, strict=True):
            assert np.array_equal(field, others)


def test_rows_of_replications_become_means_a_measure_after_the_other() -> None:
    rows = [{"a": a, "b": b, "c": 1.0} for a in "xy" for b in (1.0, 3.0)]
    table = summarise(rows, ["a"])
    assert list(table[["a", "measure"]].itertuples(index=False, name=None)) == [
        (a, measure) for measure in "bc" for a in "xy"
    ]
    assert table.to_dict("records")[0] == {
        "a": "x",
        "measure": "b",
        "mean": 2.0,
        "standard_error": 1.0,
        "replications": 2,
    }


def drawn(case: str, draw: int, seed: int) -> tuple[str, int, int]:
    return case, draw, seed


def test_draws_share_no_seed_and_cases_share_all() -> None:
    found = run_draws(drawn, ["a", "b"], draws=3, replications=2, seed=5, quick=True)
    assert [case for case, _ in found] == ["a", "b"]
    seeds = [[seed for *_, seed in outcomes] for outcomes in found[0][1]]
    assert found[0][1][2] == [("a", 7, 7000), ("a", 7, 7001)]
    assert len({seed for row in seeds for seed in row}) == 6
    assert [[seed for *_, seed in outcomes] for outcomes in found[1][1]] == seeds


def test_a_mean_over_draws_is_said_with_its_interval_and_their_scatter() -> None:
    rows = [{"a": "x", "draw": draw, "c": 1.0 + draw + luck} for draw in (0, 1, 2) for luck in (-0.1, 0.1)]
    table = summarise_draws(rows, ["a"])
    row = table.to_dict("records")[0]
    assert (row["mean"], row["spread"], row["draws"], row["replications"]) == (2.0, 1.0, 3, 6)
    assert row["within"] == pytest.approx(0.1)
    # t of two degrees, 4.303, times 1 / sqrt(3)
    assert over_draws(table, a="x") == "2.00 ± 2.48 (± 1.00 over draws)"


class Case(NamedTuple):
    a: str
    b: float
    other: int = 7


def test_outcomes_of_draws_become_a_table_beside_their_theory() -> None:
    def theory(case: Case, draw: int) -> dict[str, float]:
        return {"c": case.b + draw, "nobody measures": 1.0} if case.a == "x" else {}

    pairs = [(Case(a, 1.0), [[{"c": 2.0}, {"c": 4.0}], [{"c": 5.0}, {"c": 5.0}]]) for a in "xy"]
    table = table_of(pairs, ["a", "b"], 3, theory)
    assert table[["a", "b", "measure"]].to_numpy().tolist() == [["x", 1.0, "c"], ["y", 1.0, "c"]]
    assert table["mean"].tolist() == [4.0, 4.0]
    assert table["theory"].tolist() == [4.5, pytest.approx(np.nan, nan_ok=True)]  # of draws 3 and 4
    assert table["draws"].tolist() == [2, 2]


def test_a_curve_is_drawn_for_each_value_of_a_column() -> None:
    table = pd.DataFrame({"a": list("xyx"), "at": [1.0, 1.0, 2.0], "mean": [3.0, 4.0, 5.0]})
    axes = Figure().subplots()
    figures.curves(axes, "at", "a", table.assign(standard_error=0.5, theory=6.0), "of {}", scale=10.0)
    handles, labels = axes.get_legend_handles_labels()
    assert labels == ["of x", "of y"]
    drawn: list[Any] = [handle.lines[0].get_xydata().tolist() for handle in handles]
    assert drawn == [[[1.0, 30.0], [2.0, 50.0]], [[1.0, 40.0]]]
    lines: list[Any] = axes.get_lines()
    heights = [line.get_ydata().tolist() for line in lines]
    assert [60.0, 60.0] in heights  # theory of x, and of y
    assert [60.0] in heights


def test_measures_count_from_the_start_that_was_asked_for() -> None:
    """A run of 60 units measured from 20 on, against its frames."""
    from aimd_des import Recording, Simulation

    problem = memory_alone()
    found = measure(Run(problem, 60.0, 20.0, "continuous", Crossing(0.5)), seed=1)
    recording = Recording(demand=0.01)
    result = Simulation(
        problem, dynamics="continuous", control_unit=Crossing(0.5), seed=1, recording=recording
    ).run(60.0)
    late = result.demand[result.demand["time"] >= 20.0]
    assert found.signals[0] == (result.signals["time"] >= 20.0).sum() / 40.0
    # Sampled at 4,000 instants, each at most one step of growth off.
    assert found.utilisation[0] == pytest.approx(late["total"].mean() / 32.0, abs=1e-3)
    assert found.peak[0] == pytest.approx(late["total"].max() / 32.0, abs=60 * 0.025 * 0.01 / 32.0 + 1e-12)
    assert found.average[:, 0] == pytest.approx(result.average_at_end[:, 0])


@pytest.mark.parametrize(
    ("rule", "inside", "outside"),
    [
        (Rule("relative", 0.05, "within 5 %"), 2.09, 2.11),
        (Rule("difference", 0.02, "within 2 points"), 2.019, 2.021),
        (Rule("at least", 0.0, "at least 2"), 2.0, 1.99),
    ],
)
def test_rules_tell_what_agrees_from_what_does_not(rule: Rule, inside: float, outside: float) -> None:
    rows = [Row("f", "s", "memory", 0.01, 1.0, 2.0, mean, 0.1, rule) for mean in (inside, outside, np.nan)]
    table = frame(rows)
    assert table["holds"].tolist() == ["yes", "no", "no"]
    assert digest(table)["holds"].tolist() == ["1 of 3"]
    assert markdown(table).count("| no |") == 2


def rows_of(experiment: Callable[[Size], Any], size: Size) -> pd.DataFrame:
    made = experiment(size)
    return frame(made.rows(replicate(made.jobs, size.replications, seed=0, workers=1)))


@pytest.fixture(scope="module")
def signals() -> pd.DataFrame:
    return rows_of(signal_rows.signals_and_utilisation, SMALL)


@pytest.mark.slow
def test_signals_and_utilisation_are_as_predicted(signals: pd.DataFrame) -> None:
    rows = signals[signals["claim"] != ""]
    assert set(rows["formula"]) >= {"Signals per unit of time", "Utilisation"}
    allowed = np.where(rows["claim"] == "within 5 %", 0.05 * rows["predicted"], 0.02)
    assert (rows["deviation"].abs() <= allowed + Z * rows["standard_error"]).all()


@pytest.mark.slow
def test_peaks_are_lifted_by_the_growth_over_the_latency(signals: pd.DataFrame) -> None:
    rows = signals[signals["formula"].str.startswith("Peak")]
    assert len(rows) == 3
    assert rows["mean"].to_numpy() == pytest.approx(rows["predicted"].to_numpy(), rel=1e-9)


@pytest.mark.slow
def test_signals_without_the_loss_in_the_formula_are_refuted(signals: pd.DataFrame) -> None:
    """Negative control: the same runs, held against what they would be without loss."""
    rows = signals[
        (signals["formula"] == "Signals per unit of time") & signals["setting"].str.contains("loss")
    ]
    expected = theory.predict(smart_cameras(0), "continuous").signals
    continuous = rows[rows["setting"].str.startswith("continuous")]
    wrong = continuous["mean"].to_numpy().reshape(-1, 3) / expected - 1.0
    assert (wrong > 0.05 + Z * (continuous["standard_error"].to_numpy().reshape(-1, 3) / expected)).all()


def noise(runs: list[Measures]) -> Any:
    """Expected sum of absolute errors of the mean of averages over the sum, if each is normal; (m,)."""
    mean, error = mean_and_error([run.average for run in runs])
    return np.sqrt(2.0 / np.pi) * error.sum(axis=0) / mean.sum(axis=0)


@pytest.mark.slow
@pytest.mark.parametrize("experiment", [losses.heterogeneous, losses.compensated])
def test_loss_that_differs_leads_to_the_predicted_optimum(experiment: Callable[[Size], Any]) -> None:
    made = experiment(replace(SMALL, until=900.0, start=300.0, steps=4500))  # noise hides the far ones else
    outcomes = replicate(made.jobs, SMALL.replications, seed=0, workers=1)
    table = frame(made.rows(outcomes))
    near = table[table["claim"] == "at most 2 %"]
    assert len(near) == 6
    # Four replications leave noise in the averages, which counts as distance.
    assert (near["mean"].to_numpy() <= 0.02 + np.concatenate([noise(runs) for runs in outcomes])).all()
    far = table[table["claim"] == "at least 5 times"]
    assert (far["holds"] == "yes").all()
    shares = table[table["formula"].str.contains("share of responses")]
    assert (shares["mean"] == 0.0).all()


@pytest.mark.slow
def test_the_critical_loss_is_where_theory_puts_it() -> None:
    table = rows_of(losses.critical, replace(SMALL, replications=2))
    resolution = 0.9 / 2 ** (SMALL.halvings + 1)
    assert (table["deviation"].abs() <= 0.05 + resolution).all()
    # Negative control: the formula of the other dynamics.
    other = table["predicted"].to_numpy()[::-1]
    assert (np.abs(table["mean"].to_numpy() - other) > 0.05 + resolution).all()


def test_spread_values_have_the_mean_halfway_and_no_order() -> None:
    values = spread(0.0, 0.6)
    assert values.mean() == pytest.approx(0.3)
    assert values.min() == 0.0
    assert values.max() == 0.6
    assert abs(np.corrcoef(values, np.arange(60))[0, 1]) < 0.3


@pytest.mark.parametrize("wide", [1.0, 1.3])
def test_rows_of_accuracy_measure_what_theory_has(wide: float) -> None:
    """Made-up runs, which are as theory says, keep all claims; with too much noise they do not."""
    case, at = accuracy_rows._CASES[0], np.round(np.geomspace(1000.0, 1e5, 9))
    problem = smart_cameras(0)
    expected = theory.convergence(problem)
    draws = np.random.default_rng(0).standard_normal((30, problem.n_resources, problem.n_agents))
    runs = np.empty((30, len(at), problem.n_agents, problem.n_resources))
    for q, (time, average) in enumerate(zip(at.tolist(), expected.average(at), strict=True)):
        values, vectors = np.linalg.eigh(expected.covariance(time))
        root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
        runs[:, q] = average + wide * np.einsum("jik,rjk->rij", root, draws)
    table = frame(accuracy_rows._rows(case, SMALL, at, list(runs)))
    held = table.groupby("formula", sort=False)["holds"].apply(lambda column: set(column) == {"yes"})
    assert held.all() == (wide == 1.0)
    scatter = table[table["formula"].str.startswith("Standard deviation")]["holds"]
    assert set(scatter) == {"yes" if wide == 1.0 else "no"}
