"""The compiled steps of Algorithms 1 and 2: the control unit looks, agents answer, observers watch."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.dynamics.demand import DISCRETE, answer_row, average_row
from aimd_des.dynamics.state import AgentParameters, State
from aimd_des.dynamics.totals import observe, totals
from aimd_des.problem.costs import Costs, CostTable
from aimd_des.problem.costs.kernels import gradient_row
from aimd_des.results.metrics import fold_overshoot
from aimd_des.utils.jit import kernel
from aimd_des.utils.records import record
from aimd_des.utils.rng import Key, uniforms_row
from aimd_des.utils.validation import FloatArray

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


@record
class StepControl(NamedTuple):
    """The control unit: the totals of this look, S(k) in force, what is broadcast, and measures.

    All arrays have shape (m,) but `moment`, (1,), the step at hand, `middle`, (1,), the middle of the run, at
    which `used` is kept as `half`, and `broadcast`, (K, m): whether step k broadcast for resource j.
    """

    # Single numbers are arrays of one: kernels write them.
    moment: FloatArray
    total: FloatArray
    signal: BoolArray
    sent: IntArray
    broadcast: BoolArray
    peak: FloatArray
    above: FloatArray
    excess: FloatArray
    used: FloatArray
    middle: FloatArray
    half: FloatArray


@record
class StepBuffers(NamedTuple):
    """Working memory, so that nothing is allocated per step."""

    folded: FloatArray
    average: FloatArray
    gradient: FloatArray
    uniform: FloatArray
    spare: FloatArray


@record
class RecordBuffers(NamedTuple):
    """Buffers of the observers; `cursor` has the looks of either kind that are done, and the next step."""

    demand_steps: FloatArray
    total_demand: FloatArray
    total_average: FloatArray
    allocation_steps: FloatArray
    demand: FloatArray
    average: FloatArray
    cursor: IntArray


@kernel
def _measure(parameters: AgentParameters, control: StepControl) -> None:
    """Fold the totals of one step into peak, time above capacity and mean excess."""
    # How much of this step lies before the middle of the run, which is within a step if their number is odd.
    # Before `used` is moved on, since `half` is what it is there.
    first_half = control.middle[0] - (control.moment[0] - 1.0)
    if 0.0 < first_half <= 1.0:
        for j in range(control.total.shape[0]):
            control.half[j] = control.used[j] + control.total[j] * first_half
    running = (control.peak, control.above, control.excess, control.used)
    fold_overshoot(control.total, parameters.capacity, 1.0, *running)


@kernel
def _record_step(
    state: State, parameters: AgentParameters, records: RecordBuffers, control: StepControl
) -> None:
    """Keep totals and allocations of x(k), k being the next step that is asked for."""
    # Totals and allocations are asked for at different steps; `step` is the earlier of the next of either,
    # and what is read of all agents then serves both.
    row, page, step = records.cursor[0], records.cursor[1], records.cursor[2]
    demand, average = records.demand[page], records.average[page]
    observe(state, parameters, control.moment, DISCRETE, demand, average)
    if records.demand_steps[row] == step:
        for j in range(control.total.shape[0]):
            # In the order of agents, as at every other look: so asynchronous runs come to the same bits.
            used = 0.0
            for i in range(average.shape[1]):
                used += average[j, i]
            records.total_demand[row, j] = control.total[j]
            records.total_average[row, j] = used
        records.cursor[0] += 1
    # Otherwise the page is written again at a step that is asked for.
    if records.allocation_steps[page] == step:
        records.cursor[1] += 1
    # Both end with the end of the run, so neither runs out before the other.
    if records.cursor[0] < records.demand_steps.shape[0]:
        records.cursor[2] = min(
            records.demand_steps[records.cursor[0]], records.allocation_steps[records.cursor[1]]
        )


@kernel
def _look(
    state: State,
    parameters: AgentParameters,
    step: int,
    lag: int,
    control: StepControl,
    records: RecordBuffers,
) -> bool:
    """Let the control unit look at x(k): Algorithm 1.  Tells whether agents must act on a signal at k."""
    control.moment[0] = step
    # Added up anew and never carried along, so that no step inherits the rounding of those before it.
    totals(state, parameters, control.moment, DISCRETE, control.total)
    if step > 0:  # demand is x(k) over (k-1, k], the interval that this look closes
        _measure(parameters, control)
    if step == records.cursor[2]:
        _record_step(state, parameters, records, control)
    acting = False
    for j in range(parameters.limit.shape[0]):
        due = control.total[j] > parameters.limit[j]
        control.broadcast[step, j] = due
        # Without a lag S(k) is what this look finds; else it is what the look before has left in `signal`.
        if lag == 0:
            control.signal[j] = due
            control.sent[j] += due
        acting = acting or control.signal[j]
    return acting


@kernel
def _conclude(parameters: AgentParameters, step: int, lag: int, control: StepControl) -> None:
    """Put S(k+1) in force."""
    # After the agents of step k, who act on S(k).  `sent` counts what is in force: it is one more than the
    # number of the broadcast that is answered, the address of its draws.
    if lag == 1:
        for j in range(parameters.limit.shape[0]):
            control.signal[j] = control.broadcast[step, j]
            control.sent[j] += control.signal[j]


@kernel
def _average(
    state: State, parameters: AgentParameters, step: int, resource: int, buffers: StepBuffers
) -> None:
    """Bring the averages of one resource to step k."""
    # Only where somebody may answer: between signals demand is a line, and averages are read off it.
    folded, average = buffers.folded[resource], buffers.average[resource]
    average_row(state, parameters, resource, float(step), DISCRETE, folded, average)


@kernel
def _average_all(state: State, parameters: AgentParameters, step: int, buffers: StepBuffers) -> None:
    """Bring the averages of all resources to step k."""
    for j in range(state.demand.shape[0]):
        _average(state, parameters, step, j, buffers)


@kernel
def _answer_signal(
    state: State,
    parameters: AgentParameters,
    step: int,
    resource: int,
    number: int,
    key: Key,
    buffers: StepBuffers,
) -> None:
    """Let all agents answer broadcast b for resource j; averages and derivatives are in `buffers`."""
    # The draws that an asynchronous run takes for the same broadcast, whatever happened before it.
    uniforms_row(key, resource, number, 0, buffers.uniform)
    answer_row(
        state,
        parameters,
        resource,
        buffers.folded[resource],
        buffers.average[resource],
        buffers.gradient[resource],
        buffers.uniform,
        float(step),
        DISCRETE,
    )


@kernel
def take_steps(
    state: State,
    parameters: AgentParameters,
    table: CostTable,
    first: int,
    steps: int,
    lag: int,
    key: Key,
    control: StepControl,
    records: RecordBuffers,
    buffers: StepBuffers,
) -> None:
    """Take some steps, one after the other, in compiled code."""
    # From `first` on until `steps` have been taken in all, since a run is taken in parts.
    coupled = table.weights.shape[0] > 0
    for step in range(first, steps):
        if _look(state, parameters, step, lag, control, records):
            # Averages must be taken before anybody answers: coupled costs read all of them.
            if coupled:
                _average_all(state, parameters, step, buffers)
            for j in range(parameters.limit.shape[0]):
                if control.signal[j]:
                    if not coupled:
                        _average(state, parameters, step, j, buffers)
                    gradient_row(table, buffers.average, j, buffers.gradient[j], buffers.spare)
                    _answer_signal(state, parameters, step, j, control.sent[j] - 1, key, buffers)
        _conclude(parameters, step, lag, control)


def take_custom_steps(
    costs: Costs,
    state: State,
    parameters: AgentParameters,
    steps: int,
    lag: int,
    key: Key,
    control: StepControl,
    records: RecordBuffers,
    buffers: StepBuffers,
) -> None:
    """Take all steps with derivatives from the gradient of the costs, which kernels cannot call."""
    for step in range(steps):
        if _look(state, parameters, step, lag, control, records):
            _average_all(state, parameters, step, buffers)
            # One call for all agents and resources: a function of Python costs more than what it computes.
            buffers.gradient[:] = costs.gradient(buffers.average.T).T
            for j in np.flatnonzero(control.signal):
                _answer_signal(state, parameters, step, int(j), int(control.sent[j]) - 1, key, buffers)
        _conclude(parameters, step, lag, control)


def close_books(
    state: State, parameters: AgentParameters, steps: int, control: StepControl, records: RecordBuffers
) -> None:
    """Measure and watch x(K), to which the last step has led."""
    # No look of the control unit: K steps have K looks, at x(0) to x(K - 1).
    control.moment[0] = steps
    totals(state, parameters, control.moment, DISCRETE, control.total)
    _measure(parameters, control)
    _record_step(state, parameters, records, control)
