"""The control unit in compiled code: its looks between two events of SimPy, as the processes would take them."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.agents.crowd import Crowd
from aimd_des.agents.settling import LAST, settle, settle_all
from aimd_des.checks import FloatArray
from aimd_des.clock import next_ticks
from aimd_des.compiled import formula, kernel
from aimd_des.control_unit import MOST_AT_ONE_INSTANT
from aimd_des.environment import FIRST_ORDER
from aimd_des.population import total_of

__all__ = ["BROADCAST", "CROWDED", "REACHED", "STANDSTILL", "Limits", "Pilot", "steer"]

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

#: What has ended a stretch of compiled looks.
REACHED, BROADCAST, CROWDED, STANDSTILL = 0, 1, 2, 3


class Pilot(NamedTuple):
    """The control unit of one run.

    Attributes
    ----------
    crossing : bool
        Whether it senses crossings; if not, it samples.
    period, phase, refractory, delay : float
        Of a sampled or a crossing one; how long after a look its signals leave.
    look : ndarray of int, shape (1,)
        Index of the next look of a sampled one.
    alarm : ndarray, shape (m,)
        When a crossing one looks at each resource next.
    watchful : ndarray of bool, shape (m,)
        Whether it waits for a crossing there, and not for the end of the hold-off.
    slope : ndarray, shape (m,)
        Growth of total demand, in units of the resource per unit of time.
    instant : ndarray, shape (m,)
        When it broadcast last.
    repeated : ndarray of int, shape (m,)
        How often it did at that instant.
    due : ndarray of bool, shape (m,)
        Resources to broadcast for, at `now`.
    now : ndarray, shape (1,)
        Time of the latest look.
    moment : ndarray, shape (n,) or (1,)
        Where the agents are in their own time, at that look.
    woken : ndarray of bool, shape (1,)
        Whether the next look is what the present event of SimPy is for.
    answers : int
        Above how many answers in memory somebody has to be told of them.
    """

    crossing: bool
    period: float
    phase: float
    refractory: float
    delay: float
    look: IntArray
    alarm: FloatArray
    watchful: BoolArray
    slope: FloatArray
    instant: FloatArray
    repeated: IntArray
    due: BoolArray
    now: FloatArray
    moment: FloatArray
    woken: BoolArray
    answers: int


class Limits(NamedTuple):
    """How far the looks may go.

    Attributes
    ----------
    horizon : float
        Up to here.
    turns : int
        Looks at the horizon itself come before what is there if their turn is below this.
    acted_at, acted : float, int
        When somebody last acted, and the last turn that was over then.
    """

    horizon: float
    turns: int
    acted_at: float
    acted: int


@formula
def _within(time: float, turn: int, limits: Limits) -> bool:
    return time < limits.horizon or (time == limits.horizon and turn < limits.turns)


@formula
def _find_moments(crowd: Crowd, pilot: Pilot, limits: Limits) -> None:
    """Find where the agents are in their own time: the time, or their next tick."""
    now = pilot.now[0]
    if crowd.grain > 0.0:
        rhythm = crowd.rhythm
        over = now == limits.acted_at and limits.acted >= FIRST_ORDER
        from_ = np.nextafter(now, np.inf) if over else now
        next_ticks(rhythm.phase, rhythm.period, rhythm.jitter, rhythm.key, from_, pilot.moment)
    else:
        pilot.moment[0] = now


@formula
def _total(crowd: Crowd, pilot: Pilot, resource: int) -> float:
    state, increase = crowd.state, crowd.law.increase[resource]
    return total_of(state.demand[resource], increase, state.anchor[resource], pilot.moment, crowd.grain)


@kernel
def _sample(crowd: Crowd, pilot: Pilot, limits: Limits) -> int:
    """Look at phase + q * period: `Sampled`."""
    while True:
        now = pilot.phase + pilot.look[0] * pilot.period
        # Looks after the first have not been scheduled, and would come after what is there.
        if not _within(now, 0 if pilot.woken[0] else LAST - 1, limits):
            return REACHED
        if crowd.answers.count[0] > pilot.answers:
            return CROWDED
        pilot.now[0] = now
        pilot.woken[0] = False
        pilot.look[0] += 1
        turn = limits.acted + 1 if now == limits.acted_at else 0
        settle_all(crowd, now, turn if crowd.grain > 0.0 else LAST)
        _find_moments(crowd, pilot, limits)
        any_due = False
        for j in range(pilot.due.shape[0]):
            pilot.due[j] = _total(crowd, pilot, j) > crowd.law.limit[j]
            any_due = any_due or pilot.due[j]
        if any_due:
            return BROADCAST


@kernel
def _sense(crowd: Crowd, pilot: Pilot, limits: Limits) -> int:
    """Go from one possible crossing to the next: `Crossing`."""
    alarm = pilot.alarm
    while True:
        j = np.argmin(alarm)
        now = alarm[j]
        if not _within(now, j, limits):
            return REACHED
        if crowd.answers.count[0] > pilot.answers:
            return CROWDED
        pilot.now[0] = now
        settle(crowd, 0 if crowd.coupled else j, now, LAST)
        _find_moments(crowd, pilot, limits)
        soonest = now + (crowd.law.limit[j] - _total(crowd, pilot, j)) / pilot.slope[j]
        pilot.watchful[j] = soonest > now
        if soonest > now:
            alarm[j] = soonest
            continue
        pilot.repeated[j] = pilot.repeated[j] + 1 if now == pilot.instant[j] else 1
        pilot.instant[j] = now
        pilot.due[:] = False
        pilot.due[j] = True
        if pilot.repeated[j] > MOST_AT_ONE_INSTANT:
            return STANDSTILL
        alarm[j] = now + pilot.refractory
        return BROADCAST


@kernel
def steer(crowd: Crowd, pilot: Pilot, limits: Limits) -> int:
    """Look, and let the agents answer what has arrived by then, until somebody else has to do something.

    Parameters
    ----------
    crowd : Crowd
        The agents.
    pilot : Pilot
        The control unit.
    limits : Limits
        How far.

    Returns
    -------
    int
        `REACHED`: the next look is beyond the horizon.  `BROADCAST`: signals are due.  `CROWDED`: there is
        no more room for answers.  `STANDSTILL`: time cannot advance.
    """
    return _sense(crowd, pilot, limits) if pilot.crossing else _sample(crowd, pilot, limits)
