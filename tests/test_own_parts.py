"""Parts of one's own in files: registered, found by reading, and treated as ours are by every command."""

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import pytest

from aimd_des import InputError, load_scenario, load_study
from aimd_des.lowlevel import part
from aimd_des.scenario import named
from aimd_des.scenario.kinds import kind_of, kinds
from aimd_des.scenario.schema import scenario_schema
from aimd_des.utils.parts import REGISTERED
from tests.command_line import digest, invoke, refusal, run, said, write
from tests.conftest import INLINE
from tests.test_cli_completion import completed

HEAD = '''"""Parts of one's own."""

from dataclasses import dataclass

import networkx
import numpy as np

from aimd_des import interventions
from aimd_des.lowlevel import EventKind, Purpose, part


'''

PARTS = (
    HEAD
    + '''@part("latency")
@dataclass(frozen=True)
class Twice:
    """Half of the copies are late.

    Parameters
    ----------
    late : float
        Their latency, in units of time.
    per_agent : list of float, optional
        Is added.
    """

    late: float
    per_agent: list[float] | None = None

    def check(self, n_agents):
        assert self.per_agent is None or len(self.per_agent) == n_agents

    def draw(self, draws):
        return np.where(draws.uniforms(Purpose.LATENCY) < 0.5, self.late, 0.0)


@part("loss")
class Outage:
    """Everything is lost in a part of each period."""

    def __init__(self, period: float, share: float = 0.1, first: str = "off") -> None:
        self.period, self.share = period, share

    def start(self, n_agents):
        return self

    def draw(self, draws):
        return np.full(draws.n_agents, draws.time % self.period < self.share * self.period)


@part("control_unit")
class Always:
    """Signals at every look."""

    def process(self, system):
        for look in range(1000):
            yield system.env.at(float(look), EventKind.SENSE)
            system.broadcast(look % 2)


@part("intervention")
@dataclass(frozen=True)
class Exodus:
    """Some leave.

    Parameters
    ----------
    at : float
        When.
    count : int
        How many.
    """

    at: float
    count: int = 1

    def check(self, problem):
        if self.count >= problem.n_agents:
            raise ValueError(f"count = {self.count} is too large")

    def process(self, system):
        yield system.env.at(self.at, EventKind.INTERVENE)
        for agent in range(self.count):
            interventions.leave(system, agent)


@part("network")
def ring(n_agents: int, latency: float = 0.1):
    """Agents in a ring."""
    graph = networkx.cycle_graph(n_agents + 1)
    networkx.set_edge_attributes(graph, {edge: {"latency": latency, "loss": 0.0} for edge in graph.edges})
    graph.graph["root"] = 0
    return graph
'''
)

AGENTS = '''
import numba

from aimd_des import costs, responses


@part("costs")
class Rising(costs.TermCosts):
    """Costs that grow exponentially.

    Parameters
    ----------
    weights : list of float
        Of each agent.
    rate : float
        How fast they grow.
    """

    def __init__(self, weights: list[float], rate: float = 1.0) -> None:
        scale = np.broadcast_to(np.array(weights)[:, None] * rate, (len(weights), 2))
        terms = np.stack([scale, np.full_like(scale, rate)], axis=-1)[:, :, None]
        super().__init__(np.zeros((*scale.shape, 1)), exponentials=terms)


@numba.njit
def level(normalization, slope, average, demand, memory):
    memory[0] += 1.0
    return normalization * slope * demand / (average * average) * memory[0] / (memory[0] + 1.0)


@part("response")
class Cautious(responses.CustomResponse):
    """Responds the more often the more it holds, and little at first.

    Parameters
    ----------
    cut : str
        As with `CustomResponse`.
    """

    def __init__(self, cut: str = "drawn") -> None:
        super().__init__(level, cut, memory=1)
'''
OF_AGENTS = """\
[response]
kind = "NAME.Cautious"

[costs]
kind = "NAME.Rising"
weights = [1.0, 2.0, 3.0, 1.5, 0.5]
"""
STUDY_OF_AGENTS = """
base = "agents.toml"
replications = 2
[[axes]]
key = "costs.rate"
values = [0.5, 1.0]
[[axes]]
key = "response.cut"
values = ["drawn", "fractional", "full"]
"""

CHANNEL = """\
[channel]
latency = { kind = "NAME.Twice", late = 0.5 }
loss = [{ kind = "NAME.Outage", period = 9 }]
"""
EXODUS = '[[interventions]]\nkind = "NAME.Exodus"\nat = 30\ncount = 2\n'
STUDY = """
base = "own.toml"
replications = 2
[[axes]]
key = "channel.latency.late"
values = [0.5, 1.5]
[[axes]]
key = "channel.loss.0.share"
values = [0.1, 0.2]
"""


@pytest.fixture(autouse=True)
def _as_before() -> Iterator[None]:
    """What a test has registered is not listed in the others."""
    before = set(REGISTERED)
    yield
    for module in set(REGISTERED) - before:
        del REGISTERED[module]
        sys.modules.pop(module, None)


@pytest.fixture
def mine(own_folder: Path, request: pytest.FixtureRequest) -> str:
    """A module with parts in the working directory, under a name of its own in each test."""
    name = f"parts_of_{request.node.originalname}"
    Path(f"{name}.py").write_text(PARTS, encoding="utf-8")
    write(INLINE + (CHANNEL + EXODUS).replace("NAME", name), "own.toml")
    return name


def replaced(old: str, new: str, name: str = "own.toml") -> None:
    text = Path(name).read_text(encoding="utf-8")
    assert old in text
    write(text.replace(old, new), name)


# -- what may be registered ------------------------------------------------------------------------------


class Base:
    """A latency without parameters."""

    def check(self, n_agents: int) -> None: ...

    def draw(self, draws: Any) -> Any: ...


def latency_with(init: Callable[..., None]) -> type:
    return type("Own", (Base,), {"__init__": init, "__module__": __name__, "__qualname__": "Own"})


def test_all_that_a_file_holds_may_be_a_parameter() -> None:
    def init(
        self: Any,
        a: bool,
        b: int | None,
        c: float = np.inf,
        d: str = "",
        e: Sequence[float] = (),
        f: Mapping[str, float] | None = None,
        g: npt.NDArray[np.float64] | None = None,
        h: npt.ArrayLike = 0.0,
        h2: npt.ArrayLike | None = None,
        i: Literal["x", "y"] = "x",
        j: tuple[int, ...] = (1,),
        k: tuple[float, str] = (1.0, "a"),
        path: str | Path | None = None,
        untyped=None,  # type: ignore[no-untyped-def] # noqa: ANN001
        *,
        m: dict[str, list[float]] | None = None,
        _hidden: object = print,
    ) -> None: ...

    assert part("latency")(latency_with(init))
    (found,) = (thing for thing in REGISTERED.pop(__name__).values())
    assert found.name == f"{__name__}.Own"


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        (
            "a: Callable[[], None]",
            "parameter 'a' of Own = 'a: collections.abc.Callable[[], None]': must",
        ),
        ("a: object", "parameter 'a' of Own = 'a: object': must be of a type that a file holds: numbers, "),
        ("file: Path", "parameter 'file' of Own = 'file: pathlib.Path': must be of a type that a file holds"),
        ("a: float = print", "parameter 'a' of Own = 'a: float = <built-in function print>': must be with a"),
        ("*a: float", "parameter 'a' of Own = '*a: float': must be one that can be given by its name"),
        ("**a: float", "parameter 'a' of Own = '**a: float': must be one that can be given by its name"),
        ("kind: float", "parameter 'kind' of Own: must have another name"),
        (
            "a: 'Nothing'",
            "Own: an annotation of its parameters cannot be read (name 'Nothing' is ",
        ),
    ],
)
def test_a_parameter_that_no_file_holds_is_refused(parameters: str, said: str) -> None:
    space: dict[str, Any] = {"Callable": Callable, "Path": Path}
    exec(f"def init(self, {parameters}): ...", space)
    with pytest.raises(InputError) as caught:
        part("latency")(latency_with(space["init"]))
    assert str(caught.value).startswith(said)


def test_what_is_no_part_is_refused() -> None:
    with pytest.raises(InputError, match=r"^group of a part = 'latancy': must be one of .*mean 'latency'\?$"):
        part("latancy")
    with pytest.raises(InputError, match=r"^part Base = 'loss': must be a class with start\(\)$"):
        part("loss")(Base)
    with pytest.raises(InputError, match=r"must be a class, or a function that makes an object$"):
        part("loss")(Base())  # type: ignore[type-var]

    class Local(Base):
        pass

    with pytest.raises(InputError, match=r"Local': must be at the top level of its module$"):
        part("latency")(Local)


# -- how they are found ----------------------------------------------------------------------------------


def test_a_part_is_found_by_reading_and_by_its_group(mine: str) -> None:
    assert mine not in sys.modules
    scenario = load_scenario("own.toml")
    assert scenario.spoken()["channel"]["latency"] == {"kind": f"{mine}.Twice", "late": 0.5}
    assert kind_of("loss", f"{mine}.Outage").make(period=3.0).share == 0.1
    with pytest.raises(InputError, match=r"kind = '.*Twice': must be a part of group loss, and this"):
        kind_of("loss", f"{mine}.Twice")


OTHERS = {
    "plain": "class Twice:\n    pass\n\nraise SystemExit(0)\n",
    "another": "def part(g):\n    return lambda c: c\n\n@part('latency')\nclass Twice:\n    pass\n\n1 / 0\n",
    "inner": "from aimd_des.lowlevel import part\nclass A:\n    @part('loss')\n    class B: ...\n\n1 / 0\n",
    "broken": "from aimd_des.lowlevel import part\n@part('latency')\nclass Twice(:\n",
}


@pytest.mark.usefixtures("own_folder")
@pytest.mark.parametrize("sort", OTHERS)
def test_a_module_that_registers_no_part_is_not_run(sort: str) -> None:
    name = f"no_parts_{sort}"
    write(OTHERS[sort], f"{name}.py")
    write(INLINE + f'[channel.latency]\nkind = "{name}.Twice"\n', "own.toml")
    line = len(INLINE.splitlines()) + 2
    called = name if sort == "broken" else f"{name}.Twice"
    assert refusal("run", "own.toml", "--out", "out").startswith(
        f"own.toml:{line}: channel.latency.kind = '{called}': must be a module"
    )
    assert name not in sys.modules


def test_an_installed_package_declares_its_parts(own_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Such a module may have no source, or register its parts without a decorator.
    place = Path("site")
    Path(place, "fading-1.0.dist-info").mkdir(parents=True)
    write("Metadata-Version: 2.1\nName: fading\nVersion: 1.0\n", "site/fading-1.0.dist-info/METADATA")
    write("[aimd_des_parts]\nany = fading_parts\n", "site/fading-1.0.dist-info/entry_points.txt")
    write(PARTS.replace('@part("latency")', "") + '\n\npart("latency")(Twice)\n', "site/fading_parts.py")
    monkeypatch.syspath_prepend(str(place.resolve()))
    named.declared_modules.cache_clear()
    write(INLINE + CHANNEL.replace("NAME", "fading_parts"), "own.toml")
    assert "ok: 5 agents" in said("validate", "own.toml")
    assert "fading_parts.Twice" in said("list")
    named.declared_modules.cache_clear()


def test_mistakes_in_a_table_of_ones_own_are_named_as_in_ours(mine: str) -> None:
    for old, new, sentence in (
        ("late = 0.5", "latt = 0.5", "channel.latency.latt: unknown key 'latt'; did you mean 'late'?"),
        ("latt = 0.5", "late = true", "channel.latency.late = True: must be a valid number"),
        ("late = true", "late = 1", None),
        ("period = 9", 'period = 9, first = 2', "channel.loss.0.first = 2: must be a valid string"),
        (", first = 2", "", None),
        ("count = 2", "count = 5", "interventions.0.kind: Exodus.check() refuses (ValueError: count = 5 is"),
        ("count = 5", "count = 1.5", "interventions.0.count = 1.5: must be a valid integer"),
        ("count = 1.5", "cuont = 1", "interventions.0.cuont: unknown key 'cuont'; did you mean 'count'?"),
        ("cuont = 1", "", None),
        (f"{mine}.Exodus", f"{mine}.Exodos", f"did you mean '{mine}.Exodus'?"),
        (f"{mine}.Exodos", "Exodus", "interventions.0.kind = 'Exodus': must be one of join, absence, crash,"),
    ):  # fmt: skip
        replaced(old, new)
        if sentence is None:
            assert "ok: 5 agents" in said("validate", "own.toml")
        else:
            outcome = invoke("validate", "own.toml")
            assert outcome.exit_code == 2
            assert sentence in outcome.stderr


# -- what commands know of them ---------------------------------------------------------------------------


def test_they_are_listed_and_in_the_schema(mine: str) -> None:
    listed = json.loads(said("list", "latency", "--json"))["latency"]
    (own,) = (entry for entry in listed if entry["name"] == f"{mine}.Twice")
    assert own["meaning"] == "Half of the copies are late."
    assert [(key["name"], key["required"], key["default"], key["meaning"]) for key in own["parameters"]] == [
        ("late", True, "", "Their latency, in units of time."), ("per_agent", False, "", "Is added.")
    ]  # fmt: skip
    assert {f"{mine}.{name}" for name in ("Twice", "Outage", "Always", "Exodus", "ring")} <= {
        kind.name for kind in kinds()
    }
    text = json.dumps(scenario_schema())
    assert f'"const": "{mine}.Twice"' in text
    assert "Their latency, in units of time." in text


def test_processes_and_a_fleet_agree_whatever_is_set(mine: str) -> None:
    settings = ("--set", "channel.latency.late=0.7", "--set", f"control_unit.kind={mine}.Always")
    for agents in ("process", "fleet"):
        outcome = run("own.toml", *settings, "--out", agents, "--agents", agents)
        assert outcome.exit_code == 0, outcome.output
    assert digest("process") == digest("fleet")
    assert load_scenario("process/scenario.toml").control_unit.spoken() == {"kind": f"{mine}.Always"}


def test_a_function_that_makes_a_graph_is_a_network(mine: str) -> None:
    text = Path("own.toml").read_text(encoding="utf-8").partition("[channel]")[0]
    write(text + f'[channel.network]\nkind = "{mine}.ring"\nn_agents = 5\nover = "flood"\n')
    assert run("five.toml", "--out", "ring").exit_code == 0
    assert digest("ring")


def test_a_study_of_them_is_swept_resumed_and_kept_apart(mine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    write(STUDY, "study.toml")
    assert "4 points, 2 replications each" in said("validate", "study.toml")
    assert invoke("sweep", "study.toml", "--out", "study", "--workers", "2").exit_code == 0
    assert len(load_study("study").runs) == 16
    replaced("replications = 2", "replications = 3", "study.toml")
    assert invoke("sweep", "study.toml", "--out", "study", "--workers", "1").exit_code == 0
    assert len(load_study("study").runs) == 24
    # Another draw of latencies under the same name would be another study.
    replaced("< 0.5", "< 0.6", f"{mine}.py")
    monkeypatch.delitem(REGISTERED, mine)
    monkeypatch.delitem(sys.modules, mine)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    __import__("importlib").invalidate_caches()
    said_then = refusal("sweep", "study.toml", "--out", "study")
    assert said_then.startswith(
        "study.toml: the code at channel.latency.late = 0.5, channel.loss.0.share = 0.1 "
    )
    assert said_then.endswith(
        f" is not that of the runs in the folder ({mine}.Twice), since {mine}.Twice has changed; put it back"
        " as it was, or choose another folder, or say --overwrite (overwrite=True)"
    )


def test_costs_and_a_response_are_swept_on_two_workers(mine: str) -> None:
    with Path(f"{mine}.py").open("a", encoding="utf-8") as module:
        module.write(AGENTS)
    before, _, rest = INLINE.partition("[costs]")
    write(before + OF_AGENTS.replace("NAME", mine) + rest[rest.index("[[resources]]") :], "agents.toml")
    for agents in ("process", "fleet"):
        outcome = run("agents.toml", "--out", agents, "--agents", agents)
        assert outcome.exit_code == 0, outcome.output
    assert digest("process") == digest("fleet")
    said_of = load_scenario("process/scenario.toml").spoken()["response"]
    assert said_of == {"kind": f"{mine}.Cautious", "cut": "drawn"}
    write(STUDY_OF_AGENTS, "study.toml")
    outcome = invoke("sweep", "study.toml", "--out", "study", "--workers", "2")
    assert outcome.exit_code == 0, outcome.output
    runs = load_study("study").runs
    assert len(runs) == 24
    # Each point is another run, and so is its replication where answers are drawn.
    assert runs[runs["resource"] == "memory"]["utilisation"].nunique() == 8
    assert invoke("report", "study").exit_code == 0


def test_folders_are_shown_and_reported_without_the_parts(mine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    write(STUDY, "study.toml")
    assert run("own.toml", "--out", "run").exit_code == 0
    assert invoke("sweep", "study.toml", "--out", "study", "--workers", "1").exit_code == 0
    Path(f"{mine}.py").unlink()
    monkeypatch.delitem(REGISTERED, mine)
    monkeypatch.delitem(sys.modules, mine)
    for folder in ("run", "study"):
        assert invoke("show", folder).exit_code == 0
        assert invoke("compare", folder, folder).exit_code == 0
        assert invoke("report", folder).exit_code == 0
    study = load_study("study")
    with pytest.raises(InputError, match=rf"kind = '{mine}.Twice': must be a module on the Python path"):
        study.scenario(study.plan["key"][0])


# -- what they hand back ----------------------------------------------------------------------------------

BROKEN = {
    "Raises": (
        "__init__",
        "1 / 0",
        "broken_raises.Raises makes nothing of these parameters (ZeroDiv",
    ),
    "Leaves": (
        "__init__",
        "raise SystemExit",
        "broken_leaves.Leaves makes nothing of these parameters (Syst",
    ),
    "Other": (
        "__new__",
        "return 5",
        "what broken_other.Other makes = 5: must be an object with check() ",
    ),
}
METHODS = """
    def check(self, n_agents):
        pass

    def draw(self, draws):
        pass
"""


@pytest.mark.usefixtures("own_folder")
@pytest.mark.parametrize("name", BROKEN)
def test_a_part_that_cannot_be_made_is_named(name: str) -> None:
    method, body, sentence = BROKEN[name]
    module = f"broken_{name.lower()}"
    head = f'{HEAD}@part("latency")\nclass {name}:\n    """Broken."""\n'
    write(f"{head}\n    def {method}(self):\n        {body}\n{METHODS}", f"{module}.py")
    write(INLINE + f'[channel.latency]\nkind = "{module}.{name}"\n', "own.toml")
    line = len(INLINE.splitlines()) + 1
    assert refusal("run", "own.toml", "--out", "out").startswith(
        f"own.toml:{line}: channel.latency: {sentence}"
    )


RAISING = (
    HEAD
    + '''@part("loss")
class Start:
    """Raises where a run begins."""

    def start(self, n_agents):
        raise KeyError(n_agents)


@part("loss")
class Draw:
    """Raises at a broadcast."""

    def start(self, n_agents):
        return self

    def draw(self, draws):
        return 1 / 0


@part("latency")
class Late:
    """Raises at a broadcast."""

    def check(self, n_agents):
        pass

    def draw(self, draws):
        return 1 / 0


@part("control_unit")
class Look:
    """Raises at a look."""

    def process(self, system):
        yield system.env.at(1.0, EventKind.SENSE)
        {}["nothing"]


@part("intervention")
class Change:
    """Raises at its time."""

    def check(self, problem):
        pass

    def process(self, system):
        yield system.env.at(1.0, EventKind.INTERVENE)
        raise RuntimeError("no such device")
'''
)
RAISED = {
    "Start": ('[channel.loss]\nkind = "raising_parts.Start"\n', "Start.start() raises KeyError: 5"),
    "Draw": (
        '[channel.loss]\nkind = "raising_parts.Draw"\n',
        "Draw.draw() raises ZeroDivisionError: division by zero",
    ),
    "Late": (
        '[channel.latency]\nkind = "raising_parts.Late"\n',
        "Late.draw() raises ZeroDivisionError: division by zero",
    ),
    "Look": ('[control_unit]\nkind = "raising_parts.Look"\n', "Look.process() raises KeyError: 'nothing'"),
    "Change": (
        '[[interventions]]\nkind = "raising_parts.Change"\n',
        "Change.process() raises RuntimeError: no such device",
    ),
}


@pytest.mark.usefixtures("own_folder")
@pytest.mark.parametrize("name", RAISED)
def test_what_a_part_raises_in_a_run_is_told_with_class_and_method(name: str) -> None:
    table, sentence = RAISED[name]
    write(RAISING, "raising_parts.py")
    write(INLINE + table, "own.toml")
    outcome = run("own.toml", "--out", "out")
    assert isinstance(outcome.exception, SystemExit), outcome.exception
    assert (outcome.exit_code, outcome.stderr.splitlines()[-1]) == (1, f"Error: own.toml: {sentence}")
    assert not Path("out").exists()
    # In Python it is the user's own exception, with a note.
    kind = sentence.split(" raises ")[1].partition(":")[0]
    with pytest.raises((KeyError, ZeroDivisionError, RuntimeError)) as caught:
        load_scenario("own.toml").run()
    assert type(caught.value).__name__ == kind
    assert caught.value.__notes__ == [f"raised in {sentence.partition(' raises ')[0]}"]


@pytest.mark.usefixtures("own_folder")
def test_a_run_of_a_study_that_a_part_has_ended_says_so() -> None:
    write(RAISING, "raising_parts.py")
    write(INLINE + RAISED["Draw"][0], "own.toml")
    write('base = "own.toml"\n', "study.toml")
    invoke("sweep", "study.toml", "--out", "study", "--workers", "1")
    assert load_study("study").failed["message"].tolist() == [RAISED["Draw"][1]]


@pytest.mark.usefixtures("own_folder")
@pytest.mark.parametrize("body", ["1 / 0\n", "raise SystemExit(3)\n", "def f(:\n", "import no_such_module\n"])
def test_a_broken_module_around_disturbs_no_command(body: str) -> None:
    number = sum(map(ord, body))
    write(
        f"from aimd_des.lowlevel import part\n\n@part('loss')\nclass Own: ...\n\n{body}", f"torn_{number}.py"
    )
    write()
    for command in (["list", "loss"], ["schema"], ["schema", "study"], ["validate", "five.toml"]):
        outcome = invoke(*command)
        assert "Traceback" not in outcome.output
        assert outcome.exception is None or isinstance(outcome.exception, SystemExit), outcome.exception
    assert completed("aimd-des run five.toml --set unt") in ([], ["until="])
