"""The public names of the package: where they are imported from, and that type checkers may see them."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import aimd_des
from aimd_des._deprecated import MOVED, NAMES

ROOT = Path(__file__).resolve().parents[1]
MODULES = ["averaging", "compensation", "interventions", "latency", "loss", "theory", "topology"]


@pytest.mark.parametrize("name", MODULES)
def test_a_public_module_is_imported_by_the_name_that_the_pages_give_it(name: str) -> None:
    module = import_module(f"aimd_des.{name}")
    assert module is getattr(aimd_des, name)
    assert module.__all__
    assert all(hasattr(module, public) for public in module.__all__)


@pytest.mark.parametrize("name", ["latency", "loss", "topology"])
def test_a_face_has_all_that_its_package_has(name: str) -> None:
    face, home = import_module(f"aimd_des.{name}"), import_module(f"aimd_des.channel.{name}")
    assert face.__all__ == home.__all__
    assert all(getattr(face, public) is getattr(home, public) for public in home.__all__)


def test_each_form_of_import_works_in_a_fresh_interpreter() -> None:
    """One that has imported nothing else before, since imports leave attributes behind."""
    program = "\n".join(
        [
            "import aimd_des.loss, aimd_des.topology, aimd_des.averaging, aimd_des.compensation",
            "from aimd_des.latency import Exponential",
            "from aimd_des import latency, theory",
            "assert latency.Exponential is Exponential",
            "assert aimd_des.loss.Bernoulli(0.1).mean == 0.1",
        ]
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT)


def test_dir_shows_the_public_names_and_no_others() -> None:
    assert dir(aimd_des) == sorted(aimd_des.__all__)
    assert not [name for name in dir(aimd_des) if name.startswith("_")]


def test_the_package_tells_type_checkers_that_it_is_typed() -> None:
    """Without the mark they ignore its annotations, though the classifier promises them (PEP 561)."""
    assert Path(aimd_des.__file__).with_name("py.typed").is_file()


@pytest.mark.parametrize("old", NAMES)
def test_an_old_name_is_the_new_object_with_a_warning_at_the_line_that_asks(old: str) -> None:
    new, since = NAMES[old]
    with pytest.warns(DeprecationWarning, match=f"aimd_des.{old} is called {new} since {since}") as heard:
        found = getattr(aimd_des, old)
    assert found is getattr(aimd_des, new)
    assert [one.filename for one in heard] == [__file__]
    assert old not in dir(aimd_des)
    assert new in dir(aimd_des)


@pytest.mark.parametrize("old", MOVED)
def test_an_old_path_can_be_imported_with_a_warning(old: str) -> None:
    """In the order of the table; each has a name at least that is found in each of its new places."""
    sys.modules.pop(old, None)
    with pytest.warns(DeprecationWarning, match=f"{old} has moved: import from {MOVED[old][0]}"):
        module = import_module(old)
    for new in MOVED[old]:
        names = import_module(new).__all__
        assert any(getattr(module, name) is getattr(import_module(new), name) for name in names)
    with pytest.raises(AttributeError, match=f"module '{old}' has no attribute 'nothing'"):
        _ = module.nothing


def test_an_old_name_at_an_old_path() -> None:
    with pytest.warns(DeprecationWarning, match=r"aimd_des\.run_discrete is called run_synchronous"):
        from aimd_des.discrete import run_discrete  # type: ignore[import-not-found]
    assert run_discrete is aimd_des.run_synchronous


def test_the_name_of_the_paper_goes_on_without_a_warning() -> None:
    from aimd_des.engine.agent_process import Camera

    assert aimd_des.Camera is Camera is aimd_des.AgentProcess
    assert "Camera" not in dir(aimd_des)
