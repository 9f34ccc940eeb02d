"""Charts are what Vega-Lite allows and have the rows that they name; Altair is left as it was."""

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import altair as alt
import pytest
from altair.utils import schemapi
from jsonschema import ValidationError

from aimd_des.report import report_run, report_study
from aimd_des.report.html_page import Page
from aimd_des.scenario.run_folder import load_run
from aimd_des.study import load_study
from tests.command_line import invoke, run, write
from tests.reports import values

pytestmark = pytest.mark.usefixtures("own_folder")

STUDY = """
replications = 2
measures = ["utilisation", "misallocation", "expected_misallocation", "overshoot_peak"]

[scenario]
model = "models.smart_cameras"
dynamics = "continuous"
until = 10
control_unit = {kind = "crossing"}
recording = {demand = "end"}

[[axes]]
name = "hold_off"
key = "control_unit.hold_off"
values = [0.5, 1.0]

[[axes]]
name = "loss"
key = "channel.loss"
values = [0.0, 0.1, 0.3]
"""


def charts_of(page: Page) -> dict[str, dict[str, Any]]:
    return {chart.id: chart.spec for chart in page.charts}


def named(part: Any) -> Iterator[dict[str, Any]]:
    """Whatever a chart refers to as its data."""
    if isinstance(part, dict):
        for key, value in part.items():
            if key == "data":
                yield value
            elif key != "datasets":
                yield from named(value)
    elif isinstance(part, list):
        for value in part:
            yield from named(value)


def hold_to_the_schema(charts: dict[str, dict[str, Any]]) -> None:
    for name, spec in charts.items():
        alt.TopLevelSpec.validate(spec)
        # What is no name is rows, which Altair has copied at every step.
        assert {tuple(data) for data in named(spec)} == {("name",)}, name
        assert {data["name"] for data in named(spec)} == set(spec["datasets"]), name
        assert all(spec["datasets"].values()), name
        columns, rows = spec["usermeta"]["columns"], spec["datasets"][spec["usermeta"]["rows"]]
        assert set(columns) <= set().union(*rows), name


def test_charts_of_a_run_are_what_vega_lite_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    write()
    assert run("five.toml").exit_code == 0
    stored = load_run(Path("results/five"))
    charts = charts_of(report_run(stored))
    assert set(charts["demand"]["datasets"]) == {"rows", "level"}
    assert set(charts["convergence"]["datasets"]) == {"rows", "band"}
    assert set(charts["shares"]["datasets"]) == {"rows", "diagonal"}
    hold_to_the_schema(charts)
    monkeypatch.setattr("aimd_des.report.run_charts._MOST_ROWS", 40)
    monkeypatch.setattr("aimd_des.report.run_charts._MOST_SIGNALS", 5)
    others = charts_of(report_run(stored))
    assert {"min", "max", "mean"} <= set(values(others["demand"])[0])
    assert "rate" in values(others["signals"])[0]
    hold_to_the_schema({name: others[name] for name in ("demand", "signals")})


def test_charts_of_a_study_with_theory_are_what_vega_lite_allows() -> None:
    write(STUDY, "study.toml")
    assert invoke("sweep", "study.toml", "--out", "many", "--workers", "1").exit_code == 0
    charts = charts_of(report_study(load_study(Path("many"))))
    assert set(charts) == {"line-utilisation", "line-misallocation", "line-overshoot-peak", "map"}
    assert set(charts["line-utilisation"]["datasets"]) == {"rows", "level", "critical"}
    assert set(charts["map"]["datasets"]) == {"rows", "critical"}
    assert "expected" in values(charts["line-misallocation"])[0]
    hold_to_the_schema(charts)
    assert schemapi.DEBUG_MODE  # charts of others are checked as before
    wrong = copy.deepcopy(charts["map"])
    wrong["layer"][0]["mark"] = {"type": "square foot"}
    with pytest.raises(ValidationError):
        alt.TopLevelSpec.validate(wrong)
