"""The list of kinds: complete, described, and each with the defaults that hold."""

import inspect
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Clocks,
    InputError,
    PolynomialCosts,
    Problem,
    Recording,
    Resource,
    Simulation,
    averaging,
    compensation,
    interventions,
    latency,
    loss,
    responses,
    run_synchronous,
    topology,
)
from aimd_des.scenario import Scenario
from aimd_des.scenario.kinds import Kind, describe, kinds, our_kinds
from aimd_des.scenario.networks import over_network
from aimd_des.scenario.tables import (
    ChannelSettings,
    ClocksSettings,
    RecordingSettings,
    ResourceSettings,
)
from tests.conftest import ROOT

MEMORY = Resource("memory", capacity=1.0, increase=0.01, decrease=0.5, normalization=0.1)


def names(group: str) -> list[str]:
    return [kind.name for kind in kinds() if kind.group == group]


@pytest.fixture(autouse=True)
def _where_models_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def test_all_that_is_public_has_a_kind() -> None:
    made = {getattr(kind.of.make, "__func__", kind.of.make) for kind in our_kinds()}
    makers = {
        *(getattr(latency, name) for name in latency.__all__ if name not in {"Latency"}),
        *(getattr(loss, name) for name in loss.__all__),
        *(getattr(averaging, name) for name in averaging.__all__),
        *(getattr(responses, name) for name in responses.__all__),
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
    others = "Averaging Combined FloodChannel Intervention Loss LossProcess Planned Prices TreeChannel"
    assert missing == {*others.split(), "CustomResponse", "Response"}


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
    source = "import aimd_des\nimport nothing_of_that_name\n\n@aimd_des.model\ndef broken():\n    ...\n"
    (tmp_path / "broken_model.py").write_text(source, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("aimd_des.scenario.named._MODELS", "broken_model")
    with pytest.raises(
        InputError, match=r"^model = 'broken_model': must be a module that can be imported, and "
    ):
        kinds()


def test_without_a_package_of_models_there_are_the_other_kinds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aimd_des.scenario.named._MODELS", "no_package_of_that_name")
    assert kinds() == our_kinds()


def test_defaults_are_those_of_the_scenario() -> None:
    crossing = next(kind for kind in our_kinds("control_unit") if kind.name == "crossing")
    assert [(one.name, one.required, one.default) for one in crossing.parameters] == [
        ("hold_off", False, "1.0"), ("sensing_delay", False, "0.0"), ("longest_hold_off", False, "")
    ]  # fmt: skip
    grid = next(kind for kind in our_kinds() if kind.name == "grid")
    assert {one.name: one.default for one in grid.parameters}["root"] == "[0, 0]"
    assert {one.name: one.required for one in grid.parameters} == {
        "rows": True, "columns": True, "latency": False, "loss": False, "root": False,
        "over": False, "agents": False, "latency_model": False, "mean_burst": False,
    }  # fmt: skip


def test_a_docstring_without_parameters_describes_none() -> None:
    assert describe(None) == describe("One line.") == {}
    text = "One.\n\nParameters\n----------\na, b : int\n    Two\n    lines.\n\nReturns\n-------\nint\n    x"
    assert describe(text) == {"a": "Two lines.", "b": "Two lines."}


def defaults(function: Callable[..., Any]) -> dict[str, Any]:
    """What holds in Python: the default of each parameter, or that it is required."""
    given = inspect.signature(function).parameters
    return {
        name: "required" if one.default is one.empty else one.default
        for name, one in given.items()
        if not name.startswith("_")
    }


def in_file(table: type[BaseModel], name: str) -> Any:
    field = table.model_fields[name]
    return "required" if field.is_required() else field.get_default(call_default_factory=True)


def differences() -> dict[str, tuple[Any, Any]]:
    """Each key whose default in a file is another than that of Python, with both."""
    pairs: dict[str, tuple[Any, Any]] = {}
    for prefix, table, thing in (
        ("resources.", ResourceSettings, Resource),
        ("channel.", ChannelSettings, BroadcastChannel),
        ("clocks.", ClocksSettings, Clocks),
        ("recording.", RecordingSettings, Recording),
    ):
        for name, python in defaults(thing).items():
            pairs[prefix + name] = in_file(table, name), python
    for kind in our_kinds():
        own = defaults(kind.of.make) | (defaults(over_network) if kind.goes_over else {})
        for name, one in kind.signature.items():
            file = "required" if one.default is one.empty else one.default
            if file != own[name]:  # several kinds have keys of one name
                pairs[f"{kind.group}.{name}"] = file, own[name]
    for function in (Simulation, run_synchronous):
        for name, python in defaults(function).items():
            if name in Scenario.model_fields:
                pairs[name] = in_file(Scenario, name), python
    # What is made when nothing is given is compared as it is made.
    simulation = Simulation(Problem([MEMORY], PolynomialCosts([2], [[[1.0]]])), seed=0)
    for name in ("control_unit", "channel", "clocks", "averaging"):
        pairs[name] = repr(in_file(Scenario, name).build()), repr(getattr(simulation, name))
    pairs["agents"] = {"process": AgentProcess}[in_file(Scenario, "agents")], simulation.agents
    pairs["interventions"] = tuple(in_file(Scenario, "interventions")), simulation.interventions
    built = BroadcastChannel()
    for name in ("latency", "loss"):
        pairs[f"channel.{name}"] = repr(getattr(ChannelSettings().build(), name)), repr(getattr(built, name))
    del pairs["recording"]  # key by key, above
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def test_defaults_of_files_and_of_python_differ_where_the_page_says_so() -> None:
    page = (ROOT / "docs/scenario_files.md").read_text(encoding="utf-8")
    _, _, below = page.partition("| key | in a file | in Python |\n|---|---|---|\n")
    rows = [line.strip("|").split("|") for line in below.partition("\n\n")[0].splitlines()]
    said = {key.strip(" `"): (file.strip(" `"), python.strip(" `")) for key, file, python in rows}

    def written(value: Any) -> str:
        return value if value == "required" else json.dumps(value)

    found = {key: (written(file), written(python)) for key, (file, python) in differences().items()}
    assert found == said
