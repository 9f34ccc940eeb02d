"""Losses that were recorded."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aimd_des.channel.csv_columns import read_columns
from aimd_des.channel.loss.kernels import Cause, TabledLoss, loss_table
from aimd_des.channel.parameters import scalar_or_row
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import built_in
from aimd_des.utils.shown import brief
from aimd_des.utils.validation import BoolArray, FloatArray

_WORDS = {"0": False, "1": True, "false": False, "true": True}
_REMEDY = "one row for each broadcast, and either no columns or one for each agent"


@built_in("loss", "trace")
@brief
@dataclass(frozen=True, eq=False)
class Trace:
    """Broadcast k of a run loses the copies that row k of a record says, for any seed.

    Broadcasts for all resources are counted together, from 0, in the order in which they are sent.

    Parameters
    ----------
    lost : array_like of bool, shape (n_rows,) or (n_rows, n)
        Whether a broadcast is lost for all agents, or for each; 0 and 1 will do.
    repeat : bool
        Whether the record begins anew after its last row.  If not, a run with more broadcasts than
        rows ends in a `SimulationError`.

    Raises
    ------
    InputError
        If the record is no such array or has no rows, or `repeat` is neither True nor False.
    """

    lost: npt.ArrayLike
    _: KW_ONLY
    repeat: bool

    def __post_init__(self) -> None:
        clean = _record(self.lost)
        clean.setflags(write=False)
        object.__setattr__(self, "lost", clean)
        object.__setattr__(self, "repeat", validation.flag("Trace.repeat", self.repeat))

    @classmethod
    def from_csv(
        cls, path: str | Path, columns: str | Sequence[str] | None = None, *, repeat: bool
    ) -> "Trace":
        """Read a record from columns of a CSV file, with cells 0 or 1, false or true.

        Parameters
        ----------
        path : str or Path
            The file; its first line holds the names of the columns.
        columns : str or sequence of str, optional
            A name: that column holds for all agents.  Several names: the columns of agents 0, 1, ...
            Default: all columns of the file; a single one holds for all agents.
        repeat : bool
            Whether the record begins anew after its last row, as for `Trace`.

        Returns
        -------
        Trace
            One row for each row of the file.

        Raises
        ------
        InputError
            If the file cannot be read, a column is missing (naming the nearest one), or a cell
            holds something else (naming its row, counted from 1 below the names).
        """
        wanted = [columns] if isinstance(columns, str) else columns
        read = read_columns(path, wanted, _lost, "0 or 1, false or true")
        common = isinstance(columns, str) or (columns is None and len(read) == 1)
        return cls(np.array(read[0]) if common else np.array(read).T, repeat=repeat)

    @property
    def mean(self) -> float | FloatArray:
        """Share of rows that lose a copy; for each agent where the record is."""
        lost = np.asarray(self.lost)
        return scalar_or_row(lost.sum(axis=0) / len(lost))

    def start(self, n_agents: int) -> TabledLoss:
        """Begin a run at the first row."""
        lost = np.asarray(self.lost)
        if lost.ndim > 1 and lost.shape[1] != n_agents:
            raise InputError.of("shape of Trace.lost", lost.shape, f"({len(lost)}, {n_agents})", _REMEDY)
        return TabledLoss(loss_table(Cause.RECORD, n_agents, record=lost, repeat=self.repeat))


built_in("loss", "recorded")(Trace.from_csv)


def _record(given: npt.ArrayLike) -> BoolArray:
    """Return a copy of the record as bools, or refuse it."""
    try:
        raw = np.array(given if validation.axes(given) else None)
    except ValueError:  # rows of different lengths
        raise InputError.of("Trace.lost", given, "an array of bools", _REMEDY) from None
    if raw.dtype.kind not in "biuf":
        raise InputError.of("Trace.lost", given, "an array of bools", _REMEDY)
    if raw.ndim not in (1, 2) or not raw.size:
        raise InputError.of("shape of Trace.lost", raw.shape, "(n_rows,) or (n_rows, n_agents)", _REMEDY)
    wrong = np.argwhere((raw != 0) & (raw != 1))
    if len(wrong):
        where = tuple(int(index) for index in wrong[0])
        place = f"Trace.lost[{', '.join(map(str, where))}]"
        raise InputError.of(place, raw[where].item(), "False or True, 0 or 1")
    return raw.astype(np.bool_)


def _lost(cell: str) -> bool:
    word = cell.strip().lower()
    if word not in _WORDS:
        raise ValueError
    return _WORDS[word]
