"""How well do the closed forms predict what runs do?

PLACEHOLDER
"""

from pathlib import Path

import click

from scenarios._command import Study, command
from scenarios._replicate import replicate
from scenarios._theory_classics import classics
from scenarios._theory_losses import compensated, critical, heterogeneous, runaway
from scenarios._theory_rows import Size, frame, markdown, readable
from scenarios._theory_signals import signals_and_utilisation

__all__ = ["FULL", "QUICK", "main", "study"]

#: The size of the table in the docs, and one that takes seconds.
FULL = Size(30, until=1500.0, start=500.0, steps=10_000, critical_until=400.0, halvings=6, agents=240)
QUICK = Size(2, until=60.0, start=20.0, steps=300, critical_until=40.0, halvings=2, agents=60)

_EXPERIMENTS = (signals_and_utilisation, heterogeneous, compensated, critical, runaway, classics)


def study(quick: bool = False, seed: int = 0) -> Study:
    """Hold every closed form against simulation.

    Parameters
    ----------
    quick : bool
        Whether to run the small size, at which claims need not hold.
    seed : int
        Of the first replication.

    Returns
    -------
    Study
        A pure function of the arguments.
    """
    size = QUICK if quick else FULL
    experiments = [make(size) for make in _EXPERIMENTS]
    jobs = [job for experiment in experiments for job in experiment.jobs]
    outcomes = iter(replicate(jobs, size.replications, seed, workers=1 if quick else None))
    rows = [
        row for experiment in experiments for row in experiment.rows([next(outcomes) for _ in experiment.jobs])
    ]
    table = frame(rows)
    claimed = table[table["holds"] != ""]
    misses = claimed[claimed["holds"] == "no"]
    findings = [f"{len(claimed) - len(misses)} of {len(claimed)} claims hold, over {size.replications} replications."]
    findings += [f"Missed: {row.formula}, {row.setting}, {row.resource}." for row in misses.itertuples()]
    settings = {"seed": seed, "replications": size.replications}
    page = markdown(table)
    return Study("theory_table", settings, table, readable(table), findings, pages={"table.md": page})


main = command("theory_table", study, "How well do the closed forms predict what runs do?")

if __name__ == "__main__":
    main()
