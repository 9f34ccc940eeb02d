"""Can signals be lost to the excess that they report?

They can: where loss grows with the load, demand that has once passed a turning load does not come back by
itself, and rests at a multiple of the capacity.  Theory has that load; hold-offs far below 1 / rho put it far
away, and a channel that keeps enough of its capacity for signals has none.  Where an agent loses signals in
proportion to what it holds, shares are distorted a little, until single agents run away for themselves.
"""  # noqa: D400 - a question

from scenarios.congested_channel.study import main, study

__all__ = ["main", "study"]
