"""Accuracy: bias, scatter and misallocation of averages, how fast it falls, and how long it takes."""

from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np

from aimd_des import (
    BroadcastChannel,
    Crossing,
    Fleet,
    Recording,
    Sampled,
    Simulation,
    solve_optimum,
    theory,
)
from aimd_des.latency import Constant
from aimd_des.lowlevel import FloatArray
from aimd_des.responses import EventNormalised, Randomised, Response
from aimd_des.study import jackknife
from models.smart_cameras import smart_cameras
from scenarios.theory_table.rows import Experiment, Row, Rule, Size, estimated, rows_of

_PROBLEM = smart_cameras(0)
_PERCENT, _THOUSAND = 100.0, 1000.0
# Looks are evenly spaced in logarithms, from this part of a run on; slopes are those of the last ones.
_FIRST, _LOOKS, _LATE = 0.01, 9, 6
_LEFT = "Misallocation of a run, %"
_SLOPE = "Slope of misallocation over time, on log axes"
# Means of 30 runs have standard errors of 1 to 3 %, slopes of 0.01, and lengths of 5 %.
_NEAR = Rule("relative", 0.1, "within 10 %")
_STEEP = Rule("difference", 0.03, "within 0.03")
_SOON = Rule("relative", 0.2, "within 20 %")


class _Case(NamedTuple):
    setting: str
    dynamics: Literal["discrete", "continuous"]
    latency: float
    response: Response


_CASES = (
    _Case("clock, acts in the same step", "discrete", 0.0, Randomised()),
    _Case("clock, acts one step later", "discrete", 1.0, Randomised()),
    _Case("clock, the same step, event-normalised", "discrete", 0.0, EventNormalised()),
    _Case("continuous, crossing", "continuous", 0.0, Randomised()),
)


def accuracy(size: Size) -> Experiment:
    """Set up runs of the paper's system that are long enough for the bias to be seen."""
    at = np.round(np.geomspace(_FIRST * size.long, size.long, _LOOKS))
    looks = tuple(at.tolist())
    return Experiment([(partial(_averages, case, looks), partial(_rows, case, size, at)) for case in _CASES])


def _averages(case: _Case, at: tuple[float, ...], seed: int) -> FloatArray:
    """Run once, and look at the averages, (q, n, m)."""
    simulation = Simulation(
        _PROBLEM,
        dynamics=case.dynamics,
        control_unit=Sampled() if case.dynamics == "discrete" else Crossing(0.0),
        channel=BroadcastChannel(Constant(case.latency)),
        response=case.response,
        agents=Fleet,
        seed=seed,
        recording=Recording(demand="end", allocations=list(at), overshoot=False),
    )
    return simulation.run(at[-1]).observations.average[-len(at) :].transpose(0, 2, 1)


def _off(average: FloatArray) -> FloatArray:
    return average - solve_optimum(_PROBLEM, capacity=average.sum(axis=0)).allocation


def _rows(case: _Case, size: Size, at: FloatArray, runs: list[FloatArray]) -> list[Row]:
    """Hold averages, (q, n, m) of each run, against what theory expects of them."""
    averages = np.stack(runs)
    expected = theory.convergence(_PROBLEM, case.dynamics, latency=case.latency, response=case.response)
    labels: dict[str, Any] = {
        "names": _PROBLEM.resource_names,
        "normalization": float(_PROBLEM.normalization[0]),
        "hold_off": 1.0 if case.dynamics == "discrete" else 0.0,
    }
    off = np.stack([[_off(average) for average in run] for run in averages])
    misallocation = np.abs(off).sum(axis=2) / averages.sum(axis=2)
    predicted = expected.misallocation(at).mean
    rows = []
    if isinstance(case.response, Randomised):  # the others have no bias
        rows += _bias(expected, off[:, -1], setting=case.setting, **labels)
    rows += _scatter(expected, float(at[-1]), averages[:, -1], setting=case.setting, **labels)
    for q in (0, _LOOKS // 2, _LOOKS - 1):
        setting, found = f"{case.setting}, at {at[q]:,.0f}", _PERCENT * misallocation[:, q]
        labels_at = labels | {"formula": _LEFT, "rule": _NEAR, "setting": setting}
        rows += estimated(found, _PERCENT * predicted[q], **labels_at)
    measures: dict[str, Any] = {
        _SLOPE: (partial(_slope, at), _slope(at, predicted), _STEEP),
        f"Time until misallocation is {100 * size.accuracy:g} %, thousands": (
            partial(_until, at, size.accuracy),
            expected.needed(size.accuracy).length / _THOUSAND,
            _SOON,
        ),
    }
    for formula, (measure, wanted, rule) in measures.items():
        found = jackknife(list(misallocation), measure)
        rows += rows_of(found, wanted, formula=formula, rule=rule, setting=case.setting, **labels)
    return rows


def _bias(expected: theory.Convergence, off: FloatArray, **labels: Any) -> list[Row]:
    """Project what runs, (r, n, m), are off on the bias."""
    floor, bias = _PERCENT * expected.floor, expected.bias
    part = (off * bias).sum(axis=1) / (bias**2).sum(axis=0)
    return estimated(floor * part, floor, formula="Bias that stays, %", rule=_NEAR, **labels)


def _scatter(expected: theory.Convergence, time: float, averages: FloatArray, **labels: Any) -> list[Row]:
    """Sum up the variances of the averages of runs, (r, n, m)."""
    covariance, unit = expected.covariance(time), _PROBLEM.capacity / _PERCENT
    predicted = np.einsum("jii->j", covariance)
    found = averages.var(axis=0, ddof=1).sum(axis=0)
    # The summed variances of Gaussian averages have the variance 2 tr V^2 / (runs - 1).
    doubt = np.sqrt(0.5 * np.einsum("jik,jki->j", covariance, covariance) / (len(averages) - 1)) / predicted
    pair = np.sqrt(found) / unit, np.sqrt(found) / unit * doubt
    words = "Standard deviation, root of summed variances, % of capacity"
    return rows_of(pair, np.sqrt(predicted) / unit, formula=words, rule=_NEAR, **labels)


def _slope(at: FloatArray, misallocation: FloatArray) -> FloatArray:
    late = slice(-_LATE, None)
    return np.asarray(np.polyfit(np.log(at[late]), np.log(misallocation[late]), 1)[0])


def _until(at: FloatArray, wanted: float, misallocation: FloatArray) -> FloatArray:
    """Find when misallocation, (q, m), has fallen to what is wanted."""
    falling = np.log(np.minimum.accumulate(misallocation))[::-1].T
    return np.exp([np.interp(np.log(wanted), row, np.log(at)[::-1]) for row in falling]) / _THOUSAND
