"""Messages between the conductor of an emulation and its processes: over a pair of sockets, or over TCP.

A frame is its length, what it is, and what it says.  Each carries a mark made of the token and of its place,
so that nothing else is accepted.  When a connection ends, the process at its other end stops.
"""

import asyncio
import hmac
import json
import socket
import struct
from hashlib import blake2b
from typing import Any

_HEAD = struct.Struct("!IcQ")
_MARK = 16

#: What a frame says: a JSON object, or rows of records.
WORDS, ROWS_OF = b"J", b"R"

#: A longer frame is not read.
LONGEST_FRAME = 1 << 20


#: Bytes by which the conductor makes the frames of a connection, and the datagrams of a run, its own.
NONCE = 16


def derived(token: str, nonce: bytes) -> str:
    """Make a token for one connection, or one run: what was recorded of another one is not accepted."""
    return blake2b(nonce, key=token.encode()[:64], digest_size=_MARK).hexdigest()


class BrokenFrameError(Exception):
    """What arrives is no frame made with the token."""


def _mark(token: str, kind: bytes, place: int, content: bytes) -> bytes:
    digest = blake2b(_HEAD.pack(len(content), kind, place), key=token.encode()[:64], digest_size=_MARK)
    digest.update(content)
    return digest.digest()


class Framer:
    """Writes and reads the frames of one connection, in order."""

    def __init__(self, token: str) -> None:
        self.token = token
        self._written, self._read, self._held = 0, 0, b""

    def frame(self, kind: bytes, content: bytes) -> bytes:
        """Write a frame."""
        place, self._written = self._written, self._written + 1
        return _HEAD.pack(len(content), kind, place) + _mark(self.token, kind, place, content) + content

    def words(self, **said: Any) -> bytes:
        """Write a frame of words."""
        return self.frame(WORDS, json.dumps(said).encode())

    def feed(self, received: bytes) -> list[tuple[bytes, bytes]]:
        """Take in bytes; return the frames that are complete, as kind and content."""
        self._held += received
        found = []
        start = _HEAD.size + _MARK
        while len(self._held) >= start:
            length, kind, place = _HEAD.unpack_from(self._held)
            if length > LONGEST_FRAME or kind not in (WORDS, ROWS_OF) or place != self._read:
                raise BrokenFrameError
            if len(self._held) < start + length:
                break
            content = self._held[start : start + length]
            if not hmac.compare_digest(
                self._held[_HEAD.size : start], _mark(self.token, kind, place, content)
            ):
                raise BrokenFrameError
            self._held, self._read = self._held[start + length :], self._read + 1
            found.append((kind, content))
        return found


def read_words(content: bytes) -> dict[str, Any]:
    """Read what a frame of words says."""
    try:
        said = json.loads(content)
    except ValueError:
        raise BrokenFrameError from None
    if not isinstance(said, dict):
        raise BrokenFrameError
    return said


class Line:
    """A process's end of its connection to the conductor, for asyncio."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, token: str) -> None:
        self._reader, self._writer, self._framer = reader, writer, Framer(token)
        self._waiting: list[tuple[bytes, bytes]] = []

    @classmethod
    async def over(cls, connection: socket.socket, token: str) -> "Line":
        """Take over a connected socket."""
        connection.setblocking(False)
        return cls(*await asyncio.open_connection(sock=connection), token)

    def say(self, **said: Any) -> None:
        """Send words."""
        self._writer.write(self._framer.words(**said))

    def send_rows(self, rows: bytes) -> None:
        """Send rows of records."""
        self._writer.write(self._framer.frame(ROWS_OF, rows))

    async def hear(self) -> dict[str, Any]:
        """Wait for words; raises `EOFError` when the conductor is gone."""
        while not self._waiting:
            received = await self._reader.read(LONGEST_FRAME)
            if not received:
                raise EOFError
            self._waiting += self._framer.feed(received)
        return read_words(self._waiting.pop(0)[1])

    async def drain(self) -> None:
        """Wait until all that was said is on its way."""
        await self._writer.drain()
