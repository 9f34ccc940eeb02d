"""Columns of tidy frames."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd

__all__ = ["categorical"]


def categorical(codes: npt.NDArray[np.int64], names: Sequence[str]) -> pd.Categorical:
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
    # Generic in the stubs only: a subscript in the annotation would not survive at run time.
    return pd.Categorical.from_codes(codes.tolist(), categories=pd.Index(names))  # type: ignore[return-value]
