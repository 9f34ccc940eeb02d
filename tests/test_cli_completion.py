"""Completion in shells: the scripts, and what they are answered."""

import shutil
import subprocess

import pytest

from aimd_des.cli import main
from tests.command_line import refusal, runner, said, write

pytestmark = pytest.mark.usefixtures("own_folder")


def completed(line: str) -> list[str]:
    """What a shell is told when the tabulator is pressed at the end of the line."""
    words = line.split(" ")
    environment = {
        "_AIMD_DES_COMPLETE": "zsh_complete",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(words) - 1),
    }
    outcome = runner().invoke(main, [], prog_name="aimd-des", env=environment)
    assert outcome.exit_code == 0, outcome.output
    lines = outcome.stdout.strip().splitlines()
    return [value for kind, value in zip(lines[::3], lines[1::3], strict=True) if kind == "plain"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_a_shell_calls_back(shell: str) -> None:
    out = said("completion", shell)
    assert f"_AIMD_DES_COMPLETE={shell}_complete" in out
    if shell != "fish" and shutil.which(shell):
        checked = subprocess.run([shell, "-n"], input=out, text=True, capture_output=True, check=False)
        assert (checked.returncode, checked.stderr) == (0, "")


def test_other_shells_are_refused() -> None:
    assert refusal("completion", "tcsh").startswith(
        "Invalid value for '{bash|zsh|fish}': 'tcsh' is not one of"
    )


def test_commands_and_options_are_completed() -> None:
    assert completed("aimd-des ru") == ["run"]
    assert set(main.list_commands(None)) == set(completed("aimd-des "))  # type: ignore[arg-type]
    assert {"--seed", "--set", "--out", "--help"} <= set(completed("aimd-des run --"))


def test_words_are_completed() -> None:
    assert completed("aimd-des run a.toml --agents f") == ["fleet"]
    assert completed("aimd-des list l") == ["latency", "loss"]
    assert completed("aimd-des completion z") == ["zsh"]


def test_keys_of_the_file_are_completed() -> None:
    write()
    keys = completed("aimd-des run five.toml --set resources.1.")
    assert {"resources.1.capacity=", "resources.1.increase="} <= set(keys)
    assert completed("aimd-des run five.toml --set resources.2.") == []
    assert completed("aimd-des run five.toml --seed 3 --set until=5 --set see") == ["seed="]
    assert {"channel.loss=", "channel.loss.mean_burst="} <= set(completed("aimd-des run --set channel.lo"))
    assert completed("aimd-des run nowhere.toml --set unt") == ["until="]


def test_parameters_of_the_model_are_completed() -> None:
    write('until = 5\nmodel = "models.smart_cameras"\n', "cameras.toml")
    assert completed("aimd-des run cameras.toml --set parameters.n") == [
        "parameters.n_cameras=",
        "parameters.normalization=",
    ]
    write('until = 5\nmodel = "nowhere"\n', "cameras.toml")
    assert completed("aimd-des run cameras.toml --set parameters.") == []


def test_keys_of_studies_are_completed() -> None:
    write('replications = 3\n[scenario]\nuntil = 5\nmodel = "models.smart_cameras"\n', "study.toml")
    assert completed("aimd-des sweep study.toml --set repl") == ["replications="]
    assert completed("aimd-des sweep study.toml --set scenario.parameters.n_") == [
        "scenario.parameters.n_cameras="
    ]
    assert "scenario.channel.latency=" in completed("aimd-des sweep study.toml --set scenario.channel.la")
