"""``python -m aimd_des`` is the command `aimd-des`."""

from aimd_des.cli import main

main(prog_name="aimd-des")
