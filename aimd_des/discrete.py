"""Algorithms 1 and 2 of the paper, synchronous and with a perfect channel.

At step k every agent acts on S(k) and its average over x(0)..x(k); the control unit looks at x(k)
and sets S(k+1).  With ``lag=0`` the signal set from x(k) is used at k itself.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des import checks, streams
from aimd_des.checks import FloatArray
from aimd_des.compiled import kernel
from aimd_des.metrics import Overshoot, fold_overshoot
from aimd_des.population import Law, State, law_of, observe, start, total_demand
from aimd_des.problem import Problem
from aimd_des.recording import Observations, Recording, Signals
from aimd_des.response import CostTable, answer_row, cost_table, gradient_row, tick_averages
from aimd_des.results import Account, Result
from aimd_des.streams import Key, Purpose, uniforms_row

__all__ = ["run_discrete"]

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


class _Control(NamedTuple):
    """The control unit: the totals of this look, S(k) in force, what is broadcast, and measures.

    All arrays have shape (m,) but `broadcast`, (K, m): whether step k broadcast for resource j.
    """

    total: FloatArray
    signal: BoolArray
    sent: IntArray
    broadcast: BoolArray
    peak: FloatArray
    above: FloatArray
    excess: FloatArray


class _Scratch(NamedTuple):
    """Working memory, so that nothing is allocated per step."""

    average: FloatArray
    gradient: FloatArray
    uniform: FloatArray
    spare: FloatArray


class _Watch(NamedTuple):
    """Buffers of the observers; `cursor` has the looks of either kind that are done, and the next step."""

    demand_steps: FloatArray
    total_demand: FloatArray
    total_average: FloatArray
    allocation_steps: FloatArray
    demand: FloatArray
    average: FloatArray
    cursor: IntArray


@kernel
def _measure(law: Law, control: _Control) -> None:
    """Fold the totals of one step into peak, time above capacity and mean excess."""
    fold_overshoot(control.total, law.capacity, 1.0, control.peak, control.above, control.excess)


@kernel
def _watch(state: State, law: Law, watch: _Watch, total: FloatArray) -> None:
    """Keep totals and allocations of x(k), k being the next step that is asked for."""
    row, page, step = watch.cursor[0], watch.cursor[1], watch.cursor[2]
    demand, average = watch.demand[page], watch.average[page]
    observe(state, law, float(step), demand, average)
    if watch.demand_steps[row] == step:
        for j in range(total.shape[0]):
            used = 0.0
            for i in range(average.shape[1]):
                used += average[j, i]
            watch.total_demand[row, j] = total[j]
            watch.total_average[row, j] = used
        watch.cursor[0] += 1
    if watch.allocation_steps[page] == step:
        watch.cursor[1] += 1
    # Both end with the end of the run, so neither runs out before the other.
    if watch.cursor[0] < watch.demand_steps.shape[0]:
        watch.cursor[2] = min(
            watch.demand_steps[watch.cursor[0]], watch.allocation_steps[watch.cursor[1]]
        )


@kernel
def _look(state: State, law: Law, step: int, lag: int, control: _Control, watch: _Watch) -> bool:
    """Let the control unit look at x(k): Algorithm 1.  Tells whether agents must act on a signal at k."""
    total_demand(state, law, float(step), control.total)
    if step > 0:  # demand is x(k) over (k-1, k], the interval that this look closes
        _measure(law, control)
    if step == watch.cursor[2]:
        _watch(state, law, watch, control.total)
    acting = False
    for j in range(law.limit.shape[0]):
        due = control.total[j] > law.limit[j]
        control.broadcast[step, j] = due
        if lag == 0:
            control.signal[j] = due
            control.sent[j] += due
        acting = acting or control.signal[j]
    return acting


@kernel
def _conclude(law: Law, step: int, lag: int, control: _Control) -> None:
    """Put S(k+1) in force."""
    if lag == 1:
        for j in range(law.limit.shape[0]):
            control.signal[j] = control.broadcast[step, j]
            control.sent[j] += control.signal[j]


@kernel
def _average_all(state: State, law: Law, step: int, scratch: _Scratch) -> None:
    """Bring the averages of all resources to step k."""
    for j in range(state.demand.shape[0]):
        tick_averages(
            state.demand[j],
            state.accumulated[j],
            state.anchor[j],
            law.increase[j],
            float(step),
            scratch.average[j],
        )


@kernel
def _answer(
    state: State, law: Law, step: int, resource: int, number: int, key: Key, scratch: _Scratch
) -> None:
    """Let all agents answer broadcast b for resource j; averages and derivatives are in `scratch`."""
    uniforms_row(key, resource, number, scratch.uniform)
    answer_row(
        state.demand[resource],
        state.accumulated[resource],
        state.anchor[resource],
        state.responses[resource],
        state.saturated[resource],
        law.increase[resource],
        law.decrease[resource],
        law.normalization[resource],
        scratch.average[resource],
        scratch.gradient[resource],
        scratch.uniform,
        float(step),
    )


@kernel
def _run(
    state: State,
    law: Law,
    table: CostTable,
    steps: int,
    lag: int,
    key: Key,
    control: _Control,
    watch: _Watch,
    scratch: _Scratch,
) -> None:
    """Take all steps in compiled code."""
    coupled = table.weights.shape[0] > 0
    for step in range(steps):
        if _look(state, law, step, lag, control, watch):
            # Averages must be taken before anybody answers: coupled costs read all of them.
            if coupled:
                _average_all(state, law, step, scratch)
            for j in range(law.limit.shape[0]):
                if control.signal[j]:
                    if not coupled:
                        tick_averages(
                            state.demand[j],
                            state.accumulated[j],
                            state.anchor[j],
                            law.increase[j],
                            float(step),
                            scratch.average[j],
                        )
                    gradient_row(table, scratch.average, j, scratch.gradient[j], scratch.spare)
                    _answer(state, law, step, j, control.sent[j] - 1, key, scratch)
        _conclude(law, step, lag, control)


def _run_custom(
    problem: Problem,
    state: State,
    law: Law,
    steps: int,
    lag: int,
    key: Key,
    control: _Control,
    watch: _Watch,
    scratch: _Scratch,
) -> None:
    """Take all steps with derivatives from the user's own functions, which kernels cannot call."""
    for step in range(steps):
        if _look(state, law, step, lag, control, watch):
            _average_all(state, law, step, scratch)
            scratch.gradient[:] = problem.costs.gradient(scratch.average.T).T
            for j in np.flatnonzero(control.signal):
                _answer(state, law, step, int(j), int(control.sent[j]) - 1, key, scratch)
        _conclude(law, step, lag, control)


def run_discrete(
    problem: Problem, *, steps: int, seed: int, lag: int = 1, recording: Recording | None = None
) -> Result:
    """Run the synchronous algorithm of the paper (Algorithms 1 and 2) from x(0) = 0.

    Parameters
    ----------
    problem : Problem
        What is shared, by how many, at what cost.
    steps : int
        K >= 1; the run ends in x(K), after K looks of the control unit.
    seed : int
        At least 0; decides which agents respond to which signal.
    lag : {1, 0}
        1: a signal acts one step after the excess that it reports, as the algorithms are
        printed; 0: in the same step.
    recording : Recording, optional
        What to keep besides signals and end; totals at a thousand steps unless given.

    Returns
    -------
    Result
        With times in steps.

    Raises
    ------
    InputError
        If an argument is outside its range.

    Warns
    -----
    RuntimeWarning
        Once, if a response probability was above 1.
    """
    steps = checks.integer("steps", steps, low=1)
    lag = checks.integer("lag", lag, low=0, high=1)
    key = streams.key(seed, Purpose.RESPONSE)
    recording = Recording() if recording is None else recording
    n, m = problem.n_agents, problem.n_resources
    state, law, table = start(m, n), law_of(problem), cost_table(problem.costs)
    control = _Control(
        total=np.zeros(m),
        signal=np.zeros(m, dtype=np.bool_),
        sent=np.zeros(m, dtype=np.int64),
        broadcast=np.zeros((steps, m), dtype=np.bool_),
        peak=np.zeros(m),
        above=np.zeros(m),
        excess=np.zeros(m),
    )
    watch = _open_watch(recording, steps, n, m)
    scratch = _Scratch(np.zeros((m, n)), np.zeros((m, n)), np.zeros(n), np.zeros((2, n)))
    if table.n_agents:
        _run(state, law, table, steps, lag, key, control, watch, scratch)
    else:
        _run_custom(problem, state, law, steps, lag, key, control, watch, scratch)
    total_demand(state, law, float(steps), control.total)
    _measure(law, control)
    _watch(state, law, watch, control.total)
    return _result(problem, seed, steps, state, control, watch)


def _open_watch(recording: Recording, steps: int, n: int, m: int) -> _Watch:
    rows = recording.times("demand", steps, whole=True)
    pages = recording.times("allocations", steps, whole=True)
    return _Watch(
        demand_steps=rows,
        total_demand=np.zeros((len(rows), m)),
        total_average=np.zeros((len(rows), m)),
        allocation_steps=pages,
        demand=np.zeros((len(pages), m, n)),
        average=np.zeros((len(pages), m, n)),
        cursor=np.array([0, 0, min(rows[0], pages[0])], dtype=np.int64),
    )


def _result(
    problem: Problem, seed: int, steps: int, state: State, control: _Control, watch: _Watch
) -> Result:
    step, resource = np.nonzero(control.broadcast)
    number = np.cumsum(control.broadcast, axis=0)[step, resource] - 1
    signals = Signals(step.astype(np.float64), resource, number)
    sent = signals.counts(problem.n_resources)
    overshoot = Overshoot(
        peak=control.peak / problem.capacity,
        time=control.above / steps,
        mean=control.excess / steps / problem.capacity,
    )
    observations = Observations(
        watch.demand_steps,
        watch.total_demand,
        watch.total_average,
        watch.allocation_steps,
        watch.demand,
        watch.average,
        overshoot,
    )
    nothing = np.zeros(problem.n_resources, dtype=np.int64)
    account = Account(
        delivered=sent * problem.n_agents,
        lost=nothing,
        in_flight=nothing,
        responses=state.responses,
        saturated=state.saturated,
    )
    return Result(problem, "discrete", seed, float(steps), signals, observations, account)
