"""What a control unit in compiled code knows, and how far it may go."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aimd_des.fleet.arrays import LAST
from aimd_des.utils.records import record
from aimd_des.utils.rng import Key
from aimd_des.utils.validation import FloatArray

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

#: What has ended a stretch of compiled looks, and how far it has come then.
#:
#: REACHED     Something else is due before the next look, or there were as many looks as there may be; that
#:             look has not been taken.
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


@record
class FleetControl(NamedTuple):
    """The control unit of one run."""

    # A tuple of arrays: numbers that change are arrays of one, which compiled code and SimPy's side share.
    # `failed` and `growth` belong to the conditions, and compiled code only reads them.
    crossing: bool  # whether it senses crossings; if not, it samples
    # Of a sampled one, and bounds of the hold-off of a crossing one; how long after a look its signals leave.
    period: float
    phase: float
    shortest: float
    longest: float
    delay: float
    # Shares of the threshold between which the probability of a signal of a sampled one rises.
    low: float
    high: float
    # Address of the compiled function that gives the probability instead; 0 where there is none.
    probability: int
    key: Key  # the key of its draws
    failed: BoolArray  # (1,): whether it is down
    look: IntArray  # (1,): index of the next look of a sampled one
    look_time: FloatArray  # (m,): when a crossing one looks at each resource next
    # (m,): whether it waits for a crossing there, and not for the end of the hold-off.
    awaits_crossing: BoolArray
    growth: FloatArray  # (m,): of total demand, in units of the resource per unit of time
    instant: FloatArray  # (m,): when a crossing one broadcast last
    # (m,): what total demand would be without answers, and when it was so.
    unanswered: FloatArray
    since: FloatArray
    hold_off: FloatArray  # (m,): the present one
    holding: BoolArray  # (m,): whether its end is what the alarm is set to
    repeated: IntArray  # (m,): how often it did at that instant
    due: BoolArray  # (m,): resources to broadcast for, at `now`
    total: FloatArray  # (m,): total demand at the latest look of a sampled one
    now: FloatArray  # (1,): time of the latest look
    moment: FloatArray  # (n,) or (1,): where the agents are in their own time, at that look
    # (3,): order numbers of the next look of a sampled one, the next row of totals and the next tick that is
    # measured; `UNSCHEDULED` until SimPy's side gives it one.
    turns: IntArray
    answers: int  # above how many answers in memory they are reported


#: What a control unit knows of its own: all that neither is given nor belongs to the conditions.
OF_A_UNIT = (
    "look",
    "look_time",
    "awaits_crossing",
    "instant",
    "unanswered",
    "since",
    "hold_off",
    "holding",
    "repeated",
    "due",
    "total",
    "now",
    "moment",
    "turns",
)


@record
class Limits(NamedTuple):
    """How far sampling may go."""

    # Taken anew before every stretch; nothing in them can change during it, since no event is handled then.
    # Time, kind and order number of what is due next besides.
    horizon: float
    kind: int
    order: int
    change: float  # before this nothing can cut a signal that leaves, or the run is over
    # When an event last acted, and the last turn that was over then.
    acted_at: float
    acted: int
    steps: int  # how many looks and rows of totals there may be
