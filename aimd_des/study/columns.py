"""The columns of a study: those that say which run a row is of, and those that measure it."""

from difflib import get_close_matches

from aimd_des.results.measures import MEASURES
from aimd_des.utils.errors import InputError

#: What a row is of, besides the axes; no axis may have such a name.
LABELS = ("point", "replication", "seed", "key", "digest", "resource", "until")

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
