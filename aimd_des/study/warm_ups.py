"""Warm-ups that the points of a study share: a run of each seed makes it, and a file keeps it for others."""

import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from aimd_des.study.points import PlannedRun
from aimd_des.study.study import Study

#: The folder of the files, as long as a sweep lasts.
FOLDER = "warm_ups"


def warm_up_file(folder: Path, seed: int) -> Path:
    """Name the file of a seed."""
    return folder / FOLDER / f"{seed}.run"


class WarmUps:
    """Which warm-ups there are, and which are being made: other runs of their seeds wait for these.

    Attributes
    ----------
    shared : bool
        Whether there is a warm-up that several points share.
    """

    def __init__(self, study: Study, folder: Path, n_points: int) -> None:
        self.shared = study.warm_up is not None and study.paired and n_points > 1
        self._folder = folder
        self._n_points = n_points
        # By seed: the run that makes the warm-up.
        self._makers: dict[int, PlannedRun] = {}
        self._made: set[int] = set()
        self._over: Counter[int] = Counter()

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Have a folder for them, and remove it in the end."""
        place = self._folder / FOLDER
        # An earlier sweep may have been killed.
        shutil.rmtree(place, ignore_errors=True)
        if self.shared:
            place.mkdir()
        try:
            yield
        finally:
            shutil.rmtree(place, ignore_errors=True)

    def waits(self, run: PlannedRun) -> bool:
        """Tell whether a run has to wait until another one has made its warm-up."""
        return run.seed in self._makers

    def begin(self, run: PlannedRun) -> None:
        """Take note of a run that is carried out now."""
        if self.shared and run.seed not in self._made:
            self._makers[run.seed] = run

    def end(self, run: PlannedRun, *, done: bool) -> None:
        """Take note of a run that is there; once that of every point is, the file is removed."""
        file = warm_up_file(self._folder, run.seed)
        if self._makers.get(run.seed) is run:
            del self._makers[run.seed]
            # Where a run is done and has left no file, its parts cannot be saved: each worker makes its own.
            if done or file.is_file():
                self._made.add(run.seed)
        self._over[run.seed] += 1
        if self._over[run.seed] == self._n_points:
            file.unlink(missing_ok=True)
