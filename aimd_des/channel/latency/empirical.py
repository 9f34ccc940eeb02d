"""Latencies that were measured."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from aimd_des.channel.csv_columns import read_columns
from aimd_des.channel.latency.base import Parametrised
from aimd_des.channel.latency.kernels import Distribution, LatencyTable, latency_table
from aimd_des.channel.parameters import LONGEST, scalar_or_row, take
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import built_in
from aimd_des.utils.shown import brief
from aimd_des.utils.validation import FloatArray


@built_in("latency", "empirical")
@brief
@dataclass(frozen=True, eq=False)
class Empirical(Parametrised):
    """Draws from measured latencies, with replacement: each is as likely as any other.

    Their order does not matter, and a dependence between successive ones is not kept.

    Parameters
    ----------
    values : array_like, shape (n_values,)
        Measured latencies, at least 0; kept in ascending order.
    scale : float or array_like, shape (n,)
        Multiplies every value, at least 0: units of time per unit of the values, or how much slower
        one agent's link is.

    Raises
    ------
    InputError
        If there is no value, or a value is outside its range.
    """

    values: FloatArray
    scale: float | FloatArray = 1.0
    _each: ClassVar = ("scale",)

    def __post_init__(self) -> None:
        clean = np.sort(
            validation.array("Empirical.values", self.values, ("n_values",), low=0.0, high=LONGEST)
        )
        if not len(clean):
            raise InputError.of("Empirical.values", [], "at least one measured latency")
        clean.setflags(write=False)
        object.__setattr__(self, "values", clean)
        take(self, "scale", low=0.0, high=LONGEST)

    @classmethod
    def from_csv(cls, path: str | Path, column: str, scale: float | FloatArray = 1.0) -> "Empirical":
        """Read the values from one column of a CSV file.

        Parameters
        ----------
        path : str or Path
            The file; its first line holds the names of the columns.
        column : str
            The column with the measured latencies.
        scale : float or array_like, shape (n,)
            Multiplies every value, at least 0: 0.001 makes seconds of milliseconds.

        Returns
        -------
        Empirical
            All values of the column.

        Raises
        ------
        InputError
            If the file cannot be read, the column is missing (naming the nearest one), or a cell
            holds no latency (naming its row, counted from 1 below the names).
        """
        return cls(np.array(read_columns(path, [column], _latency, _ALLOWED)[0]), scale)

    @property
    def mean(self) -> float | FloatArray:
        """Mean of the values times the scale, in units of time."""
        return scalar_or_row(self.scale * self._mean())

    @property
    def variance(self) -> float | FloatArray:
        """Mean squared deviation of the values from their mean times scale**2, in squared units of time."""
        centred = self.values - self._mean()
        spread = math.fsum((centred * centred).tolist()) / len(self.values)
        return scalar_or_row(self.scale * self.scale * spread)

    def _mean(self) -> float:
        return math.fsum(self.values.tolist()) / len(self.values)

    def table(self, n_agents: int) -> LatencyTable:
        """Lay out the model for compiled code."""
        return latency_table(Distribution.EMPIRICAL, n_agents, self.scale, values=self.values)


built_in("latency", "measured")(Empirical.from_csv)


_ALLOWED = "a finite number at least 0"


def _latency(cell: str) -> float:
    value = float(cell)
    if not 0.0 <= value < math.inf:
        raise ValueError
    return value
