"""Many runs: a study as data, carried out on one machine or many, read back, and its statistics."""

from aimd_des.study.axis import Axis
from aimd_des.study.design import Precision, Study
from aimd_des.study.file import read_study
from aimd_des.study.intervals import Interval, difference, mean_interval, paired_difference
from aimd_des.study.loaded import StudyResults, load_study
from aimd_des.study.replicate import jackknife, mean_and_error, replicate
from aimd_des.study.steady import BatchMeans, batch_means, mser
from aimd_des.study.stopping import replications_needed
from aimd_des.study.sweep import Tally, run_study
from aimd_des.study.tables import compare, summarise
from aimd_des.study.utilisation import steady_utilisation

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
