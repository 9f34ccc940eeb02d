"""`aimd-des watch`: a run, seen while it goes on."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from aimd_des.cli.errors import INTERRUPTED, refusing
from aimd_des.cli.printing import say
from aimd_des.cli.set_option import changes, check_command, set_option
from aimd_des.utils.formatting import grouped

if TYPE_CHECKING:
    from aimd_des.scenario import Scenario
    from aimd_des.watch import View

_EPILOG = """\b
Examples:
  aimd-des watch scenarios/paper.toml
  aimd-des watch scenarios/paper.toml --speed 20 --until 1000
"""


@click.command("watch", epilog=_EPILOG)
@click.argument("scenario", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--speed",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Units of simulated time per second.  [default: as fast as it goes]",
)
@click.option("--until", type=float, help="Replaces the end of the run in the file.")
@click.option("--seed", type=int, help="Replaces the seed of the file; decides everything random.")
@set_option("channel.loss=0.1")
def command(
    scenario: Path, speed: float | None, until: float | None, seed: int | None, settings: tuple[str, ...]
) -> None:
    """Watch the run that the file SCENARIO describes while it goes on.

    For each resource: total demand against capacity as a bar (the mark is the capacity) and as a curve
    of the last looks, the signals so far, how much of the capacity the averages use, and how wrongly it
    is shared (misallocation).  Nothing is written: `aimd-des run` keeps the results, and gives the
    same digest.  Where the output is no terminal, twenty lines are printed over the run.  Ctrl-C ends it.
    """
    from aimd_des.scenario import load_scenario

    with refusing():
        check_command(scenario, study=False)
        loaded = load_scenario(scenario, **changes(settings, until=until, seed=seed))
    with refusing(scenario):
        _watch(loaded, speed)


def _watch(scenario: "Scenario", speed: float | None) -> None:
    """Run, show, and say what came out."""
    from aimd_des.watch import Monitor, last_snapshot

    view = _view(scenario)
    looker = Monitor(view.show, view.interval(speed), speed, sparing=view.sparing)
    try:
        with view:
            result = scenario.run(processes=[looker.process])
            view.end(last_snapshot(result))
    except KeyboardInterrupt:
        say(f"Stopped at time {grouped(looker.reached)} of {grouped(scenario.until)}.", err=True)
        raise SystemExit(INTERRUPTED) from None
    say(f"digest {result.digest}")


def _view(scenario: "Scenario") -> "View":
    """Choose a picture for a terminal, and lines for anything else."""
    from rich.console import Console

    from aimd_des.watch import LiveView, PlainView

    problem, console = scenario.problem(), Console()
    if console.is_terminal:
        return LiveView(problem, scenario.until, scenario.title, console)
    return PlainView(problem, scenario.until, say)
