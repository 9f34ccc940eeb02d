"""Scales for the interior point method, and a start that fits them."""

from dataclasses import dataclass

import numpy as np

from aimd_des.problem.costs import Costs
from aimd_des.utils.validation import FloatArray

# More sweeps, or smaller shares, were no better on trials with coefficients from 1e-6 to 1e6.
_SWEEPS = 8
_SMALLEST_SHARE = 1e-13


@dataclass(frozen=True, eq=False)
class ScaledCosts:
    """Costs as functions of shares, multiples of C / n: units and the number of agents drop out."""

    costs: Costs
    equal_share: FloatArray

    def gradient(self, shares: FloatArray) -> FloatArray:
        """Evaluate the derivatives by the shares."""
        return self.costs.gradient(shares * self.equal_share) * self.equal_share

    def hessian(self, shares: FloatArray) -> FloatArray:
        """Evaluate the second derivatives by the shares."""
        return self.costs.hessian(shares * self.equal_share) * np.outer(self.equal_share, self.equal_share)


def power_law_start(scaled: ScaledCosts) -> tuple[FloatArray, FloatArray, FloatArray]:
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
    return shares, gradient, np.exp(log_nu)


def _power_law_multipliers(
    log_shares: FloatArray, log_gradient: FloatArray, elasticity: FloatArray
) -> FloatArray:
    """Solve mean_i y_i (nu / g_i)**(1 / e_i) = 1: its logarithm is convex and increasing in log(nu)."""
    log_nu = log_gradient.max(axis=0)
    for _ in range(50):
        exponents = log_shares + (log_nu - log_gradient) / elasticity
        largest = exponents.max(axis=0)
        terms = np.exp(exponents - largest)
        excess = largest + np.log(terms.mean(axis=0))
        log_nu = log_nu - excess * terms.sum(axis=0) / (terms / elasticity).sum(axis=0)
        if np.abs(excess).max() < 1e-6:
            break
    return np.asarray(log_nu)
