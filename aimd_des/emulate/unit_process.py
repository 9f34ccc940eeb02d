"""The process of the control unit: it reads the meters, and sends one datagram for each signal."""

import asyncio
import socket
from collections.abc import Sequence
from contextlib import suppress

from aimd_des.emulate.framing import Line
from aimd_des.emulate.pacing import Pace
from aimd_des.emulate.records import Row, RowKind, packed
from aimd_des.emulate.served import Emulation
from aimd_des.emulate.wire import SignalDatagram, read_meter, signal_datagram
from aimd_des.engine.control_unit import Sampled
from aimd_des.utils.validation import FloatArray


class MeterReadings(asyncio.DatagramProtocol):
    """Takes in what meters on other hosts send: the latest of each counts."""

    def __init__(self, intercepts: FloatArray, token: str) -> None:
        self.intercepts, self.token = intercepts, token
        self._latest = [0] * intercepts.shape[1]

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Take in a reading."""
        del addr
        reading = read_meter(data, self.token, len(self.intercepts))
        if reading is None or reading.process >= len(self._latest):
            return
        if reading.sequence > self._latest[reading.process]:
            self._latest[reading.process] = reading.sequence
            self.intercepts[:, reading.process] = reading.intercepts


class UnitProcess:
    """The control unit of an emulation."""

    def __init__(
        self,
        setting: Emulation,
        pace: Pace,
        line: Line,
        out: socket.socket,
        receivers: Sequence[tuple[str, int]],
        intercepts: FloatArray,
        token: str,
    ) -> None:
        self.setting, self.pace, self.line, self.out = setting, pace, line, out
        self.receivers, self.intercepts, self.token = receivers, intercepts, token
        problem = setting.problem
        self.growth: list[float] = problem.increase.sum(axis=0).tolist()
        self.limit: list[float] = problem.limit.tolist()
        self.numbers = [0] * problem.n_resources
        self.sequence = 0

    def total(self, resource: int, time: float) -> float:
        """Read the meters: where the lines of all agents are now."""
        return float(self.intercepts[resource].sum()) + self.growth[resource] * time

    async def signal(self, resource: int, planned: float, time: float, total: float) -> None:
        """Send a signal after the sensing delay, and write it down."""
        number, sequence = self.numbers[resource], self.sequence
        self.numbers[resource] += 1
        self.sequence += 1
        departure = time + self.setting.control_unit.sensing_delay
        if departure < self.setting.until:
            if departure > time:
                await self.pace.reach(departure)
            datagram = signal_datagram(SignalDatagram(sequence, resource, number), self.token)
            departure = self.pace.now()
            for receiver in self.receivers:
                with suppress(OSError):  # what cannot be sent is lost, and found missing
                    self.out.sendto(datagram, receiver)
        about = (RowKind.SENT, 0, -1, resource, number, sequence)
        row = Row(*about, heard=departure, due=planned, time=time, before=total, after=self.limit[resource])
        self.line.send_rows(packed(row))

    async def run(self) -> None:
        """Look until the end."""
        unit, until = self.setting.control_unit, self.setting.until
        async with asyncio.TaskGroup() as tasks:
            if isinstance(unit, Sampled):
                tasks.create_task(self._look(unit, until, tasks))
            else:
                for resource in range(self.setting.problem.n_resources):
                    tasks.create_task(self._sense(resource, unit.hold_off, until, tasks))

    async def _look(self, unit: Sampled, until: float, tasks: asyncio.TaskGroup) -> None:
        """Look at the times of a clock."""
        look = 0
        while (planned := unit.phase + look * unit.period) < until:
            await self.pace.reach(planned)
            time = self.pace.now()
            totals = [self.total(j, time) for j in range(len(self.limit))]
            for resource, total in enumerate(totals):
                if time < until and total > self.limit[resource]:
                    tasks.create_task(self.signal(resource, planned, time, total))
            look += 1

    async def _sense(self, resource: int, hold_off: float, until: float, tasks: asyncio.TaskGroup) -> None:
        """Wait for the threshold, signal, and hold off."""
        limit, growth, free = self.limit[resource], self.growth[resource], 0.0
        await self.pace.reach(0.0)
        while (time := self.pace.now()) < until:
            total = self.total(resource, time)
            if total < limit:
                # Answers only lower the total: it can be there no sooner.
                await self.pace.reach(min(until, time + (limit - total) / growth))
                continue
            planned = max(free, time - (total - limit) / growth)
            tasks.create_task(self.signal(resource, planned, time, total))
            # From the crossing, as in a simulation: what makes the unit late adds nothing to the hold-off.
            free = planned + hold_off
            await self.pace.reach(free)
