"""Hold-off, threshold and channel that change while a run goes on."""

import math
import tomllib
from typing import Any

import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    Recording,
    Sampled,
    Simulation,
)
from aimd_des import latency as latencies
from aimd_des import loss as losses
from aimd_des.engine.delivery import ProcessGenerator, Signal
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System
from aimd_des.interventions import ChangeChannel, ChangeHoldOff, ChangeThreshold, set_hold_off
from aimd_des.scenario import validate_scenario
from tests.conftest import quietly, random_problem
from tests.test_interventions import growing

BOTH = pytest.mark.parametrize("agents", [AgentProcess, Fleet])
EVENTS = Recording(events=True)
DEAF = BroadcastChannel(loss=1.0)


def simulate(problem: Any, until: float, *interventions: Any, **parts: Any) -> Any:
    options = {
        "dynamics": "continuous",
        "control_unit": Crossing(1.0),
        "recording": EVENTS,
        "seed": 3,
        **parts,
    }
    return quietly(Simulation(problem, interventions=interventions, **options).run, until)


def times(result: Any, kind: str) -> list[float]:
    events = result.events
    return sorted(set(events.loc[events["kind"] == kind, "time"]))


@BOTH
def test_a_hold_off_that_goes_on_ends_when_it_would_have_ended(agents: Any) -> None:
    """Three agents grow by 1 each and hear nothing: 3 is reached at 1, and signals follow each other."""
    parts: dict[str, Any] = {"agents": agents, "channel": DEAF}
    result = simulate(growing(capacity=3.0), 5.0, ChangeHoldOff(3.5, 0.25), **parts)
    assert times(result, "signal") == [1.0, 2.0, 3.0, 4.0, 4.25, 4.5, 4.75]
    assert times(result, "hold_off") == [3.5]


@BOTH
def test_a_hold_off_that_adapts_is_brought_into_its_new_bounds(agents: Any) -> None:
    """Unanswered signals double the hold-off: 1, 2, 4; the one that goes on is not cut, the next are 1."""
    parts: dict[str, Any] = {"agents": agents, "channel": DEAF, "control_unit": Crossing(1.0, 0.0, 8.0)}
    result = simulate(growing(capacity=3.0), 14.0, ChangeHoldOff(5.0, 0.5, 1.0), **parts)
    assert times(result, "signal") == [1.0, 2.0, 4.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0]


@BOTH
@pytest.mark.parametrize("resource", [None, 0, "memory"])
def test_a_lower_threshold_is_reached_sooner(agents: Any, resource: Any) -> None:
    parts: dict[str, Any] = {"agents": agents, "channel": DEAF}
    result = simulate(growing(capacity=12.0), 2.5, ChangeThreshold(0.75, 0.5, resource), **parts)
    assert times(result, "signal") == [2.0]
    at_once = simulate(growing(capacity=12.0), 3.25, ChangeThreshold(2.25, 0.5, resource), **parts)
    assert times(at_once, "signal") == [2.25]


@BOTH
def test_what_has_been_sent_arrives_as_it_would_have(agents: Any) -> None:
    late, early = BroadcastChannel(latency=0.5), BroadcastChannel(latency=0.125)
    problem = growing(capacity=3.0, normalization=1e-9)
    result = simulate(problem, 4.0, ChangeChannel(2.25, early), agents=agents, channel=late)
    assert times(result, "signal") == [1.0, 2.0, 3.0]
    assert times(result, "deliver") == [1.5, 2.5, 3.125]


@BOTH
def test_a_signal_that_waits_for_its_departure_goes_the_way_it_was_looked_for(agents: Any) -> None:
    late, early = BroadcastChannel(latency=0.5), BroadcastChannel(latency=0.125)
    unit, problem = Crossing(1.0, sensing_delay=0.75), growing(capacity=3.0, normalization=1e-9)
    parts: dict[str, Any] = {"agents": agents, "channel": late, "control_unit": unit}
    result = simulate(problem, 4.0, ChangeChannel(2.25, early), **parts)
    assert times(result, "deliver") == [2.25, 3.25, 3.875]


def changed(**parts: Any) -> Any:
    bursts = losses.GilbertElliott(0.3, 4.0)
    return simulate(
        random_problem(5, 7, 2),
        120.0,
        ChangeHoldOff(20.0, 1.5),
        ChangeChannel(30.2, BroadcastChannel(latencies.Uniform(0.2, 2.0), bursts, 0.3, True)),
        ChangeThreshold(40.0, 0.7, 1),
        ChangeHoldOff(55.5, 0.2, 3.0),
        ChangeChannel(70.0, BroadcastChannel(0.1)),
        ChangeThreshold(90.0, 1.0),
        channel=BroadcastChannel(latencies.Exponential(0.5), 0.1),
        control_unit=Crossing(0.5),
        **parts,
    )


def test_processes_and_fleet_agree_and_a_log_changes_nothing() -> None:
    reference, fleet = changed(agents=AgentProcess), changed(agents=Fleet)
    compiled = changed(agents=Fleet, recording=Recording())
    assert reference.digest == fleet.digest
    assert len(reference.signals) > 60
    for other in (fleet, compiled):
        assert np.array_equal(reference.average_at_end, other.average_at_end)
        assert np.array_equal(reference.account.duplicated, other.account.duplicated)
    assert reference.account.duplicated.sum() > 0
    # Each of them makes a difference.
    assert reference.digest != simulate(random_problem(5, 7, 2), 120.0, control_unit=Crossing(0.5)).digest


@BOTH
@pytest.mark.parametrize("recording", [EVENTS, Recording()])
def test_who_listens_is_told_of_every_copy_that_leaves(agents: Any, recording: Recording) -> None:
    told: list[tuple[Signal, int]] = []

    def listen(system: System) -> ProcessGenerator:
        system.transmitter.on_leave.append(
            lambda signal, arrival: told.append((signal, int((arrival < math.inf).sum())))
        )
        yield from ()

    channel = BroadcastChannel(latencies.Exponential(0.5), 0.25)
    problem = random_problem(5, 7, 2)
    parts: dict[str, Any] = {"agents": agents, "recording": recording, "processes": [listen]}
    result = simulate(problem, 60.0, channel=channel, control_unit=Crossing(0.5), **parts)
    account = result.account
    assert len(told) == len(result.signals) > 20
    assert sum(copies for _, copies in told) == account.delivered.sum() + account.in_flight.sum()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ChangeHoldOff(-1.0, 1.0), "ChangeHoldOff.at = -1.0"),
        (lambda: ChangeHoldOff(1.0, -1.0), "hold_off = -1.0"),
        (lambda: ChangeHoldOff(1.0, 2.0, 1.0), "longest_hold_off = 1.0"),
        (lambda: ChangeThreshold(1.0, 1.5), "ChangeThreshold.threshold = 1.5"),
        (lambda: ChangeThreshold(1.0, 0.5, "memroy"), "did you mean 'memory'?"),
        (lambda: ChangeChannel(1.0, 0.5), "channel = 0.5"),
        (lambda: ChangeChannel(1.0, BroadcastChannel(latency=[1.0, 2.0])), "shape of latency = (2,)"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_runs(make: Any, words: str) -> None:
    with pytest.raises(InputError) as caught:
        Simulation(
            growing(), dynamics="continuous", control_unit=Crossing(1.0), interventions=[make()], seed=0
        )
    assert words in str(caught.value)


@pytest.mark.parametrize("unit", [None, Sampled(0.5)])
def test_a_hold_off_is_changed_only_where_there_is_one(unit: Any) -> None:
    with pytest.raises(InputError, match=r"interventions\[1\] = ChangeHoldOff.*choose Crossing"):
        Simulation(
            growing(),
            dynamics="continuous",
            control_unit=unit,
            interventions=[ChangeThreshold(1.0, 0.5), ChangeHoldOff(1.0, 1.0)],
            seed=0,
        )

    def meddle(system: System) -> ProcessGenerator:
        yield system.env.at(1.0, EventKind.INTERVENE)
        set_hold_off(system, 0.5)

    with pytest.raises(InputError, match="others have no hold-off"):
        simulate(growing(), 3.0, control_unit=unit, processes=[meddle])


FILE = {
    "until": 40.0,
    "dynamics": "continuous",
    "model": "models.smart_cameras",
    "parameters": {"n_cameras": 6},
    "control_unit": {"kind": "crossing", "hold_off": 0.5},
    "interventions": [
        {"kind": "hold_off", "at": 5.0, "hold_off": 1.0},
        {"kind": "threshold", "at": 6, "threshold": 0.9, "resource": "disk"},
        {
            "kind": "channel",
            "at": 7.5,
            "channel": {
                "latency": {"kind": "uniform", "low": 0.1, "high": 1.0},
                "loss": [0.1, 0, 0, 0, 0, 0.5],
            },
        },
    ],
}


def test_a_file_says_the_same_when_it_is_written_and_read() -> None:
    scenario = validate_scenario(FILE, "file")
    again = validate_scenario(tomllib.loads(scenario.to_toml()), "again")
    assert again.canonical() == scenario.canonical()
    assert quietly(again.run).digest == quietly(scenario.run).digest
    other = {**FILE, "interventions": FILE["interventions"][:2]}  # type: ignore[index]
    assert validate_scenario(other, "other").canonical() != scenario.canonical()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"control_unit": {"kind": "sampled"}}, "interventions.0.kind = 'hold_off'"),
        (
            {"interventions": [{"kind": "channel", "at": 1.0, "channel": {"loss": 2.0}}]},
            "interventions.0.channel: loss = 2.0",
        ),
        ({"interventions": [{"kind": "channel", "at": 1.0, "channel": {"los": 0.2}}]}, "unknown key 'los'"),
        ({"interventions": [{"kind": "channel", "at": 1.0}]}, "channel"),
    ],
)
def test_a_file_is_refused_by_the_place_of_the_mistake(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        validate_scenario({**FILE, **change}, "file")
    assert words in str(caught.value)
