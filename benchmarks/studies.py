"""What the machinery of studies adds to a run: studies of small runs beside the same runs by themselves."""

import argparse
import shutil
import statistics
import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from aimd_des.results.measures import MEASURED
from aimd_des.study import Study, journal, run_study
from aimd_des.study.points import PlannedRun, expand, run_of
from aimd_des.study.run_tables import RUN_AWAY, VERSIONS, run_schema, summary_of
from aimd_des.study.shared_parts import SharedParts
from aimd_des.study.store import Store
from aimd_des.study.stored_rows import StoredRows, put_in_order, read_rows
from benchmarks.harness import (
    Contestant,
    Timing,
    add_options,
    console,
    cpu_seconds,
    interleaved,
    machine,
    positive,
    table,
    write_json,
)

__all__ = ["main"]

ALONE = "the runs alone"
STORED = 5000  # runs of a large study
CHEAP = [name for name in MEASURED if name != "misallocation"]
SCENARIO: dict[str, Any] = {
    "model": "models.smart_cameras",
    "dynamics": "continuous",
    "control_unit": {"kind": "crossing"},
}
LATENCIES = [0.1 * number for number in range(1, 21)]
TOGETHER = "a warm-up that all share"
COLUMNS = ("program", "CPU ms\nper run", "over the\nruns alone")
LEGEND = (
    "The least of all repeats.  'The runs alone' are `Scenario.run` of scenarios that are there already;\n"
    "the studies run in a thread of this process, from the design to the folder."
)


def _study(options: argparse.Namespace, seed: int, measures: list[str] | None) -> Study:
    return Study.model_validate(
        {
            "replications": options.replications,
            "seed": seed,
            "measures": measures,
            "scenario": {**SCENARIO, "until": options.until},
            "axes": [
                {"name": "latency", "key": "channel.latency", "values": [0.0, 0.25, 0.5, 1.0]},
                {"name": "loss", "key": "channel.loss", "values": [0.0, 0.1, 0.2]},
            ],
        }
    )


def _runs(study: Study) -> list[PlannedRun]:
    points = expand(study)
    return [run_of(study, point, place) for place in range(study.replications) for point in points]


def _carried_out(study: Study, folder: Path) -> None:
    with ThreadPoolExecutor(1) as executor:
        run_study(study, folder, executor, 1)


def _contestants(options: argparse.Namespace, folder: Path) -> list[Contestant[None]]:
    def prepare_alone() -> Callable[[int], None]:
        scenarios = {
            seed: [run.scenario for run in _runs(_study(options, seed, None))]
            for seed in range(options.seed, options.seed + options.repeats)
        }

        def run(seed: int) -> None:
            for scenario in scenarios[seed]:
                scenario.run()

        return run

    def prepare_study(measures: list[str] | None) -> Callable[[], Callable[[int], None]]:
        def run(seed: int) -> None:
            shutil.rmtree(folder, ignore_errors=True)
            _carried_out(_study(options, seed, measures), folder)

        return lambda: run

    return [
        Contestant(ALONE, prepare_alone),
        Contestant("a study", prepare_study(None)),
        Contestant("a study without misallocation", prepare_study(CHEAP)),
    ]


def _milliseconds(call: Callable[[Any], Any], things: Sequence[Any], clock: Callable[[], float]) -> float:
    spent = []
    for thing in things:
        start = clock()
        call(thing)
        spent.append(clock() - start)
    return 1000.0 * statistics.median(spent)


def _parts(options: argparse.Namespace, folder: Path) -> dict[str, float]:
    """Time each step of a run's way through a study by itself, in ms of CPU; the disk by the wall."""
    study = _study(options, options.seed, None)
    points, runs, shared = expand(study), _runs(study), SharedParts()
    jobs = [run.job() for run in runs]
    done = []
    for job in jobs:
        scenario = shared.scenario(job)
        problem = shared.problem(job, scenario)
        done.append((job, scenario.run(problem=problem.problem), problem))
    records = [
        journal.record_of(
            {**job.labels, "digest": result.digest, VERSIONS: "{}"},
            {**summary_of(result, MEASURED, problem, list, dict), RUN_AWAY: result.run_away.tolist()},
        )
        for job, result, problem in done
    ]
    store = Store(folder / "parts")
    (store.folder / "runs").mkdir(parents=True)
    cpu, wall = time.process_time, time.perf_counter
    brief = _runs(_study(argparse.Namespace(**{**vars(options), "until": 1.0}), options.seed, None))
    found = {
        "a run to 1 unit, which every run takes": _milliseconds(lambda run: run.scenario.run(), brief, cpu),
        "seed and key": _milliseconds(lambda run: run_of(study, points[0], run.replication), runs, cpu),
        "the scenario in the worker": _milliseconds(shared.scenario, jobs, cpu),
        "summary without misallocation": _milliseconds(
            lambda one: summary_of(one[1], CHEAP, one[2], list, dict), done, cpu
        ),
        "misallocation, an optimum": _milliseconds(
            lambda one: summary_of(one[1], ["misallocation"], one[2], list, dict), done, cpu
        ),
        "a line of the journal": _milliseconds(
            lambda record: journal.append(store.folder / "runs", record), records, cpu
        ),
        "the same, waiting for the disk": _milliseconds(
            lambda record: journal.append(store.folder / "runs", record), records, wall
        ),
    }
    return found | _stored(study, store.folder)


def _stored(study: Study, folder: Path) -> dict[str, float]:
    """Time what a store of many runs costs, in ms of CPU for all of them: one run under many keys."""
    store, schema = Store(folder), run_schema(study)
    (record,) = journal.read(journal.journals(folder / "runs")[0].read_bytes(), "", "")[0][:1]
    for path in journal.journals(folder / "runs"):
        path.unlink()
    keys = [f"{number:032x}" for number in range(STORED)]
    for key in reversed(keys):
        labels = {**record["labels"], "key": key}
        journal.append(folder / "runs", journal.record_of(labels, record["columns"]))
    rows: list[StoredRows] = []
    clock = time.process_time
    return {
        f"{STORED:,} runs read from journals": _milliseconds(
            lambda _: rows.append(read_rows(store, schema)), [0], clock
        ),
        "put in order": _milliseconds(lambda _: put_in_order(store, rows[0], keys), [0], clock),
        "read from files": _milliseconds(lambda _: read_rows(store, schema).of(keys), range(3), clock),
    }


def _warm_up(options: argparse.Namespace, folder: Path) -> dict[str, float]:
    """Time studies of 20 points whose warm-up takes ten times as long as the rest, in s of CPU."""
    found = {}
    for name, paired in ((TOGETHER, True), ("each its own", False)):  # unpaired runs have nothing in common
        study = Study.model_validate(
            {
                "measures": CHEAP,
                "paired": paired,
                "warm_up": options.warm_up,
                "scenario": {**SCENARIO, "until": 1.1 * options.warm_up},
                "axes": [{"name": "latency", "key": "channel.latency", "values": LATENCIES}],
            }
        )
        start = cpu_seconds()
        _carried_out(study, folder / name)
        found[name] = cpu_seconds() - start
    return found


def _rows(timings: Sequence[Timing[None]], runs: int) -> list[dict[str, Any]]:
    each = {timing.name: 1000.0 * timing.best / runs for timing in timings}
    return [{"program": name, "ms": value, "over": value - each[ALONE]} for name, value in each.items()]


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.studies",
        description="what the machinery of studies adds to a run",
    )
    parser.add_argument(
        "--replications", type=positive, default=20, help="of each of 12 points (default: %(default)s)"
    )
    parser.add_argument("--until", type=float, default=60.0, help="end of the runs (default: %(default)s)")
    parser.add_argument(
        "--warm-up", type=float, default=60_000.0, help="of 20 points that share it (default: %(default)s)"
    )
    parser.add_argument("--out", type=Path, help="a folder to write below (default: a temporary one)")
    add_options(parser, repeats=5)
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> None:
    """Measure and print two tables."""
    options = _options(arguments)
    warnings.simplefilter("ignore")  # short runs have not settled, and say so
    out, host = console(), machine(("numpy", "numba", "pandas", "pyarrow", "pydantic"))
    out.print(", ".join(f"{name} {value}" for name, value in host.items()), soft_wrap=True)
    with tempfile.TemporaryDirectory(dir=options.out) as place:
        _carried_out(_study(options, options.seed, None), Path(place, "warm"))  # what is compiled is loaded
        timings = interleaved(_contestants(options, Path(place, "study")), options.repeats, options.seed)
        parts = _parts(options, Path(place))
        shared = _warm_up(options, Path(place))
    runs = 12 * options.replications
    rows = _rows(timings, runs)
    cells = [(row["program"], f"{row['ms']:.2f}", f"{row['over']:.2f}") for row in rows]
    out.print(table(f"{runs} runs, each to {options.until:g}", COLUMNS, cells))
    out.print(LEGEND, soft_wrap=True)
    out.print(table("Steps", ("step", "ms"), [(name, f"{value:.2f}") for name, value in parts.items()]))
    least = shared[TOGETHER]
    cells = [(name, f"{seconds:.2f}", f"{seconds / least:.1f}") for name, seconds in shared.items()]
    out.print(table("20 points, warm-up ten times the rest", ("program", "CPU s", "ratio"), cells))
    if options.json:
        names = ("replications", "until", "warm_up", "repeats", "seed")
        settings = {name: getattr(options, name) for name in names}
        found = {"rows": rows, "parts": parts, "shared": shared}
        write_json(options.json, {"machine": host, "settings": settings, **found})


if __name__ == "__main__":
    main()
