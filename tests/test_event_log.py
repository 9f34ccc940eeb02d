"""The event log: the order of its entries, and how it is read while a run goes on."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aimd_des import (
    AgentProcess,
    Clocks,
    Crossing,
    Fleet,
    InputError,
    Recording,
    Result,
    Sampled,
    Simulation,
    latency,
)
from aimd_des.channel import BroadcastChannel
from aimd_des.engine.system import System
from aimd_des.interventions import CapacityStep
from aimd_des.lowlevel import EventKind
from tests.conftest import quietly, random_problem

LOGGED = Recording(events=True)
REPRESENTATIONS: list[dict[str, Any]] = [
    {"agents": AgentProcess},
    {"agents": Fleet},
    {"agents": Fleet, "special": {1: AgentProcess}},
]


def _at_one_instant(result: Result, time: float) -> list[tuple[str, int, int]]:
    """Kind, resource and agent of the entries at one time."""
    log = result.events[result.events["time"] == time]
    codes = (log[name].cat.codes.tolist() for name in ("resource", "agent"))
    return list(zip(log["kind"].tolist(), *codes, strict=True))


def test_at_one_instant_entries_stand_in_the_order_of_the_model() -> None:
    """Copies need one unit: at a tick some land, signals leave, and agents answer."""
    problem = random_problem(3, 4, 2)
    rank = {"capacity": 0, "deliver": 1, "signal": 2, "lost": 2, "respond": 3, "hold": 3}
    digests, crowded = set(), 0
    for parts in REPRESENTATIONS:
        result = quietly(
            Simulation(
                problem,
                control_unit=Sampled(1.0),
                channel=BroadcastChannel(1.0, loss=0.3),
                interventions=[CapacityStep(0, float(k), problem.capacity[0]) for k in range(1, 60)],
                recording=LOGGED,
                seed=5,
                **parts,
            ).run,
            60.0,
        )
        digests.add(result.digest)
        for time in range(60):
            entries = _at_one_instant(result, float(time))
            ranks = [rank[kind] for kind, _, _ in entries]
            assert ranks == sorted(ranks)
            # By broadcasts, then agents; a signal before what is lost of it; by agents, then resources.
            landed = [(j, i) for kind, j, i in entries if kind == "deliver"]
            sent = [(j, i) for kind, j, i in entries if kind in ("signal", "lost")]
            answered = [(i, j) for kind, j, i in entries if kind in ("respond", "hold")]
            for part in (landed, sent, answered):
                assert part == sorted(part)
            crowded += len({*ranks}) == 4 and len(landed) > 4
    assert len(digests) == 1
    assert crowded > 30


def test_a_continuous_agent_answers_right_behind_the_copy_that_lands() -> None:
    """All copies of both resources land at one time; signals without latency land after their look."""
    problem = random_problem(3, 4, 2)
    for late in (0.0, 0.75):
        digests = set()
        for parts in REPRESENTATIONS:
            result = quietly(
                Simulation(
                    problem,
                    dynamics="continuous",
                    control_unit=Sampled(0.5),
                    channel=BroadcastChannel(late),
                    recording=LOGGED,
                    seed=5,
                    **parts,
                ).run,
                60.0,
            )
            digests.add(result.digest)
            log = result.events
            landed = np.flatnonzero(log["kind"] == "deliver")
            assert len(landed) > 100
            behind = log.iloc[landed + 1]
            assert behind["kind"].isin(["respond", "hold"]).all()
            for name in ("time", "resource", "agent", "number"):
                assert behind[name].tolist() == log.iloc[landed][name].tolist()
        assert len(digests) == 1


@pytest.mark.parametrize("dynamics", ["discrete", "continuous"])
def test_a_log_is_read_in_turn_while_a_run_goes_on(dynamics: Any) -> None:
    """What a process reads piece by piece is the whole log, and reading moves nothing."""
    parts: dict[str, Any] = {"control_unit": Crossing(0.5)}
    if dynamics == "discrete":
        parts = {"control_unit": Sampled(1.0), "clocks": Clocks(1.0, "random", 0.01, 0.2)}

    def simulate(agents: dict[str, Any], recording: Recording, *processes: Any) -> Result:
        channel = BroadcastChannel(latency.Exponential(0.8), loss=0.2, duplication=0.2)
        simulation = Simulation(
            random_problem(3, 5, 2),
            dynamics=dynamics,
            channel=channel,
            processes=processes,
            recording=recording,
            seed=2,
            **parts,
            **agents,
        )
        return quietly(simulation.run, 40.0)

    for agents in REPRESENTATIONS:
        pieces: list[pd.DataFrame] = []

        def read(system: Any, pieces: list[pd.DataFrame] = pieces) -> Iterator[Any]:
            for q in range(1, 100):
                yield system.env.at(0.4 * q, EventKind.OBSERVE)
                pieces.append(system.events(since=sum(map(len, pieces))))
                # What has landed before has been answered, by a fleet as well.
                assert pieces[-1]["time"].between(0.4 * (q - 1), system.env.now).all()

        result = simulate(agents, LOGGED, read)
        assert len(result.events) > 200
        pieces.append(result.events.iloc[sum(map(len, pieces)) :])
        pd.testing.assert_frame_equal(pd.concat(pieces, ignore_index=True), result.events)
        assert result.digest == simulate(agents, LOGGED).digest
        # With a log its answers are integrated, without one those that compiled code has sorted.
        one, other = (run.observations.overshoot for run in (result, simulate(agents, Recording())))
        for name in ("peak", "time", "mean"):
            assert getattr(one, name).tolist() == getattr(other, name).tolist()


def test_a_run_without_a_log_says_so() -> None:
    def read(system: Any) -> Any:
        yield system.env.at(1.0, EventKind.OBSERVE)
        system.events()

    simulation = Simulation(random_problem(3, 5, 2), processes=[read], seed=2)
    with pytest.raises(InputError, match=r"^events: the run keeps no log"):
        simulation.run(2.0)


@pytest.mark.parametrize("control_unit", [Crossing(1.0), Sampled(1.0)])
def test_a_log_costs_no_second_sum_of_the_total(control_unit: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The look that has found the total hands it to the entry of the signal."""
    sums: list[str] = []
    for name in ("total", "totals"):
        whole = getattr(System, name)

        def noted(self: System, *resource: Any, whole: Any = whole, name: str = name) -> Any:
            sums.append(name)
            return whole(self, *resource)

        monkeypatch.setattr(System, name, noted)
    counts = []
    for recording in (Recording(), LOGGED):
        sums.clear()
        parts: dict[str, Any] = {"dynamics": "continuous", "control_unit": control_unit}
        result = quietly(Simulation(random_problem(3, 4, 2), recording=recording, seed=5, **parts).run, 40.0)
        counts.append(len(sums))
    assert counts[0] == counts[1] > len(result.signals_sent.time) / 2 > 5
