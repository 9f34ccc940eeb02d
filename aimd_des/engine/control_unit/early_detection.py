"""Random early detection: the higher total demand, the more probable a signal (Floyd and Jacobson, 1993)."""

from dataclasses import dataclass

from aimd_des.dynamics.clocks import Clock
from aimd_des.engine.control_unit.base import SampledTable
from aimd_des.engine.control_unit.sampled import SampledUnit
from aimd_des.utils import validation
from aimd_des.utils.parts import built_in
from aimd_des.utils.shown import brief


@built_in("control_unit", "early_detection")
@brief
@dataclass(frozen=True)
class EarlyDetection(SampledUnit):
    """A control unit that signals at random, the more probably the higher total demand is.

    It samples at ``phase + q * period``.  At each sample it signals for each resource with the probability
    ``(total / threshold - low) / (high - low)``, cut off at 0 and at 1.

    Parameters
    ----------
    period : float
        Time between two samples, greater than 0.
    low : float
        Up to this share of the threshold it never signals; at least 0.
    high : float
        From this share of the threshold on it always signals; greater than `low`.
    phase : float
        Time of the first sample, at least 0.
    sensing_delay : float
        How long after a sample its signals leave the control unit, at least 0; a partition, or a fault of the
        control unit, cuts those that leave while it lasts.

    Notes
    -----
    The decision on a resource at sample q is drawn at the address (resource, q): it depends neither on other
    events of the run nor on whether agents are processes or a fleet.  Floyd and Jacobson (1993) average the
    queue before they compare it; here total demand is compared as it is at the sample.

    Examples
    --------
    >>> EarlyDetection(low=0.8, high=1.2).table().low
    0.8
    """

    period: float = 1.0
    low: float = 0.9
    high: float = 1.1
    phase: float = 0.0
    sensing_delay: float = 0.0

    def __post_init__(self) -> None:
        clock = Clock(self.period, self.phase)
        low = validation.number("low", self.low, low=0.0)
        clean = {
            "period": clock.period,
            "low": low,
            "high": validation.number("high", self.high, low=low, low_open=True),
            "phase": clock.phase,
            "sensing_delay": validation.number("sensing_delay", self.sensing_delay, low=0.0),
        }
        for name, value in clean.items():
            object.__setattr__(self, name, value)

    def table(self) -> SampledTable:
        """Say when the unit samples, and between which shares of the threshold the probability rises."""
        return SampledTable(self.period, self.phase, self.sensing_delay, self.low, self.high)
