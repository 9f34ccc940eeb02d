"""Public constructors and functions with arguments that work, and things that are none for them."""

from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
import pandas as pd

from aimd_des import (
    AgentProcess,
    BroadcastChannel,
    Clocks,
    CoupledCosts,
    Crossing,
    CustomCosts,
    PolynomialCosts,
    Problem,
    Recording,
    Resource,
    Sampled,
    Simulation,
    averaging,
    compensation,
    interventions,
    latency,
    loss,
    normalization_factors,
    responses,
    run_synchronous,
    solve_optimum,
    theory,
    topology,
)

#: What is no number, list or part, or is one that no argument takes.
WRONG: dict[str, Any] = {
    "nothing": None,
    "truth": True,
    "text": "text",
    "bytes": b"1",
    "not a number": float("nan"),
    "infinite": float("inf"),
    "negative": -1.0,
    "complex": 1j,
    "decimal": Decimal(1),
    "duration": np.timedelta64(1, "s"),
    "array without axes": np.array(float("nan")),
    "series of text": pd.Series(["a", "b"]),
    "series with a gap": pd.Series([1.0, None]),
    "five axes": np.ones((1, 1, 1, 1, 1)),
    "empty": [],
    "ragged": [[1.0], [1.0, 2.0]],
    "list of objects": [object()],
    "object": object(),
    "class": Sampled,
    "other class": Path,
    "function": lambda: 1.0,
    "dict": {"a": 1.0},
    "set": {1.0, 2.0},
    "generator": (number for number in (1.0, 2.0)),
    "graph": nx.path_graph(2),
    "another part": averaging.Window(40.0),
    "frame": pd.DataFrame({"a": [1.0, 2.0]}),
}

MEMORY: dict[str, Any] = {
    "name": "memory",
    "capacity": 1.0,
    "increase": 0.01,
    "decrease": 0.5,
    "normalization": 0.1,
    "threshold": 1.0,
    "unit": "GB",
}
COSTS = PolynomialCosts([2], [[[1.0]], [[2.0]]])
PROBLEM = Problem([Resource(**MEMORY)], COSTS)


def star() -> nx.Graph:
    return topology.star(2, 0.5, 0.1)


def simulation(**parts: Any) -> None:
    Simulation(**{"problem": PROBLEM, "seed": 1, **parts})


#: Each by its name: what is called, and arguments that are right.
CALLS: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "Resource": (Resource, MEMORY),
    "PolynomialCosts": (PolynomialCosts, {"exponents": [2], "coefficients": [[[1.0]], [[2.0]]]}),
    "CoupledCosts": (
        CoupledCosts,
        {
            "separable_part": COSTS,
            "quadratic": np.zeros((2, 1, 1)),
            "weights": [[1.0], [1.0]],
            "sum_exponents": [2],
            "sum_coefficients": [[1.0], [1.0]],
        },
    ),
    "CustomCosts": (
        CustomCosts,
        {
            "n_agents": 2,
            "n_resources": 1,
            "value": lambda _, x: x[0] ** 2,
            "gradient": lambda _, x: [2.0 * x[0]],
            "hessian": lambda _, x: [[2.0 + 0.0 * x[0]]],
            "separable": True,
        },
    ),
    "Problem": (Problem, {"resources": [Resource(**MEMORY)], "costs": COSTS, "agent_names": ["a", "b"]}),
    "Sampled": (Sampled, {"period": 1.0, "phase": 0.0, "sensing_delay": 0.0}),
    "Crossing": (Crossing, {"hold_off": 1.0, "sensing_delay": 0.0, "longest_hold_off": 2.0}),
    "Clocks": (Clocks, {"period": 1.0, "phase": 0.0, "drift": 0.0, "jitter": 0.0}),
    "Recording": (
        Recording,
        {"demand": "auto", "allocations": "end", "tail": 0, "overshoot": True, "events": False},
    ),
    "BroadcastChannel": (BroadcastChannel, {"latency": 0.5, "loss": 0.1, "duplication": 0.0, "fifo": False}),
    "latency.Constant": (latency.Constant, {"value": 1.0}),
    "latency.Uniform": (latency.Uniform, {"low": 0.5, "high": 1.0}),
    "latency.Exponential": (latency.Exponential, {"mean": 1.0}),
    "latency.ShiftedGamma": (latency.ShiftedGamma, {"shape": 1.0, "scale": 1.0, "shift": 0.0}),
    "latency.LogNormal": (latency.LogNormal, {"mean": 1.0, "std": 1.0}),
    "latency.LogNormal.from_median": (latency.LogNormal.from_median, {"median": 1.0, "sigma": 1.0}),
    "latency.Pareto": (latency.Pareto, {"shape": 3.0, "minimum": 1.0}),
    "latency.Empirical": (latency.Empirical, {"values": [1.0, 2.0], "scale": 1.0}),
    "latency.Empirical.from_csv": (
        latency.Empirical.from_csv,
        {"path": "delays.csv", "column": "delay", "scale": 1.0},
    ),
    "loss.Bernoulli": (loss.Bernoulli, {"probability": 0.1}),
    "loss.CommonMode": (loss.CommonMode, {"probability": 0.1}),
    "loss.GilbertElliott": (loss.GilbertElliott, {"mean_loss": 0.1, "mean_burst": 5.0}),
    "loss.Trace": (loss.Trace, {"lost": [0, 1], "repeat": True}),
    "loss.Trace.from_csv": (
        loss.Trace.from_csv,
        {"path": "losses.csv", "columns": ["lost"], "repeat": True},
    ),
    "loss.Combined": (lambda first: loss.Combined(first, 0.1), {"first": 0.1}),
    "averaging.Window": (averaging.Window, {"length": 40.0, "parts": 20}),
    "averaging.Forgetting": (averaging.Forgetting, {"time_constant": 40.0}),
    "averaging.Polynomial": (averaging.Polynomial, {"gain": 2.0}),
    "responses.Derandomised": (responses.Derandomised, {"divisor": "events", "full": True}),
    "compensation.KnownLoss": (compensation.KnownLoss, {"loss": 0.1}),
    "compensation.EstimatedLoss": (compensation.EstimatedLoss, {"number_bits": 8}),
    "topology.star": (topology.star, {"n_agents": 2, "latency": 0.5, "loss": 0.1}),
    "topology.balanced_tree": (
        topology.balanced_tree,
        {"branching": 2, "height": 1, "latency": 0.5, "loss": 0.1},
    ),
    "topology.grid": (
        topology.grid,
        {"rows": 2, "columns": 2, "latency": 0.5, "loss": 0.1, "root": (0, 0)},
    ),
    "topology.random_geometric": (
        topology.random_geometric,
        {"n_agents": 2, "radius": 2.0, "latency_per_distance": 1.0, "loss": 0.0, "seed": 1},
    ),
    "topology.tree": (
        topology.tree,
        {
            "graph": star(),
            "root": 0,
            "agents": [1, 2],
            "latency": latency.Exponential,
            "loss": loss.Bernoulli,
        },
    ),
    "topology.flood": (topology.flood, {"graph": star(), "root": 0, "agents": [1, 2]}),
    "topology.from_graphml": (
        topology.from_graphml,
        {"path": "net.graphml", "root": "r", "latency": "latency", "loss": "loss"},
    ),
    "topology.from_edges": (
        topology.from_edges,
        {
            "path": "net.csv",
            "root": "r",
            "source": "source",
            "target": "target",
            "latency": "latency",
            "loss": "loss",
            "directed": False,
        },
    ),
    "solve_optimum": (
        solve_optimum,
        {"problem": PROBLEM, "capacity": [1.0], "tolerance": 1e-6, "max_iterations": 50},
    ),
    "normalization_factors": (normalization_factors, {"costs": COSTS, "upper": [1.0], "lower": 0.0}),
    "run_synchronous": (
        run_synchronous,
        {
            "problem": PROBLEM,
            "steps": 5,
            "seed": 1,
            "lag": 1,
            "averaging": averaging.Window(40.0),
            "response": responses.EventNormalised(),
            "recording": Recording(),
        },
    ),
    "Simulation": (
        simulation,
        {
            "problem": PROBLEM,
            "dynamics": "discrete",
            "control_unit": Sampled(),
            "channel": BroadcastChannel(),
            "agents": AgentProcess,
            "special": {0: AgentProcess},
            "clocks": Clocks(),
            "averaging": averaging.Cumulative(),
            "compensation": compensation.KnownLoss(0.1),
            "response": responses.EventNormalised(),
            "interventions": [interventions.Failover(1.0, 1.0)],
            "seed": 1,
            "recording": Recording(),
            "processes": [lambda system: iter(())],
        },
    ),
    "Simulation.run": (
        lambda until, watch: Simulation(PROBLEM, seed=1).run(until, watch),
        {"until": 2.0, "watch": None},
    ),
    "theory.predict": (
        theory.predict,
        {
            "problem": PROBLEM,
            "dynamics": "continuous",
            "latency": 0.0,
            "period": 0.0,
            "loss": 0.0,
            "hold_off": 0.0,
        },
    ),
    "theory.signal_rate": (
        theory.signal_rate,
        {"increase": 0.1, "decrease": 0.5, "normalization": 0.1, "multiplier": 1.0},
    ),
    "theory.allocation_at": (theory.allocation_at, {"problem": PROBLEM, "multipliers": [1.0]}),
    "theory.reweighted_optimum": (
        theory.reweighted_optimum,
        {"problem": PROBLEM, "weights": [1.0, 1.0], "capacity": [1.0]},
    ),
    "theory.share_rates": (theory.share_rates, {"problem": PROBLEM, "allocation": [[0.5], [0.5]]}),
    "theory.recovery_time": (theory.recovery_time, {"before": 1.0, "after": 2.0, "age": 3.0}),
    "theory.safe_threshold": (theory.safe_threshold, {"problem": PROBLEM, "exceedance": 0.01}),
    "theory.limit_cycle": (
        theory.limit_cycle,
        {"problem": PROBLEM, "hold_off": 0.1, "latency": 0.5, "loss": 0.0},
    ),
    "theory.hold_off_bounds": (theory.hold_off_bounds, {"problem": PROBLEM, "latency": 0.5, "taken": 0.5}),
    "theory.partition_runaway": (theory.partition_runaway, {"problem": PROBLEM, "duration": 1.0}),
}

_OF_AGENTS = {
    "Join": {"at": 1.0},
    "Absence": {"at": 1.0, "until": 2.0},
    "Crash": {"at": 1.0, "until": 2.0},
    "UnusualActivity": {"at": 1.0, "until": 2.0, "weight": 0.5},
    "Partition": {"at": 1.0, "duration": 1.0},
    "Failover": {"at": 1.0, "duration": 1.0},
    "CapacityStep": {"at": 1.0, "capacity": 1.0},
    "CapacityRamp": {"start": 1.0, "end": 2.0, "capacity": 1.0, "steps": 2},
    "CapacityProfile": {"times": [1.0], "capacities": [1.0], "period": 3.0},
    "Prices": {"every": 1.0, "draw": lambda k: COSTS},
}


def _declared(kind: type) -> Callable[..., Any]:
    """An intervention is checked when it is made, and once more when it meets the problem."""
    return lambda **given: simulation(interventions=[kind(**given)])


for _name, _times in _OF_AGENTS.items():
    _whom: dict[str, Any] = {}
    if _name.startswith("Capacity"):
        _whom = {"resource": 0}
    elif _name not in ("Failover", "Prices"):
        _whom = {"agents": [0]}
    CALLS[f"interventions.{_name}"] = (_declared(getattr(interventions, _name)), {**_whom, **_times})

#: What is taken all the same, by call and argument: None stands for what holds unless it is given.
TAKEN: dict[str, dict[str, set[str]]] = {
    "Resource": {"name": {"text"}, "unit": {"text"}},
    "CoupledCosts": {
        "quadratic": {"nothing"},
        "weights": {"frame", "nothing"},
        "sum_coefficients": {"frame", "nothing"},
    },
    "CustomCosts": {
        "value": {"class", "function", "other class"},
        "gradient": {"class", "function", "other class"},
        "hessian": {"class", "function", "nothing", "other class"},
        "separable": {"truth"},
    },
    "Problem": {"agent_names": {"nothing", "series of text"}},
    "Crossing": {"longest_hold_off": {"nothing"}},
    "Recording": {"demand": {"empty"}, "allocations": {"empty"}, "overshoot": {"truth"}, "events": {"truth"}},
    "BroadcastChannel": {"fifo": {"truth"}},
    "loss.Trace": {"repeat": {"truth"}},
    "loss.Trace.from_csv": {"columns": {"nothing"}, "repeat": {"truth"}},
    "topology.tree": {"root": {"nothing"}, "agents": {"nothing"}},
    "responses.Derandomised": {"full": {"truth"}},
    "topology.flood": {"root": {"nothing"}, "agents": {"nothing"}},
    "topology.from_edges": {"directed": {"truth"}},
    "solve_optimum": {"capacity": {"nothing"}},
    "run_synchronous": {
        "averaging": {"another part", "nothing"},
        "response": {"nothing"},
        "recording": {"nothing"},
    },
    "Simulation": {
        "control_unit": {"nothing"},
        "channel": {"nothing"},
        "agents": {"function"},
        "special": {"nothing"},
        "clocks": {"nothing"},
        "averaging": {"another part", "nothing"},
        "compensation": {"nothing"},
        "response": {"nothing"},
        "interventions": {"empty", "generator"},
        "recording": {"nothing"},
        "processes": {"empty", "generator"},
    },
    "Simulation.run": {"watch": {"nothing"}},
    "theory.predict": {"hold_off": {"nothing"}},
    "theory.signal_rate": {
        "increase": {"empty", "five axes", "frame"},
        "decrease": {"empty"},
        "normalization": {"empty", "five axes", "frame"},
        "multiplier": {"empty", "five axes", "frame"},
    },
    "theory.reweighted_optimum": {"weights": {"frame"}, "capacity": {"nothing"}},
    "theory.share_rates": {"allocation": {"frame"}},
    "interventions.Absence": {"until": {"nothing"}},
    "interventions.Crash": {"until": {"nothing"}},
    "interventions.UnusualActivity": {"until": {"nothing"}},
    "interventions.Partition": {"agents": {"nothing"}},
    "interventions.CapacityProfile": {"period": {"nothing"}},
}
