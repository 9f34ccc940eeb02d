"""The page of the docs that `scenarios.theory_table` writes."""

#: With fields: findings, table, replications, and the lengths of runs.
PAGE = """\
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
  `theory.predict`, which also knows that signals find demand at its highest and that teeth are random. For
  the paper's Gamma of 1/90 the first order alone misses more than 5 % of the signals on one resource;
  halving Gamma halves what is missing.
- Signals are claimed to 5 % where latency is below one period and loss below 0.8 of the critical loss;
  utilisation to 2 points of the capacity without loss, and its deviation is shown where there is loss.
- Distances from an optimum are sums of absolute deviations over the sum, of the mean of the averages over
  all replications, which takes out the luck of single runs, from the optimum for the capacities in use;
  errors are those of the jackknife. A distance cannot be 0: what is left of the luck counts as distance.
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
