"""The folder examples/own_parts: each file with its scenario, and the study of two of them."""

import os
import shutil
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from aimd_des import load_study
from aimd_des.scenario.run_folder import load_run
from aimd_des.study import read_study, run_study
from aimd_des.study.workers import dask_executor
from aimd_des.utils.parts import REGISTERED
from tests.command_line import digest, invoke, run
from tests.conftest import ROOT
from tests.forks import forks

FOLDER = ROOT / "examples" / "own_parts"
NAMES = sorted(path.stem for path in FOLDER.glob("*.py"))

# Ends itself without a word once five runs are in the folder.
KILLED = """
import os, signal
from aimd_des.study import read_study, run_study
def watch(tally):
    if tally.done == 5:
        os.kill(os.getpid(), signal.SIGKILL)
run_study(read_study("study.toml"), "out", workers=1, watch=watch)
"""


@pytest.fixture(autouse=True)
def _beside_them(own_folder: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Work in a copy of the folder, whose modules workers find, too; other tests know nothing of them."""
    shutil.copytree(FOLDER, ".", dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(Path.cwd()), str(ROOT))))
    yield
    for name in NAMES:
        sys.modules.pop(name, None)
        REGISTERED.pop(name, None)


def test_each_part_has_a_scenario_and_stands_on_the_page() -> None:
    page = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
    assert sorted(path.stem for path in FOLDER.glob("*.toml")) == sorted([*NAMES, "study"])
    assert [path.name for path in FOLDER.iterdir() if path.is_file() and path.name not in page] == []


@pytest.mark.parametrize("name", NAMES)
def test_processes_and_a_fleet_agree(name: str) -> None:
    for agents in ("process", "fleet"):
        outcome = run(f"{name}.toml", "--agents", agents, "--out", agents, "--set", "until=60")
        assert outcome.exit_code == 0, outcome.output
    assert digest("process") == digest("fleet")


def test_congestion_comes_at_the_same_times_whatever_it_does() -> None:
    """So that runs of one seed are paired; another seed has other times."""

    def changes(*settings: str) -> list[float]:
        options = [word for setting in settings for word in ("--set", setting)]
        words = ("--out", "out", "--overwrite", "--no-figures", "--set", "recording.events=true", *options)
        assert run("congestion.toml", *words).exit_code == 0
        log = load_run("out").frame("events")
        return list(log["time"][log["kind"] == "channel"])

    times = changes()
    assert times[0] == 0.0
    assert len(times) > 5
    assert changes("interventions.0.congested=9.0", "interventions.0.loss_congested=0.5") == times
    assert changes("seed=2") != times


@pytest.mark.slow
def test_the_study_is_killed_and_goes_on_on_two_workers_and_on_dask() -> None:
    assert forks().run(KILLED).returncode == -signal.SIGKILL
    done = load_study("out").runs["key"].nunique()
    assert 5 <= done < 12
    assert invoke("sweep", "study.toml", "--out", "out", "--workers", "2").exit_code == 0
    whole = load_study("out")
    assert whole.runs["key"].nunique() == 12
    assert whole.failed.empty
    assert whole.missing.empty
    with dask_executor(workers=1) as (executor, workers):
        run_study(read_study("study.toml"), "dask", executor, workers)
    assert load_study("dask").runs.equals(whole.runs)
    assert invoke("report", "out", "--out", "page.html").exit_code == 0
    assert "periodic_outage.PeriodicOutage" in Path("page.html").read_text(encoding="utf-8")
