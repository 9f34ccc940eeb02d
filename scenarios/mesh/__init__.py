"""What does a lossy mesh do to cameras far away, and does flooding help?

Along the tree of shortest paths every edge on the way may lose the signal, so who is far away hears less
and takes more: shares are those of costs weighted by the probability of delivery, which is a product over
the path.  How much that is differs from network to network by factors.  Sending over each edge of the tree
three times brings the shares back in all of them, for half of the transmissions that flooding takes; and
flooding does not help who hangs on a single edge.  Knowing the loss is cheapest, where responses leave room.
"""  # noqa: D400 - a question

from scenarios.mesh.study import main, study

__all__ = ["main", "study"]
