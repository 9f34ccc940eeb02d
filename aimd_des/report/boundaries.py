"""Where the boundaries of a study lie: between which values a measure passes a limit, and what theory has."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from aimd_des.report.study_axes import Along
from aimd_des.scenario import Scenario
from aimd_des.study import StudyResults
from aimd_des.utils.formatting import percent, short

# Optima that theory needs, each of a second or less.
_MOST_OPTIMA = 24
_LOSS = "channel.loss"


class _Passage(NamedTuple):
    """Where a series of means along an axis passes the limit for the first time."""

    place: int  # the position before
    where: str  # the other axes, and the resource


def boundary_words(rows: pd.DataFrame, axes: Sequence[Along], limit: float) -> str:
    """Say between which values means pass a limit, along the axis along which most series do.

    Rows have columns i0, i1 and so on, resource and mean.
    """
    above = rows["mean"] > limit
    if above.all() or not above.any():
        return f"It is {'above' if above.all() else 'at most'} {percent(limit)} everywhere."
    best: tuple[int, int, bool, list[_Passage]] | None = None
    for number, axis in enumerate(axes):
        if axis.joined:
            for rising in (True, False):
                found, count = _passages(rows, axes, number, limit, rising=rising)
                if found and (best is None or len(found) > len(best[3])):
                    best = (number, count, rising, found)
    if best is None:
        return f"It is above {percent(limit)} at {int(above.sum()):,} of {len(rows):,} points."
    number, count, rising, found = best
    axis = axes[number]
    order = _order(axis)

    def between(passage: _Passage) -> str:
        low, high = (axis.labels[order[passage.place + step]] for step in (0, 1))
        at = f" ({passage.where})" if passage.where else ""
        return f"between {low} and {high}{at}"

    first, last = (choose(found, key=lambda one: one.place) for choose in (min, max))
    verb = "rises above" if rising else "falls to at most"
    words = f"Along {axis.name} it {verb} {percent(limit)} {between(first)}"
    if last.place > first.place:
        words += f" at the earliest, and {between(last)} at the latest"
    words += f", in {len(found):,} of {count:,} series" if len(found) < count else ""
    return f"{words}."


def _order(axis: Along) -> list[int]:
    return sorted(range(len(axis.places)), key=axis.places.__getitem__)


def _passages(
    rows: pd.DataFrame, axes: Sequence[Along], number: int, limit: float, *, rising: bool
) -> tuple[list[_Passage], int]:
    """Find where each series along an axis passes the limit, and count the series."""
    others = [k for k in range(len(axes)) if k != number]
    rank = {place: k for k, place in enumerate(_order(axes[number]))}
    several = len(set(rows["resource"])) > 1
    found, count = [], 0
    for labels, series in rows.groupby([*(f"i{k}" for k in others), "resource"], sort=False):
        count += 1
        ranks = series[f"i{number}"].map(rank).to_numpy()
        order = np.argsort(ranks)
        above = series["mean"].to_numpy()[order] > limit
        passes = np.flatnonzero(~above[:-1] & above[1:] if rising else above[:-1] & ~above[1:])
        if passes.size:
            *positions, resource = labels
            where = [
                f"{axes[k].name} {axes[k].labels[int(str(place))]}"
                for k, place in zip(others, positions, strict=True)
            ]
            place = int(ranks[order][passes[0]])
            found.append(_Passage(place, ", ".join([*where, *([str(resource)] if several else [])])))
    return found, count


class Critical(NamedTuple):
    """The loss up to which demand is held, by theory."""

    axis: int  # the axis of the loss
    rows: pd.DataFrame  # i0, i1 and so on of the other axes, resource, and loss


def critical_losses(results: StudyResults, axes: Sequence[Along]) -> Critical | None:
    """Ask theory for the critical loss, where an axis is the loss of all copies; None without an answer."""
    keys = {axis.name: axis.key for axis in results.study.axes}
    numbers = [
        number
        for number, axis in enumerate(axes)
        if axis.joined and [keys.get(name) for name in axis.columns] == [_LOSS]
    ]
    if not numbers:
        return None
    number = numbers[0]
    try:
        rows = list(_critical_rows(results, axes, number))
    except Exception:  # noqa: BLE001 - a user's model may fail in any way, and the page can do without theory
        return None
    return Critical(number, pd.DataFrame(rows)) if rows else None


def _critical_rows(results: StudyResults, axes: Sequence[Along], number: int) -> Iterator[dict[str, Any]]:
    names = [axis.name for axis in results.study.axes if axis.name not in axes[number].columns]
    known: dict[str, dict[str, float]] = {}
    firsts = results.runs.drop_duplicates(names) if names else results.runs.head(1)
    for run in firsts.to_dict("records"):
        scenario = results.scenario(str(run["key"]))
        words = repr(_what_matters(scenario))
        if words not in known:
            if len(known) == _MOST_OPTIMA:
                return
            known[words] = _critical(scenario)
        place = {
            f"i{k}": axis.positions.index(tuple(run[name] for name in axis.columns))
            for k, axis in enumerate(axes)
            if k != number
        }
        for resource, loss in known[words].items():
            yield {**place, "resource": resource, "loss": loss}


def _what_matters(scenario: Scenario) -> dict[str, Any]:
    """Leave out what the critical loss does not depend on."""
    spoken = scenario.spoken()
    return {
        key: value for key, value in spoken.items() if key not in ("until", "title", "recording", "channel")
    }


def _critical(scenario: Scenario) -> dict[str, float]:
    """Compute the loss that is survived, of each resource; nothing where the formula does not hold."""
    spoken = scenario.resolved().spoken()
    unit = spoken.get("control_unit", {})
    if spoken.get("interventions") or spoken.get("compensation") or unit.get("longest_hold_off"):
        return {}
    least = {"crossing": unit.get("hold_off"), "sampled": unit.get("period")}.get(str(unit.get("kind")))
    continuous = spoken["dynamics"] == "continuous"
    if continuous and least is None:
        return {}
    from aimd_des import theory  # it is slow to import

    problem = scenario.problem()
    rate = theory.needed_rate(problem)
    if continuous:
        found = theory.critical_loss(rate, "continuous", hold_off=float(least or 0.0))
    else:
        found = theory.critical_loss(rate, "discrete")
    return {name: float(loss) for name, loss in zip(problem.resource_names, found, strict=True)}


def critical_words(critical: Critical | None) -> str:
    """Say up to which loss theory has demand held."""
    if critical is None:
        return ""
    low, high = float(critical.rows["loss"].min()), float(critical.rows["loss"].max())
    span = short(round(low, 3)) if low == high else f"{short(round(low, 3))} to {short(round(high, 3))}"
    return f"Theory has it held up to a loss of {span}."
