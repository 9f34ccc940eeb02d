"""The command `aimd-des`: a module for each subcommand, imported when it is needed.

What is heavy (NumPy, pandas, Numba, rich) is imported inside the functions, so that help and
completion are instant.
"""

from aimd_des.cli.main import main

__all__ = ["main"]
