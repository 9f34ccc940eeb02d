"""A synchronous run in progress: advanced in pieces, stepped, looked at and forked, it ends as one."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aimd_des import Fleet, InputError, Recording, Simulation, SimulationError, responses, run_synchronous
from aimd_des.lowlevel import SynchronousRun, start_synchronous
from models import smart_cameras
from tests.conftest import FAMILIES, problems, quietly
from tests.support.configurations import SEEDS, answers, assert_same, averagings

PIECES = st.lists(st.one_of(st.floats(0.0, 1.0), st.sampled_from(["step", "signal"])), max_size=5)


@st.composite
def settings_of_runs(draw: st.DrawFn) -> tuple[Any, dict[str, Any]]:
    problem = draw(problems(FAMILIES))
    steps = draw(st.integers(1, 60))
    recording = st.builds(
        Recording,
        demand=st.sampled_from(["auto", "end", 3.0]),
        allocations=st.sampled_from(["end", 7.0]),
        tail=st.sampled_from([0, 3]),
    )
    return problem, {
        "steps": steps,
        "seed": draw(SEEDS),
        "lag": draw(st.integers(0, 1)),
        "averaging": draw(averagings()),
        "response": draw(answers()),
        "recording": draw(recording),
    }


def go(run: SynchronousRun, piece: float | str) -> None:
    if isinstance(piece, str):
        run.step("signal" if piece == "signal" else "step")
    else:
        run.advance(to=max(run.time, int(piece * run.until)))


@settings(max_examples=30)
@given(settings_of_runs(), PIECES, st.integers(0, 5), st.booleans())
def test_pieces_and_forks_make_the_same_run(
    setting: tuple[Any, dict[str, Any]], pieces: list[float | str], place: int, fork_first: bool
) -> None:
    problem, parts = setting
    whole = quietly(run_synchronous, problem, **parts)
    run = start_synchronous(problem, **parts)
    forks = []
    for number, piece in enumerate(pieces):
        go(run, piece)
        run.totals()
        if number == place:
            forks.append(run.fork())
            forks.append(forks[0].fork())
    for one in [*forks, run] if fork_first else [run, *forks[::-1]]:
        assert_same(whole, quietly(one.result))


def test_totals_are_those_of_an_asynchronous_run_at_the_same_time() -> None:
    """With clocks in phase and signals that take half a step, both are the same run."""
    problem = smart_cameras(0, 12)
    run = start_synchronous(problem, steps=60, seed=3)
    other = Simulation(problem, agents=Fleet, seed=3, channel=None).start(60.0)
    lagless = start_synchronous(problem, steps=60, seed=3, lag=0)
    for step in (1, 17, 40, 59):
        lagless.advance(step)
        other.advance(step)
        ours, theirs = lagless.totals(), other.totals()
        assert ours[["demand", "capacity"]].equals(theirs[["demand", "capacity"]])
        assert np.array_equal(ours["signals"], theirs["signals"])
        assert np.array_equal(ours["average"], theirs["average"])
    run.advance(17)
    assert run.totals().loc["memory", "demand"] > 0.0


def test_steps_and_signals() -> None:
    problem = smart_cameras(0, 12)
    whole = run_synchronous(problem, steps=80, seed=1)
    run = start_synchronous(problem, steps=80, seed=1)
    assert (run.time, run.until, run.peek()) == (0, 80, 0.0)
    assert run.step()
    assert run.time == 1
    times = []
    while run.step("signal"):
        times.append(run.time - 1.0)
    assert times == np.unique(whole.signals["time"]).tolist()
    assert (run.time, run.peek()) == (80, math.inf)
    assert not run.step()
    assert run.result() is run.result()
    with pytest.raises(SimulationError, match=r"^the run is over at step 80"):
        run.fork()


def test_other_draws_and_another_response_from_the_fork_on() -> None:
    run = start_synchronous(smart_cameras(0, 12), steps=100, seed=1, recording=Recording(demand=1.0))
    run.advance(50)
    forks = [run.fork(), run.fork(3), run.fork(3), run.fork(4), run.fork(3).fork(3)]
    forks.append(run.fork(response=responses.Derandomised()))
    whole, *others = [fork.result() for fork in forks]
    assert others[0].digest == others[1].digest
    assert len({result.digest for result in (whole, *others)}) == 5
    for other in others:
        totals = whole.observations.total_demand, other.observations.total_demand
        assert np.array_equal(totals[0][:51], totals[1][:51])
        assert not np.array_equal(*totals)


def test_what_is_out_of_range_is_refused() -> None:
    run = start_synchronous(smart_cameras(0, 5), steps=10, seed=1)
    run.advance(4)
    for wrong in (3, 11):
        with pytest.raises(InputError, match=rf"^to = {wrong}: must be"):
            run.advance(wrong)
    with pytest.raises(InputError, match=r"^kind = 'event': must be"):
        run.step("event")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"^salt = -1: must be"):
        run.fork(-1)
    with pytest.raises(InputError, match=r"^response = 3: must be a response"):
        run.fork(response=3)  # type: ignore[arg-type]
