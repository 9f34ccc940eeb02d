"""How fast do averages follow when 40 % of a capacity is lost, and what does a shorter memory cost?

The average of the paper, over all of a run, is the slower the older the run: it takes eight times the age at
the drop until it is within 5 % of the new optimum. A window of 400 periods takes 0.9 of its length. Whether
forgetting with half of that as its time constant, which has the same noise, is sooner depends on the drop:
after one of 20 % it takes a sixth less, after 40 % a quarter more. A ramp is much like a step at its middle.
Formulas meet this to one per cent once they know how much of the capacity is used. The price is noise: with
the short memories an agent's average scatters by 12 %, and no single run comes within 5 %.
"""  # noqa: D400 - a question

from scenarios.capacity_drop.study import main, study

__all__ = ["main", "study"]
