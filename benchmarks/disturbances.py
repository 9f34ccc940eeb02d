"""What networks, averages, responses, interventions, recording and own clocks cost, beside a plain fleet."""

import argparse
from collections.abc import Callable
from functools import partial
from typing import Any

import numba

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Clocks,
    Crossing,
    Fleet,
    Problem,
    Recording,
    Sampled,
    Simulation,
    averaging,
    compensation,
    latency,
    loss,
    responses,
    topology,
)
from aimd_des.control_units import EarlyDetection
from aimd_des.interventions import Absence, CapacityProfile, UnusualActivity
from aimd_des.lowlevel import exp, log, lost_table, quantile_table
from benchmarks.harness import (
    Contestant,
    Timing,
    add_options,
    console,
    interleaved,
    machine,
    positive,
    ratio,
    table,
    write_json,
)
from models import smart_cameras

__all__ = ["main"]

PLAIN = "fleet, plain"
WARM_UP = 50.0
RECORDED = 1_000, 100.0  # cameras and end of the runs that record
COLUMNS = ("program", "CPU s,\nbest", "CPU s,\nmedian", "deliveries", "ns per\ndelivery", "over\nplain")
LEGEND = (
    "CPU seconds, compiling not counted.  'over plain' is the time per delivery over that of the plain\n"
    "fleet: losses and capacities differ, and with them the number of deliveries."
)


@numba.njit
def _exponential(u: float, mean: float) -> float:
    """The exponential latency, as a function of the user's."""
    return mean * (0.0 - log(1.0 - u))


class _OwnLatency(latency.Exponential):
    """The exponential latency with a compiled function of the user's."""

    def table(self, n_agents: int) -> Any:
        return quantile_table(_exponential, n_agents, self.mean)


@numba.njit
def _log_logistic(u: float, median: float, shape: float) -> float:
    """A latency that the framework does not have, of two logarithms and an exponential."""
    return median * exp((log(u) - log(1.0 - u)) / shape)


class _LogLogistic(latency.Exponential):
    """A log-logistic latency, of the given median in the place of the mean."""

    def table(self, n_agents: int) -> Any:
        return quantile_table(_log_logistic, n_agents, self.mean, 4.0)


@numba.njit
def _lost(u: float, time: float, probability: float) -> bool:  # noqa: ARG001
    """Independent losses, as a function of the user's."""
    return u < probability


class _OwnLoss(loss.Bernoulli):
    """Independent losses with a compiled function of the user's."""

    def table(self, n_agents: int) -> Any:
        return lost_table(_lost, n_agents, self.probability)


def _own_channel() -> dict[str, Any]:
    """The channel of the plain fleet with models of the user's own, one at a time."""
    late, lossy = latency.Exponential(0.5), loss.Bernoulli(0.1)
    return {
        "a latency of one's own": {"channel": BroadcastChannel(_OwnLatency(0.5), lossy)},
        "a log-logistic one": {"channel": BroadcastChannel(_LogLogistic(0.5), lossy)},
        "a loss of one's own": {"channel": BroadcastChannel(late, _OwnLoss(0.1))},
    }


@numba.njit
def _papers(normalization: float, slope: float, average: float) -> float:
    """The paper's rule, as a function of the user's."""
    return normalization * slope / average


def _networks(n: int) -> dict[str, Any]:
    """A grid with about a camera at each node, as a tree and flooded, with exponential latencies."""
    graph = topology.grid(6, n // 6 + 1, latency=0.05, loss=0.02)
    nodes = [node for node in graph if node != graph.graph["root"]][:n]
    return {
        "tree": topology.tree(graph, agents=nodes, latency=latency.Exponential),
        "flood": topology.flood(graph, agents=nodes, latency=latency.Exponential),
    }


def _changes(problem: Problem, until: float) -> list[Any]:
    """A capacity that changes ten times, an agent away and one with unusual activity in every hundredth."""
    names = [until * place / 10 for place in range(10)]
    levels = [float(problem.capacity[0]) * (1.0 - 0.02 * (place % 3)) for place in range(10)]
    steps = [(place % problem.n_agents, until * place / 100) for place in range(1, problem.n_agents)]
    absences = [Absence(agent, at, at + until / 200) for agent, at in steps]
    activity = [UnusualActivity(agent, at, at + until / 200, 0.5) for agent, at in steps]
    return [CapacityProfile(0, names, levels), *absences, *activity]


def _ways(problem: Problem, until: float) -> dict[str, dict[str, Any]]:
    networks = _networks(problem.n_agents)
    return {
        PLAIN: {},
        "window of 1,000": {"averaging": averaging.Window(1000.0)},
        "forgetting over 500": {"averaging": averaging.Forgetting(500.0)},
        "averages with gain 2": {"averaging": averaging.Polynomial(2.0)},
        "event normalised": {"response": responses.EventNormalised()},
        "derandomised": {"response": responses.Derandomised("events")},
        "a response of one's own": {"response": responses.CustomResponse(_papers)},
        **_own_channel(),
        "known loss": {"compensation": compensation.KnownLoss(0.1)},
        "estimated loss": {"compensation": compensation.EstimatedLoss()},
        "adaptive hold-off": {"control_unit": Crossing(0.25, longest_hold_off=1.25)},
        "samples on a clock": {"control_unit": Sampled()},
        "early detection": {"control_unit": EarlyDetection()},
        "tree over a grid": {"channel": networks["tree"]},
        "flood over a grid": {"channel": networks["flood"]},
        "latency 10 for all": {"channel": BroadcastChannel(10.0, loss.Bernoulli(0.1))},
        "interventions": {"interventions": _changes(problem, until)},
    }


def _recorded() -> dict[str, dict[str, Any]]:
    """Ways of recording, and clocks, which cost most where something is recorded at every tick."""
    log, overshoot = Recording("end", overshoot=False, events=True), Recording("end")
    clock: dict[str, Any] = {"dynamics": "discrete", "control_unit": Sampled()}
    own, jitter = Clocks(phase="random", drift=0.01), Clocks(phase="random", drift=0.01, jitter=0.3)
    return {
        PLAIN: {},
        "default recording": {"recording": Recording()},
        "event log": {"recording": log},
        "agent processes": {"agents": AgentProcess},
        "agent processes, event log": {"agents": AgentProcess, "recording": log},
        "clock in common": clock,
        "clock, latency 5 for all": {**clock, "channel": BroadcastChannel(5.0, loss.Bernoulli(0.1))},
        "own clocks": {**clock, "clocks": own},
        "own clocks with jitter": {**clock, "clocks": jitter},
        "clock in common, overshoot": {**clock, "recording": overshoot},
        "own clocks, overshoot": {**clock, "clocks": own, "recording": overshoot},
        "jitter, overshoot": {**clock, "clocks": jitter, "recording": overshoot},
    }


def _prepare(problem: Problem, until: float, parts: dict[str, Any]) -> Callable[[int], int]:
    """Return a run that tells its deliveries; compiles what it needs first."""
    channel = BroadcastChannel(latency=latency.Exponential(0.5), loss=loss.Bernoulli(0.1))
    options: dict[str, Any] = {"control_unit": Crossing(1.0), "channel": channel, **parts}

    def run(seed: int, end: float = until, **others: Any) -> int:
        recording = Recording("end", overshoot=False)
        parts = {"dynamics": "continuous", "agents": Fleet, "recording": recording, **options, **others}
        return int(Simulation(problem, seed=seed, **parts).run(end).account.delivered.sum())

    # Without interventions: most would begin after so short a run, which is refused.
    run(0, WARM_UP, interventions=())
    return run


def _contestants(problem: Problem, until: float, ways: dict[str, dict[str, Any]]) -> list[Contestant[int]]:
    return [Contestant(name, partial(_prepare, problem, until, parts)) for name, parts in ways.items()]


def _row(timing: Timing[int], plain: float) -> dict[str, Any]:
    deliveries = timing.outcomes[timing.seconds.index(timing.best)]
    each = timing.best / deliveries
    return {
        "program": timing.name,
        "seconds": timing.seconds,
        "best": timing.best,
        "median": timing.median,
        "deliveries": deliveries,
        "per_delivery": each,
        "over_plain": each / plain,
    }


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    return (
        row["program"],
        f"{row['best']:.3f}",
        f"{row['median']:.3f}",
        f"{row['deliveries']:,}",
        f"{1e9 * row['per_delivery']:.0f}",
        ratio(row["over_plain"]),
    )


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.disturbances",
        description="the paper's system as a fleet, plain and with what real deployments have",
    )
    parser.add_argument("--cameras", type=positive, default=60, help="how many (default: %(default)s)")
    parser.add_argument("--until", type=float, default=30_000.0, help="end (default: %(default)s)")
    add_options(parser, repeats=5)
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> None:
    """Measure all ways and print a table."""
    options = _options(arguments)
    out, host = console(), machine(("numpy", "numba", "simpy"))
    out.print(", ".join(f"{name} {value}" for name, value in host.items()), soft_wrap=True)
    problem = smart_cameras(seed=0, n_cameras=options.cameras)
    many = smart_cameras(seed=0, n_cameras=RECORDED[0])
    rows = []
    for given, until, ways in (
        (problem, options.until, _ways(problem, options.until)),
        (many, RECORDED[1], _recorded()),
    ):
        timings = interleaved(_contestants(given, until, ways), options.repeats, options.seed)
        first = timings[0]
        plain = first.best / first.outcomes[first.seconds.index(first.best)]
        found = [_row(timing, plain) for timing in timings]
        out.print(table(f"{given.n_agents} cameras, {until:g} units of time", COLUMNS, map(_cells, found)))
        rows += [{"cameras": given.n_agents, "until": until, **row} for row in found]
    out.print(LEGEND, soft_wrap=True)
    if options.json:
        settings = {name: getattr(options, name) for name in ("cameras", "until", "repeats", "seed")}
        write_json(options.json, {"machine": host, "settings": settings, "rows": rows})


if __name__ == "__main__":
    main()
