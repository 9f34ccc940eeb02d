"""The compiled steps of Algorithms 1 and 2: the control unit samples, agents answer, observers record.

Resources meet in the derivatives of coupled costs and nowhere else.  So where costs are separable the steps
of a whole run are taken resource by resource; else all resources take each step together.
"""

from typing import NamedTuple

from aimd_des.dynamics.demand import DISCRETE, demand_at
from aimd_des.dynamics.state import AgentParameters, State
from aimd_des.problem.costs import Costs, CostTable
from aimd_des.problem.costs.kernels import gradient_row
from aimd_des.problem.costs.table import no_table
from aimd_des.results.metrics import fold_total
from aimd_des.synchronous.answers import (
    AHEAD,
    StepBuffers,
    add_ahead,
    answer_row,
    average_row,
    draw_and_add,
)
from aimd_des.utils.jit import formula, kernel, routine
from aimd_des.utils.records import record
from aimd_des.utils.rng import Key, draw_words
from aimd_des.utils.validation import BoolArray, FloatArray, IntArray


@record
class StepControl(NamedTuple):
    """The control unit: what it has broadcast, and measures.

    All arrays have shape (m,) but `broadcast`, (K, m): whether step k broadcast for resource j, and `middle`,
    (1,), the middle of the run, at which `used` is kept as `half`.
    """

    signal: BoolArray  # S(k + 1), as the look at k has left it
    answered: (
        IntArray  # how many broadcasts have been answered: the number of the next, the address of its draws
    )
    broadcast: BoolArray
    peak: FloatArray
    above: FloatArray
    excess: FloatArray
    used: FloatArray
    middle: FloatArray
    half: FloatArray


@record
class RecordBuffers(NamedTuple):
    """Buffers of the observers; `cursor`, (m, 3): records of either kind that are done, the next step."""

    demand_steps: FloatArray
    total_demand: FloatArray
    total_average: FloatArray
    allocation_steps: FloatArray
    demand: FloatArray
    average: FloatArray
    cursor: IntArray


@formula
def _measure(
    parameters: AgentParameters, resource: int, step: int, total: float, control: StepControl
) -> None:
    """Fold the total of one step into peak, time above capacity and mean excess."""
    j = resource
    # How much of this step lies before the middle of the run, which is within a step if their number is odd.
    # Before `used` is moved on, since `half` is what it is there.
    first_half = control.middle[0] - (step - 1.0)
    if 0.0 < first_half <= 1.0:
        control.half[j] = control.used[j] + total * first_half
    running = (control.peak, control.above, control.excess, control.used)
    fold_total(j, total, parameters.capacity, 1.0, *running)


@routine
def _record_step(
    state: State,
    parameters: AgentParameters,
    resource: int,
    step: int,
    total: float,
    records: RecordBuffers,
    buffers: StepBuffers,
) -> None:
    """Keep total and allocations of x(k), k being the next step that is asked for."""
    # Totals and allocations are asked for at different steps; the third of the cursor is the earlier of
    # the next of either.
    j, n = resource, records.demand.shape[2]
    cursor, average = records.cursor[j], buffers.average[j]
    row, page = cursor[0], cursor[1]
    average_row(state, parameters, j, step, buffers)
    if records.demand_steps[row] == step:
        # In the order of agents, as at every other look: so asynchronous runs come to the same bits.
        used = 0.0
        for i in range(n):
            used += average[i]
        records.total_demand[row, j] = total
        records.total_average[row, j] = used
        cursor[0] += 1
    if records.allocation_steps[page] == step:
        since = step - state.anchor[j, 0]
        for i in range(n):
            held, increase = state.demand[j, i], parameters.increase[j, i]
            records.demand[page, j, i] = demand_at(held, increase, since, DISCRETE)
            records.average[page, j, i] = average[i]
        cursor[1] += 1
    # Both end with the end of the run, so neither runs out before the other.
    if cursor[0] < records.demand_steps.shape[0]:
        cursor[2] = min(records.demand_steps[cursor[0]], records.allocation_steps[cursor[1]])


@formula
def _watch(
    state: State,
    parameters: AgentParameters,
    resource: int,
    step: int,
    total: float,
    control: StepControl,
    records: RecordBuffers,
    buffers: StepBuffers,
) -> None:
    """Measure and record the total of x(k)."""
    if step > 0:  # demand is x(k) over (k-1, k], the interval that this look closes
        _measure(parameters, resource, step, total, control)
    if step == records.cursor[resource, 2]:
        _record_step(state, parameters, resource, step, total, records, buffers)


@formula
def _look(
    state: State,
    parameters: AgentParameters,
    resource: int,
    step: int,
    total: float,
    lag: int,
    control: StepControl,
    records: RecordBuffers,
    buffers: StepBuffers,
) -> bool:
    """Let the control unit look at x(k): Algorithm 1.  Tells whether agents must act on a signal at k."""
    j = resource
    _watch(state, parameters, j, step, total, control, records, buffers)
    due = total > parameters.limit[j]
    # Without a lag S(k) is what this look finds; else it is what the look before has left.
    acting = due if lag == 0 else control.signal[j]
    control.signal[j] = due
    control.broadcast[step, j] = due
    return bool(acting)


@formula
def _answer(
    state: State,
    parameters: AgentParameters,
    table: CostTable,
    resource: int,
    step: int,
    control: StepControl,
    buffers: StepBuffers,
) -> None:
    """Let all agents answer a broadcast for resource j; averages and draws are in `buffers`."""
    # Else the derivatives are in `buffers`, too.
    if table.slopes.shape[2] > 0:
        gradient_row(table, buffers.average, resource, buffers.gradient[resource], buffers.spare)
    answer_row(state, parameters, resource, step, buffers)
    control.answered[resource] += 1


@formula
def _take_alone(
    state: State,
    parameters: AgentParameters,
    table: CostTable,
    resource: int,
    first: int,
    steps: int,
    lag: int,
    key: Key,
    control: StepControl,
    records: RecordBuffers,
    buffers: StepBuffers,
) -> None:
    """Take steps of one resource, whose derivatives do not depend on the others."""
    j, step, drawn = resource, first, False
    while step < steps:
        # Until an agent answers all demands are lines.  The draws of the next answer are needed in any case.
        if drawn:
            add_ahead(state, parameters, j, step, buffers)
        else:
            draw_and_add(state, parameters, j, step, key, control.answered[j], buffers)
        drawn = True
        for ahead in range(min(AHEAD, steps - step)):
            total = buffers.totals[ahead]
            if _look(state, parameters, j, step + ahead, total, lag, control, records, buffers):
                average_row(state, parameters, j, step + ahead, buffers)
                _answer(state, parameters, table, j, step + ahead, control, buffers)
                step, drawn = step + ahead + 1, False
                break
        if drawn:
            step += AHEAD


@kernel
def look_together(
    state: State,
    parameters: AgentParameters,
    step: int,
    lag: int,
    control: StepControl,
    records: RecordBuffers,
    buffers: StepBuffers,
) -> bool:
    """Let the control unit sample all resources; if an agent must act bring all averages to this step."""
    anybody = False
    for j in range(state.demand.shape[0]):
        add_ahead(state, parameters, j, step, buffers)
        total = buffers.totals[0]
        buffers.acting[j] = _look(state, parameters, j, step, total, lag, control, records, buffers)
        anybody = anybody or buffers.acting[j]
    # Averages must be taken before any agent answers: derivatives may read all of them.
    if anybody:
        for j in range(state.demand.shape[0]):
            average_row(state, parameters, j, step, buffers)
    return anybody


@kernel
def answer_together(
    state: State,
    parameters: AgentParameters,
    table: CostTable,
    step: int,
    key: Key,
    control: StepControl,
    buffers: StepBuffers,
) -> None:
    """Let all agents answer the signals that act at this step."""
    for j in range(state.demand.shape[0]):
        if buffers.acting[j]:
            # The draws that an asynchronous run takes for the same broadcast, after any past.
            draw_words(key, j, control.answered[j], 0, buffers.draws)
            _answer(state, parameters, table, j, step, control, buffers)


@kernel
def close_books(
    state: State,
    parameters: AgentParameters,
    steps: int,
    control: StepControl,
    records: RecordBuffers,
    buffers: StepBuffers,
) -> None:
    """Measure and watch x(K), to which the last step has led."""
    # No look of the control unit: K steps have K looks, at x(0) to x(K - 1).
    for j in range(state.demand.shape[0]):
        add_ahead(state, parameters, j, steps, buffers)
        _watch(state, parameters, j, steps, buffers.totals[0], control, records, buffers)


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
    if table.weights.shape[0] == 0:
        for j in range(state.demand.shape[0]):
            _take_alone(state, parameters, table, j, first, steps, lag, key, control, records, buffers)
    else:
        for step in range(first, steps):
            if look_together(state, parameters, step, lag, control, records, buffers):
                answer_together(state, parameters, table, step, key, control, buffers)
    if steps == control.broadcast.shape[0]:
        close_books(state, parameters, steps, control, records, buffers)


def take_custom_steps(
    costs: Costs,
    state: State,
    parameters: AgentParameters,
    first: int,
    steps: int,
    lag: int,
    key: Key,
    control: StepControl,
    records: RecordBuffers,
    buffers: StepBuffers,
) -> None:
    """Take some steps with derivatives from the gradient of the costs, which kernels cannot call."""
    none, n = no_table(), records.demand.shape[2]
    for step in range(first, steps):
        if look_together(state, parameters, step, lag, control, records, buffers):
            # One call for all agents and resources: a function of Python costs more than what it computes.
            buffers.gradient[:, :n] = costs.gradient(buffers.average[:, :n].T).T
            answer_together(state, parameters, none, step, key, control, buffers)
    if steps == control.broadcast.shape[0]:
        close_books(state, parameters, steps, control, records, buffers)
