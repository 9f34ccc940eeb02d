"""A problem takes what fits together and refuses the rest by name."""

import math
import re
from typing import Any

import numpy as np
import pytest

from aimd_des import InputError, PolynomialCosts, Problem, Resource
from tests.conftest import quadratic_problem, resource

TWO_AGENTS = PolynomialCosts([2], [[[1.0]], [[2.0]]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"capacity": -1.0}, "capacity of memory = -1.0: must be a finite number greater than 0"),
        ({"capacity": 0}, "capacity of memory = 0.0: must be a finite number greater than 0"),
        ({"capacity": math.nan}, "capacity of memory = nan: must be a finite number greater than 0"),
        ({"capacity": math.inf}, "capacity of memory = inf: must be a finite number greater than 0"),
        ({"capacity": "4"}, "capacity of memory = '4': must be a finite number greater than 0"),
        ({"capacity": [4.0]}, "capacity of memory = [4.0]: must be a finite number greater than 0"),
        (
            {"increase": 0.0},
            "increase of memory = 0.0: must be a finite number greater than 0; an agent that never adds",
        ),
        ({"increase": -0.1}, "increase of memory = -0.1: must be a finite number greater than 0"),
        ({"increase": math.nan}, "increase of memory = nan: must be a finite number greater than 0"),
        ({"increase": [0.1, 0.0]}, "increase of memory[1] = 0.0: must be a finite number greater than 0"),
        ({"increase": [[0.1]]}, "shape of increase of memory = (1, 1): must be (n_agents,)"),
        (
            {"decrease": 1.0},
            "decrease of memory = 1.0: must be a finite number at least 0 and less than 1; a response must",
        ),
        ({"decrease": 1}, "decrease of memory = 1.0: must be a finite number at least 0 and less than 1"),
        ({"decrease": -0.5}, "decrease of memory = -0.5: must be a finite number at least 0 and less than 1"),
        ({"decrease": math.nan}, "decrease of memory = nan: must be"),
        (
            {"decrease": [0.5, 1.0]},
            "decrease of memory[1] = 1.0: must be a finite number at least 0 and less",
        ),
        ({"decrease": True}, "decrease of memory = True: must be"),
        ({"normalization": 0.0}, "normalization of memory = 0.0: must be a finite number greater than 0"),
        ({"normalization": -math.inf}, "normalization of memory = -inf: must be"),
        ({"normalization": [0.1, 0.1]}, "normalization of memory = [0.1, 0.1]: must be a finite number"),
        (
            {"threshold": 0.0},
            "threshold of memory = 0.0: must be a finite number greater than 0 and at most 1",
        ),
        (
            {"threshold": 1.01},
            "threshold of memory = 1.01: must be a finite number greater than 0 and at most",
        ),
        ({"threshold": math.nan}, "threshold of memory = nan: must be"),
        ({"unit": 3}, "unit of memory = 3: must be a string"),
        ({"name": ""}, "name of a resource = '': must be a string that is not empty"),
        ({"name": 7}, "name of a resource = 7: must be a string that is not empty"),
    ],
)
def test_a_resource_refuses_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        resource(**{"name": "memory", **changes})


def test_a_resource_keeps_what_it_is_given() -> None:
    disk = Resource("disk", 20, [0.02, 0.03], 0, 1 / 90, threshold=1, unit="GB")
    assert (disk.name, disk.capacity, disk.decrease, disk.threshold, disk.unit) == (
        "disk",
        20.0,
        0.0,
        1.0,
        "GB",
    )
    assert np.array_equal(disk.increase, [0.02, 0.03])
    with pytest.raises(AttributeError):
        disk.capacity = 30.0  # type: ignore[misc]


def test_scalars_are_spread_over_agents_and_arrays_keep_their_order() -> None:
    problem = Problem(
        [
            resource("a", capacity=4.0, increase=0.1, decrease=[0.5, 0.6]),
            resource("b", capacity=8.0, increase=np.array([0.2, 0.3]), decrease=0.0, threshold=0.75),
        ],
        PolynomialCosts([2], [[[1.0], [1.0]], [[2.0], [1.0]]]),
    )
    assert (problem.n_agents, problem.n_resources) == (2, 2)
    assert problem.increase.tolist() == [[0.1, 0.2], [0.1, 0.3]]
    assert problem.decrease.tolist() == [[0.5, 0.0], [0.6, 0.0]]
    assert problem.capacity.tolist() == [4.0, 8.0]
    assert problem.threshold.tolist() == [1.0, 0.75]
    assert problem.limit.tolist() == [4.0, 6.0]
    assert problem.normalization.tolist() == [0.02, 0.02]
    assert problem.resource_names == ("a", "b")
    assert problem.agent_names == ("0", "1")


@pytest.mark.parametrize("name", ["capacity", "threshold", "normalization", "increase", "decrease"])
def test_the_arrays_of_a_problem_cannot_be_written(name: str) -> None:
    values = getattr(quadratic_problem([1.0, 2.0]), name)
    with pytest.raises(ValueError, match="read-only"):
        values[...] = 7.0


@pytest.mark.parametrize("field", ["increase", "decrease"])
@pytest.mark.parametrize("length", [1, 3])
def test_a_value_for_each_agent_must_be_one_for_each(field: str, length: int) -> None:
    message = f"shape of {field} of memory = ({length},): must be (2,); give one number for all agents"
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        Problem([resource(**{field: [0.5] * length})], TWO_AGENTS)


@pytest.mark.parametrize(
    ("resources", "options", "message"),
    [
        ([], {}, "names of the resources = []: must be one or more, each different"),
        (["a", "a"], {}, "names of the resources = ['a', 'a']: must be one or more, each different"),
        (["a", "b"], {}, "costs.n_resources = 1: must be 2, the number of resources"),
        (["a"], {"agent_names": ["x"]}, "agent_names = ['x']: must be 2 different names"),
        (["a"], {"agent_names": ["x", "x"]}, "agent_names = ['x', 'x']: must be 2 different names"),
        (["a"], {"agent_names": ["x", "y", "z"]}, "agent_names = ['x', 'y', 'z']: must be 2 different names"),
    ],
)
def test_a_problem_refuses_what_does_not_fit_together(
    resources: list[str], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        Problem([resource(name) for name in resources], TWO_AGENTS, **options)


def test_agents_may_have_names() -> None:
    problem = Problem([resource()], TWO_AGENTS, agent_names=["north", "south"])
    assert problem.agent_names == ("north", "south")


@pytest.mark.parametrize("agent_names", [[["north"], "south"], [1, 2]])
def test_names_of_agents_that_are_no_strings_are_refused(agent_names: Any) -> None:
    with pytest.raises(InputError, match="agent_names"):
        Problem([resource()], TWO_AGENTS, agent_names=agent_names)


def test_a_problem_is_replaced_part_by_part() -> None:
    problem = Problem([resource(capacity=3.0)], TWO_AGENTS, agent_names=["a", "b"])
    other = problem.replace(resources=[resource(capacity=4.0)])
    assert other.capacity.tolist() == [4.0]
    assert (other.costs, other.agent_names) == (problem.costs, ("a", "b"))
    assert problem.capacity.tolist() == [3.0]
    # Names that were given are those of the agents; others follow their number.
    three = PolynomialCosts([2], [[[1.0]]] * 3)
    with pytest.raises(InputError, match="agent_names"):
        problem.replace(costs=three)
    assert Problem([resource()], TWO_AGENTS).replace(costs=three).agent_names == ("0", "1", "2")


def test_a_part_that_a_problem_has_not_is_refused_with_the_list() -> None:
    problem = Problem([resource()], TWO_AGENTS)
    words = "'cost': must be one of resources, costs, agent_names; did you mean 'costs'"
    with pytest.raises(InputError, match=f"argument of Problem.replace = {words}"):
        problem.replace(cost=TWO_AGENTS)
