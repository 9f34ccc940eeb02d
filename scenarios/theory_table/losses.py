"""Loss: which optimum is reached, how agents make good for it, and how much is survived."""

from functools import partial
from typing import Any, Literal

import numpy as np

from aimd_des import Crossing, Problem, Sampled, theory
from aimd_des.costs import weighted_costs
from aimd_des.lowlevel import FloatArray
from aimd_des.study import jackknife
from models.smart_cameras import smart_cameras
from scenarios.common.measure import Measures, Run, distance, measure
from scenarios.common.systems import memory_alone, spread
from scenarios.common.theory import critical as critical_loss
from scenarios.common.theory import held
from scenarios.theory_table.rows import Experiment, Row, Rule, Size, estimated

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


def _words(dynamics: str, loss: str) -> str:
    return f"{'clock, one step later' if dynamics == 'discrete' else 'continuous, crossing'}, loss {loss}"


def _pooled(
    runs: list[Measures], measure_of: Any, names: tuple[str, ...], predicted: float, **labels: Any
) -> list[Row]:
    value, error = jackknife([run.average for run in runs], measure_of)
    return [
        Row(
            resource=name, predicted=predicted, mean=float(value[j]), standard_error=float(error[j]), **labels
        )
        for j, name in enumerate(names)
    ]


def heterogeneous(size: Size) -> Experiment:
    """Set up runs in which every agent has a loss of its own, from 0 to 0.6."""
    problem, loss = smart_cameras(0), spread(0.0, 0.6)
    runs = [_run(dynamics, problem, size, 0.25, loss) for dynamics in _BOTH]
    return Experiment([partial(measure, run) for run in runs], partial(_heterogeneous_rows, runs))


def _ratio(problem: Problem, weights: FloatArray, average: FloatArray) -> FloatArray:
    return distance(problem, average) / distance(problem, average, weights)


def _heterogeneous_rows(runs: list[Run], outcomes: list[list[Measures]]) -> list[Row]:
    rows: list[Row] = []
    for run, measures in zip(runs, outcomes, strict=True):
        problem, loss = run.problem, np.asarray(run.loss)
        share: FloatArray | float = 0.0
        if run.dynamics == "discrete":
            share = theory.predict(problem, "discrete", latency=1.0, loss=loss).signals
        weights = theory.loss_weights(loss[:, None], share) * np.ones((1, problem.n_resources))

        near = partial(distance, problem, weights=weights)

        labels = {
            "setting": _words(run.dynamics, "0 to 0.6"),
            "normalization": float(problem.normalization[0]),
            "hold_off": 1.0 if run.dynamics == "discrete" else 0.25,
        }
        names, what = problem.resource_names, "Loss that differs: distance of the averages from the"
        rows += _pooled(
            measures, near, names, 0.0, formula=f"{what} reweighted optimum", rule=_NEAR, **labels
        )
        words = f"{what} plain optimum, over that from the reweighted"
        rows += _pooled(
            measures, partial(_ratio, problem, weights), names, 5.0, formula=words, rule=_FAR, **labels
        )
    return sorted(rows, key=lambda row: row.rule is _FAR)


def compensated(size: Size) -> Experiment:
    """Set up runs in which agents know their loss and make good for it.

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
    return Experiment([partial(measure, run) for run in runs], partial(_compensated_rows, plain, runs))


def _compensated_rows(plain: Problem, runs: list[Run], outcomes: list[list[Measures]]) -> list[Row]:
    rows: list[Row] = []
    for run, measures in zip(runs, outcomes, strict=True):
        labels: dict[str, Any] = {
            "setting": _words(run.dynamics, f"0 to {np.max(run.loss):g}"),
            "normalization": float(plain.normalization[0]),
            "hold_off": 1.0 if run.dynamics == "discrete" else 0.25,
        }
        words = "Loss made good for: distance of the averages from the plain optimum"
        rows += _pooled(
            measures, partial(distance, plain), plain.resource_names, 0.0, formula=words, rule=_NEAR, **labels
        )
        words = "Loss made good for: share of responses with a probability above 1"
        shares = [run.saturated for run in measures]
        rows += estimated(shares, np.zeros(plain.n_resources), plain.resource_names, formula=words, **labels)
        expected = theory.predict(plain, run.dynamics, latency=run.latency)
        words = "Loss made good for: share of the opportunities to signal that are used"
        used = [found.signals * labels["hold_off"] for found in measures]
        rows += estimated(
            used, expected.signals * labels["hold_off"], plain.resource_names, formula=words, **labels
        )
    order = {name: place for place, name in enumerate(dict.fromkeys(row.formula for row in rows))}
    return sorted(rows, key=lambda row: order[row.formula])


def critical(size: Size) -> Experiment:
    """Set up searches for the loss from which on total demand of many agents with memory alone runs away."""
    problem = memory_alone(size.agents)
    jobs = [partial(_locate, problem, dynamics, size) for dynamics in _BOTH]
    return Experiment(list(jobs), partial(_critical_rows, problem))


def _locate(problem: Problem, dynamics: _Dynamics, size: Size, seed: int) -> float:
    """Halve the interval in which the critical loss lies, again and again."""
    low, high = 0.05, 0.95
    for _ in range(size.halvings):
        loss = 0.5 * (low + high)
        until = size.critical_until
        unit = Sampled() if dynamics == "discrete" else Crossing(1.0)
        run = Run(problem, until, until / 2, dynamics, unit, 0.0, loss)
        if measure(run, seed).signals[0] >= _RUN_AWAY:
            high = loss
        else:
            low = loss
    return 0.5 * (low + high)


def _critical_rows(problem: Problem, outcomes: list[list[float]]) -> list[Row]:
    rows: list[Row] = []
    for dynamics, found in zip(_BOTH, outcomes, strict=True):
        words = "clock" if dynamics == "discrete" else "continuous, crossing"
        rows += estimated(
            np.array(found)[:, None],
            critical_loss(problem, 1.0, dynamics),
            problem.resource_names,
            formula="Critical loss",
            setting=f"{words}, {problem.n_agents} agents",
            normalization=float(problem.normalization[0]),
            hold_off=1.0,
            rule=_LOCATED,
        )
    return rows


def runaway(size: Size) -> Experiment:
    """Set up runs of memory alone beyond the critical loss: total demand comes to rest."""
    problem, runs = memory_alone(), []
    for dynamics in _BOTH:
        loss = round(critical_loss(problem, 1.0, dynamics) + 0.15, 2)
        runs.append(_run(dynamics, problem, size, 1.0, loss))
    return Experiment([partial(measure, run) for run in runs], partial(_runaway_rows, runs))


def _runaway_rows(runs: list[Run], outcomes: list[list[Measures]]) -> list[Row]:
    rows: list[Row] = []
    for run, measures in zip(runs, outcomes, strict=True):
        problem = run.problem
        level = held(problem, 1.0, 0.0, float(np.max(run.loss)), run.dynamics)[1]
        rows += estimated(
            [row.utilisation for row in measures],
            level,
            problem.resource_names,
            formula="Beyond the critical loss: mean total demand over capacity",
            setting=_words(run.dynamics, f"{np.max(run.loss):g}"),
            normalization=float(problem.normalization[0]),
            hold_off=1.0,
        )
    return rows
