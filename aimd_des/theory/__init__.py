"""Closed forms that runs are held against, each with its assumption, its derivation in short and its source.

All are pure functions.  Arguments are numbers, or arrays with one value for each resource that broadcast
together; names and symbols are those of the model.  `predict` puts them together for a `Problem`.
"""

from typing import TYPE_CHECKING

from aimd_des.utils.on_demand import on_demand

if TYPE_CHECKING:
    from aimd_des.theory.accuracy import Convergence, Expected, Needed, convergence
    from aimd_des.theory.allocations import allocation_at, reweighted_optimum
    from aimd_des.theory.averaging import averaging_spread, elasticity, recovery_time, share_rates
    from aimd_des.theory.bursts import BurstRunaway, believed_loss, burst_runaway, burst_shares
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
    from aimd_des.theory.losses import (
        compensated_probability,
        critical_loss,
        loss_weights,
        runaway_multiplier,
    )
    from aimd_des.theory.prediction import Prediction, predict
    from aimd_des.theory.recovery_times import Recovery, recovery
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
    from aimd_des.theory.turnover import Churn, churn

# Where each name lives: most of SciPy, which is slow to import, is needed by few of them.
_HOME = {
    "BurstRunaway": "bursts",
    "Churn": "turnover",
    "Congestion": "loss_by_load",
    "Convergence": "accuracy",
    "Expected": "accuracy",
    "Flow": "fluid",
    "LimitCycle": "limit_cycles",
    "Needed": "accuracy",
    "Prediction": "prediction",
    "Recovery": "recovery_times",
    "Spell": "fluid",
    "SteadyTotal": "steady",
    "allocation_at": "allocations",
    "averaging_spread": "averaging",
    "believed_loss": "bursts",
    "burst_runaway": "bursts",
    "burst_shares": "bursts",
    "churn": "turnover",
    "clock_offset": "signals",
    "compensated_probability": "losses",
    "congestion": "loss_by_load",
    "convergence": "accuracy",
    "critical_loss": "losses",
    "elasticity": "averaging",
    "event_interval": "classics",
    "event_mean": "classics",
    "flow": "fluid",
    "hold_off_bounds": "hold_off",
    "limit_cycle": "limit_cycles",
    "loss_weights": "losses",
    "mixture_lift": "signals",
    "needed_rate": "steady",
    "partition_runaway": "thresholds",
    "peak_lift": "signals",
    "poisson_moment": "classics",
    "predict": "prediction",
    "price_in_bits": "signals",
    "recovery": "recovery_times",
    "recovery_time": "averaging",
    "reweighted_optimum": "allocations",
    "runaway_multiplier": "losses",
    "safe_threshold": "thresholds",
    "share_rates": "averaging",
    "signal_rate": "signals",
    "signal_share": "signals",
    "square_root_law": "classics",
    "steady_total": "steady",
    "synchronised_utilisation": "classics",
    "time_above": "thresholds",
    "utilisation": "signals",
}

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

__getattr__, __dir__ = on_demand(__name__, _HOME)
