"""The columns of a study: those that say which run a row is of, and those that measure it."""

from difflib import get_close_matches
from typing import Literal

from aimd_des.utils.errors import InputError

__all__ = ["FRAMES", "LABELS", "MEASURES", "known_frame", "known_measure"]

#: What a row is of, besides the axes; no axis may have such a name.
LABELS = ("point", "replication", "seed", "key", "digest", "resource", "until")

#: The columns of `Result.summary`, and what they hold.
MEASURES: dict[str, Literal["integer", "number"]] = {
    "signals": "integer",
    "bits": "integer",
    "delivered": "integer",
    "lost": "integer",
    "in_flight": "integer",
    "duplicated": "integer",
    "responses": "integer",
    "saturated": "integer",
    "utilisation": "number",
    "relative_error": "number",
    "misallocation": "number",
    "consensus_spread": "number",
    "cost_ratio": "number",
    "overshoot_peak": "number",
    "overshoot_time": "number",
    "overshoot_mean": "number",
}

#: The frames of a result.
FRAMES = ("signals", "demand", "allocations", "events", "pieces", "tracking")


def known_measure(field: str, name: str) -> None:
    """Refuse what is no column of the summary."""
    _known(field, name, tuple(MEASURES))


def known_frame(field: str, name: str) -> None:
    """Refuse what is no frame of a result."""
    _known(field, name, FRAMES)


def _known(field: str, name: str, names: tuple[str, ...]) -> None:
    if name not in names:
        near = get_close_matches(name, names, n=1)
        raise InputError.of(
            field, name, f"one of {', '.join(names)}", f"did you mean {near[0]!r}?" if near else ""
        )
