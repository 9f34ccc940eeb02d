"""The command `aimd-des`, also as ``python -m aimd_des``: Ctrl-C ends it with a sentence at any moment.

The first Ctrl-C is a `KeyboardInterrupt`, so that what is under way is put in order; the second ends the
process at once.  When everything is done, there is nothing left to end.
"""

import gc
import os
import signal
import sys

# Nothing more is imported before Ctrl-C is heard.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import FrameType
    from typing import NoReturn

__all__ = ["main"]

# As `aimd_des.cli.errors` has it, which takes its time to import.
_INTERRUPTED = 130

# Commands that run systems, and make garbage for as long as they do.
_RUNNING = {"run", "watch", "live", "emulate", "sweep"}


def _press(number: int, frame: "FrameType | None") -> "NoReturn":  # noqa: ARG001 - of a signal handler
    signal.signal(signal.SIGINT, _press_again)
    raise KeyboardInterrupt


def _press_again(number: int, frame: "FrameType | None") -> "NoReturn":  # noqa: ARG001 - of a signal handler
    os.write(2, b"Stopped.\n")
    os._exit(_INTERRUPTED)


def _stop() -> "NoReturn":
    sys.stderr.write("Stopped.\n")
    raise SystemExit(_INTERRUPTED) from None


def main() -> "NoReturn":
    """Run the command that the command line of this process gives."""
    signal.signal(signal.SIGINT, _press)
    if _RUNNING.isdisjoint(sys.argv[1:2]):
        # The others mostly import: to search what that makes, again and again, takes a tenth of their time.
        gc.disable()
    try:
        from aimd_des.cli import main as command

        command(prog_name="aimd-des")
    except Exception:
        if signal.getsignal(signal.SIGINT) is not _press_again:
            raise
        _stop()  # some libraries make another exception of one that comes while they are imported
    except KeyboardInterrupt:
        _stop()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    raise SystemExit(0)


if __name__ == "__main__":
    main()
