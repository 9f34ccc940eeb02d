"""Files that carry the digest of their own content: where a bit is turned, reading refuses.

The digest stands inside the file, at a place that readers of the format pass over, so that file and
digest appear at once and stay together when files are copied.  It covers all other bytes and the name of
the file below its folder: the file of another run is no substitute.
"""

from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from aimd_des.utils.errors import InputError
from aimd_des.utils.whole_files import write_file

if TYPE_CHECKING:
    import pyarrow as pa

# What stands before and after the digest.  In JSON it is the last key, in TOML a comment at the end; in
# Parquet it stands between the last page and the footer, where nothing points to.
_FORMS = {
    ".json": (b',\n  "sha256": "', b'"'),
    ".toml": (b"# sha256 ", b"\n"),
    ".parquet": (b"aimd_des.sha256 ", b""),
}
_DIGITS = 64
# A Parquet file ends with the length of its footer, and four letters.
_PARQUET_END = 8


def _behind(content: bytes, suffix: str) -> int:
    """Say how many bytes stand behind the digest."""
    if suffix == ".json":
        return len(b"\n}\n")
    if suffix == ".toml":
        return 0
    return _PARQUET_END + int.from_bytes(content[-_PARQUET_END : -_PARQUET_END + 4], "little")


def _seal(name: str, content: bytes) -> bytes:
    before, after = _FORMS[Path(name).suffix]
    digest = sha256(name.encode() + b"\n")
    digest.update(content)
    return before + digest.hexdigest().encode() + after


def write_sealed(folder: Path, name: str, content: "bytes | pa.Buffer") -> None:
    """Write a file with the digest of its content, unless the same is there already."""
    path = folder / name
    rest = bytes(content)
    place = len(rest) - _behind(rest, path.suffix)
    whole = b"".join((rest[:place], _seal(name, rest), rest[place:]))
    if not (path.is_file() and path.read_bytes() == whole):
        write_file(path, whole)


def read_sealed(folder: Path, name: str, remedy: str) -> tuple[bytes, bool]:
    """Read a file, and hold it against its digest."""
    path = folder / name
    try:
        whole = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); {remedy}") from None
    return unsealed(whole, name, str(path), remedy)


def unsealed(whole: bytes, name: str, source: str, remedy: str) -> tuple[bytes, bool]:
    """Hold content against the digest in it."""
    suffix = Path(name).suffix
    before, after = _FORMS[suffix]
    end = max(len(whole) - _behind(whole, suffix), 0)
    begin = max(end - len(before) - _DIGITS - len(after), 0)
    content = whole[:begin] + whole[end:]
    if whole[begin:end] == _seal(name, content):
        return content, True
    # Files of earlier versions lack the mark everywhere: where a turned bit has hit the length of a footer,
    # it stands at another place only.
    if whole and before not in whole:
        return whole, False
    raise InputError(f"{source}: does not fit its checksum: it is damaged, or another file's; {remedy}")
