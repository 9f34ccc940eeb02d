"""The synchronous algorithm of the paper (Algorithms 1 and 2), compiled."""

from aimd_des.synchronous.synchronous import run_discrete

__all__ = ["run_discrete"]
