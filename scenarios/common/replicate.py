"""Replications over a pool of processes, and what they say: mean and standard error."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import pandas as pd

from aimd_des.checks import FloatArray

__all__ = ["jackknife", "mean_and_error", "numbers", "replicate", "summarise"]

_Outcome = TypeVar("_Outcome")


def replicate(
    jobs: Sequence[Callable[[int], _Outcome]], replications: int, seed: int, *, workers: int | None = None
) -> list[list[_Outcome]]:
    """Call every job with the same seeds, so that jobs share their luck and differences are paired.

    Parameters
    ----------
    jobs : sequence of callable
        Each takes a seed; with several workers all are `functools.partial` of functions of a module.
    replications : int
        How many seeds.
    seed : int
        Of the first replication; replication r has the seed ``seed + r``.
    workers : int, optional
        Processes; 1 stays in this one, all processors unless given.

    Returns
    -------
    list of list
        For each job its outcomes, in the order of the seeds, however the work was shared.
    """
    seeds = range(seed, seed + replications)
    many = (os.cpu_count() or 1) if workers is None else workers
    if many == 1:
        return [[job(number) for number in seeds] for job in jobs]
    # Not forked: a fork copies the locks of threads that it does not copy.
    with ProcessPoolExecutor(many, mp_context=get_context("spawn")) as pool:
        waiting = [[pool.submit(job, number) for number in seeds] for job in jobs]
        return [[future.result() for future in row] for row in waiting]


def mean_and_error(values: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Estimate a mean and its standard error from replications.

    Parameters
    ----------
    values : array_like, shape (r, ...)
        One value, or array of values, a replication.

    Returns
    -------
    mean, error : ndarray, shape (...)
        In the unit of the values; the error is NaN for a single replication.
    """
    table = np.asarray(values, dtype=np.float64)
    count = len(table)
    spread = table.std(axis=0, ddof=1) if count > 1 else np.full(table.shape[1:], np.nan)
    return np.asarray(table.mean(axis=0)), np.asarray(spread / np.sqrt(count))


def jackknife(
    values: Sequence[FloatArray], measure: Callable[[FloatArray], FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Measure the mean over all replications, and estimate the error of that by leaving out one at a time.

    Parameters
    ----------
    values : sequence of ndarray
        One a replication.
    measure : callable
        Of the mean of such arrays; need not be linear.

    Returns
    -------
    value, error : ndarray
        Of the measure; the error is NaN for a single replication.
    """
    stack, count = np.stack(values), len(values)
    whole = measure(stack.mean(axis=0))
    if count == 1:
        return whole, np.full_like(whole, np.nan)
    parts = np.stack([measure(np.delete(stack, out, axis=0).mean(axis=0)) for out in range(count)])
    return whole, np.sqrt((count - 1) / count * ((parts - parts.mean(axis=0)) ** 2).sum(axis=0))


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
