"""How much coming and going does the system bear, and what does a camera do that has forgotten?

Little use is lost until cameras leave about as fast as they grow: with a mean stay of 80 periods 0.95 of
the capacity is used, with 24, below the critical C / (n alpha) = 32, 0.72 and hardly a signal is left.
Peaks stay below the growth over the latency. Churn evens out the shares, nearly as a square added to all
costs would. What the whole past costs is the age of the run: it follows those who are present to within 17 %
after 800 periods and 10 % after 8,000, and short memories to within 20 to 22 %, whatever the age. Who has
forgotten an average with costs of power 6 takes 1.35 times the share, as a small average makes a small
response probability; the others pay.
"""  # noqa: D400 - a question

from scenarios.churn.study import main, study

__all__ = ["main", "study"]
