"""The public names of the package: which there are, where they are imported from, and that old paths go on.

Whoever changes a list here changes what is promised to users: the changelog has a line about it.
"""

import ast
import inspect
import pickle
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import pytest

import aimd_des
from aimd_des import Crossing, InputError, PolynomialCosts, Problem, Resource, lowlevel, theory
from aimd_des._deprecated import MOVED, NAMES
from aimd_des.utils.old_keywords import KEYWORDS
from tests.test_layering import imports

ROOT = Path(__file__).resolve().parents[1]
TOP = """
    AgentProcess BroadcastChannel Clocks CoupledCosts Crossing CustomCosts Fleet InputError Optimum
    OverloadWarning PolynomialCosts Problem RESULT_VERSION Recording Resource Result Sampled Simulation
    SimulationError Study averaging compensation interventions latency load_scenario load_study loss
    lowlevel model normalization_factors run_study run_synchronous solve_optimum theory topology
"""
# Names that go on beside new ones, and are not counted.
ALIASES = {"Camera"}

FACES = {
    "averaging": """
        Averaging Cumulative Forgetting Polynomial Window
    """,
    "checks": """
        array integer number per_agent
    """,
    "compensation": """
        Compensation EstimatedLoss KnownLoss compensation_factor
    """,
    "control_units": """
        Crossing EarlyDetection Sampled
    """,
    "costs": """
        CostMethods CostTable Costs CoupledCosts CustomCosts ExponentialCosts PolynomialCosts PowerCosts
        TermCosts TrackingCosts UtilityCosts weighted_costs
    """,
    "interventions": """
        Absence CapacityProfile CapacityRamp CapacityStep ChangeChannel ChangeHoldOff
        ChangeThreshold Crash Failover Intervention Join Partition Planned Prices UnusualActivity
        check_absences check_end cut_off fail join leave reconnect recover set_capacity set_channel
        set_costs set_decrease set_hold_off set_increase set_normalization set_threshold weigh
    """,
    "latency": """
        Constant Empirical Exponential Latency LogNormal Pareto ShiftedGamma Uniform
    """,
    "loss": """
        Bernoulli Combined CommonMode GilbertElliott Loss LossProcess Trace
    """,
    "lowlevel": """
        Agent Broadcast Channel ControlUnit Copies CrossingTable DrawnLink Draws EventKind FloatArray Link
        OrderedEnvironment ProcessGenerator Purpose Run SampledTable SampledUnit Signal
        SynchronousRun System agent_indices exp expm1 exps generator key log log1p logs lost_table
        part quantile_table response_probability resume standard_normal start_synchronous uniforms
    """,
    "metrics": """
        consensus_spread cost_ratio measures relative_error utilisation
    """,
    "plots": """
        REFERENCE absolute_error agent_timeline average_allocations averages_against_optimum
        capacity_events colour consensus copies cost_ratio demand_and_signals derivatives error_decay
        error_histogram frame heat_map instantaneous_allocations
        latencies network_map number_axis overview paper_figures relative_error score
        shared_legend signal_raster sum_of_averages sum_of_demand tracking_error tracking_level
    """,
    "report": """
        check_page report_run report_study write_page
    """,
    "responses": """
        CustomResponse Derandomised EventNormalised Randomised Response
    """,
    "scenario": """
        Place Scenario StoredRun check_folder load_run load_scenario new_folder parse_setting
        scenario_schema validate_scenario with_settings write_run
    """,
    "study": """
        Axis BatchMeans Interval Precision RareEvent Study StudyResults Tally batch_means compare difference
        jackknife load load_study mean_and_error mean_interval mser paired_difference rare_event read_study
        replicate replications_needed run_study steady_utilisation summarise
    """,
    "theory": """
        BurstRunaway Churn Congestion Convergence Expected Flow LimitCycle Needed Prediction Recovery
        Spell SteadyTotal allocation_at averaging_spread believed_loss burst_runaway burst_shares
        churn clock_offset compensated_probability congestion convergence critical_loss elasticity
        event_interval event_mean flow hold_off_bounds limit_cycle loss_weights mixture_lift
        needed_rate partition_runaway peak_lift poisson_moment predict price_in_bits recovery
        recovery_time reweighted_optimum runaway_multiplier safe_threshold share_rates signal_rate
        signal_share square_root_law steady_total synchronised_utilisation time_above utilisation
    """,
    "topology": """
        FloodChannel TreeChannel balanced_tree flood from_edges from_graphml grid random_geometric star
        tree
    """,
}
MODULES = [name for name in FACES if name in aimd_des.__all__]

# What pages have named, by the paths of version 0.1 before the modules moved into wings.
OLD = {
    "elementary": "exp expm1 exps log log1p logs standard_normal",
    "environment": "EventKind OrderedEnvironment",
    "errors": "InputError OverloadWarning SimulationError",
    "output": "check_folder new_folder write_run",
    "registry": "model",
    "response": "response_probability",
    "stored": "StoredRun load_run",
    "streams": "Purpose generator key uniforms",
    "system": "System",
    "transport": "Agent Signal",
}


@pytest.mark.parametrize("name", MODULES)
def test_a_public_module_is_imported_by_the_name_that_the_pages_give_it(name: str) -> None:
    module = import_module(f"aimd_des.{name}")
    assert module is getattr(aimd_des, name)
    assert module.__all__
    assert all(hasattr(module, public) for public in module.__all__)


@pytest.mark.parametrize("name", ["latency", "loss", "topology"])
def test_a_face_has_all_that_its_package_has(name: str) -> None:
    face, home = import_module(f"aimd_des.{name}"), import_module(f"aimd_des.channel.{name}")
    assert face.__all__ == home.__all__
    assert all(getattr(face, public) is getattr(home, public) for public in home.__all__)


@pytest.mark.parametrize("face", ["study", "theory"])
def test_no_name_of_a_face_that_imports_on_demand_is_that_of_a_module_below_it(face: str) -> None:
    """Where the module was imported before, Python would give it in place of the name."""
    module = import_module(f"aimd_des.{face}")
    below = {found.name for found in iter_modules(module.__path__)}
    assert below >= {path.partition(".")[0] for path in module._HOME.values()}
    assert not below & set(module.__all__)
    assert dir(module) == sorted(module.__all__)
    with pytest.raises(AttributeError, match=f"module 'aimd_des.{face}' has no attribute 'nothing'"):
        module.nothing  # noqa: B018 - the attribute is what is tried


def test_each_form_of_import_works_in_a_fresh_interpreter() -> None:
    """One that has imported nothing else before, since imports leave attributes behind."""
    program = "\n".join(
        [
            "import aimd_des.loss, aimd_des.topology, aimd_des.averaging, aimd_des.compensation",
            "from aimd_des.latency import Exponential",
            "from aimd_des import latency, theory",
            "assert latency.Exponential is Exponential",
            "assert aimd_des.loss.Bernoulli(0.1).mean == 0.1",
        ]
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT)


def test_dir_shows_the_public_names_and_no_others() -> None:
    assert dir(aimd_des) == sorted(aimd_des.__all__)
    assert not [name for name in dir(aimd_des) if name.startswith("_")]


def test_the_package_tells_type_checkers_that_it_is_typed() -> None:
    """Without the mark they ignore its annotations, though the classifier promises them (PEP 561)."""
    assert Path(aimd_des.__file__).with_name("py.typed").is_file()


def test_the_top_hands_out_these_names() -> None:
    assert sorted(aimd_des.__all__) == TOP.split()
    assert len(aimd_des.__all__) <= 35
    assert all(getattr(aimd_des, name) is not None for name in TOP.split())


@pytest.mark.parametrize("face", FACES)
def test_a_face_hands_out_these_names(face: str) -> None:
    module = import_module(f"aimd_des.{face}")
    assert sorted(module.__all__) == FACES[face].split()
    assert all(getattr(module, name) is not None for name in module.__all__)


def is_public(name: str) -> bool:
    """Whether a dotted name of the package is one that a face hands out, or a face."""
    _, *parts = name.split(".")
    if not parts or parts[0] in FACES:
        return len(parts) < 2 or parts[1] in FACES[parts[0]].split()
    return parts[0] in {*TOP.split(), *ALIASES, "__version__"}


def hidden(path: Path) -> Iterator[str]:
    """Names of the package in a file of Python, Markdown or reStructuredText that are not promised."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        names = [name for _, name in imports(ast.parse(text), path.relative_to(ROOT))]
    else:
        names = re.findall(r"(?<![\w/.-])aimd_des(?:\.\w+)+", text)
        for module, imported in re.findall(r"from (aimd_des[\w.]*) import (\([^)]*\)|.*)", text):
            names += [
                f"{module}.{name.split(' as ')[0]}" for name in re.findall(r"\w+(?: as \w+)?", imported)
            ]
    yield from (
        name for name in names if re.match(r"aimd_des\b", name) and not is_public(name) and ".py" not in name
    )


USERS = sorted(
    path
    for folder, ends in (("models", "py"), ("scenarios", "py"), ("docs", "md"), ("docs/api", "rst"))
    for path in (ROOT / folder).rglob(f"*.{ends}")
    if "_build" not in path.parts and "gallery" not in path.parts and path.name != "changelog.md"
)


def test_models_scenarios_and_pages_use_what_is_promised_and_nothing_else() -> None:
    found = {str(path.relative_to(ROOT)): sorted(set(hidden(path))) for path in [ROOT / "README.md", *USERS]}
    assert len(found) > 90
    assert {path: names for path, names in found.items() if names} == {}


def test_a_name_that_is_not_promised_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "from aimd_des import Problem, latency, rows\n>>> from aimd_des.utils.rng import (\n    key,\n)\n"
        "`aimd_des.plots.style.frame`, aimd_des/cli, `aimd_des.Result`\n"
    )
    expected = ["aimd_des.plots.style.frame", "aimd_des.rows", "aimd_des.utils.rng", "aimd_des.utils.rng.key"]
    assert sorted(hidden(page)) == expected


@pytest.mark.parametrize("old", MOVED)
def test_an_old_path_gives_the_same_objects_with_a_warning(old: str) -> None:
    sys.modules.pop(old, None)
    assert is_public(MOVED[old][0])
    with pytest.warns(DeprecationWarning, match=f"{old} has moved: import from {MOVED[old][0]};"):
        module = import_module(old)
    for new in reversed(MOVED[old][1:]):
        home = import_module(new)
        own = [name for name, thing in vars(home).items() if getattr(thing, "__module__", new) == new]
        names = getattr(home, "__all__", [name for name in own if not name.startswith("_")])
        assert all(getattr(module, name) is getattr(home, name) for name in names)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        module.nothing  # noqa: B018 - asking is what is tested


@pytest.mark.filterwarnings("ignore:.* has moved:DeprecationWarning")
@pytest.mark.parametrize("old", OLD)
def test_an_old_path_has_what_pages_have_named(old: str) -> None:
    place = MOVED[f"aimd_des.{old}"][0]
    for name in OLD[old].split():
        assert getattr(import_module(f"aimd_des.{old}"), name) is getattr(import_module(place), name)
        assert is_public(f"{place}.{name}")


@pytest.mark.parametrize("old", NAMES)
def test_an_old_name_is_the_new_object_with_a_warning_at_the_line_that_asks(old: str) -> None:
    new, since = NAMES[old]
    with pytest.warns(DeprecationWarning, match=f"aimd_des.{old} is called {new} since {since}") as heard:
        found = getattr(aimd_des, old)
    assert found is getattr(aimd_des, new)
    assert [one.filename for one in heard] == [__file__]
    assert old not in dir(aimd_des)
    assert new in dir(aimd_des)


@pytest.mark.filterwarnings("ignore:.* has moved:DeprecationWarning")
def test_an_old_name_at_an_old_path() -> None:
    with pytest.warns(DeprecationWarning, match=r"aimd_des\.run_discrete is called run_synchronous"):
        from aimd_des.discrete import run_discrete  # type: ignore[import-not-found]
    assert run_discrete is aimd_des.run_synchronous


@pytest.mark.filterwarnings("ignore:.* has moved:DeprecationWarning")
def test_the_old_name_of_event_kinds_goes_on() -> None:
    assert import_module("aimd_des.environment").Kind is lowlevel.Kind is lowlevel.EventKind
    assert "Kind" not in lowlevel.__all__


def test_the_name_of_the_paper_goes_on_without_a_warning() -> None:
    from aimd_des.engine.agent_process import Camera

    assert aimd_des.Camera is Camera is aimd_des.AgentProcess
    assert "Camera" not in dir(aimd_des)


MEMORY = Problem([Resource("memory", 20.0, 0.02, 0.5, 0.1)], PolynomialCosts([2], [[[1.0]]] * 20))
RENAMED: list[tuple[Callable[..., Any], dict[str, Any], dict[str, float]]] = [
    (Crossing, {}, {"refractory": 0.5}),
    (Crossing, {"sensing_delay": 0.1}, {"refractory": 0.5, "longest": 2.0}),
    (theory.critical_loss, {"rate": 0.3}, {"refractory": 0.5}),
    (theory.partition_runaway, {"problem": MEMORY, "duration": 2.0}, {"refractory": 0.5}),
    (theory.predict, {"problem": MEMORY, "dynamics": "continuous"}, {"refractory": 0.5}),
    (theory.safe_threshold, {"problem": MEMORY, "dynamics": "continuous"}, {"refractory": 0.5}),
    (
        theory.runaway_multiplier,
        {"increase": 0.1, "decrease": 0.5, "normalization": 0.1, "loss": 0.5},
        {"refractory": 0.5},
    ),
]


@pytest.mark.parametrize(("called", "given", "old"), RENAMED)
def test_old_keywords_mean_the_new_ones_with_a_warning(
    called: Callable[..., Any], given: dict[str, Any], old: dict[str, float]
) -> None:
    new = {KEYWORDS[name]: value for name, value in old.items()}
    with pytest.warns(DeprecationWarning, match="is called .*hold_off since 0.1") as heard:
        found = called(**given, **old)
    assert [one.filename for one in heard] == [__file__] * len(old)
    assert str(found) == str(called(**given, **new))
    for name, value in old.items():
        words = f"{name} = {value}: must be left out beside {KEYWORDS[name]}, its new name"
        with pytest.raises(InputError, match=words):
            called(**given, **new, **{name: value})
    assert not KEYWORDS.keys() & inspect.signature(called).parameters.keys()


def test_a_crossing_is_asked_by_old_names_too() -> None:
    unit = Crossing(0.5, longest_hold_off=2.0)
    assert pickle.loads(pickle.dumps(unit)) == unit
    with pytest.warns(DeprecationWarning, match="longest is called longest_hold_off since 0.1"):
        assert unit.longest == 2.0  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match="'Crossing' object has no attribute 'nothing'"):
        _ = unit.nothing  # type: ignore[attr-defined]
