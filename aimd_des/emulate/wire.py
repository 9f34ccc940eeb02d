"""Datagrams: a signal is one of them, with a token's mark, and anything else that arrives is dropped.

Across hosts the readings of meters are datagrams, too.  All go to addresses of this machine unless the user
names another one.
"""

import hmac
import ipaddress
import secrets
import socket
import struct
from dataclasses import dataclass
from hashlib import blake2b
from typing import NamedTuple

from aimd_des.utils.errors import InputError

LOOPBACK = "127.0.0.1"

_SIGNAL = struct.Struct("!4sQII")
_METER = struct.Struct("!4sHQ")
_SIGNAL_MAGIC, _METER_MAGIC = b"aSG1", b"aMR1"
_MARK = 16
_PATIENCE = 0.25  # seconds for a probe on loopback

#: Resources whose readings fit one datagram that no network takes apart.
MOST_RESOURCES = 128

#: No datagram of ours is longer, and more is never read.
LONGEST_DATAGRAM = _METER.size + 8 * MOST_RESOURCES + _MARK


class SignalDatagram(NamedTuple):
    """What a signal says: its resource is the bit, the numbers are the addresses of draws."""

    sequence: int
    resource: int
    number: int


class MeterDatagram(NamedTuple):
    """What the agents of a process hold: the lines of their sums, where they were at time 0."""

    process: int
    sequence: int
    intercepts: tuple[float, ...]  # (m,): in units of the resources


def new_token() -> str:
    """Make a token that cannot be guessed."""
    return secrets.token_hex(16)


def _marked(content: bytes, token: str) -> bytes:
    return content + blake2b(content, key=token.encode()[:64], digest_size=_MARK).digest()


def _unmarked(datagram: bytes, token: str) -> bytes | None:
    """Return what a datagram says, or None if it was not made with the token."""
    if not _MARK < len(datagram) <= LONGEST_DATAGRAM:
        return None
    content = datagram[:-_MARK]
    return content if hmac.compare_digest(_marked(content, token), datagram) else None


def signal_datagram(signal: SignalDatagram, token: str) -> bytes:
    """Write a signal."""
    return _marked(_SIGNAL.pack(_SIGNAL_MAGIC, *signal), token)


def read_signal(datagram: bytes, token: str) -> SignalDatagram | None:
    """Read a signal; None for anything else."""
    content = _unmarked(datagram, token)
    if content is None or len(content) != _SIGNAL.size or not content.startswith(_SIGNAL_MAGIC):
        return None
    return SignalDatagram(*_SIGNAL.unpack(content)[1:])


def meter_datagram(reading: MeterDatagram, token: str) -> bytes:
    """Write a reading."""
    head = _METER.pack(_METER_MAGIC, reading.process, reading.sequence)
    return _marked(head + struct.pack(f"!{len(reading.intercepts)}d", *reading.intercepts), token)


def read_meter(datagram: bytes, token: str, n_resources: int) -> MeterDatagram | None:
    """Read a reading of m resources; None for anything else."""
    content = _unmarked(datagram, token)
    if content is None or len(content) != _METER.size + 8 * n_resources:
        return None
    if not content.startswith(_METER_MAGIC):
        return None
    process, sequence = _METER.unpack_from(content)[1:]
    return MeterDatagram(process, sequence, struct.unpack_from(f"!{n_resources}d", content, _METER.size))


@dataclass(frozen=True)
class Group:
    """A multicast group on loopback, whose datagrams no router passes on."""

    address: str
    port: int


def find_group() -> Group | None:
    """Find a free group and see whether datagrams to it arrive; None where this system has no multicast."""
    # 239.255.0.0/16 is for local use (RFC 2365).
    address = f"239.255.{secrets.randbelow(254) + 1}.{secrets.randbelow(254) + 1}"
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("", 0))
            group = Group(address, probe.getsockname()[1])
        with group_receiver(group) as receiver, sender(LOOPBACK) as out:
            receiver.settimeout(_PATIENCE)
            out.sendto(b"probe", (group.address, group.port))
            return group if receiver.recv(LONGEST_DATAGRAM) == b"probe" else None
    except OSError:
        return None


def group_receiver(group: Group) -> socket.socket:
    """Open a socket that hears a group on loopback, beside others of this machine that do."""
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # Bound to the group itself: what is sent to the port alone does not get in.
        receiver.bind((group.address, group.port))
        member = socket.inet_aton(group.address) + socket.inet_aton(LOOPBACK)
        receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        receiver.setblocking(False)
    except BaseException:
        receiver.close()
        raise
    return receiver


def receiver_at(address: str, port: int = 0) -> socket.socket:
    """Open a socket for datagrams to one address of this machine."""
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        receiver.bind((address, port))
        receiver.setblocking(False)
    except BaseException:
        receiver.close()
        raise
    return receiver


def sender(address: str) -> socket.socket:
    """Open a socket to send from, for which multicast goes to loopback and no further."""
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
    out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
    out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(LOOPBACK))
    out.bind((address, 0))
    out.setblocking(False)
    return out


def parsed_address(field: str, text: str) -> tuple[str, int]:
    """Read ADDRESS:PORT, of a private network or of this machine."""
    allowed = (
        "ADDRESS:PORT, with an IPv4 address of a private network or of this machine, such as 10.0.0.1:47000"
    )
    address, _, port = text.rpartition(":")
    try:
        found, number = ipaddress.IPv4Address(address), int(port)
    except ValueError:
        raise InputError.of(field, text, allowed) from None
    local = found.is_private or found.is_loopback or found.is_link_local
    if not local or found.is_unspecified or not 1 <= number <= 65535:
        remedy = "signals are neither encrypted nor meant for the public network"
        raise InputError.of(field, text, allowed, remedy)
    return address, number
