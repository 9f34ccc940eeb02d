"""An emulation over several hosts: one listens, and processes with agents join it from the others.

Nothing is accepted that was not made with the token that the user has given to all of them.
"""

import hashlib
import secrets
import selectors
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from aimd_des.emulate.conductor import Conductor, Member, fork, shared_array
from aimd_des.emulate.framing import NONCE, BrokenFrameError, Framer, derived, read_words
from aimd_des.emulate.members import DONE, REFUSED, Remote, local_unit, remote_agents
from aimd_des.emulate.served import Emulation
from aimd_des.emulate.wire import receiver_at
from aimd_des.utils.errors import InputError, SimulationError

_SHORTEST_TOKEN, _LONGEST_TOKEN = 8, 64

# Of connections that have not shown the token yet: seconds, bytes, and how many.
_PATIENCE, _LONGEST_HELLO, _MOST_WAITING = 5.0, 4096, 64


def check_token(token: str | None) -> str:
    """Refuse a token that is missing, or too short to be one."""
    if token is None or not _SHORTEST_TOKEN <= len(token.encode()) <= _LONGEST_TOKEN:
        allowed = f"{_SHORTEST_TOKEN} to {_LONGEST_TOKEN} bytes long, and the same on all hosts"
        remedy = "set the variable AIMD_DES_TOKEN, or say --token"
        # Not shown: it is a secret.
        raise InputError.of("length of the token", len((token or "").encode()), allowed, remedy)
    return token


def digest_of(setting: Emulation) -> str:
    """Give by what hosts see that they run the same scenario."""
    return hashlib.sha256(setting.scenario.canonical()).hexdigest()


@dataclass(eq=False)
class _Waiting:
    """A connection that has not shown the token yet."""

    connection: socket.socket
    framer: Framer
    address: str
    since: float = field(default_factory=time.monotonic)
    received: int = 0


class Listener(Conductor):
    """Conducts processes that join from other hosts: over TCP, with the readings of meters over UDP."""

    def __init__(
        self,
        setting: Emulation,
        address: tuple[str, int],
        token: str,
        watch: Callable[[float], None] | None = None,
    ) -> None:
        super().__init__(setting, "unicast", watch)
        self.address, self.secret = address, token
        self.token = derived(token, secrets.token_bytes(NONCE))
        self.digest = digest_of(setting)
        try:
            receiver_at(*address).close()  # the unit's, which opens it again
            self._server = socket.create_server(address)
        except OSError as failure:
            where = "{}:{}".format(*address)
            allowed = f"a free address of this machine ({failure.strerror})"
            raise InputError.of("listen", where, allowed, "choose another port") from None

    def gather(self) -> None:
        """Wait until enough processes have joined, then start the control unit."""
        self.setting.prepare()
        waiting: dict[socket.socket, _Waiting] = {}
        self._server.setblocking(False)
        try:
            with selectors.DefaultSelector() as selector:
                selector.register(self._server, selectors.EVENT_READ)
                while len(self.members) < self.setting.processes:
                    for key, _ in selector.select(0.2):
                        if key.fileobj is self._server:
                            self._accept(selector, waiting)
                        elif self._admitted(waiting[key.fileobj]):  # type: ignore[index]  # it is a socket
                            selector.unregister(key.fileobj)
                            waiting.pop(key.fileobj)  # type: ignore[call-overload]
                    self._weed(selector, waiting)
                    # Those that are in already may have ended.
                    self._hear(0.0)
        finally:
            self._server.close()
            for one in waiting.values():
                one.connection.close()
        for member in self.members:
            self.say(member, gathered=True)
        intercepts = shared_array(1, 1)  # the unit has readings in its place
        self.start("the process of the control unit", intercepts, partial(local_unit, self.address))

    def _accept(self, selector: selectors.BaseSelector, waiting: dict[socket.socket, _Waiting]) -> None:
        with suppress(OSError):
            connection, (address, _) = self._server.accept()
            if len(waiting) >= _MOST_WAITING:
                connection.close()
                return
            nonce = secrets.token_bytes(NONCE)
            connection.sendall(nonce)
            connection.setblocking(False)
            waiting[connection] = _Waiting(connection, Framer(derived(self.secret, nonce)), address)
            selector.register(connection, selectors.EVENT_READ)

    def _admitted(self, one: _Waiting) -> bool:
        """Take in what a connection says; whether it need not be waited for any more."""
        try:
            received = one.connection.recv(_LONGEST_HELLO)
            one.received += len(received)
            frames = one.framer.feed(received) if received and one.received <= _LONGEST_HELLO else None
            if frames == []:
                return False
            if frames is None:
                raise BrokenFrameError
            said = read_words(frames[0][1])
            self._answer(one, str(said["hello"]), int(said["port"]))
        except (OSError, BrokenFrameError, KeyError, ValueError, TypeError):
            one.connection.close()
        return True

    def _answer(self, one: _Waiting, digest: str, port: int) -> None:
        if digest != self.digest:
            words = "the scenario there is another one: give all hosts the same file, seed and settings"
            one.connection.sendall(one.framer.words(refused=words))
            one.connection.close()
            return
        process = len(self.members)
        if process >= self.setting.processes:  # more have come at once than were waited for
            one.connection.sendall(one.framer.words(refused="enough processes have joined already"))
            one.connection.close()
            return
        own = self.setting.agents_of(process)
        name = f"the process of agents {own[0]} to {own[-1]} at {one.address}"
        member = Member(name, one.connection, one.framer, one.address, port)
        self.take(member)
        welcome = {"process": process, "processes": self.setting.processes, "unit": self.setting.unit}
        self.say(member, **welcome, token=self.token)

    def _weed(self, selector: selectors.BaseSelector, waiting: dict[socket.socket, _Waiting]) -> None:
        """Close connections that say nothing."""
        late = time.monotonic() - _PATIENCE
        for connection in [connection for connection, one in waiting.items() if one.since < late]:
            selector.unregister(connection)
            waiting.pop(connection).connection.close()


def join(setting: Emulation, address: tuple[str, int], token: str, processes: int) -> None:
    """Let processes of this machine hold agents of an emulation that another host conducts."""
    setting.prepare()
    digest, ours = digest_of(setting), list[socket.socket]()
    forks: list[Any] = []
    try:
        for _ in range(processes):
            mine, theirs = socket.socketpair()
            ours.append(mine)
            forks.append(fork(remote_agents, Remote(setting, token, digest, address, theirs), list(ours)))
            theirs.close()
        for process in forks:
            process.join()
        complaints = [_read(mine) for mine in ours]
        wrong = [process.exitcode for process in forks if process.exitcode != DONE]
    finally:
        for process in forks:
            process.kill()
            process.join()
        for mine in ours:
            mine.close()
    said = next((complaint for complaint in complaints if complaint), "")
    if REFUSED in wrong:
        raise InputError(said)
    if wrong or said:
        raise SimulationError(said or f"a process has ended with exit code {wrong[0]}")


def _read(connection: socket.socket) -> str:
    connection.setblocking(False)
    with suppress(OSError):
        return connection.recv(4096).decode(errors="replace").strip()
    return ""
