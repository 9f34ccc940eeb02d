"""`aimd-des show`: what a folder holds, in the terminal."""

from pathlib import Path

import click

from aimd_des.cli.errors import Refusal, refusing
from aimd_des.cli.printing import paged


@click.command("show")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--measure", "measures", multiple=True, help="Show this measure only; may be repeated.")
@click.option(
    "--by",
    "axes",
    multiple=True,
    help="Of a study: tell the values of this axis apart, and take means over the others; may be repeated.",
)
@click.option("--csv", "form", flag_value="csv", help="Print the numbers as CSV, for other programs.")
@click.option("--json", "form", flag_value="json", help="Print the numbers as JSON, for other programs.")
@click.option(
    "--plot",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Of a study: draw the first measure into this new file, .pdf, .svg or .png: along the one axis of"
    " --by with its intervals, or over two, as a map or with a line for each case.",
)
def command(
    folder: Path, measures: tuple[str, ...], axes: tuple[str, ...], form: str | None, plot: Path | None
) -> None:
    """Show what was run in the folder DIR, and what came out.

    Of a run: the scenario, versions, digest, and all measures of each resource.  Of a study: the axes,
    how many runs are there, failed or missing, and at each point the mean of the main measures over the
    replications, with the half-width of its 95 % confidence interval.  What is longer than the terminal
    is shown page by page.
    """
    from aimd_des.cli.study_tables import show_study
    from aimd_des.utils.folders import is_study

    if form and plot:
        raise Refusal(f"--plot: cannot be given together with --{form}; say one of them")
    with refusing():
        if is_study(folder):
            if form or plot:
                _study_data(folder, measures, axes, form, plot)
            else:
                with paged():
                    show_study(folder, measures, axes)
            return
        for option, given in (("--by", axes), ("--plot", plot)):
            if given:
                raise Refusal(f"{option}: has a meaning for the folder of a study only, and {folder} is none")
        from aimd_des.cli.run_tables import show_run
        from aimd_des.cli.show_data import print_data, run_table
        from aimd_des.scenario.run_folder import load_run

        if form:
            print_data(run_table(load_run(folder), measures), "csv" if form == "csv" else "json")
        else:
            with paged():
                show_run(load_run(folder), measures)


def _study_data(
    folder: Path, measures: tuple[str, ...], by: tuple[str, ...], form: str | None, plot: Path | None
) -> None:
    """Print the means of a study as data, or draw them."""
    from aimd_des.cli.show_data import check_plot, plot_study, print_data, study_table
    from aimd_des.cli.study_tables import chosen_axes, chosen_measures
    from aimd_des.study import load_study

    if plot:
        check_plot(plot)
    results = load_study(folder)
    names = chosen_measures(results.study.columns(), measures)
    axes = chosen_axes(results.study, by)
    if results.runs.empty:
        raise Refusal(f"{folder}: no run is there yet")
    if plot:
        plot_study(results, axes, names[0], plot)
    else:
        print_data(study_table(results, axes, names), "csv" if form == "csv" else "json")
