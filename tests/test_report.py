"""A report is one file that needs nothing else, says what the folder says, and lets no text become code."""

import base64
import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aimd_des import InputError
from aimd_des.report import report_run, report_study, write_page
from aimd_des.report.html_page import render
from aimd_des.report.run_charts import demand_charts
from aimd_des.results.measures import MEASURES as MEASURES_TABLE
from aimd_des.scenario.run_folder import load_run
from aimd_des.utils.formatting import percent, short
from tests.command_line import everything, invoke, refusal, run, write
from tests.conftest import INLINE
from tests.reports import HOSTILE, HOSTILE_SCENARIO, MEASURES, Parsed, results_of, study_of, values

pytestmark = pytest.mark.usefixtures("own_folder")

AXES = {"latency": [0.0, 0.5, 2.0], "loss": [0.0, 0.5], "way": ["tree", HOSTILE]}


#: What runs have written, by the text of their scenario.
RUNS: dict[str, dict[str, bytes]] = {}


def written(text: str = INLINE, **changes: str) -> Path:
    """The folder of a run."""
    for old, new in changes.items():
        text = text.replace(old, new)
    write(text)
    folder = Path("results/five")
    if text not in RUNS:
        assert run("five.toml", "--overwrite").exit_code == 0
        RUNS[text] = {path.name: path.read_bytes() for path in folder.iterdir()}
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, content in RUNS[text].items():
        (folder / name).write_bytes(content)
    return folder


def page_of(folder: Path) -> Parsed:
    return Parsed(render(report_run(load_run(folder))))


# -- the file ----------------------------------------------------------------------------------------------


def test_a_page_needs_nothing_else() -> None:
    parsed = page_of(written())
    assert sorted(set(parsed.attributes("href"))) == ["#main", "data:,"]
    assert parsed.attributes("src") == []
    assert not {"iframe", "object", "embed", "base", "video"} & {tag for tag, _ in parsed.tags}
    policy = next(found["content"] for _, found in parsed.tags if found.get("http-equiv"))
    assert policy is not None
    assert policy.startswith("default-src 'none'; ")
    for spec in parsed.charts.values():
        assert values(spec)
        assert '"url"' not in json.dumps(spec)


def test_the_policy_knows_the_one_script() -> None:
    text = render(report_run(load_run(written())))
    parsed = Parsed(text)
    (script,) = parsed.scripts
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'; style-src" in text
    policy = next(found["content"] for _, found in parsed.tags if found.get("http-equiv"))
    assert policy is not None
    assert "eval" not in policy


def test_a_page_says_how_agents_average_and_answer() -> None:
    text = '[response]\nkind = "derandomised"\n[averaging]\nkind = "polynomial"\ngain = 2.0\n'
    page = render(report_run(load_run(written(INLINE + text))))
    assert "kind derandomised, divisor average" in page
    assert "kind polynomial, gain 2" in page


def test_texts_stay_texts() -> None:
    parsed = page_of(written(HOSTILE_SCENARIO))
    assert parsed.texts["h1"] == [HOSTILE]
    assert parsed.texts["title"] == [HOSTILE]
    assert len(parsed.scripts) == 1
    assert not {"img", "i"} & {tag for tag, _ in parsed.tags}
    assert "onerror" not in {name for _, found in parsed.tags for name in found}
    assert "<i>memory</i>" in {row["resource"] for row in values(parsed.charts["demand"])}
    assert "onerror=alert(1)" in parsed.texts["pre"][0]


def test_texts_of_a_study_stay_texts(tmp_path: Path) -> None:
    study = study_of(AXES, title=HOSTILE)
    parsed = Parsed(render(report_study(results_of(study, tmp_path, ("memory", HOSTILE)))))
    assert parsed.texts["h1"] == [HOSTILE]
    assert len(parsed.scripts) == 1
    assert "img" not in {tag for tag, _ in parsed.tags}
    (labels,) = (p["value"] for p in parsed.charts["map"]["params"] if p["name"] == "labels")
    assert ["tree", HOSTILE] in labels
    assert json.dumps(["tree", HOSTILE]) in [
        json.dumps(json.loads(v)) for v in parsed.attributes("data-values")
    ]


def test_the_document_has_an_order_for_those_who_do_not_see_it() -> None:
    parsed = page_of(written())
    tags = [tag for tag, _ in parsed.tags]
    assert [found for tag, found in parsed.tags if tag == "html"] == [{"lang": "en"}]
    assert [tag for tag in tags if tag in {"header", "main", "footer"}] == ["header", "main", "footer"]
    levels = [int(tag[1]) for tag in tags if tag in {"h1", "h2", "h3"}]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert max(np.diff(levels)) <= 1
    ids = parsed.attributes("id")
    assert len(set(ids)) == len(ids)
    named = [*parsed.attributes("aria-labelledby"), *parsed.attributes("for")]
    assert set(named) <= set(ids)
    controls = [found["id"] for tag, found in parsed.tags if tag in {"input", "select"}]
    assert set(controls) <= set(parsed.attributes("for"))
    assert all(spec["description"] for spec in parsed.charts.values())


# -- what it says of a run ---------------------------------------------------------------------------------


def test_the_verdict_is_that_of_the_summary() -> None:
    folder = written(**{"until = 60": "until = 600"})
    summary = pd.read_csv(folder / "summary.csv", index_col="resource")
    page = report_run(load_run(folder))
    assert [found.name for found in page.verdicts] == ["Utilisation", "Misallocation", "Peak demand"]
    for found, column in zip(page.verdicts, ("utilisation", "misallocation", "overshoot_peak"), strict=True):
        assert found.numbers == [(percent(value), name) for name, value in summary[column].items()]
    (table,) = page.tables
    known = [MEASURES_TABLE[name] for name in summary.columns]
    assert [row[0].split(" (")[0] for row in table.rows] == [measure.title.lower() for measure in known]
    assert [row[-2:] for row in table.rows] == [[measure.unit, measure.meaning] for measure in known]
    assert table.rows[8][1] == f"{summary['utilisation'].iloc[0]:.4g}"
    stored = json.loads((folder / "run.json").read_text())
    assert ("Digest", stored["digest"]) in page.provenance
    assert page.source == (folder / "scenario.toml").read_text()


def test_the_charts_of_a_run_hold_its_frames() -> None:
    folder = written()
    charts = {chart.id: chart.spec for chart in report_run(load_run(folder)).charts}
    assert list(charts) == ["demand", "signals", "averages", "convergence", "error", "cost", "shares"]
    demand = pd.read_parquet(folder / "demand.parquet")
    demand["capacity"] = demand["resource"].map({"memory": 3.0, "disk": 2.0}).astype(float)
    rows = pd.DataFrame(values(charts["demand"]))
    assert rows["time"].to_numpy() == pytest.approx(demand["time"].to_numpy(), rel=1e-7)
    assert rows["resource"].tolist() == demand["resource"].tolist()
    level = 100.0 * demand["total"] / demand["capacity"]
    assert rows["level"].to_numpy() == pytest.approx(level.to_numpy(), rel=1e-7)
    rows = pd.DataFrame(values(charts["averages"])).merge(demand, on=["time", "resource"])
    assert len(rows) > 100
    level = 100.0 * rows["average"] / rows["capacity"]
    assert rows["level"].to_numpy() == pytest.approx(level.to_numpy(), rel=1e-7)
    course = pd.read_parquet(folder / "convergence.parquet")
    shown = pd.DataFrame(values(charts["error"]))
    assert shown["error"].iloc[-1] == pytest.approx(100.0 * course["relative_error"].iloc[-1], rel=1e-7)
    summary = pd.read_csv(folder / "summary.csv")
    assert values(charts["cost"])[-1]["cost_ratio"] == pytest.approx(summary["cost_ratio"].iloc[-1], rel=1e-7)
    signals = pd.read_parquet(folder / "signals.parquet")
    rows = pd.DataFrame(values(charts["signals"]))
    assert rows["time"].to_numpy() == pytest.approx(signals["time"].to_numpy(), rel=1e-7)
    shares = pd.DataFrame(values(charts["shares"]))
    assert len(shares) == 10
    # What is used of a resource is shared out among all.
    optimum = pd.read_parquet(folder / "optimum.parquet")
    used = optimum.groupby("resource", observed=True)["allocation_of_used"].sum()
    last = demand[demand["time"] == 60.0].set_index("resource")["average"]
    assert used.to_dict() == pytest.approx(last.to_dict(), rel=1e-9)
    sums = shares.groupby("resource")[["best", "held"]].sum()
    assert sums["best"].to_dict() == pytest.approx(sums["held"].to_dict(), rel=1e-3)


def test_where_looks_are_too_few_for_teeth_their_bounds_are_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aimd_des.report.run_charts._MOST_ROWS", 40)
    monkeypatch.setattr("aimd_des.report.run_charts._MOST_SIGNALS", 5)
    folder = written()
    page = report_run(load_run(folder))
    charts = {chart.id: chart.spec for chart in page.charts}
    rows = pd.DataFrame(values(charts["demand"]))
    assert len(rows) == 20  # ten pieces of two resources
    assert (rows["min"] <= rows["mean"]).all()
    assert (rows["mean"] <= rows["max"]).all()
    demand = pd.read_parquet(folder / "demand.parquet")
    level = 100.0 * demand["total"] / demand["resource"].map({"memory": 3.0, "disk": 2.0}).astype(float)
    for name in ("memory", "disk"):
        own, drawn = level[demand["resource"] == name], rows[rows["resource"] == name]
        assert (drawn["min"].min(), drawn["max"].max()) == pytest.approx((own.min(), own.max()), rel=1e-7)
    assert page.controls[1].start == repr(60.0)  # the whole run
    signals = pd.read_parquet(folder / "signals.parquet")
    rows = pd.DataFrame(values(charts["signals"]))
    assert rows["signals"].sum() == len(signals)
    step = 60 / 100
    first = signals[signals["time"] < rows["time"].min() + step]
    assert rows["rate"].iloc[0] == pytest.approx(
        (first["resource"] == rows["resource"].iloc[0]).sum() / step, rel=1e-7
    )


@pytest.mark.parametrize(("looks", "dense"), [(6, True), (5, False)])
def test_a_line_is_drawn_where_every_tooth_has_six_looks(looks: int, dense: bool) -> None:
    signals = pd.DataFrame({"time": np.arange(10.0), "resource": "memory"})
    times = np.linspace(0.0, 10.0, 10 * looks + 1)
    demand = pd.DataFrame({"time": times, "resource": "memory", "total": 1.0, "average": 1.0})
    chart, _ = demand_charts(demand, signals, ["memory"], 10.0)
    assert ("level" in values(chart.spec)[0]) is dense


def test_a_signal_just_before_the_end_is_in_the_last_hundredth(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aimd_des.report.run_charts._MOST_SIGNALS", 1)
    until = 13.7
    last = np.nextafter(until, 0.0)
    assert last / (until / 100) == 100.0
    signals = pd.DataFrame({"time": [13.6, last], "resource": "memory"})
    demand = pd.DataFrame({"time": [0.0], "resource": "memory", "total": 1.0, "average": 1.0})
    rows = values(demand_charts(demand, signals, ["memory"], until)[1].spec)
    assert [row["signals"] for row in rows] == [2]


def test_what_is_not_shown_is_said() -> None:
    short = report_run(load_run(written(**{"tail = 5": 'demand = "end"\ntail = 0'})))
    assert [chart.id for chart in short.charts] == ["convergence", "error", "cost", "shares"]
    assert "recording.demand" in short.notes[0]
    assert not short.controls
    step = '[[interventions]]\nkind = "capacity_step"\nresource = "disk"\nat = 20\ncapacity = 1.5\n\n[costs]'
    changed = report_run(load_run(written(**{"[costs]": step})))
    assert "shares" in [chart.id for chart in changed.charts]
    assert [note.split(":")[0] for note in changed.notes] == ["What theory expects of the misallocation"]


def test_damaged_frames_are_refused() -> None:
    folder = written()
    (folder / "demand.parquet").write_bytes(b"no parquet")
    with pytest.raises(
        InputError, match=r"demand.parquet: does not have the checksum .*; run the scenario again"
    ):
        report_run(load_run(folder))


def test_numbers_are_written_short() -> None:
    assert [percent(value) for value in (0.12345, 1.0, 34.8211, float("nan"), float("inf"))] == [
        "12.3 %",
        "100 %",
        "3,480 %",
        "–",
        "∞",
    ]
    assert [short(value) for value in (0.123456, 12345.6, 7, True, "x", float("nan"))] == [
        "0.1235",
        "12,346",
        "7",
        "true",
        "x",
        "–",
    ]


# -- what it says of a study -------------------------------------------------------------------------------


def test_charts_of_a_study_hold_its_means(tmp_path: Path) -> None:
    results = results_of(study_of(AXES), tmp_path)
    page = report_study(results)
    assert [chart.id for chart in page.charts] == [
        "line-utilisation",
        "line-misallocation",
        "line-overshoot-peak",
        "map",
    ]
    runs = results.runs
    here = (runs["latency"] == 2.0) & (runs["loss"] == 0.5) & (runs["way"] == "tree")
    mean = runs[here & (runs["resource"] == "disk")]["misallocation"].mean()
    rows = pd.DataFrame(values(page.charts[1].spec)).query(
        "i0 == 2 and i1 == 1 and i2 == 0 and resource == 'disk'"
    )
    assert rows["mean"].tolist() == pytest.approx([100.0 * mean], rel=1e-7)
    wide = pd.DataFrame(values(page.charts[3].spec)).query("i0 == 2 and i1 == 1 and i2 == 0 and r == 1")
    assert wide["m1"].tolist() == pytest.approx([mean], rel=1e-7)
    assert wide["h1"].iloc[0] == pytest.approx(float((rows["high"] - rows["low"]).iloc[0]) / 200.0, rel=1e-3)
    assert len(values(page.charts[3].spec)) == 3 * 2 * 2 * 2
    peaks = runs.groupby(["latency", "loss", "way", "resource"], observed=True)["overshoot_peak"].mean()
    span = f"{percent(peaks.min())} to {percent(peaks.max())}"
    assert page.verdicts[2].numbers == [(span, "over 24 means")]
    assert [control.id for control in page.controls] == [
        "along",
        "axis0",
        "axis1",
        "axis2",
        "measure",
        "of",
        "up",
    ]
    (points,) = page.tables
    assert len(points.rows) == 24
    # Points of charts lead to their rows, and rows to their runs.
    links = {row["link"] for row in values(page.charts[0].spec)}
    assert links == {f"#{anchor}" for anchor in points.anchors.values()}
    keys = {run.split(": ")[1] for listed in points.details.values() for run in listed}
    assert keys == set(results.plan["key"])


def test_axes_that_vary_together_are_one(tmp_path: Path) -> None:
    study = study_of(
        {},
        axes=[
            {"name": "n", "key": "parameters.n_cameras", "values": [10, 20, 30], "zip": "size"},
            {"name": "gamma", "key": "parameters.normalization", "values": [0.1, 0.2, 0.3], "zip": "size"},
            {"name": "fixed", "key": "seed_of", "values": [1]},
        ],
    )
    page = report_study(results_of(study, tmp_path))
    (line, *_) = page.charts
    (labels,) = (p["value"] for p in line.spec["params"] if p["name"] == "labels")
    assert labels == [["10, 0.1", "20, 0.2", "30, 0.3"]]
    (joined,) = (p["value"] for p in line.spec["params"] if p["name"] == "joined")
    assert joined == [False]
    assert not page.controls
    assert [chart.id for chart in page.charts if chart.id == "map"] == []


def test_studies_without_runs_or_axes_have_a_page(tmp_path: Path) -> None:
    empty = Parsed(render(report_study(results_of(study_of(AXES), tmp_path, done=False))))
    assert "No run is there yet." in empty.texts["p"]
    assert not empty.texts.get("h3")
    assert not empty.charts
    single = report_study(results_of(study_of({}), tmp_path))
    assert not single.charts
    assert len(single.verdicts) == 3


def test_failed_runs_are_listed(tmp_path: Path) -> None:
    results = results_of(study_of(AXES), tmp_path)
    (tmp_path / "failed").mkdir()
    (tmp_path / "failed" / "0-1.json").write_text(
        json.dumps({"key": "0-1", "message": HOSTILE, "scenario": ""})
    )
    page = report_study(results)
    assert page.tables[1].rows == [["0", "0", "tree", "1", HOSTILE]]
    assert ("Runs", "0 of 24, 1 failed, 23 missing") in page.facts
    assert Parsed(render(page)).texts["th"].count(HOSTILE) > 0


def test_of_many_runs_that_failed_the_first_are_listed(tmp_path: Path) -> None:
    results = results_of(study_of(AXES), tmp_path)
    (tmp_path / "failed").mkdir()
    for key in results.plan["key"]:
        (tmp_path / "failed" / f"{key}.json").write_text(
            json.dumps({"key": key, "message": key, "scenario": ""})
        )
    table = report_study(results).tables[1]
    assert table.title == "Runs that failed: 24, of which the first 20 are listed"
    assert [row[-1] for row in table.rows] == results.plan["key"].tolist()[:20]


def test_a_large_study_is_a_small_file(tmp_path: Path) -> None:
    axes = {
        "latency": np.linspace(0, 20, 11).tolist(),
        "loss": np.linspace(0.0, 0.8, 9).round(2).tolist(),
        "hold_off": [0.25, 1.0],
    }
    study = study_of(axes, replications=20)
    results = results_of(study, tmp_path, ("memory", "disk", "bandwidth"))
    assert len(results.runs) == 11 * 9 * 2 * 20 * 3
    write_page(report_study(results), tmp_path / "study.html")
    assert (tmp_path / "study.html").stat().st_size < 2_000_000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["study.html"]


# -- the command -------------------------------------------------------------------------------------------


def test_report_writes_one_file_beside_the_folder() -> None:
    written()
    before = everything()
    outcome = invoke("report", "results/five")
    assert outcome.exit_code == 0, outcome.output
    assert everything() - before == {"results/five.html"}
    assert outcome.stdout.endswith("five.html\n")
    assert "already" in refusal("report", "results/five") or "new file" in refusal("report", "results/five")
    assert invoke("report", "results/five", "--overwrite").exit_code == 0
    assert invoke("report", "results/five", "--out", "other.html").exit_code == 0


def test_report_refuses_what_it_cannot_show(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = written()
    Path("empty").mkdir()
    assert "it has no run.json" in refusal("report", "empty")
    assert "in a folder that exists" in refusal("report", str(folder), "--out", "no/where.html")
    assert "it is a folder" in refusal("report", str(folder), "--out", "empty", "--overwrite")
    monkeypatch.setattr(
        "aimd_des.report.html_page.find_spec", lambda name: None if name == "altair" else name
    )
    sentence = refusal("report", str(folder))
    assert "a report needs altair, which is not installed; say pip install 'aimd-des[report]'" in sentence


def test_a_page_that_cannot_be_written_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    written()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    assert "No space left on device" in refusal("report", "results/five")


def test_the_measures_of_the_helper_are_measures() -> None:
    assert set(MEASURES) <= set(study_of({}).columns())
