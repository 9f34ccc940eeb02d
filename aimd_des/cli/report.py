"""`aimd-des report`: one HTML file about a run or a study."""

from pathlib import Path

import click

from aimd_des.cli.errors import refusing, writing
from aimd_des.cli.printing import say

_EPILOG = """\b
Examples:
  aimd-des report results/run
  aimd-des report results/study --out study.html --overwrite
"""


@click.command("report", short_help="Write one HTML file about a run or a study.", epilog=_EPILOG)
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="The file to write.  [default: DIR.html, beside the folder]",
)
@click.option("--overwrite", is_flag=True, help="Replace the file if it is there.")
def command(folder: Path, out: Path | None, overwrite: bool) -> None:
    """Write one HTML file about what was run in the folder DIR, and what came out.

    It shows the verdict in three numbers, charts that can be moved through, all measures, and where
    they come from.  Everything is in the file: it opens in a browser without a network, and can be sent.
    Needs the extra `report`: pip install 'aimd-des[report]'.
    """
    from aimd_des.report import check_page, report_run, report_study, write_page
    from aimd_des.utils.folders import is_study

    path = folder.resolve().with_name(f"{folder.resolve().name}.html") if out is None else out
    with refusing():
        check_page(path, overwrite=overwrite)
        if is_study(folder):
            from aimd_des.study import load_study

            page = report_study(load_study(folder))
        else:
            from aimd_des.scenario.run_folder import load_run

            page = report_run(load_run(folder))
    with writing(path):
        write_page(page, path)
    say(f"Report in {path}")
