"""The measures that summaries are made of, for averages of one's own, and the list of all measures."""

from aimd_des.results.measures import measures
from aimd_des.results.metrics import consensus_spread, cost_ratio, relative_error, utilisation

__all__ = ["consensus_spread", "cost_ratio", "measures", "relative_error", "utilisation"]
