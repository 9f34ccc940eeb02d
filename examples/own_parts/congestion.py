"""Latency and loss that are correlated over time: a channel that is calm and congested by turns."""

from dataclasses import dataclass
from itertools import cycle

from aimd_des import BroadcastChannel, Problem, checks, interventions, latency
from aimd_des.lowlevel import EventKind, ProcessGenerator, Purpose, System, generator, log1p, part


@part("intervention")
@dataclass(frozen=True)
class Congestion:
    """The channel of all agents is a Markov chain in continuous time of two states, which begins calm.

    It replaces the channel of the scenario. The compiled channel of a fleet draws the latencies.

    Parameters
    ----------
    calm : float
        Mean latency while it is calm, at least 0, in units of time.
    congested : float
        Mean latency during congestion, at least 0, in units of time.
    mean_calm : float
        Mean duration of calm, greater than 0, in units of time.
    mean_congestion : float
        Mean duration of congestion, greater than 0, in units of time.
    loss_calm : float
        Probability of loss while it is calm, from 0 to 1.
    loss_congested : float
        Probability of loss during congestion, from 0 to 1.
    """

    calm: float
    congested: float
    mean_calm: float
    mean_congestion: float
    loss_calm: float = 0.0
    loss_congested: float = 0.0

    def __post_init__(self) -> None:
        checks.number("Congestion.calm", self.calm, low=0.0)
        checks.number("Congestion.congested", self.congested, low=0.0)
        checks.number("Congestion.mean_calm", self.mean_calm, low=0.0, low_open=True)
        checks.number("Congestion.mean_congestion", self.mean_congestion, low=0.0, low_open=True)
        checks.number("Congestion.loss_calm", self.loss_calm, low=0.0, high=1.0)
        checks.number("Congestion.loss_congested", self.loss_congested, low=0.0, high=1.0)

    def check(self, problem: Problem) -> None:
        """Accept any problem."""

    def process(self, system: System) -> ProcessGenerator:
        """Change the channel whenever the state changes; runs of one seed are congested at the same times."""
        draws = generator(int(system.keys[Purpose.LATENCY][0]), Purpose.LATENCY)
        calm = BroadcastChannel(latency.Exponential(self.calm), self.loss_calm)
        congested = BroadcastChannel(latency.Exponential(self.congested), self.loss_congested)
        begin = 0.0
        for channel, mean in cycle([(calm, self.mean_calm), (congested, self.mean_congestion)]):
            yield system.env.at(begin, EventKind.INTERVENE)
            interventions.set_channel(system, channel)
            # Portable, where NumPy's own exponential numbers may differ between machines.
            begin -= mean * log1p(-draws.random())
