"""Checksums of the files of a folder, in one file beside them, as `sha256sum --check` reads it."""

import re
from collections.abc import Iterable, Mapping
from hashlib import sha256
from pathlib import Path

from aimd_des.utils.errors import InputError
from aimd_des.utils.whole_files import write_file

#: The file that holds them: a line for each file, its SHA-256 and its name.
SUMS = "SHA256SUMS"

_LINE = re.compile(r"([0-9a-f]{64})  (.+)")


def checksum(content: bytes) -> str:
    """Compute the SHA-256 of what a file holds."""
    return sha256(content).hexdigest()


def checksums_of(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Compute the checksums of files."""
    return {name: checksum((folder / name).read_bytes()) for name in names}


def write_checksums(folder: Path, sums: Mapping[str, str]) -> None:
    """Write the checksums of files beside them, whole or not at all."""
    # The line ends are part of the form, also where the system has others.
    lines = "".join(f"{found}  {name}\n" for name, found in sorted(sums.items()))
    write_file(folder / SUMS, lines.encode(), folder / f".{SUMS}.tmp")


def read_checksums(folder: Path, remedy: str) -> dict[str, str] | None:
    """Read the checksums of the files of a folder."""
    path = folder / SUMS
    try:
        lines = path.read_bytes().decode().split("\n")
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); {remedy}") from None
    found = [_LINE.fullmatch(line) for line in lines[:-1]]
    sums = {match[2]: match[1] for match in found if match}
    if len(sums) < len(found) or lines[-1]:
        raise InputError(f"{path}: is damaged (a line of it is no checksum and name); {remedy}")
    return sums


def verified(folder: Path, name: str, sums: Mapping[str, str] | None, remedy: str) -> bytes:
    """Read a file, and hold it against its checksum."""
    path = folder / name
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); {remedy}") from None
    if sums is not None and sums.get(name) != checksum(content):
        what = "does not have the checksum that it was written with" if name in sums else "has no checksum"
        raise InputError(f"{path}: {what}: it or {folder / SUMS} is damaged; {remedy}")
    return content
