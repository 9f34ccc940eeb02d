"""Losses that read the run in progress: what they find there, with processes and a fleet, in all channels."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    PolynomialCosts,
    Problem,
    Recording,
    Resource,
    Sampled,
    Simulation,
    topology,
)
from aimd_des.loss import Combined
from aimd_des.lowlevel import Channel, Draws, System

SHARED = Problem(
    [Resource("memory", capacity=20.0, increase=0.02, decrease=0.5, normalization=0.02)],
    PolynomialCosts([2], [[[1.0]]] * 20),
)


class Noting:
    """Notes the totals that it reads."""

    def __init__(self) -> None:
        self.seen: list[float] = []

    def start(self, n_agents: int) -> "Noting":
        self.seen = []
        return self

    def attach(self, system: System) -> None:
        self.system = system

    def draw(self, draws: Draws) -> npt.NDArray[np.bool_]:
        self.seen.append(self.system.total(draws.resource))
        return np.zeros(draws.n_agents, dtype=bool)


@pytest.mark.parametrize("agents", [AgentProcess, Fleet])
@pytest.mark.parametrize("way", ["alone", "combined", "network"])
def test_a_loss_reads_the_demand_that_the_control_unit_has_found(agents: type, way: str) -> None:
    noting = Noting()
    if way == "network":
        star = topology.star(20, latency=0.1)
        channel: Channel = topology.tree(star, loss=lambda _: noting)
    else:
        channel = BroadcastChannel(loss=noting if way == "alone" else Combined(0.1, noting))
    parts: dict[str, Any] = {
        "dynamics": "continuous",
        "control_unit": Crossing(0.5),
        "agents": agents,
        "seed": 1,
    }
    result = Simulation(SHARED, channel=channel, recording=Recording(events=True), **parts).run(100.0)
    log = result.events
    assert len(noting.seen) > 20
    assert noting.seen == log[log["kind"] == "signal"]["value"].tolist()


class Failing(Noting):
    """Fails before anything happens."""

    def attach(self, system: System) -> None:
        raise KeyError("no such system")


def test_what_fails_as_it_is_attached_is_named() -> None:
    channel = BroadcastChannel(loss=Failing())
    simulation = Simulation(SHARED, control_unit=Sampled(), channel=channel, seed=1)
    with pytest.raises(KeyError) as raised:
        simulation.run(10.0)
    assert raised.value.__notes__ == ["raised in Failing.attach()"]
