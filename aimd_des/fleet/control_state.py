"""What a control unit in compiled code knows, and how far it may go."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.fleet.arrays import LAST
from aimd_des.utils.rng import Key
from aimd_des.utils.validation import FloatArray

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

#: What has ended a stretch of compiled looks, and how far it has come then.
#:
#: REACHED     Something else is due before the next look, which has not been taken.
#: BROADCAST   The look at `now` has been taken; signals for `due` are left to be sent.
#: NO_ROOM     There may be too little room for what the next look brings, or answers have to be told of; that
#:             look has not been taken.
#: STANDSTILL  The look at `now` has been taken; time cannot advance for the resource in `due`.
#: REFUSED     The channel has not taken the last signal that was noted; why is in `FleetChannel.code`.
#: IMPROPER    A function of the user's own has given no probability at the look at `now`, for the resource in
#:             `due`.
REACHED, BROADCAST, NO_ROOM, STANDSTILL, REFUSED, IMPROPER = 0, 1, 2, 3, 4, 5

#: What has a turn of its own: a look of a sampled control unit, a row of totals, a tick that is measured.
LOOK, ROW, TICK = 0, 1, 2

#: The turn of what a process would schedule only now: later than that of all that has been scheduled.
UNSCHEDULED = LAST


class FleetControl(NamedTuple):
    """The control unit of one run.

    Attributes
    ----------
    crossing : bool
        Whether it senses crossings; if not, it samples.
    period, phase, shortest, longest, delay : float
        Of a sampled one, and bounds of the hold-off of a crossing one; how long after a look its signals
        leave.
    low, high : float
        Shares of the threshold between which the probability of a signal of a sampled one rises.
    probability : int
        Address of the compiled function that gives the probability instead; 0 where there is none.
    key : tuple of two uint64
        The key of its draws.
    failed : ndarray of bool, shape (1,)
        Whether it is down.
    look : ndarray of int, shape (1,)
        Index of the next look of a sampled one.
    look_time : ndarray, shape (m,)
        When a crossing one looks at each resource next.
    awaits_crossing : ndarray of bool, shape (m,)
        Whether it waits for a crossing there, and not for the end of the hold-off.
    growth : ndarray, shape (m,)
        Of total demand, in units of the resource per unit of time.
    instant : ndarray, shape (m,)
        When a crossing one broadcast last.
    unanswered, since : ndarray, shape (m,)
        What total demand would be if nobody had answered, and when it was so.
    hold_off : ndarray, shape (m,)
        The present one.
    holding : ndarray of bool, shape (m,)
        Whether its end is what the alarm is set to.
    repeated : ndarray of int, shape (m,)
        How often it did at that instant.
    due : ndarray of bool, shape (m,)
        Resources to broadcast for, at `now`.
    total : ndarray, shape (m,)
        Total demand at the latest look of a sampled one.
    now : ndarray, shape (1,)
        Time of the latest look.
    moment : ndarray, shape (n,) or (1,)
        Where the agents are in their own time, at that look.
    turns : ndarray of int, shape (3,)
        Order numbers of the next look of a sampled one, the next row of totals and the next tick that is
        measured; `UNSCHEDULED` until SimPy's side gives it one.
    answers : int
        Above how many answers in memory somebody has to be told of them.
    """

    # A tuple of arrays: numbers that change are arrays of one, which compiled code and SimPy's side share.
    # `failed` and `growth` belong to the conditions, and compiled code only reads them.
    crossing: bool
    period: float
    phase: float
    shortest: float
    longest: float
    delay: float
    low: float
    high: float
    probability: int
    key: Key
    failed: BoolArray
    look: IntArray
    look_time: FloatArray
    awaits_crossing: BoolArray
    growth: FloatArray
    instant: FloatArray
    unanswered: FloatArray
    since: FloatArray
    hold_off: FloatArray
    holding: BoolArray
    repeated: IntArray
    due: BoolArray
    total: FloatArray
    now: FloatArray
    moment: FloatArray
    turns: IntArray
    answers: int


class Limits(NamedTuple):
    """How far the looks may go.

    Attributes
    ----------
    horizon, kind, order : float, int, int
        Time, kind and order number of what is due next besides.
    change : float
        Before this nobody can cut a signal that leaves, or the run is over.
    acted_at, acted : float, int
        When somebody last acted, and the last turn that was over then.
    """

    # Taken anew before every stretch; nothing in them can change during it, since no event is handled then.
    horizon: float
    kind: int
    order: int
    change: float
    acted_at: float
    acted: int
