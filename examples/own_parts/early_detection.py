"""A control unit of one's own: random early detection of a smoothed load, as routers have it.

S. Floyd and V. Jacobson, "Random early detection gateways for congestion avoidance", IEEE/ACM Transactions
on Networking 1, 1993.
"""

from dataclasses import dataclass
from itertools import count

import numpy as np

from aimd_des import InputError, checks
from aimd_des.lowlevel import EventKind, ProcessGenerator, Purpose, System, part, uniforms


@part("control_unit")
@dataclass(frozen=True)
class SmoothedDetection:
    """Samples at regular times, and signals with a probability that grows with the smoothed load.

    Parameters
    ----------
    low, high : float
        Loads, in shares of the threshold, at which the probability begins to grow and is 1.
    weight : float
        Of the newest load in the smoothed one, greater than 0 and at most 1.
    period : float
        Between two samples, greater than 0, in units of time.
    """

    low: float = 0.8
    high: float = 1.1
    weight: float = 0.5
    period: float = 1.0

    def __post_init__(self) -> None:
        checks.number("SmoothedDetection.low", self.low, low=0.0)
        if not self.high > self.low:
            raise InputError.of("SmoothedDetection.high", self.high, f"greater than low = {self.low}")
        checks.number("SmoothedDetection.weight", self.weight, low=0.0, low_open=True, high=1.0)
        checks.number("SmoothedDetection.period", self.period, low=0.0, low_open=True)

    def process(self, system: System) -> ProcessGenerator:
        """Sample, and signal or not."""
        # A draw has an address, the resource and the sample, so it does not depend on what happened before.
        key = system.keys[Purpose.SENSING]
        smoothed = np.zeros(system.problem.n_resources)
        for look in count():
            yield system.env.at(look * self.period, EventKind.SENSE)
            if system.conditions.failed[0]:
                continue
            load = system.totals() / system.parameters.limit
            smoothed += self.weight * (load - smoothed)
            chance = (smoothed - self.low) / (self.high - self.low)
            for resource in range(len(load)):
                if uniforms(key, resource, look, 1)[0] < chance[resource]:
                    system.broadcast(resource)
