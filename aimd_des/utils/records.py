"""Named tuples that compiled code takes as one pointer.

Numba takes a named tuple apart: every array in it is seven values, and a record of fifty arrays makes each
call of a routine move hundreds of them, and each compilation carry as many through.  A record that is
decorated here is filled into one structure when compiled code is entered, and from there on is its address:
a field is loaded where it is used.  A record inside a record is a structure inside a structure.
"""

from typing import TypeVar

from aimd_des.utils.jit import note

_Class = TypeVar("_Class", bound=type)


def record(cls: _Class) -> _Class:
    """Let compiled code take a named tuple as one pointer; all named tuples in it must be records, too."""

    def teach() -> None:
        from aimd_des.utils.record_types import enter_record

        enter_record(cls)

    note(teach)
    return cls
