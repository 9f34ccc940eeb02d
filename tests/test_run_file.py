"""A run that was saved and gone on with ends as the run itself, and no file that is damaged is taken."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from aimd_des import Crossing, InputError, Simulation, interventions
from aimd_des.lowlevel import System, resume
from tests.conftest import quietly
from tests.support.configurations import Configuration, assert_same
from tests.test_fork import FORKED, WHERE, at, in_a_piece, simulation


def again(configuration: Configuration) -> Simulation:
    parts = {"seed": configuration.seed, **configuration.parts, "agents": simulation().agents}
    return Simulation(configuration.problem, **parts)


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(FORKED, WHERE, st.booleans())
def test_a_run_that_is_gone_on_with_ends_as_the_run(
    tmp_path: Path, configuration: Configuration, where: tuple[float, int], salted: bool
) -> None:
    run = in_a_piece(configuration, where)
    if salted:
        run = run.fork(5)
    run.save(tmp_path / "run")
    resumed = resume(tmp_path / "run", again(configuration))
    assert (resumed.time, resumed.peek()) == (run.time, run.peek())
    assert_same(quietly(run.result), quietly(resumed.result))
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_no_flipped_bit_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "run"
    at(20.0).save(path)
    content = path.read_bytes()
    places = [*range(0, 90, 7), *range(90, len(content), len(content) // 60)]
    for place in places:
        for bit in (0, 5):
            damaged = bytearray(content)
            damaged[place] ^= 1 << bit
            path.write_bytes(damaged)
            with pytest.raises(InputError, match=r"is damaged|is no run that this version has saved"):
                resume(path, simulation())
    path.write_bytes(content[:-1])
    with pytest.raises(InputError, match="is damaged"):
        resume(path, simulation())


@pytest.mark.parametrize(
    "other",
    [
        lambda: simulation(seed=2),
        lambda: simulation(control_unit=Crossing(2.0)),
        lambda: simulation(interventions=[interventions.Failover(50.0, 2.0)]),
    ],
)
def test_another_simulation_is_refused(tmp_path: Path, other: Callable[[], Simulation]) -> None:
    at(20.0).save(tmp_path / "run")
    with pytest.raises(
        InputError, match=r"^simulation = 'Simulation': must be that of which .*run holds a run"
    ):
        resume(tmp_path / "run", other())


def test_places_that_cannot_be_written_or_read_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere/run: cannot be written \(No such file or directory\)"):
        at(20.0).save(tmp_path / "nowhere" / "run")
    with pytest.raises(InputError, match=r"run: cannot be read \(No such file or directory\)"):
        resume(tmp_path / "run", simulation())


@pytest.mark.parametrize("place", ["", ".", "/"])
def test_places_without_a_name_are_refused(place: str) -> None:
    with pytest.raises(InputError, match=r"^[./]: cannot be written"):
        at(20.0).save(place)
    with pytest.raises(InputError, match=r"^[./]: cannot be read"):
        resume(place, simulation())


@pytest.mark.parametrize("place", [None, 5, b"run", "a\0b"])
def test_what_is_no_place_is_refused(place: Any) -> None:
    for use in (at(20.0).save, lambda path: resume(path, simulation())):
        with pytest.raises(InputError, match=r"^path = .*: must be the name of a file or folder"):
            use(place)


class OwnCosts(interventions.Planned):
    """Sets costs that no file can hold."""

    def check(self, problem: Any) -> None:
        pass

    def changes(self, system: System, memory: dict[str, Any]) -> Any:
        yield 5.0, lambda: interventions.set_costs(system, system.problem.costs)


def test_costs_of_ones_own_cannot_be_saved(tmp_path: Path) -> None:
    run = at(20.0, interventions=[OwnCosts()])
    with pytest.raises(
        InputError, match=r"^costs in force = 'PolynomialCosts': must be those of the problem"
    ):
        run.save(tmp_path / "run")
