"""What the machinery of studies adds to a run: studies of small runs beside the same runs by themselves."""

import argparse
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import tomli_w

from aimd_des.results.measures import MEASURED
from aimd_des.scenario import Scenario
from aimd_des.study import Study, run_study
from aimd_des.study.points import Run, expand, run_of
from aimd_des.study.run_tables import run_schema, run_table, summary_of
from aimd_des.study.store import parquet, write_file
from benchmarks.harness import (
    Contestant,
    Timing,
    add_options,
    console,
    interleaved,
    machine,
    positive,
    table,
    write_json,
)

__all__ = ["main"]

ALONE = "the runs alone"
CHEAP = [name for name in MEASURED if name != "misallocation"]
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
            "scenario": {
                "model": "models.smart_cameras",
                "dynamics": "continuous",
                "control_unit": {"kind": "crossing"},
                "until": options.until,
            },
            "axes": [
                {"name": "latency", "key": "channel.latency", "values": [0.0, 0.25, 0.5, 1.0]},
                {"name": "loss", "key": "channel.loss", "values": [0.0, 0.1, 0.2]},
            ],
        }
    )


def _runs(study: Study) -> list[Run]:
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
    points = expand(study)
    runs = _runs(study)
    schema = run_schema(study)
    jobs = [run.job() for run in runs]
    done = [(run, run.scenario.run()) for run in runs]
    rows = [
        (
            {**run.labels, "digest": result.digest},
            summary_of(run.scenario, result, MEASURED),
            tomli_w.dumps(run.job().scenario),
        )
        for run, result in done
    ]
    tables = [run_table(schema, *row) for row in rows]
    files = [parquet(rows_of_run, small=True) for rows_of_run in tables]
    cpu, wall = time.process_time, time.perf_counter
    return {
        "scenario, seed and key": _milliseconds(
            lambda run: run_of(study, points[0], run.replication), runs, cpu
        ),
        "the scenario as data": _milliseconds(lambda run: run.job(), runs, cpu),
        "the scenario checked by the worker": _milliseconds(
            lambda job: Scenario.model_validate(job.scenario), jobs, cpu
        ),
        "summary without misallocation": _milliseconds(
            lambda one: summary_of(one[0].scenario, one[1], CHEAP), done, cpu
        ),
        "misallocation, an optimum": _milliseconds(
            lambda one: summary_of(one[0].scenario, one[1], ["misallocation"]), done, cpu
        ),
        "rows": _milliseconds(lambda row: run_table(schema, *row), rows, cpu),
        "Parquet": _milliseconds(lambda one: parquet(one, small=True), tables, cpu),
        "file": _milliseconds(lambda one: write_file(folder / "file", one), files, cpu),
        "file, waiting for the disk": _milliseconds(
            lambda one: write_file(folder / "file", one), files, wall
        ),
    }


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
    parser.add_argument("--out", type=Path, help="a folder to write below (default: a temporary one)")
    add_options(parser, repeats=5)
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> None:
    """Measure and print two tables."""
    options = _options(arguments)
    out, host = console(), machine(("numpy", "numba", "pandas", "pyarrow", "pydantic"))
    out.print(", ".join(f"{name} {value}" for name, value in host.items()), soft_wrap=True)
    with tempfile.TemporaryDirectory(dir=options.out) as place:
        _carried_out(_study(options, options.seed, None), Path(place, "warm"))  # what is compiled is loaded
        timings = interleaved(_contestants(options, Path(place, "study")), options.repeats, options.seed)
        parts = _parts(options, Path(place))
    runs = 12 * options.replications
    rows = _rows(timings, runs)
    cells = [(row["program"], f"{row['ms']:.2f}", f"{row['over']:.2f}") for row in rows]
    out.print(table(f"{runs} runs, each to {options.until:g}", COLUMNS, cells))
    out.print(LEGEND, soft_wrap=True)
    out.print(table("Steps", ("step", "ms"), [(name, f"{value:.2f}") for name, value in parts.items()]))
    if options.json:
        settings = {name: getattr(options, name) for name in ("replications", "until", "repeats", "seed")}
        write_json(options.json, {"machine": host, "settings": settings, "rows": rows, "parts": parts})


if __name__ == "__main__":
    main()
