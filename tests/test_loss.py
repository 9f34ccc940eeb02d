"""Every model of loss loses the share that it says, in bursts as long as it says.

Statistical tests state seed and sample size.  Links are independent, so a statistic has the error
that its formula gives for one link, over the square root of their number; counts of transitions are
binomial given how often they were possible.  A right model misses a bound of 4 standard errors for
one seed in 16,000.
"""

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from aimd_des import SimulationError
from aimd_des.channel import BroadcastChannel, Draws
from aimd_des.loss import Bernoulli, Combined, CommonMode, GilbertElliott, Loss, Trace
from aimd_des.utils import rng
from aimd_des.utils.rng import Purpose
from aimd_des.utils.validation import FloatArray
from tests.conftest import refusal

SEED, LINKS = 47, 2000


def draws(n: int, number: int = 0, time: float = 0.0, resource: int = 0, seed: int = SEED) -> Draws:
    """The random numbers of one broadcast, none but those for loss."""
    return Draws({Purpose.LOSS: rng.key(seed, Purpose.LOSS)}, resource, number, time, n)


def losses(loss: Loss, n: int, times: Iterable[float], seed: int = SEED) -> Any:
    """What n agents lose of broadcasts for one resource at some times, shape (times, n)."""
    process = loss.start(n)
    return np.array([process.draw(draws(n, b, float(time), seed=seed)) for b, time in enumerate(times)])


def binomial_score(successes: int, trials: int, probability: float) -> float:
    """Deviation of a count in standard errors."""
    return (successes - trials * probability) / math.sqrt(trials * probability * (1.0 - probability))


# Independent losses.


def test_bernoulli_loses_its_share() -> None:
    lost = losses(Bernoulli(0.3), 1000, range(200))
    assert abs(binomial_score(lost.sum(), lost.size, 0.3)) <= 4.0
    assert abs(binomial_score(lost.sum(), lost.size, 0.31)) > 4.0
    # Nor has a loss to do with the one before it, or with that of the next agent.
    for after in (lost[1:][lost[:-1]], lost[:, 1:][lost[:, :-1]]):
        assert abs(binomial_score(after.sum(), after.size, 0.3)) <= 4.0


def test_certain_losses_are_certain() -> None:
    for loss in (Bernoulli, CommonMode):
        assert not losses(loss(0.0), 100, range(100)).any()
        assert losses(loss(1.0), 100, range(100)).all()
    assert not losses(GilbertElliott(0.0, 1.0), 100, range(100)).any()


def test_common_mode_loses_whole_broadcasts() -> None:
    lost = losses(CommonMode(0.3), 5, range(20_000))
    assert np.array_equal(lost.any(axis=1), lost.all(axis=1))
    assert abs(binomial_score(lost[:, 0].sum(), len(lost), 0.3)) <= 4.0
    assert abs(binomial_score(lost[:, 0].sum(), len(lost), 0.32)) > 4.0
    after = lost[1:, 0][lost[:-1, 0]]
    assert abs(binomial_score(after.sum(), after.size, 0.3)) <= 4.0


# Bursts.

# Mean loss, mean burst, and the time between broadcasts.
BURSTS = [(0.2, 2.5, 0.5), (0.05, 1.0, 0.2), (0.7, 4.0, 1.0)]


def memory(loss: float, burst: float, gap: float) -> float:
    """Autocorrelation of a link's state, exp(-(a + b) * gap)."""
    return math.exp(-gap / (burst * (1.0 - loss)))


def mean_score(lost: FloatArray, loss: float, rho: float) -> float:
    """Deviation of the share of losses, in standard errors of a chain that forgets by rho at each step."""
    steps, links = lost.shape
    correlated = (1.0 + rho) / (1.0 - rho) - 2.0 * rho * (1.0 - rho**steps) / (steps * (1.0 - rho) ** 2)
    return float((lost.mean() - loss) / math.sqrt(loss * (1.0 - loss) * correlated / steps / links))


def persistence_scores(lost: FloatArray, loss: float, rho: float) -> tuple[float, float]:
    """Deviations of how often loss follows loss, and how often it follows none."""
    before, after = lost[:-1], lost[1:]
    return (
        binomial_score(after[before].sum(), before.sum(), loss + (1.0 - loss) * rho),
        binomial_score(after[~before].sum(), (~before).sum(), loss * (1.0 - rho)),
    )


def first_bursts(lost: FloatArray) -> FloatArray:
    """Length of the first burst of every link that begins and ends within the record."""
    lengths = []
    for link in lost.T:
        starts = np.flatnonzero(link[1:] & ~link[:-1]) + 1
        ends = np.flatnonzero(~link[starts[0] :]) if len(starts) else []
        if len(ends):
            lengths.append(ends[0])
    return np.array(lengths)


@pytest.mark.parametrize(("loss", "burst", "gap"), BURSTS)
def test_bursts_have_the_mean_loss_and_the_memory_of_the_chain(loss: float, burst: float, gap: float) -> None:
    model, rho = GilbertElliott(loss, burst), memory(loss, burst, gap)
    lost = losses(model, LINKS, np.arange(400) * gap)
    assert model.mean == loss
    assert abs(mean_score(lost, loss, rho)) <= 4.0
    assert np.abs(persistence_scores(lost, loss, rho)).max() <= 4.0
    # The tests see another loss, another burst, and losses without memory.
    others = losses(GilbertElliott(loss, 1.2 * burst), LINKS, np.arange(400) * gap)
    assert np.abs(persistence_scores(others, loss, rho)).max() > 4.0
    assert (
        abs(mean_score(losses(GilbertElliott(1.1 * loss, burst), LINKS, np.arange(400) * gap), loss, rho)) > 4
    )
    assert np.abs(persistence_scores(losses(Bernoulli(loss), LINKS, range(400)), loss, rho)).max() > 4.0


@pytest.mark.parametrize(("loss", "burst", "gap"), BURSTS)
def test_runs_of_lost_broadcasts_are_geometric(loss: float, burst: float, gap: float) -> None:
    stays = loss + (1.0 - loss) * memory(loss, burst, gap)
    # So long that a record without a whole burst has a chance below 1e-9.
    begins, ends = loss * (1.0 - memory(loss, burst, gap)), 1.0 - stays
    steps = int(40.0 / begins + 40.0 / ends)
    lengths = first_bursts(losses(GilbertElliott(loss, burst), LINKS, np.arange(steps) * gap))
    assert len(lengths) == LINKS
    error = math.sqrt(stays) / (1.0 - stays) / math.sqrt(LINKS)
    assert abs(lengths.mean() - 1.0 / (1.0 - stays)) / error <= 4.0
    law = stats.geom(1.0 - stays)
    # Bins of at least 20 expected bursts.
    edges = np.unique(law.ppf(np.linspace(0.0, 1.0, 21)[1:-1]))
    edges = edges[LINKS * law.sf(edges) >= 20.0]
    expected = LINKS * np.diff([0.0, *law.cdf(edges), 1.0])
    counts = np.diff([0, *(np.sum(lengths <= edge) for edge in edges), LINKS])
    assert stats.chisquare(counts, expected).pvalue > 6e-5
    without = first_bursts(losses(Bernoulli(loss), LINKS, range(400)))
    assert abs(without.mean() - 1.0 / (1.0 - stays)) / error > 4.0


def test_bursts_and_gaps_are_as_long_as_they_say() -> None:
    # A link is looked at 50 times in a burst, so that hardly any visit to a state is missed: with a
    # mean duration T it ends between two looks with probability gap / T, up to 2 %.
    loss, burst, gap = 0.3, 2.0, 0.04
    model = GilbertElliott(loss, burst)
    lost = losses(model, 500, np.arange(3000) * gap)
    for bad, duration, other in ((True, burst, 1.0 - loss), (False, model.mean_gap, loss)):
        looks = int(np.sum(lost[:-1] == bad))
        ends = int(np.sum(lost[1:][lost[:-1] == bad] != bad))
        probability = other * (1.0 - memory(loss, burst, gap))
        assert gap / probability == pytest.approx(duration, rel=0.02)
        assert abs(binomial_score(ends, looks, probability)) <= 4.0
        assert abs(binomial_score(ends, looks, 1.1 * probability)) > 4.0
    assert model.mean_gap == pytest.approx(burst * (1.0 - loss) / loss, rel=1e-14)
    assert model.rate == pytest.approx(1.0 / burst + 1.0 / model.mean_gap, rel=1e-14)


def test_only_elapsed_time_counts_not_how_often_a_link_is_used() -> None:
    # Random gaps: the state after a gap h correlates by exp(-(a + b) h) with the state before.
    loss, burst = 0.25, 1.5
    gaps = np.random.default_rng(5).choice([0.0, 0.1, 0.7, 3.0], size=400)
    lost = losses(GilbertElliott(loss, burst), LINKS, np.concatenate([[0.0], np.cumsum(gaps)]))
    for gap in (0.1, 0.7, 3.0):
        where = np.flatnonzero(gaps == gap)
        before, after = lost[where], lost[where + 1]
        rho = memory(loss, burst, gap)
        assert abs(binomial_score(after[before].sum(), before.sum(), loss + (1.0 - loss) * rho)) <= 4.0
        assert abs(binomial_score(after[~before].sum(), (~before).sum(), loss * (1.0 - rho))) <= 4.0
        # And two gaps are as good as their sum, whatever was asked in between; pairs must not overlap
        # for their count to be binomial.
        pairs = 2 * np.flatnonzero((gaps[::2] == gap) & (gaps[1::2] == gap))
        before, after = lost[pairs], lost[pairs + 2]
        twice = loss + (1.0 - loss) * rho**2
        assert abs(binomial_score(after[before].sum(), before.sum(), twice)) <= 4.0
    same = np.flatnonzero(gaps == 0.0)
    assert np.array_equal(lost[same], lost[same + 1])


def test_a_run_begins_with_links_as_they_are_in_the_long_run() -> None:
    for time in (0.0, 1e6):
        lost = GilbertElliott(0.2, 5.0).start(100_000).draw(draws(100_000, time=time))
        assert abs(binomial_score(int(lost.sum()), 100_000, 0.2)) <= 4.0


def test_the_state_of_a_link_is_one_for_all_resources() -> None:
    process = GilbertElliott(0.3, 2.0).start(200)
    for step in range(50):
        rows = [process.draw(draws(200, step, 0.5 * step, resource)) for resource in range(3)]
        assert np.array_equal(rows[0], rows[1])
        assert np.array_equal(rows[0], rows[2])


def test_far_apart_broadcasts_are_lost_like_independent_ones() -> None:
    times = 1e6 * np.arange(50)
    for loss in (0.1, 0.3, 1.0 / 3.0):
        assert np.array_equal(
            losses(GilbertElliott(loss, 1.0), 60, times), losses(Bernoulli(loss), 60, times)
        )


def test_bursts_refuse_broadcasts_out_of_order() -> None:
    process = GilbertElliott(0.3, 2.0).start(5)
    process.draw(draws(5, 0, 2.0))
    with pytest.raises(SimulationError, match=r"time 1\.5, resource 1: .* at 2\.0"):
        process.draw(draws(5, 0, 1.5, 1))


def test_the_rate_and_the_gap_have_limits() -> None:
    assert GilbertElliott(0.0, 2.0).mean_gap == math.inf
    assert GilbertElliott(0.0, 2.0).rate == 0.5
    model = GilbertElliott([0.0, 0.5], 2.0)
    assert np.array_equal(model.mean_gap, [math.inf, 2.0])
    assert np.array_equal(model.rate, [0.5, 1.0])


# Several causes.


def test_combined_losses_are_independent() -> None:
    model = Combined(Bernoulli(0.5), Bernoulli(0.5), CommonMode(0.2))
    assert model.mean == pytest.approx(1.0 - 0.5 * 0.5 * 0.8, rel=1e-15)
    lost = losses(Combined(0.5, 0.5), 1000, range(100))
    assert abs(binomial_score(lost.sum(), lost.size, 0.75)) <= 4.0
    # Were the numbers shared, both would lose the same copies.
    assert abs(binomial_score(losses(Bernoulli(0.5), 1000, range(100)).sum(), lost.size, 0.75)) > 4.0


def test_combined_losses_are_those_of_any_part() -> None:
    times = 0.3 * np.arange(3000)
    burst, common = GilbertElliott(0.2, 2.0), CommonMode(0.1)
    lost = losses(Combined(burst, common, 0.05), 100, times)
    assert (lost >= losses(burst, 100, times)).all(), "the first part draws what it draws alone"
    whole = lost.all(axis=1)
    # Without a common cause, 100 links hardly ever lose the same broadcast. The memory of bursts is
    # diluted by what is lost without memory, so the error below is an upper bound.
    assert abs(binomial_score(int(whole.sum()), len(whole), 0.1)) <= 4.0
    rest = lost[~whole]
    rho = memory(0.2, 2.0, 0.3)
    assert abs((rest.mean() - 0.24) / math.sqrt(0.24 * 0.76 * (1 + rho) / (1 - rho) / rest.size)) <= 4.0


def test_combined_within_combined_is_flat() -> None:
    nested = Combined(Combined(0.1, CommonMode(0.2)), Combined(GilbertElliott(0.3, 1.0)))
    flat = Combined(0.1, CommonMode(0.2), GilbertElliott(0.3, 1.0))
    assert len(nested.losses) == 3
    assert np.array_equal(losses(nested, 30, range(50)), losses(flat, 30, range(50)))


def test_combined_mean_is_for_each_agent_where_a_part_is() -> None:
    model = Combined([0.1, 0.5], CommonMode(0.5), Trace([0, 1, 1, 1], repeat=True))
    assert model.mean == pytest.approx([0.8875, 0.9375], rel=1e-15)
    assert "two traces" in refusal(lambda: Combined(*[Trace([0, 1], repeat=True)] * 2).mean)

    class Silent:
        def start(self, n_agents: int) -> Any:
            return Bernoulli(0.0).start(n_agents)

    assert "Silent has no attribute `mean`" in refusal(lambda: Combined(0.1, Silent()).mean)
    assert not losses(Combined(0.0, Silent()), 3, range(5)).any()


def test_combined_losses_keep_every_memory_up() -> None:
    # A trace counts broadcasts that another part has lost, too.
    trace = Trace([0, 0, 0, 1, 0], repeat=False)
    assert losses(Combined(trace, 0.0), 2, range(5))[:, 0].tolist() == [0, 0, 0, 1, 0]
    assert losses(Combined(1.0, trace), 2, range(5)).all()


# Records.

RECORD = [[0, 1, 0], [1, 1, 0]]


def test_a_trace_is_read_row_by_row_over_all_resources() -> None:
    process = Trace(RECORD, repeat=True).start(3)
    rows = [process.draw(draws(3, step // 2, step, step % 2)).tolist() for step in range(5)]
    assert rows == [*RECORD, *RECORD, RECORD[0]]
    # Another run begins at the first row.
    assert Trace(RECORD, repeat=True).start(3).draw(draws(3)).tolist() == RECORD[0]


def test_a_trace_for_all_holds_for_any_number_of_agents() -> None:
    model = Trace(np.array([True, False]), repeat=True)
    assert losses(model, 4, range(3)).tolist() == [[True] * 4, [False] * 4, [True] * 4]
    assert model.mean == 0.5
    assert np.array_equal(Trace(RECORD, repeat=False).mean, [0.5, 1.0, 0.0])


def test_a_trace_that_ends_says_what_to_change() -> None:
    process = Trace([0, 1], repeat=False).start(3)
    for step in range(2):
        process.draw(draws(3, step, float(step)))
    with pytest.raises(
        SimulationError, match=r"time 7\.5, resource 1: broadcast 2 .* trace of 2; .*repeat=True"
    ):
        process.draw(draws(3, 0, 7.5, 1))


def test_a_trace_cannot_be_changed_afterwards() -> None:
    record = np.array([True, False])
    model = Trace(record, repeat=True)
    record[0] = False
    assert losses(model, 1, range(2)).tolist() == [[True], [False]]
    with pytest.raises(ValueError, match="read-only"):
        model.lost[0] = False


def test_traces_are_read_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "losses.csv"
    path.write_text("first,second\n0,TRUE\n1, false\n1,0\n", encoding="utf-8")
    both = [[False, True], [True, False], [True, False]]
    assert Trace.from_csv(path, repeat=True).lost.tolist() == both
    swapped = Trace.from_csv(str(path), ["second", "first"], repeat=False)
    assert swapped.lost.tolist() == [row[::-1] for row in both]
    assert Trace.from_csv(path, "first", repeat=True).lost.tolist() == [False, True, True]
    path.write_text("lost\n0\n1\n", encoding="utf-8")
    assert Trace.from_csv(path, repeat=True).lost.tolist() == [False, True]
    path.write_text("first\n0\n2\n", encoding="utf-8")
    message = refusal(lambda: Trace.from_csv(path, repeat=True))
    assert message == f"{path}: column 'first', row 2 = '2': must be 0 or 1, false or true"
    assert "did you mean 'first'?" in refusal(lambda: Trace.from_csv(path, ["fist"], repeat=True))


# What all have in common.

MODELS: dict[str, Loss] = {
    "bernoulli": Bernoulli(0.3),
    "common mode": CommonMode(0.3),
    "bursts": GilbertElliott(0.3, 2.0),
    "combined": Combined(GilbertElliott(0.3, 2.0), CommonMode(0.1), 0.1),
    "trace": Trace([0, 1, 1, 0, 1], repeat=True),
}


@pytest.mark.parametrize("name", MODELS)
def test_losses_do_not_depend_on_how_many_agents_there_are(name: str) -> None:
    many = losses(MODELS[name], 203, 0.7 * np.arange(40))
    for n in (1, 2, 7, 60):
        assert np.array_equal(losses(MODELS[name], n, 0.7 * np.arange(40)), many[:, :n])


@pytest.mark.parametrize("name", MODELS)
def test_a_run_starts_afresh_and_a_seed_gives_it_again(name: str) -> None:
    first, again = (losses(MODELS[name], 30, range(40)) for _ in range(2))
    assert np.array_equal(first, again)
    if name != "trace":
        assert not np.array_equal(first, losses(MODELS[name], 30, range(40), seed=SEED + 1))


@pytest.mark.parametrize(
    "build", [Bernoulli, lambda loss: GilbertElliott(loss, 1.5), lambda loss: Combined(loss, CommonMode(0.1))]
)
def test_each_agent_has_its_own_parameters_and_nobody_elses(build: Callable[[Any], Loss]) -> None:
    shares = [0.0, 0.2, 0.9]
    together = losses(build(shares), 3, range(60))
    for agent, share in enumerate(shares):
        assert np.array_equal(together[:, agent], losses(build(share), 3, range(60))[:, agent])
        assert build(shares).mean[agent] == build(share).mean


def test_bursts_of_each_agent_have_their_own_duration() -> None:
    durations = [0.1, 1.0, 10.0]
    together = losses(GilbertElliott(0.4, durations), 3, range(60))
    for agent, duration in enumerate(durations):
        assert np.array_equal(
            together[:, agent], losses(GilbertElliott(0.4, duration), 3, range(60))[:, agent]
        )


# Written down on x86-64. A machine on which one of them differs gives other runs for the same seed.
FORTIETH_LOSSES = {
    "bernoulli": "20016a02001db040",
    "bursts": "a5002a8200091052",
    "combined": "a5042a920009705a",
}


@pytest.mark.parametrize("name", FORTIETH_LOSSES)
def test_losses_are_the_same_on_every_machine(name: str) -> None:
    lost = losses(MODELS[name], 64, 0.7 * np.arange(40))[-1]
    assert np.packbits(lost).tobytes().hex() == FORTIETH_LOSSES[name]


@pytest.mark.parametrize(
    ("build", "start"),
    [
        (lambda: Bernoulli(1.5), "loss = 1.5: must be a finite number at least 0 and at most 1"),
        (lambda: Bernoulli([0.1, -1]), "loss[1] = -1.0: must be"),
        (lambda: BroadcastChannel(loss=-0.5), "loss = -0.5: must be"),
        (lambda: Bernoulli([0.1, 0.2]).start(3), "shape of loss = (2,): must be (3,)"),
        (lambda: CommonMode(1.5), "CommonMode.probability = 1.5: must be"),
        (lambda: CommonMode([0.1, 0.2]), "CommonMode.probability = [0.1, 0.2]: must be"),
        (
            lambda: GilbertElliott(1.0, 1),
            "GilbertElliott.mean_loss = 1.0: must be a finite number at least 0 and",
        ),
        (lambda: GilbertElliott([0.1, -1], 1), "GilbertElliott.mean_loss[1] = -1.0: must be"),
        (lambda: GilbertElliott(0.1, 0), "GilbertElliott.mean_burst = 0.0: must be"),
        (lambda: GilbertElliott(0.1, math.inf), "GilbertElliott.mean_burst = inf: must be"),
        (lambda: GilbertElliott([0.1], [1, 2]), "shape of GilbertElliott.mean_burst = (2,): must be (1,)"),
        (lambda: GilbertElliott([0.1], 1).start(2), "shape of GilbertElliott.mean_loss = (1,): must be (2,)"),
        (Combined, "Combined.losses = (): must be at least one model of loss"),
        (lambda: Combined(0.1, 2), "loss = 2.0: must be"),
        (lambda: Combined(0.1, [0.1, 0.2]).start(3), "shape of loss = (2,): must be (3,)"),
        (
            lambda: Trace([], repeat=True),
            "shape of Trace.lost = (0,): must be (n_rows,) or (n_rows, n_agents)",
        ),
        (lambda: Trace(1, repeat=True), "Trace.lost = 1: must be an array of bools"),
        (lambda: Trace([[0], [0, 1]], repeat=True), "Trace.lost = [[0], [0, 1]]: must be an array of bools"),
        (lambda: Trace(["a"], repeat=True), "Trace.lost = ['a']: must be an array of bools"),
        (lambda: Trace([[0, 1], [2, 0]], repeat=True), "Trace.lost[1, 0] = 2: must be False or True, 0 or 1"),
        (lambda: Trace([0, math.nan], repeat=True), "Trace.lost[1] = nan: must be"),
        (lambda: Trace([0, 1], repeat=2), "Trace.repeat = 2: must be True or False"),
        (lambda: Trace(RECORD, repeat=True).start(2), "shape of Trace.lost = (2, 3): must be (2, 2)"),
    ],
)
def test_bad_parameters_are_refused_by_name(build: Callable[[], object], start: str) -> None:
    assert refusal(build).startswith(start)


def test_a_trace_does_not_decide_by_itself_what_comes_after_it() -> None:
    with pytest.raises(TypeError, match="repeat"):
        Trace([0, 1])
