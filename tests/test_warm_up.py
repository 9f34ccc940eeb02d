"""A warm-up is left out of the measures, and the points of a study share it."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aimd_des import InputError, Result
from aimd_des.scenario import validate_scenario
from aimd_des.study import Axis, Study, run_study, shared_parts
from aimd_des.study.points import Job, PlannedRun, expand, run_of
from aimd_des.study.schedule import Schedule
from aimd_des.study.warm_ups import WarmUps, warm_up_file
from tests.forks import forks

LATE = {"latency": 2.0, "loss": 0.1}
BASE: dict[str, Any] = {
    "until": 60.0,
    "model": "models.smart_cameras",
    "parameters": {"n_cameras": 8},
    "dynamics": "continuous",
    "control_unit": {"kind": "crossing"},
    "channel": {"latency": 0.5},
    "agents": "fleet",
}


def ran(**changes: Any) -> Result:
    return validate_scenario({**BASE, **changes}, "mine").run()


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"dynamics": "discrete", "control_unit": {"kind": "sampled"}},
        {"interventions": [{"kind": "absence", "agents": ["3"], "at": 30.0, "until": 45.0}]},
    ],
)
def test_measures_begin_where_the_warm_up_ends(parts: dict[str, Any]) -> None:
    whole, rest = ran(**parts), ran(**parts, warm_up={"until": 40.0})
    assert rest.digest == whole.digest
    measured, since = rest.measures(), whole.signals["time"] >= 40.0
    counted = whole.signals[since].groupby("resource", observed=False).size()
    assert measured["signals"].tolist() == counted.tolist()
    for name in ("delivered", "responses"):
        assert (measured[name] < whole.measures()[name]).all()
    if "interventions" not in parts:
        # Averages over the rest, summed over the agents, are what total demand has come to in it.
        used = rest.observations.second_half
        assert measured["utilisation"] == pytest.approx(used, rel=0.05 if parts else 1e-9)
    assert rest.pieces["start"].tolist() == whole.pieces["start"].tolist()
    assert np.allclose(rest.pieces["utilisation"], whole.pieces["utilisation"])


def test_parts_of_the_warm_up_give_way_at_its_end() -> None:
    changed = ran(interventions=[{"kind": "channel", "at": 40.0, "channel": LATE}])
    exchanged = ran(channel=LATE, warm_up={"until": 40.0, "channel": BASE["channel"]})
    assert exchanged.digest == changed.digest


def content(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def study(values: Sequence[float] = (0.5, 2.0), **parts: Any) -> Study:
    step = {"kind": "capacity_step", "resource": "disk", "capacity": 1.5}
    axes = [
        Axis(name="latency", key="channel.latency", values=values),
        Axis(name="drop", cases={"none": {}, "at 45": {"interventions": [{**step, "at": 45.0}]}}),
    ]
    whole: dict[str, Any] = {"scenario": BASE, "warm_up": 40.0, "replications": 2, "axes": axes}
    return Study(**{**whole, **parts})


def test_a_study_runs_the_warm_up_once_for_each_seed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, warmed = [], shared_parts.warmed
    monkeypatch.setattr(shared_parts, "warmed", lambda *given: begun.append(given[0].seed) or warmed(*given))
    with ThreadPoolExecutor(2) as executor:
        results = run_study(study(), tmp_path / "whole", executor, workers=2)
    assert len(begun) == len(set(begun)) == 2
    assert len(results.runs["digest"].unique()) == 8
    for row in results.runs.iloc[[0, -1]].itertuples():
        again = results.scenario(row.key).run()
        assert again.digest == row.digest
        assert row.signals in again.measures()["signals"]
    # What is stopped goes on to the same bytes.
    with ThreadPoolExecutor(1) as executor:
        run_study(study((2.0,)), tmp_path / "parts", executor, workers=1)
        run_study(study(), tmp_path / "parts", executor, workers=1)
    assert content(tmp_path / "parts") == content(tmp_path / "whole")


#: Carries a study out in a thread, and then in two processes, in which warm-ups are counted.
IN_PROCESSES = """
import os, sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from aimd_des.study import run_study, shared_parts
from tests.test_warm_up import study

folder = Path(sys.argv[1])
with ThreadPoolExecutor(1) as executor:
    run_study(study(), folder / "thread", executor, 1)
begun, warmed = folder / "begun", shared_parts.warmed
begun.mkdir()

def counted(scenario, *parts):
    (begun / f"{scenario.seed} {os.getpid()}").touch(exist_ok=False)
    return warmed(scenario, *parts)

shared_parts.warmed = counted
with ProcessPoolExecutor(2, get_context("fork")) as executor:
    run_study(study(), folder / "processes", executor, 2)
"""


def test_workers_share_the_warm_up_of_a_seed(tmp_path: Path) -> None:
    outcome = forks().run(IN_PROCESSES, str(tmp_path))
    assert outcome.returncode == 0, outcome.stderr
    begun = [path.name.split() for path in (tmp_path / "begun").iterdir()]
    assert len({seed for seed, _ in begun}) == len(begun) == 2
    assert content(tmp_path / "processes") == content(tmp_path / "thread")
    assert not (tmp_path / "processes" / "warm_ups").exists()


def test_runs_wait_for_the_one_that_makes_their_warm_up(tmp_path: Path) -> None:
    made = study()
    points = expand(made)
    schedule, warm_ups = Schedule(made, points, {}), WarmUps(made, tmp_path, len(points))

    def begun() -> PlannedRun | None:
        run = schedule.next(warm_ups.waits)
        if run is not None:
            warm_ups.begin(run)
        return run

    with warm_ups.kept():
        first, second = begun(), begun()
        assert first is not None
        assert second is not None
        assert (first.replication, second.replication) == (0, 1)
        assert begun() is None
        # It has died, and has left nothing: another one takes its place.
        warm_ups.end(first, done=False)
        third = begun()
        assert third is not None
        assert third.replication == 0
        assert begun() is None
        file = warm_up_file(tmp_path, third.seed)
        file.touch()
        warm_ups.end(third, done=False)  # it has failed after that
        others = [begun() for _ in range(2)]
        assert [run.replication for run in others if run is not None] == [0, 0]
        assert begun() is None
        for run in others:
            assert file.is_file()
            assert run is not None
            warm_ups.end(run, done=True)
        assert not file.exists()
        # What cannot be saved leaves no file, and no run waits for it any more.
        warm_ups.end(second, done=True)
        others = [begun() for _ in range(3)]
        assert [run.replication for run in others if run is not None] == [1, 1, 1]
    assert not file.parent.exists()


def test_a_warm_up_that_is_damaged_or_cannot_be_saved_is_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = study()
    job, other = (run_of(made, point, 0).job() for point in expand(made)[:2])
    begun, warmed = [], shared_parts.warmed
    monkeypatch.setattr(shared_parts, "warmed", lambda *given: begun.append(given[0].seed) or warmed(*given))
    file = warm_up_file(tmp_path, 0)
    file.parent.mkdir()

    def digest(job: Job, kept: Path | None) -> str:
        parts = shared_parts.SharedParts()  # of another worker
        return parts.run(job, parts.scenario(job), kept).digest

    wanted = digest(job, None), digest(other, None)
    assert digest(job, file) == wanted[0]
    assert len(begun) == 3
    assert digest(other, file) == wanted[1]
    assert len(begun) == 3
    whole = bytearray(file.read_bytes())
    whole[len(whole) // 2] ^= 1
    file.write_bytes(whole)
    assert digest(other, file) == wanted[1]
    assert digest(job, file) == wanted[0]  # which has been written anew
    assert len(begun) == 4
    assert digest(job, tmp_path / "missing" / "0.run") == wanted[0]
    assert len(begun) == 5


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        (
            {"axes": [Axis(name="end", key="until", values=[60, 70])]},
            "key of axis .end. = 'until': must be one of control_unit",
        ),
        (
            {"axes": [Axis(key="parameters.n_cameras", values=[4, 6])]},
            "would act before the end of the warm-up",
        ),
        (
            {"scenario": {**BASE, "warm_up": {"until": 3.0}}},
            "scenario.warm_up: stands beside warm_up of the study",
        ),
        ({"warm_up": 60.0}, "warm_up.until = 60.0: must be a finite number greater than 0 and less than 60"),
    ],
)
def test_what_would_act_before_is_refused(parts: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        study(**parts)


def test_interventions_that_differ_before_its_end_are_refused(tmp_path: Path) -> None:
    early = {"kind": "capacity_step", "resource": "disk", "capacity": 1.5, "at": 30.0}
    cases = {"none": {}, "early": {"interventions": [early]}}
    with pytest.raises(InputError, match="drop = early differ in interventions that act before its end, 40"):
        run_study(study(axes=[Axis(name="drop", cases=cases)]), tmp_path / "x")
    with pytest.raises(InputError, match=r"^agents = .*must be Fleet"):
        ran(agents="process", warm_up={"until": 40.0})
    with pytest.raises(InputError, match="must be left out here"):
        validate_scenario({**BASE, "warm_up": {"until": 3.0}}, "mine").simulation()
