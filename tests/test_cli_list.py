"""`aimd-des list`: all that there is, and what it takes."""

import json
from pathlib import Path
from typing import Any

import pytest

from aimd_des.cli.catalog import TOPICS
from aimd_des.scenario.kinds import our_kinds
from tests.command_line import refusal, said, words, write
from tests.conftest import INLINE, ROOT

pytestmark = pytest.mark.usefixtures("own_folder")


def listed(*topic: str) -> Any:
    return json.loads(said("list", *topic, "--json"))


def test_everything_is_listed() -> None:
    found = listed()
    assert list(found) == list(TOPICS)
    names = {(TOPICS[topic].group, entry["name"]) for topic, entries in found.items() for entry in entries}
    assert names >= {(kind.group, kind.name) for kind in our_kinds()}
    assert ("model", "models.smart_cameras") in names
    assert all(entry["meaning"] for entries in found.values() for entry in entries)


def test_the_overview_names_everything() -> None:
    out = " ".join(said("list").split())
    for kind in our_kinds():
        assert kind.name in out
    assert "models.ev_charging" in out


@pytest.mark.parametrize("topic", [topic for topic in TOPICS if topic not in {"models", "scenarios"}])
def test_a_topic_shows_keys_defaults_and_meanings(topic: str) -> None:
    (entries,) = listed(topic).values()
    rows = words(said("list", topic))
    assert entries
    for entry in entries:
        assert any(row[:1] == [entry["name"]] for row in rows)
        for key in entry["parameters"]:
            assert any(row[:1] == [key["name"]] for row in rows)
            if key["required"]:
                assert any(row[:2] == [key["name"], "required"] for row in rows)


def test_models_of_this_folder_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    entries = {entry["name"]: entry for entry in listed("models")["models"]}
    keys = {key["name"]: key for key in entries["models.smart_cameras"]["parameters"]}
    assert keys["n_cameras"]["default"] == "60"
    assert keys["n_cameras"]["meaning"].startswith("How many cameras")
    assert keys["increase"]["default"] == '"as_run"'


def test_scripts_and_files_of_this_folder_are_found() -> None:
    Path("scenarios").mkdir()
    write('"""What happens?\n\nMuch."""\n', "scenarios/question.py")
    write("", "scenarios/_helper.py")
    for name in ("folder", "shared"):
        Path("scenarios", name).mkdir()
        write('"""Which one?"""\n', f"scenarios/{name}/__init__.py")
    write("", "scenarios/folder/__main__.py")
    write("def broken(:", "scenarios/broken.py")
    write(INLINE, "scenarios/file.toml")
    write('title = "many"\n[scenario]\nuntil = 5\n[[axes]]\nkey = "seed"\n', "study.toml")
    write("[project]\nname = 'other'\n", "pyproject.toml")
    write("until = ", "broken.toml")
    found = [(entry["name"], entry["meaning"]) for entry in listed("scenarios")["scenarios"]]
    assert found == [
        ("scenarios.folder", "Which one?"),
        ("scenarios.question", "What happens?"),
        ("scenarios/file.toml", "five agents, two resources"),
        ("study.toml", "many"),
    ]
    assert ["study.toml", "many"] in words(said("list", "scenarios"))


def test_where_there_is_nothing_it_says_so() -> None:
    assert said("list", "scenarios").endswith("there are none in this folder or on the Python path.\n")


def test_an_unknown_topic_is_refused() -> None:
    assert refusal("list", "latencies").startswith("Invalid value for '[TOPIC]'")
