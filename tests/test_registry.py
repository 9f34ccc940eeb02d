"""Models by name: found by reading, imported only where one is registered, and all of them can be called."""

import sys
from pathlib import Path

import pytest

from aimd_des import InputError, Problem
from aimd_des.scenario.kinds import kinds
from aimd_des.scenario.models import made_by, named_model
from aimd_des.scenario.module_source import decorated, modules_in, source_of
from aimd_des.scenario.named import MODELS
from tests.command_line import invoke, refusal, said, write

pytestmark = pytest.mark.usefixtures("own_folder")

HEAD = "from aimd_des import PolynomialCosts, Problem, Resource, model\n"


def function(name: str, agents: int, before: str = "@model") -> str:
    """The source of a model."""
    return (
        f"\n{before}\n"
        f"def {name}() -> Problem:\n"
        f'    """A model with {agents}."""\n'
        "    memory = Resource('memory', 1.0, 0.1, 0.5, 0.1)\n"
        f"    return Problem([memory], PolynomialCosts([2], [[[1.0]]] * {agents}))\n"
    )


def module(name: str, *functions: str) -> None:
    path = Path(*name.split(".")).with_suffix(".py")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(HEAD + "".join(functions), encoding="utf-8")


def refused(name: str) -> str:
    with pytest.raises(InputError) as caught:
        named_model(name)
    return str(caught.value)


# -- several in one module -------------------------------------------------------------------------------


def test_both_models_of_a_module_can_be_called() -> None:
    module("two_of_them", function("small", 2), function("large", 9))
    assert made_by("two_of_them.small", {}).n_agents == 2
    assert made_by("two_of_them.large", {}).n_agents == 9
    one_of = "model = 'two_of_them': must be one of two_of_them.small, two_of_them.large"
    assert refused("two_of_them") == one_of
    assert refused("two_of_them.smal").endswith("; did you mean 'two_of_them.small'?")


def test_two_models_that_were_not_imported_yet_are_told_apart() -> None:
    module("two_unseen", function("small", 2), function("large", 9))
    assert refused("two_unseen").endswith("must be one of two_unseen.small, two_unseen.large")
    assert "two_unseen" not in sys.modules


def test_one_model_of_a_module_is_called_by_either_name() -> None:
    module("only_one", function("mine", 3))
    assert named_model("only_one") is named_model("only_one.mine")
    write('until = 5\nmodel = "only_one.mine"\n', "own.toml")
    assert said("validate", "own.toml") == "own.toml: ok: 3 agents, 1 resource, discrete, until 5\n"


def test_models_of_the_working_directory_are_listed() -> None:
    module("listed_pair", function("small", 2), function("large", 9))
    module("listed_package.__init__", function("inside", 4))
    module("listed_without", "\nprint('imported')\n")
    names = [kind.name for kind in kinds() if kind.group == "model"]
    assert [name for name in names if name.startswith("listed")] == [
        "listed_package", "listed_pair.small", "listed_pair.large"
    ]  # fmt: skip
    out = said("list", "models")
    assert "imported" not in out
    assert "listed_pair.large" in out
    assert "A model with 9." in out


# -- what is imported ------------------------------------------------------------------------------------

OTHERS = {
    "without": "raise SystemExit(0)\n",
    "another": "def model(f):\n    return f\n\n@model\ndef mine():\n    ...\n\nraise SystemExit(0)\n",
    "method": "import aimd_des\n\nclass A:\n    @aimd_des.model\n    def f(self):\n        ...\n\n1 / 0\n",
    "broken": "from aimd_des import model\n@model\ndef broken(:\n",
}


@pytest.mark.parametrize("kind", OTHERS)
def test_a_module_that_registers_no_model_is_not_run(kind: str) -> None:
    name = f"other_{kind}"
    Path(f"{name}.py").write_text(OTHERS[kind], encoding="utf-8")
    write(f'until = 5\nmodel = "{name}"\n', "own.toml")
    outcome = invoke("validate", "own.toml")
    assert outcome.exit_code == 2
    assert outcome.stderr.startswith(f"own.toml: model = '{name}': must be a module that ")
    assert MODELS.within(name) == []
    assert name not in sys.modules


def test_a_package_is_not_run_for_what_is_not_in_it() -> None:
    module("a_package.__init__", "\n1 / 0\n")
    module("a_package.inside", "\n1 / 0\n")
    assert "must be a module that registers a model" in refused("a_package.inside")
    assert "did you mean 'a_package.inside'?" in refused("a_package.insid")
    assert refused("a_package.inside.deeper").startswith(
        "model = 'a_package.inside.deeper': must be a module"
    )


def test_folders_without_a_file_of_their_own_are_packages() -> None:
    module("a_folder.another.mine", function("mine", 5))
    assert made_by("a_folder.another.mine", {}).n_agents == 5
    assert modules_in("a_folder.another") == ["a_folder.another.mine"]
    assert source_of("a_folder.another") == ""


def test_the_poem_is_not_printed(capfd: pytest.CaptureFixture[str]) -> None:
    write('until = 5\nmodel = "this"\n', "poem.toml")
    assert refusal("run", "poem.toml").startswith(
        "poem.toml: model = 'this': must be a module that registers"
    )
    assert "Beautiful" not in capfd.readouterr().out
    assert "this" not in sys.modules


@pytest.mark.parametrize("name", [".".join(["a"] * 5000), "a" * 100_000, "..", ".", "", "a..b", "a b", "\0"])
def test_what_is_no_name_is_refused(name: str) -> None:
    assert refused(name).startswith("model = ")


# -- what modules do when they are run -------------------------------------------------------------------


@pytest.mark.parametrize("where", ["module", "model"])
def test_leaving_python_is_a_mistake_of_the_model(where: str) -> None:
    name = f"leaves_in_its_{where}"
    if where == "module":
        module(name, function("mine", 2), "\nraise SystemExit(0)\n")
    else:
        module(name, "\n@model\ndef mine():\n    raise SystemExit(0)\n")
    write(f'until = 5\nmodel = "{name}"\n', "own.toml")
    outcome = invoke("validate", "own.toml")
    assert outcome.exit_code == 2
    assert "SystemExit: 0" in outcome.stderr
    again = invoke("validate", "own.toml")  # a second attempt finds nothing half registered
    assert again.stderr == outcome.stderr


def test_a_model_that_returns_something_else_is_refused() -> None:
    module("returns_none", "\n@model\ndef mine():\n    ...\n")
    with pytest.raises(InputError, match=r"^what returns_none returns = None: must be a Problem$"):
        made_by("returns_none", {})


# -- reading ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("imported", "mark"),
    [
        ("from aimd_des import model", "model"),
        ("from aimd_des import model as registered", "registered"),
        ("from aimd_des.scenario.models import model", "model"),
        ("from aimd_des import registry", "registry.model"),
        ("from aimd_des import *", "model"),
        ("import aimd_des", "aimd_des.model"),
        ("import aimd_des.scenario.models", "aimd_des.scenario.models.model"),
        ("import aimd_des.scenario.models as r", "r.model"),
    ],
)
def test_the_decorator_is_known_by_all_its_names(imported: str, mark: str) -> None:
    marks = frozenset({"aimd_des.model", "aimd_des.registry.model", "aimd_des.scenario.models.model"})
    source = f"{imported}\nif True:\n    @{mark}\n    def mine():\n        ...\n"
    assert decorated(source, marks) == ("mine",)
    assert decorated(source.replace("aimd_des", "other"), marks) == ()


def test_models_of_the_project_are_found_by_reading() -> None:
    assert MODELS.within("models") == []
    assert MODELS.within("models.smart_cameras") == ["models.smart_cameras"]
    assert isinstance(made_by("models.classic_aimd", {}), Problem)


def test_folders_are_shown_and_reported_without_their_model(monkeypatch: pytest.MonkeyPatch) -> None:
    module("kept_in_folders", function("mine", 3))
    write('until = 5\nmodel = "kept_in_folders"\n', "own.toml")
    write('base = "own.toml"\n', "study.toml")
    assert invoke("run", "own.toml", "--out", "run", "--no-figures").exit_code == 0
    assert invoke("sweep", "study.toml", "--out", "study", "--workers", "1").exit_code == 0

    def looked_for(_: object, name: str) -> None:
        raise AssertionError(name)

    monkeypatch.setattr("aimd_des.scenario.named.Names._called", looked_for)
    for folder in ("run", "study"):
        assert invoke("show", folder).exit_code == 0
        assert invoke("compare", folder, folder).exit_code == 0
        assert invoke("report", folder).exit_code == 0
    with pytest.raises(AssertionError, match="kept_in_folders"):
        named_model("kept_in_folders")
