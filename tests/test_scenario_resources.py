"""Resources of a model, changed by a scenario: in files, by `--set`, and along the axes of a study."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aimd_des import InputError, Study
from aimd_des.scenario import Scenario, load_scenario, validate_scenario
from aimd_des.scenario.dotted_keys import with_settings
from aimd_des.study.points import expand, run_of
from tests.command_line import run, said, write
from tests.conftest import quietly

BASE: dict[str, Any] = {"until": 5, "model": "models.smart_cameras", "parameters": {"n_cameras": 3}}


def scenario(**settings: Any) -> Scenario:
    return validate_scenario(with_settings(BASE, settings), "it")


def test_what_is_changed_is_changed_and_the_rest_is_the_models() -> None:
    given: dict[str, Any] = {"resources.0.capacity": 20, "resources.2.increase": [0.1, 0.2, 0.3]}
    model, changed = scenario().problem(), scenario(**given).problem()
    assert changed.capacity.tolist() == [20.0, *model.capacity[1:]]
    assert changed.increase[:, 2].tolist() == [0.1, 0.2, 0.3]
    assert np.array_equal(changed.increase[:, :2], model.increase[:, :2])
    assert np.array_equal(changed.decrease, model.decrease)
    assert changed.resource_names == model.resource_names
    assert changed.agent_names == model.agent_names
    point = np.ones((3, 3))
    assert np.array_equal(changed.costs.gradient(point), model.costs.gradient(point))


def test_a_changed_resource_is_a_part_of_the_scenario(tmp_path: Path) -> None:
    one = scenario(**{"resources.1.threshold": 0.5})
    (tmp_path / "it.toml").write_text(one.resolved().to_toml(), encoding="utf-8")
    assert load_scenario(tmp_path / "it.toml") == one.resolved()
    assert one.canonical() != scenario().canonical()
    capacities = [scenario(**{"resources.0.capacity": value}).canonical() for value in (20, 20.0, 21)]
    assert capacities[0] == capacities[1] != capacities[2]
    assert quietly(one.run).problem.threshold.tolist() == [1.0, 0.5, 1.0]


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        (
            {"resources.3.capacity": 1.0},
            "number of a resource = '3': must be one of those of the model: 0 (memory), 1 (disk), 2 (band",
        ),
        ({"resources.00.capacity": 1.0}, "number of a resource = '00'"),
        ({"resources.memory.capacity": 1.0}, "number of a resource = 'memory'"),
        ({"resources.0.capacity": -1.0}, "resources.0: capacity of memory = -1.0: must be"),
        ({"resources.0.increase": [0.1]}, "increase of memory"),
        (
            {"resources.0.capaciti": 1.0},
            "resources.0.capaciti: unknown key 'capaciti'; did you mean 'capacity'?",
        ),
        ({"resources.0.name": "ram"}, "resources.0.name: unknown key 'name'"),
        ({"resources.0": 1.0}, "resources.0"),
        ({"resources": [{"capacity": 1.0}]}, "resources.0.name: is missing"),
        ({"resources": {"capacity": 1.0}}, "resources: keys = ['capacity']: must be below [[resources]]"),
        ({"costs": {"exponents": [2], "coefficients": [[[1.0]]]}}, "the problem = ['model', 'costs']"),
    ],
)
def test_what_makes_no_problem_is_refused(settings: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        scenario(**settings).problem()
    assert sentence in str(caught.value)


def test_a_problem_that_is_written_out_has_a_list_of_resources() -> None:
    data = {
        "until": 5,
        "resources": {"0": {"capacity": 1.0}},
        "costs": {"exponents": [2], "coefficients": [[[1.0]]]},
    }
    with pytest.raises(InputError, match=r"resources = \['0'\]: must be tables in a list, \[\[resources\]\]"):
        validate_scenario(data, "it")


def test_capacity_of_a_model_is_an_axis() -> None:
    axis = {"name": "capacity", "key": "resources.0.capacity", "values": [20.0, 30.0]}
    study = Study.model_validate({"scenario": BASE, "axes": [axis]})
    points = expand(study)
    assert [run_of(study, point, 0).scenario.problem().capacity[0] for point in points] == [20.0, 30.0]
    assert points[0].problem["capacity"] != points[1].problem["capacity"]
    assert points[0].problem["costs"] == points[1].problem["costs"]


def test_capacity_of_a_model_can_be_set_on_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = write('until = 5\nmodel = "models.smart_cameras"\nparameters.n_cameras = 3\n')
    outcome = run(str(file), "--out", "out", "--set", "resources.0.capacity=20")
    assert outcome.exit_code == 0, outcome.output
    assert load_scenario(Path("out/scenario.toml")).problem().capacity[0] == 20.0
    assert "20" in next(line for line in said("show", "out").splitlines() if "resources" in line)
