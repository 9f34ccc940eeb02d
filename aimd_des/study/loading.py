"""A folder read back, of any kind that this program writes."""

from pathlib import Path

from aimd_des.scenario.run_folder import StoredRun, load_run
from aimd_des.study.results import StudyResults, load_study
from aimd_des.utils import validation
from aimd_des.utils.folders import is_study


def load(folder: str | Path) -> StoredRun | StudyResults:
    """Open the folder of a run or of a study.

    Parameters
    ----------
    folder : str or Path
        As `Result.save`, `run_study`, ``aimd-des run`` or ``aimd-des sweep`` has written it.

    Returns
    -------
    StoredRun or StudyResults
        What `load_run` gives of a run, and `load_study` of a study.

    Raises
    ------
    InputError
        If it is neither, or damaged.
    """
    place = validation.path("folder", folder)
    return load_study(place) if is_study(place) else load_run(place)
