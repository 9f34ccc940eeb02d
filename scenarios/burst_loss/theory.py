r"""What bursts of loss do to total demand and to shares: first-order theory.

All links at once.  Total demand y grows at u = n alpha in a burst, of mean length B = 1 / b; else each
signal, one in a hold-off r, takes the share c of it.  With bursts at the rate a, and k = -log(1 - c) / r,
the densities of y above the capacity are, in bursts and between them,

    f(y) ~ exp(-b (y - C) / u) ((k y - u) / (k C - u))^(a / k),        g(y) = u f(y) / (k y - u).

For short bursts that is a queue with one on-off source: exponential, with the mean n alpha B p (1 - p) /
(1 - p - rho r) over all time.

Each link for itself: `aimd_des.theory.burst_shares`.
"""

import numpy as np

from aimd_des import solve_optimum
from scenarios.burst_loss.runs import Bursts, smallest

_POINTS = 4_000
_ROUNDS = 50
_RESTS = 1e-4


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
