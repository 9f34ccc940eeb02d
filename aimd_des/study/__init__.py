"""Many runs: a study as data, carried out on one machine or many, read back, and its statistics."""

from aimd_des.study.axis import Axis
from aimd_des.study.file import read_study
from aimd_des.study.replicate import jackknife, mean_and_error, replicate
from aimd_des.study.results import StudyResults, load_study
from aimd_des.study.run import Tally, run_study
from aimd_des.study.statistics.intervals import Interval, difference, mean_interval, paired_difference
from aimd_des.study.statistics.steady_state import BatchMeans, batch_means, mser
from aimd_des.study.statistics.steady_utilisation import steady_utilisation
from aimd_des.study.statistics.stopping import replications_needed
from aimd_des.study.statistics.summary import compare, summarise
from aimd_des.study.study import Precision, Study

__all__ = [
    "Axis",
    "BatchMeans",
    "Interval",
    "Precision",
    "Study",
    "StudyResults",
    "Tally",
    "batch_means",
    "compare",
    "difference",
    "jackknife",
    "load_study",
    "mean_and_error",
    "mean_interval",
    "mser",
    "paired_difference",
    "read_study",
    "replicate",
    "replications_needed",
    "run_study",
    "steady_utilisation",
    "summarise",
]
