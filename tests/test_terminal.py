"""What the command prints, and how it stops: no text steers a terminal, no Ctrl-C ends in a traceback."""

import ast
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest

from aimd_des.cli.printing import paged, say
from aimd_des.utils.terminal_text import fit
from tests.command_line import invoke, refusal, run, runner, said, write
from tests.conftest import INLINE, ROOT
from tests.forks import PROGRAM, forks, until

pytestmark = pytest.mark.usefixtures("own_folder")

STEERING = [
    "\x1b[2J",
    "\x1b]0;title\x07",
    "\x9b2J",
    "\x07",
    "\x7f",
    "\r",
    "\u202e",
    "\u2066",
    "\u200f",
    "\u2028",
    "\b",
]


# -- texts -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", STEERING)
def test_signs_that_steer_are_shown_as_escapes(sign: str) -> None:
    shown = fit(f"a{sign}b")
    assert shown.isprintable()
    assert shown.startswith("a\\")
    assert shown.endswith("b")
    assert shown.encode("ascii").decode("unicode_escape") == f"a{sign}b"


def test_letters_of_all_scripts_and_lines_stay() -> None:
    text = "Zürich → Genève\n\tذاكرة 内存 $x^2$ \\x1b"
    assert fit(text) == text


@pytest.mark.parametrize("sign", STEERING)
def test_a_folder_cannot_steer_the_terminal(sign: str) -> None:
    """Names are refused where they enter, but a folder may come from anywhere."""
    write()
    assert run("five.toml", "--out", "out").exit_code == 0
    stored = Path("out", "scenario.toml")
    quoted = json.dumps(f"a{sign}b").replace("\\u007f", "\x7f")
    text = re.sub(
        "^title = .*", lambda _: f"title = {quoted}", stored.read_text(encoding="utf-8"), flags=re.M
    )
    stored.write_text(text, encoding="utf-8")
    provenance = json.loads(Path("out", "run.json").read_text(encoding="utf-8"))
    provenance["digest"] = f"0{sign}0"
    provenance["versions"] = {f"py{sign}thon": f"3{sign}"}
    Path("out", "run.json").write_text(json.dumps(provenance), encoding="utf-8")
    out = invoke("show", "out").output
    assert [letter for letter in out if not letter.isprintable() and letter != "\n"] == []
    assert "a\\" in out or "is damaged" in out  # DEL is no TOML


def test_errors_cannot_steer_the_terminal() -> None:
    write("until = 5\n", "\x1b[2J.toml")
    for command in ("run", "watch", "validate", "sweep"):
        outcome = invoke(command, "\x1b[2J.toml")
        assert outcome.exit_code == 2
        assert "\\x1b[2J.toml" in outcome.stderr
        assert "\x1b" not in outcome.output


def test_brackets_of_a_name_are_no_markup() -> None:
    write(
        'base = "five.toml"\n[[axes]]\nname = "[bold]loss[/bold]"\nkey = "channel.loss"\nvalues = [0.0]\n',
        "s.toml",
    )
    write()
    out = said("sweep", "s.toml", "--dry-run")
    assert "[bold]loss[/bold]" in out


def test_all_printing_of_the_commands_goes_one_way() -> None:
    """`say` and the tables make texts fit; nothing else of the commands writes, or makes a text for rich."""
    for path in (ROOT / "aimd_des" / "cli").glob("*.py"):
        called = {
            ast.unparse(node.func)
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Call)
        }
        own = {"printing.py": {"click.echo"}, "terminal_tables.py": {"Text", "console.print"}}.get(
            path.name, set()
        )
        ways = {"click.echo", "click.secho", "print", "console.print", "Text", "sys.stdout.write"}
        assert called & ways == own, path


# -- which command ---------------------------------------------------------------------------------------


def test_the_command_to_use_is_told() -> None:
    write()
    write('base = "five.toml"\nreplications = 2\n', "study.toml")
    for command in ("run", "watch"):
        assert (
            refusal(command, "study.toml")
            == "study.toml: is the file of a study: say aimd-des sweep study.toml"
        )
    assert refusal("sweep", "five.toml") == "five.toml: is the file of a scenario: say aimd-des run five.toml"


# -- how it stops ----------------------------------------------------------------------------------------

COMMAND = [sys.executable, "-m", "aimd_des"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_what_stops_a_command_is_said_in_a_sentence(
    error: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("aimd_des.scenario.Scenario.run", stop)
    write()
    outcome = runner().invoke(sys.modules["aimd_des.cli"].main, ["run", "five.toml", "--out", "out"])
    code, sentence = {
        KeyboardInterrupt: (130, "Stopped.\n"),
        MemoryError: (1, "Error: five.toml: the memory of this machine is too small for it\n"),
    }[error]
    assert (outcome.exit_code, outcome.stderr) == (code, sentence)
    assert not Path("out").exists()


@pytest.mark.parametrize("times", [1, 2])
@pytest.mark.parametrize("module", ["click", "aimd_des.scenario", "numpy._core.getlimits", "numba"])
def test_ctrl_c_while_something_is_imported_ends_with_a_sentence(module: str, times: int) -> None:
    write()
    program = (
        "import os, signal, sys\n"
        "class Press:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == {module!r}:\n"
        f"            for _ in range({times}):\n"
        "                os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Press())\n"
        "sys.argv = ['aimd-des', 'run', 'five.toml', '--out', 'out']\n"
        "from aimd_des.__main__ import main\n"
        "main()\n"
    )
    outcome = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert (outcome.returncode, outcome.stderr) == (130, "Stopped.\n")
    assert not Path("out").exists()


def test_ctrl_c_during_a_run_leaves_nothing() -> None:
    write(INLINE.replace("until = 60", "until = 1e7"))
    command = [*COMMAND, "run", "five.toml", "--out", "out"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
        time.sleep(3.0)
        process.send_signal(signal.SIGINT)
        _, rest = process.communicate(timeout=60)
    assert process.returncode == 130
    assert rest.splitlines()[-1] == "Stopped."
    assert "Traceback" not in rest
    assert [str(path) for path in Path().iterdir()] == ["five.toml"]


def test_ctrl_c_twice_while_workers_start_ends_with_a_sentence() -> None:
    """A worker that was about to be started had missed its parent, and said so in a traceback."""
    write()
    Path("study.toml").write_text('base = "five.toml"\nreplications = 4\n', encoding="utf-8")
    arguments = ("sweep", "study.toml", "--out", "out", "--workers", "2")
    process = forks().start(PROGRAM, *arguments)
    until(Path("out/manifest.json").exists)
    time.sleep(0.3)  # the server of workers imports what runs need, which takes longer
    for _ in range(2):
        os.kill(process.pid, signal.SIGINT)
        time.sleep(0.05)
    done = process.wait()
    assert done.returncode == 130
    assert done.stderr.splitlines()[-1].startswith("Stopped.")
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
@pytest.mark.parametrize("arguments", [["--help"], ["show", "out"], ["list", "loss"]])
def test_an_output_that_is_full_is_told(arguments: list[str]) -> None:
    write()
    assert run("five.toml", "--out", "out").exit_code == 0
    outcome = forks().run(PROGRAM, *arguments, stdout=Path("/dev/full"))
    assert outcome.returncode == 1
    assert outcome.stderr == "Error: the output cannot be written (No space left on device)\n"


def test_a_warning_is_a_sentence() -> None:
    write(INLINE.replace("normalization = 0.1", "normalization = 9.0"))
    outcome = forks().run(PROGRAM, "run", "five.toml", "--no-figures")
    assert outcome.returncode == 0, outcome.stderr
    said = [line for line in outcome.stderr.splitlines() if "responses had" in line]
    assert len(said) == 1
    assert said[0].startswith("Warning: ")
    assert "RuntimeWarning" not in outcome.stderr
    assert "scenario.run" not in outcome.stderr


# -- help, and long tables -------------------------------------------------------------------------------


def test_no_help_text_of_a_command_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    out = invoke("--help").output
    listed = out.partition("Commands:")[2].partition("Examples:")[0]
    assert "..." not in listed
    assert all(len(line) <= 80 for line in listed.splitlines())
    assert all(line.endswith(".") for line in listed.splitlines() if line.strip())


@pytest.mark.parametrize(
    ("typed", "hint"),
    [("swep", "Did you mean 'sweep'?"), ("rnu", "Did you mean 'run'?"), ("xyz", "There are run,")],
)
def test_a_mistyped_command_is_refused_with_the_nearest(typed: str, hint: str) -> None:
    outcome = invoke(typed)
    assert outcome.exit_code == 2
    assert f"No such command {typed!r}. {hint}" in outcome.stderr


class _Screen(io.StringIO):
    """A terminal of which nothing but its text is looked at."""

    encoding = "utf-8"

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("lines", "is_paged"), [(3, False), (9, False), (10, True), (400, True)])
def test_a_terminal_gets_what_is_too_long_page_by_page(
    lines: int, is_paged: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages: list[str] = []
    screen = _Screen()
    monkeypatch.setattr(sys, "stdout", screen)
    monkeypatch.setattr(click, "echo_via_pager", pages.append)
    monkeypatch.setattr("shutil.get_terminal_size", lambda: os.terminal_size((80, 10)))
    with paged():
        say("\n".join("line" for _ in range(lines)))
    text = "line\n" * lines
    assert (pages, screen.getvalue()) == (([text], "") if is_paged else ([], text))


def test_what_was_printed_before_a_failure_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = _Screen()
    monkeypatch.setattr(sys, "stdout", screen)

    def fail() -> None:
        say("so far")
        raise ValueError("later")

    with pytest.raises(ValueError, match="later"), paged():
        fail()
    assert screen.getvalue() == "so far\n"


def test_files_and_pipes_are_not_paged(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(click, "echo_via_pager", None)
    with paged():
        say("\n" * 500)
    assert capsys.readouterr().out == "\n" * 501
