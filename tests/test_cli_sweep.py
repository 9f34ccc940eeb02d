"""`aimd-des sweep`: what it says, how it ends, and how it goes on."""

import errno
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from aimd_des import load_study
from aimd_des.study import run as sweeping
from aimd_des.study.workers import Processes
from tests.command_line import invoke
from tests.conftest import INLINE

STUDY = """
title = "two points"
base = "base.toml"
replications = 2

[scenario]
until = 20

[[axes]]
key = "channel.latency"
values = [0, 2]
"""


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("base.toml").write_text(INLINE, encoding="utf-8")
    Path("study.toml").write_text(STUDY, encoding="utf-8")
    # Processes are tested with the studies themselves; here a thread is enough.
    monkeypatch.setattr(Processes, "start", lambda self, workers: ThreadPoolExecutor(1))


def sweep(*arguments: str) -> Result:
    return invoke("sweep", *arguments)


def test_a_sweep_fills_a_folder_and_the_same_command_finds_it_full() -> None:
    listed = sweep("study.toml", "--dry-run")
    assert listed.exit_code == 0, listed.output
    assert listed.stdout.splitlines()[-1] == "2 points, 4 runs: 0 are there, 0 have failed"
    assert not Path("results").exists()
    for _ in range(2):
        outcome = sweep("study.toml", "--workers", "2")
        assert outcome.exit_code == 0, outcome.output
        assert outcome.stdout == "4 of 4 runs in results/study\n"
    assert sweep("study.toml", "--dry-run").stdout.splitlines()[-1].endswith("4 are there, 0 have failed")
    grown = sweep("study.toml", "--set", "replications=3", "--set", "axes.0.values=[0, 1, 2]")
    assert grown.stdout == "9 of 9 runs in results/study\n"
    again = sweep("results/study/study.toml", "--out", "results/study")
    assert again.stdout == grown.stdout


def test_ctrl_c_ends_with_how_to_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*args: Any, **kwargs: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sweeping, "run_study", stop)
    outcome = sweep("study.toml", "--out", "a b", "--set", "seed=3", "--dask-workers", "2")
    assert outcome.exit_code == 130
    expected = "Stopped. To go on: aimd-des sweep study.toml --out 'a b' --set seed=3 --dask-workers 2\n"
    assert outcome.stderr.endswith(expected)


def test_a_full_disk_ends_with_how_to_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", fail)
    outcome = sweep("study.toml", "--out", "out")
    assert outcome.exit_code == 1
    sentence = "Error: out: cannot be written (No space left on device); what is written is kept; to go on:"
    assert outcome.stderr.splitlines()[-1] == f"{sentence} aimd-des sweep study.toml --out out"


def test_runs_that_fail_are_told_and_tried_again_if_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("frail.py").write_text(
        "from aimd_des import PolynomialCosts, Problem, Resource, model\n"
        "from pathlib import Path\n"
        "@model\n"
        "def frail(seed=0):\n"
        "    if seed and not Path('well').exists():\n"
        "        raise RuntimeError('not today')\n"
        "    return Problem([Resource('r', 1.0, 0.1, 0.5, 0.1)], PolynomialCosts([2], [[[1.0]]]))\n"
    )
    monkeypatch.syspath_prepend(str(Path.cwd()))
    Path("frail.toml").write_text("replications = 3\n[scenario]\nmodel = 'frail'\nuntil = 5\n")
    for arguments in ([], ["--retry-failed"]):
        outcome = sweep("frail.toml", *arguments)
        assert outcome.exit_code == 1
        cause = "frail makes no problem of them (RuntimeError: not today); all are described in"
        assert f"3 runs failed, the first with: InputError: parameters: {cause}" in outcome.stderr
        assert "aimd-des sweep frail.toml --out results/frail --retry-failed" in outcome.stderr
    Path("well").touch()
    assert sweep("frail.toml").exit_code == 1
    assert sweep("frail.toml", "--retry-failed").exit_code == 0
    assert load_study("results/frail").failed.empty


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["nowhere.toml"], "nowhere.toml: there is no such file"),
        (["study.toml", "--set", "replication=3"], "did you mean 'replications'?"),
        (
            ["study.toml", "--set", "axes.0.key=channel.latancy"],
            "study.toml: at channel.latancy = 0: channel.latancy",
        ),
        (["study.toml", "--workers", "1", "--dask-workers", "1"], "exclude each other"),
        (["study.toml", "--workers", "0"], "0 is not in the range"),
        (["study.toml", "--scheduler", "nonsense"], "scheduler = 'nonsense': must be the address of a Dask"),
        (["study.toml", "--out", "base.toml"], "it is a file; choose another name"),
        (["study.toml", "--out", "."], "new, empty or that of a study; it has no manifest.json"),
    ],
)
def test_a_mistake_ends_with_one_sentence(arguments: list[str], sentence: str) -> None:
    outcome = sweep(*arguments)
    assert outcome.exit_code == 2, outcome.output
    assert "Traceback" not in outcome.output
    assert sentence in outcome.stderr
    assert not Path("results").exists()


def test_dask_that_is_not_installed_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    outcome = sweep("study.toml", "--dask-workers", "1")
    assert outcome.exit_code == 2
    assert outcome.stderr.splitlines()[-1].endswith("Dask is not installed: install 'aimd-des[dask]'")
