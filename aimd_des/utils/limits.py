"""Limits of what users give: names and titles that fit on a line, and runs that fit into the memory."""

import os
import re

from aimd_des.utils.errors import InputError

# Letters of a name, or of a title.
_LONGEST_TEXT = 500
# Control characters, what ends a line, and halves of pairs, which no file can hold.
_NO_LETTER = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")


def memory(field: str, value: object, needed: float, what: str) -> None:
    """Refuse what cannot fit into the memory of this machine."""
    try:
        there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # a system that does not tell
        return
    if needed > there:
        allowed = (
            f"less: {what} would take {needed / 1e9:,.3g} GB, and this machine has {there / 1e9:,.3g} GB"
        )
        raise InputError.of(field, value, allowed)


def text(field: str, value: object, *, empty: bool = False) -> str:
    """Return a name or a title that fits on one line, or refuse it by name."""
    if not isinstance(value, str) or not (value or empty):
        raise InputError.of(field, value, "a string" if empty else "a string that is not empty")
    if len(value) > _LONGEST_TEXT:
        raise InputError.of(field, value, f"at most {_LONGEST_TEXT} letters long")
    if _NO_LETTER.search(value):
        raise InputError.of(field, value, "on one line and without control characters")
    return value
