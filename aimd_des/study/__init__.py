"""Many runs: a study as data, carried out on one machine or many, and its folder read back."""

from aimd_des.study.design import Axis, Precision, Study
from aimd_des.study.file import read_study
from aimd_des.study.loaded import StudyResults, load_study
from aimd_des.study.sweep import Tally, run_study

__all__ = ["Axis", "Precision", "Study", "StudyResults", "Tally", "load_study", "read_study", "run_study"]
