"""The list of kinds: complete, described, and each with the defaults that hold."""

import inspect
from pathlib import Path

import pytest

from aimd_des import InputError, averaging, compensation, interventions, latency, loss, topology
from aimd_des.scenario.kinds import KINDS, Kind, describe, kinds, kinds_of
from tests.conftest import ROOT


def names(group: str) -> list[str]:
    return [kind.name for kind in kinds() if kind.group == group]


@pytest.fixture(autouse=True)
def _where_models_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def test_all_that_is_public_has_a_kind() -> None:
    made = {getattr(kind.make, "__func__", kind.make) for kind in KINDS}
    makers = {
        *(getattr(latency, name) for name in latency.__all__ if name not in {"Latency"}),
        *(getattr(loss, name) for name in loss.__all__),
        *(getattr(averaging, name) for name in averaging.__all__),
        compensation.KnownLoss,
        compensation.EstimatedLoss,
        *(getattr(topology, name) for name in topology.__all__),
        *(getattr(interventions, name) for name in interventions.__all__),
    }
    missing = {
        thing.__name__
        for thing in makers - made
        if inspect.isclass(thing) or thing.__module__.endswith("files")
    }
    # Protocols; what is made of other things; and prices, which are drawn by the model.
    others = "Averaging Combined FloodChannel Intervention Loss LossProcess Prices TreeChannel"
    assert missing == set(others.split())


@pytest.mark.parametrize("kind", kinds(), ids=lambda kind: f"{kind.group} {kind.name}")
def test_every_kind_and_every_key_is_described(kind: Kind) -> None:
    assert kind.meaning.endswith(".")
    for parameter in kind.parameters:
        assert parameter.meaning, parameter.name
        assert not (parameter.required and parameter.default)


def test_models_are_found() -> None:
    found = names("model")
    assert found == sorted(found)
    assert {"models.smart_cameras", "models.tcp_flows"} <= set(found)
    cameras = next(kind for kind in kinds() if kind.name == "models.smart_cameras")
    assert [(one.name, one.default) for one in cameras.parameters[:3]] == [
        ("seed", "0"), ("n_cameras", "60"), ("increase", '"as_run"')
    ]  # fmt: skip


def test_a_model_that_cannot_be_imported_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "broken_model.py").write_text("import nothing_of_that_name", encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("aimd_des.scenario.kinds._MODELS", "broken_model")
    with pytest.raises(
        InputError, match=r"^model = 'broken_model': must be a module that can be imported, and "
    ):
        kinds()


def test_without_a_package_of_models_there_are_the_other_kinds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aimd_des.scenario.kinds._MODELS", "no_package_of_that_name")
    assert kinds() == KINDS


def test_defaults_are_those_of_the_scenario() -> None:
    crossing = kinds_of("control_unit")[1]
    assert [(one.name, one.required, one.default) for one in crossing.parameters] == [
        ("refractory", False, "1.0"), ("sensing_delay", False, "0.0"), ("longest", False, "")
    ]  # fmt: skip
    grid = next(kind for kind in KINDS if kind.name == "grid")
    assert {one.name: one.default for one in grid.parameters}["root"] == "[0, 0]"
    assert {one.name: one.required for one in grid.parameters} == {
        "rows": True, "columns": True, "latency": False, "loss": False, "root": False,
        "over": False, "agents": False, "latency_model": False, "mean_burst": False,
    }  # fmt: skip


def test_a_docstring_without_parameters_describes_none() -> None:
    assert describe(None) == describe("One line.") == {}
    text = "One.\n\nParameters\n----------\na, b : int\n    Two\n    lines.\n\nReturns\n-------\nint\n    x"
    assert describe(text) == {"a": "Two lines.", "b": "Two lines."}
