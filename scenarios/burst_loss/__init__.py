"""Does it matter whether losses come in bursts?

Hardly, where each link has bursts of its own that are short against the time in which demand renews
itself, x / alpha, 21 periods in the mean: signals, peaks and shares are those of independent losses.
Longer ones give everybody p alpha B, whatever its costs, so that shares level out, signals become more
frequent, and from 74 periods on do not suffice.  If all links have their bursts together, total demand
runs away by n alpha B in each, and is above the capacity for p of the time and a little more; what is
used is shared as ever.
"""  # noqa: D400 - a question

from scenarios.burst_loss.study import main, study

__all__ = ["main", "study"]
