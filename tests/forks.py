"""Programs in processes of their own that need not import everything again: copies of one that has."""

import atexit
import functools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.conftest import ROOT

# Reads a request from each line: run code here, copy itself, or wait for a copy. A copy leaves the loop.
_SERVER = """
import json, os, shutil, signal, sys, time

running = set()

def code_of(pid, patience):
    end = time.monotonic() + patience
    while True:
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended or time.monotonic() >= end:
            running.discard(ended)
            return os.waitstatus_to_exitcode(status) if ended else None
        time.sleep(0.005)

def serve():
    while line := sys.stdin.readline():
        asked = json.loads(line)
        if "prepare" in asked:
            exec(asked["prepare"], {})
            said = None
        elif "wait" in asked:
            said = code_of(asked["wait"], asked["patience"])
        else:
            said = os.fork()
            if not said:
                return asked
            running.add(said)
        print(json.dumps(said), flush=True)
    # What a test that has failed has left.
    for pid in running:
        os.kill(pid, signal.SIGKILL)
    shutil.rmtree(os.getcwd(), ignore_errors=True)
    os._exit(0)

asked = serve()
os.setsid()
for number, (path, flags) in enumerate(
    ((os.devnull, os.O_RDONLY), (asked["stdout"], os.O_WRONLY), (asked["stderr"], os.O_WRONLY))
):
    os.dup2(os.open(path, flags | (os.O_CREAT if number else 0), 0o600), number)
os.chdir(asked["cwd"])
os.environ.clear()
os.environ.update(asked["environment"])
sys.path[1:1] = filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
sys.argv[1:] = asked["arguments"]
if "numba" in sys.modules:
    sys.modules["numba"].config.reload_config()
code = asked["code"]
del asked, serve, code_of, running, number, path, flags
exec(compile(code, "<string>", "exec"))
"""

# What most commands import.
_COMMANDS = """
import aimd_des.scenario, aimd_des.study, pandas, pyarrow, rich.table, scipy.integrate, scipy.optimize
import aimd_des.cli.emulate, aimd_des.cli.run_tables, aimd_des.emulate, aimd_des.scenario.run_folder
import aimd_des.utils.compiling
"""

#: Runs a file.
FILE = "import runpy, sys\nrunpy.run_path(sys.argv[1], run_name='__main__')"

#: Runs the command with the arguments of the process.
PROGRAM = "from aimd_des.__main__ import main\nmain()"


@dataclass(frozen=True)
class Fork:
    """A copy of a server that runs code, in a group of processes of its own."""

    server: "ForkServer"
    pid: int
    stdout: Path
    stderr: Path

    def poll(self) -> int | None:
        """Tell with which code it has ended, or None; once it has ended this must not be asked again."""
        return self.server.ask(wait=self.pid, patience=0.0)

    def wait(self, patience: float = 300.0) -> "subprocess.CompletedProcess[str]":
        """Wait until it has ended."""
        code = self.server.ask(wait=self.pid, patience=patience)
        # A device such as /dev/full would be read without an end.
        said, errors = (
            path.read_text(encoding="utf-8") if path.is_file() else "" for path in (self.stdout, self.stderr)
        )
        assert code is not None, f"it has not ended after {patience} s: {errors}"
        return subprocess.CompletedProcess([], code, said, errors)


class ForkServer:
    """An interpreter that imports once, and copies itself for each program."""

    def __init__(self) -> None:
        if not hasattr(os, "fork"):
            pytest.skip("the system cannot copy processes")
        self._folder = Path(tempfile.mkdtemp())  # which the server removes
        self._prepared: set[str] = set()
        self._forks = 0
        self._process = subprocess.Popen(
            [sys.executable, "-c", _SERVER],
            cwd=self._folder,
            env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": "321"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        atexit.register(self.close)

    def ask(self, **request: object) -> int | None:
        """Send a request and wait for the answer."""
        assert self._process.stdin
        assert self._process.stdout
        print(json.dumps(request), file=self._process.stdin, flush=True)
        answer = self._process.stdout.readline()
        assert answer, "the server has ended"
        found: int | None = json.loads(answer)
        return found

    def prepare(self, code: str) -> "ForkServer":
        """Run code in the server, once: what it imports or compiles is then there in all copies."""
        if code not in self._prepared:
            self.ask(prepare=code)
            self._prepared.add(code)
        return self

    def start(
        self,
        code: str,
        *arguments: str,
        cwd: Path | None = None,
        stdout: Path | None = None,
        **environment: str,
    ) -> Fork:
        """Start code in a copy, which finds the arguments in `sys.argv`."""
        self._forks += 1
        outputs = [stdout, *(self._folder / f"{self._forks}.{name}" for name in ("out", "err"))]
        stdout, stderr = outputs[0] or outputs[1], outputs[2]
        assert stderr
        stderr.touch()
        pid = self.ask(
            code=code,
            arguments=arguments,
            cwd=str(cwd or Path.cwd()),
            environment={**os.environ, "PYTHONPATH": str(ROOT), **environment},
            stdout=str(stdout),
            stderr=str(stderr),
        )
        assert pid
        return Fork(self, pid, stdout, stderr)

    def run(
        self,
        code: str,
        *arguments: str,
        cwd: Path | None = None,
        stdout: Path | None = None,
        **environment: str,
    ) -> "subprocess.CompletedProcess[str]":
        """Run code in a copy to its end."""
        return self.start(code, *arguments, cwd=cwd, stdout=stdout, **environment).wait()

    def close(self) -> None:
        """End the server."""
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()


@functools.cache
def forks() -> ForkServer:
    """Give the server that has imported what most commands import."""
    return ForkServer().prepare(_COMMANDS)


@functools.cache
def compilers() -> ForkServer:
    """Give a server that has compiled something, and imported no more of the project than Numba asks for."""
    return ForkServer().prepare("import numba, simpy\nnumba.njit(lambda x: x + 1.0)(1.0)")


def until(condition: Callable[[], bool], patience: float = 300.0) -> None:
    """Wait for something; how long must not depend on what else the machine does."""
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end, "it has not come"
        time.sleep(0.005)
