"""Runs as tables: what was run, what came out, and how two of them differ."""

from collections.abc import Sequence

from aimd_des.cli.printing import say
from aimd_des.cli.scenario_diff import HEADS, differences, print_differences
from aimd_des.cli.terminal_tables import print_pairs, print_table
from aimd_des.results.measures import measure_words
from aimd_des.scenario.run_folder import StoredRun
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

# What a scenario says of the problem, and how long it is.
_PROBLEM = ("resources", "costs")


def show_run(run: StoredRun, measures: Sequence[str]) -> None:
    """Print what was run, with which versions, and the measures of each resource."""
    chosen_of_run(run, measures)
    of_model = "model" in run.scenario
    given = {key: value for key, value in run.scenario.items() if of_model or key not in _PROBLEM}
    problem = [] if of_model else [("problem", _written_out(run))]
    pairs = [(key.replace("_", " "), value) for key, value in given.items() if value not in ("", {}, [])]
    versions = ("versions", run.versions)
    print_pairs(f"Run in {run.folder}", [*pairs, *problem, ("digest", run.digest), versions])
    say()
    print_measures("Measures", run, measures)


def _written_out(run: StoredRun) -> str:
    agents = len(run.scenario.get("costs", {}).get("coefficients", []))
    return f"written out: {agents} agents, {len(run.measures)} resources"


def print_measures(title: str, run: StoredRun, measures: Sequence[str] = ()) -> None:
    """Print a line for each measure and a column for each resource."""
    rows = [
        [measure_words(name), *(of[name] for of in run.measures.values())]
        for name in chosen_of_run(run, measures)
    ]
    print_table(title, ["measure", *run.measures], rows)


def chosen_of_run(run: StoredRun, measures: Sequence[str]) -> list[str]:
    """Take the measures that are asked for, or all of the run."""
    known = list(next(iter(run.measures.values()), {}))
    for name in measures:
        validation.known("measure", name, known)
    return list(measures) or known


def compare_runs(first: StoredRun, second: StoredRun, measures: Sequence[str]) -> None:
    """Print where two runs differ, whether their digests are equal, and their measures side by side."""
    shared = [name for name in first.measures if name in second.measures]
    if not shared:
        own = f"{', '.join(first.measures)} and {', '.join(second.measures)}"
        raise InputError(f"{first.folder} and {second.folder}: no resource is in both (they have {own})")
    of_second = chosen_of_run(second, measures)
    names = [name for name in chosen_of_run(first, measures) if name in of_second]
    equal = first.digest == second.digest
    print_pairs(
        "The digests are equal: the same events, to the last bit" if equal else "The digests are different",
        [(name, f"{run.folder}\n{run.digest}") for name, run in zip(HEADS, (first, second), strict=True)],
    )
    say()
    found = differences({**first.scenario, **first.versions}, {**second.scenario, **second.versions})
    print_differences(found, "The scenarios and the versions are the same.")
    say()
    rows = [
        [measure_words(name), resource, *pair, pair[1] - pair[0]]
        for name in names
        for resource in shared
        for pair in [(first.measures[resource][name], second.measures[resource][name])]
    ]
    print_table("Measures", ["measure", "resource", *HEADS, "difference"], rows, labels=2)
