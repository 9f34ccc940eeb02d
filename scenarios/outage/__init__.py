"""How far does total demand run away in an outage, when is it back, and who pays for it?

No further than n alpha (duration + latency), and in the mean half a saw tooth less: 90 % of the capacity
after 20 periods in which nobody hears. It is back within three periods, a signal each hold-off. Nobody gets
less then; the resource pays. If only half of the agents are cut off, the others give way, so that demand
runs away by 7 % only, and pay with 17 periods of their share; averages remember, and pay a little back.
"""  # noqa: D400 - a question

from scenarios.outage.study import main, study

__all__ = ["main", "study"]
