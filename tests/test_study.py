"""Studies as data: axes, conditions, points, seeds and keys, and what is refused before anything runs."""

import tomllib
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import tomli_w

import aimd_des
from aimd_des import InputError
from aimd_des.results.measures import MEASURED, MEASURES
from aimd_des.results.result import Result
from aimd_des.study import Axis, Precision, Study, read_study
from aimd_des.study.columns import FRAMES
from aimd_des.study.condition import Condition
from aimd_des.study.points import expand, run_of
from aimd_des.study.run_tables import summary_of
from aimd_des.study.schedule import Schedule
from aimd_des.study.shared_parts import SharedParts, SharedProblem
from tests.conftest import INLINE, quadratic_problem, quietly

BASE = {key: value for key, value in tomllib.loads(INLINE).items() if key != "seed"}
LATENCY: dict[str, Any] = {"name": "latency", "key": "channel.latency", "values": [0, 0.5, 2]}
LOSS: dict[str, Any] = {"name": "loss", "key": "channel.loss", "linspace": [0, 0.3, 4]}


def study(**changes: Any) -> Study:
    return Study.model_validate({"scenario": BASE, **changes})


def labels(made: Study) -> list[tuple[Any, ...]]:
    return [tuple(point.labels.values()) for point in expand(made)]


def refusal(**changes: Any) -> str:
    with pytest.raises(InputError) as caught:
        expand(study(**changes))
    return str(caught.value)


# -- axes ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"values": ["a", "b"]}, ["a", "b"]),
        ({"values": [True, False]}, [True, False]),
        ({"linspace": [0, 0.3, 4]}, [0.0, 0.1, 0.2, 0.3]),  # and not 0.30000000000000004
        ({"linspace": [0, 10, 11]}, list(range(11))),
        ({"logspace": [-2, 0, 3]}, [0.01, 0.1, 1.0]),
        ({"logspace": [0, 2, 3]}, [1, 10, 100]),
    ],
)
def test_values_of_an_axis(given: dict[str, Any], expected: list[Any]) -> None:
    found = [value for value, _ in Axis.model_validate({"key": "lag", **given}).settings()]
    assert found == expected
    assert [type(value) for value in found] == [type(value) for value in expected]


def test_axes_are_combined_the_last_one_fastest() -> None:
    assert labels(study(axes=[LATENCY, LOSS]))[:5] == [(0, 0), (0, 0.1), (0, 0.2), (0, 0.3), (0.5, 0)]
    assert labels(study()) == [()]


def test_axes_of_one_group_vary_together() -> None:
    zipped = [
        {**LATENCY, "zip": "both"},
        {"key": "dynamics", "values": ["discrete", "continuous"]},
        {"name": "loss", "key": "channel.loss", "values": [0.0, 0.1, 0.3], "zip": "both"},
    ]
    assert labels(study(axes=zipped)) == [
        (latency, dynamics, loss)
        for latency, loss in ((0, 0.0), (0.5, 0.1), (2, 0.3))
        for dynamics in ("discrete", "continuous")
    ]


def test_cases_set_several_keys_and_are_called_by_their_name() -> None:
    cases = {
        "ticks": {"dynamics": "discrete", "clocks.jitter": 0.5},
        "flow": {"dynamics": "continuous", "control_unit": {"kind": "crossing", "hold_off": 0.5}},
    }
    points = expand(study(axes=[{"name": "kind", "cases": cases}]))
    assert [point.labels for point in points] == [{"kind": "ticks"}, {"kind": "flow"}]
    assert [point.scenario.dynamics for point in points] == ["discrete", "continuous"]
    assert points[0].scenario.clocks.jitter == 0.5
    assert points[1].scenario.spoken()["control_unit"]["hold_off"] == 0.5


def test_a_condition_leaves_points_out() -> None:
    made = study(axes=[LATENCY, LOSS], where="latency < 1 and loss <= 0.1 or latency == 2 and loss == 0.3")
    assert labels(made) == [(0, 0), (0, 0.1), (0.5, 0), (0.5, 0.1), (2, 0.3)]


# -- conditions ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("latency <= 5 or loss < 0.5", True),
        ("not (latency <= 5) and loss < 0.5", False),
        ("0 < channel.delay - latency * 2 < 1", True),
        ("kind in ('a', 'b')", True),
        ("kind not in ['a', 'b'] or -latency % 2 > 0", True),
        ("channel.delay / (latency + 1) >= +1.75", True),
        ("kind == 'c'", False),
        ("3 > latency > 2", False),  # each is compared with its neighbour
    ],
)
def test_conditions(text: str, expected: bool) -> None:
    values = {"latency": 1.0, "loss": 0.5, "channel.delay": 2.5 + 1, "kind": "a"}
    values["channel.delay"] = 3.5 if "/" in text else 2.5
    assert Condition(text, list(values))(values) is expected


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('x')",
        "latency.__class__",
        "(lambda: 1)()",
        "[x for x in (1,)]",
        "latency ** 9",
        "latency if loss else 1",
        "latency is loss",
        "f'{latency}'",
        "latency[0]",
        "latency := 1",
        "latency = 1",
        "b'x' == latency",
        "",
        "(" * 1000 + ")" * 1000,
    ],
)
def test_what_is_no_condition_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="where"):
        Condition(text, ["latency", "loss"])


def test_a_condition_names_axes_that_there_are() -> None:
    with pytest.raises(InputError, match="did you mean 'latency'"):
        Condition("latancy < 1", ["latency"])
    with pytest.raises(InputError, match="cannot be computed at latency = 1, kind = 'a'"):
        Condition("latency < kind", ["latency", "kind"])({"latency": 1, "kind": "a"})


# -- what is refused -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"axes": [{"key": "lag"}]}, "exactly one of values, linspace, logspace and cases"),
        ({"axes": [{"key": "lag", "values": [1], "linspace": [0, 1, 2]}]}, "exactly one of"),
        ({"axes": [{"values": [1]}]}, "key = None: must be given with values"),
        ({"axes": [{"cases": {"a": {"lag": 1}}}]}, "name = '': must be given"),
        ({"axes": [{"key": "lag", "values": []}]}, "one value or more"),
        ({"axes": [{"key": "lag", "values": [1, 1.0]}]}, "different from each other"),
        (
            {"axes": [{"key": "lag", "values": [1, "a"]}]},
            "of one kind; give values of several kinds as cases",
        ),
        ({"axes": [{"key": "lag", "values": [float("nan")]}]}, "finite numbers"),
        ({"axes": [{"key": "lag", "values": [2**53 + 1]}]}, "at most 2**53"),
        ({"axes": [{"key": "seed", "values": [1]}]}, "seeds come from the study"),
        ({"axes": [{"name": "signals", "key": "lag", "values": [1]}]}, "another word: it is a column"),
        ({"axes": [LATENCY, LATENCY]}, "names of the axes"),
        ({"axes": [LATENCY, {"key": "channel", "values": ["a"]}]}, "set by one axis only; 'latency' sets"),
        ({"axes": [{**LATENCY, "zip": "a"}, {**LOSS, "zip": "a"}]}, "zip = 'a' = {'latency': 3, 'loss': 4}"),
        ({"axes": [{**LATENCY, "zip": "a"}, LOSS]}, "zip = 'a': must be the same word at two axes or more"),
        ({"axes": [LATENCY], "where": "latency > 5"}, "fulfilled by one point or more"),
        ({"axes": [{"key": "channel.latency", "linspace": [0, 1, 0]}]}, "number of linspace = 0"),
        ({"measures": ["utilization"]}, "did you mean 'utilisation'?"),
        ({"measures": []}, "one or more; leave it out to keep all"),
        ({"keep": ["signal"]}, "did you mean 'signals'?"),
        ({"keep": ["signals", "signals"]}, "different from each other"),
        ({"replications": 0}, "replications = 0: must be an integer of at least 1"),
        ({"seed": -1}, "seed = -1"),
        ({"scenario": {**BASE, "seed": 1}}, "scenario.seed: has no meaning in a study"),
        (
            {"precision": {"measure": "utilisation", "half_width": 0.1, "at_most": 9}},
            "replications = 1: must be from 2",
        ),
        (
            {
                "precision": {"measure": "signals", "half_width": 0.1, "at_most": 9},
                "replications": 2,
                "measures": ["bits"],
            },
            "one of the measures that are kept",
        ),
        (
            {
                "precision": {"measure": "bits", "half_width": 0.1, "at_most": 9, "resource": "dsk"},
                "replications": 2,
            },
            "precision.resource = 'dsk': must be all or one of memory, disk; did you mean 'disk'?",
        ),
    ],
)
def test_a_mistake_in_a_study_is_refused(changes: dict[str, Any], sentence: str) -> None:
    assert sentence in refusal(**changes)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: Axis(key="lag", values=[]), "axis 'lag' = []: must be one value or more"),
        (lambda: Axis(key="lag", value=[1]), "value: unknown key 'value'; did you mean 'values'?"),  # type: ignore[call-arg]
        (lambda: Axis(key="lag", values="1"), "values = '1': must be a valid list"),  # type: ignore[arg-type]
        (
            lambda: Precision(measure="signal", half_width=1.0, at_most=9),
            "precision.measure = 'signal': must be one of",
        ),
        (lambda: Precision(measure="signals", half_width=0.0, at_most=9), "half_width = 0.0: must be"),
        (lambda: Study(scenario=BASE, replications=0), "replications = 0: must be an integer of at least 1"),
        (
            lambda: Study(scenario=BASE, axes=[{"key": "lag", "valves": [1]}]),
            "axes.0.valves: unknown key 'valves'; did you mean 'values'?",
        ),
        (
            lambda: Study.model_validate({"scenario": BASE, "sede": 1}),
            "sede: unknown key 'sede'; did you mean",
        ),
        (
            lambda: Study(scenario={"untill": 5}),
            "scenario: untill: unknown key 'untill'; did you mean 'until'?",
        ),
        (
            lambda: Study(scenario=BASE, axes=[Axis(key="channel.loss", values=[2.0, 0.5])]),
            "at channel.loss = 2.0: channel: loss = 2.0: must be",
        ),
    ],
)
def test_what_is_made_in_python_is_refused_like_everything_else(call: Any, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        call()
    assert sentence in str(caught.value)
    assert not str(caught.value).startswith(":")


def test_a_study_in_python_is_checked_at_its_first_point() -> None:
    # What the condition leaves out need not be a scenario.
    axis = Axis(key="channel.loss", values=[2.0, 0.5])
    assert expand(Study(scenario=BASE, axes=[axis], where="channel.loss < 1"))[0].labels == {
        "channel.loss": 0.5
    }


@pytest.mark.parametrize(
    "values",
    [
        np.linspace(0.0, 1.0, 3),
        [np.float64(0.0), 0.5, np.float32(1.0)],
        pd.Series([0.0, 0.5, 1.0]),
        pd.Index([0.0, 0.5, 1.0]),
        (0.0, np.array(0.5), 1.0),
    ],
)
def test_arrays_and_numbers_of_numpy_are_values(values: Any) -> None:
    axis = Axis(key="channel.loss", values=values)
    assert axis == Axis(key="channel.loss", values=[0.0, 0.5, 1.0])
    assert [type(value) for value, _ in axis.settings()] == [float] * 3


def test_whatever_a_study_is_given_may_be_of_numpy() -> None:
    made = Study(
        scenario={**BASE, "until": np.int64(30), "channel": {"latency": np.full(5, 0.5)}},
        replications=np.int64(3),
        precision=Precision(measure="signals", half_width=np.float64(2.0), at_most=np.int64(9)),  # type: ignore[arg-type]
        axes=[
            Axis(key="recording.tail", values=range(2)),  # type: ignore[arg-type]
            Axis(key="channel.loss", linspace=(np.float64(0), 1, np.int64(3))),  # type: ignore[arg-type]
            Axis(name="k", cases={"a": {"channel.duplication": np.zeros(5)}}),
        ],
    )
    assert made == Study.model_validate(tomllib.loads(tomli_w.dumps(made.spoken())))
    assert made.scenario["channel"] == {"latency": [0.5] * 5}


@pytest.mark.parametrize(
    ("axis", "sentence"),
    [
        (
            {"key": "channel.latancy", "values": [1]},
            "at channel.latancy = 1: channel.latancy: unknown key 'latancy'; did",
        ),
        ({"key": "chanel.latency", "values": [1]}, "did you mean 'channel'?"),
        ({"key": "channel.loss", "values": [0.5, 1.5]}, "at channel.loss = 1.5: "),
        ({"key": "until.x", "values": [1]}, "until.x"),
        ({"name": "kind", "cases": {"a": {"model": "nowhere"}}}, "at kind = a: "),
        ({"key": "resources.2.capacity", "values": [1.0]}, "resources.2.capacity"),
        (
            {"name": "x", "cases": {"a": {"compensation": {"kind": "known_loss", "loss": [0.1]}}}},
            "at x = a: ",
        ),
    ],
)
def test_a_scenario_that_is_refused_names_its_point(axis: dict[str, Any], sentence: str) -> None:
    assert sentence in refusal(axes=[axis])


def test_two_points_with_the_same_scenario_are_refused() -> None:
    cases = {"a": {"channel.loss": 0.0}, "b": {"channel.loss": 0}, "c": {"channel.loss": 0.1}}
    assert "points kind = a and kind = b are the same scenario" in refusal(
        axes=[{"name": "kind", "cases": cases}]
    )
    cases = {"a": {"channel.loss": 0.0}, "b": {"channel.latency": 0.0}}
    assert "are the same scenario" in refusal(axes=[{"name": "kind", "cases": cases}], paired=True)


# -- seeds and keys --------------------------------------------------------------------------------------


def seeds(made: Study, replications: int = 3) -> list[list[int]]:
    return [
        [run_of(made, point, place).scenario.seed for place in range(replications)] for point in expand(made)
    ]


def test_points_share_their_seeds_unless_they_are_not_paired() -> None:
    shared = seeds(study(axes=[LATENCY]))
    assert shared[0] == shared[1] == shared[2]
    assert len(set(shared[0])) == 3
    state = np.random.SeedSequence(0, spawn_key=(0, 2)).generate_state(1, np.uint64)[0]
    assert shared[0][2] == int(state) >> 1 < 2**63
    apart = seeds(study(axes=[LATENCY], paired=False))
    assert len({seed for row in [*apart, shared[0]] for seed in row}) == 12
    assert seeds(study(axes=[LATENCY], seed=1))[0] != shared[0]


@pytest.mark.parametrize("paired", [True, False])
def test_what_a_study_grows_by_changes_no_run_that_was_there(paired: bool) -> None:
    grown = {"name": "latency", "key": "channel.latency", "values": [0.0, 0.25, 0.5, 1, 2.0]}
    small, large = (
        {run_of(made, point, place).key for point in expand(made) for place in range(2)}
        for made in (
            study(axes=[LATENCY, LOSS], paired=paired),
            study(axes=[LOSS, grown], paired=paired, title="grown", replications=9),
        )
    )
    assert small < large


def test_a_key_depends_on_all_that_results_depend_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def key(**changes: Any) -> str:
        made = study(scenario={**BASE, **changes})
        return run_of(made, expand(made)[0], 0).key

    first = key()
    assert len(first) == 32
    assert key(title="other") == key(agents="process") == first
    others = {key(until=61.0), key(channel={"loss": 0.1}), key(recording={"events": True})}
    monkeypatch.setattr("aimd_des.study.points.RESULT_VERSION", 2)
    assert len({first, *others, key()}) == 5


def test_what_is_prepared_for_a_point_is_what_each_of_its_runs_has() -> None:
    cameras = {"until": 60, "model": "models.smart_cameras"}
    pinned = {**cameras, "parameters": {"seed": 7, "n_cameras": 5}}
    # A problem for each seed that a model gets, whatever the point; one in all where it gets none.
    for scenario, expected in ((BASE, 1), (cameras, 2), (pinned, 1)):
        made, parts, problems = study(scenario=scenario, axes=[LATENCY]), SharedParts(), set()
        runs = [run_of(made, point, place) for place in range(2) for point in expand(made)]
        for run in runs:
            canonical = b"%d\n" % aimd_des.RESULT_VERSION + run.scenario.canonical()
            assert run.key == sha256(canonical).hexdigest()[:32]
            assert list(run.job().scenario().items()) == list(run.scenario.spoken().items())
            in_worker = parts.scenario(run.job())
            assert in_worker.spoken() == run.scenario.spoken()
            problems.add(parts.problem(run.job(), in_worker))
        assert len(problems) == expected


def test_problems_are_forgotten_where_they_are_large(monkeypatch: pytest.MonkeyPatch) -> None:
    made = study(scenario={"until": 60, "model": "models.smart_cameras"}, axes=[LATENCY])
    jobs = [run_of(made, expand(made)[0], place).job() for place in (0, 1, 0)]
    for most, kept in ((200, True), (60, False), (1, False)):  # a camera is an agent, and there are 60
        monkeypatch.setattr("aimd_des.study.shared_parts._MOST_AGENTS", most)
        parts = SharedParts()
        first, _, again = (parts.problem(job, parts.scenario(job)) for job in jobs)
        assert (first is again) is kept


def test_runs_are_fleets_that_record_only_what_is_kept() -> None:
    def recording(*keep: str, **changes: Any) -> tuple[Any, ...]:
        scenario = expand(study(keep=list(keep), scenario={**BASE, "recording": {}, **changes}))[0].scenario
        found = scenario.recording
        return scenario.agents, found.demand, found.allocations, found.tail, found.events

    assert recording() == ("fleet", "end", "end", 0, False)
    assert recording("demand") == ("fleet", "auto", "end", 100, False)
    assert recording("allocations", "events") == ("fleet", "end", "auto", 100, True)
    assert recording("tracking") == ("fleet", "end", "auto", 100, False)
    assert recording(agents="process", recording={"demand": 5.0}) == ("process", 5.0, "end", 0, False)


def test_what_is_recorded_and_how_agents_are_made_changes_no_result() -> None:
    lean = expand(study())[0].scenario
    full = lean.model_validate({**BASE, "seed": 7, "recording": {"demand": 0.7, "allocations": "auto"}})
    assert quietly(lean.model_copy(update={"seed": 7}).run).digest == quietly(full.run).digest


def test_measures_and_frames_are_those_of_a_result() -> None:
    result = quietly(aimd_des.run_synchronous, quadratic_problem([1.0, 2.0]), steps=5, seed=0)
    kinds = {
        name: "integer" if column.dtype.kind == "i" else "number" for name, column in result.summary().items()
    }
    assert kinds == {name: MEASURES[name].kind for name in MEASURED}
    assert all(hasattr(Result, name) for name in FRAMES)


def test_a_run_is_held_against_the_problem_at_its_end() -> None:
    step = {"kind": "capacity_step", "resource": "memory", "at": 30.0, "capacity": 1.5}
    names = ["relative_error", "cost_ratio", "utilisation"]
    found = []
    for interventions in ([], [step]):
        scenario = expand(study(scenario={**BASE, "interventions": interventions}))[0].scenario
        result = quietly(scenario.run)
        found.append(summary_of(result, names, SharedProblem(scenario.problem()), list, dict))
        for name, values in result.measures(names=names).items():
            assert found[-1][name] == pytest.approx(values.tolist(), rel=1e-9)
    assert found[0]["relative_error"] != pytest.approx(found[1]["relative_error"], rel=0.1)


# -- how many replications -------------------------------------------------------------------------------


def test_replications_that_a_folder_has_already_stay_in_the_plan() -> None:
    """Three would do, and a folder from a sweep that asked for more has seven of the second point."""
    precision = {"measure": "utilisation", "half_width": 1e3, "at_most": 40}
    made = study(axes=[LATENCY], replications=3, precision=precision)
    points = expand(made)
    schedule = Schedule(made, points, {points[1].name: 7})
    while (run := schedule.next(lambda _: False)) is not None:
        schedule.record(run, [("memory", float(run.replication))])
    assert [sum(run.point is point for run in schedule.runs) for point in points] == [3, 7, 3]


@pytest.mark.parametrize(
    ("succeeds", "reached"), [("never", 5), ("the first", 40), ("every other", 40), ("always", 40)]
)
def test_replications_are_added_until_a_mean_is_known(succeeds: str, reached: int) -> None:
    precision = {"measure": "utilisation", "resource": "disk", "half_width": 0.5, "at_most": 40}
    made = study(axes=[LATENCY], replications=5, precision=precision)
    points = expand(made)

    def carried_out(order: int) -> dict[str, int]:
        schedule = Schedule(made, points, {})
        flying: list[Any] = []
        while True:
            while len(flying) < 4 and (run := schedule.next(lambda _: False)) is not None:
                flying.append(run)
            if not flying:
                break
            run = flying.pop(order % len(flying))
            # The first point scatters little, the second much, and the third more still, if it does not fail.
            spread = {0: 0.1, 0.5: 1.0, 2: 9.0}[run.point.labels["latency"]]
            value = spread * np.random.default_rng(run.scenario.seed).normal()
            every = {"never": 1000, "the first": 1000, "every other": 2, "always": 1}[succeeds]
            failed = run.point.labels["latency"] == 2 and (run.replication % every > 0 or succeeds == "never")
            schedule.record(run, () if failed else [("memory", 100 * value), ("disk", value)])
        assert len(schedule) == len(schedule.runs)
        return {
            str(point.labels["latency"]): sum(run.point is point for run in schedule.runs) for point in points
        }

    counts = carried_out(0)
    assert counts["0"] == 5 < counts["0.5"] < 40
    # One that has failed is no reason to stop; that all have, is.
    assert counts["2"] == reached
    # Who is done first makes no difference.
    assert all(carried_out(order) == counts for order in (1, 3))


# -- files -----------------------------------------------------------------------------------------------

FILE = """
title = "A study"
replications = 4
base = "base.toml"

[scenario]
until = 30.0
channel.loss = 0.1
control_unit = { kind = "crossing" }
dynamics = "continuous"

[[axes]]
key = "channel.latency"
values = [0, 1]
"""


def test_a_file_is_put_together_from_others(tmp_path: Path) -> None:
    (tmp_path / "base.toml").write_text(
        INLINE + "[channel]\nlatency = 0.5\n[control_unit]\nkind = 'sampled'\nperiod = 2.0\n"
    )
    (tmp_path / "study.toml").write_text(FILE)
    found = read_study(tmp_path / "study.toml", {"seed": 3, "scenario.channel.fifo": True})
    assert found.scenario["channel"] == {"latency": 0.5, "loss": 0.1, "fifo": True}
    assert found.scenario["control_unit"] == {"kind": "crossing"}  # of the period nothing is left
    assert (found.scenario["until"], found.seed, found.replications) == (30.0, 3, 4)
    assert "seed" not in found.scenario
    (tmp_path / "more").mkdir()
    (tmp_path / "more/large.toml").write_text(
        'extends = "../study.toml"\nreplications = 9\n[scenario]\nchannel.loss = 0.2\n'
        '[[axes]]\nkey = "lag"\nvalues = [0]'
    )
    large = read_study(tmp_path / "more/large.toml")
    assert (large.title, large.replications, large.scenario["channel"]["loss"]) == ("A study", 9, 0.2)
    assert [axis.name for axis in large.axes] == ["lag"]
    assert Study.model_validate(large.spoken()) == large


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "replications",
            "replication",
            "study.toml:3: replication: unknown key 'replication'; did you mean",
        ),
        ("values", "value", "value"),
        ("base.toml", "bse.toml", "bse.toml: there is no such file"),
        ("base = ", 'extends = "study.toml"\nbase = ', "extends"),
        (
            "replications = 4",
            "replications = 'four'",
            "study.toml:3: replications = 'four': must be a valid integer",
        ),
        ("[scenario]", "[scenario", "is not valid TOML"),
    ],
)
def test_a_mistake_in_a_file_is_told_with_its_place(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    (tmp_path / "base.toml").write_text(INLINE)
    (tmp_path / "study.toml").write_text(FILE.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_study(tmp_path / "study.toml")
    assert sentence in str(caught.value)
