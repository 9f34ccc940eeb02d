"""What is watched during a run, what comes out of it, and what is measured."""

from aimd_des.results.recording import Recording
from aimd_des.results.result import Result

__all__ = ["Recording", "Result"]
