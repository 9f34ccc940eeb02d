"""A process that holds some of the agents: it makes signals late or lost, and lets agents answer."""

import asyncio
import math
import socket
from dataclasses import dataclass, field

from aimd_des.channel import Broadcast
from aimd_des.emulate.agent import Answer
from aimd_des.emulate.framing import Line
from aimd_des.emulate.pacing import Pace
from aimd_des.emulate.records import Row, RowKind, packed
from aimd_des.emulate.served import Emulation, records_losses
from aimd_des.emulate.wire import MeterDatagram, SignalDatagram, meter_datagram, read_signal
from aimd_des.utils import rng
from aimd_des.utils.rng import Purpose
from aimd_des.utils.validation import FloatArray

# Seconds: after how long rows are sent at the latest, how often meters are read across hosts at least, and
# how long datagrams are still waited for after the end.
_FLUSH, _READING, GRACE = 0.02, 0.05, 0.25


@dataclass(frozen=True)
class Heard:
    """A signal on its way to one agent."""

    sequence: int
    resource: int
    number: int
    copy: int
    heard: float
    due: float
    uniform: float


@dataclass
class Meter:
    """Where readings go: memory that the unit shares, or datagrams to it."""

    intercepts: FloatArray  # (m, n): each agent's line, where it was at time 0
    out: socket.socket | None = None
    unit: tuple[str, int] = ("", 0)
    token: str = ""
    process: int = 0
    sequence: int = field(default=0, init=False)

    def read(self) -> None:
        """Send a reading, where memory is not shared; the next one replaces one that is lost."""
        if self.out is not None:
            self.sequence += 1
            sums = tuple(self.intercepts.sum(axis=1).tolist())
            self.out.sendto(
                meter_datagram(MeterDatagram(self.process, self.sequence, sums), self.token), self.unit
            )


class AgentsProcess(asyncio.DatagramProtocol):
    """The agents of one process, and what all of them need of it."""

    def __init__(
        self, setting: Emulation, process: int, pace: Pace, line: Line, meter: Meter, token: str
    ) -> None:
        self.setting, self.process, self.pace, self.line, self.meter = setting, process, pace, line, meter
        self.token = token
        self.indices = setting.agents_of(process)
        self.link = setting.link()
        self.key = setting.keys[Purpose.RESPONSE]
        self.inboxes = {i: asyncio.Queue[Heard]() for i in self.indices}
        self._by_rows = records_losses(self.link)
        self._seen = set[int]()
        self._rows: list[bytes] = []
        self._loop = asyncio.get_running_loop()

    def keep(self, row: Row) -> None:
        """Write a row down; it is sent soon."""
        if not self._rows:
            self._loop.call_later(_FLUSH, self.flush)
        self._rows.append(packed(row))

    def flush(self) -> None:
        """Send the rows that are written."""
        # A frame has a bound, and many agents may answer at once.
        while self._rows:
            some, self._rows = self._rows[:5000], self._rows[5000:]
            self.line.send_rows(b"".join(some))

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Take in a signal: draw what becomes of each agent's copy, as the simulation does."""
        del addr
        now = self.pace.now()
        signal = read_signal(data, self.token)
        if signal is None or not 0 <= signal.resource < self.setting.problem.n_resources:
            return
        about = (self.process, -1, signal.resource, signal.number, signal.sequence)
        if signal.sequence in self._seen:
            self.keep(Row(RowKind.REPEATED, *about, heard=now))
            return
        self._seen.add(signal.sequence)
        self.keep(Row(RowKind.HEARD, *about, heard=now))
        self._deliver(signal, now)

    def _deliver(self, signal: SignalDatagram, now: float) -> None:
        if self._by_rows:
            # Row k of a record is for the k-th signal of the run, also where others were not heard.
            self.link.table.loss.row[:] = signal.sequence
        n = self.setting.problem.n_agents
        copies = self.link.draw(Broadcast(signal.resource, signal.number, now), now)
        self.link.keep_order(copies)
        for copy, arrival in enumerate(copies):
            if arrival is None:
                continue
            uniforms = rng.uniforms(self.key, signal.resource, signal.number, n, copy)
            for i in self.indices:
                due = float(arrival[i])
                if math.isfinite(due):
                    heard = Heard(
                        signal.sequence, signal.resource, signal.number, copy, now, due, float(uniforms[i])
                    )
                    self._loop.call_at(self.pace.clock(due), self.inboxes[i].put_nowait, heard)
                elif copy == 0:
                    about = (self.process, i, signal.resource, signal.number, signal.sequence)
                    self.keep(Row(RowKind.LOST, *about, heard=now))

    async def live(self, index: int) -> None:
        """Be one agent: wait for a signal, answer it, and let its meter know."""
        agent, inbox, until = self.setting.agent(index), self.inboxes[index], self.setting.until
        while True:
            signal = await inbox.get()
            time = self.pace.now()
            if time >= until:
                return
            answer = agent.answer(signal.resource, time, signal.uniform)
            slope = agent.holdings[signal.resource].increase
            self.meter.intercepts[signal.resource, index] = answer.after - slope * time
            if answer.responded:
                self.meter.read()
            self.keep(_answered(self.process, index, signal, time, answer))

    async def run(self) -> None:
        """Let all agents live until the end, and hear a little longer."""
        tasks = [asyncio.create_task(self.live(i)) for i in self.indices]
        end = self.pace.clock(self.setting.until) + GRACE
        tasks.append(asyncio.create_task(self._keep_reading(end)))
        # An agent that fails ends the process, and so the run: its error is not to be overlooked.
        done, late = await asyncio.wait(
            tasks, return_when=asyncio.FIRST_EXCEPTION, timeout=end - self._loop.time()
        )
        for task in done:
            task.result()
        for task in late:
            task.cancel()
        self.flush()

    async def _keep_reading(self, end: float) -> None:
        """Send readings until the end, so that a lost one is replaced."""
        while (left := end - self._loop.time()) > 0.0:
            self.meter.read()
            await asyncio.sleep(left if self.meter.out is None else min(_READING, left))


def _answered(process: int, index: int, signal: Heard, time: float, answer: Answer) -> Row:
    return Row(
        RowKind.ANSWER,
        process,
        index,
        signal.resource,
        signal.number,
        signal.sequence,
        signal.copy,
        int(answer.responded) + 2 * int(answer.saturated),
        signal.heard,
        signal.due,
        time,
        answer.before,
        answer.after,
        answer.state,
        answer.probability,
    )
