"""Scenario files: what is written is what is read, and what is refused is refused with its line."""

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from aimd_des import InputError, Recording, run_synchronous
from aimd_des.channel import BroadcastChannel
from aimd_des.engine.simulation import Simulation
from aimd_des.scenario import Scenario, load_scenario
from aimd_des.scenario.models import model_parameters, named_model
from models import smart_cameras
from tests.conftest import INLINE, ROOT, quietly
from tests.scenario_examples import load

BY_MODEL = """
title = "cameras"
until = 200.0
seed = 3
model = "models.smart_cameras"

[parameters]
n_cameras = 5

[channel]
latency = 0.5
"""


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Models are looked for in the working directory, too, which goes onto the path."""
    monkeypatch.chdir(tmp_path_factory.mktemp("cwd"))
    monkeypatch.syspath_prepend(str(ROOT))


def line_of(text: str, beginning: str, nth: int = 0) -> int:
    """The number of the n-th line that begins so."""
    lines = [number for number, line in enumerate(text.splitlines(), 1) if line.startswith(beginning)]
    return lines[nth]


def refusals(text: str) -> list[str]:
    """The sentences with which a file is refused, without the name of the file."""
    with pytest.raises(InputError) as caught:
        load(text)
    lines = str(caught.value).splitlines()
    assert all(line.startswith("scenario.toml:") for line in lines)
    return [line.removeprefix("scenario.toml:") for line in lines]


# -- what is written is what is read ---------------------------------------------------------------------

POSITIVE = st.floats(1e-300, 1e300)
# Whatever fits on a line.
LETTERS = st.characters(exclude_categories=["Cs", "Cc", "Zl", "Zp"])
TEXT = st.text(LETTERS, max_size=20)


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    """Any scenario with the problem written out or by a model's name."""
    dynamics = draw(st.sampled_from(["discrete", "synchronous"]))
    data: dict[str, Any] = {
        "until": draw(st.integers(1, 10**9) if dynamics == "synchronous" else POSITIVE),
        "seed": draw(st.integers(0, 2**62)),
        "dynamics": dynamics,
    }
    optional: dict[str, st.SearchStrategy[Any]] = {
        "title": TEXT,
        "recording": st.fixed_dictionaries(
            {},
            optional={
                "demand": st.sampled_from(["auto", "end", 0.1, 7.0, [0.0, 0.1, 3.5]]),
                "allocations": st.sampled_from(["auto", "end", 12.5]),
                "tail": st.integers(0, 500),
            },
        ),
    }
    if data["dynamics"] == "synchronous":
        optional["lag"] = st.sampled_from([0, 1])
    else:
        clock = {"period": POSITIVE, "phase": st.floats(0.0, 1e300)}
        optional["control_unit"] = st.fixed_dictionaries({}, optional=clock)
        optional["clocks"] = st.fixed_dictionaries({}, optional=clock)
        probability = st.floats(0.0, 1.0)
        optional["channel"] = st.fixed_dictionaries(
            {},
            optional={
                "latency": st.floats(0.0, 1e9) | st.lists(st.floats(0.0, 1e9), min_size=1, max_size=3),
                "loss": probability | st.lists(probability, min_size=1, max_size=3),
            },
        )
    data |= draw(st.fixed_dictionaries({}, optional=optional))
    return Scenario.model_validate(data | draw(st.one_of(inline_problems(), models_by_name())))


def models_by_name() -> st.SearchStrategy[dict[str, Any]]:
    parameters = {
        "n_cameras": st.integers(1, 10**9),
        "increase": st.sampled_from(["as_run", "as_printed"]),
        "normalization": POSITIVE,
        "seed": st.integers(0, 99),
    }
    return st.fixed_dictionaries(
        {"model": st.just("models.smart_cameras")},
        optional={"parameters": st.fixed_dictionaries({}, optional=parameters)},
    )


@st.composite
def inline_problems(draw: st.DrawFn) -> dict[str, Any]:
    n, m, powers = draw(st.integers(1, 3)), draw(st.integers(1, 3)), draw(st.sampled_from([[1], [2, 4], [7]]))
    factor = st.floats(-1e300, 1e300) | st.integers(0, 99)
    rows = st.lists(factor, min_size=len(powers), max_size=len(powers))
    share = st.floats(0.0, 0.999)
    table = st.fixed_dictionaries(
        {
            "name": st.text(LETTERS, min_size=1, max_size=9),
            "capacity": POSITIVE | st.integers(1, 9),
            "increase": POSITIVE | st.lists(POSITIVE, min_size=n, max_size=n),
            "decrease": share | st.lists(share, min_size=n, max_size=n),
            "normalization": POSITIVE,
        },
        optional={"threshold": st.floats(0.1, 1.0), "unit": TEXT},
    )
    agents = st.lists(st.lists(rows, min_size=m, max_size=m), min_size=n, max_size=n)
    return {
        "resources": draw(st.lists(table, min_size=m, max_size=m)),
        "costs": {"exponents": powers, "coefficients": draw(agents)},
    }


@given(scenarios())
def test_what_is_written_is_read_as_the_same(scenario: Scenario) -> None:
    written = scenario.to_toml()
    again = load(written)
    assert again == scenario
    assert again.to_toml() == written


@given(scenarios())
def test_what_is_resolved_is_written_and_read_as_the_same(scenario: Scenario) -> None:
    resolved = scenario.resolved()
    assert load(resolved.to_toml()) == resolved
    assert resolved.resolved() == resolved


def test_every_value_is_spelled_out() -> None:
    written = load(INLINE).to_toml()
    for key in (
        "title",
        "until",
        "seed",
        "dynamics",
        "threshold",
        "unit",
        "tail",
        "latency",
        "loss",
        "period",
    ):
        assert re.search(rf"^{key} = ", written, re.MULTILINE), key
    assert "lag" not in written
    assert "channel" not in load(synchronous()).to_toml()


def synchronous(extra: str = "") -> str:
    return f'dynamics = "synchronous"\n{extra}\n' + INLINE


def test_a_resolved_scenario_names_every_parameter_of_the_model() -> None:
    scenario = load(BY_MODEL)
    assert scenario.parameters == {"n_cameras": 5}
    assert scenario.resolved().parameters == {
        "seed": 3,
        "n_cameras": 5,
        "increase": "as_run",
        "normalization": 1 / 90,
    }
    assert load(BY_MODEL, seed=8).resolved().parameters["seed"] == 8
    own = BY_MODEL.replace("n_cameras = 5", "n_cameras = 5\nseed = 1")
    assert load(own, seed=8).resolved().parameters["seed"] == 1


def test_a_scenario_with_its_problem_written_out_is_resolved_already() -> None:
    scenario = load(INLINE)
    assert scenario.resolved() is scenario


def test_scenarios_cannot_be_changed() -> None:
    scenario = load(INLINE)
    with pytest.raises(ValidationError, match="frozen"):
        scenario.until = 3.0


# -- what is run -----------------------------------------------------------------------------------------


def test_a_file_is_run_as_its_parts_say() -> None:
    scenario = load(INLINE + "\n[channel]\nlatency = [0.5, 0.25, 1.0, 2.5, 0.0]\nloss = 0.1\n")
    channel = BroadcastChannel(latency=[0.5, 0.25, 1.0, 2.5, 0.0], loss=0.1)
    expected = quietly(Simulation(scenario.problem(), channel=channel, seed=4).run, 60.0)
    assert quietly(scenario.run).digest == expected.digest
    assert len(expected.signals) > 10


@pytest.mark.parametrize("lag", [0, 1])
def test_the_synchronous_algorithm_is_run_as_the_file_says(lag: int) -> None:
    scenario = load(synchronous(f"lag = {lag}"))
    recording = Recording("auto", "auto", 100)
    expected = quietly(run_synchronous, scenario.problem(), steps=60, seed=4, lag=lag, recording=recording)
    result = quietly(scenario.run)
    assert result.digest == expected.digest
    assert result.demand.equals(expected.demand)
    assert result.allocations.equals(expected.allocations)


def test_a_model_is_run_with_the_seed_of_the_scenario() -> None:
    scenario = load(BY_MODEL)
    problem = smart_cameras(seed=3, n_cameras=5)
    expected = Simulation(problem, channel=BroadcastChannel(latency=0.5), seed=3).run(200)
    assert scenario.run().digest == load(scenario.resolved().to_toml()).run().digest == expected.digest
    assert load(BY_MODEL, seed=4).run().digest != expected.digest


def test_a_model_of_the_users_own_is_found_in_the_working_directory() -> None:
    Path("my_own_model.py").write_text(
        "from aimd_des import PolynomialCosts, Problem, Resource\n"
        "from aimd_des.scenario.models import model\n\n"
        "@model\n"
        "def mine(size: int = 2) -> Problem:\n"
        "    memory = Resource('memory', 1.0, 0.1, 0.5, 0.1)\n"
        "    return Problem([memory], PolynomialCosts([2], [[[1.0]]] * size))\n",
        encoding="utf-8",
    )
    scenario = load('until = 50\nmodel = "my_own_model"\nparameters.size = 3\n')
    assert scenario.problem().n_agents == 3
    assert len(scenario.run().signals) > 5
    assert scenario.resolved().parameters["size"] == 3


def test_a_parameter_of_a_model_may_be_none() -> None:
    Path("a_model_with_none.py").write_text(
        "from aimd_des.scenario.models import model\n\n@model\ndef mine(weights=None, size=2):\n    ...\n",
        encoding="utf-8",
    )
    scenario = load('until = 50\nmodel = "a_model_with_none"\n').resolved()
    assert load(scenario.to_toml()).resolved() == scenario


def test_what_is_no_whole_number_of_steps_is_refused() -> None:
    with pytest.raises(InputError, match=r": until = 60\.5: must be a whole number of steps$"):
        load(synchronous().replace("until = 60", "until = 60.5"))


# -- what is refused -------------------------------------------------------------------------------------


def test_a_line_within_a_text_is_no_key() -> None:
    title, rest = INLINE.split("\n", 1)
    text = rest.replace("until = 60", "until = true").replace("seed = 4", 'title = """\nuntil = 60\n"""')
    assert title.startswith("title")
    assert refusals(text)[0].startswith("1: until = ")


@pytest.mark.parametrize(
    ("old", "new", "line", "sentence"),
    [
        ("until = 60", "untill = 60", "untill", "untill: unknown key 'untill'; did you mean 'until'?"),
        ("tail = 5", "tial = 5", "tial", "recording.tial: unknown key 'tial'; did you mean 'tail'?"),
        (
            "tail = 5",
            "xyz = 5",
            "xyz",
            "recording.xyz: unknown key 'xyz'; known are demand, allocations, tail",
        ),
        (
            "exponents",
            "exponent",
            "exponent",
            "costs.exponent: unknown key 'exponent'; did you mean 'exponents'?",
        ),
        (
            "[recording]",
            "[recordings]",
            "[recordings]",
            "recordings: unknown key 'recordings'; did you mean 'rec",
        ),
        ("seed = 4", "seed = 4.5", "seed", "seed = 4.5: must be a valid integer"),
        ("seed = 4", "seed = true", "seed", "seed = True: must be a valid integer"),
        ("seed = 4", 'seed = "4"', "seed", "seed = '4': must be a valid integer"),
        ("until = 60", 'until = "60"', "until", "until = '60': must be a valid number"),
        ("until = 60", "until = true", "until", "until = True: must be a valid number"),
        ("until = 60", "until = [60]", "until", "until = [60]: must be a valid number"),
        ("tail = 5", "tail = 5.5", "tail", "recording.tail = 5.5: must be a valid integer"),
        (
            "tail = 5",
            'demand = "often"',
            "demand",
            "recording.demand = 'often': must be 'auto' or 'end'",
        ),
        ("seed = 4", 'dynamics = "static"', "dynamics", "dynamics = 'static': must be 'discrete'"),
        (
            "exponents = [2]",
            "exponents = [2.5]",
            "exponents",
            "costs.exponents.0 = 2.5: must be a valid int",
        ),
        ("seed = 4", 'agents = "fleets"', "agents", "agents = 'fleets': must be "),
    ],
)
def test_an_unknown_key_or_a_wrong_type_is_refused_with_its_line(
    old: str, new: str, line: str, sentence: str
) -> None:
    text = INLINE.replace(old, new)
    assert text != INLINE
    sentences = refusals(text)
    number = line_of(text, line)
    assert any(found.startswith(f"{number}: {sentence}") for found in sentences), sentences


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("capacity", "-3.0", "capacity of disk = -3.0: must be a finite number greater than 0"),
        ("capacity", "0", "capacity of disk = 0.0: must be a finite number greater than 0"),
        ("capacity", "nan", "capacity of disk = nan: must be a finite number greater than 0"),
        ("capacity", "inf", "capacity of disk = inf: must be a finite number greater than 0"),
        ("decrease", "1", "decrease of disk = 1.0: must be a finite number at least 0 and less than 1"),
        ("decrease", "nan", "decrease of disk = nan: must be a finite number at least 0 and less than 1"),
        (
            "decrease",
            "[0.5, 1.0]",
            "decrease of disk[1] = 1.0: must be a finite number at least 0 and less than 1",
        ),
        ("increase", "0", "increase of disk = 0.0: must be a finite number greater than 0"),
        ("increase", "[]", "shape of increase of disk = (0,): must be (n_agents,), one for each agent"),
        ("increase", "[0.1]", None),
        ("normalization", "-1e-3", "normalization of disk = -0.001: must be a finite number greater than 0"),
        ("threshold", "1.5", "threshold of disk = 1.5: must be a finite number greater than 0 and at most 1"),
        ("name", '""', "name of a resource = '': must be a string that is not empty"),
    ],
)
def test_a_value_of_a_resource_outside_its_range_is_refused_with_its_table(
    key: str, value: str, sentence: str | None
) -> None:
    table = INLINE.index("[[resources]]", INLINE.index("[[resources]]") + 1)
    head, tail = INLINE[:table], INLINE[table:]
    text = head + re.sub(rf"(?m)^{key} = .*$", f"{key} = {value}", tail, count=1)
    assert text != INLINE
    if sentence is None:  # how many agents there are is known only with the costs
        with pytest.raises(InputError, match=r"^shape of increase of disk = \(1,\): must be \(5,\)"):
            load(text).problem()
    else:
        (found,) = refusals(text)
        number = line_of(text, "[[resources]]", 1)
        assert re.match(
            rf"({number}|{line_of(text, key, -1)}): resources\.1(\.\w+)?: {re.escape(sentence)}", found
        )


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("until = 60", "until = nan", "until = nan: must be a finite number greater than 0"),
        ("until = 60", "until = inf", "until = inf: must be a finite number greater than 0"),
        ("until = 60", "until = -1", "until = -1.0: must be a finite number greater than 0"),
        ("seed = 4", "seed = -4", "seed = -4: must be an integer of at least 0"),
        (
            "[[1.0], [2.0]]",
            "[[nan], [2.0]]",
            "coefficients[0, 0, 0] = nan: must be a finite number; give one",
        ),
        ("[[1.0], [2.0]]", "[[1.0]]", "coefficients = "),
        ("[[1.0], [2.0]]", "[[1.0, 3.0], [2.0, 3.0]]", "coefficients = "),
        (
            "exponents = [2]",
            "exponents = [2, 2]",
            "exponents = [2, 2]: must be one or more different integers",
        ),
        (
            "exponents = [2]",
            "exponents = [0]",
            "exponents[0] = 0: must be an integer of at least 1 and at most 64",
        ),
        ("exponents = [2]", "exponents = []", "exponents = []: must be one or more different integers"),
        ("tail = 5", "tail = -1", "tail = -1: must be an integer of at least 0"),
        ("tail = 5", "demand = -1", "demand = -1.0: must be a finite number greater than 0"),
        ("tail = 5", "demand = nan", "demand = nan: must be a finite number greater than 0"),
        ("tail = 5", "demand = [2, 1]", "demand = [2.0, 1.0]: must be strictly ascending times"),
        ("[recording]", "[channel]\nlatency = -1\n[recording]", "-1.0: must be a finite number at least 0"),
        (
            "[recording]",
            "[channel]\nloss = nan\n[recording]",
            "nan: must be a finite number at least 0 and at most",
        ),
        (
            "[recording]",
            "[channel]\nloss = [0.5, 1.5]\n[recording]",
            "[1] = 1.5: must be a finite number at least",
        ),
        (
            "[recording]",
            "[clocks]\nperiod = 0\n[recording]",
            "period = 0.0: must be a finite number greater than 0",
        ),
        (
            "[recording]",
            "[control_unit]\nphase = inf\n[recording]",
            "phase = inf: must be a finite number at least",
        ),
        ("[recording]", 'model = "m"\n[recording]', None),
    ],
)
def test_a_value_outside_its_range_is_refused(old: str, new: str, sentence: str | None) -> None:
    text = INLINE.replace(old, new)
    assert text != INLINE
    found = refusals(text)
    if sentence is not None:
        assert len(found) == 1
        assert sentence in found[0]


def test_the_problem_is_a_model_or_is_written_out_and_not_both() -> None:
    allowed = "either a model, or resources together with costs"
    assert refusals('model = "models.smart_cameras"\n' + INLINE) == [
        f" the problem = ['model', 'resources', 'costs']: must be {allowed}"
    ]
    assert refusals("until = 5\n") == [f" the problem = []: must be {allowed}"]
    only_costs = "until = 5\n[costs]\nexponents = [2]\ncoefficients = [[[1.0]]]\n"
    assert refusals(only_costs) == [f" the problem = ['costs']: must be {allowed}"]


def test_parameters_are_those_of_a_model() -> None:
    (sentence,) = refusals(INLINE + "\n[parameters]\nn_cameras = 3\n")
    assert "parameters" in sentence


@pytest.mark.parametrize(
    ("table", "key"),
    [
        ("[channel]\nlatency = 0.5", "channel"),
        ("[control_unit]\nperiod = 1.0", "control_unit"),
        ("[clocks]\nphase = 0.5", "clocks"),
    ],
)
def test_what_has_no_meaning_is_refused_instead_of_ignored(table: str, key: str) -> None:
    (sentence,) = refusals(synchronous() + f"\n{table}\n")
    assert re.search(rf"\b{key}: has no meaning .*; leave it out$", sentence)
    (sentence,) = refusals("lag = 1\n" + INLINE)
    assert re.search(r"\blag: has no meaning .*; leave it out$", sentence)


@pytest.mark.parametrize("value", ["2", "-1", '"1"', "true", "0.0"])
def test_a_lag_is_zero_or_one(value: str) -> None:
    text = synchronous(f"lag = {value}")
    (sentence,) = refusals(text)
    assert sentence.startswith(f"{line_of(text, 'lag')}: lag = ")
    assert re.search(r"must be (a valid integer|(less|greater) than or equal to [01])$", sentence)


def test_several_mistakes_are_told_at_once() -> None:
    text = INLINE.replace("until = 60", "untill = 60").replace("tail = 5", 'tail = "5"')
    found = refusals(text)
    assert len(found) == 3
    for word in (
        "did you mean 'until'?",
        "until: is missing",
        "recording.tail = '5': must be a valid int",
    ):
        assert any(word in sentence for sentence in found), word


def test_what_is_missing_is_named_with_its_table() -> None:
    text = re.sub(r"(?m)^capacity = 2.0\n", "", INLINE)
    (sentence,) = refusals(text)
    assert sentence == f"{line_of(text, '[[resources]]', 1)}: resources.1.capacity: is missing"


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"until = ", "scenario.toml: is not valid TOML: Invalid value"),
        (b"until = 5\nuntil = 6\n", "scenario.toml: is not valid TOML: Cannot overwrite a value"),
        (b"title = '\xff'\n", "scenario.toml: must be saved as UTF-8 (invalid start byte at byte 9)"),
        ("title = 'x'".encode("utf-16"), "scenario.toml: must be saved as UTF-8 ("),
        (b"a = " + b"[" * 5000, "scenario.toml: is not valid TOML: "),
    ],
)
def test_a_file_that_is_no_toml_is_refused(content: bytes, sentence: str) -> None:
    Path("scenario.toml").write_bytes(content)
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}"):
        load_scenario(Path("scenario.toml"))


def test_what_editors_put_before_the_text_and_at_the_ends_of_lines_changes_nothing() -> None:
    Path("scenario.toml").write_bytes(b"\xef\xbb\xbf" + INLINE.replace("\n", "\r\n").encode())
    assert load_scenario(Path("scenario.toml")) == load(INLINE)


def test_a_number_of_five_thousand_digits_is_refused() -> None:
    with pytest.raises(InputError):
        load(INLINE.replace("seed = 4", f"seed = {'4' * 5000}"))


def test_a_file_that_cannot_be_read_is_refused() -> None:
    with pytest.raises(InputError, match=r"^missing\.toml: there is no such file$"):
        load_scenario(Path("missing.toml"))
    Path("folder.toml").mkdir()
    with pytest.raises(InputError, match=r"^folder\.toml: cannot be read \("):
        load_scenario(Path("folder.toml"))


NO_MODULE = "must be a module on the Python path or in the working directory"


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        (
            "models.smart_camera",
            f"{NO_MODULE}; did you mean 'models.smart_cameras'?",
        ),
        (
            "nowhere",
            f"{NO_MODULE}; install it, or run from the folder",
        ),
        ("nowhere.at_all", f"{NO_MODULE}; install it"),
        ("models smart", NO_MODULE),
        ("", NO_MODULE),
        ("models..smart_cameras", NO_MODULE),
        ("math", "must be a module that registers a model; decorate its function with aimd_des.model"),
        ("__main__", "must be a module"),
    ],
)
def test_an_unknown_model_is_refused(name: str, sentence: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("__main__.__spec__", None)  # as in the program that is installed
    scenario = load(BY_MODEL.replace("models.smart_cameras", name))
    with pytest.raises(InputError, match=f"^model = {re.escape(repr(name))}: {re.escape(sentence)}"):
        scenario.problem()


@pytest.mark.parametrize(
    ("parameter", "sentence"),
    [
        ("n_camera = 5", "parameters of models.smart_cameras = 'n_camera': must be one of seed, n_cameras, "),
        ("n_cameras = 0", "n_cameras = 0: must be an integer of at least 1"),
        ("n_cameras = 5.0", "n_cameras = 5.0: must be an integer of at least 1"),
        ("normalization = nan", "normalization of memory = nan: must be a finite number greater than 0"),
        ('increase = "other"', "increase = 'other': must be one of 'as_run', 'as_printed'"),
    ],
)
def test_a_wrong_parameter_of_a_model_is_refused(parameter: str, sentence: str) -> None:
    scenario = load(BY_MODEL.replace("n_cameras = 5", parameter))
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}"):
        scenario.problem()


def test_the_nearest_parameter_is_named() -> None:
    with pytest.raises(InputError, match=r"did you mean 'n_cameras'\?$"):
        model_parameters("models.smart_cameras", {"n_camera": 5}, 0)


def test_models_are_registered_by_the_name_of_their_module() -> None:
    assert named_model("models.smart_cameras") is smart_cameras


def test_a_length_that_does_not_fit_the_agents_is_refused() -> None:
    scenario = load(INLINE + "\n[channel]\nlatency = [0.5, 0.5]\n")
    with pytest.raises(
        InputError, match=r"= \(2,\): must be \(5,\); give one number for all agents or one for"
    ):
        scenario.run()


def test_numpys_numbers_arrays_and_series_are_taken_as_a_file_has_them() -> None:
    """In keys, in tables, and in values that replace those of a file."""
    Path("five.toml").write_text(INLINE, encoding="utf-8")
    plainly = load_scenario(
        "five.toml", until=40, **{"channel.latency": 0.25, "clocks.phase": [0.0, 0.5, 0.25, 0.0, 0.5]}
    )
    dressed = load_scenario(
        "five.toml",
        until=np.array(40),
        **{"channel.latency": np.float32(0.25), "clocks.phase": pd.Series([0.0, 0.5, 0.25, 0.0, 0.5])},
    )
    assert dressed == plainly
    assert dressed.to_toml() == plainly.to_toml()


def test_in_python_what_is_wrong_is_refused_in_the_sentences_of_files() -> None:
    with pytest.raises(InputError, match=r"^until = -1\.0: must be a finite number greater than 0$"):
        Scenario(model="models.smart_cameras", until=-1.0)
    wrong: dict[str, Any] = {"model": "models.smart_cameras", "untill": 5}
    sentences = r"^until: is missing\nuntill: .*; did you mean 'until'\?$"
    with pytest.raises(InputError, match=sentences):
        Scenario(**wrong)
    with pytest.raises(InputError, match=sentences):
        Scenario.model_validate(wrong)


def test_a_fleet_and_processes_give_the_same_digest() -> None:
    digests = {Scenario(**tomllib.loads(INLINE), agents=word).run().digest for word in ("process", "fleet")}
    assert len(digests) == 1
