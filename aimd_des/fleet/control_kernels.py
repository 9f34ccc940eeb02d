"""The looks of a control unit between two events of SimPy, as the processes would take them."""

import numpy as np

from aimd_des.dynamics.clocks import next_ticks
from aimd_des.dynamics.totals import observe_totals, total_of
from aimd_des.engine.control_unit import MOST_AT_ONE_INSTANT, NEVER, adapted, soonest_crossing
from aimd_des.engine.environment import Kind
from aimd_des.fleet.arrays import LAST, Crowd
from aimd_des.fleet.broadcast_kernel import Post, broadcast
from aimd_des.fleet.control_state import (
    BROADCAST,
    CROWDED,
    LOOK,
    REACHED,
    REFUSED,
    ROW,
    STANDSTILL,
    TICK,
    UNSCHEDULED,
    Limits,
    Pilot,
)
from aimd_des.fleet.observer_kernels import Meter, Watch, fold_answers
from aimd_des.fleet.response_kernels import settle
from aimd_des.results.metrics import fold_overshoot
from aimd_des.utils.jit import announced, formula, routine

__all__ = ["sample", "sense", "settle_and_fold"]

# Plain numbers, as kernels take them.
_SENSE, _OBSERVE = int(Kind.SENSE), int(Kind.OBSERVE)


@formula
def _within(time: float, kind: int, turn: int, limits: Limits) -> bool:
    """Tell whether something comes before what is due next besides."""
    # The order of the environment's queue, written out for kernels.
    if time != limits.horizon:
        return time < limits.horizon
    return kind < limits.kind or (kind == limits.kind and turn < limits.order)


@formula
def _crowded(crowd: Crowd, pilot: Pilot, post: Post) -> bool:
    """Tell whether there may be too little space for what a look can bring."""
    # Asked before a look, while nothing has been done that would have to be taken back.
    if crowd.answers.held[0] > pilot.answers:
        return True
    m, n = pilot.due.shape[0], post.arrival.shape[0]
    # The worst case: no look can send more.  A crossing unit looks at one resource at a time.
    signals = 1 if pilot.crossing else m
    copies = signals * n * (2 if post.channel.duplicates else 1)
    full = post.held[0] + signals > post.time.shape[0] or crowd.flights.aloft[0] + copies > crowd.room
    # What SimPy's side sends finds room there.
    return post.compiled and full


@formula
def _find_moments(crowd: Crowd, pilot: Pilot) -> None:
    """Find where the agents are in their own time: the time, or their next tick; looks come before ticks."""
    now = pilot.now[0]
    if crowd.grain > 0.0:
        rhythm = crowd.rhythm
        next_ticks(rhythm.phase, rhythm.period, rhythm.jitter, rhythm.key, now, pilot.moment)
    else:
        pilot.moment[0] = now


@formula
def _total(crowd: Crowd, pilot: Pilot, resource: int) -> float:
    # Added up anew at every look, in the order of agents.  A total carried along from answer to answer would
    # depend on the order in which they were computed, in its last bits, and so on when somebody looked.
    state, increase = crowd.state, crowd.law.increase[resource]
    return total_of(state.demand[resource], increase, state.anchor[resource], pilot.moment, crowd.grain)


@formula
def _find_totals(crowd: Crowd, pilot: Pilot, meter: Meter) -> None:
    """Bring all agents to the time of the look, and add up their demand."""
    now = pilot.now[0]
    # At one instant copies land before a look and ticks come after it: of continuous agents all that is due
    # now has been answered, of discrete ones nothing.
    settle(crowd, 0, crowd.flights.base.shape[0], now, 0 if crowd.grain > 0.0 else LAST)
    # Answers may be folded in now: all that are earlier have been computed.
    if meter.lines and crowd.answers.held[0] > 0:
        fold_answers(crowd.answers, meter)
    _find_moments(crowd, pilot)
    for j in range(pilot.total.shape[0]):
        pilot.total[j] = _total(crowd, pilot, j)


@formula
def _measure(pilot: Pilot, meter: Meter, now: float) -> None:
    """Close the interval of constant demand that ends with the tick at hand."""
    # Totals are those before the tick: observers look before agents act.
    duration = now - meter.measured[0]
    meter.tick[0] += 1
    pilot.turns[TICK] = UNSCHEDULED
    # Whoever has changed a demand from outside at this instant has closed the interval already.
    if duration > 0.0:
        running = (meter.peak, meter.above, meter.excess, meter.used)
        fold_overshoot(pilot.total, meter.capacity, duration, *running)
        meter.measured[0] = now


@formula
def _next_tick(crowd: Crowd, meter: Meter) -> float:
    """Return the next tick of a common clock that closes an interval."""
    return crowd.rhythm.phase[0] + meter.tick[0] * crowd.rhythm.period[0] if meter.steps else np.inf


@formula
def _next_row(watch: Watch) -> float:
    """Return when totals are kept next."""
    row = watch.row[0]
    return watch.times[row] if row < watch.times.shape[0] else np.inf


@formula
def _keep(crowd: Crowd, pilot: Pilot, watch: Watch) -> None:
    """Keep the totals of demand and of averages."""
    row = watch.row[0]
    observe_totals(crowd.state, crowd.law, pilot.moment, crowd.grain, watch.demand[row], watch.average[row])
    watch.row[0] += 1
    pilot.turns[ROW] = UNSCHEDULED


@formula
def _sends(pilot: Pilot, post: Post, limits: Limits) -> bool:
    """Tell whether compiled code may send: what leaves later may be cut, which is known then."""
    # Until the next event of SimPy nobody can cut it.  What leaves in this very look is cut by what is so
    # now, even if an event at this instant comes after the look.
    departure = pilot.now[0] + pilot.delay
    return post.compiled and (departure < limits.change or departure == pilot.now[0])


@formula
def _signal(crowd: Crowd, pilot: Pilot, post: Post, limits: Limits) -> int:
    """Broadcast for each resource whose total demand is above its threshold."""
    # All resources are decided on before anything is sent: a signal without latency must not change what the
    # same look finds for the next resource.
    due, up = False, not pilot.failed[0]
    for j in range(pilot.due.shape[0]):
        pilot.due[j] = up and pilot.total[j] > crowd.law.limit[j]
        due = due or pilot.due[j]
    if due and not _sends(pilot, post, limits):
        return BROADCAST
    now, delay = pilot.now[0], pilot.delay
    for j in range(pilot.due.shape[0]):
        if pilot.due[j] and not broadcast(crowd, post, j, now, delay, limits.acted_at, limits.acted):
            return REFUSED
    return REACHED


@announced("the fleet (about a minute)")
def sample(crowd: Crowd, pilot: Pilot, post: Post, meter: Meter, watch: Watch, limits: Limits) -> int:
    """Look at phase + q * period, and let observers look, until something else is due."""
    # For which instant the totals are those at hand: looks of several kinds at one instant share them.
    summed = NEVER
    while True:
        look = pilot.phase + pilot.look[0] * pilot.period
        tick, row, turns = _next_tick(crowd, meter), _next_row(watch), pilot.turns
        keeping = row < tick or (row == tick and turns[ROW] < turns[TICK])
        observed = row if keeping else tick
        # The control unit looks before observers do.
        now, looking = min(look, observed), look <= observed
        turn = turns[LOOK] if looking else turns[ROW if keeping else TICK]
        if not _within(now, _SENSE if looking else _OBSERVE, turn, limits):
            return REACHED
        if looking and _crowded(crowd, pilot, post):
            return CROWDED
        if now != summed:
            pilot.now[0] = summed = now
            _find_totals(crowd, pilot, meter)
        if not looking:
            if keeping:
                _keep(crowd, pilot, watch)
            else:
                _measure(pilot, meter, now)
            continue
        # Counted before signals are sent: whoever sends them in its place does not come back to this look.
        pilot.look[0] += 1
        pilot.turns[LOOK] = UNSCHEDULED
        status = _signal(crowd, pilot, post, limits)
        if status != REACHED:
            return status
        # Continuous agents answer signals without latency before observers look at the same instant.
        if crowd.grain == 0.0:
            summed = NEVER


@formula
def _hold_off(pilot: Pilot, resource: int, now: float, total: float) -> None:
    """Set the alarm to the end of the hold-off after a signal."""
    j = resource
    # Only where a hold-off has ended with demand still at the threshold does it adapt: a crossing that comes
    # later says nothing about latency.
    if pilot.holding[j]:
        expected = pilot.unanswered[j] + pilot.growth[j] * (now - pilot.since[j])
        pilot.hold_off[j] = adapted(pilot.hold_off[j], pilot.shortest, pilot.longest, expected, total)
    pilot.instant[j], pilot.since[j], pilot.unanswered[j], pilot.holding[j] = now, now, total, True
    pilot.alarm[j] = now + pilot.hold_off[j]


@announced("the fleet (about a minute)")
def sense(crowd: Crowd, pilot: Pilot, post: Post, meter: Meter, watch: Watch, limits: Limits) -> int:
    """Go from one possible crossing to the next, and let observers look, until something else is due."""
    alarm = pilot.alarm
    while True:
        # Of alarms at one instant the first is that of the lowest index, which is their order as events.
        j = int(np.argmin(alarm))
        now, row = alarm[j], _next_row(watch)
        # Strictly: at one instant the control unit looks before observers do.
        if row < now:
            if not _within(row, _OBSERVE, pilot.turns[ROW], limits):
                return REACHED
            pilot.now[0] = row
            _find_totals(crowd, pilot, meter)
            _keep(crowd, pilot, watch)
            continue
        if not _within(now, _SENSE, j, limits):
            return REACHED
        if _crowded(crowd, pilot, post):
            return CROWDED
        pilot.now[0] = now
        # Others' copies stay where they are: this look reads the total of one resource, and no answer for
        # another one changes it.
        queue = 0 if crowd.coupled else j
        settle(crowd, queue, queue + 1, now, LAST)
        # Overshoot is integrated for each resource, so answers for others may be folded in at another time.
        if meter.lines and crowd.answers.held[0] > 0:
            fold_answers(crowd.answers, meter)
        _find_moments(crowd, pilot)
        total = _total(crowd, pilot, j)
        # No alarm misses a crossing: responses only lower the total, and `growth` is what all grow by.  What
        # changes from outside sets the alarm anew.
        soonest = soonest_crossing(now, crowd.law.limit[j], total, pilot.growth[j])
        pilot.watchful[j] = soonest > now or pilot.failed[0]
        if pilot.watchful[j]:
            pilot.holding[j] = False
            # A unit that is down would look again at this instant for ever; who takes over sets the alarm.
            alarm[j] = soonest if soonest > now else np.inf
            continue
        pilot.repeated[j] = pilot.repeated[j] + 1 if now == pilot.instant[j] else 1
        pilot.due[:] = False
        pilot.due[j] = True
        if pilot.repeated[j] > MOST_AT_ONE_INSTANT:
            return STANDSTILL
        # Before anything is sent, so that the look is done with whoever sends.
        _hold_off(pilot, j, now, total)
        if not _sends(pilot, post, limits):
            return BROADCAST
        if not broadcast(crowd, post, j, now, pilot.delay, limits.acted_at, limits.acted):
            return REFUSED


@routine
def settle_and_fold(crowd: Crowd, meter: Meter, time: float, limit: int) -> None:
    """Let all agents answer all copies that are due, as `settle` has it, and measure."""
    settle(crowd, 0, crowd.flights.base.shape[0], time, limit)
    if meter.lines and crowd.answers.held[0] > 0:
        fold_answers(crowd.answers, meter)
