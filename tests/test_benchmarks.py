"""The benchmark's C++ program is held against ours: a rival that does other work is no yardstick."""

import os
import shlex
import shutil

import numpy as np
import pytest

from aimd_des import Fleet, Recording
from aimd_des.utils.validation import FloatArray
from benchmarks import asynchronous
from benchmarks.asynchronous import Outcome, Run, Task
from benchmarks.harness import Alone

CAMERAS, UNTIL = 60, 200.0
OURS, RIVALS = 40, 400  # runs: the C++ program's cost next to nothing
FAR = 5.0  # standard errors; the seeds are fixed, so what passes once passes always

COMPILER = shlex.split(os.environ.get("CXX", "c++"))[0]
pytestmark = pytest.mark.skipif(shutil.which(COMPILER) is None, reason=f"{COMPILER} is not installed")


@pytest.fixture(scope="module")
def task() -> Task:
    return asynchronous._task(CAMERAS, UNTIL)


@pytest.fixture(scope="module")
def rival(task: Task) -> Run:
    return asynchronous._prepare_queue(task)


def _numbers(outcome: Outcome) -> FloatArray:
    """One run in a row: deliveries, signals and total average of each resource, then every single average."""
    average = outcome.average
    return np.concatenate([[outcome.deliveries], outcome.signals, average.sum(axis=0), average.ravel()])


def _scores(ours: FloatArray, theirs: FloatArray) -> FloatArray:
    """Difference of the means in standard errors."""
    errors = [sample.var(axis=0, ddof=1) / len(sample) for sample in (ours, theirs)]
    return np.asarray((ours.mean(axis=0) - theirs.mean(axis=0)) / np.sqrt(errors[0] + errors[1]))


def test_the_c_plus_plus_program_does_what_our_simulation_does(task: Task, rival: Run) -> None:
    run = asynchronous._prepare_ours(task, Fleet, Recording("end", overshoot=False))
    ours = np.array([_numbers(run(seed)) for seed in range(OURS)])
    theirs = np.array([_numbers(rival(seed)) for seed in range(RIVALS)])
    scores = _scores(ours, theirs)
    assert np.abs(scores).max() < FAR
    # Many scores that are all a little off would pass that: together they scatter as scores do.
    assert np.mean(scores**2) == pytest.approx(1.0, abs=0.5)
    # And the samples are large enough to see a difference that matters.
    together = ours[:, : 1 + 2 * task.problem.n_resources]
    assert (together.std(axis=0) / np.sqrt(OURS) < 0.01 * together.mean(axis=0)).all()


def test_the_c_plus_plus_program_repeats_itself_and_listens_to_its_seed(rival: Run) -> None:
    first, again, other = (_numbers(rival(seed)) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_one_copy_in_ten_is_lost(rival: Run) -> None:
    outcome = rival(0)
    sent = CAMERAS * int(outcome.signals.sum())
    # Copies of three signals of every resource: with half the hold-off as latency, more are hardly under way.
    in_flight = 3 * outcome.average.size
    expected, scatter = (1 - asynchronous.LOSS) * sent, np.sqrt(0.09 * sent)
    assert expected - in_flight - FAR * scatter < outcome.deliveries < expected + FAR * scatter


def test_the_table_has_a_row_for_every_program(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # A process of its own for each program would take some two seconds each, most of them for imports.
    monkeypatch.setattr(asynchronous, "alone", lambda contestant, seed: Alone(1.0, 2.0, 3.0))
    asynchronous.main(["--cameras", "5", "--until", "60", "--repeats", "1"])
    out = capsys.readouterr().out
    names = [contestant.name for contestant, _ in asynchronous._contestants(asynchronous._task(5, 60.0))]
    rows = [line for line in out.splitlines() if line.strip().startswith(tuple(names))]
    assert [row.strip().partition("  ")[0] for row in rows] == names
    assert all(row.split()[-3:] == ["1.00", "2", "3.0"] for row in rows)
    asynchronous.main(["--cameras", "5", "--until", "60", "--repeats", "1", "--programs", names[1]])
    out = capsys.readouterr().out
    assert [name for name in names if f"  {name}  " in out] == [names[1]]
