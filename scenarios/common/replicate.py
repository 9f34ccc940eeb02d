"""Replications over a pool of processes, and what they say: mean and standard error."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from aimd_des.checks import FloatArray
from aimd_des.study import jackknife, mean_and_error, replicate

__all__ = ["jackknife", "mean_and_error", "numbers", "replicate", "summarise"]


def summarise(rows: Sequence[dict[str, Any]], labels: Sequence[str]) -> pd.DataFrame:
    """Reduce rows of single replications to a tidy table.

    Parameters
    ----------
    rows : sequence of dict
        One a replication: labels, and numbers for everything else.
    labels : sequence of str
        Columns that say what was run.

    Returns
    -------
    DataFrame
        Columns: the labels, measure, mean, standard_error, replications; a row for each
        combination of labels and measure, in the order of their first appearance.
    """
    long = pd.DataFrame(rows).melt(id_vars=list(labels), var_name="measure")
    groups = long.groupby([*labels, "measure"], sort=False, dropna=False)["value"]
    found = groups.agg(mean="mean", standard_error="sem", replications="count")
    return found.reset_index()


def numbers(table: pd.DataFrame, column: str = "mean", **wanted: str) -> FloatArray:
    """Take a column of the rows that have the labels wanted.

    Parameters
    ----------
    table : DataFrame
        As from `summarise`.
    column : str
        Which.
    **wanted
        Columns and what they must hold.

    Returns
    -------
    ndarray
        In the order of the rows.
    """
    chosen = np.ones(len(table), dtype=np.bool_)
    for name, value in wanted.items():
        chosen &= (table[name] == value).to_numpy()
    return table.loc[chosen, column].to_numpy(dtype=np.float64)
