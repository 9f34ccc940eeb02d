"""The study: what is run, and what is made of it."""

from functools import partial
from pathlib import Path

import pandas as pd

from aimd_des.study import replicate
from scenarios.common.command import Finding, command
from scenarios.theory_table.classics import classics
from scenarios.theory_table.figure import deviations
from scenarios.theory_table.losses import compensated, critical, heterogeneous, runaway
from scenarios.theory_table.page import PAGE
from scenarios.theory_table.rows import Size, digest, frame, markdown
from scenarios.theory_table.signals import signals_and_utilisation

#: The size of the table in the docs, and one that takes seconds.
FULL = Size(30, until=1500.0, start=500.0, steps=10_000, critical_until=400.0, halvings=6, agents=240)
QUICK = Size(2, until=60.0, start=20.0, steps=300, critical_until=40.0, halvings=2, agents=60)

_EXPERIMENTS = (signals_and_utilisation, heterogeneous, compensated, critical, runaway, classics)


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Hold every closed form against simulation."""
    size = QUICK if quick else FULL
    experiments = [make(size) for make in _EXPERIMENTS]
    jobs = [job for experiment in experiments for job in experiment.jobs]
    outcomes = iter(replicate(jobs, size.replications, seed, workers=1 if quick else None, out=runs))
    rows = [
        row
        for experiment in experiments
        for row in experiment.rows([next(outcomes) for _ in experiment.jobs])
    ]
    table = frame(rows)
    if quick:
        table["holds"] = ""  # at this size no claim is judged
    settings = {"seed": seed, "replications": size.replications}
    findings = _findings(table)
    page = PAGE.format(
        findings="\n".join(f"- {finding}" for finding in findings),
        replications=size.replications,
        table=markdown(table),
        **_lengths(size),
    )
    return Finding(
        "theory_table",
        settings,
        table,
        digest(table),
        findings,
        {"theory_table": partial(deviations, table)},
        pages={"theory_table.md": page},
    )


def _lengths(size: Size) -> dict[str, str]:
    return {
        "until": f"{size.until:,.0f}",
        "start": f"{size.start:,.0f}",
        "steps": f"{size.steps:,}",
        "agents": f"{size.agents}",
        "resolution": f"{0.9 / 2**size.halvings:.3f}",
    }


def _findings(table: pd.DataFrame) -> list[str]:
    claimed = table[table["holds"] != ""]
    if claimed.empty:
        return ["At this size no claim is judged: run it without --quick."]
    misses = claimed[claimed["holds"] == "no"]
    lines = [f"{len(claimed) - len(misses)} of {len(claimed)} claims hold."]
    lines += [f"Missed: {row.formula}, {row.setting}, {row.resource}." for row in misses.itertuples()]
    first = table.loc[table["formula"] == "Signals, first order alone", "relative_deviation"]
    rows = table[table["formula"] == "Signals per unit of time"]
    lossy = rows["setting"].str.contains("loss").to_numpy()
    gaps = 100.0 * rows["relative_deviation"].abs().to_numpy()
    lines.append(
        f"Signals without loss are predicted to {gaps[~lossy].max():.1f} %, with loss to "
        f"{gaps[lossy].max():.1f} %; "
        f"by formulas of first order alone to {100.0 * first.abs().max():.1f} %, and always too many."
    )
    return lines


main = command("theory_table", study, "How well do the closed forms predict what runs do?")
