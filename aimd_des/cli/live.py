"""`aimd-des live`: a page in the browser on which one plays with a system."""

import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

import click

from aimd_des.cli.errors import Refusal, refusing, writing
from aimd_des.cli.options import seed_option
from aimd_des.cli.printing import say
from aimd_des.cli.set_option import changes, check_command, set_option

if TYPE_CHECKING:
    from aimd_des.scenario import Scenario

_EPILOG = """\b
Examples:
  aimd-des live
  aimd-des live my_system.toml --set channel.loss=0.2
  aimd-des live --export page.html --from 30 --to 60
"""


@click.command("live", short_help="Show and change a system in the browser while it runs.", epilog=_EPILOG)
@click.argument("scenario", type=click.Path(path_type=Path, dir_okay=False), required=False)
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, help="Where to listen.  [default: any that is free]"
)
@click.option("--browser/--no-browser", default=True, show_default=True, help="Open the page.")
@seed_option
@click.option(
    "--export", "page", type=click.Path(path_type=Path), help="Write a page with one recorded run, and end."
)
@click.option("--from", "since", type=float, default=40.0, show_default=True, help="Where the record begins.")
@click.option("--to", type=float, default=80.0, show_default=True, help="Where it ends.")
@click.option("--overwrite", is_flag=True, help="Replace the page if it is there.")
@set_option("channel.latency=0.5")
def command(
    scenario: Path | None,
    port: int,
    browser: bool,
    seed: int | None,
    page: Path | None,
    since: float,
    to: float,
    overwrite: bool,
    settings: tuple[str, ...],
) -> None:
    """Play with the system that the file SCENARIO describes, in the browser.

    Without a file it is the paper's cameras, as continuous agents.  The page shows the agents round the
    control unit, every copy of a signal on its way, total demand against capacity, and the misallocation.
    It plays, pauses, steps, and changes the system while it runs.  What was played can be saved as a
    scenario file that repeats it to the last bit.  The server listens on this machine only; Ctrl-C ends
    it. Needs the extra `live`: pip install 'aimd-des[live]'.
    """
    from aimd_des.live import check_server, default_scenario, serve
    from aimd_des.scenario import load_scenario, validate_scenario, with_settings

    if page is None:
        with refusing():
            check_server()
    with refusing():
        given = changes(settings, seed=seed)
        if scenario is None:
            base = validate_scenario(with_settings(default_scenario().spoken(), given), "the paper's cameras")
        else:
            check_command(scenario, study=False)
            base = load_scenario(scenario, **given)
        if base.dynamics == "synchronous":
            raise Refusal("dynamics = 'synchronous': must be 'discrete' or 'continuous' for a live page")
        if page is not None:
            _export(base, page, since, to, overwrite=overwrite)
            return
        serve(base, port, lambda address: _tell(address, browser=browser))
    say("Stopped.")


def _export(base: "Scenario", page: Path, since: float, to: float, *, overwrite: bool) -> None:
    """Write a page with one recorded run."""
    from aimd_des.live import export_page, write_page
    from aimd_des.live.settings import PageState
    from aimd_des.utils import validation

    if page.exists() and not overwrite:
        raise Refusal(f"export = {str(page)!r}: must be a new file; choose another, or say --overwrite")
    for name, value in (("from", since), ("to", to)):
        validation.number(name, value, low=0.0 if name == "from" else since, high=base.until)
    text = export_page(base, PageState({}, ()), since, to)
    with writing(page):
        write_page(text, page)
    say(f"Page in {page}")


def _tell(address: str, *, browser: bool) -> None:
    say(f"Playing at {address}")
    say("Ctrl-C ends it.")
    if browser:
        webbrowser.open(address)
