"""A camera sees something unusual: how fast does it get more, and what does a short memory cost?

Demand answers at once, over tens of periods, as the response probability does; the average follows as fast
as its memory allows. Over all of the past, a camera with quadratic costs has made 43 % of the way after
500 periods, and one with steep costs gets there by holding far more than its new share for a while, which
it pays back afterwards. Forgetting with time constant 100 is half-way after 126 and 45 periods, and costs
a scatter of the averages of 13 and 8 % instead of 8 and 4 %.
"""  # noqa: D400 - a question

from scenarios.unusual_activity.study import main, study

__all__ = ["main", "study"]
