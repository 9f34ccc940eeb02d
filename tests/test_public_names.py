"""The public names of the package: where they are imported from, and that type checkers may see them."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import aimd_des

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
