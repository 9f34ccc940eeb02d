"""Models of latency and loss by name, as scenario files give them: ``{kind = "exponential", mean = 0.5}``."""

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from inspect import signature
from typing import Any

from aimd_des.channel import latency, loss
from aimd_des.channel.latency import Latency
from aimd_des.channel.loss import Loss
from aimd_des.errors import InputError

__all__ = ["LATENCIES", "LOSSES", "named_latency", "named_loss"]

#: Kinds of latency; their keys are the parameters of the class or, for "measured", of its CSV reader.
LATENCIES: Mapping[str, Callable[..., Latency]] = {
    "constant": latency.Constant,
    "uniform": latency.Uniform,
    "exponential": latency.Exponential,
    "gamma": latency.ShiftedGamma,
    "lognormal": latency.LogNormal,
    "pareto": latency.Pareto,
    "empirical": latency.Empirical,
    "measured": latency.Empirical.from_csv,
}

#: Kinds of loss; their keys are the parameters of the class or, for "recorded", of its CSV reader.
LOSSES: Mapping[str, Callable[..., Loss]] = {
    "bernoulli": loss.Bernoulli,
    "gilbert_elliott": loss.GilbertElliott,
    "common": loss.CommonMode,
    "trace": loss.Trace,
    "recorded": loss.Trace.from_csv,
}


def _made(field: str, kinds: Mapping[str, Callable[..., Any]], table: Mapping[str, Any]) -> Any:
    """Call the class that `kind` names with the other keys of the table."""
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        near = get_close_matches(str(kind), kinds, n=1)
        hint = f"did you mean {near[0]!r}?" if near else ""
        raise InputError.of(f"{field}.kind", kind, f"one of {', '.join(kinds)}", hint)
    given = {key: value for key, value in table.items() if key != "kind"}
    known = {
        name: parameter
        for name, parameter in signature(kinds[kind]).parameters.items()
        if not name.startswith("_")
    }
    for key in given:
        if key not in known:
            near = get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else ""
            raise InputError.of(f"key of {field} {kind}", key, f"one of {', '.join(known)}", hint)
    for name, parameter in known.items():
        if parameter.default is parameter.empty and name not in given:
            raise InputError(f"{field}: {kind} needs {name}; it is missing")
    return kinds[kind](**given)


def named_latency(table: Mapping[str, Any]) -> Latency:
    """Make a model of latency.

    Parameters
    ----------
    table : mapping
        ``kind`` and the parameters of that kind.

    Returns
    -------
    Latency
        Checked.

    Raises
    ------
    InputError
        If the kind or a key is unknown (naming the nearest), a key is missing, or a value refused.
    """
    made: Latency = _made("latency", LATENCIES, table)
    return made


def named_loss(table: Mapping[str, Any]) -> Loss:
    """Make a model of loss.

    Parameters
    ----------
    table : mapping
        ``kind`` and the parameters of that kind.

    Returns
    -------
    Loss
        Checked.

    Raises
    ------
    InputError
        If the kind or a key is unknown (naming the nearest), a key is missing, or a value refused.
    """
    made: Loss = _made("loss", LOSSES, table)
    return made
