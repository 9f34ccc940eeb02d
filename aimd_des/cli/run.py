"""`aimd-des run`: one scenario, and a folder with what came out."""

import math
import warnings
from pathlib import Path

import click

from aimd_des.cli.errors import refusing, writing
from aimd_des.cli.options import out_option, overwrite_option, seed_option
from aimd_des.cli.printing import say
from aimd_des.cli.set_option import changes, check_command, set_option
from aimd_des.cli.show_data import FORMATS


def _formats(_context: click.Context, _option: click.Parameter, given: str) -> tuple[str, ...]:
    """Take formats apart, each once."""
    formats = tuple(dict.fromkeys(word.strip() for word in given.split(",")))
    for word in formats:
        if word not in FORMATS:
            raise click.BadParameter(f"{word!r}: must be some of {', '.join(FORMATS)}, separated by commas")
    return formats


@click.command(
    "run",
    short_help="Run one scenario, and write what came out.",
    epilog="What a scenario file may say is described in docs/scenario_files.md of the project.",
)
@click.argument("scenario", type=click.Path(path_type=Path, dir_okay=False))
@seed_option
@click.option(
    "--agents",
    type=click.Choice(["process", "fleet"]),
    help="Replaces the word of the file: a SimPy process each, or all in compiled code; same results.",
)
@set_option("channel.latency=0.5 or resources.0.capacity=10")
@out_option
@overwrite_option
@click.option(
    "--checkpoint",
    type=click.FloatRange(0.0, min_open=True),
    help="Every so many seconds, or later if that takes over 1 % of the time, write to OUT.checkpoint where "
    "the run stands; for fleets.",
)
@click.option("--resume", is_flag=True, help="Go on from OUT.checkpoint, if there is one.")
@click.option("--figures/--no-figures", default=True, show_default=True, help="Draw the figures, too.")
@click.option(
    "--format",
    "formats",
    default="png",
    show_default=True,
    callback=_formats,
    metavar="FORMATS",
    help="Formats of the figures, separated by commas: png, and pdf and svg with vectors.",
)
def command(
    scenario: Path,
    seed: int | None,
    agents: str | None,
    settings: tuple[str, ...],
    out: Path | None,
    overwrite: bool,
    checkpoint: float | None,
    resume: bool,
    figures: bool,
    formats: tuple[str, ...],
) -> None:
    """Run the system that the file SCENARIO describes, and write what came out.

    The folder receives scenario.toml (the run, every value spelled out), run.json (digest, seed,
    versions), figures, and SHA256SUMS (a checksum of each file). Tables are summary.csv (a row for each
    resource), signals.parquet, demand.parquet and allocations.parquet. Their references are
    capacity.parquet, optimum.parquet, and convergence.parquet (misallocation over time, measured and
    expected).  The same scenario and seed give the same digest.

    A run with --checkpoint that was ended goes on with --resume, to the same bytes: the same command with
    both may be repeated until it is through.
    """
    from aimd_des.cli.run_tables import print_measures
    from aimd_des.results.overload import overload_words
    from aimd_des.scenario import load_scenario
    from aimd_des.scenario.checkpoints import begin, finish
    from aimd_des.scenario.run_folder import load_run, write_run
    from aimd_des.utils.errors import OverloadWarning
    from aimd_des.utils.folders import check_folder
    from aimd_des.utils.progress import RunProgress

    folder = Path("results") / scenario.stem if out is None else out
    kept = folder.with_name(f"{folder.name}.checkpoint")
    with refusing():
        check_command(scenario, study=False)
        loaded = load_scenario(scenario, **changes(settings, seed=seed, agents=agents))
    with writing(folder), refusing():
        place = check_folder(folder, overwrite=overwrite)
    with refusing(scenario), RunProgress(loaded.until) as progress, warnings.catch_warnings():
        warnings.simplefilter("ignore", OverloadWarning)  # said below, in one line
        if checkpoint is None and not resume:
            result = loaded.run(progress.update)
        else:
            begun = begin(loaded, kept, resumed=resume)
            if begun.time > 0.0:
                say(f"Goes on at time {begun.time:g} from {kept}", err=True)
            result = finish(begun, kept, math.inf if checkpoint is None else checkpoint, progress.update)
    with writing(folder), refusing():
        write_run(place, loaded, result, figures=figures, formats=formats)
        if resume or checkpoint is not None:
            kept.unlink(missing_ok=True)
    with refusing():
        stored = load_run(folder)
        print_measures("Summary", stored)
    for sentence in stored.accuracy:
        say(sentence)
    if loaded.rare_event is not None:
        from aimd_des.study.rare_event_file import estimated, in_words

        with refusing():
            say(in_words(estimated(loaded), loaded))
    if result.run_away.any():
        names, mean = result.problem.resource_names, result.observations.second_half
        say(f"Warning: {overload_words(names, mean, result.run_away, result.judged)}", err=True)
    say(f"Results in {folder}")
