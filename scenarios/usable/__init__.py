"""Which delays and losses are usable: demand below the capacity, shares right?

Usable is what leaves demand above the capacity for at most 1 % of the time, and averages at most 5 % from the
optimum for what they use.  The first is a matter of the threshold: the growth over the latency must fit
between it and the capacity, whatever the hold-off.  The second is one of the hold-off: signals on their way
may take about one and a half times the capacity.  The limit cycle of theory has both.  Losses that are the
same for all cost no shares; what leaves demand below the capacity is less than what is survived.
"""  # noqa: D400 - a question

from scenarios.usable.study import main, study

__all__ = ["main", "study"]
