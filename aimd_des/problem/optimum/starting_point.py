"""Where the search for the optimum begins."""

import numpy as np

from aimd_des.problem.optimum.scaled_costs import Candidate, ScaledCosts
from aimd_des.utils.validation import FloatArray

# More sweeps, or smaller shares, were no better on trials with coefficients from 1e-6 to 1e6.
_SWEEPS = 8
_SMALLEST_SHARE = 1e-13


def power_law_start(scaled: ScaledCosts) -> Candidate:
    """Find shares by sweeps that take each derivative for a power of its share.

    From equal shares alone Newton's method would need very many steps where derivatives differ by
    many orders of magnitude: on y**p it only gains a factor (p - 2) / (p - 1) each time.
    """
    tiny = np.finfo(float).tiny
    shares = np.ones((scaled.costs.n_agents, scaled.costs.n_resources))
    gradient = scaled.gradient(shares)
    for _ in range(_SWEEPS):
        halved = np.maximum(scaled.gradient(shares / 2), tiny)
        log_gradient, log_shares = np.log(np.maximum(gradient, tiny)), np.log(shares)
        # Elasticity 1 at least: a nearly linear cost then gets a share of about nu / gradient, where
        # share times reduced gradient is about nu, which is on the central path and not at the bound.
        elasticity = np.clip((log_gradient - np.log(halved)) / np.log(2.0), 1.0, 100.0)
        log_nu = _power_law_multipliers(log_shares, log_gradient, elasticity)
        moved = log_shares + (log_nu - log_gradient) / elasticity
        shares = np.exp(np.clip(moved, np.log(_SMALLEST_SHARE), np.log(len(shares))))
        shares /= shares.mean(axis=0)
        gradient = scaled.gradient(shares)
        if np.abs(np.log(shares) - log_shares).max() < 0.5:
            break
    return Candidate(shares, gradient, np.exp(log_nu))


def _power_law_multipliers(
    log_shares: FloatArray, log_gradient: FloatArray, elasticity: FloatArray
) -> FloatArray:
    """Solve mean_i y_i (nu / g_i)**(1 / e_i) = 1: its logarithm is convex and increasing in log(nu)."""
    log_nu = log_gradient.max(axis=0)
    for _ in range(50):
        exponents = log_shares + (log_nu - log_gradient) / elasticity
        largest = exponents.max(axis=0)
        terms = np.exp(exponents - largest)
        total = terms.sum(axis=0)
        excess = largest + np.log(total / len(terms))
        log_nu = log_nu - excess * total / (terms / elasticity).sum(axis=0)
        if np.abs(excess).max() < 1e-6:
            break
    return np.asarray(log_nu)
