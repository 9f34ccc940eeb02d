"""A night of charging behind one transformer, and what is measured of it.

The unit of time is the minute, and a night lasts from noon to noon.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from aimd_des import BroadcastChannel, Problem, Recording, Result, theory
from aimd_des.averaging import Cumulative, Forgetting
from aimd_des.interventions import CapacityProfile, Join, leave
from aimd_des.latency import Constant, Exponential
from aimd_des.loss import Bernoulli
from aimd_des.lowlevel import EventKind, FloatArray, ProcessGenerator, System
from models.ev_charging import Vehicles, capacity_left, daily_base_load, ev_charging, vehicle_schedule
from scenarios.common.measure import sensed

_DAY = 1440
_CHARGERS, _HOUSES = (3.7, 7.4), 0.5  # kW in turn, and houses for each vehicle
_HOLD_OFF, _LATENCY, _EXCEEDANCE, _MEMORY = 0.5, 0.5, 0.01, 120.0

#: Probability that a signal is lost on a vehicle, where the channel is lossy.
LOSS = 0.3
#: When totals are kept, and when averages are: from 18:00 to 3:00.
TIMES, LOOKS = np.arange(0.0, _DAY, 5.0), np.arange(360.0, 901.0, 30.0)
#: Parts of its stay for which the progress of a vehicle is kept.
SHARES = np.linspace(0.0, 1.0, 101)
#: When nearly all are here: 22:00 to 1:00.
SPAN = (600.0, 780.0)


class Case(NamedTuple):
    """What is run."""

    # Whether signals are late, and whether they get lost.
    late: bool
    lossy: bool
    forgets: bool = False  # whether averages forget, or are over all of the stay
    lowered: bool = False  # whether the threshold is lowered to the one that theory gives


class Garage:
    """Meters all vehicles by the minute; who is full or due leaves, and no charger exceeds its rating.

    Arrivals and departures are whole minutes.
    """

    def __init__(self, vehicles: Vehicles) -> None:
        self.vehicles = vehicles
        self.ratings = np.resize(_CHARGERS, len(vehicles))
        self.energy = np.zeros(len(vehicles))  # in kWh
        self.gone = np.full(len(vehicles), np.nan)  # when each has left
        self.history = np.zeros((_DAY, len(vehicles)))  # the energy at every minute of its stay

    def __call__(self, system: System) -> ProcessGenerator:
        """Look at all vehicles every minute, as a process beside theirs."""
        away, held = system.conditions.away, np.zeros(len(self.vehicles))
        minute = int(self.vehicles.arrival.min())
        while np.isnan(self.gone).any():
            minute += 1
            yield system.env.at(float(minute), EventKind.INTERVENE)
            before, held = held, system.allocations()[0][0]
            self.energy += 0.5 * (before + held) / 60.0
            self.history[minute] = self.energy
            done = (self.energy >= self.vehicles.energy) | (self.vehicles.departure <= minute)
            for i in np.flatnonzero(done & ~away).tolist():
                leave(system, i)
                self.gone[i] = minute
            for i in np.flatnonzero((held > self.ratings) & ~away).tolist():
                system.set_demand(i, 0, float(self.ratings[i]))
            held = np.where(away, 0.0, np.minimum(held, self.ratings))


class Night(NamedTuple):
    """What is measured of one night."""

    # Numbers, and what theory has for some of them.
    measures: dict[str, float]
    expected: dict[str, float]
    error: FloatArray  # distance of the averages from the optimum in force, at `LOOKS`
    # (4, 288): At `TIMES`: total demand, what it would be without control, the capacity, all in kW;
    # vehicles present.
    lines: FloatArray
    progress: FloatArray  # (101, n): share of its need that each vehicle has, at `SHARES` of its stay


def night(case: Case, n: int, step: int, seed: int) -> Night:
    """Run a night from noon to noon: n vehicles, and so many minutes between two changes of the capacity."""
    result, garage = run(case, n, step, seed)
    expected = _expected(case, result, garage.vehicles)
    return _measured(result, garage, expected)


def run(case: Case, n: int, step: int, seed: int) -> tuple[Result, Garage]:
    """Run a night as `night` does, for its result and the garage as it is in the end."""
    drawn = vehicle_schedule(seed, n)
    vehicles = replace(drawn, arrival=np.round(drawn.arrival), departure=np.round(drawn.departure))
    problem = ev_charging(seed, n, _CHARGERS, _HOUSES, probability=0.5)
    if case.lowered:
        setting = {"latency": _LATENCY, "hold_off": _HOLD_OFF, "exceedance": _EXCEEDANCE}
        gamma = theory.safe_threshold(problem, "continuous", loss=LOSS, **setting)
        problem = Problem([replace(problem.resources[0], threshold=float(gamma[0]))], problem.costs)
    latency = Exponential(_LATENCY) if case.late else Constant(0.0)
    minutes, base_load = daily_base_load(step)
    garage = Garage(vehicles)
    result = sensed(
        problem,
        _HOLD_OFF,
        channel=BroadcastChannel(latency, Bernoulli(LOSS if case.lossy else 0.0)),
        averaging=Forgetting(_MEMORY) if case.forgets else Cumulative(),
        interventions=[
            CapacityProfile("power", minutes, capacity_left(base_load, n * _HOUSES)),
            *(Join(i, at) for i, at in enumerate(vehicles.arrival.tolist())),
        ],
        seed=seed,
        recording=Recording(demand=TIMES, allocations=LOOKS),
        processes=[garage],
    ).run(_DAY)
    return result, garage


def _measured(result: Result, garage: Garage, expected: dict[str, float]) -> Night:
    vehicles, pieces, sent = garage.vehicles, result.pieces, result.signals_sent.time
    lasted = _lasted(result)
    place = np.searchsorted(pieces["start"], TIMES, side="right") - 1
    at_once = vehicles.arrival + 60.0 * vehicles.energy / garage.ratings
    plugged = (TIMES[:, None] >= vehicles.arrival) & (TIMES[:, None] < at_once)
    error = result.tracking["relative_error"].to_numpy()[: len(LOOKS)]
    missing = np.maximum(vehicles.energy - garage.energy, 0.0)
    measures = {
        "minutes above capacity": float((pieces["overshoot_time"] * (pieces["end"] - pieces["start"])).sum()),
        "peak": float(pieces["overshoot_peak"].max()),
        "signals, 22:00 to 1:00": float(((sent >= SPAN[0]) & (sent < SPAN[1])).sum()),
        "used, 22:00 to 1:00": float(pieces["utilisation"].to_numpy() @ lasted / lasted.sum()),
        "energy missing": float(missing.sum() / vehicles.energy.sum()),
        "hours to spare": float((vehicles.departure - garage.gone).mean() / 60.0),
        "least hours to spare": float((vehicles.departure - garage.gone).min() / 60.0),
        "error of averages": float(error[(SPAN[0] <= LOOKS) & (SPAN[1] >= LOOKS)].mean()),
        "threshold": float(result.problem.threshold[0]),
    }
    capacity, present = (pieces[name].to_numpy()[place] for name in ("capacity", "agents"))
    total = result.observations.total_demand[: len(TIMES), 0]
    stay = SHARES[:, None] * (vehicles.departure - vehicles.arrival)
    minutes = np.minimum(np.round(vehicles.arrival + stay), garage.gone).astype(np.int64)
    progress = garage.history[minutes, np.arange(len(vehicles))] / vehicles.energy
    lines = np.stack([total, plugged @ garage.ratings, capacity, present])
    return Night(measures, expected, error, lines, progress)


def _lasted(result: Result) -> FloatArray:
    """Return for how long each piece lasted within the span."""
    pieces = result.pieces
    return np.asarray(np.clip(pieces["end"], *SPAN) - np.clip(pieces["start"], *SPAN), dtype=np.float64)


def _expected(case: Case, result: Result, vehicles: Vehicles) -> dict[str, float]:
    """Predict signals, piece by piece, and how far luck alone drives averages at the middle of their time."""
    pieces, problem, loss = result.pieces, result.problem, LOSS if case.lossy else 0.0
    middle = 0.5 * sum(SPAN)
    alpha, beta, gamma = problem.increase[0, 0], problem.decrease[0, 0], problem.normalization[0]
    lasted = _lasted(result)
    rates = theory.signal_rate(alpha, beta, gamma, pieces["multiplier"].to_numpy()[lasted > 0.0], loss)
    piece = result.piece_at(middle)
    best = result.optimum_of(piece)
    assert best is not None  # noqa: S101 - vehicles are there at midnight
    held = best.allocation[:, 0]
    age = float(middle - vehicles.arrival[piece.present].mean())
    memory = {"time_constant": _MEMORY} if case.forgets else {"window": age}
    chance = (1.0 - loss) * gamma * best.multipliers[0] / held
    spread = theory.averaging_spread(held, alpha, beta, probability=chance, **memory)
    # The expected absolute value of a normal number is the root of 2 / pi of its standard deviation.
    luck = float(np.sqrt(2.0 / np.pi) * (held @ spread) / held.sum())
    found = {"signals, 22:00 to 1:00": float(rates @ lasted[lasted > 0.0]), "error of averages": luck}
    if case.lowered:
        found["minutes above capacity"] = _EXCEEDANCE * float(np.ptp(result.signals_sent.time))
    return found
