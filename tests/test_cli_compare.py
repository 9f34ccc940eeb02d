"""`aimd-des compare`: where two runs differ."""

import pandas as pd
import pytest

from aimd_des.cli.scenario_diff import differences, flat
from aimd_des.results.measures import measure_words
from aimd_des.utils.formatting import measured
from tests.command_line import digest, refusal, run, said, words, write
from tests.conftest import INLINE

pytestmark = pytest.mark.usefixtures("own_folder")


def runs(first: str = INLINE, second: str = INLINE) -> None:
    for folder, text in (("one", first), ("two", second)):
        outcome = run(str(write(text)), "--out", folder)
        assert outcome.exit_code == 0, outcome.output


def test_equal_runs_are_equal() -> None:
    runs()
    out = said("compare", "one", "two")
    assert out.startswith("The digests are equal: the same events, to the last bit\n")
    assert "The scenarios and the versions are the same." in out
    assert ["first", "one"] in words(out)
    assert [digest("two")] in words(out)


def test_the_keys_that_differ_are_named_and_measures_are_side_by_side() -> None:
    runs(second=INLINE.replace("seed = 4", "seed = 5").replace("capacity = 2.0", "capacity = 2.5"))
    out = said("compare", "one", "two")
    rows = words(out)
    assert out.startswith("The digests are different\n")
    table = rows[rows.index(["key", "first", "second"]) + 2 :]
    assert table[: table.index([])] == [["seed", "4", "5"], ["resources.1.capacity", "2", "2.5"]]
    first, second = (pd.read_csv(f"{folder}/summary.csv", index_col="resource") for folder in ("one", "two"))
    for name in first:
        for resource in ("memory", "disk"):
            one, other = first[name].to_dict()[resource], second[name].to_dict()[resource]
            expected = [
                *measure_words(name).split(),
                resource,
                measured(one),
                measured(other),
                measured(other - one),
            ]
            assert expected in rows


def test_a_difference_that_is_not_shown_is_counted() -> None:
    runs(second=INLINE.replace("[[2.0], [2.0]]", "[[2.0], [2.5]]"))
    out = " ".join(said("compare", "one", "two").split())
    assert "costs.coefficients" in out
    runs_of = INLINE.replace("capacity = 3.0", "capacity = 3.0000000001")
    assert run(str(write(runs_of)), "--out", "three").exit_code == 0
    assert ["resources.0.capacity", "3.0", "3.0000000001"] in words(said("compare", "one", "three"))


def test_a_key_that_only_one_has_is_shown_with_a_dash() -> None:
    runs(second=INLINE + "[channel.latency]\nkind = 'constant'\nvalue = 0.5\n")
    rows = words(said("compare", "one", "two"))
    assert ["channel.latency", "0", "-"] in rows
    assert ["channel.latency.value", "-", "0.5"] in rows


def test_measures_are_chosen() -> None:
    runs()
    rows = words(said("compare", "one", "two", "--measure", "signals"))
    table = rows[rows.index(["measure", "resource", "first", "second", "difference"]) + 2 :]
    assert [row[:2] for row in table] == [["signals", "memory"], ["signals", "disk"]]
    assert "did you mean 'signals'?" in refusal("compare", "one", "two", "--measure", "signal")


def test_only_resources_that_both_have_are_compared() -> None:
    runs(second=INLINE.replace('"disk"', '"space"'))
    rows = words(said("compare", "one", "two", "--measure", "signals"))
    assert [row[:2] for row in rows if row[:1] == ["signals"]] == [["signals", "memory"]]


def test_runs_that_have_nothing_in_common_are_refused() -> None:
    runs(second=INLINE.replace('"disk"', '"space"').replace('"memory"', '"time"'))
    found = refusal("compare", "one", "two")
    assert found == "one and two: no resource is in both (they have memory, disk and time, space)"


def test_paths_name_every_value() -> None:
    table = {"a": 1, "b": {"c": [1, 2], "d": {}}, "e": [{"f": 2}, {"f": 3}], "g": []}
    assert flat(table) == {"a": 1, "b.c": [1, 2], "b.d": {}, "e.0.f": 2, "e.1.f": 3, "g": []}


def test_a_key_that_is_null_in_one_and_missing_in_the_other_differs() -> None:
    assert differences({"a": None, "b": 1}, {"b": 1}) == [["a", "None", "-"]]
    assert differences({}, {"a": {"b": None}}) == [["a.b", "-", "None"]]
    assert differences({"a": None}, {"a": None}) == []
    assert differences({"a": None}, {"a": "None"}) == [["a", "None", "'None'"]]
    assert flat({}) == {}
