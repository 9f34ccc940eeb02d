"""What does a lossy mesh do to cameras far away, and does flooding help?

Along the tree of shortest paths every edge on the way may lose the signal, so who is far away hears less
and takes more: shares are those of costs weighted by the probability of delivery, which is a product over
the path.  That cameras share links changes no share.  Flooding over the same edges delivers nearly all,
brings nearly all of the shares back and halves the signals, for nine times the transmissions of each; who
hangs on a single edge is not helped.
"""  # noqa: D400 - a question

from scenarios.mesh.study import main, study

__all__ = ["main", "study"]
