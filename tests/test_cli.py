"""The command: one sentence and exit code 2 for every mistake, and a folder for every run."""

import errno
import json
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from click.testing import CliRunner, Result

from aimd_des import __version__
from aimd_des.cli import main
from aimd_des.errors import SimulationError
from aimd_des.progress import RunProgress, show_summary
from aimd_des.scenario import Scenario, load_scenario
from tests.conftest import INLINE, ROOT, python, quietly

TABLES = {
    "run.json",
    "scenario.toml",
    "summary.csv",
    "signals.parquet",
    "demand.parquet",
    "allocations.parquet",
}


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(ROOT))  # models are found beside the package; and the path is put back


def write(text: str = INLINE) -> Path:
    path = Path("five.toml")
    path.write_text(text, encoding="utf-8")
    return path


def invoke(*arguments: str) -> Result:
    return quietly(CliRunner().invoke, main, arguments)


def run(*arguments: str) -> Result:
    return invoke("run", *arguments, "--no-figures")


def everything() -> set[str]:
    """All files and folders below the working directory, hidden ones too."""
    return {str(path) for path in Path().rglob("*")}


def refusal(*arguments: str) -> str:
    """The one sentence with which the command refuses; it must leave everything as it was."""
    before = everything()
    outcome = run(*arguments)
    assert isinstance(outcome.exception, SystemExit), outcome.exception
    assert outcome.exit_code == 2
    assert "Traceback" not in outcome.output
    assert everything() == before
    # Click says before its own errors how the command is used.
    lines = [line for line in outcome.stderr.splitlines() if line and not line.startswith(("Usage:", "Try "))]
    assert len(lines) == 1, lines
    assert lines[0].startswith("Error: ")
    return lines[0].removeprefix("Error: ")


# -- what goes well --------------------------------------------------------------------------------------


def test_a_run_writes_everything_and_says_where() -> None:
    outcome = run(str(write()), "--out", "out")
    assert outcome.exit_code == 0, outcome.output
    assert {path.name for path in Path("out").iterdir()} == TABLES
    assert everything() == {"five.toml", "out", *(f"out/{name}" for name in TABLES)}
    assert outcome.stdout.splitlines()[-1] == "Results in out"
    for word in ("memory", "disk", "signals", "utilisation", "relative error", "cost ratio"):
        assert word in outcome.stdout, word
    provenance = json.loads(Path("out/run.json").read_text(encoding="utf-8"))
    expected = quietly(load_scenario(Path("five.toml")).run)
    assert (provenance["digest"], provenance["seed"]) == (expected.digest, 4)
    assert len(pd.read_parquet("out/signals.parquet")) == len(expected.signals) > 10


def test_figures_are_drawn_unless_they_are_not_wanted() -> None:
    outcome = invoke("run", str(write()), "--out", "out")
    assert outcome.exit_code == 0, outcome.output
    figures = {path for path in Path("out").iterdir() if path.suffix == ".png"}
    assert figures
    assert {path.name for path in Path("out").iterdir()} - {path.name for path in figures} == TABLES
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in figures)


def digest(folder: str) -> str:
    return str(json.loads(Path(folder, "run.json").read_text(encoding="utf-8"))["digest"])


def test_the_same_run_twice_is_the_same() -> None:
    path = str(write())
    assert run(path, "--out", "out").exit_code == 0
    first, files = digest("out"), {name: Path("out", name).read_bytes() for name in TABLES}
    assert run(path, "--out", "out", "--overwrite").exit_code == 0
    assert digest("out") == first
    assert {name: Path("out", name).read_bytes() for name in TABLES} == files


def test_what_was_written_runs_again_to_the_same() -> None:
    assert run(str(write()), "--out", "out", "--seed", "9").exit_code == 0
    assert run("out/scenario.toml", "--out", "again").exit_code == 0
    assert digest("again") == digest("out")


def test_a_seed_replaces_that_of_the_file() -> None:
    path = str(write())
    for seed in ("4", "5"):
        assert run(path, "--seed", seed, "--out", seed).exit_code == 0
    assert run(path, "--out", "file").exit_code == 0
    assert digest("4") == digest("file") != digest("5")
    assert load_scenario(Path("5/scenario.toml")).seed == 5


def test_agents_as_a_fleet_give_the_same_digest() -> None:
    path = str(write())
    assert run(path, "--out", "file").exit_code == 0
    assert run(path, "--agents", "fleet", "--out", "fleet").exit_code == 0
    assert digest("fleet") == digest("file")
    assert load_scenario(Path("fleet/scenario.toml")).agents == "fleet"


def test_other_words_for_agents_are_refused() -> None:
    found = refusal(str(write()), "--out", "out", "--agents", "fleets")
    assert found == "Invalid value for '--agents': 'fleets' is not one of 'process', 'fleet'."


def test_results_go_by_default_into_a_folder_with_the_name_of_the_file() -> None:
    outcome = run(str(write()))
    assert outcome.exit_code == 0
    assert {path.name for path in Path("results/five").iterdir()} == TABLES


def test_folders_above_are_made() -> None:
    assert run(str(write()), "--out", "a/b/c").exit_code == 0
    assert {path.name for path in Path("a/b/c").iterdir()} == TABLES


def test_an_empty_folder_is_filled() -> None:
    Path("out").mkdir()
    assert run(str(write()), "--out", "out").exit_code == 0


def test_the_synchronous_algorithm_and_a_registered_model_run_too() -> None:
    text = (
        'until = 300\ndynamics = "synchronous"\nmodel = "models.smart_cameras"\n[parameters]\nn_cameras = 4\n'
    )
    outcome = run(str(write(text)), "--out", "out")
    assert outcome.exit_code == 0, outcome.output
    assert load_scenario(Path("out/scenario.toml")).parameters["n_cameras"] == 4


def test_a_run_in_which_nobody_holds_anything_is_summed_up() -> None:
    outcome = run(str(write(INLINE + "\n[clocks]\nphase = 100.0\n")), "--out", "out")
    assert outcome.exit_code == 0, outcome.output
    assert "nan" in outcome.stdout


# -- what is refused -------------------------------------------------------------------------------------

NO_CONVEX = (
    # Agent 0 pays 9 x - x**2 for memory: increasing up to 4.5, concave everywhere.
    ("exponents = [2]", "exponents = [1, 2]"),
    ("[[1.0], [2.0]]", "[[9.0, -1.0], [0.0, 2.0]]"),
    ("[[3.0], [1.0]]", "[[0.0, 3.0], [0.0, 1.0]]"),
    ("[[2.0], [2.0]]", "[[0.0, 2.0], [0.0, 2.0]]"),
    ("[[4.0], [0.5]]", "[[0.0, 4.0], [0.0, 0.5]]"),
    ("[[1.5], [1.0]]", "[[0.0, 1.5], [0.0, 1.0]]"),
)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            [("capacity = 3.0", "capacity = -3.0")],
            "capacity of memory = -3.0: must be a finite number greater than 0",
        ),
        (
            [("decrease = 0.7", "decrease = 1")],
            "decrease of memory = 1.0: must be a finite number at least 0 and less",
        ),
        (
            [("increase = 0.05", "increase = 0")],
            "increase of memory = 0.0: must be a finite number greater than 0",
        ),
        (
            [("capacity = 3.0", "capacity = nan")],
            "capacity of memory = nan: must be a finite number greater than 0",
        ),
        ([("increase = 0.05", "increase = nan")], "increase of memory = nan: must be a finite number"),
        ([("decrease = 0.7", "decrease = nan")], "decrease of memory = nan: must be a finite number"),
        ([("normalization = 0.1", "normalization = nan")], None),
        ([("threshold = 0.95", "threshold = nan")], "threshold of disk = nan: must be a finite number"),
        ([("until = 60", "until = nan")], "until = nan: must be a finite number greater than 0"),
        ([("[[1.0], [2.0]]", "[[nan], [2.0]]")], "coefficients[0, 0, 0] = nan: must be a finite number"),
        ([("tail = 5", "demand = nan")], "demand = nan: must be a finite number"),
        ([("tail = 5", "tail = 5\n[channel]\nlatency = nan")], "= nan: must be a finite number"),
        ([("tail = 5", "tail = 5\n[channel]\nloss = nan")], "= nan: must be a finite number"),
        ([("tail = 5", "tail = 5\n[clocks]\nperiod = nan")], "period = nan: must be a finite number"),
        ([("tail = 5", "tail = 5\n[control_unit]\nphase = nan")], "phase = nan: must be a finite number"),
        ([("[[1.0], [2.0]]", "[[1.0]]")], "coefficients = "),
        ([("[[1.0], [2.0]]", "[[1.0, 2.0], [2.0, 1.0]]")], "coefficients = "),
        (
            [("[2]", "[2, 3]")],
            "shape of coefficients = (5, 2, 1): must be (n_agents, n_resources, 2); give one",
        ),
        (NO_CONVEX, "smallest eigenvalue of the Hessian of the cost of agent 0 at x = ["),
        (
            [("disk", "memory")],
            "names of the resources = ['memory', 'memory']: must be one or more, each different",
        ),
        ([("until = 60", 'until = "long"')], "until = 'long': must be a valid number"),
        ([("until", "untill")], None),
        ([("seed = 4", "seed = 4.5")], "seed = 4.5: must be a valid integer"),
        ([("seed = 4", "seed = -4")], "seed = -4: must be an integer of at least 0"),
        ([("seed = 4", "seed = ")], "is not valid TOML"),
    ],
)
def test_a_mistake_in_the_file_is_refused(changes: Any, sentence: str | None) -> None:
    text = INLINE
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    if sentence is None:  # two mistakes, two sentences
        outcome = run(str(write(text)), "--out", "out")
        assert outcome.exit_code == 2
        assert len(outcome.stderr.splitlines()) == 2
    else:
        found = refusal(str(write(text)), "--out", "out")
        assert found.startswith("five.toml")
        assert sentence in found


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ('model = "models.smart_camera"', "did you mean 'models.smart_cameras'?"),
        (
            'model = "nowhere"',
            "model = 'nowhere': must be a module on the Python path or in the working directory",
        ),
        ('model = "json"', "model = 'json': must be a module that registers a model"),
        ('model = "models.smart_cameras"\nparameters.n_camera = 5', "did you mean 'n_cameras'?"),
        (
            'model = "models.smart_cameras"\nparameters.n_cameras = 0',
            "n_cameras = 0: must be an integer of at least",
        ),
    ],
)
def test_an_unknown_model_or_parameter_is_refused(changes: str, sentence: str) -> None:
    found = refusal(str(write(f"until = 5\n{changes}\n")), "--out", "out")
    assert found.startswith("five.toml: ")
    assert sentence in found


@pytest.mark.parametrize(
    "text",
    ['until = 5\nmodel = "nowhere"\n', INLINE.replace('"disk"', '"memory"')],
    ids=["unknown model", "same name twice"],
)
def test_no_folder_is_made_for_a_run_that_is_refused(text: str) -> None:
    refusal(str(write(text)))


@pytest.mark.parametrize("seed", ["one", "1.5", "", "1e3", "nan"])
def test_a_seed_that_is_no_integer_is_refused(seed: str) -> None:
    found = refusal(str(write()), "--out", "out", "--seed", seed)
    assert found == f"Invalid value for '--seed': {seed!r} is not a valid integer."


def test_a_negative_seed_is_refused() -> None:
    assert "seed = -1: must be an integer of at least 0" in refusal(
        str(write()), "--out", "out", "--seed", "-1"
    )


@pytest.mark.parametrize("overwrite", [[], ["--overwrite"]])
def test_a_folder_of_somebody_else_is_refused(overwrite: list[str]) -> None:
    Path("out").mkdir()
    Path("out/thesis.tex").write_text("years", encoding="utf-8")
    found = refusal(str(write()), "--out", "out", *overwrite)
    expected = (
        "one that this program wrote; it has no run.json" if overwrite else "new or empty; choose another"
    )
    assert found.startswith(f"output folder = 'out': must be {expected}")
    assert Path("out/thesis.tex").read_text(encoding="utf-8") == "years"


def test_earlier_results_are_not_replaced_by_accident() -> None:
    path = str(write())
    assert run(path, "--out", "out").exit_code == 0
    before = Path("out/run.json").read_bytes()
    found = refusal(path, "--out", "out", "--seed", "5")
    assert found == "output folder = 'out': must be new or empty; choose another, or say --overwrite"
    assert Path("out/run.json").read_bytes() == before


def test_a_file_as_folder_is_refused() -> None:
    Path("out").write_text("mine", encoding="utf-8")
    for more in ([], ["--overwrite"]):
        found = refusal(str(write()), "--out", "out", *more)
        assert found == "output folder = 'out': must be a folder; it is a file; choose another name"
    assert Path("out").read_text(encoding="utf-8") == "mine"


def test_a_place_that_cannot_be_written_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    # Who runs tests as root may write everywhere: the system's refusal is made up.
    def refuse(*args: Any, **kwargs: Any) -> Any:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    path = str(write())
    with monkeypatch.context() as patch:
        patch.setattr(tempfile, "mkdtemp", refuse)
        assert refusal(path, "--out", "out") == "output folder 'out': cannot be written (Permission denied)"


def test_a_disk_that_is_full_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*args: Any, **kwargs: Any) -> Any:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(pd.DataFrame, "to_parquet", fail)
    assert refusal(str(write()), "--out", "out") == "out: cannot be written (No space left on device)"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["missing.toml"], "missing.toml: there is no such file"),
        (["folder"], "Invalid value for 'SCENARIO': File 'folder' is a directory."),
        ([], "Missing argument 'SCENARIO'."),
        (["five.toml", "--sed", "1"], "No such option"),
    ],
)
def test_what_is_no_scenario_is_refused(arguments: list[str], sentence: str) -> None:
    write()
    Path("folder").mkdir()
    assert refusal(*arguments).startswith(sentence.removesuffix("."))


def test_several_mistakes_are_told_at_once() -> None:
    text = INLINE.replace("until = 60", "untill = 60").replace("capacity = 3.0", "capacity = -3.0")
    outcome = run(str(write(text)), "--out", "out")
    assert outcome.exit_code == 2
    assert len(outcome.stderr.splitlines()) == 3
    assert "did you mean 'until'?" in outcome.stderr
    assert "capacity of memory = -3.0" in outcome.stderr


def test_a_run_that_cannot_go_on_ends_with_one_sentence_and_exit_code_1(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def stand_still(*args: Any, **kwargs: Any) -> Any:
        raise SimulationError("time 5.0, resource memory: time cannot advance; set refractory greater than 0")

    monkeypatch.setattr(Scenario, "run", stand_still)
    outcome = run(str(write()), "--out", "out")
    assert outcome.exit_code == 1
    assert (
        outcome.stderr
        == "Error: time 5.0, resource memory: time cannot advance; set refractory greater than 0\n"
    )
    assert everything() == {"five.toml"}


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
    monkeypatch.setattr("aimd_des.progress._PATIENCE", patience)
    monkeypatch.setenv("COLUMNS", "120")
    with RunProgress(8000.0) as progress:
        progress.update(2000.0, 100_000)
    shown = capsys.readouterr()
    assert shown.out == ""
    if patience < 0:
        assert re.search(r"simulated time 2,000 of 8,000 .* [\d,]+ events/s", shown.err)
    else:
        assert shown.err == ""


def test_the_summary_shows_whole_numbers_and_fractions(capsys: pytest.CaptureFixture[str]) -> None:
    frame = pd.DataFrame(
        {"signals": [12345, 1], "relative_error": [0.04321, float("nan")]},
        index=pd.Index(["memory", "disk"], name="resource"),
    )
    show_summary(frame)
    rows = [re.sub(r"[^\w.,]+", " ", line).strip() for line in capsys.readouterr().out.splitlines()]
    assert "measure memory disk" in rows
    assert "signals 12,345 1" in rows
    assert "relative error 0.0432 nan" in rows


# -- in a process of its own -----------------------------------------------------------------------------


def test_help_starts_without_what_is_slow_to_import() -> None:
    program = (
        "import sys, click.testing, aimd_des.cli as cli\n"
        "outcome = click.testing.CliRunner().invoke(cli.main, ['run', '--help'])\n"
        "assert outcome.exit_code == 0\n"
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
    arguments = ("-m", "aimd_des", "run", path, "--no-figures", "--out", "out")
    done = python(*arguments)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert done.stdout.splitlines()[-1] == "Results in out"
    assert digest("out") == quietly(load_scenario(Path(path)).run).digest
    again = python(*arguments)
    assert again.returncode == 2
    assert again.stdout == ""
    assert (
        again.stderr
        == "Error: output folder = 'out': must be new or empty; choose another, or say --overwrite\n"
    )


def test_a_program_without_a_command_says_how_it_is_used() -> None:
    outcome = python("-m", "aimd_des")
    assert outcome.returncode in (0, 2)  # as Click decides
    assert "Usage: aimd-des [OPTIONS] COMMAND" in outcome.stdout + outcome.stderr
    assert sys.executable not in outcome.stderr
