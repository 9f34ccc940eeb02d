"""The synchronous algorithm of the paper (Algorithms 1 and 2), compiled."""

from aimd_des.synchronous.run_in_steps import SynchronousRun
from aimd_des.synchronous.synchronous import run_synchronous, start_synchronous

__all__ = ["SynchronousRun", "run_synchronous", "start_synchronous"]
