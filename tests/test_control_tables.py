"""Control units of the user's own with a table: compiled code and processes make the same run of them."""

from typing import Any

import numba
import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    Sampled,
    Simulation,
    interventions,
)
from aimd_des.engine.environment import EventKind
from aimd_des.fleet.control_table import compiled_table
from aimd_des.lowlevel import CrossingTable, ProcessGenerator, SampledTable, SampledUnit, System
from tests.conftest import random_problem
from tests.test_fleet import assert_same, both

PROBLEM = random_problem(1, 6, 2)


@numba.njit  # type: ignore[untyped-decorator]
def parabola(total: float, threshold: float, time: float, look: int, resource: int) -> float:
    """Depends on all that it is given: no signal at every seventh look, and fewer for the second resource."""
    above = min(max(total / threshold - 0.7, 0.0) / 0.4, 1.0)
    return 0.0 if look % 7 == 3 or time < 2.0 else above ** (2 + resource)


class Own(SampledUnit):
    """Of one method."""

    def __init__(self, table: Any) -> None:
        self.said = table

    def table(self) -> Any:
        return self.said


class Held:
    """A unit of the other form, whose process is that of a unit of ours."""

    def table(self) -> CrossingTable:
        return CrossingTable(0.5, 2.0, 0.25)

    def process(self, system: System) -> ProcessGenerator:
        return Crossing(0.5, 0.25, 2.0).process(system)


class Doubled(Sampled):
    """Decides otherwise in its process, of which its table knows nothing."""

    def process(self, system: System) -> ProcessGenerator:
        for look in range(1, 100):
            yield system.env.at(float(look), EventKind.SENSE)
            system.broadcast(0)
            system.broadcast(0)


def parts_of(dynamics: str) -> dict[str, Any]:
    return {
        "dynamics": dynamics,
        "channel": BroadcastChannel(0.3, 0.2, 0.1),
        "interventions": [interventions.Failover(10.0, 4.0), interventions.CapacityStep(0, 18.0, 1.0)],
        "seed": 3,
    }


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_a_unit_with_a_compiled_function_is_served_by_its_table(dynamics: str) -> None:
    unit = Own(SampledTable(0.5, 0.25, 0.125, probability=parabola))
    assert compiled_table(unit) == unit.said
    processes, fleet = both(PROBLEM, 40.0, control_unit=unit, **parts_of(dynamics))
    assert_same(processes, fleet)
    assert 5 < len(fleet.signals) < 120
    # Plain Python has to be called by a process; the run is the same.
    plain = Own(SampledTable(0.5, 0.25, 0.125, probability=parabola.py_func))
    assert compiled_table(plain) is None
    assert_same(fleet, both(PROBLEM, 40.0, control_unit=plain, **parts_of(dynamics))[1])


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_a_table_of_one_threshold_is_the_sampled_unit(dynamics: str) -> None:
    own = Simulation(PROBLEM, control_unit=Own(SampledTable(0.5)), agents=Fleet, **parts_of(dynamics))
    ours = Simulation(PROBLEM, control_unit=Sampled(0.5), agents=Fleet, **parts_of(dynamics))
    assert own.run(40.0).digest == ours.run(40.0).digest


def test_a_table_of_a_hold_off_is_the_crossing_unit() -> None:
    parts = parts_of("continuous")
    processes, fleet = both(PROBLEM, 40.0, control_unit=Held(), **parts)
    assert_same(processes, fleet)
    assert compiled_table(Held()) == CrossingTable(0.5, 2.0, 0.25)
    ours = Simulation(PROBLEM, control_unit=Crossing(0.5, 0.25, 2.0), agents=Fleet, **parts).run(40.0)
    assert fleet.digest == ours.digest
    with pytest.raises(InputError, match=r"^control_unit = .*Held.*: must be a Sampled with discrete agents"):
        Simulation(PROBLEM, control_unit=Held(), seed=0)


def test_a_process_of_its_own_is_run_whatever_the_table_of_its_base_says() -> None:
    assert compiled_table(Doubled()) is None
    processes, fleet = both(PROBLEM, 20.0, control_unit=Doubled(), **parts_of("continuous"))
    assert_same(processes, fleet)
    assert len(fleet.signals) == 38


@pytest.mark.parametrize(
    ("said", "message"),
    [
        (1.0, r"Own.table\(\) = 1.0: must be a SampledTable or a CrossingTable"),
        (SampledTable(0.0), r"Own.table\(\).period = 0.0: must be a finite number greater than 0"),
        (
            SampledTable(1.0, low=1.0, high=0.5),
            r"Own.table\(\).high = 0.5: must be a finite number at least 1",
        ),
        (SampledTable(1.0, probability=0.5), r"Own.table\(\).probability = 0.5: must be a function of "),  # type: ignore[arg-type]
        (
            CrossingTable(1.0, 0.5),
            r"Own.table\(\).longest_hold_off = 0.5: must be ",
        ),
    ],
)
def test_a_table_is_checked_when_the_simulation_is_made(said: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}"):
        Simulation(PROBLEM, control_unit=Own(said), dynamics="continuous", seed=0)


@numba.njit  # type: ignore[untyped-decorator]
def beyond(total: float, threshold: float, time: float, look: int, resource: int) -> float:
    return 0.5 if look < 9 or resource == 0 else 1.5


@numba.njit  # type: ignore[untyped-decorator]
def no_number(total: float, threshold: float, time: float, look: int, resource: int) -> float:
    return np.nan if look == 9 else 0.0


@numba.njit  # type: ignore[untyped-decorator]
def zero(total: float, threshold: float, time: float, look: int, resource: int) -> float:
    return 0.0 / (9.0 - time)


@pytest.mark.parametrize(("function", "given"), [(beyond, "1.5"), (no_number, "nan")])
def test_what_is_no_probability_is_refused_by_name_at_the_look(function: Any, given: str) -> None:
    words = []
    for agents in (AgentProcess, Fleet):
        unit = Own(SampledTable(1.0, probability=function))
        with pytest.raises(InputError) as caught:
            Simulation(PROBLEM, control_unit=unit, agents=agents, seed=0).run(20.0)
        words.append(str(caught.value))
    assert words[0] == words[1]
    assert words[0].startswith("Own.table().probability(total=")
    assert f"time=9.0, ...) = {given}: must be a finite number at least 0 and at most 1" in words[0]


@pytest.mark.parametrize("agents", [AgentProcess, Fleet])
def test_an_exception_of_the_function_ends_the_run(agents: Any) -> None:
    unit = Own(SampledTable(1.0, probability=zero))
    with pytest.raises(ZeroDivisionError):
        Simulation(PROBLEM, control_unit=unit, agents=agents, seed=0).run(20.0)
