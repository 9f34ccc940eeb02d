"""Scenario files that are damaged at random: each is accepted, or refused in sentences that name a key.

Two thousand of them by default, and ten thousand with ``--hypothesis-profile explore``.
"""

import copy
import random
import re
import tomllib
from collections.abc import Callable, Iterator
from contextlib import suppress
from datetime import UTC, date, datetime, time
from pathlib import Path
from time import perf_counter
from typing import Any

import pytest
import tomli_w
from hypothesis import settings

from aimd_des import InputError
from aimd_des.scenario import Scenario, load_scenario
from aimd_des.scenario.kinds import our_kinds
from aimd_des.scenario.schema import scenario_schema
from tests.conftest import INLINE
from tests.scenario_examples import EXAMPLES, write_files

MANY = settings.get_profile("explore").max_examples <= settings().max_examples
BLOCK = 250
BLOCKS = range(20 if MANY else 4)

SECONDS = 5.0
LONGEST = 100_000

# What the writer of TOML would not write, or takes long to write: it is put into the text.
MARKS = {
    "<1e400>": "1e400",
    "<many digits>": "7" * 4000,
    "<too many digits>": "7" * 5000,
    "<hexadecimal>": f"0x{'f' * 6000}",
    "<huge list>": f"[{'0.1, ' * 2_000}]",
}


def nested(depth: int) -> list[Any]:
    value: list[Any] = []
    for _ in range(depth):
        value = [value]
    return value


WORDS = [kind.name for kind in our_kinds()]
VALUES: list[Callable[[random.Random], Any]] = [
    lambda r: r.choice([0, 1, -1, 2, 3, 7, 10**6, 10**12, 2**63 - 1, -(2**63), 2**63, 10**30, -(10**400)]),
    lambda r: r.choice([0.0, -0.0, 0.5, 1.0, 1.5, -2.5, 1e-320, 1e-9, 1e9, 1e300, 1.7976931348623157e308]),
    lambda r: r.choice([float("nan"), float("inf"), -float("inf"), True, False]),
    lambda r: r.choice([*MARKS]),
    lambda r: r.choice(["", "auto", "end", "random", "seed", "tree", "hub", "κάμερα", "\u202e☃", "\x00"]),
    lambda r: r.choice(["/dev/zero", "/dev/stdin", "/etc", ".", "no.csv", "a" * 5000, "day.csv", "\x00.csv"]),
    lambda r: r.choice(WORDS),
    lambda r: r.choice([[], [[]], {}, [{}], [0.5], [1, 2, 3, 4, 5], ["a", 1], [[1.0], [2.0]]]),
    lambda r: r.choice([date(2020, 1, 1), time(12, 30), datetime(2020, 1, 1, tzinfo=UTC)]),
    lambda r: [r.choice([0.1, 1, float("nan"), "x"])] * r.choice([5, 6, 300]),
    lambda r: nested(r.choice([2, 40, 150])),
    lambda r: {"kind": r.choice(WORDS), "x": {"y": nested(3)}},
    lambda r: [{"kind": r.choice(WORDS), "at": r.random()} for _ in range(r.choice([1, 3, 30]))],
    lambda r: {f"k{number}": number for number in range(r.choice([1, 100]))},
    lambda r: "<huge list>",
]


def names_in(schema: Any) -> Iterator[str]:
    """All keys that a schema knows."""
    if isinstance(schema, dict):
        yield from schema.get("properties", {})
        for part in schema.values():
            yield from names_in(part)
    elif isinstance(schema, list):
        for part in schema:
            yield from names_in(part)


KEYS = sorted(set(names_in(scenario_schema())))
NAMES = re.compile(r"\b(" + "|".join(KEYS) + r"|unknown key|the problem|kind|keys more)\b")


def places(data: Any) -> Iterator[tuple[Any, Any]]:
    """Every table and list, with every key or number in it."""
    keys = list(data) if isinstance(data, dict) else range(len(data))
    for key in keys:
        yield data, key
        if isinstance(data[key], dict | list):
            yield from places(data[key])


def misspelt(word: str, r: random.Random) -> str:
    place = r.randrange(len(word) + 1)
    return word[:place] + r.choice(["x", "é", "_", " ", '"', ".", "\n", ""]) + word[place + 1 :]


def change(data: dict[str, Any], r: random.Random) -> None:
    """Damage data at one place."""
    container, key = r.choice(list(places(data)) or [(data, None)])
    what = r.randrange(7)
    value = r.choice(VALUES)(r)
    if what == 0 and isinstance(container, dict):
        container[r.choice([*KEYS, "unknown", "__class__", "model_config", "of", "form", "build"])] = value
    elif what == 1 and isinstance(container, dict) and key in container:
        container[misspelt(key, r)] = container.pop(key)
    elif what == 2 and key is not None:
        del container[key]
    elif what == 3 and isinstance(container, list):
        container.insert(r.randrange(len(container) + 1), value)
    elif what == 4:
        other, taken = r.choice(list(places(copy.deepcopy(r.choice(DATA)))))
        container[key if key is not None else "until"] = other[taken]
    elif key is not None:
        container[key] = value


def damage(text: str, r: random.Random) -> str:
    """Damage a text at one place."""
    lines = text.splitlines(keepends=True)
    place = r.randrange(len(lines))
    what = r.randrange(6)
    if what == 0:
        return text[: r.randrange(len(text))]
    if what == 1:
        lines.insert(r.randrange(len(lines)), lines[place])
    elif what == 2:
        lines[place:place] = r.choice(TEXTS).splitlines(keepends=True)
    elif what == 3:
        del lines[place]
    elif what == 4:
        lines[place] = misspelt(lines[place], r)
    else:
        lines.insert(
            place, r.choice(["[", "[[channel]]\n", "[a.b.c]\n", "= 3\n", "\x00", "'''", "[" * 3000, "{" * 99])
        )
    return "".join(lines)  # fmt: skip


TEXTS = list(EXAMPLES.values())
DATA = list(map(tomllib.loads, TEXTS))


def mutated(r: random.Random) -> str:
    """One damaged file."""
    if r.random() < 0.75:
        data = copy.deepcopy(r.choice(DATA))
        for _ in range(r.choice([1, 1, 1, 2, 4])):
            change(data, r)
        text = tomli_w.dumps(data)
        for mark, number in MARKS.items():
            text = text.replace(f'"{mark}"', number)
    else:
        text = r.choice(TEXTS)
    if r.random() < 0.3:
        text = damage(text, r)
    return text[:LONGEST]


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(own_folder: None, tmp_path: Path) -> None:
    write_files(tmp_path)


#: What is said of a file as a whole, and so names no key.
OF_THE_FILE = ("is not valid TOML", "cannot be read", "is nested deeper than")


def judge(path: Path) -> Scenario | None:
    """Load a file; what is refused has to be refused in sentences that name a key."""
    try:
        return load_scenario(path)
    except InputError as refusal:
        for line in str(refusal).splitlines():
            whole = line.startswith(f"{path}: ") and any(words in line for words in OF_THE_FILE)
            assert whole or NAMES.search(line.removeprefix(str(path))), line
        return None


@pytest.mark.parametrize("block", BLOCKS)
def test_damaged_files_are_accepted_or_refused(block: int, tmp_path: Path) -> None:
    before = sorted(tmp_path.iterdir())
    path = Path("s.toml")
    accepted = 0
    for number in range(block * BLOCK, (block + 1) * BLOCK):
        text = mutated(random.Random(number))
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        begun = perf_counter()
        try:
            scenario = judge(path)
            if scenario is not None:
                written = scenario.to_toml()
                path.write_text(written, encoding="utf-8")
                assert load_scenario(path).to_toml() == written
                with suppress(InputError):  # a model that there is not
                    scenario.canonical()
                accepted += 1
        except Exception as failure:
            failure.add_note(f"mutation {number}:\n{text[:3000]}")
            raise
        assert perf_counter() - begun < SECONDS, f"mutation {number}:\n{text[:3000]}"
    path.unlink()
    assert sorted(tmp_path.iterdir()) == before
    # Damage that does nothing, and damage that leaves nothing, test nothing.
    assert BLOCK / 20 < accepted < BLOCK / 2


def test_what_is_not_damaged_is_accepted(tmp_path: Path) -> None:
    for text in TEXTS:
        Path("s.toml").write_text(text, encoding="utf-8")
        assert judge(Path("s.toml")) is not None


def test_a_refusal_that_names_no_key_would_be_found(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("s.toml").write_text(INLINE, encoding="utf-8")

    def refuse(*_: object, **__: object) -> None:
        raise InputError("s.toml: something is wrong")

    monkeypatch.setattr("aimd_des.scenario.file.validate_scenario", refuse)
    with pytest.raises(AssertionError, match="something is wrong"):
        judge(Path("s.toml"))
