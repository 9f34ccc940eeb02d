"""The two exceptions of the framework, and its warning.

`InputError` is raised before anything runs: its message names the field, the
value, what is allowed and the remedy.  `SimulationError` ends a run that cannot go on.
Both take one message, so that they survive being rebuilt from ``.args`` (SimPy and process
pools do that).  `OverloadWarning` says that a run did not hold its capacity.
"""

import re
import sys

_LONGEST = 500

# Where an object lies in memory tells readers nothing, and differs from run to run.
_ADDRESS = re.compile(r" at 0x[0-9a-fA-F]+")


def _shown(value: object) -> str:
    """Show a value, but not pages of it."""
    try:
        shown = _ADDRESS.sub("", repr(value))
        if hasattr(type(value), "_shown"):  # a title, and a table below it
            shown = shown.partition("\n")[0]
    except ValueError:  # an integer of thousands of digits
        return f"a value of type {type(value).__name__} that is too long to show"
    return shown if len(shown) <= _LONGEST else f"{shown[:_LONGEST]}..."


class InputError(ValueError):
    """Something the user gave is outside what is allowed.

    Parameters
    ----------
    message : str
        Field, value, allowed range and remedy in one sentence.
    """

    @classmethod
    def of(cls, field: str, value: object, allowed: str, remedy: str = "") -> "InputError":
        """Compose the sentence in the one form that all refusals share.

        Parameters
        ----------
        field : str
            The name under which the user gave the value.
        value : object
            The value that is refused.
        allowed : str
            What is allowed, to be read after "must be".
        remedy : str
            What to do about it; empty where the range says it.

        Returns
        -------
        InputError
            The exception, to be raised by the caller.
        """
        sentence = f"{field} = {_shown(value)}: must be {allowed}"
        return cls(f"{sentence}; {remedy}" if remedy else sentence)


class SimulationError(RuntimeError):
    """A run that cannot go on.

    Parameters
    ----------
    message : str
        Simulated time, resource, cause, and the setting to change.
    """


class OverloadWarning(RuntimeWarning):
    """Demand has run away from the capacity; `result.run_away` says of which resources."""


def level_outside() -> int:
    """Count the frames up to the first that is not of this package: the `stacklevel` of a warning there."""
    frame, level = sys._getframe(1), 1  # noqa: SLF001 - what `inspect` uses, which reads source files besides
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "aimd_des":
        frame, level = frame.f_back, level + 1
    return level


# Tracebacks show where users import them from.
for _public in (InputError, OverloadWarning, SimulationError):
    _public.__module__ = "aimd_des"
