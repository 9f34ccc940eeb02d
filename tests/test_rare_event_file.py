"""The rare event of a scenario file is estimated as in Python: by the command, and at points of a study."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aimd_des import InputError
from aimd_des.results.measures import RARE
from aimd_des.scenario import validate_scenario
from aimd_des.study import Axis, Study, rare_event, run_study
from tests.command_line import run

EVENT = {
    "level": 1.09,
    "within": 5.0,
    "after": 60.0,
    "resource": "disk",
    "trials": 10,
    "repetitions": 2,
    "step": 1.0,
}
BASE: dict[str, Any] = {
    "until": 20.0,
    "model": "models.smart_cameras",
    "parameters": {"n_cameras": 12},
    "dynamics": "continuous",
    "control_unit": {"kind": "crossing"},
    "channel": {"latency": 1.0, "loss": 0.2},
    "agents": "fleet",
    "rare_event": EVENT,
}


def test_a_study_has_the_estimate_of_each_run(tmp_path: Path) -> None:
    study = Study(
        scenario=BASE, measures=["signals", *RARE], axes=[Axis(key="rare_event.level", values=[1.09, 50.0])]
    )
    with ThreadPoolExecutor(1) as executor:
        results = run_study(study, tmp_path / "out", executor, workers=1)
    rows = results.runs.set_index(["rare_event.level", "resource"])
    scenario = results.scenario(results.runs["key"].iloc[0])
    found = rare_event(scenario.simulation(), **EVENT)
    expected = [found.probability, found.low, found.high, found.relative_error, found.gain]
    assert 0.0 < found.probability < 1.0
    assert np.array_equal(rows.loc[(1.09, "disk"), list(RARE)].to_numpy(float), expected, equal_nan=True)
    # Of other resources nothing is asked, and the other level is out of reach.
    assert rows.loc[(1.09, "memory"), list(RARE)].isna().all()
    assert rows.loc[(50.0, "disk"), list(RARE)].isna().all()
    assert "rare_event_high" in Study(scenario=BASE).columns()


def test_the_command_prints_it(own_folder: Path) -> None:
    scenario = validate_scenario(BASE, "mine")
    Path("mine.toml").write_text(scenario.to_toml(), encoding="utf-8")
    outcome = run("mine.toml", "--no-figures")
    assert outcome.exit_code == 0, outcome.output
    assert "Rare event: demand of disk reaches 1.09 within 5 with a probability of 0." in " ".join(
        outcome.output.split()
    )


@pytest.mark.parametrize(
    ("event", "said"),
    [
        ({**EVENT, "within": 0.0}, "rare_event.within = 0.0"),
        ({**EVENT, "trials": 3}, "rare_event.trials = 3"),
        ({**EVENT, "step": 9.0}, "rare_event.step = 9.0"),
    ],
)
def test_values_out_of_range_are_refused(event: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        validate_scenario({**BASE, "rare_event": event}, "mine")


def test_measures_of_it_need_the_table() -> None:
    scenario = {key: value for key, value in BASE.items() if key != "rare_event"}
    with pytest.raises(InputError, match=r"measures = \['rare_event'\]: must be left out"):
        Study(scenario=scenario, measures=["rare_event"])
