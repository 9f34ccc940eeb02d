"""What the comparison of responses is to show, at a reduced size."""

import numpy as np
import pytest

from aimd_des import BroadcastChannel, Crossing, Fleet, Recording, Simulation
from aimd_des.responses import Derandomised
from aimd_des.study import mean_and_error
from models.smart_cameras import smart_cameras
from scenarios.responses import _cuts, _Size, measure, observe

# Three draws of the costs: by Student's t with 2 degrees of freedom a mean is so far off once in 100.
Z = 10.0
SEEDS = range(3)
SIZE = _Size(len(SEEDS), until=1000.0, change=300.0, watched=200.0, cuts=(1, 10))


def test_an_observer_reads_demand_and_share_of_fractional_cuts_from_the_log() -> None:
    """Every cut takes (1 - beta) lambda of the demand; demand after the last one grows to that at the end."""
    simulation = Simulation(
        smart_cameras(0),
        dynamics="continuous",
        control_unit=Crossing(0.5),
        channel=BroadcastChannel(latency=0.5),
        agents=Fleet,
        response=Derandomised("events"),
        recording=Recording(events=True),
        seed=0,
    )
    result = simulation.run(80.0)
    problem = result.problem
    cuts = _cuts(result.events, problem, 60.0)
    one = cuts[(cuts["i"] == 4) & (cuts["j"] == 0)]
    assert one["cuts"].tolist() == list(range(1, len(one) + 1)) == one["heard"].tolist()
    assert set(cuts["i"] % 2) == {0}
    last, before = one.iloc[-1], one["found"].iloc[0]
    grown = problem.increase[4, 0] * (80.0 - one["time"].iloc[0])
    assert result.demand_at_end[4, 0] == pytest.approx(before + grown - one["value"].sum(), rel=1e-9)
    assert 0.0 < last["share"] < 1.0 - problem.decrease[4, 0]


@pytest.mark.slow
def test_one_fractional_cut_tells_more_than_ten_drawn_ones() -> None:
    (fractional, its_error), (drawn, error) = (
        mean_and_error([observe(response, SIZE, seed) for seed in SEEDS])
        for response in ("fractional cuts", "event-normalised")
    )
    none, one, ten = range(3)
    assert (fractional[one] + Z * its_error[one] < drawn[ten] - error[ten]).all()
    # Negative control: who sees no cut takes the derivative for what it was, which is twice as much.
    assert (np.abs(fractional[none] - 100.0) < 10.0 + Z * its_error[none]).all()


@pytest.mark.slow
def test_fractional_cuts_are_nearer_and_keep_the_total_higher() -> None:
    paper, fractional = (
        [measure(response, "continuous", SIZE, seed) for seed in SEEDS]
        for response in ("the paper's", "fractional cuts")
    )
    for ours, theirs in zip(fractional, paper, strict=True):
        assert (ours["misallocation"] < theirs["misallocation"]).all()
        assert (ours["low"] > theirs["low"]).all()
        assert ours["high"] == pytest.approx(theirs["high"], abs=0.005)
