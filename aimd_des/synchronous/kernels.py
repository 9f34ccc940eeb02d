"""The compiled steps of Algorithms 1 and 2: the control unit looks, agents answer, observers watch."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.dynamics.response import DISCRETE, answer_row, average_row
from aimd_des.dynamics.state import Law, State
from aimd_des.dynamics.totals import observe, totals
from aimd_des.problem.costs import Costs
from aimd_des.problem.costs.kernels import CostTable, gradient_row
from aimd_des.results.metrics import fold_overshoot
from aimd_des.utils.jit import kernel
from aimd_des.utils.rng import Key, uniforms_row
from aimd_des.utils.validation import FloatArray

__all__ = ["Control", "Scratch", "Watch", "close_books", "take_custom_steps", "take_steps"]

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


class Control(NamedTuple):
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


class Scratch(NamedTuple):
    """Working memory, so that nothing is allocated per step."""

    folded: FloatArray
    average: FloatArray
    gradient: FloatArray
    uniform: FloatArray
    spare: FloatArray


class Watch(NamedTuple):
    """Buffers of the observers; `cursor` has the looks of either kind that are done, and the next step."""

    demand_steps: FloatArray
    total_demand: FloatArray
    total_average: FloatArray
    allocation_steps: FloatArray
    demand: FloatArray
    average: FloatArray
    cursor: IntArray


@kernel
def _measure(law: Law, control: Control) -> None:
    """Fold the totals of one step into peak, time above capacity and mean excess."""
    # How much of this step lies before the middle of the run, which is within a step if their number is odd.
    # Before `used` is moved on, since `half` is what it is there.
    first_half = control.middle[0] - (control.moment[0] - 1.0)
    if 0.0 < first_half <= 1.0:
        for j in range(control.total.shape[0]):
            control.half[j] = control.used[j] + control.total[j] * first_half
    running = (control.peak, control.above, control.excess, control.used)
    fold_overshoot(control.total, law.capacity, 1.0, *running)


@kernel
def _watch_step(state: State, law: Law, watch: Watch, control: Control) -> None:
    """Keep totals and allocations of x(k), k being the next step that is asked for."""
    # Totals and allocations are asked for at different steps; `step` is the earlier of the next of either,
    # and what is read of all agents then serves both.
    row, page, step = watch.cursor[0], watch.cursor[1], watch.cursor[2]
    demand, average = watch.demand[page], watch.average[page]
    observe(state, law, control.moment, DISCRETE, demand, average)
    if watch.demand_steps[row] == step:
        for j in range(control.total.shape[0]):
            # In the order of agents, as at every other look: so asynchronous runs come to the same bits.
            used = 0.0
            for i in range(average.shape[1]):
                used += average[j, i]
            watch.total_demand[row, j] = control.total[j]
            watch.total_average[row, j] = used
        watch.cursor[0] += 1
    # Otherwise the page is written again at a step that is asked for.
    if watch.allocation_steps[page] == step:
        watch.cursor[1] += 1
    # Both end with the end of the run, so neither runs out before the other.
    if watch.cursor[0] < watch.demand_steps.shape[0]:
        watch.cursor[2] = min(watch.demand_steps[watch.cursor[0]], watch.allocation_steps[watch.cursor[1]])


@kernel
def _look(state: State, law: Law, step: int, lag: int, control: Control, watch: Watch) -> bool:
    """Let the control unit look at x(k): Algorithm 1.  Tells whether agents must act on a signal at k."""
    control.moment[0] = step
    # Added up anew and never carried along, so that no step inherits the rounding of those before it.
    totals(state, law, control.moment, DISCRETE, control.total)
    if step > 0:  # demand is x(k) over (k-1, k], the interval that this look closes
        _measure(law, control)
    if step == watch.cursor[2]:
        _watch_step(state, law, watch, control)
    acting = False
    for j in range(law.limit.shape[0]):
        due = control.total[j] > law.limit[j]
        control.broadcast[step, j] = due
        # Without a lag S(k) is what this look finds; else it is what the look before has left in `signal`.
        if lag == 0:
            control.signal[j] = due
            control.sent[j] += due
        acting = acting or control.signal[j]
    return acting


@kernel
def _conclude(law: Law, step: int, lag: int, control: Control) -> None:
    """Put S(k+1) in force."""
    # After the agents of step k, who act on S(k).  `sent` counts what is in force: it is one more than the
    # number of the broadcast that is answered, the address of its draws.
    if lag == 1:
        for j in range(law.limit.shape[0]):
            control.signal[j] = control.broadcast[step, j]
            control.sent[j] += control.signal[j]


@kernel
def _average(state: State, law: Law, step: int, resource: int, scratch: Scratch) -> None:
    """Bring the averages of one resource to step k."""
    # Only where somebody may answer: between signals demand is a line, and averages are read off it.
    folded, average = scratch.folded[resource], scratch.average[resource]
    average_row(state, law, resource, float(step), DISCRETE, folded, average)


@kernel
def _average_all(state: State, law: Law, step: int, scratch: Scratch) -> None:
    """Bring the averages of all resources to step k."""
    for j in range(state.demand.shape[0]):
        _average(state, law, step, j, scratch)


@kernel
def _answer_signal(
    state: State, law: Law, step: int, resource: int, number: int, key: Key, scratch: Scratch
) -> None:
    """Let all agents answer broadcast b for resource j; averages and derivatives are in `scratch`."""
    # The draws that an asynchronous run takes for the same broadcast, whatever happened before it.
    uniforms_row(key, resource, number, 0, scratch.uniform)
    answer_row(
        state,
        law,
        resource,
        scratch.folded[resource],
        scratch.average[resource],
        scratch.gradient[resource],
        scratch.uniform,
        float(step),
        DISCRETE,
    )


@kernel
def take_steps(
    state: State,
    law: Law,
    table: CostTable,
    first: int,
    steps: int,
    lag: int,
    key: Key,
    control: Control,
    watch: Watch,
    scratch: Scratch,
) -> None:
    """Take some steps, one after the other, in compiled code."""
    # From `first` on until `steps` have been taken in all, since a run is taken in parts.
    coupled = table.weights.shape[0] > 0
    for step in range(first, steps):
        if _look(state, law, step, lag, control, watch):
            # Averages must be taken before anybody answers: coupled costs read all of them.
            if coupled:
                _average_all(state, law, step, scratch)
            for j in range(law.limit.shape[0]):
                if control.signal[j]:
                    if not coupled:
                        _average(state, law, step, j, scratch)
                    gradient_row(table, scratch.average, j, scratch.gradient[j], scratch.spare)
                    _answer_signal(state, law, step, j, control.sent[j] - 1, key, scratch)
        _conclude(law, step, lag, control)


def take_custom_steps(
    costs: Costs,
    state: State,
    law: Law,
    steps: int,
    lag: int,
    key: Key,
    control: Control,
    watch: Watch,
    scratch: Scratch,
) -> None:
    """Take all steps with derivatives from the user's own functions, which kernels cannot call."""
    for step in range(steps):
        if _look(state, law, step, lag, control, watch):
            _average_all(state, law, step, scratch)
            # One call for all agents and resources: a function of Python costs more than what it computes.
            scratch.gradient[:] = costs.gradient(scratch.average.T).T
            for j in np.flatnonzero(control.signal):
                _answer_signal(state, law, step, int(j), int(control.sent[j]) - 1, key, scratch)
        _conclude(law, step, lag, control)


def close_books(state: State, law: Law, steps: int, control: Control, watch: Watch) -> None:
    """Measure and watch x(K), to which the last step has led."""
    # No look of the control unit: K steps have K looks, at x(0) to x(K - 1).
    control.moment[0] = steps
    totals(state, law, control.moment, DISCRETE, control.total)
    _measure(law, control)
    _watch_step(state, law, watch, control)
