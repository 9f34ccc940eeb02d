"""Where runs are carried out: processes of our own, or an executor that the caller made."""

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from importlib import import_module
from multiprocessing import forkserver, get_all_start_methods, get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from aimd_des.study import worker_task
from aimd_des.utils.errors import InputError

# Workers share the machine run by run: threads of their own would only be in each other's way.
_ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "NUMBA_NUM_THREADS",
    ),
    "1",
)

# What runs need and this process may never: it imports Numba.
_COMPILES = "aimd_des.utils.compiling"


class Pool(Protocol):
    """What makes executors; more than once, because a killed worker breaks one."""

    workers: int

    def start(self, workers: int) -> Executor:
        """Make an executor with so many workers, or give the one there is."""

    def stop(self, executor: Executor) -> None:
        """Let go of an executor that `start` gave."""

    def end_at_once(self) -> None:
        """End all that is under way, if that is possible."""


class Processes:
    """Processes of this machine, to be used as a context.

    They are never forked from this process, which would copy the locks of threads that it does not
    copy.  Where the system can, they are forked from a server that has imported what runs need.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        method = "forkserver" if "forkserver" in get_all_start_methods() else "spawn"
        self._context: Any = get_context(method)
        if method == "forkserver":
            self._context.set_forkserver_preload([worker_task.__name__, _COMPILES])
            with _deaf():
                forkserver.ensure_running()
        # Nothing is ever sent: workers see when this end of it is gone.
        self._ear, self._leash = self._context.Pipe(duplex=False)
        self._executor: ProcessPoolExecutor | None = None

    def __enter__(self) -> "Processes":
        self._outer = {name: os.environ.get(name) for name in _ONE_THREAD}
        os.environ.update(_ONE_THREAD)
        return self

    def __exit__(self, *_: object) -> None:
        self._leash.close()
        self._ear.close()
        for name, value in self._outer.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value

    def start(self, workers: int) -> Executor:
        """Make an executor."""
        self._executor = ProcessPoolExecutor(
            workers, self._context, initializer=_begin, initargs=(self._ear,)
        )
        return self._executor

    def stop(self, executor: Executor) -> None:
        """End the processes of an executor once they have done what they are doing."""
        executor.shutdown(cancel_futures=True)

    def end_at_once(self) -> None:
        """End all processes, at once."""
        self._leash.close()
        # One that is about to be forked, or does not listen yet, would miss its parent, with a traceback.
        server = getattr(forkserver, "_forkserver", None)
        if self._context.get_start_method() == "forkserver" and (
            pid := getattr(server, "_forkserver_pid", None)
        ):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)  # it is started anew when it is needed again
        processes = None if self._executor is None else self._executor._processes  # noqa: SLF001 - no other way
        for process in list((processes or {}).values()):
            process.kill()


@contextmanager
def _deaf() -> Iterator[None]:
    """Make what is started here deaf to Ctrl-C, which is for the parent; it hears it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    # The code that starts it starts this before, and is told when that is done.
    resource_tracker.ensure_running()
    earlier = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, earlier)


def _begin(ear: Connection) -> None:
    """Prepare a worker: Ctrl-C is for the parent, and the worker ends with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_follow, args=(ear,), daemon=True).start()


def _follow(ear: Connection) -> None:
    parent = parent_process()
    wait([ear, *([] if parent is None else [parent.sentinel])])
    os._exit(1)


class Given:
    """An executor that the caller made, and keeps."""

    def __init__(self, executor: Executor, workers: int) -> None:
        self.workers = workers
        self._executor = executor

    def start(self, workers: int) -> Executor:
        """Give the executor."""
        return self._executor

    def stop(self, executor: Executor) -> None:
        """Leave it to the caller."""

    def end_at_once(self) -> None:
        """Leave that to the caller, too."""


@contextmanager
def dask_executor(address: str | None = None, workers: int | None = None) -> Iterator[tuple[Executor, int]]:
    """Connect to a Dask scheduler, or start a cluster of processes on this machine."""
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise InputError("Dask is not installed: install 'aimd-des[dask]'") from None
    if address is None:
        with _deaf():
            made = distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None)
        with made as cluster, distributed.Client(cluster) as client:
            yield client.get_executor(pure=False), workers or len(cluster.workers)
        return
    try:
        client = distributed.Client(address, timeout=10)
    except (OSError, ValueError) as error:
        remedy = "start it with the command dask scheduler, and workers with dask worker"
        raise InputError.of(
            "scheduler", address, f"the address of a Dask scheduler ({error})", remedy
        ) from None
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise InputError.of("scheduler", address, "one that has workers", "start some with dask worker")
        yield client.get_executor(pure=False), threads
