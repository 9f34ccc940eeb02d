"""The option `--set`: values that replace those of a file."""

from collections.abc import Sequence
from typing import Any

__all__ = ["changes"]


def changes(settings: Sequence[str], **options: Any) -> dict[str, Any]:
    """Put together what the command line says about a file.

    Parameters
    ----------
    settings : sequence of str
        What was given to `--set`: dotted keys with their values.
    **options
        Keys that have an option of their own, which goes before; None where it was not given.

    Returns
    -------
    dict
        Values by dotted keys.

    Raises
    ------
    InputError
        If a setting is none.
    """
    from aimd_des.scenario.keys import parse_setting

    given = {name: value for name, value in options.items() if value is not None}
    return {**dict(map(parse_setting, settings)), **given}
