"""Columns of tidy frames."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd

__all__ = ["categorical"]


def categorical(codes: npt.NDArray[np.int64], names: Sequence[str]) -> pd.Categorical:  # type: ignore[type-arg]  # generic in the stubs only
    """Turn indices into names.

    Parameters
    ----------
    codes : ndarray of int
        Indices; -1 for a missing name.
    names : sequence of str
        All names there are.

    Returns
    -------
    pandas.Categorical
        With the names as categories.
    """
    return pd.Categorical.from_codes(codes.tolist(), categories=pd.Index(names))
