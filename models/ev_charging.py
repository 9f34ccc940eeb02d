r"""Electric vehicles that charge overnight behind one transformer, the urgent ones faster.

AIMD for charging, with one-bit signals that the power is used up, is from S. Stuedli, E. Crisostomi, R.
Middleton and R. Shorten. Their paper is "A flexible distributed framework for realising electric and
plug-in hybrid vehicle charging policies", International Journal of Control 85(8), 2012. The setting is
theirs, costs and numbers are ours.  The unit of time is the minute, and minute 0 is noon, so that a night
is in one piece.

A vehicle that needs the energy E_i in the time T_i that it stays has to charge with u_i = E_i / T_i in the
mean, its urgency in kW.  What all have in common at the optimum is the derivative of their costs.  For shares
in proportion to urgency that must be x / u_i, and a factor makes it steep beyond the charger's rating r_i:

    df_i / dx = x / u_i * (1 + (x / r_i)^6),    f_i = x^2 / (2 u_i) + x^8 / (8 u_i r_i^6).

A vehicle well below its rating gets x = nu u_i, and one at its rating half of nu u_i.  Costs are about
averages: demand itself may exceed the rating for a while.

============================  ====================  ==========================================================
number                        value                 why
============================  ====================  ==========================================================
transformer, per house        2.5 kVA               400 kVA for 160 houses, a common size in European suburbs
power factor                  0.95                  so that it carries 2.375 kW per house
base load, per house          0.30 to 0.95 kW       the mean over many houses, 11 kWh on a winter's day
chargers                      3.7 and 7.4 kW        one phase of 230 V with 16 A or 32 A
energy needed                 8 kWh (2.9 to 21.7)   45 km at 0.18 kWh/km, about a day's driving
alpha                         0.025 kW per minute   0.1 A at 230 V; an hour until the transformer is full
beta                          0.7                   milder than halving: powers vary by less
largest response probability  0.6                   with alpha and beta a signal about every five minutes
============================  ====================  ==========================================================

They are of the right size, not measured.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aimd_des import InputError, PolynomialCosts, Problem, Resource, checks, lowlevel, model, solve_optimum
from aimd_des.lowlevel import FloatArray, Purpose

__all__ = ["EVENING_PEAK", "Vehicles", "capacity_left", "daily_base_load", "ev_charging", "vehicle_schedule"]

#: When the base load is largest, 18:30, in minutes after noon.
EVENING_PEAK = 390.0

_DAY = 1440
_TRANSFORMER, _POWER_FACTOR = 2.5, 0.95  # kVA per house
_INCREASE, _DECREASE = 0.025, 0.7
# Base load per house: a floor and a bump for each of (kW, minute of its top, width in minutes).
_FLOOR = 0.30
_BUMPS = ((0.25, 1185.0, 75.0), (0.65, EVENING_PEAK, 120.0))
# Mean and standard deviation in minutes after noon: 18:30 and half past seven in the morning.
_ARRIVAL, _DEPARTURE = (390.0, 90.0), (1170.0, 60.0)
# Median in kWh, and standard deviation of the logarithm.
_ENERGY = (8.0, 0.5)
# All are cut off at two standard deviations: then even the shortest stay is long enough for the largest need.
_CUT = 2.0
_STEEPNESS = 8


@dataclass(frozen=True, eq=False)
class Vehicles:
    """When vehicles are plugged in, and what they need.

    Parameters
    ----------
    arrival, departure : array_like, shape (n,)
        In minutes after noon, 0 <= arrival < departure.
    energy : array_like, shape (n,)
        Needed between the two, > 0, in kWh.

    Raises
    ------
    InputError
        If lengths differ, or a value is outside its range.

    Examples
    --------
    >>> Vehicles(arrival=[360.0], departure=[1080.0], energy=[6.0]).urgency.tolist()
    [0.5]
    """

    arrival: FloatArray
    departure: FloatArray
    energy: FloatArray

    def __post_init__(self) -> None:
        arrival = checks.array("arrival", self.arrival, ("n_vehicles",), low=0.0)
        departure = checks.array("departure", self.departure, arrival.shape)
        energy = checks.array("energy", self.energy, arrival.shape, low=0.0, low_open=True)
        for i in np.flatnonzero(departure <= arrival):
            after = f"after the arrival at {arrival[i]:g}"
            raise InputError.of(f"departure[{i}]", float(departure[i]), after)
        for name, values in (("arrival", arrival), ("departure", departure), ("energy", energy)):
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        return len(self.arrival)

    @property
    def urgency(self) -> FloatArray:
        """The power that would just do, in kW: energy over stay, shape (n,)."""
        return np.asarray(60.0 * self.energy / (self.departure - self.arrival))


def vehicle_schedule(seed: int = 0, n_vehicles: int = 40) -> Vehicles:
    """Draw arrivals in the evening, departures in the morning and the energy needed.

    Parameters
    ----------
    seed : int
        At least 0; with the same seed these are the vehicles of `ev_charging`.
    n_vehicles : int
        How many; the first vehicles stay when more are added.

    Returns
    -------
    Vehicles
        Arrivals are normal around 18:30 with 90 minutes, departures around 7:30 with 60 minutes, and the
        logarithm of the energy around that of 8 kWh with 0.5.  All are cut off at two standard deviations:
        arrivals are from 15:30 to 21:30, departures from 5:30 to 9:30 and needs from 2.9 to 21.7 kWh.

    Raises
    ------
    InputError
        If an argument is outside its range.
    """
    from scipy.special import ndtr, ndtri  # slow to import, and all models are imported together

    n = checks.integer("n_vehicles", n_vehicles, low=1)
    uniform = lowlevel.generator(seed, Purpose.PROBLEM).random((n, 3))
    low, high = ndtr(-_CUT), ndtr(_CUT)
    arrival, departure, energy = ndtri(low + (high - low) * uniform).T
    return Vehicles(
        arrival=_ARRIVAL[0] + _ARRIVAL[1] * arrival,
        departure=_DEPARTURE[0] + _DEPARTURE[1] * departure,
        energy=_ENERGY[0] * np.exp(_ENERGY[1] * energy),
    )


def _load_at(minute: FloatArray) -> FloatArray:
    """Evaluate the base load of a house, in kW."""
    load = np.full_like(minute, _FLOOR)
    for height, top, width in _BUMPS:
        radian = 2.0 * math.pi / _DAY
        load += height * np.exp((np.cos(radian * (minute - top)) - 1.0) / (radian * width) ** 2)
    return load


def daily_base_load(step: int = 15) -> tuple[FloatArray, FloatArray]:
    """Describe a day of the base load of a house: a small peak in the morning, a large one in the evening.

    Parameters
    ----------
    step : int
        Minutes between two values, a divisor of 1440.

    Returns
    -------
    minute : ndarray, shape (1440 / step,)
        0, step, ..., in minutes after noon.
    base_load : ndarray, shape (1440 / step,)
        The load at these minutes in kW per house, a mean over many houses; the next day is the same.

    Raises
    ------
    InputError
        If `step` is no divisor of 1440.

    Notes
    -----
    Synthetic: 0.30 kW, and the sum over k of ``h_k exp((cos(a (t - t_k)) - 1) / (a w_k)^2)`` with ``a = 2
    pi / 1440``. Each term is a Gaussian bump of height h and width w, closed to a circle of one day
    (after R. von Mises). The bumps have h = 0.25 kW, w = 75 minutes at 7:45, and h = 0.65 kW, w = 120
    minutes at 18:30. The file `base_load.csv` beside the scenarios holds the values for ``step=15``,
    rounded to 0.1 W.

    Examples
    --------
    >>> minute, base_load = daily_base_load()
    >>> len(minute), float(minute[base_load.argmax()]), round(float(base_load.max()), 6)
    (96, 390.0, 0.95)
    """
    every = checks.integer("step", step, low=1, high=_DAY)
    if _DAY % every:
        raise InputError.of("step", every, f"a divisor of {_DAY}")
    minute = np.arange(0, _DAY, every, dtype=np.float64)
    return minute, _load_at(minute)


def capacity_left(base_load: FloatArray, n_houses: float) -> FloatArray:
    """Say what the transformer has left for vehicles.

    Parameters
    ----------
    base_load : ndarray
        In kW per house, as from `daily_base_load`.
    n_houses : float
        How many houses; the transformer is as large as that many need.

    Returns
    -------
    ndarray
        In kW, for each value of the base load.

    Raises
    ------
    InputError
        If a base load leaves nothing, or the number of houses is not positive.

    Examples
    --------
    >>> capacity_left(np.array([0.375, 0.875]), n_houses=40).tolist()
    [80.0, 60.0]
    """
    usable = _TRANSFORMER * _POWER_FACTOR
    shape = ("n_times",) if np.ndim(base_load) else ()
    load = checks.array("base_load", base_load, shape, low=0.0, high=usable, high_open=True)
    return np.asarray(checks.number("n_houses", n_houses, low=0.0, low_open=True) * (usable - load))


@model
def ev_charging(
    seed: int = 0,
    n_vehicles: int = 40,
    chargers: Sequence[float] = (3.7, 7.4),
    houses_per_vehicle: float = 1.0,
    minute: float = EVENING_PEAK,
    probability: float = 0.6,
) -> Problem:
    """Build vehicles that charge behind one transformer.

    Parameters
    ----------
    seed : int
        Decides the draw of the vehicles, at least 0: `vehicle_schedule`.
    n_vehicles : int
        How many vehicles, each with a charger of its own; houses and transformer grow with them.
    chargers : sequence of float
        Ratings in kW, > 0, that vehicles get in turn: with the default every second one is fast.
    houses_per_vehicle : float
        Houses behind the transformer for each vehicle, > 0; 4 where one house in four has one.
    minute : float
        0 to 1440, the minute after noon whose base load counts: the capacity is what the transformer has
        left then.  By default the evening peak, 18:30, when the least is left; 0 for that at time 0.
    probability : float
        0 < probability <= 1, the largest response probability of any vehicle at the optimum or where all
        charge with the same power; it leads to Gamma.

    Returns
    -------
    Problem
        One resource, "power", in kW, among vehicles that are all plugged in and have yet to charge.

    Raises
    ------
    InputError
        If an argument is outside its range, or all chargers together would not use up what is left.

    Examples
    --------
    Vehicles well below their rating share in proportion to urgency:

    >>> problem = ev_charging(seed=0, n_vehicles=40, chargers=[22.0])
    >>> ratio = solve_optimum(problem).allocation[:, 0] / vehicle_schedule(seed=0, n_vehicles=40).urgency
    >>> bool(ratio.max() / ratio.min() < 1.01)
    True
    """
    vehicles = vehicle_schedule(seed, n_vehicles)
    n, urgency = len(vehicles), vehicles.urgency
    houses = checks.number("houses_per_vehicle", houses_per_vehicle, low=0.0, low_open=True)
    when = checks.number("minute", minute, low=0.0, high=_DAY)
    capacity = float(capacity_left(_load_at(np.array(when)), n * houses))
    given = checks.array("chargers", chargers, ("n_chargers",), low=0.0, low_open=True)
    ratings = np.resize(given, n)  # zeros where none are given
    if ratings.sum() <= capacity:
        left = f"together more than the {capacity:g} kW that are left"
        raise InputError.of("chargers", list(chargers), left, "nothing needs to be shared")
    coefficients = [0.5 / urgency, 1.0 / (_STEEPNESS * urgency * ratings ** (_STEEPNESS - 2))]
    costs = PolynomialCosts([2, _STEEPNESS], np.stack(coefficients, axis=1)[:, None, :])
    largest = checks.number("probability", probability, low=0.0, high=1.0, low_open=True)
    return _problem(costs, capacity, largest)


def _problem(costs: PolynomialCosts, capacity: float, probability: float) -> Problem:
    """Choose Gamma: the steepest cost, at the optimum or at equal shares, gets the probability."""

    def with_normalization(normalization: float) -> Problem:
        power = Resource("power", capacity, _INCREASE, _DECREASE, normalization, unit="kW")
        return Problem([power], costs)

    equal = np.full((costs.n_agents, 1), capacity / costs.n_agents)
    points = (equal, solve_optimum(with_normalization(1.0)).allocation)
    steepest = max(float((costs.gradient(point) / point).max()) for point in points)
    return with_normalization(probability / steepest)
