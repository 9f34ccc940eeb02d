"""Which of the recorded samples are shown: all are too many for the eye, and often for memory."""

import numpy as np
import numpy.typing as npt

from aimd_des.utils.validation import FloatArray


def looks(times: FloatArray, count: int, *, log: bool = False) -> npt.NDArray[np.intp]:
    """Choose which of the recorded samples are drawn."""
    first = int(np.searchsorted(times, 0.0, side="right")) if log else 0
    kept = times[first:]
    if not kept.size:
        return np.empty(0, dtype=np.intp)
    spread = np.geomspace if log else np.linspace
    wanted = spread(kept[0], kept[-1], count)
    after = np.clip(np.searchsorted(kept, wanted), 1, max(len(kept) - 1, 1))
    after = np.minimum(after, len(kept) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(wanted - kept[before] < kept[after] - wanted, before, after)
    return np.asarray(first + np.unique(np.append(nearest, len(kept) - 1)))
