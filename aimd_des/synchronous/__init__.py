"""The synchronous algorithm of the paper (Algorithms 1 and 2), compiled."""

from aimd_des.synchronous.synchronous import run_synchronous

__all__ = ["run_synchronous"]
