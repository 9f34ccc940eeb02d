"""A scenario that is run with checkpoints: what ends it, it goes on from the last of them."""

import math
import time
from collections.abc import Callable
from pathlib import Path

from aimd_des.engine.run_file import unfinished
from aimd_des.engine.run_in_progress import Run, resume
from aimd_des.results.result import Result
from aimd_des.scenario.scenario import Scenario
from aimd_des.utils.errors import InputError

Watch = Callable[[float, int], None]

# A run is advanced in pieces of about this share of the time between two checkpoints, within bounds in
# seconds: a checkpoint is written between two of them, and pieces that are too short come to nothing.
_SHARE, _SHORTEST, _LONGEST = 0.1, 0.02, 0.5

# The first piece, as a share of the whole run.
_FIRST = 1e-4

# What checkpoints may cost: all that a run has recorded is in each, and grows with it.
_COST = 0.01


def begin(scenario: Scenario, path: Path, *, resumed: bool) -> Run:
    """Begin a run that can be saved, or go on with the one that was, where there is one."""
    remedy = "the results are the same"
    if scenario.dynamics == "synchronous":
        allowed = "'discrete' or 'continuous' with checkpoints: nothing is written between two steps"
        raise InputError.of("dynamics", scenario.dynamics, allowed)
    if scenario.agents != "fleet":
        raise InputError.of("agents", scenario.agents, "'fleet' with checkpoints", remedy)
    simulation = scenario.simulation()
    # A run that was killed while it wrote a checkpoint has left a part of it.
    unfinished(path).unlink(missing_ok=True)
    if not (resumed and path.exists()):
        return simulation.start(scenario.until)
    run = resume(path, simulation)
    if run.until != scenario.until:
        raise InputError.of("until", scenario.until, f"{run.until!r}, as of the run in {path}")
    return run


def finish(run: Run, path: Path, seconds: float, watch: Watch | None = None) -> Result:
    """Take a run to its end, and write where it stands every so many seconds, or less often."""
    longest = max(min(_SHARE * seconds, _LONGEST), _SHORTEST)
    piece, saved, wait = _FIRST * run.until, time.monotonic(), seconds
    while run.time < run.until and not math.isinf(seconds):
        began = time.monotonic()
        run.advance(min(run.time + piece, run.until), watch)
        ended = time.monotonic()
        piece *= 2.0 if ended - began < 0.5 * longest else 0.5 if ended - began > longest else 1.0
        if ended - saved >= wait and run.time < run.until:
            run.save(path)
            saved = time.monotonic()
            wait = max(seconds, (saved - ended) / _COST)
    run.advance(watch=watch)
    return run.result()
