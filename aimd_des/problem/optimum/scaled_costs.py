"""Costs without units, and how far shares are from their optimum."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aimd_des.problem.costs import Costs
from aimd_des.utils.validation import FloatArray


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
        units = self.equal_share[:, None] * self.equal_share
        return self.costs.hessian(shares * self.equal_share) * units


@dataclass(frozen=True, eq=False)
class Candidate:
    """What may be the optimum: shares, the derivatives there, and multipliers of the capacities."""

    shares: FloatArray
    gradient: FloatArray
    multipliers: FloatArray

    @cached_property
    def price(self) -> FloatArray:
        """The mean price paid, w (m,): equal to nu at the optimum and positive everywhere."""
        return np.asarray((self.shares * self.gradient).mean(axis=0))

    @cached_property
    def residual(self) -> float:
        """The residual that `solve_optimum` defines."""
        if not ((self.multipliers > 0).all() and np.isfinite(self.gradient).all()):
            return float(np.inf)
        reduced = self.gradient / self.multipliers - 1
        feasibility = np.abs(self.shares.mean(axis=0) - 1).max()
        stationarity = np.abs(np.minimum(self.shares, reduced)).max()
        complementarity = (self.shares * np.maximum(reduced, 0)).max()
        return float(max(feasibility, stationarity, complementarity))
