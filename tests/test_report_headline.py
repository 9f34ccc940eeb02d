"""The first sentence of a report is what is so: a run that cannot be judged says why, and is not judged."""

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from aimd_des.report.boundaries import boundary_words
from aimd_des.report.headline import Headline, Settling, headline
from aimd_des.report.study_axes import Along
from aimd_des.report.verdicts import run_verdicts
from aimd_des.scenario.run_folder import Number, StoredRun

NOTHING = Settling({}, {})
GOOD: dict[str, Number] = {
    "signals": 1000,
    "delivered": 4000,
    "lost": 1000,
    "in_flight": 0,
    "responses": 2000,
    "saturated": 0,
    "utilisation": 0.975,
    "misallocation": 0.024,
    "cost_ratio": 0.94,
    "overshoot_peak": 1.12,
    "overshoot_time": 0.5,
    "overshoot_mean": 0.01,
}


def stored(
    until: float = 5000.0, run_away: tuple[str, ...] = (), left: float | None = None, **rows: Any
) -> StoredRun:
    """A run of which only the measures are known: GOOD but for what is given of each resource."""
    measures = {name: {**GOOD, **changes} for name, changes in rows.items()}
    return StoredRun(Path("run"), {"until": until}, "", {}, measures, None, run_away, unsettled=left)


def said(run: StoredRun, settling: Settling = NOTHING) -> Headline:
    return headline(run, settling)


def test_a_run_that_holds_its_capacities_is_told_by_use_shares_and_peak() -> None:
    found = said(stored(memory={"utilisation": 0.9906}, bandwidth={"utilisation": 1.011}))
    assert found.sentence == (
        "Mean demand is 0.94 % below the capacity of memory and 1.1 % above that of bandwidth, and what is"
        " used is shared with an error of 2.4 % and 2.4 %."
    )
    assert found.more == "Peak demand is 112 % of memory and 112 % of bandwidth."
    assert found.judged


@pytest.mark.parametrize(
    ("ratio", "far"), [(0.94, "6 % below"), (1.0004, "0.04 % above"), (1.0, "at"), (219.06, "219 times")]
)
def test_the_cost_is_held_against_that_of_the_optimum(ratio: float, far: str) -> None:
    run = stored(memory={"cost_ratio": ratio})
    (utilisation, *_) = run_verdicts(run, said(run), NOTHING)
    assert utilisation.words == f"The total cost is {far} that of the optimum for all of the capacity."


@pytest.mark.parametrize(
    ("band", "words"),
    [
        ((0.01, 0.05), ", as theory expects at this length."),
        ((0.01, 0.02), ", more than theory expects for memory."),
        ((0.03, 0.05), ", no more than theory expects at this length."),
    ],
)
def test_shares_are_held_against_theory(band: tuple[float, float], words: str) -> None:
    assert said(stored(memory={}), Settling({}, {"memory": band})).sentence.endswith(words)


def test_a_run_that_never_reached_its_capacity_says_so_and_judges_nothing() -> None:
    short = {"signals": 0, "overshoot_time": 0.0}
    run = stored(
        25.0, (), 1.0, memory={**short, "overshoot_peak": 0.625}, disk={**short, "overshoot_peak": 0.8}
    )
    found = said(run)
    assert found.sentence == (
        "Demand never reached the capacity in 25 units of time: it peaked at 62.5 % of memory and 80 % of"
        " disk. No signal was sent, so the run says nothing of use and shares."
    )
    assert (
        found.more == "At the growth so far it takes about 40 units of time until all capacities are reached."
    )
    (card,) = run_verdicts(run, found, NOTHING)
    assert (card.name, card.words) == ("Peak demand", "The capacity was never reached.")


def test_one_resource_that_was_never_reached_is_named_first() -> None:
    found = said(stored(memory={}, disk={"signals": 0, "overshoot_peak": 0.5}))
    assert found.sentence == "Demand for disk never reached its capacity: it peaked at 50 % of disk."
    assert found.more == (
        "No signal was sent for it, so nothing is said of its use and shares. Peak demand is 112 % of memory."
    )
    assert not found.judged


def test_a_run_without_a_signal_says_what_demand_did() -> None:
    silent = said(stored(memory={"signals": 0, "overshoot_peak": 2.5}))
    assert silent.sentence == (
        "No signal was sent for memory, and nothing held demand: it peaked at 250 % of the capacity of"
        " memory."
    )
    unheard = said(stored(memory={"delivered": 0}))
    assert unheard.sentence.startswith("No copy of a signal for memory arrived, and nothing held demand")
    rare = said(stored(memory={"signals": 1, "overshoot_time": 0.9, "overshoot_peak": 15.0}))
    assert rare.sentence.startswith("Signals were as few as 1 for memory, and nothing held demand")


def test_only_the_criterion_of_the_warning_says_that_demand_has_run_away() -> None:
    high = {"utilisation": 1.3, "overshoot_peak": 3.0}
    assert "run away" not in said(stored(memory=high)).sentence
    found = said(stored(run_away=("memory",), memory=high, disk={}))
    assert found.sentence == (
        "Demand has run away from the capacity of memory: mean demand is 130 % of the capacity."
    )
    assert found.more == "20 % of the copies of signals were lost."


def test_answers_that_are_cut_off_are_said_first() -> None:
    found = said(stored(memory={"saturated": 1600}))
    assert found.sentence == (
        "Answers are saturated: the probability of 80 % of the responses for memory was above 1, and was cut"
        " off."
    )
    assert not found.judged
    assert said(stored(memory={"saturated": 19})).judged


def test_a_run_too_short_to_have_settled_says_what_tells() -> None:
    by_theory = said(stored(left=0.34, memory={}), Settling({"memory": 0.0}, {}))
    assert by_theory.sentence == (
        "The run is too short to have settled: by theory 34 % of the deviation that decays most slowly is"
        " left at its end."
    )
    measured = said(stored(memory={}), Settling({"memory": 0.15}, {}))
    assert measured.sentence == (
        "The run is too short to have settled: in its second half the averages have still moved by 15 % of"
        " the capacity of memory."
    )
    assert said(stored(memory={}), Settling({"memory": 0.02}, {})).judged
    # Where theory knows, a sum that still moves is no sign: averages forget, or disturbances are over.
    assert said(stored(left=0.01, memory={}), Settling({"memory": 0.15}, {})).judged
    few = said(stored(memory={"signals": 3}))
    assert "the signals are too few (3 for memory)" in few.sentence
    cards = run_verdicts(stored(memory={}), measured, NOTHING)
    assert [card.words for card in cards[:2]] == ["", ""]


def test_of_many_resources_the_span_is_said() -> None:
    rows = {f"r{k}": {"utilisation": 0.95 + 0.02 * k} for k in range(4)}
    found = said(stored(**rows))
    assert found.sentence.startswith("Mean demand is 5 % below to 1 % above the capacities, and")
    (utilisation, *_) = run_verdicts(stored(**rows), found, NOTHING)
    assert utilisation.numbers == [("95 %", "r0, the lowest"), ("101 %", "r3, the highest")]


# -- boundaries of a study ---------------------------------------------------------------------------------

LOSS = Along("loss", ("0", "0.2", "0.4"), (0.0, 0.2, 0.4), joined=True)
LATENCY = Along("latency", ("0", "5"), (0.0, 5.0), joined=True)


def series(**means: list[float]) -> pd.DataFrame:
    """Means along the loss, a series for each latency."""
    rows = [
        {"i0": k, "i1": place, "resource": "memory", "mean": mean}
        for place, (_, values) in enumerate(means.items())
        for k, mean in enumerate(values)
    ]
    return pd.DataFrame(rows)


def test_boundaries_lie_between_the_values_where_means_pass_the_limit() -> None:
    rows = series(none=[0.9, 1.02, 1.4], five=[0.9, 1.0, 1.3])
    assert boundary_words(rows, [LOSS, LATENCY], 1.01) == (
        "Along loss it rises above 101 % between 0 and 0.2 (latency 0) at the earliest, and between 0.2 and"
        " 0.4 (latency 5) at the latest."
    )
    once = series(none=[0.9, 1.0, 1.4], five=[0.9, 1.0, 1.0])
    assert boundary_words(once, [LOSS, LATENCY], 1.01) == (
        "Along loss it rises above 101 % between 0.2 and 0.4 (latency 0), in 1 of 2 series."
    )
    assert boundary_words(series(none=[0.9, 0.9, 1.0]), [LOSS], 1.01) == "It is at most 101 % everywhere."
    assert boundary_words(series(none=[1.2, 1.3, 1.4]), [LOSS], 1.01) == "It is above 101 % everywhere."


def test_cells_of_a_map_end_half_way_between_values() -> None:
    lows, highs = Along("loss", ("a", "b", "c"), (0.0, 4.0, 1.0), joined=True).edges
    assert lows == (-0.5, 2.5, 0.5)
    assert highs == (0.5, 5.5, 2.5)
