"""The centralised solution that every run is held against, and the normalization factors."""

from aimd_des.problem.optimum.normalization import in_f_delta, normalization_factors
from aimd_des.problem.optimum.optimum import Optimum, solve_optimum

__all__ = ["Optimum", "in_f_delta", "normalization_factors", "solve_optimum"]
