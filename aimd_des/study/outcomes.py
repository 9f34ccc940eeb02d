"""Outcomes of functions as text: numbers, strings, arrays and records of them, exact to the bit.

A record is written as the name of its class and its fields.  When it is read, the class is looked up among
those that this process has loaded, and must be a NamedTuple or a frozen dataclass with these fields; neither
a module is imported nor a constructor called, so that a file runs nothing.
"""

import base64
import binascii
import dataclasses
import json
import math
import sys
from collections.abc import Callable, Mapping
from functools import reduce
from typing import Any

import numpy as np

from aimd_des.utils.errors import InputError

_ALLOWED = (
    "numbers, strings, NumPy arrays of them, and lists, tuples, mappings, NamedTuples and frozen dataclasses"
    " of such, with classes of a module"
)
_REMEDY = "return what is measured as such data"


def encoded(outcome: object) -> bytes:
    """Write an outcome as JSON; what is no data is refused with its place."""
    content = {"outcome": _written(outcome, "outcome")}
    return json.dumps(content, indent=2, allow_nan=False).encode() + b"\n"


def decoded(content: bytes) -> Any:
    """Read an outcome; ValueError, or what json and NumPy raise, where it is none."""
    return _read(json.loads(content)["outcome"])


def _written(value: Any, place: str) -> Any:
    """Turn a value into what JSON has; other kinds become a mapping that begins with the kind."""
    kind = type(value)
    if value is None or kind in (bool, int, str) or (kind is float and np.isfinite(value)):
        found: Any = value
    elif kind in (float, complex, np.ndarray) or isinstance(value, np.generic):
        word = "array" if kind is np.ndarray else "scalar" if isinstance(value, np.generic) else "number"
        found = {word: _array(np.asarray(value), place)}
    elif kind in (list, tuple):
        parts = [_written(part, f"{place}[{i}]") for i, part in enumerate(value)]
        found = parts if kind is list else {"tuple": parts}
    elif kind is dict:
        pairs = [[_key(key, place), _written(part, f"{place}[{key!r}]")] for key, part in value.items()]
        found = {"mapping": pairs}
    else:
        name = f"{kind.__module__}:{kind.__qualname__}"
        fields = _fields(kind)
        if fields is None or _loaded(name) is not kind:
            raise InputError.of(place, kind, _ALLOWED, _REMEDY)
        named = {field: _written(getattr(value, field), f"{place}.{field}") for field in fields}
        found = {"record": name, "fields": named}
    return found


def _key(key: Any, place: str) -> Any:
    # A list, or an array, would be no key when it is read.
    if type(key) in (str, int, bool) or (type(key) is float and np.isfinite(key)):
        return key
    raise InputError.of(f"key of {place}", key, "a string or a finite number", _REMEDY)


def _array(value: Any, place: str) -> dict[str, Any]:
    if value.dtype.hasobject or value.dtype.names:
        raise InputError.of(place, value.dtype, "an array of numbers or strings", _REMEDY)
    # As pickling does: sums may depend on the order in memory, in their last bit.
    order = "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
    data = base64.b64encode(value.tobytes(order)).decode()
    return {"dtype": value.dtype.str, "shape": list(value.shape), "order": order, "data": data}


def _read(value: Any) -> Any:
    if isinstance(value, list):
        return [_read(part) for part in value]
    if not isinstance(value, dict):
        return value
    word, held = next(iter(value.items()))
    return _READ[word](held, value)


def _values(value: Mapping[str, Any]) -> Any:
    dtype, shape, order = np.dtype(value["dtype"]), tuple(value["shape"]), value["order"]
    if dtype.hasobject or dtype.names or order not in ("C", "F"):
        raise ValueError(f"{dtype} in order {order} is no array of numbers or strings")
    try:
        data = bytearray(base64.b64decode(value["data"], validate=True))
    except binascii.Error as error:
        raise ValueError(f"an array is damaged: {error}") from None
    if len(data) != math.prod(shape) * dtype.itemsize:
        raise ValueError(f"an array has {len(data)} bytes, and not those of {shape} {dtype}")
    return np.ndarray(shape, dtype, data, order=order).copy(order) if data else np.empty(shape, dtype, order)


def _record(name: str, fields: dict[str, Any]) -> Any:
    """Make a record of a class that is loaded, without its constructor."""
    kind = _loaded(name)
    if kind is None or list(_fields(kind) or ()) != list(fields):
        raise ValueError(f"no record {name} with the fields {', '.join(fields)} is loaded")
    if issubclass(kind, tuple):
        return tuple.__new__(kind, fields.values())
    made = object.__new__(kind)
    for field, value in fields.items():
        object.__setattr__(made, field, value)
    return made


_READ: Mapping[str, Callable[[Any, dict[str, Any]], Any]] = {
    "number": lambda held, _: _values(held).item(),
    "scalar": lambda held, _: _values(held)[()],
    "array": lambda held, _: _values(held),
    "tuple": lambda held, _: tuple(map(_read, held)),
    "mapping": lambda held, _: {key: _read(part) for key, part in held},
    "record": lambda held, value: _record(
        held, {name: _read(part) for name, part in value["fields"].items()}
    ),
}


def _loaded(name: str) -> Any:
    """Look up a class among those that are there; None if it is not."""
    module, _, path = name.partition(":")
    try:
        return reduce(getattr, path.split("."), sys.modules[module])
    except (KeyError, AttributeError):
        return None


def _fields(kind: Any) -> tuple[str, ...] | None:
    """Name the fields of a NamedTuple or frozen dataclass; None of anything else."""
    if not isinstance(kind, type):
        return None
    if issubclass(kind, tuple):
        return getattr(kind, "_fields", None)
    if dataclasses.is_dataclass(kind) and kind.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        return tuple(field.name for field in dataclasses.fields(kind))
    return None
