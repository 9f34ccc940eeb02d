"""Algorithms 1 and 2 of the paper, synchronous and with a perfect channel.

At step k every agent acts on S(k) and its average over x(0)..x(k); the control unit samples x(k)
and sets S(k+1).  With ``lag=0`` the signal set from x(k) is used at k itself.
"""

import numpy as np

from aimd_des.dynamics.averaging import Averaging
from aimd_des.dynamics.demand import DISCRETE
from aimd_des.dynamics.responses import Response
from aimd_des.dynamics.state import start
from aimd_des.problem.problem import Problem
from aimd_des.results.recording import Recording
from aimd_des.results.result import Result
from aimd_des.synchronous.kernels import RecordBuffers, StepControl
from aimd_des.synchronous.run_in_steps import StepsSetting, SynchronousRun
from aimd_des.utils import limits, rng, validation
from aimd_des.utils.docstrings import described_like
from aimd_des.utils.errors import InputError
from aimd_des.utils.rng import Purpose


def run_synchronous(
    problem: Problem,
    *,
    steps: int,
    seed: int,
    lag: int = 1,
    averaging: Averaging | None = None,
    response: Response | None = None,
    recording: Recording | None = None,
) -> Result:
    """Run the synchronous algorithm of the paper (Algorithms 1 and 2) from x(0) = 0.

    Parameters
    ----------
    problem : Problem
        What is shared, by how many, at what cost.
    steps : int
        K >= 1; the run ends in x(K), after K samples of the control unit.
    seed : int
        At least 0; decides which agents respond to which signal.
    lag : {1, 0}
        1: a signal acts one step after the excess that it reports, as the algorithms are
        printed; 0: in the same step.
    averaging : Averaging, optional
        How agents average their demand. Default: over all of their past.
    response : Response, optional
        How agents answer signals. Default: by the paper's rule.
    recording : Recording, optional
        What to keep besides signals and end; default: totals at a thousand steps.

    Returns
    -------
    Result
        With times in steps.

    Warns
    -----
    RuntimeWarning
        Once, if a response probability was above 1.
    OverloadWarning
        Once, if demand has run away from the capacity.
    """
    run = start_synchronous(
        problem,
        steps=steps,
        seed=seed,
        lag=lag,
        averaging=averaging,
        response=response,
        recording=recording,
    )
    return run.result()


@described_like(run_synchronous)
def start_synchronous(
    problem: Problem,
    *,
    steps: int,
    seed: int,
    lag: int = 1,
    averaging: Averaging | None = None,
    response: Response | None = None,
    recording: Recording | None = None,
) -> SynchronousRun:
    """Begin a run of the synchronous algorithm, in which no step has been taken yet.

    Returns
    -------
    SynchronousRun
        Advanced by its methods, as far as one likes.
    """
    validation.instance("problem", problem, Problem, "a Problem")
    steps = check_steps("steps", steps, problem)
    lag = validation.integer("lag", lag, low=0, high=1)
    key = rng.key(seed, Purpose.RESPONSE)
    recording = Recording() if recording is None else recording
    validation.instance("recording", recording, Recording, "a Recording, such as Recording(demand='end')")
    # Refused, not ignored: a caller that asks for a log would look for it in the result.
    if recording.events:
        raise InputError.of("recording.events", True, "False: the synchronous algorithm has no events")
    n, m = problem.n_agents, problem.n_resources
    setting = StepsSetting(problem, steps, int(seed), lag, averaging, response)
    law = setting.law()
    state = start(m, law.parameters.increase.shape[1], DISCRETE, law.parameters)
    control = StepControl(
        signal=np.zeros(m, dtype=np.bool_),
        answered=np.zeros(m, dtype=np.int64),
        broadcast=np.zeros((steps, m), dtype=np.bool_),
        peak=np.zeros(m),
        above=np.zeros(m),
        excess=np.zeros(m),
        used=np.zeros(m),
        middle=np.array([0.5 * steps]),
        half=np.zeros(m),
    )
    return SynchronousRun(setting, law, (), key, state, control, _open_records(recording, steps, n, m))


def check_steps(field: str, steps: object, problem: Problem) -> int:
    """Refuse a number of steps that is none, or whose signals have no room."""
    clean = validation.integer(field, steps, low=1)
    limits.memory(field, clean, clean * problem.n_resources, "a byte for each step and resource")
    return clean


def _open_records(recording: Recording, steps: int, n: int, m: int) -> RecordBuffers:
    rows = recording.times("demand", steps, whole=True)
    pages = recording.times("allocations", steps, whole=True)
    return RecordBuffers(
        demand_steps=rows,
        total_demand=np.zeros((len(rows), m)),
        total_average=np.zeros((len(rows), m)),
        allocation_steps=pages,
        demand=np.zeros((len(pages), m, n)),
        average=np.zeros((len(pages), m, n)),
        # Both end at K, so there is a next step until both are done.
        cursor=np.array([[0, 0, min(rows[0], pages[0])]] * m, dtype=np.int64),
    )
