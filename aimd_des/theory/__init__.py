"""Closed forms that runs are held against, each with its assumption, its derivation in short and its source.

All are pure functions.  Arguments are numbers, or arrays with one value for each resource that broadcast
together; names and symbols are those of the model.  `predict` puts them together for a `Problem`.
"""

from aimd_des.theory.accuracy import Convergence, Expected, Needed, convergence
from aimd_des.theory.allocations import allocation_at, reweighted_optimum
from aimd_des.theory.averaging import averaging_spread, elasticity, recovery_time, share_rates
from aimd_des.theory.bursts import BurstRunaway, believed_loss, burst_runaway, burst_shares
from aimd_des.theory.churn import Churn, churn
from aimd_des.theory.classics import (
    event_interval,
    event_mean,
    poisson_moment,
    square_root_law,
    synchronised_utilisation,
)
from aimd_des.theory.fluid import Flow, Spell, flow
from aimd_des.theory.hold_off import hold_off_bounds
from aimd_des.theory.limit_cycles import LimitCycle, limit_cycle
from aimd_des.theory.loss_by_load import Congestion, congestion
from aimd_des.theory.losses import compensated_probability, critical_loss, loss_weights, runaway_multiplier
from aimd_des.theory.prediction import Prediction, predict
from aimd_des.theory.recovery import Recovery, recovery
from aimd_des.theory.signals import (
    clock_offset,
    mixture_lift,
    peak_lift,
    price_in_bits,
    signal_rate,
    signal_share,
    utilisation,
)
from aimd_des.theory.steady import SteadyTotal, needed_rate, steady_total
from aimd_des.theory.thresholds import partition_runaway, safe_threshold, time_above

__all__ = [
    "BurstRunaway",
    "Churn",
    "Congestion",
    "Convergence",
    "Expected",
    "Flow",
    "LimitCycle",
    "Needed",
    "Prediction",
    "Recovery",
    "Spell",
    "SteadyTotal",
    "allocation_at",
    "averaging_spread",
    "believed_loss",
    "burst_runaway",
    "burst_shares",
    "churn",
    "clock_offset",
    "compensated_probability",
    "congestion",
    "convergence",
    "critical_loss",
    "elasticity",
    "event_interval",
    "event_mean",
    "flow",
    "hold_off_bounds",
    "limit_cycle",
    "loss_weights",
    "mixture_lift",
    "needed_rate",
    "partition_runaway",
    "peak_lift",
    "poisson_moment",
    "predict",
    "price_in_bits",
    "recovery",
    "recovery_time",
    "reweighted_optimum",
    "runaway_multiplier",
    "safe_threshold",
    "share_rates",
    "signal_rate",
    "signal_share",
    "square_root_law",
    "steady_total",
    "synchronised_utilisation",
    "time_above",
    "utilisation",
]
