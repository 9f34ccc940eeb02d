"""A latency of one's own: log-logistic, as round-trip times in large networks often are."""

from dataclasses import dataclass
from typing import Any

import numba

from aimd_des import checks
from aimd_des.lowlevel import Draws, FloatArray, Purpose, exp, exps, log, logs, part, quantile_table


@numba.njit
def quantile(u: float, median: float, shape: float) -> float:
    """Give the latency at which the distribution function is u."""
    return median * exp((log(u) - log(1.0 - u)) / shape)


@part("latency")
@dataclass(frozen=True)
class LogLogistic:
    """Latency whose logarithm has a logistic distribution.

    Parameters
    ----------
    median : float
        Half of the copies take longer; greater than 0, in units of time.
    shape : float
        Tail exponent, at least 0.1: P(latency > x) falls like x**-shape.
    """

    median: float
    shape: float = 4.0

    def __post_init__(self) -> None:
        checks.number("LogLogistic.median", self.median, low=0.0, low_open=True)
        checks.number("LogLogistic.shape", self.shape, low=0.1)

    def check(self, n_agents: int) -> None:
        """Accept any number of agents: all have the same distribution."""

    def draw(self, draws: Draws) -> FloatArray:
        """Draw the latency of each agent's copy, shape (n,)."""
        u = draws.uniforms(Purpose.LATENCY)
        return self.median * exps((logs(u) - logs(1.0 - u)) / self.shape)

    def table(self, n_agents: int) -> Any:
        """Let compiled code draw the same; without this method a fleet calls `draw`, more slowly."""
        return quantile_table(quantile, n_agents, self.median, self.shape)
