"""The paper's experiment: a quick run against a stored table, and the full one against paper and theory."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from aimd_des import InputError, load_scenario, run_synchronous, solve_optimum
from aimd_des.utils.folders import check_folder
from models.smart_cameras import smart_cameras
from scenarios import paper
from scenarios.paper import CAPACITY_EVENTS, markdown, sentences, table
from tests.conftest import ROOT, picture_size

STORED = Path(__file__).parent / "data" / "paper_quick.csv"
RESOURCES = list(CAPACITY_EVENTS)
FILES = {"figure1.png", "figure2.png", "figure3.png", "figure4.png", "table.csv", "table.md", "paper.json"}

# Standard errors by which the mean of 60 draws may lie beyond a bound: where the truth is on the
# bound itself, the chance of a false alarm is 0.0001 (Student's t, 59 degrees of freedom).
Z = 4.0


def differences(ours: pd.DataFrame, stored: pd.DataFrame) -> list[str]:
    """Where two tables differ: counts at all, other numbers by more than 1e-9."""
    words = ["increase", "lag", "measure", "resource", "paper"]
    if list(ours) != list(stored) or not ours[words].equals(stored[words]):
        return ["rows or columns"]
    counts = (stored["measure"] == "signals").to_numpy()
    found = []
    for column in ("this_run", "mean", "std"):
        one, other = ours[column].to_numpy(), stored[column].to_numpy()
        exact = counts & (column == "this_run")
        wrong = np.where(exact, one != other, np.abs(one - other) > 1e-9 * np.maximum(1.0, np.abs(other)))
        found += [f"{column} of row {row}" for row in np.flatnonzero(wrong)]
    return found


def read(path: Path) -> pd.DataFrame:
    return pd.read_csv(path, dtype={"paper": str}, keep_default_na=False)


@pytest.fixture(scope="module")
def quick() -> paper.PaperStudy:
    return paper.run(*paper.QUICK)


@pytest.fixture(scope="module")
def full() -> paper.PaperStudy:
    """60 draws of 30,000 steps, seeds 0 to 59."""
    return paper.run(*paper.FULL)


def test_the_command_writes_twelve_panels_and_the_stored_table(tmp_path: Path) -> None:
    out = tmp_path / "results" / "paper"
    done = CliRunner().invoke(paper.main, ["--quick", "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert {path.name for path in out.iterdir()} == FILES
    assert [path.name for path in out.parent.iterdir()] == ["paper"]  # nothing temporary is left
    for number in range(1, 5):
        width, height = picture_size(out / f"figure{number}.png")
        assert width > 2000
        assert height > 600
    assert differences(read(out / "table.csv"), read(STORED)) == []
    provenance = json.loads((out / "paper.json").read_text(encoding="utf-8"))
    assert (provenance["steps"], provenance["draws"], provenance["seed"]) == (*paper.QUICK, 0)
    assert len(provenance["digests"]) == paper.QUICK[1]
    assert "capacity events" in done.output
    assert "capacity events" in (out / "table.md").read_text(encoding="utf-8")


def test_the_comparison_of_tables_sees_one_event_and_one_part_in_a_hundred_million(
    quick: paper.PaperStudy,
) -> None:
    ours, stored = table(quick), read(STORED)
    ours["paper"] = ours["paper"].astype(str)
    assert differences(ours.astype(stored.dtypes), stored) == []
    for row, column, change in ((0, "this_run", 1.0), (3, "mean", 1e-8), (20, "std", 1e-8)):
        wrong = ours.copy()
        wrong[column] = wrong[column].astype(float)
        wrong.loc[row, column] += change
        assert differences(wrong, stored) == [f"{column} of row {row}"]
    assert differences(table(replace(quick, steps=30_000)), stored) == ["rows or columns"]


def test_twelve_panels(quick: paper.PaperStudy) -> None:
    figures = paper.figures(quick)
    assert [len(figure.axes) for figure in figures.values()] == [3, 3, 3, 3]
    assert "4 simulations" in figures["figure4"].axes[2].get_title(loc="left")
    labels = [axes.get_xlabel() for axes in figures["figure3"].axes]
    assert [label.split(" of ")[1] for label in labels] == [
        "memory (GB)",
        "disk (10 GB)",
        "bandwidth (10 Mbps)",
    ]


def test_sentences_hold_computed_numbers(quick: paper.PaperStudy) -> None:
    """Other measures must make other sentences, but for the one on the event-driven run."""
    before = sentences(quick)
    measures = quick.measures.copy()
    numbers = measures.columns.difference(["resource", "increase", "lag", "draw"])
    measures[numbers] = measures[numbers] * np.linspace(1.5, 1.7, len(measures))[:, None]
    after = sentences(replace(quick, measures=measures))
    assert [one != other for one, other in zip(before, after, strict=True)] == [False, *[True] * 5, False]
    assert "a fault" in sentences(replace(quick, same_digests=False))[-1]


def test_conclusions_are_drawn_only_where_the_numbers_allow_them(quick: paper.PaperStudy) -> None:
    before = " ".join(sentences(quick))
    assert "fits the run without the lag" in before
    assert "cannot be the one that was run" in before
    swapped = quick.measures.copy()
    swapped["lag"] = swapped["lag"].where(swapped["increase"] == "as_printed", 1 - swapped["lag"])
    swapped.loc[swapped["increase"] == "as_run", "signals"] *= 2
    after = " ".join(sentences(replace(quick, measures=swapped)))
    assert "does not tell the two apart here" in after
    assert "cannot" not in after


def test_the_event_driven_run_agrees(quick: paper.PaperStudy) -> None:
    assert quick.same_digests
    assert quick.event_driven_steps == 300


def test_a_seed_is_all_that_decides() -> None:
    first, again, other = (paper.run(400, 2, seed=seed).measures for seed in (1, 1, 3))
    pd.testing.assert_frame_equal(first, again, check_exact=True)
    assert not first.equals(other)


@pytest.mark.parametrize(
    ("steps", "draws", "seed", "name"), [(0, 2, 0, "steps"), (10, 1, 0, "draws"), (10, 2, -1, "seed")]
)
def test_impossible_sizes_are_refused(steps: int, draws: int, seed: int, name: str) -> None:
    with pytest.raises(InputError, match=name):
        paper.run(steps, draws, seed)


def test_results_of_others_are_not_touched(tmp_path: Path) -> None:
    mine = tmp_path / "mine.txt"
    mine.write_text("mine", encoding="utf-8")
    for extra in ([], ["--overwrite"]):
        refused = CliRunner().invoke(paper.main, ["--quick", "--out", str(tmp_path), *extra])
        assert refused.exit_code == 2
        assert refused.output.startswith("Error: output folder")
        assert len(refused.output.splitlines()) == 1
        assert mine.read_text(encoding="utf-8") == "mine"
        assert list(tmp_path.iterdir()) == [mine]


def test_own_results_are_replaced_only_when_asked(
    tmp_path: Path, quick: paper.PaperStudy, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "paper"
    with monkeypatch.context() as without:
        without.setattr(paper, "figures", lambda study: dict.fromkeys(paper._FIGURES, Figure()))
        paper.write(quick, check_folder(out, overwrite=False, mark=paper.MARK))
    stale = out / "stale.txt"
    stale.touch()
    with pytest.raises(InputError, match="overwrite"):
        check_folder(out, overwrite=False, mark=paper.MARK)
    assert stale.exists()
    paper.write(quick, check_folder(out, overwrite=True, mark=paper.MARK))
    assert {path.name for path in out.iterdir()} == FILES


def test_nothing_is_left_of_a_run_that_fails(
    tmp_path: Path, quick: paper.PaperStudy, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(study: paper.PaperStudy) -> str:
        raise OSError("disk full")

    monkeypatch.setattr(paper, "markdown", fail)
    with pytest.raises(OSError, match="disk full"):
        paper.write(quick, check_folder(tmp_path / "paper", overwrite=False, mark=paper.MARK))
    assert list(tmp_path.iterdir()) == []


def test_the_scenario_file_is_the_first_run_of_the_study() -> None:
    scenario = load_scenario(ROOT / "scenarios" / "paper.toml", until=200.0, seed=3)
    assert scenario.run().digest == run_synchronous(smart_cameras(3), steps=200, seed=3).digest


def case(study: paper.PaperStudy, increase: str, lag: int) -> pd.DataFrame:
    rows = study.measures
    return rows[(rows["increase"] == increase) & (rows["lag"] == lag)]


def by_draw(rows: pd.DataFrame, column: str) -> np.ndarray:
    """One measure, shape (draws, 3 resources)."""
    return rows.pivot_table(column, index="draw", columns="resource")[RESOURCES].to_numpy()


def bracket(study: paper.PaperStudy, lag: int, gamma: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest share of steps with a signal that theory allows, shape (draws, 3).

    In the long run what all add, n alpha in a step without a signal, is what is cut at signals:
    (1 - beta) Gamma mu per agent, times the total then in force over the total of the averages. That
    total is at most the peak's bound; it is above the capacity where a signal acts at once, and at
    least the average otherwise.
    """
    rows = case(study, "as_run", lag)
    use, peak = 1.0 - by_draw(rows, "unused"), by_draw(rows, "peak_bound")
    lowest = np.ones_like(use) if lag == 0 else use
    shares = []
    for height in (peak, lowest):
        rho = np.empty_like(use)
        for draw in range(study.draws):
            problem = smart_cameras(study.seed + draw)
            mu = solve_optimum(problem, capacity=use[draw] * problem.capacity).multipliers
            cut = (1.0 - problem.decrease[0]) * gamma * problem.normalization * mu
            rho[draw] = problem.increase[0] / cut * use[draw] / height[draw]
        shares.append(rho / (1.0 + rho))
    return shares[0], shares[1]


def z_above(values: np.ndarray, bound: float) -> np.ndarray:
    """How many standard errors the mean over the draws lies above a bound, shape (3,)."""
    return (values.mean(axis=0) - bound) / (values.std(axis=0, ddof=1) / np.sqrt(len(values)))


@pytest.mark.slow
@pytest.mark.parametrize("lag", [1, 0])
def test_the_papers_capacity_events_lie_within_two_standard_deviations(
    full: paper.PaperStudy, lag: int
) -> None:
    """Seeds 0 to 59; the paper is one draw of its own, so the spread of draws is what it is held against."""
    counts = by_draw(case(full, "as_run", lag), "signals")
    off = np.array(list(CAPACITY_EVENTS.values())) - counts.mean(axis=0)
    assert (np.abs(off) <= 2.0 * counts.std(axis=0, ddof=1)).all()


@pytest.mark.slow
def test_the_printed_increase_of_disk_gives_a_sixth_of_the_papers_events(full: paper.PaperStudy) -> None:
    """Seeds 0 to 59.  About 1,900; and what is rejected above is rejected by far."""
    disk = by_draw(case(full, "as_printed", 1), "signals")[:, 1]
    assert abs(disk.mean() - 1900.0) <= 2.0 * disk.std(ddof=1)
    assert CAPACITY_EVENTS["disk"] - disk.mean() > 50.0 * disk.std(ddof=1)


@pytest.mark.slow
@pytest.mark.parametrize("lag", [1, 0])
def test_capacity_events_follow_the_closed_form(full: paper.PaperStudy, lag: int) -> None:
    """Seeds 0 to 59; ratios per draw, so the spread of the costs cancels; standard error of their mean."""
    share = by_draw(case(full, "as_run", lag), "signals") / full.steps
    least, greatest = bracket(full, lag)
    assert (z_above(share / least, 1.0) > -Z).all()
    assert (z_above(share / greatest, 1.0) < Z).all()


@pytest.mark.slow
@pytest.mark.parametrize("gamma", [0.9, 1.1])
def test_a_normalization_that_is_wrong_by_a_tenth_is_seen(full: paper.PaperStudy, gamma: float) -> None:
    """The negative control of the test above."""
    share = by_draw(case(full, "as_run", 0), "signals") / full.steps
    least, greatest = bracket(full, 0, gamma)
    below, above = z_above(share / least, 1.0) < -Z, z_above(share / greatest, 1.0) > Z
    assert (below | above).all()


@pytest.mark.slow
def test_errors_and_peaks_tell_the_two_lags_apart(full: paper.PaperStudy) -> None:
    """Draws are paired: the same costs and the same luck with either lag."""
    with_lag, without = case(full, "as_run", 1), case(full, "as_run", 0)
    error = by_draw(with_lag, "relative_error") - by_draw(without, "relative_error")
    assert (z_above(error, 0.0) > Z).all()
    assert (by_draw(without, "relative_error") < 0.05).all()
    assert np.mean(by_draw(with_lag, "relative_error")[:, 2] > 0.05) > 0.5
    for rows in (with_lag, without):
        assert (rows["overshoot_peak"] <= rows["peak_bound"] * (1.0 + 1e-12)).all()
    assert (by_draw(with_lag, "overshoot_peak") > by_draw(without, "peak_bound")).all()


@pytest.mark.slow
def test_the_relative_error_is_unused_capacity_or_more(full: paper.PaperStudy) -> None:
    rows = full.measures
    assert (rows["relative_error"] >= np.abs(rows["unused"]) * (1.0 - 1e-9)).all()
    # What is used is shared nearly optimally: the cost ratio is that of using less.
    excess = rows["cost_ratio"] / rows["cost_of_use"] - 1.0
    assert excess.between(-1e-9, 0.01).all()
    assert (rows["cost_ratio"] < 1.0).all()


@pytest.mark.slow
def test_the_page_of_the_docs_says_what_the_run_gives(full: paper.PaperStudy) -> None:
    page = _without_breaks((ROOT / "docs" / "paper.md").read_text(encoding="utf-8"))
    lines = [_without_breaks(line) for line in markdown(full).splitlines()[2:]]
    assert [line for line in lines if line not in page] == []


def _without_breaks(text: str) -> str:
    """Words with one space between them; none around the bars of tables."""
    return " ".join(text.split()).replace(" | ", "|").replace("| ", "|").replace(" |", "|")
