"""How long the copies of a signal are on their way: the models that `BroadcastChannel` takes."""

from aimd_des.channel.latency import (
    Constant,
    Empirical,
    Exponential,
    Latency,
    LogNormal,
    Pareto,
    ShiftedGamma,
    Uniform,
)

__all__ = [
    "Constant",
    "Empirical",
    "Exponential",
    "Latency",
    "LogNormal",
    "Pareto",
    "ShiftedGamma",
    "Uniform",
]
