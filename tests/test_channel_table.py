"""The compiled channel is held against the same models drawn one by one from Python, to the last bit."""

import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import pytest

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Fleet,
    InputError,
    Recording,
    Simulation,
    SimulationError,
    latency,
    loss,
    topology,
)
from aimd_des.channel import Broadcast, CompiledLink, Draws, Link
from aimd_des.channel.latency import own_latency
from aimd_des.channel.transmit_kernel import transmit
from aimd_des.lowlevel import exp, exps, log, logs, lost_table, quantile_table
from aimd_des.utils import rng
from aimd_des.utils.rng import Purpose
from aimd_des.utils.validation import FloatArray
from tests.conftest import assert_same_run, random_problem

N = 7
KEYS = {purpose: rng.key(3, purpose) for purpose in Purpose}
EACH = np.linspace(0.0, 0.9, N)
RECORD = np.arange(3 * N).reshape(3, N) % 2


@numba.njit
def weibull(u: float, scale: float, power: float) -> float:
    """A quantile of a user's."""
    return scale * exp(log(0.0 - log(1.0 - u)) * power)


@dataclass(frozen=True, eq=False)
class Weibull:
    """A latency of a user's that is written down twice."""

    scale: Any
    power: float = 0.5
    quantile: Any = weibull

    def check(self, n_agents: int) -> None: ...

    def draw(self, draws: Draws) -> FloatArray:
        u = draws.uniforms(Purpose.LATENCY)
        return np.asarray(self.scale * exps(logs(0.0 - logs(1.0 - u)) * self.power))

    def table(self, n_agents: int) -> Any:
        return quantile_table(self.quantile, n_agents, self.scale, self.power)


@numba.njit
def sticky(u: float, time: float, chance: float, decay: float, memory: FloatArray) -> bool:
    """A loss of a user's: the more probable the sooner after the last one."""
    bad = u < chance + (1.0 - chance) * memory[0] * decay / (1.0 + time - memory[1])
    memory[0], memory[1] = 1.0 if bad else 0.0, time
    return bool(bad)


@dataclass(frozen=True, eq=False)
class Sticky:
    """A loss of a user's that is written down twice, with a memory of each link."""

    chance: Any = 0.2
    decay: float = 0.5
    function: Any = sticky
    memory: int = 2

    def start(self, n_agents: int) -> "StickyOfRun":
        return StickyOfRun(self, np.zeros((2, n_agents)))

    def table(self, n_agents: int) -> Any:
        return lost_table(self.function, n_agents, self.chance, self.decay, memory=self.memory)


@dataclass(frozen=True, eq=False)
class StickyOfRun:
    model: Sticky
    memory: FloatArray

    def draw(self, draws: Draws) -> Any:
        bad, since = self.memory
        chance = self.model.chance + (1.0 - self.model.chance) * bad * self.model.decay / (
            1.0 + draws.time - since
        )
        self.memory[:] = draws.uniforms(Purpose.LOSS) < chance, np.full(draws.n_agents, draws.time)
        return self.memory[0] > 0.0


LATENCIES: dict[str, Any] = {
    "constant": latency.Constant(0.5),
    "uniform": latency.Uniform(EACH, 2.0),
    "exponential": latency.Exponential(0.5),
    "exponential of each": latency.Exponential(EACH),
    "lognormal": latency.LogNormal(1.0, EACH),
    "pareto": latency.Pareto(1.5, EACH + 0.1),
    "empirical": latency.Empirical([0.1, 0.5, 0.3], EACH),
    "gamma": latency.ShiftedGamma(2.5, 0.3, EACH),
    "gamma with shapes below 1": latency.ShiftedGamma(2.0 * EACH + 0.01, 0.3),
    "own": Weibull(EACH),
}
LOSSES: dict[str, Any] = {
    "none": loss.Bernoulli(0.0),
    "independent": loss.Bernoulli(0.2),
    "independent of each": loss.Bernoulli(EACH),
    "common": loss.CommonMode(0.3),
    "bursts": loss.GilbertElliott(0.3, 2.0),
    "bursts of each": loss.GilbertElliott(EACH, EACH + 0.1),
    "trace": loss.Trace([1, 0, 0], repeat=True),
    "trace of each": loss.Trace(RECORD, repeat=True),
    "own": Sticky(),
    "own of each": Sticky(EACH),
    "own among others": loss.Combined(0.1, Sticky(), Sticky(EACH, 0.9), loss.GilbertElliott(0.1, 2.0)),
    "combined": loss.Combined(
        0.1, loss.GilbertElliott(EACH, 2.0), loss.CommonMode(0.1), loss.Trace(RECORD, repeat=True), EACH
    ),
}


class OwnLatency:
    """A user's model, of which the framework knows nothing but that it draws."""

    def __init__(self, model: Any) -> None:
        self.model = model

    def check(self, n_agents: int) -> None:
        self.model.check(n_agents)

    def draw(self, draws: Draws) -> FloatArray:
        drawn: FloatArray = self.model.draw(draws)
        return drawn


class _OwnProcess:
    def __init__(self, process: Any) -> None:
        self.draw = process.draw


class OwnLoss:
    """A user's model likewise."""

    def __init__(self, model: Any) -> None:
        self.model = model

    def start(self, n_agents: int) -> _OwnProcess:
        return _OwnProcess(self.model.start(n_agents))


def opened(**parts: Any) -> Link:
    return BroadcastChannel(**parts).open(N, KEYS)


def assert_same(compiled: Link, drawn: Link) -> None:
    assert isinstance(compiled, CompiledLink)
    assert not hasattr(drawn, "table")
    for k in range(60):
        # Three resources, two broadcasts at some instants, and departures later than the looks.
        time = 0.7 * (k - k % 2)
        one, other = (link.transmit(Broadcast(k % 3, k // 3, time), time + 0.1) for link in (compiled, drawn))
        assert one.arrival.tobytes() == other.arrival.tobytes()
        assert (one.second is None) == (other.second is None)
        if one.second is not None and other.second is not None:
            assert one.second.tobytes() == other.second.tobytes()


@pytest.mark.parametrize("fifo", [False, True])
@pytest.mark.parametrize("duplication", [0.0, 0.3, EACH], ids=["none", "some", "of each"])
@pytest.mark.parametrize("cause", LOSSES)
@pytest.mark.parametrize("distribution", LATENCIES)
def test_compiled_copies_are_those_of_the_models(
    distribution: str, cause: str, duplication: Any, fifo: bool
) -> None:
    late, lossy = LATENCIES[distribution], LOSSES[cause]
    parts = {"duplication": duplication, "fifo": fifo}
    drawn = opened(latency=OwnLatency(late), loss=OwnLoss(lossy), **parts)
    assert_same(opened(latency=late, loss=lossy, **parts), drawn)


def test_a_combination_with_a_users_part_draws_what_one_without_draws() -> None:
    late, parts = LATENCIES["gamma"], LOSSES["combined"].losses
    mixed = loss.Combined(*parts[:1], OwnLoss(parts[1]), *parts[2:])
    # A user's own process need not know of parts; this one draws from the broadcast it is given.
    assert_same(opened(latency=late, loss=LOSSES["combined"]), opened(latency=late, loss=mixed))


class _Slower(latency.Exponential):
    def draw(self, draws: Draws) -> FloatArray:
        return 2.0 * super().draw(draws)


def test_what_a_user_derives_from_a_model_is_asked_itself() -> None:
    plain, slower = opened(latency=latency.Exponential(0.5)), opened(latency=_Slower(0.5))
    assert not hasattr(slower, "table")
    signal = Broadcast(0, 0, 0.0)
    assert np.array_equal(slower.transmit(signal, 0.0).arrival, 2.0 * plain.transmit(signal, 0.0).arrival)


class _Later(Weibull):
    def draw(self, draws: Draws) -> FloatArray:
        return 1.0 + super().draw(draws)


def test_the_table_of_a_class_serves_those_that_draw_as_it_does() -> None:
    class Renamed(Weibull): ...

    assert isinstance(opened(latency=Renamed(1.0)), CompiledLink)
    assert not isinstance(opened(latency=_Later(1.0)), CompiledLink)
    network = topology.tree(topology.star(N, latency=0.1), latency=Weibull)
    assert isinstance(network.open(N, KEYS), CompiledLink)


def test_a_fleet_and_processes_hear_an_own_latency_alike() -> None:
    channel = BroadcastChannel(latency=Weibull(0.4), loss=0.1, duplication=0.1)
    problem = random_problem(5, 7, 2)
    settings: dict[str, Any] = {"dynamics": "continuous", "channel": channel, "seed": 3}
    recording = Recording(events=True)
    runs = [
        Simulation(problem, agents=agents, recording=recording, **settings).run(60.0)
        for agents in (AgentProcess, Fleet)
    ]
    assert_same_run(*runs)


def test_a_fleet_and_processes_hear_an_own_loss_alike() -> None:
    arcs = topology.tree(topology.star(7, latency=0.1, loss=0.1), loss=Sticky, latency=Weibull)
    for channel in (BroadcastChannel(0.4, Sticky(), duplication=0.1), arcs):
        recording = Recording(events=True)
        parts: dict[str, Any] = {"dynamics": "continuous", "channel": channel, "seed": 3}
        problem = random_problem(5, 7, 2)
        runs = [
            Simulation(problem, agents=agents, recording=recording, **parts).run(60.0)
            for agents in (AgentProcess, Fleet)
        ]
        assert runs[0].account.lost.sum() > 10
        assert_same_run(*runs)
        # What is remembered begins anew with every run.
        again = Simulation(problem, agents=Fleet, recording=recording, **parts).run(60.0)
        assert again.digest == runs[0].digest


@numba.njit
def _negative(u: float, scale: float, power: float) -> float:
    return scale * (u - 0.5) * power


@numba.njit
def _other(u: float, scale: float, power: float) -> float:
    return scale + u * power


@numba.njit
def _of_one(u: float) -> float:
    return u


@pytest.mark.parametrize(
    ("model", "said"),
    [
        (Weibull(1.0, 0.5, _negative), r"^Weibull.table\(\) at u = 0\[0\] = -0.25: must be .* at least 0"),
        (
            Weibull(1.0, 0.5, _other),
            r"^Weibull.table\(\)\[0\] = 1.\d+: must be .* as Weibull.draw\(\) has",
        ),
        (Weibull(1.0, 0.5, _of_one), r"^_of_one\(u, first, second\) of numbers cannot be compiled \("),
        (Weibull(1.0, 0.5, abs), r"^quantile abs = .*: must be a function decorated with numba.njit$"),
        (Weibull([1.0, 2.0]), r"^shape of parameter 0 = \(2,\): must be \(7,\)"),
    ],
)
def test_a_compiled_latency_that_cannot_serve_is_named(model: Weibull, said: str) -> None:
    with pytest.raises(InputError, match=said):
        opened(latency=model)


def test_a_table_has_three_parameters_at_most() -> None:
    with pytest.raises(InputError, match=r"^parameters of weibull = 4: must be at most 3$"):
        quantile_table(weibull, N, 1.0, 1.0, 1.0, 1.0)


@numba.njit
def _a_chance(u: float, time: float, chance: float, decay: float, memory: FloatArray) -> float:
    return chance


@numba.njit
def _never(u: float, time: float, chance: float, decay: float, memory: FloatArray) -> bool:
    return u < 0.0


@numba.njit
def _late(u: float, time: float, chance: float, decay: float, memory: FloatArray) -> bool:
    if time > 20.0:
        raise ValueError
    return sticky(u, time, chance, decay, memory)  # type: ignore[no-any-return]


class Attached(Sticky):
    """Starts with what reads the run, and has a table all the same."""

    def start(self, n_agents: int) -> Any:
        started = super().start(n_agents)
        object.__setattr__(started, "attach", lambda system: None)
        return started

    def table(self, n_agents: int) -> Any:
        return super().table(n_agents)


@pytest.mark.parametrize(
    ("model", "said"),
    [
        (
            Sticky(function=_a_chance),
            r"^what _a_chance\(u, time, first, second, memory\) returns = 'float64'",
        ),
        (
            Sticky(function=_never),
            r"^Sticky.table\(\)\[\d\] at time \d.*: must be True as the draw\(\) of what start",
        ),
        (Sticky(function=abs), r"^lost abs = .*: must be a function decorated with numba.njit$"),
        (Sticky(function=weibull), r"^weibull\(u, time, .*, memory\) of numbers cannot be compiled \("),
        (Sticky(memory=-1), r"^memory = -1: must be"),
        (Sticky([0.1, 0.2]), r"^shape of parameter 0 = \(2,\): must be \(7,\)"),
        (Attached(), r"^Attached.table\(\) is for losses that do not read the run"),
    ],
)
def test_a_compiled_loss_that_cannot_serve_is_named(model: Sticky, said: str) -> None:
    with pytest.raises(InputError, match=said):
        opened(loss=model)


class Sure(Sticky):
    """Starts in its own way, so that the table it has inherited is none of its own."""

    def start(self, n_agents: int) -> Any:
        return loss.Bernoulli(1.0).start(n_agents)


def test_a_class_that_starts_in_its_own_way_is_asked_itself() -> None:
    copies = opened(loss=Sure()).transmit(Broadcast(0, 0, 0.0), 0.0)
    assert np.isinf(copies.arrival).all()


def test_what_a_compiled_loss_raises_ends_the_run() -> None:
    link = opened(loss=Sticky(function=_late))
    link.transmit(Broadcast(0, 0, 20.0), 20.0)
    with pytest.raises(SimulationError, match=r"^time 21.0, resource 0: the compiled function of a loss"):
        link.transmit(Broadcast(0, 1, 21.0), 21.0)


@numba.njit
def _seldom(u: float, scale: float, power: float) -> float:
    return scale * power if u < 0.9 else math.nan


class Unchecked(Weibull):
    """Wrong for few uniform numbers, at none of which it is asked when it is opened."""

    def draw(self, draws: Draws) -> FloatArray:
        return np.full(draws.n_agents, self.scale * self.power)

    def table(self, n_agents: int) -> Any:
        return super().table(n_agents)


def test_what_a_compiled_latency_gives_is_checked_at_every_broadcast(monkeypatch: Any) -> None:
    monkeypatch.setattr(own_latency, "_checked", lambda latency, table, draws: table)
    link = opened(latency=Unchecked(1.0, 0.5, _seldom))
    # The larger the uniform number, the later: some of 60 broadcasts to seven agents have one above 0.9.
    with pytest.raises(InputError, match=r"resource 0: compiled latency of one's own\[\d\] = nan: must be"):
        assert_same(link, opened(latency=OwnLatency(Unchecked(1.0, 0.5))))


def test_all_channels_are_of_one_compiled_type() -> None:
    before = set(transmit.dispatcher.signatures)  # type: ignore[attr-defined]
    for late in LATENCIES.values():
        for lossy in LOSSES.values():
            opened(latency=late, loss=lossy, fifo=True).transmit(Broadcast(0, 0, 0.0), 0.0)
    after = set(transmit.dispatcher.signatures)  # type: ignore[attr-defined]
    assert len(before | after) == 1


@pytest.mark.parametrize(
    ("rows", "ends"), [((2,), 2), ((3, 2), 2), ((2, 3), 2), ((3, 3), 3), ((4, 2, 3), 2), ((2, 2, 1), 1)]
)
def test_the_trace_that_ends_first_is_the_one_named(rows: tuple[int, ...], ends: int) -> None:
    traces = [loss.Trace(np.zeros(count), repeat=False) for count in rows]
    endless = loss.Trace([0], repeat=True)
    for parts in (traces, [endless, *traces], [loss.Bernoulli(0.1), *traces, endless]):
        link = opened(loss=loss.Combined(*parts))
        for k in range(ends):
            link.transmit(Broadcast(0, k, 0.0), float(k))
        expected = (
            f"time {float(ends)!r}, resource 1: broadcast {ends} of the run has no row in a trace of {ends};"
        )
        with pytest.raises(SimulationError, match=expected):
            link.transmit(Broadcast(1, 0, 0.0), float(ends))


def test_bursts_after_other_causes_refuse_broadcasts_out_of_order() -> None:
    link = opened(loss=loss.Combined(0.1, loss.GilbertElliott(0.3, 1.0), loss.GilbertElliott(0.2, 2.0)))
    link.transmit(Broadcast(0, 0, 2.0), 2.0)
    with pytest.raises(SimulationError, match=r"time 1\.0, resource 1: .* at 2\.0; bursts of loss"):
        link.transmit(Broadcast(1, 0, 1.0), 1.0)
