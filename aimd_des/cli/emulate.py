"""`aimd-des emulate`: a scenario over real sockets, and held against simulations."""

import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import click

from aimd_des.cli.errors import INTERRUPTED, Refusal, refusing, writing
from aimd_des.cli.options import out_option, overwrite_option, seed_option
from aimd_des.cli.printing import say
from aimd_des.cli.set_option import changes, check_command, set_option

if TYPE_CHECKING:
    from collections.abc import Callable

    from aimd_des.emulate import Collected, Emulation
    from aimd_des.scenario import Scenario
    from aimd_des.utils.folders import Place

_EPILOG = """\b
Examples:
  aimd-des emulate mine.toml --unit 0.25 --processes 4 --out results/real
  aimd-des emulate --replay results/real
  aimd-des emulate mine.toml --listen 10.0.0.1:47000 --out results/real
  aimd-des emulate mine.toml --join 10.0.0.1:47000 --processes 2
"""

_UNIT, _PROCESSES = 0.25, 4


@click.command("emulate", short_help="Run a scenario over real sockets.", epilog=_EPILOG)
@click.argument("scenario", type=click.Path(path_type=Path, dir_okay=False), required=False)
@click.option("--unit", type=float, help=f"Seconds for a unit of time.  [default: {_UNIT:g}]")
@click.option(
    "--processes",
    type=int,
    help=f"How many processes hold agents; with --listen, how many are waited for.  [default: {_PROCESSES}]",
)
@click.option(
    "--transport",
    type=click.Choice(["auto", "multicast", "unicast"]),
    help="One datagram for all processes, or one for each.  [default: auto, multicast where it works]",
)
@seed_option
@set_option("channel.latency=0.5 or until=40")
@out_option
@overwrite_option
@click.option("--figures/--no-figures", default=None, help="Draw the figures, too.  [default: figures]")
@click.option(
    "--replay",
    "replayed",
    metavar="DIR",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Run nothing: hold an emulation in DIR against simulations; --out gets table and figure.",
)
@click.option("--listen", metavar="ADDRESS:PORT", help="Let processes on other hosts hold the agents.")
@click.option("--join", "joined", metavar="ADDRESS:PORT", help="Hold agents of a host that listens there.")
@click.option(
    "--token",
    envvar="AIMD_DES_TOKEN",
    help="A secret that only the hosts know; better given by the variable AIMD_DES_TOKEN.",
)
def command(
    scenario: Path | None,
    unit: float | None,
    processes: int | None,
    transport: str | None,
    seed: int | None,
    settings: tuple[str, ...],
    out: Path | None,
    overwrite: bool,
    figures: bool | None,
    replayed: Path | None,
    listen: str | None,
    joined: str | None,
    token: str | None,
) -> None:
    """Run the agents of the file SCENARIO for real: as tasks of processes, with signals as datagrams.

    The control unit is a process of its own, which reads the agents' meters and sends one datagram for each
    signal over the loopback interface.  The receiver delays or loses it with the random numbers
    that a simulation has, so that both can be held against each other.  The folder receives what aimd-des run
    writes, and what was measured: delays and losses of the network, lateness of unit and agents, all records.

    Continuous agents are served, with the control units sampled and crossing; what is not is refused.
    """
    given = {"--unit": unit, "--transport": transport, "--figures": figures}
    written = {"--out": out, "--overwrite": overwrite or None}
    if replayed is not None:
        others = {"SCENARIO": scenario, "--processes": processes, "--seed": seed, "--set": settings or None}
        _refuse("--replay", {**given, **others, "--listen": listen, "--join": joined})
        _replay(replayed, out, overwrite)
        return
    if scenario is None:
        raise Refusal("SCENARIO: is missing; give the file of a scenario, or a folder with --replay")
    from aimd_des.scenario import load_scenario

    with refusing():
        check_command(scenario, study=False)
        loaded = load_scenario(scenario, **changes(settings, seed=seed))
    if joined is not None:
        _refuse("--join", {**given, **written, "--listen": listen})
        _join(scenario, loaded, joined, _PROCESSES if processes is None else processes, token)
        return
    if listen is not None:
        _refuse("--listen", {"--transport": transport})
    from aimd_des.utils.folders import check_folder

    folder = Path("results") / scenario.stem if out is None else out
    with writing(folder), refusing():
        place = check_folder(folder, overwrite=overwrite)
    with refusing(scenario):
        from aimd_des.emulate import check_setting

        many = _PROCESSES if processes is None else processes
        setting = check_setting(loaded, unit=_UNIT if unit is None else unit, processes=many)
    measured = _conducted(setting, transport or "auto", listen, token)
    _write(place, setting, measured, figures is not False)


def _refuse(option: str, others: dict[str, object]) -> None:
    """Refuse options that have no meaning beside another one."""
    for name, value in others.items():
        if value is not None:
            raise Refusal(f"{name}: has no meaning with {option}; leave it out")


def _conducted(setting: "Emulation", transport: str, listen: str | None, token: str | None) -> "Collected":
    """Run, and show how far it is."""
    from aimd_des.emulate import Conductor, Listener, check_token, parsed_address
    from aimd_des.utils.progress import RunProgress

    with refusing(), RunProgress(setting.until) as progress:

        def watch(time: float) -> None:
            progress.update(time, 0)

        if listen is None:
            return Conductor(setting, transport, watch).run()
        conductor = Listener(setting, parsed_address("listen", listen), check_token(token), watch)
        say(f"Waiting for {setting.processes} processes to join at {listen}", err=True)
        return conductor.run()


def _write(place: "Place", setting: "Emulation", measured: "Collected", figures: bool) -> None:
    """Write the folder, and say what came out."""
    from aimd_des.cli.run_tables import print_measures
    from aimd_des.emulate import lateness_words, write_emulation
    from aimd_des.results.overload import overload_words
    from aimd_des.scenario.run_folder import load_run
    from aimd_des.utils.errors import OverloadWarning

    with writing(place.folder), refusing(), warnings.catch_warnings():
        warnings.simplefilter("ignore", OverloadWarning)
        result, frames = write_emulation(place, setting, measured, figures=figures and not measured.stopped)
    with refusing():
        print_measures("Summary", load_run(place.folder))
    for sentence in lateness_words(frames):
        say(sentence)
    if result.run_away.any():
        names, mean = result.problem.resource_names, result.observations.second_half
        say(f"Warning: {overload_words(names, mean, result.run_away)}", err=True)
    say(f"Results in {place.folder}")
    if measured.stopped:
        kept = (
            f"what was measured up to time {measured.reached:.4g} of {setting.until:g} is in {place.folder}"
        )
        say(f"Stopped: {measured.stopped}; {kept}", err=True)
        raise SystemExit(INTERRUPTED if measured.interrupted else 1)


def _replay(folder: Path, out: Path | None, overwrite: bool) -> None:
    """Simulate what was emulated, and put all side by side."""
    from aimd_des.cli.terminal_tables import print_table
    from aimd_des.emulate import load_emulation, replay, replay_figure
    from aimd_des.results.measures import measure_words
    from aimd_des.utils.errors import OverloadWarning
    from aimd_des.utils.folders import check_folder, new_folder

    place = None
    if out is not None:
        with writing(out), refusing():
            place = check_folder(out, overwrite=overwrite, mark="replay.csv")
    with refusing(), warnings.catch_warnings():
        warnings.simplefilter("ignore", OverloadWarning)
        found = replay(load_emulation(folder))
        table = found.table()
    if place is not None:
        with writing(place.folder), refusing(), new_folder(place) as temporary:
            table.to_csv(temporary / "replay.csv", index=False)
            replay_figure(found).savefig(temporary / "replay.png", dpi=160)
    rows = [[_words(str(row[0]), measure_words), *row[1:]] for row in table.to_numpy().tolist()]
    print_table("Real and simulated", list(table.columns), rows, labels=2)
    for sentence in found.words():
        say(sentence)


def _words(measure: str, known: "Callable[[str], str]") -> str:
    return "averages apart" if measure == "distance" else known(measure)


def _join(scenario: Path, loaded: "Scenario", address: str, processes: int, token: str | None) -> None:
    """Hold agents until the host that conducts is done."""
    from aimd_des.emulate import MOST_PROCESSES, check_setting, check_token, join, parsed_address
    from aimd_des.utils import validation

    with refusing():
        where, secret = parsed_address("join", address), check_token(token)
        many = validation.integer("processes", processes, low=1, high=MOST_PROCESSES)
    with refusing(scenario):
        setting = check_setting(loaded, unit=1.0, processes=1)
    say(f"Process {os.getpid()} joins {address}", err=True)
    with refusing():
        join(setting, where, secret, many)
    say("The emulation is over.")
