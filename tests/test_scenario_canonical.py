"""The form of a scenario that is hashed: alike for what is alike, different for what is different."""

import json
import re
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from aimd_des import InputError
from aimd_des.scenario import Scenario, load_scenario
from aimd_des.scenario.canonical import typed_parameters
from aimd_des.scenario.dotted_keys import with_settings
from aimd_des.study.file import read_study as load_study_file
from aimd_des.study.points import expand, run_of
from aimd_des.study.study import Study, stored_study

CAMERAS: dict[str, Any] = {
    "until": 60,
    "seed": 3,
    "model": "models.smart_cameras",
    "parameters": {"n_cameras": 5},
}


pytestmark = pytest.mark.usefixtures("own_folder")


def canonical(**changes: Any) -> bytes:
    return Scenario(**{**CAMERAS, **changes}).canonical()


@pytest.mark.parametrize(
    "changes",
    [
        {"title": "another"},
        {"agents": "fleet"},
        {"until": 60.0},
        {"dynamics": "discrete"},
        {"channel": {"latency": 0}},
        {"parameters": {"n_cameras": 5, "increase": "as_run"}},
        {"parameters": {"n_cameras": 5, "seed": 3}},
        {"parameters": {"n_cameras": 5, "normalization": 1 / 90}},
    ],
)
def test_what_changes_no_result_changes_no_byte(changes: dict[str, Any]) -> None:
    assert canonical(**changes) == canonical()


@pytest.mark.parametrize(
    "changes",
    [
        {"until": 61},
        {"seed": 4},
        {"dynamics": "continuous"},
        {"channel": {"latency": 0.1}},
        {"recording": {"tail": 3}},
        {"parameters": {"n_cameras": 6}},
        {"parameters": {"n_cameras": 5, "seed": 4}},
    ],
)
def test_what_changes_a_result_changes_it(changes: dict[str, Any]) -> None:
    assert canonical(**changes) != canonical()


def test_a_number_is_the_same_with_and_without_a_point() -> None:
    for change in ("channel", "clocks"):
        key = {"channel": "latency", "clocks": "period"}[change]
        assert canonical(**{change: {key: 2}}) == canonical(**{change: {key: 2.0}})
    one, other = ({"n_cameras": 5, "normalization": number} for number in (1, 1.0))
    assert canonical(parameters=one) == canonical(parameters=other)


def test_it_is_json_with_sorted_keys() -> None:
    read = json.loads(canonical())
    assert read["seed"] == 3
    assert list(read) == sorted(read)
    assert "title" not in read
    assert read["parameters"]["normalization"] == 1 / 90


def test_numbers_of_a_model_have_the_types_of_its_signature(tmp_path: Path) -> None:
    def function(
        a: float = 1.0,
        b: int = 1,
        c: float | None = None,
        d: npt.ArrayLike = 1,
        e: list[float] = [],  # noqa: B006
        f: Path = Path(),
        g=2.0,  # type: ignore # noqa: ANN001, PGH003
        h: int | float = 1,
        i: np.float64 | None = None,
        j: "bool | float" = False,
    ) -> None: ...

    (tmp_path / "data.csv").write_text("x", encoding="utf-8")
    given = {
        "a": 1,
        "b": 1,
        "c": 1,
        "d": [1, 2],
        "e": [1],
        "f": "data.csv",
        "g": 1,
        "h": 1,
        "i": 1,
        "j": True,
    }
    typed = typed_parameters(function, given)
    floats = {name for name, value in typed.items() if type(value) is float or type(value) is list}
    assert floats == set("acdegi")
    assert typed["d"] == [1.0, 2.0]
    assert all(type(number) is float for number in typed["d"])
    assert typed["f"] == "sha256:2d711642b726b04401627ca9fbac32f5c8530fb1903cc4db02258717921a4881"
    assert typed_parameters(function, {"f": "missing.csv"}) == {"f": "missing.csv"}


def test_annotations_that_cannot_be_read_are_done_without() -> None:
    def function(a: "Nowhere" = 1.0, b=2) -> None: ...  # type: ignore # noqa: ANN001, F821, PGH003

    assert [type(value) for value in typed_parameters(function, {"a": 1, "b": 1}).values()] == [float, int]


# -- keys that have been renamed ---------------------------------------------------------------------------

# Hashes of before `refractory` and `longest` were renamed: stored studies go on as long as these hold.
OLD_SCENARIO = "d4194b9a0317288fe4b4b5cca89fa44ee6596d41e762ab534cbccc9cdea8aae6"
OLD_RUNS = [
    ("8d612dbf69b1dc56", "7ef82f4ce6aaf3518a29dc9a1046e13e"),
    ("94085f81932eba82", "9575ad0bbafe145e3f117d4f4e10ed27"),
    ("66104131488e402f", "e5fca05dabb5510d2479cccf71568ab9"),
    ("167b2b6eb9e32ce7", "4ef8129c439862ce1a12298385af3782"),
]
OLD_CASE = ("5684da9e476d5e5c", "bf3c525b26d939de2a998da8bcc4f750")
FIRST = {"hold_off": "refractory", "longest_hold_off": "longest"}
FLOWING: dict[str, Any] = {
    "until": 60,
    "model": "models.smart_cameras",
    "parameters": {"n_cameras": 5},
    "dynamics": "continuous",
}


def unit(names: dict[str, str], **values: float) -> dict[str, Any]:
    return {"kind": "crossing", **{names.get(key, key): value for key, value in values.items()}}


def keyed(names: dict[str, str], key: str) -> str:
    return f"control_unit.{names.get(key, key)}"


def runs_of(study: Study) -> list[tuple[str, str]]:
    return [(point.name, run_of(study, point, 0).key) for point in expand(study)]


@pytest.mark.parametrize("names", [{}, FIRST])
def test_renamed_keys_leave_hashes_as_they_were(names: dict[str, str]) -> None:
    adaptive = unit(names, hold_off=0.5, longest_hold_off=4.0)
    scenario = Scenario(**FLOWING, control_unit=adaptive)
    assert sha256(scenario.canonical()).hexdigest() == OLD_SCENARIO
    axes = [
        {"name": "wait", "key": keyed(names, "hold_off"), "values": [0.5, 1]},
        {
            "name": "unit",
            "cases": {
                "fixed": {"control_unit.sensing_delay": 0.0},
                "own": {keyed(names, "longest_hold_off"): 4.0},
            },
        },
    ]
    base = {**FLOWING, "control_unit": unit(names, hold_off=0.25)}
    assert runs_of(Study(scenario=base, paired=False, axes=axes)) == OLD_RUNS
    cases = [{"name": "unit", "cases": {"a": {"control_unit": adaptive}}}]
    assert runs_of(Study(scenario=FLOWING, paired=False, axes=cases)) == [OLD_CASE]


def test_a_study_under_old_keys_spells_the_new_ones_and_keeps_its_columns(
    caplog: pytest.LogCaptureFixture,
) -> None:
    base = {**FLOWING, "control_unit": unit(FIRST, hold_off=0.25)}
    study = Study(scenario=base, axes=[{"key": keyed(FIRST, "hold_off"), "values": [0.5, 1.0]}])
    assert "longest" not in str(study.spoken())
    assert study.scenario["control_unit"] == unit({}, hold_off=0.25)
    assert [(axis.name, axis.key) for axis in study.axes] == [
        ("control_unit.refractory", "control_unit.hold_off")
    ]
    words = "is called {}control_unit.hold_off since 0.1; the old name ends with 0.3"
    assert caplog.messages == [
        f"scenario.control_unit.refractory {words.format('scenario.')}",
        f"control_unit.refractory {words.format('')}",
    ]
    caplog.clear()
    Study(**study.spoken())
    stored = {"scenario": base, "axes": [{"key": keyed(FIRST, "hold_off"), "values": [0.5, 1.0]}]}
    assert stored_study({"study": stored}, Path("there")) == study
    assert not caplog.messages


def test_old_keys_in_files_and_settings_are_told_once_with_the_file(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        'until = 5\nmodel = "models.smart_cameras"\ndynamics = "continuous"\n'
        '[control_unit]\nkind = "crossing"\nrefractory = 0.5\n',
        encoding="utf-8",
    )
    assert load_scenario(file).spoken()["control_unit"]["hold_off"] == 0.5
    told = "control_unit.refractory is called control_unit.hold_off since 0.1; the old name ends with 0.3"
    assert caplog.messages == [f"{file}: {told}"]
    caplog.clear()
    changed = load_scenario(file, **{"control_unit.refractory": 0.25, "control_unit.longest": 2})
    assert changed.spoken()["control_unit"] == {
        "kind": "crossing", "hold_off": 0.25, "sensing_delay": 0.0, "longest_hold_off": 2.0
    }  # fmt: skip
    assert caplog.messages[1] == told
    assert len(caplog.messages) == 3
    file.write_text(file.read_text(encoding="utf-8").replace("0.5", '"x"'), encoding="utf-8")
    with pytest.raises(InputError, match=r"mine\.toml:6: control_unit\.hold_off = 'x': must be"):
        load_scenario(file)


@pytest.mark.parametrize("table", ["control_unit", "scenario.control_unit"])
def test_old_and_new_keys_together_are_refused(table: str, tmp_path: Path) -> None:
    both = f"{table}.refractory = 0.5: must be left out beside {table}.hold_off, its new name"
    with pytest.raises(InputError, match=re.escape(both)):
        with_settings({}, {f"{table}.refractory": 0.5, f"{table}.hold_off": 1.0})
    file = tmp_path / "mine.toml"
    file.write_text(f"[{table}]\nrefractory = 0.5\nhold_off = 1.0\n", encoding="utf-8")
    read: Any = load_scenario if table == "control_unit" else load_study_file
    with pytest.raises(InputError, match=re.escape(f"{file}: {both}")):
        read(file)
