"""Electric vehicles at a transformer: who gets how much, and the day that they live in."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import brentq

from aimd_des import InputError, run_synchronous, solve_optimum, theory
from aimd_des.scenario.models import model_parameters, named_model
from models import ev_charging
from models.ev_charging import EVENING_PEAK, Vehicles, capacity_left, daily_base_load, vehicle_schedule

BASE_LOAD = Path(__file__).resolve().parents[1] / "scenarios" / "data" / "base_load.csv"
STEPS, REPLICATIONS = 20_000, 16


def ratings(n: int) -> Any:
    return np.where(np.arange(n) % 2 == 0, 3.7, 7.4)


def fair(urgency: Any, rating: Any, capacity: float) -> Any:
    """What vehicles get where x (1 + (x / r)^6) / u is common to all: two nested searches by SciPy."""

    def held(nu: float, u: float, r: float) -> float:
        return float(brentq(lambda x: x * (1 + (x / r) ** 6) - nu * u, 0.0, nu * u + 1e-9, xtol=1e-13))

    def all_hold(nu: float) -> Any:
        return np.array([held(nu, u, r) for u, r in zip(urgency, rating, strict=True)])

    return all_hold(brentq(lambda nu: all_hold(nu).sum() - capacity, 1e-3, 1e3, xtol=1e-13))


@pytest.mark.parametrize(("seed", "n"), [(0, 40), (1, 7), (2, 1)])
def test_shares_follow_urgency_up_to_the_rating(seed: int, n: int) -> None:
    problem, vehicles = ev_charging(seed, n), vehicle_schedule(seed, n)
    optimum = solve_optimum(problem)
    assert optimum.kkt_residual <= 1e-10
    # x grows at most in proportion to a derivative, and that is off by 1e-10 at most.
    expected = fair(vehicles.urgency, ratings(n), problem.capacity[0])
    np.testing.assert_allclose(optimum.allocation[:, 0], expected, rtol=1e-9)


def test_far_below_the_rating_shares_are_in_proportion_to_urgency() -> None:
    urgency = vehicle_schedule(3, 30).urgency
    problem = ev_charging(3, 30, chargers=[1000.0])
    expected = problem.capacity[0] * urgency / urgency.sum()
    np.testing.assert_allclose(solve_optimum(problem).allocation[:, 0], expected, rtol=1e-9)


def test_nobody_charges_much_above_the_rating() -> None:
    # Where the least is drawn by houses the urgent are at their rating, and the fast chargers take the rest.
    problem = ev_charging(0, 40, houses_per_vehicle=2.0, minute=960.0)
    held = solve_optimum(problem).allocation[:, 0]
    assert (held > 0.8 * ratings(40))[::2].any()
    assert (held < 1.25 * ratings(40)).all()
    assert held[1::2].max() > 3.7


def test_the_derivative_doubles_at_the_rating() -> None:
    problem, urgency = ev_charging(5, 6), vehicle_schedule(5, 6).urgency
    at_rating = problem.costs.gradient(ratings(6)[:, None])[:, 0]
    np.testing.assert_allclose(at_rating, 2 * ratings(6) / urgency, rtol=1e-13)
    assert problem.costs.proven


def test_the_capacity_is_what_is_left_at_the_peak_or_at_another_minute() -> None:
    minute, load = daily_base_load()
    left = capacity_left(load, 40)
    problem = ev_charging(0, 40)
    assert problem.capacity[0] == left.min()
    assert minute[left.argmin()] == EVENING_PEAK
    assert ev_charging(0, 40, minute=0).capacity[0] == left[0]
    assert ev_charging(0, 40, minute=1440.0).capacity[0] == pytest.approx(left[0], rel=1e-14)
    assert ev_charging(0, 20, houses_per_vehicle=2.0).capacity[0] == left.min()
    assert ev_charging(0, 160).capacity[0] == pytest.approx(160 * (2.375 - 0.95), rel=1e-8)


def test_power_is_in_kilowatts_a_minute() -> None:
    problem = ev_charging()
    assert problem.resource_names == ("power",)
    assert problem.resources[0].unit == "kW"
    assert (problem.increase == 0.025).all()
    assert (problem.decrease == 0.7).all()


@pytest.mark.parametrize("probability", [0.2, 0.6, 1.0])
def test_the_largest_response_probability_is_as_asked_for(probability: float) -> None:
    for n in (1, 40, 160):
        problem = ev_charging(1, n, probability=probability)
        held = solve_optimum(problem).allocation
        for x in (held, np.full((n, 1), problem.capacity[0] / n)):
            assert (problem.normalization * problem.costs.gradient(x) / x).max() < probability * (1 + 1e-9)
        assert (problem.normalization * problem.costs.gradient(held) / held).max() > 0.95 * probability


def test_averages_settle_at_the_optimum() -> None:
    # 16 replications of 20,000 minutes, early in the morning, when the urgent are at their rating.  A signal
    # finds a vehicle half a saw tooth h above its average, so what settles to a common value is the
    # derivative times 1 + h / x.  These factors lie between 1 and 1 + h / min x, and so what vehicles get
    # differs by no more: derivatives grow at least in proportion to x.
    problem = ev_charging(0, 40, houses_per_vehicle=1.5, minute=960.0)
    results = [run_synchronous(problem, steps=STEPS, seed=seed) for seed in range(REPLICATIONS)]
    assert sum(int(result.account.saturated.sum()) for result in results) == 0
    averages = np.array([result.average_at_end[:, 0] for result in results])
    mean = averages.mean(axis=0)
    error = (averages.std(axis=0, ddof=1) / mean).mean() / math.sqrt(REPLICATIONS)
    urgency = vehicle_schedule(0, 40).urgency
    optimum = fair(urgency, ratings(40), mean.sum())
    signals = np.mean([len(result.signals) for result in results]) / STEPS
    tolerance = 0.025 * (1 - signals) / (2 * signals) / optimum.min() + 4 * error
    assert tolerance < 0.13
    assert np.abs(mean / optimum - 1).max() < tolerance
    # Negative controls: equal shares, and chargers that know no rating.
    assert np.abs(mean / mean.mean() - 1).max() > 2 * tolerance
    assert np.abs(mean / (urgency / urgency.sum() * mean.sum()) - 1).max() > 2 * tolerance
    expected = theory.predict(problem, latency=1)
    assert signals == pytest.approx(expected.signals[0], rel=0.05)
    assert mean.sum() / problem.capacity[0] == pytest.approx(expected.utilisation[0], abs=0.02)


def test_vehicles_come_in_the_evening_and_leave_in_the_morning() -> None:
    # 20,000 vehicles, seed 0: means are known to a standard deviation over sqrt(20,000), 0.7 % of it.
    vehicles = vehicle_schedule(0, 20_000)
    for values, middle, deviation in (
        (vehicles.arrival, 390.0, 90.0),
        (vehicles.departure, 1170.0, 60.0),
        (np.log(vehicles.energy), math.log(8.0), 0.5),
    ):
        scaled = (values - middle) / deviation
        assert np.abs(scaled).max() <= 2 + 1e-9
        # Cut off at 2 a standard normal number has the variance 1 - 4 phi(2) / (Phi(2) - Phi(-2)) = 0.774.
        assert abs(scaled.mean()) < 4 * math.sqrt(0.774 / 20_000)
        assert scaled.var() == pytest.approx(0.774, abs=0.02)
    assert (vehicles.departure - vehicles.arrival >= 480 - 1e-9).all()
    assert abs(np.corrcoef(vehicles.arrival, vehicles.energy)[0, 1]) < 4 / math.sqrt(20_000)


def test_any_vehicle_can_be_charged_in_its_stay() -> None:
    assert vehicle_schedule(0, 20_000).urgency.max() < 3.7


def test_the_first_vehicles_stay_when_more_are_added() -> None:
    few, many = vehicle_schedule(7, 10), vehicle_schedule(7, 61)
    for name in ("arrival", "departure", "energy"):
        np.testing.assert_array_equal(getattr(few, name), getattr(many, name)[:10])
    x = np.random.default_rng(7).uniform(0.1, 8.0, (61, 1))
    gradient = ev_charging(7, 10).costs.gradient(x[:10])
    np.testing.assert_array_equal(gradient, ev_charging(7, 61).costs.gradient(x)[:10])
    assert (vehicle_schedule(8, 10).arrival != few.arrival).all()


def test_the_base_load_has_its_peak_in_the_evening() -> None:
    minute, load = daily_base_load(1)
    np.testing.assert_array_equal(minute, np.arange(1440.0))
    assert minute[load.argmax()] == EVENING_PEAK == 390.0
    assert load.max() == pytest.approx(0.95, rel=1e-6)
    assert 0.30 < load.min() < 0.31
    assert 11.0 < load.sum() / 60 < 12.0  # kWh in a day
    tops = minute[(load > np.roll(load, 1)) & (load > np.roll(load, -1))]
    assert tops.tolist() == [390.0, 1185.0]  # 18:30 and 7:45
    # Smooth, over midnight and noon, too: no more than the steepest slope of the bumps, h / (w sqrt(e)).
    slope = np.diff(load, append=load[:1])
    assert np.abs(slope).max() < 0.65 / 120 / math.sqrt(math.e) * 1.01
    np.testing.assert_array_equal(daily_base_load(15)[1], load[::15])


def test_the_file_holds_the_profile() -> None:
    minute, load = daily_base_load()
    table = pd.read_csv(BASE_LOAD)
    assert table.columns.tolist() == ["minute", "base_load"]
    np.testing.assert_array_equal(table["minute"], minute)
    np.testing.assert_allclose(table["base_load"], load, rtol=0, atol=0.500001e-4)


def test_vehicles_are_what_they_were_given() -> None:
    arrival = np.array([300.0, 400.0])
    vehicles = Vehicles(arrival, departure=np.array([900.0, 1000.0]), energy=np.array([5.0, 20.0]))
    assert vehicles.urgency.tolist() == [0.5, 2.0]
    arrival[0] = 0.0
    assert vehicles.arrival.tolist() == [300.0, 400.0]
    assert not vehicles.arrival.flags.writeable
    assert len(vehicles) == 2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"arrival": [-1.0, 400.0]}, "arrival[0] = -1.0: must be a finite number at least 0"),
        ({"departure": [900.0]}, "shape of departure = (1,): must be (2,)"),
        ({"departure": [900.0, 400.0]}, "departure[1] = 400.0: must be after the arrival at 400"),
        ({"energy": [5.0, 0.0]}, "energy[1] = 0.0: must be a finite number greater than 0"),
        ({"energy": "much"}, "energy = 'much': must be an array of numbers of shape (2,)"),
    ],
)
def test_vehicles_refuse_by_name(changes: dict[str, Any], message: str) -> None:
    given = {"arrival": [300.0, 400.0], "departure": [900.0, 1000.0], "energy": [5.0, 20.0]}
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        Vehicles(**{**given, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": -1}, "seed = -1: must be an integer of at least 0"),
        ({"n_vehicles": 0}, "n_vehicles = 0: must be an integer of at least 1"),
        ({"chargers": [3.7, 0.0]}, "chargers[1] = 0.0: must be a finite number greater than 0"),
        ({"chargers": 7.4}, "shape of chargers = (): must be (n_chargers,)"),
        ({"chargers": []}, "chargers = []: must be together more than the 57 kW that are left"),
        ({"chargers": [1.4]}, "chargers = [1.4]: must be together more than the 57 kW that are left"),
        ({"houses_per_vehicle": 0.0}, "houses_per_vehicle = 0.0: must be a finite number greater than 0"),
        ({"minute": -1.0}, "minute = -1.0: must be a finite number at least 0 and at most 1440"),
        ({"minute": 1441.0}, "minute = 1441.0: must be a finite number at least 0 and at most 1440"),
        ({"probability": 0.0}, "probability = 0.0: must be a finite number greater than 0 and at most 1"),
    ],
)
def test_it_refuses_by_name(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        ev_charging(**options)


def test_the_base_load_refuses_by_name() -> None:
    with pytest.raises(InputError, match=r"^step = 7: must be a divisor of 1440"):
        daily_base_load(7)
    with pytest.raises(InputError, match=r"^step = 0: must be an integer of at least 1 and at most 1440"):
        daily_base_load(0)
    with pytest.raises(InputError, match=r"^base_load\[1\] = 2.375: must be a finite number at least 0"):
        capacity_left(np.array([0.3, 2.375]), 40)
    with pytest.raises(InputError, match=r"^n_houses = 0\.0"):
        capacity_left(np.array([0.3]), 0.0)


def test_it_is_registered_with_defaults() -> None:
    assert named_model("models.ev_charging") is ev_charging
    parameters = model_parameters("models.ev_charging", {"n_vehicles": 10}, seed=3)
    assert parameters["seed"] == 3
    assert ev_charging(**parameters).n_agents == 10
