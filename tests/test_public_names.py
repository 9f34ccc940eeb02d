"""The public names of the package: where they are imported from, and that type checkers may see them."""

import inspect
import pickle
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import aimd_des
from aimd_des import Crossing, InputError, PolynomialCosts, Problem, Resource, theory
from aimd_des._deprecated import KEYWORDS, MOVED, NAMES

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


MEMORY = Problem([Resource("memory", 20.0, 0.02, 0.5, 0.1)], PolynomialCosts([2], [[[1.0]]] * 20))
RENAMED: list[tuple[Callable[..., Any], dict[str, Any], dict[str, float]]] = [
    (Crossing, {}, {"refractory": 0.5}),
    (Crossing, {"sensing_delay": 0.1}, {"refractory": 0.5, "longest": 2.0}),
    (theory.critical_loss, {"rate": 0.3}, {"refractory": 0.5}),
    (theory.partition_runaway, {"problem": MEMORY, "duration": 2.0}, {"refractory": 0.5}),
    (theory.predict, {"problem": MEMORY, "dynamics": "continuous"}, {"refractory": 0.5}),
    (theory.safe_threshold, {"problem": MEMORY, "dynamics": "continuous"}, {"refractory": 0.5}),
    (
        theory.runaway_multiplier,
        {"increase": 0.1, "decrease": 0.5, "normalization": 0.1, "loss": 0.5},
        {"refractory": 0.5},
    ),
]


@pytest.mark.parametrize(("called", "given", "old"), RENAMED)
def test_old_keywords_mean_the_new_ones_with_a_warning(
    called: Callable[..., Any], given: dict[str, Any], old: dict[str, float]
) -> None:
    new = {KEYWORDS[name]: value for name, value in old.items()}
    with pytest.warns(DeprecationWarning, match="is called .*hold_off since 0.1") as heard:
        found = called(**given, **old)
    assert [one.filename for one in heard] == [__file__] * len(old)
    assert str(found) == str(called(**given, **new))
    for name, value in old.items():
        words = f"{name} = {value}: must be left out beside {KEYWORDS[name]}, its new name"
        with pytest.raises(InputError, match=words):
            called(**given, **new, **{name: value})
    assert not KEYWORDS.keys() & inspect.signature(called).parameters.keys()


def test_a_crossing_is_asked_by_old_names_too() -> None:
    unit = Crossing(0.5, longest_hold_off=2.0)
    assert pickle.loads(pickle.dumps(unit)) == unit
    with pytest.warns(DeprecationWarning, match="longest is called longest_hold_off since 0.1"):
        assert unit.longest == 2.0  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match="'Crossing' object has no attribute 'nothing'"):
        _ = unit.nothing  # type: ignore[attr-defined]
