"""`aimd-des run`: one sentence and exit code 2 for every mistake, and a folder for every run."""

import errno
import json
import os
import tempfile
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from aimd_des.scenario import Scenario, load_scenario
from aimd_des.utils.errors import SimulationError
from tests.command_line import TABLES, digest, everything, invoke, refusal, run, write
from tests.conftest import INLINE, quietly

pytestmark = pytest.mark.usefixtures("own_folder")


def run_refusal(*arguments: str) -> str:
    return refusal("run", *arguments, "--no-figures")


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


def test_units_with_dollar_signs_are_drawn() -> None:
    # The file ends with the table of the second resource.
    text = INLINE.replace('"GB"', "'US$ (2020_$)'") + "unit = '$\\frac{1}{$'\n"
    outcome = invoke("run", str(write(text)), "--out", "out")
    assert outcome.exit_code == 0, outcome.output
    # A figure that is missing is told; a run that takes long on a busy machine shows how far it is.
    assert "is missing" not in outcome.stderr
    assert len(list(Path("out").glob("*.png"))) == 4


def test_a_figure_that_fails_is_a_warning_and_no_reason_to_lose_a_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(*args: Any) -> Any:
        raise ZeroDivisionError("no picture")

    monkeypatch.setattr("aimd_des.plots.paper.sum_of_averages", fail)
    sentence = r"^out/figure4.png: is missing \(ZeroDivisionError: no picture\); all numbers are written$"
    with pytest.warns(RuntimeWarning, match=sentence):
        outcome = invoke("run", str(write()), "--out", "out")
    assert outcome.exit_code == 0, outcome.output
    assert {path.name for path in Path("out").glob("*.png")} == {f"figure{k}.png" for k in (1, 2, 3)}
    assert {path.name for path in Path("out").iterdir()} >= TABLES


def test_figures_have_the_formats_that_are_asked_for() -> None:
    outcome = invoke("run", str(write()), "--out", "out", "--format", "pdf, svg")
    assert outcome.exit_code == 0, outcome.output
    names = {f"figure{k}.{form}" for k in (1, 2, 3, 4) for form in ("pdf", "svg")}
    assert {path.name for path in Path("out").iterdir()} == names | TABLES
    pdf = Path("out/figure1.pdf").read_bytes()
    assert pdf.startswith(b"%PDF")
    # Which publishers refuse.
    assert b"/Type3" not in pdf
    assert "<svg" in Path("out/figure1.svg").read_text(encoding="utf-8")
    found = refusal("run", "five.toml", "--format", "gif")
    assert found == "Invalid value for '--format': 'gif': must be some of pdf, svg, png, separated by commas"


@pytest.mark.parametrize("overwrite", [[], ["--overwrite"]])
def test_what_comes_to_the_folder_during_a_run_is_left_alone(
    overwrite: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, of_file = str(write()), Scenario.run

    def while_others_write(self: Scenario, *args: Any, **kwargs: Any) -> Any:
        Path("out").mkdir()
        # A run that has begun after this one, and ended before: --overwrite was not said about it.
        Path("out/run.json").write_text("mine", encoding="utf-8")
        return of_file(self, *args, **kwargs)

    monkeypatch.setattr(Scenario, "run", while_others_write)
    outcome = run(path, "--out", "out", *overwrite)
    assert outcome.exit_code == 2
    (sentence,) = [line for line in outcome.stderr.splitlines() if line.startswith("Error: ")]
    assert sentence.startswith("Error: output folder 'out': cannot be replaced any more (something has come")
    assert Path("out/run.json").read_text(encoding="utf-8") == "mine"
    beside = Path(sentence.split(" is in ")[1].strip("'"))
    assert {path.name for path in beside.iterdir()} == TABLES
    assert beside.parent == Path("out").parent


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
    found = run_refusal(str(write()), "--out", "out", "--agents", "fleets")
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
        found = run_refusal(str(write(text)), "--out", "out")
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
    found = run_refusal(str(write(f"until = 5\n{changes}\n")), "--out", "out")
    assert found.startswith("five.toml: ")
    assert sentence in found


@pytest.mark.parametrize(
    "text",
    ['until = 5\nmodel = "nowhere"\n', INLINE.replace('"disk"', '"memory"')],
    ids=["unknown model", "same name twice"],
)
def test_no_folder_is_made_for_a_run_that_is_refused(text: str) -> None:
    run_refusal(str(write(text)))


@pytest.mark.parametrize("seed", ["one", "1.5", "", "1e3", "nan"])
def test_a_seed_that_is_no_integer_is_refused(seed: str) -> None:
    found = run_refusal(str(write()), "--out", "out", "--seed", seed)
    assert found == f"Invalid value for '--seed': {seed!r} is not a valid integer."


def test_a_negative_seed_is_refused() -> None:
    assert "seed = -1: must be an integer of at least 0" in run_refusal(
        str(write()), "--out", "out", "--seed", "-1"
    )


@pytest.mark.parametrize("overwrite", [[], ["--overwrite"]])
def test_a_folder_of_somebody_else_is_refused(overwrite: list[str]) -> None:
    Path("out").mkdir()
    Path("out/thesis.tex").write_text("years", encoding="utf-8")
    found = run_refusal(str(write()), "--out", "out", *overwrite)
    expected = (
        "one that this program wrote; it has no run.json" if overwrite else "new or empty; choose another"
    )
    assert found.startswith(f"output folder = 'out': must be {expected}")
    assert Path("out/thesis.tex").read_text(encoding="utf-8") == "years"


def test_earlier_results_are_not_replaced_by_accident() -> None:
    path = str(write())
    assert run(path, "--out", "out").exit_code == 0
    before = Path("out/run.json").read_bytes()
    found = run_refusal(path, "--out", "out", "--seed", "5")
    assert found == "output folder = 'out': must be new or empty; choose another, or say --overwrite"
    assert Path("out/run.json").read_bytes() == before


def test_a_file_as_folder_is_refused() -> None:
    Path("out").write_text("mine", encoding="utf-8")
    for more in ([], ["--overwrite"]):
        found = run_refusal(str(write()), "--out", "out", *more)
        assert found == "output folder = 'out': must be a folder; it is a file; choose another name"
    assert Path("out").read_text(encoding="utf-8") == "mine"


def test_a_place_that_cannot_be_written_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    # Who runs tests as root may write everywhere: the system's refusal is made up.
    def refuse(*args: Any, **kwargs: Any) -> Any:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    path = str(write())
    with monkeypatch.context() as patch:
        patch.setattr(tempfile, "mkdtemp", refuse)
        assert (
            run_refusal(path, "--out", "out") == "output folder 'out': cannot be written (Permission denied)"
        )


def test_a_disk_that_is_full_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*args: Any, **kwargs: Any) -> Any:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(pd.DataFrame, "to_parquet", fail)
    assert run_refusal(str(write()), "--out", "out") == "out: cannot be written (No space left on device)"


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
    assert run_refusal(*arguments).startswith(sentence.removesuffix("."))


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
        raise SimulationError("time 5.0, resource memory: time cannot advance; set hold_off greater than 0")

    monkeypatch.setattr(Scenario, "run", stand_still)
    outcome = run(str(write()), "--out", "out")
    assert outcome.exit_code == 1
    assert (
        outcome.stderr
        == "Error: time 5.0, resource memory: time cannot advance; set hold_off greater than 0\n"
    )
    assert everything() == {"five.toml"}


# -- settings --------------------------------------------------------------------------------------------


def test_settings_replace_values_of_the_file() -> None:
    path = str(write())
    settings = ("until=30", "channel.latency=0.5", "resources.1.capacity = 2.5", "agents=fleet", "title=a b")
    outcome = run(path, "--out", "out", *(word for setting in settings for word in ("--set", setting)))
    assert outcome.exit_code == 0, outcome.output
    found = load_scenario(Path("out/scenario.toml"))
    assert (found.until, found.agents, found.title) == (30, "fleet", "a b")
    assert found.channel.latency == 0.5
    assert found.resources is not None
    assert [table.capacity for table in found.resources] == [3.0, 2.5]
    changed = INLINE.replace("until = 60", "until = 30").replace("capacity = 2.0", "capacity = 2.5")
    assert run(str(write(changed + "[channel]\nlatency = 0.5\n")), "--out", "file").exit_code == 0
    assert digest("file") == digest("out")


def test_the_last_setting_holds_and_an_option_goes_before() -> None:
    path = str(write())
    assert run(path, "--set", "seed=1", "--set", "seed=2", "--out", "out").exit_code == 0
    assert load_scenario(Path("out/scenario.toml")).seed == 2
    assert run(path, "--seed", "3", "--set", "seed=2", "--out", "other").exit_code == 0
    assert load_scenario(Path("other/scenario.toml")).seed == 3


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("until", "setting = 'until': must be key=value, such as channel.latency=0.5"),
        ("until=", "setting = 'until=': must be key=value"),
        ("until=[", "value of until = '[': must be a value of TOML"),
        ("channel.los=0.1", "five.toml: channel.los: unknown key 'los'; did you mean 'loss'?"),
        ("channel.loss=1.5", "five.toml: channel: loss = 1.5: must be"),
        ("resources.2.capacity=1", "resources.2.capacity: element of resources = '2': must be the number of"),
        ("until.x=1", "until.x: until = 60: must be a table"),
        ("path=1", "five.toml: path: unknown key 'path'"),
        ("self=1", "five.toml: self: unknown key 'self'"),
    ],
)
def test_a_setting_that_is_wrong_is_refused_by_its_key(setting: str, sentence: str) -> None:
    assert run_refusal(str(write()), "--out", "out", "--set", setting).startswith(sentence)
