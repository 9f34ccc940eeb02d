"""What the processes of an emulation do from fork to end: they connect, wait for the start, and run.

A process ends when its work is done, or as soon as its connection to the conductor is gone, for any reason:
nothing is left running.
"""

import asyncio
import gc
import os
import signal
import socket
import time
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aimd_des.emulate.agents_process import AgentsProcess, Meter
from aimd_des.emulate.framing import NONCE, BrokenFrameError, Line, derived
from aimd_des.emulate.pacing import Pace, fine_loop
from aimd_des.emulate.served import Emulation
from aimd_des.emulate.unit_process import MeterReadings, UnitProcess
from aimd_des.emulate.wire import Group, group_receiver, receiver_at, sender
from aimd_des.utils.validation import FloatArray

# Round trips by which the clock of another host is read: the shortest of them counts.
_ROUND_TRIPS = 20

#: Exit codes of a process.
DONE, FAILED, REFUSED, LEFT_ALONE = 0, 1, 2, 3


class RefusedError(Exception):
    """The conductor does not take a process in."""


@dataclass(frozen=True)
class Local:
    """What a process of the conductor's own machine is given at its fork."""

    setting: Emulation
    token: str  # of datagrams
    intercepts: FloatArray  # (m, n), shared by all processes: lines of demand, where they were at time 0
    connection: socket.socket
    group: Group | None


def forked(main: Callable[[Any], Awaitable[None]], given: Any, foreign: Sequence[socket.socket]) -> None:
    """Live as a forked process; never returns."""
    # Ctrl-C is the conductor's business: it reaches all processes of a terminal at once.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for connection in foreign:
        connection.close()
    # A collection at the wrong moment makes answers late, and there is little to collect.
    gc.freeze()
    gc.disable()
    code = FAILED
    try:
        loop = fine_loop()
        asyncio.set_event_loop(loop)
        loop.run_until_complete(main(given))
        code = DONE
    except (EOFError, ConnectionError):
        code = LEFT_ALONE
    except RefusedError:
        code = REFUSED
    finally:
        os._exit(code)


async def _working(line: Line, work: Awaitable[None]) -> None:
    """Work as long as the conductor is there; tell it of a failure."""
    listening = asyncio.ensure_future(line.hear())
    working = asyncio.ensure_future(work)
    try:
        await asyncio.wait({listening, working}, return_when=asyncio.FIRST_COMPLETED)
        if not working.done():
            raise EOFError
        working.result()
        line.say(done=True)
        await line.drain()
        await listening  # until the conductor hangs up: what was sent has then been read
    except (EOFError, ConnectionError, BrokenFrameError):
        if not working.done():
            raise
    finally:
        listening.cancel()
        working.cancel()


def _words(failure: BaseException) -> str:
    if isinstance(failure, BaseExceptionGroup):
        return _words(failure.exceptions[0])
    return f"{type(failure).__name__}: {failure}"


async def told(line: Line, work: Awaitable[None]) -> None:
    """Do work, and tell the conductor why it has failed."""
    try:
        await work
    except (EOFError, ConnectionError, BrokenFrameError):
        raise EOFError from None
    except Exception as failure:
        line.say(failed=_words(failure))
        await line.drain()
        raise


async def local_agents(process: int, own: Local) -> None:
    """Hold agents on the conductor's own machine."""
    line = await Line.over(own.connection, own.token)
    await told(line, _local_agents(own, process, line))


async def _local_agents(own: Local, process: int, line: Line) -> None:
    receiver = receiver_at("127.0.0.1") if own.group is None else group_receiver(own.group)
    line.say(ready=True, port=receiver.getsockname()[1])
    start = (await line.hear())["start"]
    pace, meter = Pace(start, own.setting.unit), Meter(own.intercepts)
    await _live(AgentsProcess(own.setting, process, pace, line, meter, own.token), receiver, line)


async def _live(agents: AgentsProcess, receiver: socket.socket, line: Line) -> None:
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(lambda: agents, sock=receiver)
    try:
        await _working(line, agents.run())
    finally:
        transport.close()


async def local_unit(readings: tuple[str, int] | None, own: Local) -> None:
    """Be the control unit; with an address, readings of meters on other hosts are heard there."""
    line = await Line.over(own.connection, own.token)
    await told(line, _local_unit(own, readings, line))


async def _local_unit(own: Local, readings: tuple[str, int] | None, line: Line) -> None:
    intercepts = own.intercepts
    if readings is not None:
        intercepts = np.zeros((own.setting.problem.n_resources, own.setting.processes))
        receiver, loop = receiver_at(*readings), asyncio.get_running_loop()
        await loop.create_datagram_endpoint(lambda: MeterReadings(intercepts, own.token), sock=receiver)
    line.say(ready=True)
    said = await line.hear()
    receivers = [(address, port) for address, port in said["receivers"]]
    out = sender("127.0.0.1" if readings is None else readings[0])
    pace = Pace(said["start"], own.setting.unit)
    await _working(line, UnitProcess(own.setting, pace, line, out, receivers, intercepts, own.token).run())


async def clock_offset(line: Line) -> tuple[float, float]:
    """Read the conductor's clock: by how much it is ahead of ours, and how uncertain that is, in seconds."""
    best, offset = float("inf"), 0.0
    for _ in range(_ROUND_TRIPS):
        before = time.monotonic()
        line.say(clock=True)
        there = (await line.hear())["clock"]
        after = time.monotonic()
        if after - before < best:
            best, offset = after - before, there - 0.5 * (before + after)
    return offset, 0.5 * best


@dataclass(frozen=True)
class Remote:
    """What a process on another host is given at its fork."""

    setting: Emulation  # but for the unit and the number of processes, which the conductor says
    token: str  # as the user gave it
    digest: str  # of the scenario, which must be the conductor's
    conductor: tuple[str, int]
    above: socket.socket  # to the command that has forked it: it ends with that, and complains to it

    def complain(self, sentence: str) -> None:
        """Tell the command what went wrong."""
        self.above.setblocking(True)
        self.above.sendall(f"{sentence}\n".encode())


async def remote_agents(plan: Remote) -> None:
    """Hold agents on another host than the conductor's."""
    plan.above.setblocking(False)
    asyncio.get_running_loop().add_reader(plan.above, os._exit, LEFT_ALONE)
    where = "{}:{}".format(*plan.conductor)
    try:
        await _remote_agents(plan)
    except (EOFError, ConnectionResetError, BrokenFrameError):
        plan.complain(f"{where}: has hung up before the end; does it have the same token?")
        raise EOFError from None
    except OSError as failure:
        plan.complain(f"{where}: cannot be joined ({failure.strerror or failure})")
        raise EOFError from None


async def _remote_agents(plan: Remote) -> None:
    reader, writer = await asyncio.open_connection(*plan.conductor)
    line = Line(reader, writer, derived(plan.token, await reader.readexactly(NONCE)))
    receiver = receiver_at(writer.get_extra_info("sockname")[0])
    line.say(hello=plan.digest, port=receiver.getsockname()[1])
    welcome = await line.hear()
    if "refused" in welcome:
        plan.complain(str(welcome["refused"])[:1000])
        raise RefusedError
    process = int(welcome["process"])
    setting = replace(plan.setting, processes=int(welcome["processes"]), unit=float(welcome["unit"]))
    await told(line, _remote_life(setting, process, line, receiver, plan.conductor, str(welcome["token"])))


async def _remote_life(
    setting: Emulation,
    process: int,
    line: Line,
    receiver: socket.socket,
    conductor: tuple[str, int],
    token: str,
) -> None:
    await line.hear()  # all are there, and the conductor answers at once
    offset, error = await clock_offset(line)
    line.say(ready=True, offset=offset, error=error)
    pace = Pace((await line.hear())["start"] - offset, setting.unit)
    intercepts = np.zeros((setting.problem.n_resources, setting.problem.n_agents))
    out = sender(receiver.getsockname()[0])
    meter = Meter(intercepts, out, conductor, token, process)
    await _live(AgentsProcess(setting, process, pace, line, meter, token), receiver, line)
