"""Everything that a simulation offers, said in a file: the same run as by hand, and refusals by their key."""

import pickle
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from aimd_des import (
    BroadcastChannel,
    Crossing,
    InputError,
    Problem,
    Simulation,
    averaging,
    compensation,
    interventions,
    latency,
    loss,
    responses,
    run_synchronous,
    topology,
)
from aimd_des.scenario import Scenario, validate_scenario
from aimd_des.scenario.dry_run import check_to_run
from aimd_des.scenario.kind_tables import KindTable, NetworkSettings
from aimd_des.scenario.schema import scenario_schema
from models import smart_cameras
from tests.conftest import quietly
from tests.scenario_examples import EXAMPLES, MODEL, inline, load, write_files

SCHEMA = scenario_schema()
VALIDATOR = jsonschema.Draft7Validator(SCHEMA)


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(own_folder: None, tmp_path: Path) -> None:
    write_files(tmp_path)


def test_a_scenario_can_be_sent_to_another_process() -> None:
    for text in EXAMPLES.values():
        scenario = load(text)
        sent = pickle.loads(pickle.dumps(scenario))
        assert type(sent) is Scenario
        assert sent == scenario
        assert sent.to_toml() == scenario.to_toml()


# -- what is run -----------------------------------------------------------------------------------------

CHANGES = [
    interventions.CapacityStep("disk", 5, 1.5),
    interventions.CapacityRamp("memory", 2.5, 20, 2.0, steps=4),
    interventions.CapacityProfile("memory", np.array([0.0, 10.0]), np.array([2.0, 3.5]), 24),
    interventions.Join(1, 7.5),
    interventions.Absence([0, 3], 10, 20),
    interventions.Crash(4, 12.5),
    interventions.UnusualActivity(2, 3, 33.5, weight=0.25),
    interventions.Failover(15, 4.5),
    interventions.Partition(20, 5, [0, 1]),
]


def redrawn(k: int) -> Any:
    """What the page says about prices, written out."""
    seed = np.random.SeedSequence(3, spawn_key=(k,)).generate_state(1, np.uint64)[0]
    return smart_cameras(seed=int(seed), n_cameras=5).costs


LOST = [[False, True, False, False, False], [True, False, False, False, True]]
BY_HAND: dict[str, Callable[[], dict[str, Any]]] = {
    "inline": dict,
    "crossing": lambda: {
        "dynamics": "continuous",
        "control_unit": Crossing(0.5, longest_hold_off=4),
        "channel": BroadcastChannel(2.0),
    },
    "window": lambda: {"averaging": averaging.Window(40)},
    "polynomial": lambda: {"averaging": averaging.Polynomial(2.5)},
    "event normalised": lambda: {"response": responses.EventNormalised()},
    "derandomised": lambda: {"response": responses.Derandomised("events")},
    "full cuts": lambda: {"response": responses.Derandomised(full=True)},
    "window of continuous agents": lambda: {
        "dynamics": "continuous",
        "averaging": averaging.Window(0.5, 3),
    },
    "known": lambda: {
        "channel": BroadcastChannel(loss=0.2),
        "compensation": compensation.KnownLoss([0.2, 0.2, 0.2, 0.2, 0.0]),
    },
    "estimated": lambda: {
        "channel": BroadcastChannel(loss=0.2),
        "compensation": compensation.EstimatedLoss(4),
    },
    "combined": lambda: {
        "channel": BroadcastChannel(loss=loss.Combined(loss.CommonMode(0.1), loss.Bernoulli(0.0)))
    },
    "latency gamma": lambda: {"channel": BroadcastChannel(latency.ShiftedGamma(2.0, 0.1, 0.2))},
    "latency measured": lambda: {"channel": BroadcastChannel(latency.Empirical([80, 120, 400], 0.001))},
    "loss trace": lambda: {"channel": BroadcastChannel(loss=loss.Trace(LOST, repeat=True))},
    "network star": lambda: {"channel": topology.tree(topology.star(5, [0.1, 0.2, 0.1, 0.2, 0.1], 0.1))},
    "network balanced_tree": lambda: {
        "channel": topology.tree(topology.balanced_tree(2, 2, 0.0, 0.05), agents=[2, 3, 4, 5, 6])
    },
    "network grid": lambda: {"channel": topology.tree(topology.grid(2, 3, 0.1, 0.1, root=(0, 1)))},
    "network random_geometric": lambda: {
        "channel": topology.tree(topology.random_geometric(5, 0.8, latency_per_distance=0.5, seed=2))
    },
    "network graphml": lambda: {
        "channel": topology.tree(topology.from_graphml("network.graphml", root="hub"))
    },
    "network edges": lambda: {
        "channel": topology.tree(topology.from_edges("links.csv", root="hub", latency="delay"))
    },
    "profile from a file": lambda: {
        "interventions": [
            interventions.CapacityProfile("memory", np.array([0.0, 8, 20]), np.array([3, 2, 2.5]), 24)
        ]
    },
    "all interventions": lambda: {"interventions": CHANGES},
}  # fmt: skip


@pytest.mark.parametrize("name", BY_HAND)
def test_a_file_gives_the_run_that_python_gives(name: str) -> None:
    scenario = load(EXAMPLES[name])
    expected = quietly(Simulation(scenario.problem(), **BY_HAND[name](), seed=4).run, 60)
    result = quietly(scenario.run)
    assert result.digest == expected.digest
    assert len(result.signals) > 10
    assert name == "inline" or result.digest != quietly(load(EXAMPLES["inline"]).run).digest


@pytest.mark.parametrize("over", ["tree", "flood"])
@pytest.mark.parametrize("spread", ["constant", "exponential"])
@pytest.mark.parametrize("burst", [None, 3])
def test_a_network_is_used_as_the_file_says(over: str, spread: str, burst: float | None) -> None:
    keys = f'over = "{over}"\nlatency_model = "{spread}"\nagents = [[0, 0], [0, 2], [1, 0], [1, 1], [1, 2]]'
    scenario = load(EXAMPLES["network grid"] + keys + (f"\nmean_burst = {burst}" if burst else ""))
    make = {"tree": topology.tree, "flood": topology.flood}[over]
    channel = make(
        topology.grid(2, 3, 0.1, 0.1, root=(0, 1)),
        latency={"constant": latency.Constant, "exponential": latency.Exponential}[spread],
        loss=loss.Bernoulli if burst is None else lambda p: loss.GilbertElliott(p, burst),
    )
    expected = quietly(Simulation(scenario.problem(), channel=channel, seed=4).run, 60)
    assert quietly(scenario.run).digest == expected.digest


def test_prices_are_drawn_by_the_model_as_the_page_says() -> None:
    scenario = load(EXAMPLES["prices"])
    problem = smart_cameras(seed=3, n_cameras=5)
    prices = interventions.Prices(12.5, redrawn)
    expected = Simulation(problem, interventions=[prices], seed=3).run(40)
    result = scenario.run()
    assert result.digest == expected.digest
    assert result.digest != load(MODEL).run().digest
    assert result.pieces["start"].unique().tolist() == [0.0, 12.5, 25.0, 37.5]
    assert result.pieces.equals(expected.pieces)  # with the optimum for each draw


def test_the_synchronous_algorithm_averages_as_the_file_says() -> None:
    scenario = load(EXAMPLES["synchronous"])
    how = averaging.Forgetting(20)
    expected = quietly(run_synchronous, scenario.problem(), steps=60, seed=4, lag=0, averaging=how)
    result = quietly(scenario.run)
    assert result.digest == expected.digest
    plain = load(EXAMPLES["synchronous"].partition("[averaging]")[0])
    assert quietly(plain.run).digest != expected.digest


def test_all_interventions_change_a_fleet_alike() -> None:
    digests = {
        quietly(load(EXAMPLES["all interventions"], agents=word).run).digest for word in ("process", "fleet")
    }
    assert len(digests) == 1


# -- what is written is what is read, and what editors are told --------------------------------------------


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_kind_is_written_and_read_as_the_same(name: str) -> None:
    scenario = load(EXAMPLES[name])
    written = scenario.to_toml()
    again = load(written)
    assert again == scenario
    assert again.to_toml() == written
    resolved = scenario.resolved()
    assert load(resolved.to_toml()) == resolved
    assert scenario.canonical() == again.canonical() == resolved.canonical()


def test_examples_are_different_runs() -> None:
    forms = {load(text).canonical() for text in EXAMPLES.values()}
    # Cumulative averages are the ones that hold anyway.
    assert len(forms) == len(EXAMPLES) - 1
    assert load(EXAMPLES["cumulative"]).canonical() == load(EXAMPLES["inline"]).canonical()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("mean = 0.5", "mean = 1"),
        ("shape = 3\nminimum = 0.1", "shape = 3\nminimum = 1"),
        ("loss = 0.05", "loss = 0"),
    ],
)
def test_a_number_in_a_table_with_a_kind_is_the_same_with_and_without_a_point(old: str, new: str) -> None:
    text = next(text for text in EXAMPLES.values() if old in text)
    assert load(text.replace(old, new)).canonical() == load(text.replace(old, f"{new}.0")).canonical()


def test_a_file_is_hashed_by_what_it_holds() -> None:
    for name, file in [("latency measured", "wifi.csv"), ("network graphml", "network.graphml")]:
        before = load(EXAMPLES[name]).canonical()
        Path(file).rename("moved.csv")
        moved = EXAMPLES[name].replace(file, "moved.csv")
        assert load(moved).canonical() == before
        path = Path("moved.csv")
        path.write_text(path.read_text(encoding="utf-8") + "\n", encoding="utf-8")
        assert load(moved).canonical() != before


def test_the_schema_is_one() -> None:
    jsonschema.Draft7Validator.check_schema(SCHEMA)
    assert SCHEMA["additionalProperties"] is False
    tables = [SCHEMA, *SCHEMA["definitions"].values()]
    for table in tables:
        assert table["description"]
        assert table["additionalProperties"] is False
        for key, part in table["properties"].items():
            assert part["description"], key


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_schema_accepts_what_is_accepted_and_refuses_an_unknown_key(name: str) -> None:
    read = tomllib.loads(EXAMPLES[name])
    spoken = load(EXAMPLES[name]).resolved().spoken()
    for data in (read, spoken):
        VALIDATOR.validate(data)
    for table in tables_in(spoken):
        table["unknown_key"] = 1
        assert not VALIDATOR.is_valid(spoken)
        with pytest.raises(InputError, match=r"^here: .*unknown key 'unknown_key'"):
            validate_scenario(spoken, "here")
        del table["unknown_key"]
    VALIDATOR.validate(spoken)


def tables_in(data: Any) -> list[dict[str, Any]]:
    """All tables but that of a model's parameters."""
    if isinstance(data, list):
        return [found for item in data for found in tables_in(item)]
    if not isinstance(data, dict):
        return []
    inner = [found for key, item in data.items() if key != "parameters" for found in tables_in(item)]
    return [data, *inner]


VAST = "[channel.network]" + EXAMPLES["network random_geometric"].partition("[channel.network]")[2]

# -- what is refused -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            '[averaging]\nkind = "widnow"',
            "averaging.kind = 'widnow': must be one of cumulative, window, forgetting, polynomial; did",
        ),
        (
            "[averaging]\nlength = 40",
            "averaging.kind: is missing; give one of cumulative, window, forgetting, polynomial",
        ),
        (
            '[averaging]\nkind = "window"\nlenght = 40',
            "averaging.lenght: unknown key 'lenght'; did you mean 'length'?",
        ),
        ('[averaging]\nkind = "window"', "averaging.length: is missing"),
        (
            '[averaging]\nkind = "window"\nlength = 30',
            "averaging: Window.length = 30.0: must be a multiple of its 20 parts",
        ),
        (
            '[averaging]\nkind = "forgetting"\ntime_constant = "long"',
            "averaging.time_constant = 'long': must be a valid number",
        ),
        (
            '[compensation]\nkind = "known"\nloss = 1',
            "compensation: KnownLoss.loss = 1.0: must be a finite number at least 0 and less than 1",
        ),
        (
            '[compensation]\nkind = "known"\nloss = "much"',
            "compensation.loss = 'much': must be a valid number or a valid list",
        ),
        (
            "[control_unit]\nhold_off = 1",
            "control_unit.hold_off: unknown key 'hold_off'; known are kind, period, phase, sensing_dela",
        ),
        (
            '[control_unit]\nkind = "crossing"',
            "control_unit.kind = 'crossing': must be one that samples with discrete dynamics",
        ),
        ("[control_unit]\nkind = 3", "control_unit.kind = 3: must be one of crossing, sampled"),
        ("[[channel]]\nlatency = 1", "channel = [{'latency': 1}]: must be a table; write [channel] in pl"),
        (
            '[interventions]\nkind = "crash"',
            "interventions = {'kind': 'crash'}: must be a valid list; write [[interventions]] in place of",
        ),
        (
            '[channel]\nlatency = "long"',
            "channel.latency = 'long': must be a number, a list with one for each agent, or a table whose k",
        ),
        ('[channel]\nlatency = [0.5, "x"]', "channel.latency.1 = 'x': must be a valid number"),
        (
            '[channel]\nlatency = { kind = "exponental", mean = 1 }',
            "channel.latency.kind = 'exponental': must be one of constant, empirical, measured",
        ),
        (
            '[channel]\nlatency = { kind = "exponential", mean = -1 }',
            "channel.latency: Exponential.mean = -1.0: must be a finite number at least 0",
        ),
        (
            '[channel]\nlatency = { kind = "measured", path = "wifi.csv", column = "dealy" }',
            "channel.latency: wifi.csv: column = 'dealy': must be one of delay; did you mean 'delay'?",
        ),
        (
            '[channel]\nlatency = { kind = "measured", path = "/dev/zero", column = "x" }',
            "channel.latency: path = '/dev/zero': must be the name of a file that exists",
        ),
        (
            '[channel]\nlatency = { kind = "measured", path = "", column = "x" }',
            "channel.latency: path = '': must be the name of a file that exists",
        ),
        (
            '[channel]\nloss = [{ kind = "common" }, { kind = "bernoulli", probability = 0.1 }]',
            "channel.loss.0.probability: is missing",
        ),
        (
            '[channel]\nloss = [{ kind = "common", probability = 0.1 }, 0.1]',
            "channel.loss.1 = 0.1: must be a table whose kind is one of bernoulli,",
        ),
        (
            '[channel]\nlatency = 1\nnetwork = { kind = "star", n_agents = 5 }',
            "channel: latency: has no meaning beside the other settings; leave it out",
        ),
        (
            '[channel]\nfifo = true\nnetwork = { kind = "star", n_agents = 5 }',
            "channel: fifo: has no meaning",
        ),
        (
            '[channel.network]\nkind = "star"\nn_agents = 5\nover = "air"',
            "channel.network.over = 'air': must be 'tree' or 'flood'",
        ),
        (
            '[channel.network]\nkind = "star"\nn_agents = 5\nloss = 2',
            "channel.network: loss = 2.0: must be a finite number at least 0 and at most 1",
        ),
        (
            '[channel.network]\nkind = "grid"\nrows = 2\ncolumns = 3\nroot = [0]',
            "channel.network.root: list should have at least 2 items",
        ),
        (
            '[channel.network]\nkind = "grid"\nrows = 2\ncolumns = 3\nroot = [5, 5]',
            "channel.network: root = (5, 5): must be one of the 6 nodes of the graph",
        ),
        (
            '[channel.network]\nkind = "grid"\nrows = 1000000000000\ncolumns = 3',
            "channel.network: size of the network = 'grid': must be at most 10,000,000 edges, and these are",
        ),
        (
            '[channel.network]\nkind = "balanced_tree"\nbranching = 1000000\nheight = 1000000',
            "channel.network: size of the network = 'balanced_tree': must be at most",
        ),
        (
            VAST.replace("n_agents = 5", "n_agents = 9000000"),
            "channel.network: size of the network = 'random_geometric'",
        ),
        (
            '[channel.network]\nkind = "star"\nn_agents = 9999999999',
            "channel.network: size of the network = 'star'",
        ),
        (
            '[channel.network]\nkind = "edges"\npath = "links.csv"\nroot = "hubb"\nlatency = "delay"',
            "channel.network: links.csv: root = 'hubb': must be one of the 6 nodes of the graph; did you me",
        ),
        (
            '[[interventions]]\nkind = "crahs"\nat = 1',
            "interventions.0.kind = 'crahs': must be one of join, absence, crash, unusual_activity,",
        ),
        (
            '[[interventions]]\nkind = "crash"\nagents = 1\nat = 9\nuntil = 8',
            "interventions.0: Crash.until = 8.0: must be a finite number greater than 9",
        ),
        (
            '[[interventions]]\nkind = "crash"\nagents = [1, 2.5]\nat = 9',
            "interventions.0.agents.1 = 2.5: must be a valid string or a valid integer",
        ),
        (
            '[[interventions]]\nkind = "crash"\nagents = true\nat = 9',
            "interventions.0.agents = True: must be a valid string or a valid integer or a valid list",
        ),
        (
            '[[interventions]]\nkind = "capacity_profile"\nresource = 0\npath = "day.csv"\ntimes = [0]',
            "interventions.0.times: unknown key 'times'; did you mean 'time'?",
        ),
        ('[[interventions]]\nkind = "capacity_profile"\nresource = 0', "interventions.0.times: is missing"),
        (
            '[[interventions]]\nkind = "prices"\nevery = 5',
            "interventions.0.kind = 'prices': must be left out where the problem is written out; prices are",
        ),
        (
            '[[interventions]]\nkind = "prices"\nevery = 5\nparameter = "n_cameras"',
            "interventions.0: parameter = 'n_cameras': must be one that takes a seed",
        ),
    ],
)
def test_what_is_wrong_is_refused_by_its_key(text: str, sentence: str) -> None:
    with pytest.raises(InputError) as refusal:
        load(inline("", text))
    lines = str(refusal.value).splitlines()
    assert any(re.sub(r"^scenario.toml(:\d+)?: ", "", line).startswith(sentence) for line in lines), lines


@pytest.mark.parametrize("key", ["compensation", "interventions", "control_unit", "channel", "clocks"])
def test_the_synchronous_algorithm_has_no(key: str) -> None:
    tables = {
        "compensation": '[compensation]\nkind = "estimated"',
        "interventions": '[[interventions]]\nkind = "failover"\nat = 1\nduration = 1',
    }
    with pytest.raises(InputError, match=rf"{key}: has no meaning beside the other settings; leave it out$"):
        load(inline('dynamics = "synchronous"', tables.get(key, f"[{key}]")))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            'kind = "crash"\nagents = 9\nat = 1',
            "interventions.1.agents: agent = 9: must be an integer of at least 0 and at most 4",
        ),
        (
            'kind = "crash"\nagents = []\nat = 1',
            "interventions.1.agents: agents = []: must be one agent or several different ones",
        ),
        (
            'kind = "partition"\nagents = ["camera 1", "x"]\nat = 1\nduration = 1',
            "interventions.1.agents: agent = 'camera 1': must be one of",
        ),
        (
            'kind = "capacity_step"\nresource = "dsik"\nat = 1\ncapacity = 1',
            "interventions.1.resource: resource = 'dsik': must be one of memory, disk; did you mean 'disk'?",
        ),
        ('kind = "absence"\nagents = 0\nat = 1', "interventions: absence of agent "),
    ],
)
def test_what_does_not_fit_the_problem_is_refused_by_its_key(text: str, sentence: str) -> None:
    first = '[[interventions]]\nkind = "crash"\nagents = 0\nat = 3\n\n'
    scenario = load(inline("", f"{first}[[interventions]]\n{text}"))
    for build in (scenario.problem, scenario.run):
        with pytest.raises(InputError, match=f"^{re.escape(sentence)}"):
            build()


def test_a_seed_that_the_model_does_not_have_is_refused_by_its_key() -> None:
    scenario = load(f'{MODEL}\n[[interventions]]\nkind = "prices"\nevery = 5\nparameter = "seeds"\n')
    with pytest.raises(
        InputError, match=r"^interventions\.0\.parameter: parameters of .*did you mean 'seed'\?$"
    ):
        scenario.problem()


def test_a_number_of_losses_that_is_not_that_of_the_agents_is_refused_by_its_key() -> None:
    scenario = load(EXAMPLES["known"].replace("0.2, 0.2, 0.2, 0.2, 0]", "0.2]"))
    with pytest.raises(InputError, match=r"^compensation: shape of KnownLoss\.loss = \(1,\): must be \(5,\)"):
        scenario.problem()


def test_a_network_for_other_agents_is_refused() -> None:
    scenario = load(
        EXAMPLES["network star"].replace("n_agents = 5", "n_agents = 6").replace("0.1]", "0.1, 0]")
    )
    with pytest.raises(InputError, match=r"^agents of the network = 6: must be 5"):
        scenario.run()


def test_a_large_network_is_built_when_the_run_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    built = []
    monkeypatch.setattr(NetworkSettings, "build", lambda self: built.append(self.of.name))
    for rows in (10, 10_000):
        load(f'{MODEL}\n[channel.network]\nkind = "grid"\nrows = {rows}\ncolumns = 10\n')
    assert built.count("grid") == 1


# -- parameters of models ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        (10**30, "parameters.n_cameras = 1000000000000000000000000000000: must be an integer of 64 bits"),
        ([{"a": 2**64}], "parameters.n_cameras.0.a = 18446744073709551616: must be an integer of 64 bits"),
        (
            {1, 2},
            "parameters.n_cameras = {1, 2}: must be a string, number, truth value, date, time, list or tabl",
        ),
        (np.arange(2) * 1j, "parameters.n_cameras.0 = 0j: must be a string"),
    ],
)
def test_a_parameter_that_no_file_can_hold_is_refused(value: object, sentence: str) -> None:
    with pytest.raises(InputError, match=f"^here: {re.escape(sentence)}"):
        validate_scenario({**tomllib.loads(MODEL), "parameters": {"n_cameras": value}}, "here")


def test_a_parameter_that_is_nested_too_deep_is_refused() -> None:
    text = f"{MODEL}deep = {'[' * 50}{']' * 50}\n"
    deeper: list[Any] = []
    for _ in range(5000):  # more than Python can call itself
        deeper = [deeper]
    with pytest.raises(InputError, match=r"parameters\.deep[.0]+: is nested deeper than 32 tables and lists"):
        validate_scenario({**tomllib.loads(MODEL), "parameters": {"deep": deeper}}, "here")
    with pytest.raises(InputError, match=r"parameters\.deep[.0]+: is nested deeper than 32 tables and lists"):
        load(text)


def own_model(name: str, body: str, parameters: str) -> Scenario:
    Path(f"{name}.py").write_text(
        f"import numpy as np\nfrom aimd_des import model\n\n@model\ndef made({parameters}):\n    {body}\n",
        encoding="utf-8",
    )
    return load(f'until = 5\nmodel = "{name}"\n')


def test_defaults_are_written_as_a_file_has_them() -> None:
    defaults = "a=(1, 2.5), b=np.array([[1.0], [2.0]]), c=np.float64(2), d={'x': (1,)}"
    scenario = own_model("a_model_with_arrays", "...", defaults).resolved()
    assert scenario.parameters == {"a": [1, 2.5], "b": [[1.0], [2.0]], "c": 2.0, "d": {"x": [1]}}
    assert load(scenario.to_toml()) == scenario


def test_a_default_that_no_file_can_hold_is_refused() -> None:
    scenario = own_model("a_model_with_a_function", "...", "f=print")
    with pytest.raises(InputError, match=r"^parameters\.f = <built-in function print>: must be a string"):
        scenario.resolved()


@pytest.mark.parametrize(
    ("body", "cause"),
    [
        ("return np.zeros(10**19)", "ValueError: Maximum allowed dimension exceeded"),
        ("raise MemoryError", "MemoryError"),
        ("return 1 / 0", "ZeroDivisionError: division by zero"),
    ],
)
def test_a_model_that_fails_is_refused_by_its_parameters(body: str, cause: str) -> None:
    name = f"a_model_that_raises_{cause.partition(':')[0]}"
    scenario = own_model(name, body, "size=1")
    sentence = f"parameters: {name} makes no problem of them ({cause})"
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}$"):
        scenario.problem()


def test_a_model_that_cannot_be_imported_is_refused() -> None:
    scenario = own_model("a_model_that_is_broken", "...", "size=nothing")
    with pytest.raises(
        InputError, match=r"^model = '.*': must be a module that can be imported, and this one r"
    ):
        scenario.problem()


def test_values_that_replace_those_of_the_file_may_lie_in_tables() -> None:
    changes = {"channel.loss": 0.5, "seed": 9, "resources.1.capacity": 7}
    scenario = load(EXAMPLES["numbers"], **changes)
    assert (scenario.channel.loss, scenario.seed) == (0.5, 9)
    problem: Problem = scenario.problem()
    assert problem.capacity.tolist() == [3.0, 7.0]
    with pytest.raises(InputError, match=r"^until\.x: until = 60: must be a table"):
        load(EXAMPLES["numbers"], **{"until.x": 1})


def test_not_more_than_a_page_of_mistakes_is_told() -> None:
    with pytest.raises(InputError) as refusal:
        validate_scenario({f"key {number}": 1 for number in range(50)}, "here")
    lines = str(refusal.value).splitlines()
    assert len(lines) == 21
    assert lines[-1] == "here: and 31 keys more are refused"


def test_each_part_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the check of its own table; the channel, the dry run and the run get the same."""
    made: list[str] = []
    make = KindTable.make

    def counted(table: KindTable) -> Any:
        made.append(table.of.name)
        return make(table)

    monkeypatch.setattr(KindTable, "make", counted)
    losses = [{"kind": "bernoulli", "probability": 0.1}, {"kind": "common", "probability": 0.1}]
    parts = {
        "channel": {"latency": {"kind": "exponential", "mean": 0.1}, "loss": losses},
        "averaging": {"kind": "forgetting", "time_constant": 5.0},
        "compensation": {"kind": "known", "loss": 0.1},
        "interventions": [{"kind": "capacity_step", "resource": "memory", "at": 3.0, "capacity": 1.0}],
    }
    scenario = Scenario.model_validate({"model": "models.smart_cameras", "until": 6.0, **parts})
    check_to_run(scenario)
    digest = quietly(scenario.run).digest
    kinds = ["bernoulli", "capacity_step", "common", "exponential", "forgetting", "known", "sampled"]
    assert sorted(made) == kinds
    assert quietly(scenario.run).digest == digest
    assert sorted(made) == kinds
