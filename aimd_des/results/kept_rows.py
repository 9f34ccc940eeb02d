"""Rows that are recorded and never written again: a run that is forked shares them with what comes of it."""

import numpy as np

from aimd_des.utils.validation import FloatArray


class Kept:
    """Rows of two arrays that are full, piece by piece; each piece is of one run."""

    def __init__(self, *pieces: tuple[FloatArray, FloatArray]) -> None:
        self.pieces = pieces

    @property
    def count(self) -> int:
        """How many rows there are."""
        return sum(len(one) for one, _ in self.pieces)

    def with_more(self, one: FloatArray, other: FloatArray) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Return the pieces and one more, if there is anything in it."""
        return (*self.pieces, (one, other)) if len(one) else self.pieces

    def followed_by(self, one: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Put all pieces together, and what comes after them."""
        if not self.pieces:
            return one, other
        first, second = zip(*self.pieces, (one, other), strict=True)
        return np.concatenate(first), np.concatenate(second)
