"""`aimd-des run --checkpoint --resume`: whatever ends a run, the same command goes on, to the same bytes."""

import os
import random
import signal
import time
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from aimd_des.lowlevel import Run
from aimd_des.scenario import checkpoints, load_scenario
from aimd_des.utils.errors import SimulationError
from tests.command_line import everything, invoke, refusal, run, write
from tests.conftest import ROOT, quietly
from tests.forks import PROGRAM, forks

pytestmark = pytest.mark.usefixtures("own_folder")

FLEET = ("--agents", "fleet")
KEPT = Path("out.checkpoint")


def sums(folder: str) -> str:
    """The checksums of all files of a folder."""
    return Path(folder, "SHA256SUMS").read_text(encoding="utf-8")


def checkpoint_at(until: float, at: float, **changes: object) -> None:
    """Leave the checkpoint of a run that was ended on its way."""
    scenario = load_scenario(write(), agents="fleet", until=until, **changes)
    begun = scenario.simulation().start(until)
    begun.advance(at)
    begun.save(KEPT)


class SlowlySaved:
    """A run that takes a second for each unit of time, and four to be saved."""

    until = 2000.0

    def __init__(self) -> None:
        self.time = self.clock = 0.0
        self.saved: list[float] = []

    def advance(self, to: float | None = None, watch: object = None) -> None:
        goal = self.until if to is None else to
        self.clock, self.time = self.clock + goal - self.time, goal

    def save(self, path: Path) -> None:
        self.saved.append(self.clock)
        self.clock += 4.0

    def result(self) -> float:
        return self.clock


def test_checkpoints_take_no_more_than_a_hundredth_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    slow = SlowlySaved()
    monkeypatch.setattr(checkpoints.time, "monotonic", lambda: slow.clock)
    checkpoints.finish(cast(Run, slow), KEPT, 10.0)
    # The first as asked for; then each after a hundred times what it has taken, and a piece at most.
    waits = np.diff([-4.0, *slow.saved]) - 4.0
    assert 10.0 <= waits[0] <= 10.5
    assert len(waits) == 5
    assert ((waits[1:] >= 400.0) & (waits[1:] <= 400.5)).all()


def test_checkpoints_change_nothing_and_are_gone_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    write()
    assert run("five.toml", *FLEET, "--out", "whole").exit_code == 0
    saved = []
    monkeypatch.setattr(checkpoints.Run, "save", lambda run, path: saved.append((run.time, path.name)))
    outcome = run("five.toml", *FLEET, "--out", "out", "--checkpoint", "1e-9")
    assert outcome.exit_code == 0, outcome.output
    assert sums("out") == sums("whole")
    times = [time for time, _ in saved]
    assert len(times) > 3
    assert times == sorted(set(times))
    assert {name for _, name in saved} == {"out.checkpoint"}


def test_a_run_goes_on_from_its_checkpoint() -> None:
    write()
    assert run("five.toml", *FLEET, "--out", "whole").exit_code == 0
    checkpoint_at(60, 41.0)
    Path(".out.checkpoint.part").write_bytes(b"of a process that was killed")
    outcome = run("five.toml", *FLEET, "--out", "out", "--resume")
    assert outcome.exit_code == 0, outcome.output
    assert outcome.stderr.count("Goes on at time 41 from out.checkpoint") == 1
    assert sums("out") == sums("whole")
    assert not list(Path().glob("*.checkpoint*")) + list(Path().glob(".*.part"))


def test_without_a_checkpoint_it_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = run(str(write()), *FLEET, "--out", "out", "--resume")
    assert outcome.exit_code == 0, outcome.output
    assert "Goes on" not in outcome.stderr
    # What is there from another attempt is of no interest to one that does not ask for it.
    checkpoint_at(60, 41.0)
    monkeypatch.setattr(checkpoints, "resume", lambda *_: pytest.fail("asked for"))
    assert run("five.toml", *FLEET, "--out", "new", "--checkpoint", "60").exit_code == 0


def test_what_cannot_be_gone_on_with_is_refused() -> None:
    write()
    command = ("run", "five.toml", "--no-figures", "--out", "out")
    assert "agents = 'process': must be 'fleet' with checkpoints" in refusal(*command, "--checkpoint", "5")
    synchronous = ("--set", "dynamics=synchronous", "--checkpoint", "5")
    assert "dynamics = 'synchronous': must be 'discrete' or" in refusal(*command, *synchronous)
    checkpoint_at(60, 41.0)
    again = (*command, *FLEET, "--resume")
    assert "simulation = 'Simulation': must be that of which out.checkpoint" in refusal(*again, "--seed", "5")
    assert "until = 70.0: must be 60.0, as of the run in out.checkpoint" in refusal(
        *again, "--set", "until=70"
    )
    damaged = bytearray(KEPT.read_bytes())
    damaged[1000] ^= 1
    KEPT.write_bytes(damaged)
    assert "out.checkpoint: is damaged (it does not have its checksum)" in refusal(*again)


def test_a_run_that_fails_leaves_its_checkpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    write()
    checkpoint_at(60, 41.0)
    before = everything()

    def fail(*_: object) -> None:
        raise SimulationError("by the test")

    monkeypatch.setattr(checkpoints.Run, "advance", fail)
    assert run("five.toml", *FLEET, "--out", "out", "--resume").exit_code == 1
    assert everything() == before


KILLS = 3
#: A fleet that has run once: what it runs is then there in all copies of the process.
FLEET_THERE = f"""
import aimd_des.scenario
aimd_des.scenario.load_scenario({str(ROOT / "scenarios" / "paper.toml")!r}, agents="fleet", until=5.0).run()
"""


@pytest.mark.slow
def test_killed_at_random_moments_it_goes_on_to_the_same_bytes() -> None:
    write()
    until = ("--set", "until=900000", "--set", "recording.demand=1000.0")
    options = ("five.toml", *FLEET, *until, "--no-figures")
    whole = quietly(invoke, "run", *options, "--out", "whole")
    assert whole.exit_code == 0, whole.output
    command = ("run", *options, "--out", "out", "--checkpoint", "0.1", "--resume")
    server = forks().prepare(FLEET_THERE)
    draw, seen = random.Random(1), 0
    for _ in range(KILLS):
        process = server.start(PROGRAM, *command)
        # At any moment after it has written something new, and so perhaps while it writes.
        while not KEPT.exists() or KEPT.stat().st_mtime_ns == seen:
            assert process.poll() is None, "the run was through before it could be killed"
            time.sleep(0.005)
        time.sleep(draw.uniform(0.0, 0.1))
        assert process.poll() is None, "the run was through before it could be killed"
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        seen = KEPT.stat().st_mtime_ns
    done = server.run(PROGRAM, *command)
    assert done.returncode == 0, done.stderr
    assert "Goes on at time" in done.stderr
    assert sums("out") == sums("whole")
    assert not KEPT.exists()
