"""An emulation held against simulations: with recorded arrivals, with measured lateness, and plain."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from aimd_des.channel import Broadcast, Copies, Link
from aimd_des.channel.broadcast import CompiledLink
from aimd_des.emulate.folder import StoredEmulation
from aimd_des.emulate.outcome import Rows, answers, outcome, sent_signals, unheard
from aimd_des.emulate.records import RowKind
from aimd_des.emulate.served import served_link
from aimd_des.engine.agent_process import AgentProcess
from aimd_des.engine.control_unit import ControlUnit
from aimd_des.engine.delivery import ProcessGenerator
from aimd_des.engine.environment import EventKind
from aimd_des.engine.simulation import Simulation
from aimd_des.engine.system import System
from aimd_des.fleet import Fleet
from aimd_des.results.result import Result
from aimd_des.utils.rng import Key, Purpose
from aimd_des.utils.validation import FloatArray

# Of so many agents processes are fast enough, and nothing need be compiled.
_FEW = 500


@dataclass(frozen=True, eq=False)
class RecordedUnit:
    """A control unit that signals when another one has."""

    time: FloatArray  # (s,): ascending
    resource: Any  # (s,): int

    def process(self, system: System) -> ProcessGenerator:
        """Signal at the recorded times."""
        for time, resource in zip(self.time.tolist(), self.resource.tolist(), strict=True):
            yield system.env.at(time, EventKind.SENSE)
            system.broadcast(resource)


@dataclass(frozen=True, eq=False)
class RecordedChannel:
    """A channel whose copies arrive when they have arrived, and are lost where they were lost."""

    arrival: Mapping[tuple[int, int], FloatArray]  # by resource and number: (n,), inf where none arrived
    second: Mapping[tuple[int, int], FloatArray]

    def open(self, n_agents: int, keys: Mapping[Purpose, Key]) -> Link:
        """Begin a run: the record is the same in all."""
        del n_agents, keys
        return self

    def transmit(self, broadcast: Broadcast, departure: float) -> Copies:
        """Look up when copies arrive."""
        place = broadcast.resource, broadcast.number
        # Clocks of two hosts may differ by a little, and nothing arrives before it has left.
        return Copies(*(np.maximum(kind[place], departure) for kind in (self.arrival, self.second)))


@dataclass(frozen=True, eq=False)
class LateChannel:
    """The channel of a scenario, with what sockets and processes have added to each copy."""

    channel: Any
    extra: tuple[FloatArray, ...]  # of each resource (numbers, n), at least one row

    def open(self, n_agents: int, keys: Mapping[Purpose, Key]) -> Link:
        """Begin a run."""
        return _LateLink(served_link(self.channel.open(n_agents, keys)), self.extra)


@dataclass(frozen=True, eq=False)
class _LateLink:
    link: CompiledLink
    extra: tuple[FloatArray, ...]

    def transmit(self, broadcast: Broadcast, departure: float) -> Copies:
        """Draw, and add what was measured at the signal of the same number."""
        copies = self.link.draw(broadcast, departure)
        self.link.keep_order(copies)
        rows = self.extra[broadcast.resource]
        late = rows[broadcast.number % len(rows)]
        second = copies.second
        return Copies(copies.arrival + late, None if second is None else second + late)


@dataclass(frozen=True, eq=False)
class Replay:
    """An emulation and three simulations of it."""

    real: Result  # over sockets
    plain: Result  # the scenario, simulated
    # The same with the lateness of unit, network and agents, as measured at the signals of the same number.
    late: Result
    replayed: Result  # with the recorded signals and arrivals, agent by agent

    def table(self) -> pd.DataFrame:
        """Put the four side by side: a row for each measure and resource, and distances of averages."""
        runs = {"emulated": self.real, "replayed": self.replayed, "late": self.late, "plain": self.plain}
        measures = {
            name: run.measures(names=["signals", "responses", "utilisation", "misallocation"])
            for name, run in runs.items()
        }
        for name, run in runs.items():
            measures[name]["distance"] = self.distance(run)
        names = self.real.problem.resource_names
        return pd.DataFrame(
            [
                {
                    "measure": measure,
                    "resource": resource,
                    **{name: measures[name][measure][j] for name in runs},
                }
                for measure in measures["emulated"]
                for j, resource in enumerate(names)
            ]
        )

    def distance(self, run: Result) -> FloatArray:
        """Compare averages at the end with those of the emulation, (m,): over the sum of these."""
        real = self.real.average_at_end
        return np.asarray(np.abs(run.average_at_end - real).sum(axis=0) / real.sum(axis=0))

    def words(self) -> list[str]:
        """Say in sentences what still differs, and why."""
        other = int(np.abs(self.real.account.responses - self.replayed.account.responses).sum())
        apart = float(self.distance(self.replayed).max())
        said = [f"With the recorded signals and arrivals {_same(other, apart)}"]
        used = self.real.measures(names=["utilisation"])["utilisation"]
        gaps = {
            name: float(np.abs(run.measures(names=["utilisation"])["utilisation"] - used).mean())
            for name, run in (("plain", self.plain), ("late", self.late))
        }
        said.append(
            f"The use of capacity differs by {gaps['plain']:.4f} from the plain simulation, in the mean over "
            f"the resources, and by {gaps['late']:.4f} from that with the measured lateness"
        )
        said.append(_parting(self.real, self.plain))
        return said


def _same(other: int, distance: float) -> str:
    if other == 0 and distance < 1e-9:
        return f"all answers are the same: averages differ by {distance:.1e} of their sum, which is rounding"
    return f"{other} responses are others, and averages differ by {distance:.2g} of their sum"


def _parting(real: Result, plain: Result) -> str:
    """Say until when both signal for the same resource about the same time."""
    ours, theirs = real.signals_sent, plain.signals_sent
    both = min(len(ours.time), len(theirs.time))
    spacing = real.until / max(len(ours.time), 1)
    apart = np.abs(ours.time[:both] - theirs.time[:both]) > 0.5 * spacing
    parted = np.flatnonzero(apart | (ours.resource[:both] != theirs.resource[:both]))
    if not len(parted):
        return "All signals of both are within half of the mean time between two of them"
    first = int(parted[0])
    return (
        f"The signals of both part at the {first + 1}th of {len(ours.time)}, at time {ours.time[first]:.3g}: "
        "an answer that comes a little later meets another demand, and may go the other way"
    )


def replay(stored: StoredEmulation) -> Replay:
    """Simulate what was emulated, in three ways."""
    setting, measured = stored.setting, stored.measured
    sent = sent_signals(measured.rows, setting.until)
    answered = answers(measured.rows, setting.until)
    recorded = RecordedUnit(sent["time"].copy(), sent["resource"].astype(np.int64))
    arrivals = RecordedChannel(*(_arrivals(stored, sent, answered, copy) for copy in (0, 1)))
    unit = setting.control_unit
    late = _simulated(stored, unit, LateChannel(setting.channel, _extra(stored, sent, answered)))
    real = outcome(setting, measured)
    plain = _simulated(stored, unit, setting.channel)
    return Replay(real, plain, late, _simulated(stored, recorded, arrivals))


def _simulated(stored: StoredEmulation, unit: ControlUnit, channel: Any) -> Result:
    scenario, problem = stored.scenario, stored.setting.problem
    return Simulation(
        problem,
        dynamics="continuous",
        control_unit=unit,
        channel=channel,
        agents=Fleet if problem.n_agents > _FEW else AgentProcess,
        averaging=scenario.averaging.build(),
        response=None if scenario.response is None else scenario.response.build(),
        compensation=None if scenario.compensation is None else scenario.compensation.build(),
        seed=scenario.seed,
        recording=scenario.recording.build(),
    ).run(scenario.until)


def _arrivals(
    stored: StoredEmulation, sent: Rows, answered: Rows, copy: int
) -> dict[tuple[int, int], FloatArray]:
    """Tell when each agent has answered each signal."""
    n = stored.setting.problem.n_agents
    found = {(int(row["resource"]), int(row["number"])): np.full(n, np.inf) for row in sent}
    for row in answered[answered["copy"] == copy]:
        found[int(row["resource"]), int(row["number"])][row["agent"]] = row["time"]
    if copy == 0:
        _still_under_way(stored, sent, found)
    return found


def _still_under_way(
    stored: StoredEmulation, sent: Rows, found: Mapping[tuple[int, int], FloatArray]
) -> None:
    """Let copies that were neither lost nor answered arrive after the end."""
    lost = unheard(stored.setting, stored.measured.rows, sent) & (sent["heard"] > 0.0)[:, None]
    place = {int(sequence): row for row, sequence in enumerate(sent["sequence"])}
    rows = stored.measured.rows
    for row in rows[rows["kind"] == RowKind.LOST]:
        if int(row["sequence"]) in place:
            lost[place[int(row["sequence"])], row["agent"]] = True
    for row, signal in enumerate(sent):
        times = found[int(signal["resource"]), int(signal["number"])]
        times[np.isinf(times) & ~lost[row]] = stored.setting.until


def _extra(stored: StoredEmulation, sent: Rows, answered: Rows) -> tuple[FloatArray, ...]:
    """Tell by how much each copy was later than the scenario makes it, counted from the planned look."""
    n, m = stored.setting.problem.n_agents, stored.setting.problem.n_resources
    planned = sent["due"] + stored.setting.control_unit.sensing_delay
    departure = dict(zip(sent["sequence"].tolist(), planned.tolist(), strict=True))
    numbers = np.bincount(sent["resource"], minlength=m)
    extra = [np.full((max(1, count), n), np.nan) for count in numbers.tolist()]
    for row in answered[answered["copy"] == 0]:
        on_the_way = row["heard"] - departure[int(row["sequence"])]
        extra[row["resource"]][row["number"], row["agent"]] = on_the_way + (row["time"] - row["due"])
    known = np.concatenate([rows.ravel() for rows in extra])
    known = known[~np.isnan(known)]
    # A copy that was not answered is as late as the others are in the mean.
    usual = float(known.mean()) if len(known) else 0.0
    return tuple(np.clip(np.where(np.isnan(rows), usual, rows), 0.0, None) for rows in extra)
