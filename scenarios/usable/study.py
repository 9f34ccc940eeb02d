"""The study: its maps, what is run for them, and what is made of it."""

from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from scenarios.common import figures
from scenarios.common.command import Finding, command
from scenarios.common.measure import run_draws
from scenarios.common.tables import shown, summarise_draws
from scenarios.usable.delay import DELAY
from scenarios.usable.frame import BOTH, Case, Map, search
from scenarios.usable.loss import LOSS

_MAPS: tuple[Map, ...] = DELAY, LOSS
_LABELS = ["rises", "hold_off", "threshold", "other", "until"]


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Search how far latencies or losses may rise before a limit is passed, over draws of the costs."""
    cases = [case for each in _MAPS for case in each.cases(quick)]
    found = [
        pair
        for count in sorted({case.draws for case in cases})
        for pair in run_draws(
            search, [case for case in cases if case.draws == count], count, 1, seed, quick, runs
        )
    ]
    rows = [
        {**_labels(case), "draw": draw, **seen._asdict(), BOTH: seen.both}
        for case, outcomes in found
        for draw, (seen,) in enumerate(outcomes)
    ]
    table = summarise_draws(rows, _LABELS)
    maps = {each.name: each for each in _MAPS}
    expected = {tuple(_labels(case).values()): maps[case.rises].expected(case) for case in cases}
    table["theory"] = [
        getattr(expected[tuple(row[name] for name in _LABELS)], row["measure"])
        for row in table.to_dict("records")
    ]
    parts = {name: table[table["rises"] == name] for name in maps}
    settings = {"seed": seed, "draws": max(case.draws for case in cases)}
    findings = [line for name, part in parts.items() for line in maps[name].findings(part)]
    printed = shown(table, [*_LABELS, "measure"], ".2f")
    return Finding("usable", settings, table, printed, findings, {"usable": partial(_figure, parts, maps)})


def _labels(case: Case) -> dict[str, Any]:
    """Name a case; `other` is the loss where the latency rises, and the latency where the loss does."""
    setting = case.setting
    other = setting.loss if case.rises == "latency" else setting.latency
    values = case.rises, setting.hold_off, setting.threshold, other, case.until
    return dict(zip(_LABELS, values, strict=True))


def _figure(parts: dict[str, pd.DataFrame], maps: dict[str, Map]) -> Figure:
    figure, panels = figures.panels(len(parts), 2, (11.0, 4.6 * len(parts)))
    for row, (name, part) in enumerate(parts.items()):
        maps[name].draw(panels[2 * row : 2 * row + 2], part)
    return figure


main = command(
    "usable",
    study,
    "Which delays and losses are usable: demand below the capacity, shares right?",
)
