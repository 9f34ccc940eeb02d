"""Closed forms of steady states: limits by hand; tests of the scenarios hold runs against them."""

from typing import Any

import numpy as np
import pytest

from aimd_des import InputError, PolynomialCosts, Problem, SimulationError, solve_optimum, theory
from aimd_des.dynamics.averaging import Averaging, Cumulative, Forgetting, Window
from models.smart_cameras import smart_cameras
from scenarios.common.systems import memory_alone
from tests.conftest import resource

N, ALPHA, BETA, CAPACITY = 20, 0.02, 0.5, 20.0
GAMMA = 0.02


def squares(increase: Any = ALPHA, gamma: float = GAMMA) -> Problem:
    """Agents with costs x**2."""
    memory = resource(capacity=CAPACITY, increase=increase, decrease=BETA, normalization=gamma)
    return Problem([memory], PolynomialCosts([2], np.ones((N, 1, 1))))


@pytest.mark.parametrize("averaging", [Cumulative(), Forgetting(50.0), Window(50.0, 10)])
def test_the_fluid_comes_to_rest_at_the_optimum_for_its_level(averaging: Averaging) -> None:
    problem = memory_alone()
    path = theory.flow(problem, 30.0, 1500.0, averaging, step=0.5)
    best = solve_optimum(problem, capacity=np.array([30.0])).allocation[:, 0]
    assert path.demand[-1].sum() == pytest.approx(30.0)
    mean = path.demand[-400:].mean(axis=0)  # a window makes steep costs swing
    assert np.abs(mean - best).sum() / best.sum() < 0.03


def test_agents_of_a_spell_are_away_and_forget() -> None:
    kept, forgotten = (
        theory.flow(squares(), 19.0, 300.0, spells=[theory.Spell(100.0, 200.0, [0, 1], forgets=forgets)])
        for forgets in (False, True)
    )
    assert (kept.demand[401:801, :2] == 0.0).all()
    assert (kept.demand[401:801, 2:] > 0.0).all()
    before, after = kept.demand[:401, 0].mean(), kept.demand[801:, 0].mean()
    assert forgotten.average[-1, :2] == pytest.approx(after, rel=0.01)
    assert kept.average[-1, :2] == pytest.approx(0.5 * (before + after), rel=0.01)
    # With squares responses do not depend on averages, so demand is the same.
    assert kept.demand == pytest.approx(forgotten.demand)
    weighted = theory.flow(squares(), 19.0, 900.0, spells=[theory.Spell(0.0, np.inf, [0], weight=0.5)])
    assert weighted.demand[-1, 0] == pytest.approx(2.0 * weighted.demand[-1, 1], rel=0.01)


def test_signals_that_are_needed_and_the_total_on_both_sides_of_the_critical_loss() -> None:
    problem = squares()
    rho = float(theory.needed_rate(problem)[0])
    assert rho == pytest.approx(ALPHA / ((1 - BETA) * GAMMA * 2.0 * CAPACITY / N))
    assert theory.needed_rate(problem, capacity=[CAPACITY / 2])[0] == pytest.approx(2 * rho)
    held = theory.steady_total(problem, hold_off=0.5, loss=0.3)
    expected = theory.predict(problem, "continuous", loss=0.3)
    assert (held.signals, held.utilisation) == (expected.signals[0], expected.utilisation[0])
    # Beyond it derivatives 2 x are at alpha r / ((1 - p) (1 - beta) Gamma), and at p in the place of r.
    for dynamics, loss, wait in (("continuous", 0.9, 0.5), ("discrete", 0.9, 1.0)):
        away = theory.steady_total(problem, dynamics, hold_off=wait, loss=loss)  # type: ignore[arg-type]
        grown = loss if dynamics == "discrete" else wait
        wanted = N * 0.5 * ALPHA * grown / ((1 - loss) * (1 - BETA) * GAMMA) / CAPACITY
        assert away == pytest.approx((1.0 / wait, wanted))
    assert np.isnan(theory.steady_total(memory_alone(), hold_off=30.0)).tolist() == [False, True]  # cut off


def test_churn_adds_a_square() -> None:
    problem, stay = squares(), 100.0
    found = theory.churn(problem, stay, 0.8, 0.5)
    per_signal = found.signals * (1 - BETA) * GAMMA
    assert found.share == pytest.approx(np.full(N, ALPHA / (2.0 * per_signal + 1.0 / stay)))
    assert found.utilisation == pytest.approx(0.8 * found.share.sum() / CAPACITY)
    still = theory.churn(problem, np.inf, 1.0)
    expected = theory.predict(problem, "continuous")
    assert still.utilisation == pytest.approx(expected.utilisation[0], abs=2e-3)
    assert still.signals == pytest.approx(expected.signals[0], rel=0.05)
    assert found.signals < still.signals


def test_short_bursts_in_common_are_a_queue() -> None:
    problem, loss, burst, hold_off = squares(gamma=0.002), 0.1, 2.0, 0.05
    found = theory.burst_runaway(problem, loss, burst, hold_off=hold_off, span=1000.0)
    assert found is not None
    rho = float(theory.needed_rate(problem, capacity=[found.utilisation * CAPACITY])[0])
    lift = N * ALPHA * burst / CAPACITY
    wanted = lift * loss * (1 - loss) / (1 - loss - rho * hold_off)
    assert found.excess == pytest.approx(wanted, rel=0.1)  # a tooth is a twentieth of a burst
    assert found.allocation.sum() == pytest.approx(found.utilisation * CAPACITY, rel=1e-3)
    assert theory.burst_runaway(problem, 0.1, 20.0, hold_off=1.1 / rho, span=1.0) is None


def test_weights_of_agents_that_make_good_for_their_loss() -> None:
    loss = np.array([0.0, 0.2, 0.4])
    for share in (0.0, 0.3):
        known = theory.loss_weights(loss, share, loss)
        assert known == pytest.approx(np.full(3, known[0]))
        assert theory.loss_weights(loss, share, 0.0).tolist() == theory.loss_weights(loss, share).tolist()
    # On the clock s = 1 - 0.3 * 0.8 steps have no signal, and a belief of a half makes s / (s - 1/2) of it.
    s = 1.0 - 0.3 * 0.8
    assert theory.loss_weights(0.2, 0.3, 0.5) == pytest.approx(0.8 / s * s / (s - 0.5))


def test_elasticities_are_powers_less_one() -> None:
    costs = PolynomialCosts([2, 4], [[[1.0, 0.0]], [[0.0, 3.0]]])
    problem = Problem([resource(capacity=2.0)], costs)
    assert theory.elasticity(problem, [[0.3], [0.7]]) == pytest.approx(np.array([[1.0], [3.0]]))


def test_what_is_out_of_range_is_refused() -> None:
    one, three = squares(), smart_cameras(0)
    with pytest.raises(InputError, match="averaging"):
        theory.flow(one, 19.0, 10.0, object())  # type: ignore[arg-type]
    with pytest.raises(InputError, match="level"):
        theory.flow(one, 0.0, 10.0)
    with pytest.raises(InputError, match="increase"):
        theory.needed_rate(squares(np.linspace(0.01, 0.02, N)))
    with pytest.raises(InputError, match="present"):
        theory.churn(one, 10.0, 0.0)
    with pytest.raises(SimulationError, match="one signal takes too large a part"):
        theory.churn(squares(gamma=20.0), np.inf, 1.0)
    with pytest.raises(InputError, match="hold_off"):
        theory.burst_runaway(one, 0.1, 1.0, hold_off=0.0, span=1.0)
    with pytest.raises(InputError, match="allocation"):
        theory.elasticity(one, [[0.0]] * N)
    several: list[Any] = [
        lambda: theory.flow(three, 1.0, 1.0),
        lambda: theory.steady_total(three),
        lambda: theory.churn(three, 10.0, 1.0),
        lambda: theory.burst_runaway(three, 0.1, 1.0, hold_off=0.5, span=1.0),
    ]
    for call in several:
        with pytest.raises(InputError, match="number of resources"):
            call()
