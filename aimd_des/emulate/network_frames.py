"""What was measured of the network and of the processes, as CSV files that simulations read."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from aimd_des.emulate.conductor import Collected
from aimd_des.emulate.outcome import Rows, answers, sent_signals, unheard
from aimd_des.emulate.records import RowKind
from aimd_des.emulate.served import Emulation


def network_frames(setting: Emulation, measured: Collected) -> dict[str, pd.DataFrame]:
    """Put what was measured into frames, in units of time or, in columns that end so, in ``ms``."""
    sent = sent_signals(measured.rows, measured.reached)
    gone = sent[sent["heard"] > 0.0]
    answered = answers(measured.rows, measured.reached)
    names = np.array(setting.problem.resource_names, dtype=object)
    to_ms = 1000.0 * setting.unit
    lost = pd.DataFrame(
        unheard(setting, measured.rows, gone).astype(np.int64),
        columns=[f"agent_{name}" for name in setting.problem.agent_names],
    )
    departure = sent["heard"] - setting.control_unit.sensing_delay
    late_unit = np.where(sent["heard"] > 0.0, departure, sent["time"]) - sent["due"]
    late = answered["time"] - answered["due"]
    return {
        "network_delays": _delays(measured.rows, gone, names, to_ms),
        "network_losses": lost,
        "network_counts": _counts(setting, measured, gone),
        "unit_lateness": pd.DataFrame(
            {
                "sequence": sent["sequence"],
                "resource": names[sent["resource"]],
                "planned": sent["due"],
                "lateness": np.clip(late_unit, 0.0, None),
                "lateness_ms": np.clip(late_unit, 0.0, None) * to_ms,
            }
        ),
        "agent_lateness": pd.DataFrame(
            {
                "sequence": answered["sequence"],
                "agent": np.array(setting.problem.agent_names, dtype=object)[answered["agent"]],
                "due": answered["due"],
                "lateness": np.clip(late, 0.0, None),
                "lateness_ms": np.clip(late, 0.0, None) * to_ms,
            }
        ),
    }


def _heard(rows: Rows, sent: Rows) -> tuple[Rows, Any]:
    """Give the datagrams that were received, and when each had left."""
    heard = rows[rows["kind"] == RowKind.HEARD]
    heard = heard[np.isin(heard["sequence"], sent["sequence"])]
    return heard, sent["heard"][np.searchsorted(sent["sequence"], heard["sequence"])]


def _delays(rows: Rows, sent: Rows, names: Any, to_ms: float) -> pd.DataFrame:
    heard, departure = _heard(rows, sent)
    # Clocks of two hosts agree to within half a round trip: a delay below 0 counts as none.
    delay = np.clip(heard["heard"] - departure, 0.0, None)
    return pd.DataFrame(
        {
            "sequence": heard["sequence"],
            "resource": names[heard["resource"]],
            "process": heard["process"],
            "departure": departure,
            "delay": delay,
            "delay_ms": delay * to_ms,
        }
    ).sort_values(["sequence", "process"], ignore_index=True)


def _counts(setting: Emulation, measured: Collected, sent: Rows) -> pd.DataFrame:
    rows = measured.rows
    heard, _ = _heard(rows, sent)
    table = []
    for process in range(setting.processes):
        own = heard[heard["process"] == process]
        order = own["sequence"][np.argsort(own["heard"], kind="stable")]
        behind = int((order < np.maximum.accumulate(order)).sum()) if len(order) else 0
        repeated = int(((rows["kind"] == RowKind.REPEATED) & (rows["process"] == process)).sum())
        offset = measured.offsets[process] if measured.offsets else (0.0, 0.0)
        clock = {"clock_offset_s": offset[0], "clock_uncertainty_s": offset[1]}
        of = setting.agents_of(process)
        counts = {
            "received": len(own),
            "lost": len(sent) - len(own),
            "repeated": repeated,
            "overtaken": behind,
        }
        table.append({"process": process, "first_agent": of[0], "last_agent": of[-1], **counts, **clock})
    return pd.DataFrame(table)


def lateness_words(frames: Mapping[str, pd.DataFrame]) -> list[str]:
    """Say in sentences what the network and the processes have added."""
    counts = frames["network_counts"]
    of = {name: int(counts[name].sum()) for name in ("received", "lost", "repeated", "overtaken")}
    first = "{received} datagrams received, {lost} lost, {repeated} twice, {overtaken} behind a later one"
    said = [first.format(**of)]
    for name, column, what in (
        ("network_delays", "delay_ms", "Datagrams were under way for"),
        ("unit_lateness", "lateness_ms", "Signals left late by"),
        ("agent_lateness", "lateness_ms", "Answers were late by"),
    ):
        values = frames[name][column].to_numpy()
        if len(values):
            middle, most = np.percentile(values, [50, 99])
            said.append(f"{what} {middle:.2f} ms in the median, {most:.2f} ms in 99 %")
    return said
