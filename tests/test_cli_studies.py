"""`aimd-des show` and `compare` for the folders of studies, against NumPy and SciPy."""

import json
import re
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from aimd_des.study import Study, load_study, run_study
from aimd_des.study.store import AGAIN
from aimd_des.utils.formatting import given as setting
from aimd_des.utils.formatting import interval, measured
from tests.command_line import refusal, run, said, words, write
from tests.conftest import INLINE, quietly
from tests.test_study_runs import forget

MAIN = ["utilisation", "misallocation", "cost_ratio", "overshoot_peak"]
LATENCIES, LOSSES, RESOURCES = (0.0, 0.5), (0.0, 0.2), ("memory", "disk")


def study(**changes: Any) -> Study:
    scenario = {**tomllib.loads(INLINE), "until": 40}
    del scenario["seed"]
    axes = [
        {"name": "latency", "key": "channel.latency", "values": list(LATENCIES)},
        {"name": "loss", "key": "channel.loss", "values": list(LOSSES)},
    ]
    return Study.model_validate(
        {"title": "of two axes", "replications": 3, "scenario": scenario, "axes": axes, **changes}
    )


def made(folder: str, **changes: Any) -> None:
    with ThreadPoolExecutor(1) as executor:
        quietly(run_study, study(**changes), folder, executor, 1)


@pytest.fixture(scope="module", autouse=True)
def _studies(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("studies"))
        made("base")
        made("other", scenario={**study().scenario, "control_unit": {"period": 2.0}}, replications=2)
        made("reseeded", seed=1)
        yield


def t_interval(values: Any) -> str:
    low, high = stats.t.interval(0.95, len(values) - 1, np.mean(values), stats.sem(values))
    return interval(float(np.mean(values)), float(high - low) / 2)


def at(runs: pd.DataFrame, latency: float, loss: float, resource: str) -> pd.DataFrame:
    return runs[(runs["latency"] == latency) & (runs["loss"] == loss) & (runs["resource"] == resource)]


def flat(text: str) -> str:
    return " ".join(text.split())


def test_means_of_every_point_with_their_half_widths(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    out = said("show", "base")
    rows = words(out)
    assert ["title", "of", "two", "axes"] in rows
    assert ["axis", "latency", "[0,", "0.5]"] in rows
    assert ["runs", "12", "of", "12", "are", "there"] in rows
    runs = load_study("base").runs
    for latency in LATENCIES:
        for loss in LOSSES:
            for resource in RESOURCES:
                part = at(runs, latency, loss, resource)
                cells = [word for name in MAIN for word in t_interval(part[name]).split()]
                assert [setting(latency), setting(loss), resource, "3", *cells] in rows


def test_means_over_an_axis_take_one_number_of_each_replication(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    rows = words(said("show", "base", "--by", "loss", "--measure", "signals"))
    runs = load_study("base").runs
    for loss in LOSSES:
        part = runs[(runs["loss"] == loss) & (runs["resource"] == "disk")]
        values = part.groupby("replication")["signals"].mean()
        assert len(values) == 3
        assert [setting(loss), "disk", "3", *t_interval(values).split()] in rows
    rows = words(said("show", "base", "--by", "resource", "--measure", "signals"))
    assert rows[-2][0] == "memory"


def test_what_failed_and_what_is_missing_is_told() -> None:
    made("holes")
    results = load_study("holes")
    keys = results.plan["key"].tolist()
    for key in keys[:2]:
        forget(results.folder, key)
    record = {"key": keys[0], "message": "out of [luck]", "scenario": "until = 40"}
    (results.folder / "failed" / f"{keys[0]}.json").write_text(json.dumps(record), encoding="utf-8")
    out = said("show", "holes")
    assert "runs 10 of 12 are there, 1 failed, 1 missing" in flat(out)
    assert "Runs that failed: 1" in out
    assert any(row[:3] == ["0", "0", "0"] and row[3:] == ["out", "of", "[luck]"] for row in words(out))
    # At this point one replication is left: a mean, and nothing that it is known to.
    assert any(row[:4] == ["0", "0", "memory", "1"] and "±" not in row for row in words(out))
    # Over the axis only the replication counts of which all is there.
    assert any(row[:3] == ["0", "memory", "1"] for row in words(said("show", "holes", "--by", "latency")))


def test_a_damaged_failure_is_refused() -> None:
    made("luckless", replications=1)
    key = load_study("luckless").plan["key"].iloc[0]
    forget(Path("luckless"), key)
    for content in ("{", "[]", "{}"):
        Path("luckless/failed", f"{key}.json").write_text(content, encoding="utf-8")
        assert refusal("show", "luckless").startswith(f"luckless/failed/{key}.json: cannot be read (")


def test_a_study_without_runs_is_shown() -> None:
    made("empty", replications=1)
    for path in Path("empty/runs").iterdir():
        path.unlink()
    out = said("show", "empty")
    assert "No run is there yet." in out
    assert "runs 0 of 4 are there, 4 missing" in flat(out)


def test_a_study_of_one_point_is_shown() -> None:
    made("point", axes=[], measures=["signals"])
    rows = words(said("show", "point"))
    assert ["resource", "replications", "signals"] in rows


def test_pairs_where_seeds_are_equal() -> None:
    out = said("compare", "base", "other", "--measure", "utilisation")
    rows = words(out)
    assert ["scenario.control_unit.period", "-", "2"] in rows
    assert ["replications", "3", "2"] in rows
    one, other = load_study("base").runs, load_study("other").runs
    for latency in LATENCIES:
        first, second = (
            at(runs, latency, 0.2, "disk").set_index("replication")["utilisation"] for runs in (one, other)
        )
        first = first[second.index]
        cells = [
            measured(float(first.mean())),
            measured(float(second.mean())),
            *t_interval(second - first).split(),
        ]
        assert [setting(latency), "0.2", "disk", *cells, "pairs:", "2"] in rows


def test_welch_where_seeds_differ() -> None:
    rows = words(said("compare", "base", "reseeded", "--measure", "signals", "--measure", "utilisation"))
    one, other = (at(load_study(name).runs, 0.5, 0.2, "memory") for name in ("base", "reseeded"))
    for name in ("signals", "utilisation"):
        test = stats.ttest_ind(other[name], one[name], equal_var=False).confidence_interval(0.95)
        mean = float(other[name].mean() - one[name].mean())
        cells = interval(mean, (test.high - test.low) / 2).split()
        means = [measured(float(part[name].mean())) for part in (one, other)]
        assert ["0.5", "0.2", "memory", *means, *cells, "Welch:", "3,", "3"] in rows


def test_points_that_only_one_has_are_named() -> None:
    axes = [
        {"name": "latency", "key": "channel.latency", "values": [0.5, 1.0]},
        {"name": "loss", "key": "channel.loss", "values": [0.0]},
    ]
    made("shifted", axes=axes, replications=1)
    out = said("compare", "base", "shifted", "--measure", "signals")
    assert "Only in the first: latency 0, loss 0; latency 0, loss 0.2; latency 0.5, loss 0.2" in flat(out)
    assert "Only in the second: latency 1, loss 0" in flat(out)
    # One pair: a difference, and nothing that it is known to.
    assert any(row[-2:] == ["pairs:", "1"] and "±" not in row for row in words(out))


def test_an_axis_with_one_value_may_be_missing() -> None:
    axes = [{"name": "latency", "key": "channel.latency", "values": list(LATENCIES)}]
    made("narrow", axes=axes, replications=1)
    found = refusal("compare", "narrow", "base")
    assert found.startswith("axis 'loss': only base has it, with 2 values, so that points match none")
    axes = [*axes, {"name": "loss", "key": "channel.loss", "values": [0.0]}]
    made("lossless", axes=axes, replications=1)
    assert "± 0" not in said("compare", "narrow", "lossless", "--measure", "signals")


def test_studies_without_a_common_point_are_refused() -> None:
    axes = [{"name": "latency", "key": "channel.latency", "values": [7.0]}]
    made("far", axes=axes, replications=1)
    made("near", axes=[{**axes[0], "values": [1.0]}], replications=1)
    assert refusal("compare", "far", "near") == "far and near: no point at which there are runs is in both"


def test_a_run_and_a_study_are_not_compared() -> None:
    assert run(str(write()), "--out", "run").exit_code == 0
    for pair in (("run", "base"), ("base", "run")):
        assert refusal("compare", *pair).startswith("only base is the folder of a study; give those of two")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--measure", "nothing"], "measure = 'nothing': must be one of signals, "),
        (["--measure", "utilization"], "did you mean 'utilisation'?"),
        (["--by", "los"], "by = 'los': must be one of latency, loss, resource"),
    ],
)
def test_what_a_study_does_not_have_is_refused(options: list[str], sentence: str) -> None:
    assert sentence in refusal("show", "base", *options)


def test_a_measure_that_is_not_kept_is_refused() -> None:
    made("lean", measures=["signals"], replications=1)
    assert refusal("show", "lean", "--measure", "bits") == (
        "measure = 'bits': must be one that the study keeps: signals"
    )
    assert re.search(r"replications +signals", said("show", "lean"))


def test_a_run_has_no_axes() -> None:
    assert run(str(write()), "--out", "alone").exit_code == 0
    found = refusal("show", "alone", "--by", "loss")
    assert found == "--by: has a meaning for the folder of a study only, and alone is none"


@pytest.mark.parametrize("content", ["{", "[]", "{}", '{"study": {}}', None])
def test_a_damaged_folder_is_refused(content: str | None) -> None:
    if not Path("damaged").exists():
        made("damaged", replications=1)
    manifest = json.loads(Path("base/manifest.json").read_text(encoding="utf-8"))
    manifest["study"]["scenario"] = 3
    text = json.dumps(manifest) if content is None else content
    Path("damaged/manifest.json").write_text(text, encoding="utf-8")
    assert refusal("show", "damaged").startswith("damaged/manifest.json: ")


@pytest.mark.parametrize("name", ["plan.parquet", "runs"])
def test_a_damaged_table_is_refused(name: str) -> None:
    if not Path("torn").exists():
        made("torn", replications=1)
    path = Path("torn", name)
    path = next(path.iterdir()) if path.is_dir() else path
    whole = path.read_bytes()
    remedy = AGAIN if name == "runs" else "remove it, and sweep again"
    for damaged, what in ((whole[:-20], "does not fit its checksum"), (whole[:99], "cannot be read (")):
        path.write_bytes(damaged)
        sentence = refusal("show", "torn")
        assert sentence.startswith(f"{path}: {what}")
        assert sentence.endswith(remedy)
    path.write_bytes(whole)


def test_a_folder_without_a_plan_is_refused() -> None:
    made("planless", replications=1)
    Path("planless/plan.parquet").unlink()
    assert "with its manifest.json and plan.parquet" in refusal("show", "planless")
