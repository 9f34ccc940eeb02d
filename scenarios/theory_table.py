"""How well do the closed forms predict what runs do?

PLACEHOLDER
"""

import pandas as pd

from scenarios._command import Study, command
from scenarios._replicate import replicate
from scenarios._theory_classics import classics
from scenarios._theory_losses import compensated, critical, heterogeneous, runaway
from scenarios._theory_rows import Size, digest, frame, markdown
from scenarios._theory_signals import signals_and_utilisation

__all__ = ["FULL", "QUICK", "main", "study"]

#: The size of the table in the docs, and one that takes seconds.
FULL = Size(30, until=1500.0, start=500.0, steps=10_000, critical_until=400.0, halvings=6, agents=240)
QUICK = Size(2, until=60.0, start=20.0, steps=300, critical_until=40.0, halvings=2, agents=60)

_EXPERIMENTS = (signals_and_utilisation, heterogeneous, compensated, critical, runaway, classics)

_PAGE = """\
# Closed forms and simulation

Made by `python -m scenarios.theory_table`, which writes this page as `theory_table.md`. What each formula assumes and neglects, and how it comes about, stands in
[Theory](theory.md); symbols are those of [the model](model.md).

{findings}

## How it was measured

- {replications} replications each, with the same seeds everywhere; "simulation" is their mean ± its standard error. The deviation is that of the mean, in % of the prediction and in standard errors (se).
- The system is the paper's, 60 cameras, with the costs of seed 0, unless the setting names another. Event-driven runs go to time {until}; synchronous runs have {steps} steps.
  Signals, utilisation and peaks are measured from time {start} on (a fifth of the steps), when the start has died away; averages are the agents' own, over the whole run.
- A prediction knows the problem and nothing of the run. "First order alone" is the plain formula, at the derivative that belongs to the predicted utilisation; all other rows of signals, utilisation and price are `theory.predict`, which
  also knows that signals find demand at its highest and that teeth are random. For the paper's Gamma of 1/90 the first order alone misses more than 5 % of the signals on one resource; halving Gamma halves what is missing.
- Signals are claimed to 5 % where latency is below one period and loss below 0.8 of the critical loss; utilisation to 2 points of the capacity without loss, and its deviation is shown where there is loss.
- Distances from an optimum are sums of absolute deviations over the sum, of the mean of the averages over all replications, which takes out the luck of single runs, from the optimum for the capacities in use; errors are those of the jackknife.
  A distance cannot be 0: what is left of the luck counts as distance.
- Loss made good for: agent i responds with the probability of `theory.compensated_probability`, which is lambda / (1 - p_i) for continuous agents. Gamma is 1/180 and losses go to 0.5 (hold-off 0.25) and on the clock to 0.3, so
  that no response has a probability above 1 and the control unit has opportunities left, as two sections show. With Gamma of 1/90 or losses to 0.6 some would be cut off at 1.
- The critical loss is searched for by halving the interval from 0.05 to 0.95 (resolution {resolution}), in each replication, with memory alone and {agents} cameras. Demand counts as run away where the
  control unit signals at 99 % of its opportunities in the second half of the run. Near the limit demand wanders as a queue near saturation does: with fewer agents the transition is less sharp.
- Small systems with fixed probabilities: costs c x² give response probabilities that do not depend on the averages.

## The table

{table}"""


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
    if quick:
        table["holds"] = ""  # at this size no claim is judged
    settings = {"seed": seed, "replications": size.replications}
    findings = _findings(table)
    page = _PAGE.format(
        findings="\n".join(f"- {finding}" for finding in findings), replications=size.replications, table=markdown(table), **_lengths(size))
    return Study("theory_table", settings, table, digest(table), findings, pages={"theory_table.md": page})


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
    first = table[table["formula"] == "Signals, first order alone"]
    exact = table[table["formula"] == "Signals per unit of time"]
    without = exact[~exact["setting"].str.contains("loss")]
    return [
        *lines,
        f"Signals without loss are predicted to {100 * without['relative_deviation'].abs().max():.1f} %, with loss to "
        f"{100 * exact['relative_deviation'].abs().max():.1f} %; by the formula of first order alone to "
        f"{100 * first['relative_deviation'].abs().max():.1f} %, always too high.",
    ]


main = command("theory_table", study, "How well do the closed forms predict what runs do?")

if __name__ == "__main__":
    main()
