"""Settings by dotted keys: what they change, what they leave, and what is refused."""

import copy
import re
from typing import Any

import pytest

from aimd_des import InputError
from aimd_des.scenario.dotted_keys import parse_setting, split_key, with_settings

DATA: dict[str, Any] = {
    "until": 60,
    "channel": {"latency": {"kind": "exponential", "mean": 0.5}, "loss": 0.1},
    "resources": [{"name": "memory", "capacity": 3.0}, {"name": "disk", "capacity": 2.0}],
    "parameters": {"a.b": 1},
}


@pytest.mark.parametrize(
    ("key", "value", "path"),
    [
        ("until", 70, ["until"]),
        ("seed", 5, ["seed"]),
        ("channel.loss", 0.2, ["channel", "loss"]),
        ("channel.latency", 1.0, ["channel", "latency"]),
        ("channel.latency.mean", 1.0, ["channel", "latency", "mean"]),
        ("clocks.jitter", 0.5, ["clocks", "jitter"]),
        ("channel.network.kind", "star", ["channel", "network", "kind"]),
        ("resources.1.capacity", 4.0, ["resources", 1, "capacity"]),
        ("resources.0", {}, ["resources", 0]),
        ("resources.1.unit", "GB", ["resources", 1, "unit"]),
        ('parameters."a.b"', 2, ["parameters", "a.b"]),
        ("parameters.0", 2, ["parameters", "0"]),
        ("channel", 1.0, ["channel"]),
    ],
)
def test_one_place_is_set_and_nothing_else(key: str, value: object, path: list[str | int]) -> None:
    before = copy.deepcopy(DATA)
    changed = with_settings(DATA, {key: value})
    assert before == DATA
    expected: Any = copy.deepcopy(DATA)
    place = expected
    for part in path[:-1]:
        place = place.setdefault(part, {}) if isinstance(place, dict) else place[part]
    place[path[-1]] = value
    assert changed == expected


def test_settings_act_one_after_another() -> None:
    changed = with_settings(DATA, {"channel.latency": {"kind": "constant"}, "channel.latency.value": 2.0})
    assert changed["channel"]["latency"] == {"kind": "constant", "value": 2.0}
    assert with_settings(DATA, {}) == DATA


def test_a_value_that_is_given_is_not_changed_by_a_later_setting() -> None:
    given = {"kind": "constant"}
    with_settings(DATA, {"channel.latency": given, "channel.latency.value": 2.0})
    assert given == {"kind": "constant"}


@pytest.mark.parametrize(
    ("key", "sentence"),
    [
        ("until.x", "until.x: until = 60: must be a table, to have a key 'x'; set until itself"),
        ("channel.loss.kind", "channel.loss.kind: channel.loss = 0.1: must be a table, to have a key 'kind'"),
        (
            "resources.2.capacity",
            "resources.2.capacity: element of resources = '2': must be the number of one",
        ),
        (
            "resources.-1",
            "resources.-1: element of resources = '-1': must be the number of one of its 2, from",
        ),
        (
            "resources.disk.capacity",
            "resources.disk.capacity: element of resources = 'disk': must be the num",
        ),
        ("", "key = '': must be names of keys joined by dots"),
        ("a..b", "key = 'a..b': must be names of keys"),
        (".a", "key = '.a': must be names of keys"),
        ("a.", "key = 'a.': must be names of keys"),
        ("a b", "key = 'a b': must be names of keys"),
        ('"a', "key = '\"a': must be names of keys"),
    ],
)
def test_a_key_that_leads_nowhere_is_refused(key: str, sentence: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}"):
        with_settings(DATA, {key: 1})


def test_an_empty_list_has_no_element_to_set() -> None:
    with pytest.raises(InputError, match=r"^a\.0: element of a = '0': must be left out$"):
        with_settings({"a": []}, {"a.0": 1})


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("seed=3", "seed", 3),
        ("until = 1e3", "until", 1000.0),
        ("channel.latency=[0.5, 1]", "channel.latency", [0.5, 1]),
        ('channel.latency={kind = "constant"}', "channel.latency", {"kind": "constant"}),
        ("recording.events=true", "recording.events", True),
        ("agents=fleet", "agents", "fleet"),
        ("model=models.smart_cameras", "model", "models.smart_cameras"),
        ('title="a=b"', "title", "a=b"),
        ("title=my run", "title", "my run"),
        ("channel.latency.path=data/wifi.csv", "channel.latency.path", "data/wifi.csv"),
        ("channel.loss=0.1x", "channel.loss", "0.1x"),
    ],
)
def test_a_setting_is_read_as_toml_or_as_a_word(text: str, key: str, value: object) -> None:
    found = parse_setting(text)
    assert found == (key, value)
    assert type(found[1]) is type(value)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "seed",
        "seed=",
        "=3",
        "a b=3",
        'title="open',
        "list=[1, 2",
        "list=[1, 2]]",
        "a=1\nb = 2",
        "a=x\ny",
        f"a={'[' * 5000}",
        "table={a = 1",
    ],
)
def test_what_is_no_setting_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"^(setting|key|value of \w+) = "):
        parse_setting(text)


def test_a_part_in_quotes_keeps_its_dots() -> None:
    assert split_key("a.\"b.c\".'d.e'.0") == ("a", "b.c", "d.e", "0")


def test_keys_have_an_end() -> None:
    assert len(split_key(".".join(["a"] * 64))) == 64
    with pytest.raises(InputError, match=r"must be of at most 64 parts$"):
        with_settings(DATA, {".".join(["a"] * 100_000): 1})
