"""The form of a scenario that is hashed: alike for what is alike, different for what is different."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from aimd_des.scenario import Scenario
from aimd_des.scenario.canonical import typed_parameters
from tests.conftest import ROOT

CAMERAS: dict[str, Any] = {
    "until": 60,
    "seed": 3,
    "model": "models.smart_cameras",
    "parameters": {"n_cameras": 5},
}


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(ROOT))


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
