"""How long the copies of a signal are on their way."""

from aimd_des.channel.latency.base import Latency
from aimd_des.channel.latency.constant import Constant
from aimd_des.channel.latency.empirical import Empirical
from aimd_des.channel.latency.gamma import ShiftedGamma
from aimd_des.channel.latency.inverted import Exponential, LogNormal, Pareto, Uniform

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
