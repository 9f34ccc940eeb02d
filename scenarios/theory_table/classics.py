"""Results from the literature on AIMD: synchronised agents, fixed probabilities, signals at random times."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from aimd_des import Crossing, PolynomialCosts, Problem, Recording, Resource, Result, Simulation, theory
from aimd_des.lowlevel import EventKind, FloatArray, ProcessGenerator, System
from scenarios.theory_table.rows import Experiment, Row, Rule, Size, estimated

_TWO_PERCENT = Rule("relative", 0.02, "within 2 %")
_EXACT = Rule("relative", 0.002, "within 0.2 %")
_AGENTS = 20

# What is measured in a run, and what theory has for it, by formula.
_Outcome = dict[str, tuple[float, Any]]


def _problem(increase: Any, decrease: Any, probability: FloatArray, capacity: float) -> Problem:
    """Make a problem in which agents respond with fixed probabilities: costs c_i x**2, Gamma 1/2."""
    resource = Resource("all", capacity, increase, decrease, 0.5)
    return Problem([resource], PolynomialCosts([2], probability[:, None, None]))


def _continuous(problem: Problem, unit: Any, seed: int, until: float, recording: Recording) -> Result:
    simulation = Simulation(problem, dynamics="continuous", control_unit=unit, seed=seed, recording=recording)
    return simulation.run(until)


def _intervals(result: Result) -> float:
    """Average the time between signals, over the second half of them."""
    times = result.signals_sent.time
    return float(np.diff(times[len(times) // 2 :]).mean())


def _synchronised(until: float, seed: int) -> _Outcome:
    """Draw increases and decreases, let all respond to every signal, and compare with the fixed point."""
    rng = np.random.default_rng([2018, seed])
    alpha, beta = rng.uniform(0.5, 1.5, _AGENTS) / _AGENTS, rng.uniform(0.3, 0.8, _AGENTS)
    problem = _problem(alpha, beta, np.ones(_AGENTS), 4.0)
    start = until / 2
    result = _continuous(problem, Crossing(0.0), seed, until, Recording([start], [start]))
    held = result.observations.average[:, 0]
    mean = (until * held[-1] - start * held[0]) / (until - start)
    saw = 0.5 * (1.0 + beta) * theory.event_mean(4.0, alpha, beta)
    found = {
        "period": _intervals(result) / float(theory.event_interval(4.0, alpha, beta)),
        "mean utilisation": mean.sum() / 4.0 / float(theory.synchronised_utilisation(alpha, beta)),
        "shares (1 − sum of deviations over sum)": float(1.0 - np.abs(mean - saw).sum() / saw.sum()),
    }
    return {f"Synchronised agents, over theory: {name}": (ratio, 1.0) for name, ratio in found.items()}


def _mixed() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Give agents that differ in everything: alpha, beta, probability."""
    rng = np.random.default_rng(2018)
    alpha = rng.uniform(0.5, 1.5, _AGENTS) / _AGENTS
    return alpha, rng.uniform(0.3, 0.8, _AGENTS), rng.uniform(0.1, 0.6, _AGENTS)


def _fixed_probabilities(until: float, seed: int) -> tuple[float, FloatArray]:
    """Measure shares at events: responses are drawn apart, so responders are a fair sample."""
    alpha, beta, chance = _mixed()
    problem = _problem(alpha, beta, chance, 8.0)
    recording = Recording("end", "end", overshoot=False, events=True)
    result = _continuous(problem, Crossing(0.0), seed, until, recording)
    log = result.events
    cuts = log[(log["kind"] == "respond") & (log["time"] >= until / 5)]
    taken = cuts.groupby(cuts["agent"].cat.codes)["value"].mean()
    return _intervals(result), taken.reindex(range(_AGENTS)).to_numpy() / (1.0 - beta)


class _Drawn:
    """A control unit that signals at random times, at a rate per unit of time or of demand and time."""

    def __init__(self, seed: int, rate: float, *, per_demand: bool = False) -> None:
        self.random = np.random.default_rng([2018, seed])
        self.rate, self.per_demand = rate, per_demand

    def process(self, system: System) -> ProcessGenerator:
        """Signal when the integral of the rate has reached the next exponential number."""
        slope = float(system.parameters.increase[0].sum())
        while True:
            # At an instant copies land before any look: the last signal has been answered here.
            yield system.env.at(system.env.now, EventKind.SENSE)
            wait = self.random.exponential() / self.rate
            if self.per_demand:
                held = system.total(0)
                wait = 2.0 * wait / (held + np.sqrt(held * held + 2.0 * slope * wait))
            yield system.env.at(system.env.now + wait, EventKind.SENSE)
            system.broadcast(0)


def _poisson(until: float, seed: int) -> _Outcome:
    """Take moments of agents with alpha 1 and beta 0.5 that answer every other one of the signals."""
    problem = _problem(1.0, 0.5, np.full(_AGENTS, 0.5), 1000.0)
    looks = np.arange(until / 5, until, 0.5)
    result = _continuous(problem, _Drawn(seed, 1.0), seed, until, Recording("end", looks, overshoot=False))
    held = result.observations.demand
    first, second = (theory.poisson_moment(1.0, 0.5, 0.5, order) for order in (1, 2))
    return {
        "Poisson signals: first moment": (held.mean(), first),
        "Poisson signals: second moment": ((held**2).mean(), second),
    }


def _flow(until: float, seed: int) -> _Outcome:
    """Let each packet of one flow be lost with probability 0.002."""
    problem = _problem(1.0, 0.5, np.ones(1), 1e6)
    start = until / 5
    unit = _Drawn(seed, 0.002, per_demand=True)
    result = _continuous(problem, unit, seed, until, Recording("end", [start], overshoot=False))
    held = result.observations.average[:, 0, 0]
    mean = (until * held[-1] - start * held[0]) / (until - start)
    return {
        "Square-root law, a loss per packet": (mean, theory.square_root_law(1.0, 0.5, 0.002, "per_packet"))
    }


def classics(size: Size) -> Experiment:
    """Set up runs of small systems with fixed response probabilities."""
    drawn, mixed = "alpha and beta drawn for each replication", "alpha, beta and lambda differ"
    known, lost = "alpha 1, beta 0.5, rate 0.5", "alpha 1, beta 0.5, loss 0.002"
    return Experiment(
        [
            (partial(_synchronised, size.until), partial(_rows, drawn, _EXACT)),
            (partial(_fixed_probabilities, size.until), partial(_rows_of_shares, mixed)),
            (partial(_poisson, size.until), partial(_rows, known, _TWO_PERCENT)),
            (partial(_flow, 20 * size.until), partial(_rows, lost, _TWO_PERCENT)),
        ]
    )


def _rows(setting: str, rule: Rule, runs: Sequence[_Outcome]) -> list[Row]:
    rows: list[Row] = []
    for formula, (_, predicted) in runs[0].items():
        values = np.array([[run[formula][0]] for run in runs])
        labels = {"setting": setting, "normalization": 0.5, "hold_off": 0.0, "rule": rule}
        rows += estimated(values, predicted, ["all"], formula=formula, **labels)
    return rows


def _rows_of_shares(setting: str, runs: list[tuple[float, FloatArray]]) -> list[Row]:
    """Make rows of the time between events, and of shares at them: of all agents, and of the farthest one."""
    wanted, interval = (law(8.0, *_mixed()) for law in (theory.event_mean, theory.event_interval))
    ratios = [shares / wanted for _, shares in runs]
    worst = int(np.abs(np.mean(ratios, axis=0) - 1.0).argmax())
    words = "Fixed probabilities:"
    outcomes: list[_Outcome] = [
        {
            f"{words} time between events": (found, interval),
            # Averaged over the agents: each of them should be 1.
            f"{words} share at events, over theory": (ratio.mean(), 1.0),
            f"{words} share at events, agent {worst}, the farthest": (shares[worst], wanted[worst]),
        }
        for (found, shares), ratio in zip(runs, ratios, strict=True)
    ]
    return _rows(setting, _TWO_PERCENT, outcomes)
