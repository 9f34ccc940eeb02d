"""`aimd-des watch`: a run, seen while it goes on."""

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import click

from aimd_des.cli.errors import INTERRUPTED, refusing
from aimd_des.cli.options import seed_option
from aimd_des.cli.printing import say
from aimd_des.cli.set_option import changes, check_command, set_option
from aimd_des.utils.formatting import grouped

if TYPE_CHECKING:
    from rich.console import Console

    from aimd_des.problem import Problem
    from aimd_des.scenario import Scenario
    from aimd_des.watch import View

_EPILOG = """\b
Examples:
  aimd-des watch scenarios/paper.toml
  aimd-des watch scenarios/paper.toml --speed 20 --until 1000

Keys: space pauses and goes on; s takes one event, n goes to the next signal; + and -
double and halve the speed; tab or the digits of a number choose the agent that is shown.
"""


@click.command("watch", short_help="Run one scenario, and show it meanwhile.", epilog=_EPILOG)
@click.argument("scenario", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--speed",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Units of simulated time per second.  [default: as fast as it goes]",
)
@click.option("--until", type=float, help="Replaces the end of the run in the file.")
@seed_option
@set_option("channel.loss=0.1")
def command(
    scenario: Path, speed: float | None, until: float | None, seed: int | None, settings: tuple[str, ...]
) -> None:
    """Watch the run that the file SCENARIO describes while it goes on.

    For each resource it shows total demand as a bar (the mark is the capacity) and as a curve of the last
    samples. Numbers beside them are the signals so far, the part of the capacity that averages use, and
    the misallocation.  Nothing is written: `aimd-des run` keeps the results, and gives the same digest.
    Where the output is no terminal, twenty lines are printed over the run.  Ctrl-C ends it.
    """
    from aimd_des.scenario import load_scenario

    with refusing():
        check_command(scenario, study=False)
        loaded = load_scenario(scenario, **changes(settings, until=until, seed=seed))
    with refusing(scenario):
        _watch(loaded, speed)


def _watch(scenario: "Scenario", speed: float | None) -> None:
    """Run, show, and say what came out."""
    from rich.console import Console

    from aimd_des.watch import Monitor, NoKeys, keyboard, last_snapshot

    run, console = scenario.simulation().start(scenario.until), Console()
    with keyboard() if console.is_terminal else nullcontext(NoKeys()) as keys:
        view = _view(scenario, run.simulation.problem, console, full=not isinstance(keys, NoKeys))
        looker = Monitor(view.show, view.interval, speed, sparing=view.sparing, keys=keys)
        try:
            with view:
                result = looker.play(run)
                view.end(last_snapshot(result))
        except KeyboardInterrupt:
            reached = f"{grouped(looker.reached)} of {grouped(scenario.until)}"
            say(f"Stopped at time {reached}.", err=True)
            raise SystemExit(INTERRUPTED) from None
    say(f"digest {result.digest}")


def _view(scenario: "Scenario", problem: "Problem", console: "Console", *, full: bool) -> "View":
    """Choose a picture for a terminal, and lines for anything else."""
    from aimd_des.watch import LiveView, PlainView

    if console.is_terminal:
        return LiveView(problem, scenario.until, scenario.title, console, full=full)
    return PlainView(problem, scenario.until, say)
