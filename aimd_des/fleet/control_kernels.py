"""The samples of a control unit between two events of SimPy, as the processes would take them."""

import numpy as np

from aimd_des.dynamics.clocks import next_ticks
from aimd_des.dynamics.totals import observe_totals, total_of
from aimd_des.engine.control_unit.base import NEVER
from aimd_des.engine.control_unit.crossing import MOST_AT_ONE_INSTANT, adapted, soonest_crossing
from aimd_des.engine.control_unit.sampled import signal_probability, signals
from aimd_des.engine.environment import EventKind
from aimd_des.fleet.arrays import LAST, FleetAgents
from aimd_des.fleet.broadcast_kernel import FleetChannel, broadcast
from aimd_des.fleet.control_state import (
    BROADCAST,
    IMPROPER,
    LOOK,
    NO_ROOM,
    REACHED,
    REFUSED,
    ROW,
    STANDSTILL,
    TICK,
    UNSCHEDULED,
    FleetControl,
    Limits,
)
from aimd_des.fleet.control_table import call_probability
from aimd_des.fleet.observer_kernels import FleetOvershoot, ObservedTotals
from aimd_des.fleet.response_kernels import settle, settle_and_take
from aimd_des.fleet.row_queue import is_full
from aimd_des.results.metrics import fold_overshoot
from aimd_des.utils.jit import announced, formula
from aimd_des.utils.validation import FloatArray

# Plain numbers, as kernels take them.
_SENSE, _OBSERVE = int(EventKind.SENSE), int(EventKind.OBSERVE)


@formula
def _within(time: float, kind: int, turn: int, limits: Limits) -> bool:
    """Tell whether something comes before what is due next besides."""
    # The order of the environment's queue, written out for kernels.
    if time != limits.horizon:
        return time < limits.horizon
    return kind < limits.kind or (kind == limits.kind and turn < limits.order)


@formula
def _crowded(
    agents: FleetAgents, control: FleetControl, channel: FleetChannel, now: float, limit: int
) -> bool:
    """Tell whether there may be too little space for what a look can bring."""
    # Asked before a look, while nothing has been done that would have to be taken back.
    if agents.answers.held[0] > control.answers:
        return True
    full = False
    for j in range(control.due.shape[0]):
        full |= is_full(agents.rows, j, now, limit)
    m, n = control.due.shape[0], channel.arrival.shape[0]
    # The worst case: no look can send more.  A crossing unit looks at one resource at a time.
    signals = 1 if control.crossing else m
    copies = signals * n * (2 if channel.table.duplicates else 1)
    full |= channel.held[0] + signals > channel.time.shape[0]
    full |= agents.copies.in_flight[0] + copies > agents.room
    # What SimPy's side sends finds room there.
    return channel.compiled and full


@formula
def _find_moments(agents: FleetAgents, control: FleetControl) -> None:
    """Find where the agents are in their own time: the time, or their next tick; samples precede ticks."""
    now = control.now[0]
    if agents.tick_weight > 0.0:
        clocks = agents.clocks
        next_ticks(clocks.phase, clocks.period, clocks.jitter, clocks.key, now, control.moment)
    else:
        control.moment[0] = now


@formula
def _total(agents: FleetAgents, control: FleetControl, resource: int) -> float:
    # Added up anew at every look, in the order of agents.  A total carried along from answer to answer would
    # depend on the order in which they were computed, in its last bits, and so on the times of looks.
    state, increase = agents.state, agents.parameters.increase[resource]
    return total_of(
        state.demand[resource], increase, state.anchor[resource], control.moment, agents.tick_weight
    )


@formula
def _measure(control: FleetControl, integrals: FleetOvershoot, now: float) -> None:
    """Close the interval of constant demand that ends with the tick at hand."""
    # Totals are those before the tick: observers look before agents act.
    duration = now - integrals.measured[0]
    integrals.tick[0] += 1
    control.turns[TICK] = UNSCHEDULED
    # A change of a demand from outside at this instant has closed the interval already.
    if duration > 0.0:
        running = (integrals.peak, integrals.above, integrals.excess, integrals.used)
        fold_overshoot(control.total, integrals.capacity, duration, *running)
        integrals.measured[0] = now


@formula
def _next_tick(agents: FleetAgents, integrals: FleetOvershoot) -> float:
    """Return the next tick of a common clock that closes an interval."""
    return agents.clocks.phase[0] + integrals.tick[0] * agents.clocks.period[0] if integrals.steps else np.inf


@formula
def _next_row(observed: ObservedTotals) -> float:
    """Return when totals are kept next."""
    row = observed.row[0]
    return observed.times[row] if row < observed.times.shape[0] else np.inf


@formula
def _keep(agents: FleetAgents, control: FleetControl, observed: ObservedTotals) -> None:
    """Keep the totals of demand and of averages."""
    row = observed.row[0]
    observed.taken[:] = row + 1
    observe_totals(
        agents.state,
        agents.parameters,
        control.moment,
        agents.tick_weight,
        observed.values,
        observed.demand[row],
        observed.average[row],
    )
    observed.row[0] += 1
    control.turns[ROW] = UNSCHEDULED


@formula
def _may_wait(agents: FleetAgents) -> bool:
    """Tell whether totals may wait for a pass over the agents: of continuous ones that answer rows."""
    return bool(agents.rows.enabled and agents.tick_weight == 0.0)


@formula
def _let_wait(control: FleetControl, observed: ObservedTotals) -> None:
    """Leave the totals of an instant to the next pass over the agents, which may be later."""
    observed.row[0] += 1
    control.turns[ROW] = UNSCHEDULED


@formula
def _take_all(agents: FleetAgents, integrals: FleetOvershoot, observed: ObservedTotals) -> None:
    """Take the totals that wait: an event may change what they are of."""
    row = observed.row[0]
    for j in range(observed.taken.shape[0]):
        # Not of others, which may have been settled up to later.
        if observed.taken[j] < row:
            settle_and_take(agents, integrals, observed, j, j + 1, observed.times[row - 1], LAST)


@formula
def _sends(control: FleetControl, channel: FleetChannel, limits: Limits) -> bool:
    """Tell whether compiled code may send: what leaves later may be cut, which is known then."""
    # Until the next event of SimPy nothing can cut it.  What leaves in this very look is cut by what is so
    # now, even if an event at this instant comes after the look.
    departure = control.now[0] + control.delay
    return channel.compiled and (departure < limits.change or departure == control.now[0])


@formula
def _probability(agents: FleetAgents, control: FleetControl, resource: int, look: int) -> float:
    total, limit = control.total[resource], agents.parameters.limit[resource]
    if control.probability != 0:
        given = (total, limit, control.now[0], look, resource)
        return float(call_probability(control.probability, given))
    return signal_probability(control.low, control.high, total, limit)


@formula
def _signal(
    agents: FleetAgents, control: FleetControl, channel: FleetChannel, limits: Limits, look: int
) -> int:
    """Broadcast for each resource for which the look signals."""
    # All resources are decided on before anything is sent: a signal without latency must not change what the
    # same look finds for the next resource.
    due, control.due[:] = False, False
    for j in range(0 if control.failed[0] else control.due.shape[0]):
        probability = _probability(agents, control, j, look)
        if not 0.0 <= probability <= 1.0:
            control.due[:], control.due[j] = False, True
            return IMPROPER
        control.due[j] = signals(probability, control.key, j, look)
        due = due or control.due[j]
    if due and not _sends(control, channel, limits):
        return BROADCAST
    now, delay = control.now[0], control.delay
    for j in range(control.due.shape[0]):
        if control.due[j] and not broadcast(agents, channel, j, now, delay, limits.acted_at, limits.acted):
            return REFUSED
    return REACHED


@announced("the fleet (some ten seconds)")
def sample(
    agents: FleetAgents,
    control: FleetControl,
    channel: FleetChannel,
    integrals: FleetOvershoot,
    observed: ObservedTotals,
    limits: Limits,
) -> int:
    """Look at phase + q * period, and let observers look, until something else is due."""
    # Which instant agents have been brought to, and of which the totals are at hand: looks of several kinds
    # at one instant share both.
    reached = summed = NEVER
    # At one instant copies land before a look and ticks come after it: of continuous agents all that is due
    # then has been answered, of discrete ones nothing.
    limit = 0 if agents.tick_weight > 0.0 else LAST
    observed.taken[:] = observed.row[0]
    status = REACHED
    for _ in range(limits.steps):
        look = control.phase + control.look[0] * control.period
        tick, row, turns = _next_tick(agents, integrals), _next_row(observed), control.turns
        keeping = row < tick or (row == tick and turns[ROW] < turns[TICK])
        observation = row if keeping else tick
        # The control unit looks before observers do.
        now, looking = min(look, observation), look <= observation
        turn = turns[LOOK] if looking else turns[ROW if keeping else TICK]
        if not _within(now, _SENSE if looking else _OBSERVE, turn, limits):
            break
        if looking and _crowded(agents, control, channel, now, limit):
            status = NO_ROOM
            break
        if not looking and keeping and _may_wait(agents):
            _let_wait(control, observed)
            continue
        if now != reached:
            control.now[0] = reached = now
            settle_and_take(agents, integrals, observed, 0, agents.copies.base.shape[0], now, limit)
            _find_moments(agents, control)
        if not looking and keeping:
            _keep(agents, control, observed)
            continue
        if now != summed:
            summed = now
            for j in range(control.total.shape[0]):
                control.total[j] = _total(agents, control, j)
        if not looking:
            _measure(control, integrals, now)
            continue
        # Counted before signals are sent: code that sends them in its place does not come back to this look.
        control.look[0] += 1
        control.turns[LOOK] = UNSCHEDULED
        status = _signal(agents, control, channel, limits, control.look[0] - 1)
        if status != REACHED:
            break
        # Continuous agents answer signals without latency before observers look at the same instant.
        if agents.tick_weight == 0.0:
            reached = summed = NEVER
    _take_all(agents, integrals, observed)
    return status


@formula
def _next_alarm(look_time: FloatArray) -> int:
    """Return whose alarm is first."""
    first = 0
    for j in range(1, look_time.shape[0]):
        if look_time[j] < look_time[first]:
            first = j
    return first


@formula
def _hold_off(control: FleetControl, resource: int, now: float, total: float) -> None:
    """Set the alarm to the end of the hold-off after a signal."""
    j = resource
    # Only where a hold-off has ended with demand still at the threshold does it adapt: a crossing that comes
    # later says nothing about latency.
    if control.holding[j]:
        expected = control.unanswered[j] + control.growth[j] * (now - control.since[j])
        control.hold_off[j] = adapted(control.hold_off[j], control.shortest, control.longest, expected, total)
    control.instant[j], control.since[j], control.unanswered[j], control.holding[j] = now, now, total, True
    control.look_time[j] = now + control.hold_off[j]


@formula
def _let_wait_or_keep(
    agents: FleetAgents,
    control: FleetControl,
    integrals: FleetOvershoot,
    observed: ObservedTotals,
    time: float,
) -> None:
    """Leave a row of totals to the next look, or keep it where agents may be in no rows."""
    if _may_wait(agents):
        _let_wait(control, observed)
    else:
        control.now[0] = time
        settle_and_take(agents, integrals, observed, 0, agents.copies.base.shape[0], time, LAST)
        _find_moments(agents, control)
        _keep(agents, control, observed)


@formula
def _settle(
    agents: FleetAgents, integrals: FleetOvershoot, observed: ObservedTotals, queue: int, time: float
) -> None:
    """Settle a queue; at once where no totals wait for it, which is the usual case."""
    if observed.taken[queue] < observed.row[0]:
        settle_and_take(agents, integrals, observed, queue, queue + 1, time, LAST)
    else:
        settle(agents, integrals, queue, queue + 1, time, LAST)


@announced("the fleet (some ten seconds)")
def sense(
    agents: FleetAgents,
    control: FleetControl,
    channel: FleetChannel,
    integrals: FleetOvershoot,
    observed: ObservedTotals,
    limits: Limits,
) -> int:
    """Go from one possible crossing to the next, and let observers look, until something else is due."""
    look_time, status = control.look_time, REACHED
    observed.taken[:] = observed.row[0]
    for _ in range(limits.steps):
        # Of alarms at one instant the first is that of the lowest index, which is their order as events.
        j = _next_alarm(look_time)
        now, row = look_time[j], _next_row(observed)
        # Strictly: at one instant the control unit looks before observers do.
        if row < now:
            if not _within(row, _OBSERVE, control.turns[ROW], limits):
                break
            _let_wait_or_keep(agents, control, integrals, observed, row)
            continue
        if not _within(now, _SENSE, j, limits):
            break
        if _crowded(agents, control, channel, now, LAST):
            status = NO_ROOM
            break
        control.now[0] = now
        # Others' copies stay where they are: this look reads the total of one resource, and no answer for
        # another one changes it.
        queue = 0 if agents.coupled else j
        _settle(agents, integrals, observed, queue, now)
        _find_moments(agents, control)
        total = _total(agents, control, j)
        # No alarm misses a crossing: responses only lower the total, and `growth` is what all grow by.  What
        # changes from outside sets the alarm anew.
        soonest = soonest_crossing(now, agents.parameters.limit[j], total, control.growth[j])
        control.awaits_crossing[j] = soonest > now or control.failed[0]
        if control.awaits_crossing[j]:
            control.holding[j] = False
            # A unit that is down would look again at this instant for ever; its replacement sets the alarm.
            look_time[j] = soonest if soonest > now else np.inf
            continue
        control.repeated[j] = control.repeated[j] + 1 if now == control.instant[j] else 1
        control.due[:] = False
        control.due[j] = True
        if control.repeated[j] > MOST_AT_ONE_INSTANT:
            status = STANDSTILL
            break
        # Before anything is sent, so that the look is done with every way of sending.
        _hold_off(control, j, now, total)
        if not _sends(control, channel, limits):
            status = BROADCAST
            break
        if not broadcast(agents, channel, j, now, control.delay, limits.acted_at, limits.acted):
            status = REFUSED
            break
    _take_all(agents, integrals, observed)
    return status
