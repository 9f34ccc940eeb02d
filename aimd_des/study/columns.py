"""The columns of a study: those that say which run a row is of, and those that measure it."""

from aimd_des.results.measures import MEASURES
from aimd_des.utils import validation

#: What a row is of, besides the axes; no axis may have such a name.
LABELS = ("point", "replication", "seed", "key", "digest", "resource", "until")

#: The frames of a result.
FRAMES = ("signals", "demand", "allocations", "events", "pieces", "tracking")


def known_measure(field: str, name: str) -> None:
    """Refuse what is no measure."""
    validation.known(field, name, MEASURES)


def known_frame(field: str, name: str) -> None:
    """Refuse what is no frame of a result."""
    validation.known(field, name, FRAMES)
