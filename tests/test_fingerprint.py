"""Digests of problems: the same wherever they are made, and others where the problem may be another."""

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from aimd_des import CoupledCosts, CustomCosts, PolynomialCosts, Problem, Resource
from aimd_des.problem.costs import weighted_costs
from aimd_des.study.fingerprint import FORM, fingerprint, problem_digests
from tests.forks import forks

SCALE = 2.0
TABLE = {"a": 1.0}


def scaled(x: float) -> float:
    return SCALE * x


def value(agent: int, x: Any) -> float:
    return float(scaled(x[0]) ** 2 + agent * TABLE["a"])


def gradient(agent: int, x: Any) -> Any:
    return 2 * SCALE**2 * x


@dataclass
class Price:
    """Costs of one's own."""

    factor: float

    def __call__(self, agent: int, x: Any) -> float:
        return self.factor * scaled(float(x[0]))


def problem(costs: Any, **changes: Any) -> Problem:
    given = {"capacity": 4.0, "increase": 0.03, "decrease": 0.5, "normalization": 0.02, **changes}
    return Problem([Resource("memory", **given)], costs)


def quantile(x: float) -> float:
    return float(norm.ppf(x))


SQUARES = PolynomialCosts([2], [[[1.0]], [[2.0]]])
OWN = CustomCosts(2, 1, value, gradient)


@pytest.mark.parametrize(
    ("costs", "stored"),
    [
        (SQUARES, "521037f7aa462554"),
        (CoupledCosts(SQUARES, weights=[[1.0], [1.0]], sum_coefficients=[[1.0], [0.5]]), "5d8001aa1b0e16a4"),
        (OWN, "1c05846a9ef67ef0"),
    ],
)
def test_digests_stay_as_they_are_in_the_folders_of_others(costs: Any, stored: str) -> None:
    # Where one changes without a change of the problem, studies could not go on: then raise FORM.
    assert (FORM, fingerprint(problem_digests(problem(costs)))) == (1, stored)


def test_only_what_has_changed_has_another_digest() -> None:
    first = problem_digests(problem(SQUARES))
    other = problem_digests(
        problem(PolynomialCosts([2], [[[1.0]], [[2.5]]]), capacity=4.5, increase=[0.03, 0.1])
    )
    assert {name for name in first if first[name] != other[name]} == {"capacity", "increase", "costs"}
    assert problem_digests(problem(PolynomialCosts([2], [[[1.0]], [[2.0]]]))) == first


def test_another_process_finds_the_same() -> None:
    found = "print(problem_digests(problem(OWN))['costs'], fingerprint(Price(1.0)))"
    code = f"from tests.test_fingerprint import *; {found}"
    outcome = forks().run(code, cwd=Path(__file__).parent.parent)
    assert outcome.stdout.split() == [problem_digests(problem(OWN))["costs"], fingerprint(Price(1.0))]


@pytest.mark.parametrize(
    "costs", [OWN, weighted_costs(OWN, [1.0, 2.0]), Price(1.0), functools.partial(value, 1)]
)
@pytest.mark.parametrize(("name", "changed"), [("SCALE", 3.0), ("scaled", lambda x: x + 1.0)])
def test_what_a_function_refers_to_is_a_part_of_it(
    monkeypatch: pytest.MonkeyPatch, costs: Any, name: str, changed: Any
) -> None:
    before = fingerprint(costs)
    monkeypatch.setitem(scaled.__globals__, name, changed)
    assert fingerprint(costs) != before


def test_a_memory_that_fills_while_the_process_goes_on_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = fingerprint(value)
    monkeypatch.setitem(TABLE, "b", 2.0)
    assert fingerprint(value) == before


def test_what_is_assigned_is_read_anew_where_its_file_has_changed(tmp_path: Path) -> None:
    path = tmp_path / "prices.py"
    made: dict[str, Any] = {"__name__": "__main__", "__file__": str(path), "PRICES": [1.0]}
    exec("def first(): return PRICES[0]", made)
    digests = []
    for text in ("PRICES = [1.0]\nOTHERS = [1.0]", "PRICES = [1.0]\nOTHERS = [2, 3]", "PRICES = [2.0]", "("):
        path.write_text(text, encoding="utf-8")
        digests.append(fingerprint(made["first"]))
    assert digests[0] == digests[1]
    assert len(set(digests)) == 3


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (Price(1.0), Price(2.0)),
        (weighted_costs(OWN, [1.0, 2.0]), weighted_costs(OWN, [1.0, 3.0])),
        (functools.partial(value, 1), functools.partial(value, 2)),
        ([1.0, 2.0], [2.0, 1.0]),
        (np.zeros(3), np.zeros((3, 1))),
        ({"a": 1}, {"a": 2}),
        ({1, 2}, {1, 3}),
        (lambda x, y=1: x, lambda x, y=2: x),
        (np.exp, np.log),
        (Price(1.0).__call__, Price(2.0).__call__),
        (functools.lru_cache(scaled), functools.lru_cache(value)),
    ],
)
def test_what_differs_has_another_digest(one: Any, other: Any) -> None:
    assert fingerprint(one) != fingerprint(other)
    assert fingerprint(one) == fingerprint(one)


def test_what_refers_to_itself_ends() -> None:
    ring: list[Any] = [1.0]
    ring.append(ring)
    assert fingerprint(ring) == fingerprint(ring)


def test_functions_typed_in_by_hand_have_a_digest() -> None:
    made: dict[str, Any] = {"__name__": "__main__"}
    exec("def one(x): return x + 1\ndef two(x): return x + 2", made)
    assert fingerprint(made["one"]) != fingerprint(made["two"])


def test_a_distribution_of_scipy_has_one_digest_whatever_has_been_drawn() -> None:
    # It refers to the generator that NumPy's functions draw from, which begins anew in each process.
    before = fingerprint(quantile)
    np.random.random()  # noqa: NPY002 - this very generator
    assert fingerprint(quantile) == before
    assert fingerprint(np.random.default_rng(0)) != fingerprint(np.random.default_rng(1))
