"""What is shared, by how many, at what private cost, and the optimum of the whole."""

from aimd_des.problem.problem import Problem, Resource

__all__ = ["Problem", "Resource"]
