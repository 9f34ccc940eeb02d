r"""The paper's system: city cameras that share memory, disk and bandwidth.

60 cameras, one kind of cost out of three each, drawn once with probability 1/3 (eq. (cost_fn)),
with prices drawn from the ranges that follow the price table of a cloud provider for four hours:

=================  ==============  =======================
resource           price (USD)     factor in the costs
=================  ==============  =======================
memory, 1 GB       0.017784        a in {10, ..., 20}
disk, 10 GB        0.283333        b in {25, ..., 35}
bandwidth, 10 Mbps 0.277775        c in {22, ..., 32}
other                              d in {1, ..., 5}
=================  ==============  =======================

Memory is in GB, disk in units of 10 GB ("GB^D"), bandwidth in units of 10 Mbps ("Mbps^D").
"""

from typing import Literal

import numpy as np

from aimd_des import InputError, PolynomialCosts, Problem, Resource, checks, lowlevel, model
from aimd_des.lowlevel import FloatArray, Purpose

__all__ = ["INCREASES", "PRICES", "smart_cameras"]

#: USD for four hours: per GB of memory, per 10 GB of disk, per 10 Mbps of bandwidth.
PRICES = {"memory": 0.017784, "disk": 0.283333, "bandwidth": 0.277775}

#: alpha of memory, disk and bandwidth.  The printed 20 MB of disk gives a sixth of the capacity
#: events that the paper reports; ten times as much gives them.
INCREASES = {"as_run": (0.025, 0.020, 0.0225), "as_printed": (0.025, 0.002, 0.0225)}

_EXPONENTS = (2, 4, 6, 8)
_PAPER_CAMERAS = 60

# Cameras that are drawn at a time: what is computed on the way takes little memory, however many there are.
_TOGETHER = 1 << 13


def _coefficients(n: int, seed: int) -> FloatArray:
    """Draw the coefficients of eq. (cost_fn), shape (n, 3, 4).

    One row of five uniform numbers a camera, so that the first cameras stay when more are added.
    """
    generator, coefficients = lowlevel.generator(seed, Purpose.PROBLEM), np.empty((n, 3, len(_EXPONENTS)))
    for first in range(0, n, _TOGETHER):
        few = coefficients[first : first + _TOGETHER]
        few[:] = _of_kinds(generator.random((len(few), 5)))
    return coefficients


def _of_kinds(draws: FloatArray) -> FloatArray:
    """Turn five uniform numbers for each of some cameras into their coefficients."""
    n = len(draws)
    lowest, choices = np.array([10, 25, 22, 1]), np.array([11, 11, 11, 5])
    a, b, c, d = (lowest + np.floor(choices * draws[:, :4])).T
    kind = np.floor(3 * draws[:, 4]).astype(int)
    zero = np.zeros(n)
    kinds = (
        [[a, a / 2, zero, zero], [zero, 2 * b, b / 2, zero], [c, c / 4, zero, d / 8]],
        [[a, zero, zero, zero], [b, b / 2, zero, zero], [zero, 1.5 * c, zero, zero]],
        [[zero, zero, a / 3, zero], [b, zero, d / 6, zero], [c, d / 8, zero, zero]],
    )
    table = np.array(kinds)  # (3 kinds, 3 resources, 4 exponents, n)
    return np.asarray(np.moveaxis(table, -1, 0)[np.arange(n), kind])


@model
def smart_cameras(
    seed: int = 0,
    n_cameras: int = _PAPER_CAMERAS,
    increase: Literal["as_run", "as_printed"] = "as_run",
    normalization: float = 1 / 90,
) -> Problem:
    """Build the paper's multi-camera coordination system (section V).

    Parameters
    ----------
    seed : int
        Decides the draw of the costs, at least 0.
    n_cameras : int
        How many cameras; capacities grow in proportion from those of 60.
    increase : {"as_run", "as_printed"}
        Which additive increase for disk: 0.02 (200 MB), with which the reported capacity events
        come about, or the 0.002 (20 MB) that is printed.
    normalization : float
        Gamma, the same for all resources.

    Returns
    -------
    Problem
        Resources memory (GB), disk (10 GB) and bandwidth (10 Mbps).

    Raises
    ------
    InputError
        If an argument is outside its range.
    """
    n = checks.integer("n_cameras", n_cameras, low=1)
    if not isinstance(increase, str) or increase not in INCREASES:
        raise InputError.of("increase", increase, f"one of {', '.join(map(repr, INCREASES))}")
    scale = n / _PAPER_CAMERAS
    alpha = INCREASES[increase]
    resources = [
        Resource("memory", 32.0 * scale, alpha[0], 0.70, normalization, unit="GB"),
        Resource("disk", 20.0 * scale, alpha[1], 0.85, normalization, unit="10 GB"),
        Resource("bandwidth", 25.0 * scale, alpha[2], 0.75, normalization, unit="10 Mbps"),
    ]
    return Problem(resources, PolynomialCosts(_EXPONENTS, _coefficients(n, seed)))
