"""What a part of a channel remembers from one broadcast to the next, where a run is forked or saved."""

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

from aimd_des.utils import returned_values
from aimd_des.utils.errors import InputError

_REMEDY = "where it remembers nothing, let state() return {} and resume(state) do nothing"


def memory_of(part: Any) -> dict[str, Any]:
    """Ask a part for what it remembers; refuse one of the user's own that cannot say it."""
    if not all(callable(getattr(part, name, None)) for name in ("state", "resume")):
        allowed = "one with methods state() and resume(state): what it remembers cannot be copied without"
        raise InputError.of(type(part).__name__, part, allowed, _REMEDY)
    said = returned_values.said_by(part, "state")
    with returned_values.calling(said):
        state = part.state()
    given: dict[str, Any] = returned_values.instance(said, state, dict, "a dict")
    # What a part of the user's own returns may be what it goes on with.
    return given if type(part).__module__.startswith("aimd_des.") else deepcopy(given)


def remember(part: Any, state: Mapping[str, Any]) -> None:
    """Let a part go on from what it has said."""
    with returned_values.calling(returned_values.said_by(part, "resume")):
        part.resume(state)
