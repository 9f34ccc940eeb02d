"""How many copies of a broadcast arrive over a network, and how late.

Along the one path of a tree, arcs are independent of each other, and losses of latencies:

    delivery = product of (1 - p),    mean = sum of means,    variance = sum of variances.

Flooding takes the fastest of many paths, which share arcs: whether any survives is the reliability of
a network, which no formula of polynomial length is known for (L. G. Valiant, "The complexity of
enumeration and reliability problems", SIAM Journal on Computing 8, 1979).  It is estimated by draws.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from aimd_des.channel.broadcast import Broadcast, CompiledLink, Link
from aimd_des.channel.topology.routes import Routes
from aimd_des.utils import rng, validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.rng import Key, Purpose
from aimd_des.utils.validation import FloatArray

if TYPE_CHECKING:
    import pandas as pd


def tree_statistics(routes: Routes, latency: object, loss: object) -> "pd.DataFrame":
    """Compute the statistics of a tree."""
    lost = _of_arcs(routes, "loss", loss, "mean")
    means, variances = (_of_arcs(routes, "latency", latency, name) for name in ("mean", "variance"))
    delivery, mean, variance = np.zeros((3, len(routes.head) + 1))
    delivery[0] = 1.0
    # By their tails: a node's values are known before any arc that leaves it is looked at.
    for arc in np.argsort(routes.tail, kind="stable").tolist():
        tail, head = routes.tail[arc], routes.head[arc]
        delivery[head] = delivery[tail] * (1.0 - lost[arc])
        mean[head] = mean[tail] + means[arc]
        variance[head] = variance[tail] + variances[arc]
    arrives = delivery[routes.node] > 0.0
    late = np.where(arrives, (mean[routes.node], np.sqrt(variance[routes.node])), np.nan)
    return _frame(routes, delivery=delivery[routes.node], latency_mean=late[0], latency_std=late[1])


def _of_arcs(routes: Routes, field: str, model: object, name: str) -> FloatArray:
    if not hasattr(model, name):
        raise InputError(f"statistics: {field}: {type(model).__name__} has no attribute `{name}`")
    return np.broadcast_to(np.asarray(getattr(model, name), dtype=np.float64), routes.head.shape)


def estimated_statistics(
    routes: Routes, begin: Callable[[int, Mapping[Purpose, Key]], Link], broadcasts: int, seed: int
) -> "pd.DataFrame":
    """Estimate the statistics of a network from draws."""
    count = validation.integer("broadcasts", broadcasts, low=2)
    keys = {purpose: rng.key(seed, purpose) for purpose in Purpose}
    arrived, mean, squares = np.zeros((3, len(routes.agents)))
    link = begin(len(routes.agents), keys)
    for number in range(count):
        latency = link.transmit(Broadcast(0, number, 0.0), 0.0).arrival
        # Begun anew each time, so that bursts of loss do not make broadcasts depend on each other.
        if isinstance(link, CompiledLink):
            link.renew()
        else:
            link = begin(len(routes.agents), keys)
        (here,) = np.nonzero(latency < np.inf)
        arrived[here] += 1.0
        # B. P. Welford's way, which subtracts no large numbers from each other.
        away = latency[here] - mean[here]
        mean[here] += away / arrived[here]
        squares[here] += away * (latency[here] - mean[here])
    delivery = arrived / count
    variance = np.divide(squares, arrived - 1.0, out=np.full_like(squares, np.nan), where=arrived > 1.0)
    # Where nothing arrives the denominator counts for nothing: the numerator is not a number.
    return _frame(
        routes,
        delivery=delivery,
        latency_mean=np.where(arrived > 0.0, mean, np.nan),
        latency_std=np.sqrt(variance),
        delivery_error=np.sqrt(delivery * (1.0 - delivery) / count),
        latency_mean_error=np.sqrt(variance / np.maximum(arrived, 1.0)),
    )


def _frame(routes: Routes, **columns: FloatArray) -> "pd.DataFrame":
    import pandas as pd

    given: dict[str, Any] = {"agent": list(routes.agents), "hops": routes.hops, **columns}
    return pd.DataFrame(given)
