"""Runs by hand: channels that say when copies arrive, signals at given instants, and the log as lines."""

from typing import Any

import numpy as np

from aimd_des import Result
from aimd_des.channel import Broadcast, Copies
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.system import System


def exactly(time: float) -> str:
    """A time without zeros at its end, and with all digits that it has."""
    return repr(time).removesuffix(".0")


def story(result: Result) -> list[str]:
    """The log, one line for each entry: time, what happened, to whom, in which broadcast."""
    names = result.problem.agent_names
    return [
        f"{exactly(event.time)} {f'agent {event.agent} ' if event.agent in names else ''}"
        f"{event.kind} {event.number}"
        for event in result.events.itertuples()
    ]


class Script:
    """A channel that says when the copies of broadcast b of each resource arrive."""

    def __init__(self, *arrivals: list[float]) -> None:
        self.arrivals = arrivals

    def open(self, n_agents: int, keys: Any) -> "Script":
        return self

    def transmit(self, sent: Broadcast, departure: float) -> Copies:
        return Copies(np.array(self.arrivals[sent.number]))


def send_at(time: float, *resources: int) -> Any:
    """A process that has the control unit broadcast at an instant."""

    def process(system: System) -> ProcessGenerator:
        yield system.env.at(time, EventKind.SENSE)
        for j in resources:
            system.broadcast(j)

    return process
