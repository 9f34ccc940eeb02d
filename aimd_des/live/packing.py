"""Arrays as one message: the length of a header, the header as JSON, and the arrays one after the other."""

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy.typing as npt

# What a page reads without a copy: each array begins at a multiple of its words.
_WORD = 4


def packed(head: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """Write a header and arrays, little-endian, numbers as float32 and counts as int32."""
    forms = {name: _form(array) for name, array in arrays.items()}
    told = {name: [array.dtype.kind, list(array.shape)] for name, array in forms.items()}
    text = json.dumps({**head, "arrays": told}, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % _WORD)
    return b"".join([struct.pack("<I", len(text)), text, *(array.tobytes() for array in forms.values())])


def _form(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return array.astype("<i4" if array.dtype.kind in "biu" else "<f4")
