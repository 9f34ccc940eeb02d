r"""What bursts of loss do to total demand and to shares: first-order theory.

All links at once.  Total demand y grows at u = n alpha in a burst, of mean length B = 1 / b; else each
signal, one in a hold-off r, takes the share c of it.  With bursts at the rate a, and k = -log(1 - c) / r,
the densities of y above the capacity are, in bursts and between them,

    f(y) ~ exp(-b (y - C) / u) ((k y - u) / (k C - u))^(a / k),        g(y) = u f(y) / (k y - u).

For short bursts that is a queue with one on-off source: exponential, with the mean n alpha B p (1 - p) /
(1 - p - rho r) over all time.

Each link for itself.  Signals that an agent hears find it with E[x | good] = x - p alpha B, exactly, if
they come evenly.  So the balance is that of costs with the derivative f_i'(x) (1 - p alpha B / x): where
costs are quadratic, everybody gets p alpha B, and a share of the rest.
"""

import math
from functools import partial

import numpy as np
from scipy.optimize import brentq

from aimd_des import Problem, solve_optimum
from aimd_des.checks import FloatArray
from aimd_des.theory import signal_rate
from scenarios.burst_loss.runs import Bursts, smallest

_POINTS = 4_000
_ROUNDS = 50
_RESTS = 1e-4
_HALVINGS = 40
_TEETH = 3


def level_shares(problem: Problem, loss: float, burst: float) -> tuple[FloatArray, float]:
    """Predict shares (n, 1), and signals per unit of time, where each link has bursts of its own.

    Of what a saw below the capacity uses; both are NaN where links that are bad hold more than that.  To
    the next order, signals find agents with half a tooth more than their mean: a smaller p alpha B.
    """
    increase, capacity = problem.increase[:, 0], float(problem.capacity[0])
    if loss * burst * increase.sum() >= capacity:
        return np.full((problem.n_agents, 1), np.nan), np.nan
    mu, used = float(solve_optimum(problem).multipliers[0]), capacity
    for _ in range(_TEETH):
        signals = float(signal_rate(increase[0], problem.decrease[0, 0], problem.normalization[0], mu, loss))
        tooth = 0.5 * increase / signals
        lump, used = loss * burst * increase - tooth, capacity - float(tooth.sum())
        unused = partial(_unused, problem, lump, used)
        mu = math.exp(brentq(unused, math.log(1e-9 * mu), math.log(1e3 * mu), xtol=1e-6))
    return _held(problem, lump, mu)[:, None], signals


def _held(problem: Problem, lump: FloatArray, mu: float) -> FloatArray:
    """Find x with f_i'(x) (1 - lump_i / x) = mu, shape (n,)."""
    low = np.maximum(lump, 0.0)
    high = low + 2.0 * problem.capacity[0]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        short = problem.costs.gradient(middle[:, None])[:, 0] * (1.0 - lump / middle) < mu
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return low


def _unused(problem: Problem, lump: FloatArray, used: float, log_mu: float) -> float:
    return float(_held(problem, lump, math.exp(log_mu)).sum() - used)


def run_away(run: Bursts) -> dict[str, float]:
    """Predict what total demand does where all links have their bursts together, long against the hold-off.

    By the names of `Outcome`; nothing where signals would not suffice.  Iterates on the mean of demand, on
    which the share c that a signal takes depends.  A burst that finds total demand held, evenly spread over
    a tooth, crosses the capacity with probability phi.
    """
    problem, r = run.problem, run.hold_off
    capacity, keep = float(problem.capacity[0]), 1.0 - float(problem.decrease[0, 0])
    u, b = float(problem.increase.sum()) / capacity, 1.0 / run.burst
    a, used = b * run.loss / (1.0 - run.loss), 1.0
    found: dict[str, float] = {}
    for _ in range(_ROUNDS):
        mu = float(solve_optimum(problem, capacity=np.array([used * capacity])).multipliers[0])
        cut = problem.n_agents * keep * float(problem.normalization[0]) * mu / (used * capacity)
        k, tooth = -np.log1p(-cut) / r, cut / u
        if k <= u:
            return {}
        w = np.linspace(0.0, 40.0 * u * run.burst, _POINTS)
        f = np.exp(-b * w / u) * (1.0 + k * w / (k - u)) ** (a / k)
        g = u * f / (k * (1.0 + w) - u)
        phi = -np.expm1(-b * tooth) / (b * tooth)
        weight = run.loss / (np.trapezoid(f, w) + u * run.burst * (1.0 - phi) / phi)
        inside, between = (weight * float(np.trapezoid(density, w)) for density in (f, g))
        excess = weight * float(np.trapezoid(w * (f + g), w))
        above = inside + between
        tail = 1.0 - np.append(0.0, np.cumsum(0.5 * (f[1:] + f[:-1]))) / np.cumsum(0.5 * (f[1:] + f[:-1]))[-1]
        bursts = (run.until - run.start) * (u * weight + a * between)
        found = {
            "time_above": above,
            "excess": excess,
            "run_away_peak": weight * float(np.trapezoid(w * f, w)) / inside,
            "excursion": above / (u * weight),
            "peak": 1.0 + float(np.trapezoid(1.0 - (1.0 - np.clip(tail, 0.0, 1.0)) ** bursts, w)),
            "utilisation": 1.0 + excess - 0.5 * cut * (1.0 - above),
        }
        moved = found["utilisation"] - used
        used += 0.5 * moved
        if abs(moved) < _RESTS:
            break
    # Everybody grows alike in a burst, and falls in proportion after it: what is used is shared as ever.
    held = solve_optimum(problem, capacity=np.array([used * capacity])).allocation[:, 0]
    return {**found, "smallest": float(held[smallest(problem)].sum() / held.sum()), "from plain optimum": 0.0}
