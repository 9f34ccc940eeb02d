"""Loss that grows with the load: theory by hand, and runs on either side of the load that it names."""

from typing import Any

import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Crossing,
    Fleet,
    InputError,
    PolynomialCosts,
    Problem,
    Resource,
    Simulation,
)
from aimd_des.theory import congestion, needed_rate
from aimd_des.utils.validation import FloatArray
from scenarios.common.systems import memory_alone
from scenarios.congested_channel import (
    BEGIN,
    Constant,
    Excess,
    Holding,
    LoadLoss,
    Overflow,
    Silence,
    Stay,
    load,
    shares,
    stay,
)

# By Student's t with 7 degrees of freedom, beyond on one side once in 1,000.
Z = 4.8


def quadratic(power: int = 2) -> Problem:
    """Twenty agents alike, of which 5 signals per 2 periods hold the capacity."""
    memory = Resource("memory", capacity=20.0, increase=0.02, decrease=0.5, normalization=0.02)
    return Problem([memory], PolynomialCosts([power], [[[1.0]]] * 20))


def test_the_turning_load_and_the_rest_solve_the_two_balances() -> None:
    """Quadratic costs: (1 - p) l = rho r, and 1 - p = rho r / l."""
    problem = quadratic()
    needed = 0.3 * float(needed_rate(problem)[0])
    turning, rests = congestion(problem, Excess(0.2, 0.9), hold_off=0.3)
    # (1.8 - l) l = needed
    assert turning == pytest.approx(0.9 + np.sqrt(0.81 - needed))
    # 0.1 = needed / l
    assert list(rests) == pytest.approx([needed / 0.1])
    # Negative control: with another hold-off it is another load.
    assert congestion(problem, Excess(0.2, 0.9), hold_off=0.25).turning > turning + 0.01


@pytest.mark.parametrize(
    ("law", "hold_off"), [(Constant(0.2), 1.0), (Overflow(0.2), 1.0), (Excess(0.2, 0.6), 0.4)]
)
def test_demand_always_comes_back_where_enough_signals_pass(law: Constant, hold_off: float) -> None:
    assert congestion(memory_alone(), law, hold_off=hold_off) == (np.inf, ())


def test_there_is_no_way_back_to_a_capacity_that_signals_cannot_hold() -> None:
    """At the base loss alone signals do not suffice: demand rests above, as for a loss that is constant."""
    turning, rests = congestion(quadratic(), Constant(0.5), hold_off=1.0)
    needed = float(needed_rate(quadratic())[0])
    assert needed > 0.5
    assert turning == 1.0
    assert list(rests) == pytest.approx([needed / 0.5])


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="hold_off"):
        congestion(quadratic(), Constant(0.5), hold_off=0.0)
    with pytest.raises(InputError, match="highest"):
        congestion(quadratic(), Constant(0.5), hold_off=1.0, highest=1.0)


def test_runs_come_back_from_below_the_turning_load_and_not_from_beyond() -> None:
    """Three draws of the costs, silences that lift demand clearly to one side of it."""
    for hold_off, short, long in ((1.0, 3.0, 12.0), (0.5, 8.0, 19.0)):
        for draw in range(3):
            law = Excess(0.2, 0.95)
            turning = congestion(memory_alone(draw=draw), law, hold_off=hold_off).turning
            near, far = (
                load(Silence(law, hold_off, silence, after=200.0), draw, 1000 * draw)
                for silence in (short, long)
            )
            lifted, last = near
            assert lifted < turning - 0.05
            assert last < 1.1
            lifted, last = far
            assert lifted > turning + 0.1
            assert last > lifted  # it runs on
    # The run without the cause.
    assert load(Silence(Constant(0.2), 1.0, 12.0, after=200.0), 0, 0)[1] < 1.1


def test_escapes_are_counted_with_the_time_until_then() -> None:
    law = Excess(0.2, 0.95)
    assert congestion(memory_alone(), law, hold_off=1.4).turning == 1.0
    gone, time = stay(Stay(law, 1.4, 1.0, 400.0, 0.5), 0, 0)
    assert gone == 1.0
    assert 0.0 < time < 300.0
    # Negative control: the run without the cause stays for all of the time after the start.
    assert stay(Stay(Constant(0.2), 1.0, 1.0, 400.0, 0.5), 0, 0).tolist() == [0.0, 300.0]


def distances(own: bool) -> FloatArray:
    case = Holding(0.2, own, ends=(400.0, 1200.0))
    return np.array([shares(case, draw, 1000 * draw)[1] for draw in range(8)])


def test_loss_in_proportion_to_holdings_distorts_shares() -> None:
    """Paired with the same loss for all, over eight draws: 3 points farther from the optimum at least."""
    gap = distances(own=True) - distances(own=False)
    assert gap.mean() - Z * gap.std(ddof=1) / np.sqrt(len(gap)) > 0.03


def test_losses_that_read_the_run_are_the_same_with_processes_and_a_fleet() -> None:
    parts: dict[str, Any] = {"dynamics": "continuous", "control_unit": Crossing(0.5), "seed": 1}
    channel = BroadcastChannel(latency=1.0, loss=LoadLoss(Excess(0.2, 0.9)))
    runs = [
        Simulation(quadratic(), channel=channel, agents=agents, **parts).run(BEGIN)
        for agents in (AgentProcess, Fleet)
    ]
    assert runs[0].digest == runs[1].digest
    # Negative control: more is lost than by the base alone.
    base = BroadcastChannel(latency=1.0, loss=LoadLoss(Constant(0.2)))
    assert Simulation(quadratic(), channel=base, **parts).run(BEGIN).digest != runs[0].digest
