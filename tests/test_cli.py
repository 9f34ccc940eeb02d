"""The command as a whole: help, progress, exit codes, and how it is in a process of its own."""

import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import click
import pytest

from aimd_des import InputError, Study, __version__, run_study
from aimd_des.cli import main
from aimd_des.scenario import load_scenario
from aimd_des.utils.progress import RunProgress
from tests.command_line import digest, invoke, run, runner, words, write
from tests.conftest import INLINE, ROOT, python, quietly
from tests.forks import PROGRAM, forks

pytestmark = pytest.mark.usefixtures("own_folder")


# -- help and progress -----------------------------------------------------------------------------------


@pytest.mark.parametrize("option", ["-h", "--help"])
def test_help_teaches(option: str) -> None:
    general, command = invoke(option), invoke("run", option)
    assert (general.exit_code, command.exit_code) == (0, 0)
    for word in ("Usage:", "Examples:", "aimd-des run scenarios/paper.toml --seed 0", "exit code 2"):
        assert word in general.stdout, word
    for word in (
        "SCENARIO",
        "--seed",
        "--out",
        "--overwrite",
        "--no-figures",
        "summary.csv",
        "run.json",
        "digest",
    ):
        assert word in command.stdout, word


def test_the_version_is_that_of_the_package() -> None:
    assert invoke("--version").stdout == f"aimd-des, version {__version__}\n"


def test_an_unknown_command_is_refused() -> None:
    outcome = invoke("rum")
    assert outcome.exit_code == 2
    assert "No such command 'rum'" in outcome.stderr


@pytest.mark.parametrize("patience", [-1.0, 1e6])
def test_progress_is_shown_where_a_run_takes_its_time(
    patience: float, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("aimd_des.utils.progress._PATIENCE", patience)
    monkeypatch.setenv("COLUMNS", "120")
    clock = iter([0.0, 40.0, 50.0])  # 40 s of compiling, and 10 s of running
    monkeypatch.setattr("aimd_des.utils.progress.time", SimpleNamespace(monotonic=lambda: next(clock)))
    with RunProgress(8000.0) as progress:
        progress.update(500.0, 10_000)
        progress.update(2000.0, 100_000)
    shown = capsys.readouterr()
    assert shown.out == ""
    if patience < 0:
        assert re.search(r"simulated time 2,000 of 8,000 .* 150 a second", shown.err)
    else:
        assert shown.err == ""


def test_runs_and_studies_in_python_show_progress_where_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    scenario, heard, told = load_scenario(write()), list[float](), list[float]()
    monkeypatch.setattr(RunProgress, "update", lambda _bar, time, _events: told.append(time))
    system = scenario.simulation()
    silent = quietly(system.run, 60.0)
    assert told == []
    shown = quietly(system.run, 60.0, lambda time, _: heard.append(time), progress=True)
    assert shown.digest == silent.digest == quietly(scenario.run, progress=True).digest
    assert heard == [60.0]
    assert told == [60.0, 60.0]
    data = {key: value for key, value in scenario.spoken().items() if key not in ("seed", "recording")}
    study = Study(scenario={**data, "agents": "process"}, replications=2)
    assert len(run_study(study, "many", ThreadPoolExecutor(1), 1, progress=True).runs) == 4
    assert "2 of 2 runs" in capsys.readouterr().err
    with pytest.raises(InputError, match="progress = 'yes': must be True or False"):
        system.run(60.0, progress="yes")  # type: ignore[arg-type]


def test_what_a_terminal_cannot_show_is_written_as_a_number() -> None:
    write(INLINE.replace("five agents, two resources", "Zürich → Genève"))
    assert run("five.toml", "--out", "out").exit_code == 0
    outcome = runner(charset="ascii").invoke(main, ["show", "out"])
    assert outcome.exit_code == 0
    assert ["title", "|", "Z\\xfcrich", "\\u2192", "Gen\\xe8ve"] in words(outcome.stdout)


# -- its page --------------------------------------------------------------------------------------------

COMMANDS = {name: main.get_command(None, name) for name in main.list_commands(None)}  # type: ignore[arg-type]
OPTION = re.compile(r"(?<![\w|-])--[a-z][\w-]*")
PAGE = (ROOT / "docs" / "command_line.md").read_text(encoding="utf-8")


def options(command: click.Command) -> set[str]:
    return {
        word
        for parameter in command.params
        if isinstance(parameter, click.Option)
        for word in [*parameter.opts, *parameter.secondary_opts]
    }


@pytest.mark.parametrize("name", COMMANDS)
def test_the_page_shows_every_command_with_all_its_options(name: str) -> None:
    command = COMMANDS[name]
    assert command is not None
    (section,) = (part for part in PAGE.split("\n## ") if part.startswith(f"`{name}`"))
    assert f"```console\n$ aimd-des {name}" in section
    assert options(command) - set(OPTION.findall(section)) == set()


def test_the_page_shows_no_option_that_is_gone() -> None:
    known = {word for command in COMMANDS.values() if command is not None for word in options(command)}
    assert set(OPTION.findall(PAGE)) - known - {"--help", "--version"} == set()


@pytest.mark.parametrize("name", COMMANDS)
def test_help_fits_the_terminal(name: str) -> None:
    outcome = invoke(name, "--help")
    assert outcome.exit_code == 0
    assert max(map(len, outcome.stdout.splitlines())) <= 80


# -- in a process of its own -----------------------------------------------------------------------------


def test_help_and_completion_start_without_what_is_slow_to_import() -> None:
    program = (
        "import sys, click.testing, aimd_des.cli as cli\n"
        "for arguments in [[], *([name] for name in cli.main.list_commands(None))]:\n"
        "    outcome = click.testing.CliRunner().invoke(cli.main, [*arguments, '--help'])\n"
        "    assert outcome.exit_code == 0\n"
        "words = {'_AIMD_DES_COMPLETE': 'zsh_complete', 'COMP_WORDS': 'aimd-des ', 'COMP_CWORD': '1'}\n"
        "click.testing.CliRunner().invoke(cli.main, [], prog_name='aimd-des', env=words)\n"
        "heavy = {'numpy', 'scipy', 'numba', 'pandas', 'matplotlib', 'pyarrow', 'simpy', 'networkx'}\n"
        "heavy |= {'pydantic', 'rich'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
    )
    outcome = python("-c", program)
    assert outcome.returncode == 0, outcome.stderr
    assert outcome.stdout == "[]\n"


def test_the_check_above_finds_what_is_imported() -> None:
    outcome = python("-c", "import sys, aimd_des.problem; print('numpy' in sys.modules)")
    assert outcome.stdout == "True\n"


def test_the_command_in_a_process_of_its_own() -> None:
    path = str(write())
    here = quietly(load_scenario(Path(path)).run).digest  # and then nothing is left to compile
    arguments = ("run", path, "--no-figures", "--out", "out")
    done = python("-m", "aimd_des", *arguments)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert done.stdout.splitlines()[-1] == "Results in out"
    assert digest("out") == here
    again = forks().run(PROGRAM, *arguments)
    assert again.returncode == 2
    assert again.stdout == ""
    assert (
        again.stderr
        == "Error: output folder = 'out': must be new or empty; choose another, or say --overwrite\n"
    )


@pytest.mark.parametrize(("arguments", "searched"), [("show --help", False), ("sweep --help", True)])
def test_only_commands_that_run_systems_have_their_garbage_collected(arguments: str, searched: bool) -> None:
    program = (
        "import gc\n"
        "from aimd_des.__main__ import main\n"
        "try:\n"
        "    main()\n"
        "finally:\n"
        "    print(gc.isenabled())\n"
    )
    outcome = python("-c", program, *arguments.split())
    assert outcome.returncode == 0, outcome.stderr
    assert outcome.stdout.splitlines()[-1] == str(searched)


def test_a_reader_who_has_seen_enough_is_no_reason_to_complain() -> None:
    command = [sys.executable, "-m", "aimd_des", "completion", "zsh"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.stderr is not None
        assert process.stderr.read() == b""


def test_a_program_without_a_command_says_how_it_is_used() -> None:
    outcome = python("-m", "aimd_des")
    assert outcome.returncode in (0, 2)  # as Click decides
    assert "Usage: aimd-des [OPTIONS] COMMAND" in outcome.stdout + outcome.stderr
    assert sys.executable not in outcome.stderr
