"""Loss: which optimum is reached, how agents compensate for it, and how much is survived."""

from functools import partial
from typing import Any, Literal

import numpy as np

from aimd_des import Crossing, Problem, Sampled, theory
from aimd_des.costs import weighted_costs
from aimd_des.lowlevel import FloatArray
from aimd_des.study import jackknife
from models.smart_cameras import smart_cameras
from scenarios.common.measure import Measures, Run, distance, measure
from scenarios.common.systems import critical as critical_loss
from scenarios.common.systems import held, memory_alone, spread
from scenarios.theory_table.rows import Experiment, Row, Rule, Size, estimated, rows_of

_NEAR = Rule("difference", 0.02, "at most 2 %")
_FAR = Rule("at least", 0.0, "at least 5 times")
_LOCATED = Rule("difference", 0.05, "within 0.05")

_Dynamics = Literal["discrete", "continuous"]
_BOTH: tuple[_Dynamics, ...] = ("continuous", "discrete")

# Demand has run away where the control unit signals at practically every opportunity.
_RUN_AWAY = 0.99


def _run(dynamics: _Dynamics, problem: Problem, size: Size, hold_off: float, loss: Any) -> Run:
    unit = Sampled() if dynamics == "discrete" else Crossing(hold_off)
    latency = 1.0 if dynamics == "discrete" else 0.0
    return Run(problem, size.until, size.start, dynamics, unit, latency, loss)


def _labels(run: Run, loss: str) -> dict[str, Any]:
    crossing = isinstance(run.control_unit, Crossing)
    return {
        "setting": f"{'continuous, crossing' if crossing else 'clock, one step later'}, loss {loss}",
        "normalization": float(run.problem.normalization[0]),
        "hold_off": run.control_unit.hold_off if isinstance(run.control_unit, Crossing) else 1.0,
    }


def heterogeneous(size: Size) -> Experiment:
    """Set up runs in which every agent has a loss of its own, from 0 to 0.6."""
    problem, loss = smart_cameras(0), spread(0.0, 0.6)
    runs = [_run(dynamics, problem, size, 0.25, loss) for dynamics in _BOTH]
    return Experiment([(partial(measure, run), partial(_heterogeneous_rows, run)) for run in runs])


def _ratio(problem: Problem, weights: FloatArray, average: FloatArray) -> FloatArray:
    return distance(problem, average) / distance(problem, average, weights)


def _heterogeneous_rows(run: Run, measures: list[Measures]) -> list[Row]:
    problem, loss = run.problem, np.asarray(run.loss)
    share: FloatArray | float = 0.0
    if run.dynamics == "discrete":
        share = theory.predict(problem, "discrete", latency=1.0, loss=loss).signals
    weights = theory.loss_weights(loss[:, None], share) * np.ones((1, problem.n_resources))
    averages, labels = [one.average for one in measures], _labels(run, "0 to 0.6")
    what, rows = "Loss that differs: distance of the averages from the", []
    for words, reduced, predicted, rule in (
        ("reweighted optimum", partial(distance, problem, weights=weights), 0.0, _NEAR),
        ("plain optimum, over that from the reweighted", partial(_ratio, problem, weights), 5.0, _FAR),
    ):
        found, formula = jackknife(averages, reduced), f"{what} {words}"
        rows += rows_of(found, predicted, problem.resource_names, formula=formula, rule=rule, **labels)
    return rows


def compensated(size: Size) -> Experiment:
    """Set up runs in which agents know their loss and compensate for it.

    Gamma and losses are such that no response saturates.
    """
    plain = smart_cameras(0, normalization=1 / 180)
    runs, tops = [], {"continuous": 0.5, "discrete": 0.3}
    for dynamics in _BOTH:
        loss = spread(0.0, tops[dynamics])
        clock = dynamics == "discrete"
        expected = theory.predict(plain, dynamics, latency=float(clock))
        share = expected.signals if clock else np.zeros(plain.n_resources)
        chance = theory.compensated_probability(expected.probability, loss[:, None], share)
        costs = weighted_costs(plain.costs, chance / expected.probability)
        runs.append(_run(dynamics, Problem(plain.resources, costs), size, 0.25, loss))
    return Experiment([(partial(measure, run), partial(_compensated_rows, plain, run)) for run in runs])


def _compensated_rows(plain: Problem, run: Run, measures: list[Measures]) -> list[Row]:
    names, what, labels = (
        plain.resource_names,
        "Loss made good for:",
        _labels(run, f"0 to {np.max(run.loss):g}"),
    )
    found = jackknife([one.average for one in measures], partial(distance, plain))
    words = f"{what} distance of the averages from the plain optimum"
    rows = rows_of(found, 0.0, names, formula=words, rule=_NEAR, **labels)
    words = f"{what} share of responses with a probability above 1"
    rows += estimated([one.saturated for one in measures], 0.0, names, formula=words, **labels)
    words = f"{what} share of the opportunities to signal that are used"
    expected = theory.predict(plain, run.dynamics, latency=run.latency).signals * labels["hold_off"]
    used = [one.signals * labels["hold_off"] for one in measures]
    return rows + estimated(used, expected, names, formula=words, **labels)


def critical(size: Size) -> Experiment:
    """Set up searches for the loss from which on total demand of many agents with memory alone runs away."""
    problem = memory_alone(size.agents)
    return Experiment(
        [(partial(_locate, problem, each, size), partial(_critical_rows, problem, each)) for each in _BOTH]
    )


def _locate(problem: Problem, dynamics: _Dynamics, size: Size, seed: int) -> float:
    """Halve the interval in which the critical loss lies, again and again."""
    low, high, until = 0.05, 0.95, size.critical_until
    unit = Sampled() if dynamics == "discrete" else Crossing(1.0)
    for _ in range(size.halvings):
        loss = 0.5 * (low + high)
        run = Run(problem, until, until / 2, dynamics, unit, 0.0, loss)
        away = measure(run, seed).signals[0] >= _RUN_AWAY
        low, high = (low, loss) if away else (loss, high)
    return 0.5 * (low + high)


def _critical_rows(problem: Problem, dynamics: _Dynamics, found: list[float]) -> list[Row]:
    words = "clock" if dynamics == "discrete" else "continuous, crossing"
    return estimated(
        np.array(found)[:, None],
        critical_loss(problem, 1.0, dynamics),
        problem.resource_names,
        formula="Critical loss",
        setting=f"{words}, {problem.n_agents} agents",
        normalization=float(problem.normalization[0]),
        hold_off=1.0,
        rule=_LOCATED,
    )


def runaway(size: Size) -> Experiment:
    """Set up runs of memory alone beyond the critical loss: total demand comes to rest."""
    problem = memory_alone()
    losses = {dynamics: round(critical_loss(problem, 1.0, dynamics) + 0.15, 2) for dynamics in _BOTH}
    runs = [_run(dynamics, problem, size, 1.0, loss) for dynamics, loss in losses.items()]
    return Experiment([(partial(measure, run), partial(_runaway_rows, run)) for run in runs])


def _runaway_rows(run: Run, measures: list[Measures]) -> list[Row]:
    loss, words = float(np.max(run.loss)), "Beyond the critical loss: mean total demand over capacity"
    level = held(run.problem, run.dynamics, loss=loss).utilisation
    used, labels = [one.utilisation for one in measures], _labels(run, f"{loss:g}")
    return estimated(used, level, run.problem.resource_names, formula=words, **labels)
