"""Texts that others have written, made fit for a terminal: signs that would steer it are shown as numbers."""

import re

# Control characters but the tabulator and the end of a line, what reorders a line, and halves of pairs.
_STEERING = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)


def fit(text: str) -> str:
    r"""Show signs that steer a terminal as escapes, such as ``\x1b``.

    Examples
    --------
    >>> print(fit("red \x1b[31m alert"))
    red \x1b[31m alert
    """
    return _STEERING.sub(lambda sign: sign[0].encode("unicode_escape").decode("ascii"), text)
