"""Whatever is typed: no traceback, and one of three exit codes."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from aimd_des.cli import main
from tests.command_line import invoke, write
from tests.conftest import INLINE

COMMANDS = tuple(main.list_commands(None))  # type: ignore[arg-type]
FILES = (
    "five.toml",
    "study.toml",
    "broken.toml",
    "binary.toml",
    "empty.toml",
    "folder",
    "done",
    "nowhere.toml",
)
OPTIONS = (
    *("--seed", "--agents", "--set", "--out", "--overwrite", "--no-figures", "--help", "--json"),
    *("--measure", "--by", "--version", "--", "-", "-x"),
)
VALUES = (
    *("3", "-1", "1e400", "9" * 30, "process", "fleet", "bash", "models", "latency", "signals", "scenario"),
    *("channel.loss=0.1", "channel.loss=2", "until=5", "until=", "=5", "a.b.c=1", "resources.9.capacity=1"),
    *("resources.0.capacity=nan", "until=[", "seed=1e3", "costs=1", "path=x", "self=1", "channel=[1]"),
)

# What a shell can pass: bytes that are no UTF-8, but no character 0; and no slash, so that nothing outside
# of the folder is touched.
CHARACTERS = st.characters(
    exclude_categories=["Cs"], include_characters="\udc80\udcff", exclude_characters="\0/"
)
ANYTHING = st.text(CHARACTERS, max_size=300)
WORDS = st.one_of(st.sampled_from(FILES), st.sampled_from(OPTIONS), st.sampled_from(VALUES), ANYTHING)


@pytest.fixture(scope="module", autouse=True)
def _a_folder(tmp_path_factory: pytest.TempPathFactory) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("fuzz"))
        write(INLINE.replace("until = 60", "until = 5"))
        write('replications = 2\n[scenario]\nuntil = 5\n[[axes]]\nkey = "a"\nvalues = [1]\n', "study.toml")
        write("until = [", "broken.toml")
        write("", "empty.toml")
        Path("binary.toml").write_bytes(bytes(range(256)))
        Path("folder").mkdir()
        assert invoke("run", "five.toml", "--no-figures", "--out", "done").exit_code == 0
        yield


@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(st.one_of(st.sampled_from(COMMANDS), ANYTHING), st.lists(WORDS, max_size=6))
@example("run", ["x" * 300])
@example("run", ["five.toml", "--no-figures", "--out", "x" * 300])
@example("run", ["five.toml", "--no-figures", "--set", "path=1"])
@example("show", ["\udcff"])
def test_no_command_line_ends_in_a_traceback(command: str, words: list[str]) -> None:
    outcome = invoke(command, *(["--no-figures"] if command == "run" else []), *words)
    assert outcome.exception is None or isinstance(outcome.exception, SystemExit), outcome.exception
    assert outcome.exit_code in {0, 1, 2}
    assert "Traceback" not in outcome.output
