"""What several test files share: small problems, references for draws and derivatives, fresh processes."""

import gc
import math
import os
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from PIL import Image

from aimd_des import CoupledCosts, CustomCosts, InputError, PolynomialCosts, Problem, Resource, Result
from aimd_des.costs import ExponentialCosts, PowerCosts, TermCosts, TrackingCosts, UtilityCosts
from aimd_des.problem.costs import Costs
from aimd_des.study.workers import _ONE_THREAD

ROOT = Path(__file__).resolve().parents[1]

# The same examples at every run; `--hypothesis-profile explore` looks for new ones.
settings.register_profile("project", derandomize=True, deadline=None, database=None, max_examples=15)
settings.register_profile("explore", deadline=None, database=None, max_examples=1000)
settings.load_profile("project")


def pytest_configure(config: pytest.Config) -> None:
    """Give each worker one thread: linear algebra would else keep all processors busy with sixty rows."""
    if not hasattr(config, "workerinput"):
        os.environ.update(_ONE_THREAD)  # for workers and commands that are started from here


def pytest_collection_finish(session: pytest.Session) -> None:
    """Keep the collector of garbage from what a worker has imported: it takes a tenth of the time else.

    Alone, without workers, tests run with old versions too, and Hypothesis 6.100 loses an example by it.
    """
    if hasattr(session.config, "workerinput"):
        gc.collect()
        gc.freeze()


@pytest.fixture
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in an empty folder, in which models are still found."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(ROOT))  # and the path is put back, whatever the command adds


#: A scenario with its problem written out: two resources, five agents.
INLINE = """\
title = "five agents, two resources"
until = 60
seed = 4

[recording]
tail = 5

[costs]
exponents = [2]
coefficients = [
    [[1.0], [2.0]],
    [[3.0], [1.0]],
    [[2.0], [2.0]],
    [[4.0], [0.5]],
    [[1.5], [1.0]],
]

[[resources]]
name = "memory"
capacity = 3.0
increase = 0.05
decrease = 0.7
normalization = 0.1
unit = "GB"

[[resources]]
name = "disk"
capacity = 2.0
increase = 0.03
decrease = 0.85
normalization = 0.1
threshold = 0.95
"""

_Outcome = TypeVar("_Outcome")


def quietly(run: Callable[..., _Outcome], *args: Any, **kwargs: Any) -> _Outcome:
    """Call without the warning about response probabilities above 1, which random problems may have."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".* responses had a probability above 1", RuntimeWarning)
        return run(*args, **kwargs)


def refusal(build: Callable[[], object]) -> str:
    """The sentence with which something is refused."""
    with pytest.raises(InputError) as caught:
        build()
    return str(caught.value)


def standard_error(samples: Any) -> Any:
    """The standard error of the mean over independent runs, the first axis."""
    samples = np.asarray(samples)
    return samples.std(axis=0, ddof=1) / math.sqrt(len(samples))


def z_score(samples: Any, expected: Any) -> Any:
    """How many standard errors the mean is away from what is expected."""
    return np.abs(np.mean(samples, axis=0) - expected) / standard_error(samples)


def resource(name: str = "memory", **changes: Any) -> Resource:
    """A resource with ordinary values."""
    ordinary = {"capacity": 4.0, "increase": 0.03, "decrease": 0.5, "normalization": 0.02}
    return Resource(name, **{**ordinary, **changes})


def quadratic_problem(factors: list[float], **changes: Any) -> Problem:
    """One resource and costs c_i x**2: the response probabilities are 2 Gamma c_i whatever the averages."""
    return Problem([resource(**changes)], PolynomialCosts([2], [[[factor]] for factor in factors]))


def as_custom(costs: Costs, *, hessian: bool = True) -> CustomCosts:
    """The same costs as functions of one agent's allocation, with the same bits."""

    def of_agent(function: Callable[[Any], Any]) -> Callable[[int, Any], Any]:
        return lambda agent, x: function(np.tile(x, (costs.n_agents, 1)))[agent]

    return CustomCosts(
        costs.n_agents,
        costs.n_resources,
        of_agent(costs.value),
        of_agent(costs.gradient),
        of_agent(costs.hessian) if hessian else None,
        separable=costs.separable,
    )


def random_costs(rng: np.random.Generator, family: str, share: Any, n: int) -> Costs:
    """Costs whose terms are all of one size where everybody holds `share`, shape (m,)."""
    m = len(share)
    exponents = [2, 3, 6]
    scale = np.array([share**power for power in exponents]).T
    own = PolynomialCosts(exponents, rng.uniform(0.1, 1.0, (n, m, 3)) / scale)
    if family == "polynomial":
        return own
    if family == "custom":
        return as_custom(own)
    if family in TERMS:
        return _random_terms(rng, family, share, n)
    factors = rng.uniform(size=(n, m, m)) / share[:, None]
    coupled = CoupledCosts(
        own,
        quadratic=0.1 * factors @ factors.transpose(0, 2, 1),
        weights=rng.uniform(0.0, 1.0, (n, m)) / share,
        sum_exponents=(2, 3),
        sum_coefficients=rng.uniform(0.0, 1.0, (n, 2)),
    )
    return coupled if family == "coupled" else as_custom(coupled)


def _random_terms(rng: np.random.Generator, family: str, share: Any, n: int) -> Costs:
    """Costs of a family that derives from `TermCosts`, or of two terms of each kind."""
    first, second = rng.uniform(0.5, 2.0, (2, n, len(share)))
    powers, each = np.array([1.5, 2.7]), share[:, None]
    if family == "exponential":
        return ExponentialCosts(first, second / share)
    if family == "power":
        return PowerCosts(powers, rng.uniform(0.1, 1.0, (*first.shape, 2)) / each**powers)
    if family == "tracking":
        pull = (first * second).max(axis=0) / share
        return TrackingCosts(
            first * share, second / share**2, price=pull * 1.5 if rng.random() < 0.5 else None
        )
    if family == "utility":
        fairness = 1.0 if rng.random() < 0.3 else rng.uniform(0.5, 2.5)
        return UtilityCosts(first * share ** (fairness - 1.0), second * share, fairness)
    # The second exponential and the second power fall, by less than the polynomial grows.
    slopes = np.stack([first / share, second / share**2], axis=-1)
    growth = [[[0.5 / s, 1.0 / s], [-0.3 / s, -0.7 / s]] for s in share]
    more = [[[0.5 / s**1.5, 0.5, 0.0], [0.2 * s**0.5, -1.5, 1.2 * s]] for s in share]
    spread = (n, len(share), 2)
    return TermCosts(slopes, np.broadcast_to(growth, (*spread, 2)), np.broadcast_to(more, (*spread, 3)))


def random_problem(
    seed: int, n: int, m: int, family: str = "polynomial", *, per_agent: bool = False, threshold: bool = False
) -> Problem:
    """A problem that reaches its capacities after some ten steps, without numbers that are round."""
    rng = np.random.default_rng([seed, n, m])
    capacity = rng.uniform(0.5, 40.0, m)
    share = capacity / n
    costs = random_costs(rng, family, share, n)
    steepest = (costs.gradient(np.tile(share, (n, 1))) / share).max(axis=0)
    size = n if per_agent else None
    resources = [
        Resource(
            f"resource {j}",
            capacity=capacity[j],
            increase=share[j] * rng.uniform(0.05, 0.3, size),
            decrease=rng.uniform(0.0, 0.99, size) * rng.integers(0, 4, size).clip(0, 1),  # sometimes 0
            normalization=rng.uniform(0.1, 0.8) / steepest[j],
            threshold=rng.uniform(0.6, 1.0) if threshold else 1.0,
        )
        for j in range(m)
    ]
    return Problem(resources, costs)


#: Families of `random_costs`: those that derive from `TermCosts`, those that run in compiled code, and all.
TERMS = ("exponential", "power", "utility", "tracking", "terms")
COMPILED = ("polynomial", "coupled", *TERMS)
FAMILIES = (*COMPILED, "custom", "custom coupled")


def problems(families: tuple[str, ...] = FAMILIES) -> st.SearchStrategy[Problem]:
    """Random problems with one to seven agents and one to three resources."""
    return st.builds(
        random_problem,
        st.integers(0, 2**32 - 1),
        st.integers(1, 7),
        st.integers(1, 3),
        st.sampled_from(families),
        per_agent=st.booleans(),
        threshold=st.booleans(),
    )


def reference_draws(seed: int, purpose: int, j: int, b: int, n: int, lane: int = 0) -> Any:
    """The draws of all agents for broadcast b of resource j, by NumPy alone; second copies have a lane."""
    key = np.random.SeedSequence(seed, spawn_key=(purpose,)).generate_state(2, np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=[0, lane, j, b])).random(n)


def reference_derivative(costs: Costs, agent: int, x: list[float], j: int) -> float:
    """grad_j f_i(x) term by term, as it is written on paper."""
    if isinstance(costs, PolynomialCosts):
        terms = zip(costs.exponents, costs.coefficients[agent, j], strict=True)
        return float(sum(p * c * x[j] ** (p - 1) for p, c in terms))
    if isinstance(costs, CoupledCosts):
        weights = costs.weights[agent]
        weighted = sum(w * held for w, held in zip(weights, x, strict=True))
        total = reference_derivative(costs.separable_part, agent, x, j)
        total += sum(q * held for q, held in zip(costs.quadratic[agent, j], x, strict=True))
        terms = zip(costs.sum_exponents, costs.sum_coefficients[agent], strict=True)
        return float(total + sum(p * c * weighted ** (p - 1) for p, c in terms) * weights[j])
    if isinstance(costs, TermCosts):
        table = costs.table()
        slope = sum(c * x[j] ** d for d, c in enumerate(table.slopes[j, :, agent].tolist()))
        slope += sum(c * math.exp(r * x[j]) for c, r in table.exponentials[j, :, :, agent].tolist())
        return float(slope + sum(c * (x[j] + s) ** p for c, p, s in table.powers[j, :, :, agent].tolist()))
    assert isinstance(costs, CustomCosts)
    return float(np.asarray(costs.agent_gradient(agent, np.array(x)))[j])


def signals_of(result: Result) -> list[tuple[float, int, int]]:
    """Time, resource and number of every signal, in order."""
    sent = result.signals_sent
    return list(zip(sent.time.tolist(), sent.resource.tolist(), sent.number.tolist(), strict=True))


def assert_same_run(first: Result, second: Result) -> None:
    """Hold two runs to be equal in every bit of what they did and what they recorded."""
    assert first.digest == second.digest
    for name in ("signals", "demand", "allocations"):
        pd.testing.assert_frame_equal(getattr(first, name), getattr(second, name), check_exact=True)
    assert np.array_equal(first.account.responses, second.account.responses)
    assert np.array_equal(first.account.saturated, second.account.saturated)
    for name in ("peak", "time", "mean"):
        one, other = (getattr(result.observations.overshoot, name) for result in (first, second))
        assert np.array_equal(one, other), name


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height of a picture whose checksums are right; its pixels take long to decode."""
    with Image.open(path) as picture:
        picture.verify()
        return picture.size


def python(
    *arguments: str, cwd: Path | None = None, path: Path = ROOT, **environment: str
) -> "subprocess.CompletedProcess[str]":
    """Run Python in a fresh process that finds what is in `path`, by default the project."""
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(path), **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
