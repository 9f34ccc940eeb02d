"""The study: what is run, and what is made of it."""

from functools import partial
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from aimd_des.plots import REFERENCE, colour, frame, number_axis, shared_legend
from aimd_des.study import replicate
from scenarios.common.command import Finding, command
from scenarios.theory_table.accuracy import accuracy
from scenarios.theory_table.classics import classics
from scenarios.theory_table.losses import compensated, critical, heterogeneous, runaway
from scenarios.theory_table.rows import Size, digest, markdown
from scenarios.theory_table.rows import frame as table_of
from scenarios.theory_table.signals import signals_and_utilisation

#: The size of the table in the docs, and one that takes seconds.
FULL = Size(30, 1500.0, 500.0, 10_000, critical_until=400.0, halvings=6, agents=240, long=1e5, accuracy=0.01)
QUICK = Size(2, 60.0, 20.0, 300, critical_until=40.0, halvings=2, agents=60, long=1000.0, accuracy=0.08)

_EXPERIMENTS = (signals_and_utilisation, accuracy, heterogeneous, compensated, critical, runaway, classics)

#: The page of the docs, with fields: findings, table, replications, and the lengths of runs.
_PAGE = """\
# Closed forms and simulation

Made by `python -m scenarios.theory_table`, which writes this page as `theory_table.md`. What each formula
assumes and neglects, and how it comes about, stands in [Theory](theory.md); symbols are those of [the
model](model.md).

{findings}

## How it was measured

- {replications} replications each, with the same seeds everywhere; "simulation" is their mean ± its
  standard error. The deviation is that of the mean, in % of the prediction and in standard errors (se).
- The system is the paper's, 60 cameras, with the costs of seed 0, unless the setting names another.
  Event-driven runs go to time {until}; synchronous runs have {steps} steps. Signals, utilisation and peaks
  are measured from time {start} on (a fifth of the steps), when the start has died away; averages are the
  agents' own, over the whole run.
- A prediction knows the problem and nothing of the run. "First order alone" is the plain formula, at the
  derivative that belongs to the predicted utilisation; all other rows of signals, utilisation and price are
  `theory.predict`, which also knows that signals find demand at its highest and that sawtooths are random.
  For the paper's Gamma of 1/90 the first order alone misses more than 5 % of the signals on one resource;
  halving Gamma halves what is missing.
- Signals are claimed to 5 % where latency is below one period and loss below 0.8 of the critical loss;
  utilisation to 2 points of the capacity without loss, and its deviation is shown where there is loss.
- Accuracy is that of `theory.convergence`, held against runs to {long}: they must be long for the bias to be
  seen behind the noise. The bias is what their averages are off, projected on the predicted one; the mean of
  30 runs has a standard error of 1 to 2 % of it. A slope is that of the mean misallocation on log axes from a
  twentieth of the length on.
- Distances from an optimum are sums of absolute deviations over the sum, of the mean of the averages over
  all replications, which takes out the random error of single runs, from the optimum for the capacities in
  use; errors are those of the jackknife. A distance cannot be 0: what is left of the random error counts as
  distance.
- Loss made good for: agent i responds with the probability of `theory.compensated_probability`, which is
  lambda / (1 - p_i) for continuous agents. Gamma is 1/180 and losses go to 0.5 (hold-off 0.25) and on the
  clock to 0.3, so that no response has a probability above 1 and the control unit has opportunities left,
  as two sections show. With Gamma of 1/90 or losses to 0.6 some would be cut off at 1.
- The critical loss is searched for by halving the interval from 0.05 to 0.95 (resolution {resolution}), in
  each replication, with memory alone and {agents} cameras. Demand counts as run away where the control unit
  signals at 99 % of its opportunities in the second half of the run. Near the limit demand wanders as a
  queue near saturation does: with fewer agents the transition is less sharp.
- Small systems with fixed probabilities: costs c x² give response probabilities that do not depend on the
  averages.

## The table

{table}"""


def study(quick: bool = False, seed: int = 0, runs: Path | None = None) -> Finding:
    """Hold every closed form against simulation."""
    size = QUICK if quick else FULL
    experiments = [make(size) for make in _EXPERIMENTS]
    jobs = [job for experiment in experiments for job in experiment.jobs]
    outcomes = iter(replicate(jobs, size.replications, seed, workers=1 if quick else None, out=runs))
    table = table_of([row for each in experiments for row in each.rows([next(outcomes) for _ in each.jobs])])
    if quick:
        table["holds"] = ""  # at this size no claim is judged
    settings = {"seed": seed, "replications": size.replications}
    findings = _findings(table)
    page = _PAGE.format(
        findings="\n".join(f"- {finding}" for finding in findings),
        **{name: f"{value:,g}" for name, value in vars(size).items()},
        resolution=f"{0.9 / 2**size.halvings:.3f}",
        table=markdown(table),
    )
    drawn, pages = {"theory_table": partial(_deviations, table)}, {"theory_table.md": page}
    return Finding("theory_table", settings, table, digest(table), findings, drawn, pages)


def _deviations(table: pd.DataFrame) -> Figure:
    """Draw the deviation of every row that has one, in % of the prediction, a line for each formula.

    Bars are two standard errors to either side.
    """
    rows = table[table["relative_deviation"].notna()]
    formulas = rows["formula"].drop_duplicates().tolist()
    figure = Figure(figsize=(11.0, 0.5 + 0.36 * len(formulas)), layout="constrained")
    axes = figure.subplots()
    for first_order in (False, True):
        chosen = rows[rows["formula"].str.endswith("first order alone") == first_order]
        rows_of = chosen.groupby("formula")
        within = rows_of.cumcount() - (rows_of["formula"].transform("size") - 1) / 2
        axes.errorbar(
            100.0 * chosen["relative_deviation"],
            chosen["formula"].map(formulas.index) + 0.02 * within,
            xerr=200.0 * (chosen["standard_error"] / chosen["predicted"]).abs(),
            fmt="s" if first_order else "o",
            color=colour(int(first_order)),
            markersize=3.5,
            elinewidth=0.8,
            label="first order alone" if first_order else "theory",
        )
    axes.axvline(0.0, color=REFERENCE, linewidth=1.0)
    axes.set_yticks(range(len(formulas)), formulas, fontsize="small")
    axes.invert_yaxis()
    axes.set_xlabel("simulation over theory - 1 (%), ± 2 standard errors")
    number_axis(axes.xaxis)
    frame(axes)
    shared_legend(figure)
    return figure


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
