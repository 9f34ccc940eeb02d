"""Four numbers side by side, which compiled code adds, subtracts and multiplies at once.

Formulas take them in place of one number: kernels hold them in a vector, Python in an array.
"""

from typing import Any

import numpy as np

from aimd_des.utils.jit import instruction


@instruction
def four_lanes(first: float, second: float, third: float, fourth: float) -> Any:
    """Put four numbers side by side."""
    return np.array((first, second, third, fourth))


@instruction
def lanes_of(lanes: Any) -> tuple[float, float, float, float]:
    """Take them apart."""
    first, second, third, fourth = lanes
    return first, second, third, fourth
