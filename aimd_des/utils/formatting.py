"""How numbers, shares and settings are written for people: in terminals, reports, figures and logs."""

from collections.abc import Sequence
from math import floor, isfinite, isnan, log10
from typing import Any

_DIGITS = 4
_MOST_DECIMALS = 6
# Below this a number has its digits behind zeros.
_SMALL = 1e-3
_LONGEST_LIST = 6


def grouped(value: float, digits: int = 6) -> str:
    """Write a number with so many digits at most, and thousands apart.

    Examples
    --------
    >>> grouped(1234.5), grouped(0.1)
    ('1,234.5', '0.1')
    """
    return f"{value:,.{digits}g}"


def percent(share: float, digits: int = 3, *, decimals: int | None = None, missing: str = "–") -> str:
    """Write a share as a percentage, with so many digits, or so many decimals where a column shall not jump.

    Examples
    --------
    >>> percent(0.98765), percent(34.8211), percent(1.0, decimals=1)
    ('98.8 %', '3,480 %', '100.0 %')
    """
    if not isfinite(share):
        return missing if isnan(share) else "∞"
    if decimals is not None:
        return f"{100.0 * share:,.{decimals}f} %"
    return f"{grouped(float(f'{100.0 * share:.{digits}g}'), 10)} %"


def short(value: Any) -> str:
    """Write a value of any kind in running text, with no more than can be taken in.

    Examples
    --------
    >>> short(0.123456), short(12345.6), short(True), short(float("nan"))
    ('0.1235', '12,346', 'true', '–')
    """
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        if not isfinite(value):
            return "–" if isnan(value) else "∞"
        return grouped(value, _DIGITS) if abs(value) < 1e4 else f"{value:,.0f}"
    return f"{value:,d}" if isinstance(value, int) else str(value)


def measured(value: Any) -> str:
    """Write what was measured, for a column: four digits, zeros at the end too.

    Examples
    --------
    >>> measured(0.95), measured(1234567), measured(1.5e-9)
    ('0.9500', '1,234,567', '1.500e-09')
    """
    if isinstance(value, int):
        return f"{value:,d}"
    if isinstance(value, float):
        return _number(value)
    return value or ""


def _number(value: float) -> str:
    if not isfinite(value):
        return str(value)
    decimals = _DIGITS - 1 - _magnitude(value)
    many = not -_MOST_DECIMALS <= decimals <= _MOST_DECIMALS
    return f"{value:.{_DIGITS - 1}e}" if many else f"{value:,.{max(decimals, 0)}f}"


def _magnitude(value: float) -> int:
    """Find the power of ten of the first digit."""
    return floor(log10(abs(value))) if value else 0


def interval(mean: float, half_width: float, sign: str = "±") -> str:
    """Write a mean with what it is known to, to two digits of that.

    Examples
    --------
    >>> interval(0.98765, 0.00321), interval(1.0001898, 0.0000079)
    ('0.9877 ± 0.0032', '1.0001898 ± 0.0000079')
    """
    if not (isfinite(mean) and isfinite(half_width)):
        return measured(mean)
    if half_width == 0:
        return f"{measured(mean)} {sign} 0"
    decimals = max(1 - _magnitude(half_width), 0)
    # More decimals than in a column of numbers serve a mean that is no smaller number than that.
    if decimals > (_MOST_DECIMALS if abs(mean) < _SMALL else _MOST_DECIMALS + 3):
        shown = f"{mean:.3e}" if abs(mean) < _SMALL else measured(mean)
        return f"{shown} {sign} {half_width:.1e}"
    return f"{mean:,.{decimals}f} {sign} {half_width:,.{decimals}f}"


def given(value: Any) -> str:
    """Write what was set: a value, a list, or a table of a file.

    Examples
    --------
    >>> given({"kind": "constant", "value": 0.5, "on": True})
    'kind constant, value 0.5, on true'
    """
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_inner(item)}" for key, item in value.items())
    if isinstance(value, list):
        return _list(value)
    return str(value)


def _inner(value: Any) -> str:
    """Write a value that stands in a table: one that is a table itself is put into parentheses."""
    return f"({given(value)})" if isinstance(value, dict) else given(value)


def _list(values: Sequence[Any]) -> str:
    if len(values) <= _LONGEST_LIST:
        return f"[{', '.join(map(_inner, values))}]"
    return f"[{_inner(values[0])}, {_inner(values[1])}, ... {_inner(values[-1])}] ({len(values)} values)"
