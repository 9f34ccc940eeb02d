"""What `robust_responses` prints: its table, and what the numbers say."""

from collections.abc import Sequence
from functools import partial

import pandas as pd

from scenarios.common.systems import critical, memory_alone, rate

MEMORY = memory_alone()


def _pick(table: pd.DataFrame, panel: str, setting: str, measure: str) -> pd.DataFrame:
    return table[
        (table["panel"] == panel) & table["setting"].str.startswith(setting) & (table["measure"] == measure)
    ]


def _listed(rows: pd.DataFrame, scale: float = 1.0) -> str:
    return " / ".join(f"{scale * value:.1f}" for value in rows["mean"])


def _span(rows: pd.DataFrame) -> str:
    return f"{rows['mean'].min():.2f} to {rows['mean'].max():.2f}"


def findings(table: pd.DataFrame, hold_offs: Sequence[str]) -> list[str]:
    """Say in sentences what the numbers say of losses, thresholds, and hold-offs with these names."""
    found = []
    for dynamics in ("continuous", "discrete"):
        for way in dict.fromkeys(table.loc[table["panel"] == f"loss, {dynamics}", "setting"]):
            pick = partial(_pick, table, f"loss, {dynamics}", way)
            cut = pick("saturated")["mean"].sum()
            found.append(
                f"{dynamics}, losses 0 to 0.5, {way} ({' / '.join(pick('bits')['resource'])}): a run is "
                f"{_listed(pick('misallocation'), 100)} % off, the mean of the averages "
                f"{_listed(pick('misallocation of the mean'), 100)} %, at {_listed(pick('bits'))} bits per "
                f"unit of time; responses with a probability above 1: {cut:g} a run."
            )
    plain, careful = (_pick(table, "threshold", name, "above") for name in ("threshold 1", "safe threshold"))
    used, less = (_pick(table, "threshold", name, "used") for name in ("threshold 1", "safe threshold"))
    cost = used["mean"].to_numpy() - less["mean"].to_numpy()
    gap = pd.concat([used["mean"] - used["theory"], less["mean"] - less["theory"]]).abs().max()
    found.append(
        f"Threshold 1 leaves demand above capacity for up to {100 * plain['mean'].max():.0f} % of the time, "
        f"those from theory (down to {careful['threshold'].min():.3f}) for "
        f"{100 * careful['mean'].min():.2f} to {100 * careful['mean'].max():.2f} %, and cost up to "
        f"{100 * cost.max():.1f} points of utilisation, which theory has to within {100 * gap:.2f} points."
    )
    for panel in ("latency", "loss"):
        for name in hold_offs:
            pick = partial(_pick, table, panel, name)
            found.append(
                f"{panel} {pick('used')['at'].min():g} to {pick('used')['at'].max():g}, hold-off {name}: "
                f"mean demand {_span(pick('used'))} of the capacity, {_span(pick('bits'))} bits per unit of "
                f"time, above the capacity for {_span(pick('above'))} of the time."
            )
    limits = " and ".join(f"{critical(MEMORY, hold_off):.2f}" for hold_off in (0.25, 1.0))
    found.append(
        f"1 / rho is {1 / rate(MEMORY):.2f}; hold-offs of 0.25 and 1 survive losses up to {limits} by theory."
    )
    return found
