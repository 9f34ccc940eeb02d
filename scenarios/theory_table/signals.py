"""Signals, utilisation, price and peaks of the paper's system, with and without loss."""

from functools import partial
from typing import NamedTuple

import numpy as np

from aimd_des import Crossing, Problem, Sampled, solve_optimum, theory
from aimd_des.lowlevel import FloatArray
from models.smart_cameras import smart_cameras
from scenarios.common.measure import Measures, Run, measure
from scenarios.theory_table.rows import Experiment, Row, Rule, Size, estimated

_SIGNALS = Rule("relative", 0.05, "within 5 %")
_UTILISATION = Rule("difference", 0.02, "within 2 points")
_FAR_FROM_CRITICAL = 0.8


class _Case(NamedTuple):
    setting: str
    run: Run
    hold_off: float
    first_order: bool = False


def _cases(size: Size) -> list[_Case]:
    ninety, half = smart_cameras(0), smart_cameras(0, normalization=1 / 180)
    tick = partial(Run, ninety, size.until, size.start)
    long = partial(Run, ninety, size.steps, size.steps // 5)
    flow = partial(tick, dynamics="continuous")
    return [
        _Case("clock, acts one step later", long(latency=1.0), 1.0, True),
        _Case("clock, acts in the same step", long(), 1.0),
        _Case("continuous, crossing", flow(control_unit=Crossing(0.0)), 0.0, True),
        _Case(
            "continuous, crossing", Run(half, size.until, size.start, "continuous", Crossing(0.0)), 0.0, True
        ),
        _Case("continuous, crossing, latency 0.5", flow(control_unit=Crossing(1.0), latency=0.5), 1.0),
        _Case("continuous, sampled", flow(control_unit=Sampled(1.0)), 1.0),
        _Case("continuous, crossing, loss 0.4", flow(control_unit=Crossing(0.25), loss=0.4), 0.25),
        _Case("continuous, crossing, loss 0.2", flow(control_unit=Crossing(1.0), loss=0.2), 1.0),
        _Case("clock, one step later, loss 0.2", tick(latency=1.0, loss=0.2), 1.0),
        _Case("clock, one step later, loss 0.4", tick(latency=1.0, loss=0.4), 1.0),
    ]


def signals_and_utilisation(size: Size) -> Experiment:
    """Set up runs of the paper's system: signals, utilisation, the price in bits and the lift of peaks."""
    cases = _cases(size)
    return Experiment([partial(measure, case.run) for case in cases], partial(_rows, cases))


def _rows(cases: list[_Case], outcomes: list[list[Measures]]) -> list[Row]:
    first: list[Row] = []
    next_order: list[Row] = []
    price: list[Row] = []
    peaks: list[Row] = []
    for case, runs in zip(cases, outcomes, strict=True):
        next_order += _next_order(case, runs)
        if case.first_order:
            first += _first_order(case, runs)
        if case.first_order and case.run.dynamics == "continuous":
            price += _price(case, runs)
        if case.run.latency and case.run.dynamics == "continuous":
            peaks += _peaks(case, runs)
    rows = [*next_order, *price, *peaks, *first]
    order = {name: place for place, name in enumerate(dict.fromkeys(row.formula for row in rows))}
    return sorted(rows, key=lambda row: order[row.formula])


def _labels(case: _Case) -> dict[str, object]:
    gamma = float(case.run.problem.normalization[0])
    return {"setting": case.setting, "normalization": gamma, "hold_off": case.hold_off}


def _rate(problem: Problem, used: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute rho and mu where this much of the capacities is used."""
    mu = solve_optimum(problem, capacity=used * problem.capacity).multipliers
    rho = theory.signal_rate(problem.increase[0], problem.decrease[0], problem.normalization, mu)
    return rho, mu


def _next_order(case: _Case, runs: list[Measures]) -> list[Row]:
    run, names = case.run, case.run.problem.resource_names
    period = 1.0 if run.dynamics == "continuous" and isinstance(run.control_unit, Sampled) else 0.0
    expected = theory.predict(run.problem, run.dynamics, latency=run.latency, period=period, loss=run.loss)
    loss = float(np.max(run.loss))
    rho, _ = _rate(run.problem, np.ones(len(names)))
    critical = theory.critical_loss(rho, run.dynamics, hold_off=case.hold_off)
    signals, used = [row.signals for row in runs], [row.utilisation for row in runs]
    labels = _labels(case)
    found = estimated(signals, expected.signals, names, formula="Signals per unit of time", **labels)
    claimed = [
        row if loss >= _FAR_FROM_CRITICAL * critical[j] else _with(row, _SIGNALS)
        for j, row in enumerate(found)
    ]
    rule = None if loss else _UTILISATION
    use = estimated(used, expected.utilisation, names, formula="Utilisation", rule=rule, **labels)
    return [*claimed, *use]


def _with(row: Row, rule: Rule) -> Row:
    return Row(**{**vars(row), "rule": rule})


def _first_order(case: _Case, runs: list[Measures]) -> list[Row]:
    """Hold the formulas of first order against the runs, with mu at the use that the next order predicts."""
    run, problem, names = case.run, case.run.problem, case.run.problem.resource_names
    expected = theory.predict(problem, run.dynamics, latency=run.latency)
    rho, mu = _rate(problem, expected.utilisation)
    discrete = run.dynamics == "discrete"
    rows = estimated(
        [row.signals for row in runs],
        theory.signal_share(rho) if discrete else rho,
        names,
        formula="Signals, first order alone",
        **_labels(case),
    )
    if not discrete:
        used = theory.utilisation(
            problem.n_agents, problem.decrease[0], problem.normalization, mu, problem.capacity
        )
        rows += estimated(
            [row.utilisation for row in runs],
            used,
            names,
            formula="Utilisation, first order alone",
            rule=_UTILISATION,
            **_labels(case),
        )
    return rows


def _price(case: _Case, runs: list[Measures]) -> list[Row]:
    problem, names = case.run.problem, case.run.problem.resource_names
    expected = theory.predict(problem, "continuous")
    found = [(1.0 - row.utilisation) * row.signals for row in runs]
    first = theory.price_in_bits(problem.n_agents, problem.increase[0], problem.capacity)
    words = "Price in bits, (1 − utilisation) × signals"
    return [
        *estimated(
            found,
            (1.0 - expected.utilisation) * expected.signals,
            names,
            formula=words,
            rule=_SIGNALS,
            **_labels(case),
        ),
        *estimated(found, first, names, formula=f"{words}, first order alone", **_labels(case)),
    ]


def _peaks(case: _Case, runs: list[Measures]) -> list[Row]:
    problem = case.run.problem
    lift = theory.peak_lift(problem.n_agents, problem.increase[0], case.run.latency)
    return estimated(
        [row.typical_peak for row in runs],
        1.0 + lift / problem.capacity,
        problem.resource_names,
        formula="Peak over capacity, median of all peaks",
        **_labels(case),
    )
