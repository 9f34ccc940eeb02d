"""The folder of an emulation: that of a run, with what was measured beside it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aimd_des.emulate.conductor import Collected, sound_rows
from aimd_des.emulate.network_frames import network_frames
from aimd_des.emulate.outcome import Rows, outcome
from aimd_des.emulate.records import ROWS
from aimd_des.emulate.served import Emulation, check_setting
from aimd_des.results.result import Result
from aimd_des.scenario.run_folder import StoredRun, load_run, write_run
from aimd_des.scenario.scenario import Scenario, validate_scenario
from aimd_des.utils.errors import InputError
from aimd_des.utils.folders import Place

_ABOUT, _RECORDS = "emulation.json", "records"


def cut_at(setting: Emulation, reached: float) -> Emulation:
    """Let a run end where it was stopped."""
    scenario = setting.scenario
    if reached >= scenario.until:
        return setting
    recording = scenario.recording
    kept = {
        name: [time for time in times if time <= reached] or "end"
        for name in ("demand", "allocations")
        if isinstance(times := getattr(recording, name), list)
    }
    changed = {"until": reached, "recording": recording.model_copy(update=kept)}
    return replace(setting, scenario=scenario.model_copy(update=changed))


def write_emulation(
    place: Place, setting: Emulation, measured: Collected, *, figures: bool = True
) -> tuple[Result, dict[str, pd.DataFrame]]:
    """Write the folder of a run, with the records and with what was measured of the network."""
    setting = cut_at(setting, measured.reached)
    result, frames = outcome(setting, measured), network_frames(setting, measured)
    about = {
        "unit": setting.unit,
        "processes": setting.processes,
        "transport": measured.transport,
        "stopped": measured.stopped,
        "offsets": measured.offsets,
    }

    def also(folder: Path) -> None:
        (folder / _ABOUT).write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
        records = pd.DataFrame(measured.rows[np.argsort(measured.rows["sequence"], kind="stable")])
        records.to_parquet(folder / f"{_RECORDS}.parquet", index=False)
        for name, frame in frames.items():
            frame.to_csv(folder / f"{name}.csv", index=False)

    write_run(place, setting.scenario, result, figures=figures, also=also)
    return result, frames


@dataclass(frozen=True, eq=False)
class StoredEmulation:
    """A folder that `aimd-des emulate` wrote."""

    run: StoredRun
    setting: Emulation
    measured: Collected

    @property
    def scenario(self) -> Scenario:
        """What was run."""
        return self.setting.scenario


def load_emulation(folder: Path) -> StoredEmulation:
    """Read the folder of an emulation with all its records; refuse what is none, or damaged."""
    run = load_run(folder)
    if not run.has(_RECORDS):
        allowed = "one that aimd-des emulate wrote"
        raise InputError.of("folder", str(folder), allowed, f"it has no {_RECORDS}.parquet")
    about = _about(run)
    scenario = validate_scenario(run.scenario, str(folder / "scenario.toml"))
    setting = check_setting(scenario, unit=about["unit"], processes=about["processes"])
    offsets = tuple((float(ahead), float(error)) for ahead, error in about["offsets"])
    rows = _rows(folder, run.frame(_RECORDS))
    known = {name: str(about[name]) for name in ("stopped", "transport")}
    rows = sound_rows(rows, setting)
    return StoredEmulation(
        run, setting, Collected(rows, scenario.until, known["stopped"], False, known["transport"], offsets)
    )


def _about(run: StoredRun) -> Mapping[str, Any]:
    path = run.folder / _ABOUT
    try:
        about = json.loads(run.text(_ABOUT))
        missing = {"unit", "processes", "transport", "stopped", "offsets"} - set(about)
    except (ValueError, TypeError) as damage:
        raise InputError(f"{path}: is damaged ({damage}); emulate the scenario again") from None
    if missing:
        raise InputError(
            f"{path}: is damaged (it has no {', '.join(sorted(missing))}); emulate the scenario again"
        )
    return about  # type: ignore[no-any-return]  # a dictionary, as it has keys


def _rows(folder: Path, frame: pd.DataFrame) -> Rows:
    if list(frame.columns) != list(ROWS.names or ()):
        raise InputError(
            f"{folder / _RECORDS}.parquet: is damaged (other columns); emulate the scenario again"
        )
    rows = np.zeros(len(frame), dtype=ROWS)
    for name in frame.columns:
        rows[name] = frame[name].to_numpy()
    return rows
