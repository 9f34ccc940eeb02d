"""What the study of answers to loss and delay is to show, at a reduced size."""

from typing import Any

import numpy as np
import pytest

from aimd_des import BroadcastChannel, Crossing, Fleet, Recording, Simulation
from aimd_des.study import mean_and_error
from aimd_des.theory import believed_loss
from scenarios.common.measure import run_draws
from scenarios.common.systems import critical, rate
from scenarios.common.tables import theory_of
from scenarios.robust_responses import LUCK, MEMORY, OFF, Answer, Drawn, answer, measure_late
from tests.conftest import quietly

# Four replications: by Student's t with 3 degrees of freedom a mean is so far off once in 200.
Z = 6.0
SEEDS = range(4)


def runs(unit: Crossing, channel: BroadcastChannel, until: float) -> list[Any]:
    recording = Recording(demand=[until])
    parts: dict[str, Any] = {"dynamics": "continuous", "agents": Fleet, "recording": recording}
    return [
        # Where demand runs away, responses saturate.
        quietly(
            Simulation(MEMORY, control_unit=unit, channel=channel, seed=seed, **parts).run,
            until,
        )
        for seed in SEEDS
    ]


def measured(unit: Crossing, until: float = 800.0, **channel: Any) -> tuple[Any, Any]:
    """Mean demand over capacity and bits per unit of time: means and standard errors."""
    rows = [run.summary().iloc[0] for run in runs(unit, BroadcastChannel(**channel), until)]
    return mean_and_error([[row["utilisation"], row["bits"] / until] for row in rows])


@pytest.mark.slow
def test_a_hold_off_that_adapts_saves_signals_under_latency_if_it_is_bounded() -> None:
    (short, its_bits), (error, _) = measured(Crossing(0.25), latency=8.0)
    (bounded, bits), (own, bits_error) = measured(Crossing(0.25, longest_hold_off=1.25), latency=8.0)
    assert 1.25 < 1 / rate(MEMORY) < 2.0
    assert bits + Z * bits_error < 0.65 * its_bits
    assert abs(bounded - 1.0) + Z * own < 0.1
    assert short + Z * error < 0.9
    # Negative control: one that may grow beyond 1 / rho saves more, and does not hold the capacity.
    (loose, fewer), (loose_error, _) = measured(Crossing(0.25, longest_hold_off=8.0), latency=8.0)
    assert fewer < 0.5 * bits
    assert loose - Z * loose_error > 1.5


@pytest.mark.slow
def test_a_hold_off_that_adapts_survives_as_much_loss_as_a_short_one() -> None:
    assert critical(MEMORY, 1.0) < 0.7 < critical(MEMORY, 0.25)
    for longest in (1.25, 8.0):
        (held, _), (error, _) = measured(Crossing(0.25, longest_hold_off=longest), loss=0.7)
        assert held + Z * error < 1.0
    (away, _), (error, _) = measured(Crossing(1.0), loss=0.7)
    assert away - Z * error > 1.3


@pytest.mark.slow
def test_numbers_that_wrap_around_leave_what_the_chain_says() -> None:
    """On the clock, draws 0 to 3 of the costs; half a point for the luck that is left is an allowance."""
    known, three = (
        [one for (one,) in outcomes]
        for way in ("known", "3 bits")
        for _, outcomes in run_draws(answer, [Answer("discrete", way, 10_000.0)], 4, 1, 0, quick=True)
    )
    gaps = [
        (one[LUCK][0] - other[LUCK][0], one[OFF][0] - one[theory_of(OFF)][0], one[OFF][0])
        for one, other in zip(three, known, strict=True)
    ]
    (luck, beside, off), errors = mean_and_error(gaps)
    assert luck < Z * errors[0] + 0.005
    assert abs(beside) < Z * errors[1] + 0.005
    assert max(np.mean([one[theory_of(OFF)] for one in known]), *(one["saturated"] for one in three)) < 1e-6
    # Negative control: as if nobody were ever mistaken, or nobody made good for anything.
    assert off - Z * errors[2] > 0.05
    nothing = answer(Answer("discrete", "nothing", 100.0), 0, 0)[theory_of(OFF)][0]
    assert off + Z * errors[2] < nothing - 0.05


def test_the_chain_by_hand() -> None:
    assert believed_loss(0.3, 8) == 0.3
    assert believed_loss(0.3, 5) == pytest.approx(0.3, abs=1e-6)
    assert believed_loss(0.0, 2) == pytest.approx(0.0)
    # Two bits, by the balance of the four states, 1 : p : p^2 : p^2.  Who hears the next number moves one
    # step on, who has lost one moves two; at p = 1/2 these are as many steps as signals heard.
    assert believed_loss(0.5, 2) == pytest.approx(0.0, abs=1e-12)
    assert believed_loss(1 / 3, 2) == pytest.approx(1 / 15, rel=1e-12)


@pytest.fixture(scope="module")
def late() -> dict[str, np.ndarray]:
    """Use, misallocation and time above of draws 0 to 3 of the costs, shape (draws, 3)."""
    cases = {
        "short": Drawn("", "", 0.0, Crossing(0.25), 8.0, 0.0, 3_000.0),
        "long": Drawn("", "", 0.0, Crossing(1.0), 8.0, 0.0, 3_000.0),
        "right": Drawn("", "", 0.0, Crossing(0.5), 1.0, 0.0, 3_000.0, safe=1.0),
        "wrong": Drawn("", "", 0.0, Crossing(0.5), 1.2, 0.0, 3_000.0, safe=1.0),
    }
    found = run_draws(measure_late, list(cases.values()), 4, 1, 0, quick=True)
    return {
        name: np.array([(one["used"], one[OFF], one["above"]) for (one,) in runs])
        for name, (_, runs) in zip(cases, found, strict=True)
    }


@pytest.mark.slow
def test_a_hold_off_that_is_short_against_the_latency_is_not_the_safe_one(
    late: dict[str, np.ndarray],
) -> None:
    used, error = mean_and_error(late["short"].tolist())
    assert used[0] + Z * error[0] < 0.9
    # Paired draws: the shares of the longer one are as right as noise leaves them.
    worse, error = mean_and_error((late["short"] - late["long"]).tolist())
    assert worse[1] - Z * error[1] > 0.02


@pytest.mark.slow
def test_a_safe_threshold_bears_no_longer_latency(late: dict[str, np.ndarray]) -> None:
    right, error = mean_and_error(late["right"].tolist())
    assert right[2] < 0.01 + Z * error[2]
    wrong, error = mean_and_error(late["wrong"].tolist())
    assert wrong[2] - Z * error[2] > 0.02
