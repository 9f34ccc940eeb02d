"""The script in every page: Vega, and what joins it to the page, bundled once on a machine."""

from contextlib import suppress
from functools import lru_cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

from aimd_des.utils.whole_files import write_file

# Beside what Python and Numba keep of this package; it goes with them.
_KEPT = Path(__file__).with_name("__pycache__")


@lru_cache
def bundled(glue: str) -> str:
    """Put Vega and what joins it to the page into one script.

    The bundler is a browser's engine, which takes seconds and a hundred megabytes.  Its result depends on its
    version and on the glue alone, and is kept on the disk, where that can be written.
    """
    name = sha256(f"{version('vl-convert-python')}\n{glue}".encode()).hexdigest()
    kept = _KEPT / f"script.{name[:16]}.js"
    with suppress(OSError, ValueError):
        return _unsealed(kept.read_bytes().decode())
    import vl_convert

    script = str(vl_convert.javascript_bundle(glue))
    with suppress(OSError):
        _KEPT.mkdir(exist_ok=True)
        write_file(kept, f"{_digest(script)}\n{script}".encode())
    return script


def _unsealed(kept: str) -> str:
    """Take the script that stands behind its digest; what is damaged is made anew."""
    digest, _, script = kept.partition("\n")
    if digest != _digest(script):
        raise ValueError(digest)
    return script


def _digest(script: str) -> str:
    return sha256(script.encode()).hexdigest()
