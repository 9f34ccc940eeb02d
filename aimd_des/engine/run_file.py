"""A run in progress in a file: written whole or not at all, and read back to the same bits.

A line that says what it is, a line with the SHA-256 of all that follows, and then an archive of NumPy
(``.npz``): the arrays, and how they belong together as JSON.  Nothing is pickled.
"""

import json
import zipfile
from dataclasses import fields, is_dataclass
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from aimd_des.engine.arguments import Arguments, Begun
from aimd_des.engine.fork import check_data, state_of
from aimd_des.problem.costs import Costs, weighted_costs
from aimd_des.results.metrics import Stretch
from aimd_des.results.run_data import Piece, Signals
from aimd_des.utils.errors import InputError
from aimd_des.utils.whole_files import write_file

_MAGIC = b"aimd-des run 4\n"
_LAYOUT = "layout"
_REMEDY = "run the simulation again from its beginning"

# What is kept field by field, and made again.
_KINDS: dict[str, type] = {"Piece": Piece, "Signals": Signals, "Stretch": Stretch}

# What decides a run besides processes of its own, of which one that is saved has none.
_DECISIVE = (
    "problem",
    "dynamics",
    "control_unit",
    "channel",
    "clocks",
    "averaging",
    "compensation",
    "response",
    "interventions",
    "seed",
    "recording",
)


def save_run(run: Begun, path: Path) -> None:
    """Write where a run stands."""
    check_data(run)
    writer = _Writer(run.simulation)
    layout = {
        "until": run.system.until,
        "salts": list(run.salts),
        "simulation": fingerprint(run.simulation),
        # First: other things refer to them.
        "recipes": [writer.recipe(*recipe) for recipe in run.system.conditions.recipes],
        "state": writer.encoded("run", state_of(run)),
    }
    archive = BytesIO()
    words = np.frombuffer(json.dumps(layout).encode(), dtype=np.uint8)
    named: dict[str, Any] = {_LAYOUT: words, **{str(place): rows for place, rows in enumerate(writer.arrays)}}
    np.savez(archive, **named)
    content = archive.getvalue()
    try:
        write_file(path, _MAGIC + sha256(content).hexdigest().encode() + b"\n" + content, unfinished(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None


def unfinished(path: Path) -> Path:
    """Name the file that is there while another one is written, and stays where the process is killed."""
    # One and the same name: what was left is overwritten by the next.
    return path.parent / f".{path.name}.part"


def read_run(path: Path, simulation: Arguments) -> tuple[float, tuple[int, ...], dict[str, Any]]:
    """Read end, salts and state of a run of the simulation; refuse a file that holds none."""
    layout, arrays = _read(path)
    if layout["simulation"] != fingerprint(simulation):
        allowed = f"that of which {path} holds a run: problem, seed or another argument differs"
        raise InputError.of("simulation", type(simulation).__name__, allowed, "make it of the same arguments")
    reader = _Reader(simulation, arrays)
    for recipe in layout["recipes"]:
        reader.add(*recipe)
    return layout["until"], tuple(layout["salts"]), reader.decoded(layout["state"])


def _read(path: Path) -> tuple[dict[str, Any], list[Any]]:
    """Read a file, and hold it against its checksum."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    if not content.startswith(_MAGIC):
        raise InputError(f"{path}: is no run that this version has saved; {_REMEDY}")
    found, _, archive = content[len(_MAGIC) :].partition(b"\n")
    if found != sha256(archive).hexdigest().encode():
        raise InputError(f"{path}: is damaged (it does not have its checksum); {_REMEDY}")
    try:
        with np.load(BytesIO(archive), allow_pickle=False) as stored:
            layout = json.loads(stored[_LAYOUT].tobytes())
            return layout, [stored[str(place)] for place in range(len(stored.files) - 1)]
    except (ValueError, KeyError, zipfile.BadZipFile) as error:  # written by something else
        raise InputError(f"{path}: holds no run ({error}); {_REMEDY}") from None


class _Writer:
    """Turns what parts keep into JSON and a list of arrays."""

    def __init__(self, simulation: Arguments) -> None:
        self.arrays: list[Any] = []
        self._costs = [simulation.problem.costs]
        self._channels = _channels(simulation)

    def recipe(self, costs: Costs, by: Any, weights: Any) -> list[Any]:
        """Note costs that have been in force, and return how they come about."""
        if by == "":
            allowed = "those of the problem, drawn by Prices or weighted: others cannot be written to a file"
            raise InputError.of("costs in force", type(costs).__name__, allowed)
        self._costs.append(costs)
        return [by, self.encoded("weights", weights)]

    def encoded(self, name: str, value: Any) -> Any:
        """Turn one thing into JSON; its name is said where that cannot be done."""
        if isinstance(value, np.generic):
            return value.item()
        if value is None or isinstance(value, bool | int | float | str):
            return value
        if isinstance(value, np.ndarray):
            self.arrays.append(value)
            return {"array": len(self.arrays) - 1}
        if isinstance(value, dict):
            return {"dict": {str(key): self.encoded(str(key), each) for key, each in value.items()}}
        return self._composed(name, value)

    def _composed(self, name: str, value: Any) -> Any:
        for place, channel in enumerate(self._channels):
            if channel is value:
                return {"channel": place}
        kind = type(value).__name__
        if kind in _KINDS:
            parts = value if isinstance(value, tuple) else [getattr(value, f.name) for f in fields(value)]
            return {"kind": kind, "of": [self.encoded(name, part) for part in parts]}
        if isinstance(value, list | tuple):
            return [self.encoded(name, part) for part in value]
        for place, costs in enumerate(self._costs):
            if costs is value:
                return {"costs": place}
        raise InputError.of(f"{name} of a run that is saved", value, "numbers, strings, and arrays of these")


class _Reader:
    """Turns JSON and a list of arrays back into what parts keep."""

    def __init__(self, simulation: Arguments, arrays: list[Any]) -> None:
        self._simulation, self._arrays = simulation, arrays
        self._costs: list[Costs] = [simulation.problem.costs]
        self._channels = _channels(simulation)

    def add(self, by: Any, weights: Any) -> None:
        """Make costs as they came about."""
        base = self._simulation.problem.costs
        if by is not None:
            name, k = by
            prices: Any = self._simulation.interventions[int(name.partition("[")[2].rstrip("]"))]
            base = prices.draw(k)
        self._costs.append(base if weights is None else weighted_costs(base, self.decoded(weights)))

    def decoded(self, value: Any) -> Any:
        """Turn JSON back into one thing."""
        if isinstance(value, list):
            return [self.decoded(part) for part in value]
        if not isinstance(value, dict):
            return value
        for kind, known in (("array", self._arrays), ("costs", self._costs), ("channel", self._channels)):
            if kind in value:
                return known[value[kind]]
        if "dict" in value:
            return {key: self.decoded(each) for key, each in value["dict"].items()}
        return _KINDS[value["kind"]](*self.decoded(value["of"]))


def _channels(simulation: Arguments) -> list[Any]:
    """List the channels that may be in force: that of the run, and those of its interventions."""
    return [simulation.channel, *(getattr(change, "channel", None) for change in simulation.interventions)]


def fingerprint(simulation: Arguments) -> str:
    """Compute a hash of what a simulation was made of."""
    digest, problem = sha256(), simulation.problem
    # Names that were not given are those of indices, and need not be made.
    _add(digest, None if problem.named_by_index else problem.agent_names)
    for name in _DECISIVE:
        digest.update(name.encode())
        _add(digest, getattr(simulation, name))
    return digest.hexdigest()


def _add(digest: Any, value: Any) -> None:
    """Add a part to a hash: its class and what it was given, and so on down to numbers."""
    digest.update(type(value).__name__.encode())
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif value is None or isinstance(value, bool | int | float | str | np.generic):
        digest.update(repr(value).encode())
    elif isinstance(value, list | tuple):
        for part in value:
            _add(digest, part)
    elif isinstance(value, dict):
        for key, part in value.items():
            _add(digest, (str(key), part))
    elif is_dataclass(value):
        for field in fields(value):
            _add(digest, getattr(value, field.name))
    elif callable(value):
        digest.update(getattr(value, "__qualname__", "").encode())
    elif type(value).__module__.startswith("aimd_des."):
        own = getattr(value, "__dict__", {})
        _add(digest, {name: own[name] for name in sorted(own) if not name.startswith("_")})
