"""What the study of the paper's experiment found."""

from dataclasses import dataclass

import pandas as pd

from aimd_des import Optimum, Result


@dataclass(frozen=True, eq=False)
class PaperStudy:
    """What the study found."""

    # Length of each run, number of draws of the costs, and seed of the first; draw d has the seed ``seed
    # + d`` for its costs and for its responses.
    steps: int
    draws: int
    seed: int
    # One row per increase, lag, draw and resource.  Columns: signals, relative_error, misallocation,
    # cost_ratio, overshoot_peak, overshoot_time as in `Result.summary`; unused, the share of the capacity
    # that the averages leave; cost_of_use, the cost of sharing optimally what was used, over the optimal
    # cost; peak_bound, one plus what all agents add, over the capacity, before a signal acts.
    measures: pd.DataFrame
    # The run of each draw with the increase as run and the lag as printed; the first is recorded.
    results: tuple[Result, ...]
    optimum: Optimum  # for the first draw
    event_driven_steps: int  # how far the event-driven simulation was held against the algorithm
    same_digests: bool  # whether latency 0.5 and latency 0 gave the digests of lag 1 and lag 0
