"""Keywords that have other names now: the old ones go on for two minor releases more, with a warning."""

import warnings
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from aimd_des.utils.deprecation import renamed
from aimd_des.utils.errors import InputError

_Made = TypeVar("_Made", bound=Callable[..., Any])

#: Old keywords of functions, which are keys of files too, each with the new one.
KEYWORDS: dict[str, str] = {"refractory": "hold_off", "longest": "longest_hold_off"}


def refuse_both(old: str, value: object, new: str, *, given: bool) -> None:
    """Refuse an old name beside the new one."""
    if given:
        raise InputError.of(old, value, f"left out beside {new}, its new name")


def keywords(*old: str) -> Callable[[_Made], _Made]:
    """Let a function, or a class and its instances, be asked by old keywords too."""

    def decorate(made: _Made) -> _Made:
        call: Callable[..., Any] = vars(made)["__init__"] if isinstance(made, type) else made

        @wraps(call)
        def taking_old_ones(*arguments: Any, **given: Any) -> Any:
            for name in given.keys() & set(old):
                new = KEYWORDS[name]
                refuse_both(name, given[name], new, given=new in given)
                warnings.warn(renamed(name, new), DeprecationWarning, stacklevel=2)
                given[new] = given.pop(name)
            return call(*arguments, **given)

        if not isinstance(made, type):
            return taking_old_ones  # type: ignore[return-value]  # which takes more than it did

        def attribute(self: Any, name: str) -> Any:
            if name not in old:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            warnings.warn(renamed(name, KEYWORDS[name]), DeprecationWarning, stacklevel=2)
            return getattr(self, KEYWORDS[name])

        type.__setattr__(made, "__init__", taking_old_ones)
        type.__setattr__(made, "__getattr__", attribute)
        return made

    return decorate
