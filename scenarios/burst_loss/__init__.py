"""Does it matter whether losses come in bursts?

Hardly, where each link has bursts of its own and n p alpha B / C, the part of the capacity that bad links
hold, is small.  What is larger gives everybody p alpha B, whatever its costs: shares level out, signals
become more frequent, and in the end do not suffice.  If all links have their bursts together, total demand
runs away by n alpha B in each, and is above the capacity for p of the time and a little more; shares stay
as they are up to bursts of some tens of periods.  Agents that make good for loss make it worse where bursts
are long.
"""  # noqa: D400 - a question

from scenarios.burst_loss.study import main, study

__all__ = ["main", "study"]
