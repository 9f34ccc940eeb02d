"""The rule of one agent, written from the page on the model: nothing of it is shared with simulations.

Only the derivative of the private cost and the uniform numbers come from outside, so that a run over sockets
and a simulation can be held against each other signal by signal.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from aimd_des.emulate.averages import Average

Derivative = Callable[[Sequence[float], int], float]

Cut = Literal["drawn", "fractional", "full"]
Divisor = Literal["average", "signals", "cuts"]


@dataclass(frozen=True)
class Rule:
    """How signals are answered."""

    # Multiply by beta with probability lambda; by 1 - (1 - beta) * lambda for certain; or by beta whenever
    # the sum of all lambda passes a whole number.
    cut: Cut = "drawn"
    # What lambda is divided by: the average over time; the mean demand that signals have found; or
    # (1 + beta) / 2 times the mean demand that the agent's own cuts have found.
    divisor: Divisor = "average"
    factor: float = 1.0  # multiplies lambda, for signals that are known to get lost


class Answer(NamedTuple):
    """What an agent has done about a signal."""

    before: float  # demand that the signal has found, in units of the resource
    after: float  # demand from now on
    state: float  # of the average, at the time of the answer
    probability: float  # lambda, not cut off
    responded: bool
    saturated: bool  # whether it responded with a lambda that had to be cut off


class Holding:
    """What an agent knows of one resource: its line of demand, and what it remembers of signals."""

    def __init__(self, increase: float, decrease: float, normalization: float) -> None:
        self.increase, self.decrease, self.normalization = increase, decrease, normalization
        self.since, self.demand, self.state = 0.0, 0.0, 0.0
        self.found, self.count, self.credit = 0.0, 0, 0.0

    def demand_at(self, time: float) -> float:
        """Return the demand at a time on the present line."""
        return self.demand + self.increase * (time - self.since)

    def note(self, demand: float) -> None:
        """Take a demand that was found into the mean of those."""
        self.count += 1
        self.found += (demand - self.found) / self.count


class EmulatedAgent:
    """One agent: a line of demand for each resource, its averages, and its answers."""

    def __init__(
        self, holdings: Sequence[Holding], derivative: Derivative, average: Average, rule: Rule
    ) -> None:
        self.holdings, self.derivative, self.average, self.rule = holdings, derivative, average, rule

    def averages(self, time: float) -> list[float]:
        """Return the averages of all resources."""
        return [self._averaged(held, time)[1] for held in self.holdings]

    def _averaged(self, held: Holding, time: float) -> tuple[float, float]:
        if time <= 0.0:
            return 0.0, 0.0
        state = self.average.fold(held.state, held.since, held.demand, held.increase, time)
        return float(state), float(self.average.mean(state, time))

    def answer(self, resource: int, time: float, uniform: float) -> Answer:
        """Answer a signal that arrives now."""
        held, averages = self.holdings[resource], self.averages(time)
        state = self._averaged(held, time)[0]
        before = held.demand_at(time)
        probability = self._probability(held, averages, resource, before)
        factor = self._factor(held, probability, uniform, before)
        responded = factor < 1.0
        allowed = 1.0 / (1.0 - held.decrease) if self.rule.cut == "fractional" else 1.0
        # A signal that is not answered leaves the line as it is: it is begun anew at the same height.
        held.since, held.demand, held.state = time, before * factor, state
        return Answer(before, held.demand, state, probability, responded, responded and probability > allowed)

    def _probability(self, held: Holding, averages: Sequence[float], resource: int, demand: float) -> float:
        divisor = averages[resource]
        if self.rule.divisor == "signals":
            held.note(demand)
            divisor = held.found
        elif self.rule.divisor == "cuts" and held.count:
            divisor = 0.5 * (1.0 + held.decrease) * held.found
        if divisor <= 0.0:
            return 0.0
        slope = self.derivative(averages, resource)
        return self.rule.factor * held.normalization * slope / divisor

    def _factor(self, held: Holding, probability: float, uniform: float, demand: float) -> float:
        if self.rule.cut == "drawn":
            return held.decrease if uniform < probability else 1.0
        if self.rule.cut == "fractional":
            return max(0.0, 1.0 - (1.0 - held.decrease) * probability)
        held.credit += min(1.0, probability)
        if held.credit < 1.0:
            return 1.0
        held.credit -= 1.0
        if self.rule.divisor == "cuts":
            held.note(demand)
        return held.decrease
