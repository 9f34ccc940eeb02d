"""`aimd-des validate` and `schema`: files that would run, and what they may say."""

import json
import time
from pathlib import Path

import pytest

from aimd_des.cli.schema import schema_of
from tests.command_line import everything, invoke, refusal, said, write
from tests.conftest import INLINE

pytestmark = pytest.mark.usefixtures("own_folder")

STUDY = """\
base = "five.toml"
replications = 3

[[axes]]
key = "channel.loss"
values = [0.0, 0.1]

[[axes]]
key = "channel.latency"
values = [0.0, 0.5]
"""


def test_files_that_would_run_are_described() -> None:
    write()
    write(STUDY, "study.toml")
    write('until = 1e3\ndynamics = "continuous"\nmodel = "models.smart_cameras"\n', "cameras.toml")
    before = everything()
    assert said("validate", "five.toml", "study.toml", "cameras.toml").splitlines() == [
        "five.toml: ok: 5 agents, 2 resources, discrete, until 60",
        "study.toml: ok: a study of 4 points, 3 replications each: 12 runs",
        "cameras.toml: ok: 60 agents, 3 resources, continuous, until 1000",
    ]
    assert everything() == before


def test_one_is_one() -> None:
    write()
    write('base = "five.toml"\naxes = []\n', "study.toml")
    assert said("validate", "study.toml") == "study.toml: ok: a study of 1 point, 1 replication each: 1 run\n"


def test_the_other_files_are_checked_where_one_is_wrong() -> None:
    write()
    write(INLINE.replace("until", "untill"), "wrong.toml")
    outcome = invoke("validate", "wrong.toml", "five.toml", "nowhere.toml")
    assert outcome.exit_code == 2
    assert outcome.stdout == "five.toml: ok: 5 agents, 2 resources, discrete, until 60\n"
    assert outcome.stderr.splitlines() == [
        "wrong.toml: until: is missing",
        "wrong.toml:2: untill: unknown key 'untill'; did you mean 'until'?",
        "nowhere.toml: there is no such file",
    ]


SYNCHRONOUS = INLINE.replace("seed = 4", 'dynamics = "synchronous"')
OF_BASE = STUDY.replace("five.toml", "base.toml")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            INLINE.replace("[[1.0], [2.0]]", "[[-1.0], [2.0]]"),
            ": derivative of the cost of agent 0 by resource 0",
        ),
        (INLINE.replace('"disk"', '"memory"'), ": names of the resources = ['memory', 'memory']: must be"),
        ('until = 5\nmodel = "nowhere"\n', ": model = 'nowhere': must be a module"),
        ("", ": until: is missing"),
        ("until = [", ": is not valid TOML"),
        # What a run would find out only when it begins.
        (INLINE + "[channel]\nlatency = [1.0, 2.0]\n", ": shape of latency = (2,): must be (5,)"),
        (INLINE + "[channel]\nduplication = [0.1, 0.2]\n", ": shape of duplication = (2,): must be (5,)"),
        (INLINE + "[clocks]\nperiod = [1.0, 2.0]\n", ": shape of period = (2,): must be (5,)"),
        (INLINE.replace("tail = 5", "demand = [1.0, 99.0]"), ": demand = 99.0: must be times of at most 60"),
        (
            INLINE + '[[interventions]]\nkind = "failover"\nat = 60.0\nduration = 1.0\n' * 2,
            (
                ": interventions[0], interventions[1] = [Failover(at=60.0, duration=1.0), Failover(at=60.0, "
                "duration=1.0)]: must be such that they begin before 60, the end of the run; leave"
            ),
        ),
        (
            SYNCHRONOUS.replace("until = 60", "until = 60.5"),
            ": until = 60.5: must be a whole number of steps",
        ),
        (SYNCHRONOUS.replace("tail = 5", "events = true"), ": recording.events = True: must be false"),
        (SYNCHRONOUS.replace("tail = 5", "demand = 1.5"), ": demand = 1.5: must be whole numbers"),
        ("[scenario]\n", ": scenario: until: is missing"),
        (STUDY.replace("five.toml", "nowhere.toml"), ": nowhere.toml: there is no such file"),
        (OF_BASE.replace("replications = 3", "replications = 0"), ": replications = 0: must be an integer"),
        (
            OF_BASE.replace("channel.loss", "channel.los"),
            ": at channel.los = 0.0, channel.latency = 0.0: channel.",
        ),
        (
            OF_BASE.replace("[0.0, 0.1]", "[0.0, 1.1]"),
            ": at channel.loss = 1.1, channel.latency = 0.0: channel",
        ),
        (
            OF_BASE + "[scenario.clocks]\nperiod = [1.0, 2.0]\n",
            ": at channel.loss = 0.0, channel.latency = 0.0 (replication 0): shape of period = (2,)",
        ),
    ],
)
def test_what_would_not_run_is_told(text: str, sentence: str) -> None:
    write(name="base.toml")
    write(text)
    outcome = invoke("validate", "five.toml")
    assert (outcome.exit_code, outcome.stdout) == (2, "")
    assert outcome.stderr.startswith(f"five.toml{sentence}")
    assert "Traceback" not in outcome.output


def test_no_file_is_refused() -> None:
    assert refusal("validate") == "Missing argument 'FILE...'."


@pytest.mark.parametrize("kind", ["scenario", "study"])
def test_schemas_are_printed_and_written(kind: str) -> None:
    printed = said("schema", kind)
    assert json.loads(printed) == schema_of(kind)
    assert said("schema", kind, "--out", "schema.json") == ""
    assert Path("schema.json").read_text(encoding="utf-8") == printed
    assert everything() == {"schema.json"}


def test_the_schema_is_that_of_scenarios_unless_told() -> None:
    assert json.loads(said("schema")) == schema_of("scenario")


def test_a_schema_that_cannot_be_written_is_refused() -> None:
    assert refusal("schema", "--out", "no/such/folder.json") == (
        "no/such/folder.json: cannot be written (No such file or directory)"
    )
    assert refusal("schema", "--out", "").startswith(".: cannot be written")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "until = 5\n" + ".".join(["a"] * 100_000) + " = 1\n",
            "own.toml:2: a key must have at most 64 parts",
        ),
        ("x = { " + ".".join(['"a"'] * 1000) + " = 1 }\n", "own.toml:1: a key must have at most 64 parts"),
        (f"[{' . '.join(['a'] * 1000)}]\n", "own.toml:1: a key must have at most 64 parts"),
        (f"until = {'[' * 100}{']' * 100}\n", "own.toml: is nested deeper than 64 tables and lists"),
        (f"title = '{'a' * 1000}'\nuntil = 5\n", "must be at most 500 letters long"),
        ('title = "one\\ntwo"\nuntil = 5\n', "must be on one line and without control characters"),
    ],
)
def test_files_have_limits(text: str, sentence: str) -> None:
    write(text, "own.toml")
    began = time.monotonic()
    outcome = invoke("validate", "own.toml")
    assert time.monotonic() - began < 5.0  # a key of 100,000 parts took minutes
    assert outcome.exit_code == 2
    assert sentence in outcome.stderr


def test_a_file_of_nothing_but_letters_is_read_in_no_time(monkeypatch: pytest.MonkeyPatch) -> None:
    letters = "a" * 10**6 + " a." * 63 + ' "' * 10**6
    write(f"until = 5\n# {letters}\n", "own.toml")
    began = time.monotonic()
    assert "the problem = []: must be" in invoke("validate", "own.toml").stderr
    assert time.monotonic() - began < 5.0
    monkeypatch.setattr("aimd_des.scenario.file._LARGEST", 1000)
    assert "own.toml: must be at most 1,000 letters long" in invoke("validate", "own.toml").stderr


def test_steps_without_room_are_refused() -> None:
    write(INLINE.replace("until = 60", 'until = 1e15\ndynamics = "synchronous"'), "own.toml")
    outcome = invoke("validate", "own.toml")
    assert outcome.exit_code == 2
    room = "a byte for each step and resource would take 2e+06 GB"
    assert outcome.stderr.startswith(f"own.toml: until = 1000000000000000: must be less: {room}")
