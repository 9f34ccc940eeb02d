"""How far does total demand run away in an outage, when is it back, and who pays for it?

No further than n alpha (duration + latency), and, behind a short latency, in the mean half a saw tooth less:
91 % of the capacity after 20 periods in which nobody hears. How long the way back takes is a matter of the
hold-off, as each brings a signal: 2.8 periods with 0.25, 13.7 with 1. Nobody gets less then; the resource
pays. If only half of the agents are cut off, the others give way, as far as signals let them: demand runs
away by 8 % with hold-off 0.25, and by 35 % with 1. Averages remember, and pay a little back.
"""  # noqa: D400 - a question

from scenarios.outage.study import main, study

__all__ = ["main", "study"]
