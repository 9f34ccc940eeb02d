"""Signals, utilisation, price and peaks of the paper's system, with and without loss."""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from aimd_des import Crossing, Problem, Sampled, solve_optimum, theory
from aimd_des.lowlevel import FloatArray
from models.smart_cameras import smart_cameras
from scenarios.common.measure import Measures, Run, measure
from scenarios.theory_table.rows import Experiment, Row, Rule, Size, estimated

_NEAR = Rule("relative", 0.05, "within 5 %")
_POINTS = Rule("difference", 0.02, "within 2 points")
_FAR_FROM_CRITICAL = 0.8
_SIGNALS, _USE, _PEAK = "Signals per unit of time", "Utilisation", "Peak over capacity, median of all peaks"
_PRICE, _FIRST = "Price in bits, (1 − utilisation) × signals", ", first order alone"
_ORDER = (_SIGNALS, _USE, _PRICE, _PRICE + _FIRST, _PEAK, "Signals" + _FIRST, _USE + _FIRST)


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
    return Experiment([(partial(measure, case.run), partial(_rows, case)) for case in _cases(size)], _ORDER)


def _rows(case: _Case, runs: list[Measures]) -> list[Row]:
    run, problem, loss = case.run, case.run.problem, float(np.max(case.run.loss))
    continuous = run.dynamics == "continuous"
    period = 1.0 if continuous and isinstance(run.control_unit, Sampled) else 0.0
    expected = theory.predict(problem, run.dynamics, latency=run.latency, period=period, loss=run.loss)
    signals, used = (np.array([getattr(one, name) for one in runs]) for name in ("signals", "utilisation"))
    found: list[tuple[str, Any, FloatArray, Rule | None]] = [
        (_SIGNALS, signals, expected.signals, _NEAR),
        (_USE, used, expected.utilisation, None if loss else _POINTS),
    ]
    if case.first_order:
        found += _first_order(problem, expected, continuous, signals, used)
    if run.latency and continuous:
        lift = theory.peak_lift(problem.n_agents, problem.increase[0], run.latency)
        found.append((_PEAK, [one.typical_peak for one in runs], 1.0 + lift / problem.capacity, None))
    labels = {
        "setting": case.setting,
        "normalization": float(problem.normalization[0]),
        "hold_off": case.hold_off,
    }
    rows = [
        row
        for formula, values, predicted, rule in found
        for row in estimated(values, predicted, problem.resource_names, formula=formula, rule=rule, **labels)
    ]
    critical = theory.critical_loss(theory.needed_rate(problem), run.dynamics, hold_off=case.hold_off)
    for j in np.flatnonzero(loss >= _FAR_FROM_CRITICAL * critical):  # the rows of signals come first
        rows[j] = replace(rows[j], rule=None)
    return rows


def _first_order(
    problem: Problem, expected: theory.Prediction, continuous: bool, signals: FloatArray, used: FloatArray
) -> list[tuple[str, Any, FloatArray, Rule | None]]:
    """Put the formulas of first order beside the runs, with mu at the use that the next order predicts."""
    n, alpha, beta, gamma = problem.n_agents, problem.increase[0], problem.decrease[0], problem.normalization
    mu = solve_optimum(problem, capacity=expected.utilisation * problem.capacity).multipliers
    rho = theory.signal_rate(alpha, beta, gamma, mu)
    if not continuous:
        return [("Signals" + _FIRST, signals, theory.signal_share(rho), None)]
    price = (1.0 - used) * signals
    return [
        ("Signals" + _FIRST, signals, rho, None),
        (_USE + _FIRST, used, theory.utilisation(n, beta, gamma, mu, problem.capacity), _POINTS),
        (_PRICE, price, (1.0 - expected.utilisation) * expected.signals, _NEAR),
        (_PRICE + _FIRST, price, theory.price_in_bits(n, alpha, problem.capacity), None),
    ]
