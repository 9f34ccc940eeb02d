"""Many runs: a study as data, carried out on one machine or many, read back, and its statistics."""

from typing import TYPE_CHECKING

from aimd_des.utils.on_demand import on_demand

if TYPE_CHECKING:
    from aimd_des.study.axis import Axis
    from aimd_des.study.file import read_study
    from aimd_des.study.loading import load
    from aimd_des.study.rare_events import RareEvent, rare_event
    from aimd_des.study.replications import jackknife, mean_and_error, replicate
    from aimd_des.study.results import StudyResults, load_study
    from aimd_des.study.run import run_study
    from aimd_des.study.runs_left import Tally
    from aimd_des.study.statistics.intervals import Interval, difference, mean_interval, paired_difference
    from aimd_des.study.statistics.steady_state import BatchMeans, batch_means, mser
    from aimd_des.study.statistics.steady_utilisation import steady_utilisation
    from aimd_des.study.statistics.stopping import replications_needed
    from aimd_des.study.statistics.summary import compare, summarise
    from aimd_des.study.study import Precision, Study

# Where each name lives: files are checked without frames and what is stored, which are slow to import.
_HOME = {
    "Axis": "axis",
    "BatchMeans": "statistics.steady_state",
    "Interval": "statistics.intervals",
    "Precision": "study",
    "RareEvent": "rare_events",
    "Study": "study",
    "StudyResults": "results",
    "Tally": "runs_left",
    "batch_means": "statistics.steady_state",
    "compare": "statistics.summary",
    "difference": "statistics.intervals",
    "jackknife": "replications",
    "load": "loading",
    "load_study": "results",
    "mean_and_error": "replications",
    "mean_interval": "statistics.intervals",
    "mser": "statistics.steady_state",
    "paired_difference": "statistics.intervals",
    "rare_event": "rare_events",
    "read_study": "file",
    "replicate": "replications",
    "replications_needed": "statistics.stopping",
    "run_study": "run",
    "steady_utilisation": "statistics.steady_utilisation",
    "summarise": "statistics.summary",
}

__all__ = [
    "Axis",
    "BatchMeans",
    "Interval",
    "Precision",
    "RareEvent",
    "Study",
    "StudyResults",
    "Tally",
    "batch_means",
    "compare",
    "difference",
    "jackknife",
    "load",
    "load_study",
    "mean_and_error",
    "mean_interval",
    "mser",
    "paired_difference",
    "rare_event",
    "read_study",
    "replicate",
    "replications_needed",
    "run_study",
    "steady_utilisation",
    "summarise",
]

__getattr__, __dir__ = on_demand(__name__, _HOME)
