"""The conductor of an emulation: it starts the processes, gives the start, and collects what they write down.

A process that has ended, in any way, has closed its connection, and one whose conductor has ended stops
by itself.  If anything stops a run, all processes are ended, and what was collected is kept.
"""

import mmap
import multiprocessing
import selectors
import signal
import socket
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from aimd_des.emulate.agents_process import GRACE
from aimd_des.emulate.framing import LONGEST_FRAME, ROWS_OF, BrokenFrameError, Framer, read_words
from aimd_des.emulate.members import Local, forked, local_agents, local_unit
from aimd_des.emulate.pacing import Pace
from aimd_des.emulate.records import RowKind, read_rows
from aimd_des.emulate.served import Emulation
from aimd_des.emulate.wire import LOOPBACK, find_group, new_token
from aimd_des.utils.errors import InputError, SimulationError
from aimd_des.utils.jit import teach_numba
from aimd_des.utils.validation import FloatArray

# Seconds: until all are ready at the latest, from the start being said to the start, and how often the run is
# looked at.
_PATIENCE, _AHEAD, _LOOK = 60.0, 0.2, 0.1


@dataclass(frozen=True, eq=False)
class Collected:
    """What has been collected."""

    rows: npt.NDArray[Any]  # of `records.ROWS`, of all processes
    reached: float  # up to which time of the run everything is there
    stopped: str  # why it was stopped before its end; empty if it was not
    interrupted: bool  # whether Ctrl-C, or a signal to end, was the reason
    transport: str  # how signals went: "multicast" or "unicast"
    # Of each process on another host: how far the conductor's clock was ahead, and how uncertain that is, in
    # seconds.
    offsets: tuple[tuple[float, float], ...] = ()


@dataclass(eq=False)
class Member:
    """A process, as the conductor sees it."""

    name: str
    connection: socket.socket
    framer: Framer
    address: str = LOOPBACK
    port: int = 0
    ready: bool = False
    done: bool = False
    offset: tuple[float, float] | None = None
    rows: bytearray = field(default_factory=bytearray)


class _EndedError(Exception):
    """A process has ended, or says that it has failed."""


class Conductor:
    """Runs an emulation on this machine; signals go as one datagram for all processes, or one for each."""

    def __init__(
        self, setting: Emulation, transport: str = "auto", watch: Callable[[float], None] | None = None
    ) -> None:
        self.setting, self.watch = setting, watch or (lambda time: None)
        self.group = None if transport == "unicast" else find_group()
        if transport == "multicast" and self.group is None:
            allowed = "'auto' or 'unicast': multicast does not work on the loopback of this system"
            raise InputError.of("transport", transport, allowed)
        self.token = new_token()
        self.members: list[Member] = []
        self.started: float | None = None
        self._processes: list[multiprocessing.process.BaseProcess] = []
        self._selector = selectors.DefaultSelector()

    def run(self) -> Collected:
        """Run to the end, or as far as it goes."""
        stopped, interrupted, ended = "", False, None
        with _asked_to_end():
            try:
                self.gather()
                self._begin()
                self._collect()
            except _EndedError as end:
                stopped, ended = str(end), time.monotonic()
            except KeyboardInterrupt:
                stopped, interrupted, ended = "it was interrupted", True, time.monotonic()
            finally:
                self._end()
        return self._measured(stopped, interrupted, ended)

    def gather(self) -> None:
        """Start all processes, of which the last is the control unit."""
        self.setting.prepare()
        intercepts = shared_array(self.setting.problem.n_resources, self.setting.problem.n_agents)
        for process in range(self.setting.processes):
            own = self.setting.agents_of(process)
            name = f"the process of agents {own[0]} to {own[-1]}"
            self.start(name, intercepts, partial(local_agents, process))
        self.start("the process of the control unit", intercepts, partial(local_unit, None))

    def start(self, name: str, intercepts: FloatArray, main: Callable[[Local], Any]) -> None:
        """Fork a process that is connected to this one."""
        ours, theirs = socket.socketpair()
        # Else the ends that a process inherits would keep the connections of others open.
        foreign = [ours, *(member.connection for member in self.members)]
        local = Local(self.setting, self.token, intercepts, theirs, self.group)
        process = fork(main, local, foreign)
        theirs.close()
        self._processes.append(process)
        self.take(Member(name, ours, Framer(self.token)))

    def take(self, member: Member) -> None:
        """Listen to a process."""
        member.connection.setblocking(False)
        self.members.append(member)
        self._selector.register(member.connection, selectors.EVENT_READ, member)

    def _begin(self) -> None:
        """Wait until all are ready, and say when the run begins."""
        patience = time.monotonic() + _PATIENCE
        while not all(member.ready for member in self.members):
            if time.monotonic() > patience:
                late = next(member.name for member in self.members if not member.ready)
                raise _EndedError(f"{late} was not ready after {_PATIENCE:g} s")
            self._hear(_LOOK)
        self.started = time.monotonic() + _AHEAD
        *agents, unit = self.members
        receivers = [(member.address, member.port) for member in agents]
        if self.group is not None:
            receivers = [(self.group.address, self.group.port)]
        for member in agents:
            self.say(member, start=self.started)
        self.say(unit, start=self.started, receivers=receivers)

    def _collect(self) -> None:
        """Read what the processes write down, until all are done."""
        pace = Pace(self.started or 0.0, self.setting.unit)
        patience = pace.clock(self.setting.until) + GRACE + _PATIENCE
        while not all(member.done for member in self.members):
            if time.monotonic() > patience:
                late = next(member.name for member in self.members if not member.done)
                raise _EndedError(f"{late} has not come to its end")
            self._hear(_LOOK)
            self.watch(min(max(pace.now(), 0.0), self.setting.until))

    def say(self, member: Member, **said: Any) -> None:
        """Send words to a process."""
        member.connection.setblocking(True)
        try:
            member.connection.sendall(member.framer.words(**said))
        except OSError:
            raise _EndedError(f"{member.name} has ended") from None
        finally:
            member.connection.setblocking(False)

    def _hear(self, patience: float) -> None:
        """Take in what has arrived."""
        for key, _ in self._selector.select(patience):
            member: Member = key.data
            try:
                received = member.connection.recv(LONGEST_FRAME)
                frames = member.framer.feed(received)
            except (OSError, BrokenFrameError):
                received, frames = b"", []
            for kind, content in frames:
                if kind == ROWS_OF:
                    member.rows += content
                else:
                    self._heard(member, read_words(content))
            if not received:
                raise _EndedError(f"{member.name} has ended before the run has")

    def _heard(self, member: Member, said: dict[str, Any]) -> None:
        if "failed" in said:
            raise _EndedError(f"{member.name} has failed ({str(said['failed'])[:500]})")
        if "clock" in said:
            self.say(member, clock=time.monotonic())
        if "ready" in said:
            member.ready, member.port = True, int(said.get("port", member.port))
            if "offset" in said:
                member.offset = float(said["offset"]), float(said["error"])
        if "done" in said:
            member.done = True

    def _end(self) -> None:
        """End all processes, and wait until they are gone."""
        self._selector.close()
        for member in self.members:
            # What is still in there was written before the end.
            _rest(member)
            member.connection.close()
        for process in self._processes:
            process.kill()
        for process in self._processes:
            process.join()
            process.close()

    def _measured(self, stopped: str, interrupted: bool, ended: float | None) -> Collected:
        reached = self.setting.until
        if ended is not None:
            begun = self.started is not None
            now = Pace(self.started or 0.0, self.setting.unit)
            # What was written last may not have been sent yet.
            reached = min(reached, (ended - 0.1 - now.start) / now.unit) if begun else 0.0
        content = b"".join(bytes(member.rows) for member in self.members)
        if ended is not None and reached <= 0.0:
            if interrupted:
                raise KeyboardInterrupt
            raise SimulationError(f"the emulation has not begun: {stopped}")
        offsets = tuple(member.offset for member in self.members if member.offset is not None)
        how = "unicast" if self.group is None else "multicast"
        return Collected(
            sound_rows(read_rows(content), self.setting), reached, stopped, interrupted, how, offsets
        )


def sound_rows(rows: npt.NDArray[Any], setting: Emulation) -> npt.NDArray[Any]:
    """Leave out rows that are about nothing that there is."""
    places = (("process", 0, setting.processes), ("resource", 0, setting.problem.n_resources))
    kept = rows["kind"] <= max(RowKind)
    for name, low, high in (*places, ("agent", -1, setting.problem.n_agents), ("copy", 0, 2)):
        kept &= (rows[name] >= low) & (rows[name] < high)
    return rows[kept]


def _rest(member: Member) -> None:
    try:
        while received := member.connection.recv(LONGEST_FRAME):
            for kind, content in member.framer.feed(received):
                if kind == ROWS_OF:
                    member.rows += content
    except (OSError, BrokenFrameError):
        return


def fork(main: Callable[[Any], Any], given: Any, foreign: Sequence[socket.socket]) -> Any:
    """Start a process that has all that this one has, at once."""
    teach_numba()  # which takes half a second to import: a process would be late with what it calls first
    context = multiprocessing.get_context("fork")
    process = context.Process(target=forked, args=(main, given, foreign), daemon=True)
    with warnings.catch_warnings():
        # Newer versions of Python warn of any other thread, such as those of libraries for linear algebra.
        warnings.simplefilter("ignore", DeprecationWarning)
        process.start()
    return process


def shared_array(rows: int, columns: int) -> FloatArray:
    """Make memory that processes which are forked later share with this one."""
    # One number for each line: it is written in one piece, so that no reader finds half of it.
    memory = mmap.mmap(-1, 8 * rows * columns)
    return np.frombuffer(memory, dtype=np.float64).reshape(rows, columns)


@contextmanager
def _asked_to_end() -> Iterator[None]:
    """Take a signal to end as Ctrl-C: what was measured is kept."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only there can handlers be set
        return
    earlier = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, earlier)
