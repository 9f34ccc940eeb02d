"""`aimd-des list`: what there is, with parameters, defaults and meanings."""

import json
from dataclasses import asdict

import click

from aimd_des.cli.catalog import TOPICS, CatalogEntry, entries
from aimd_des.cli.errors import refusing
from aimd_des.cli.printing import say


@click.command("list")
@click.argument("topic", metavar="[TOPIC]", required=False, type=click.Choice(list(TOPICS)))
@click.option("--json", "as_json", is_flag=True, help="Print JSON, for other programs.")
def command(topic: str | None, as_json: bool) -> None:
    """List what there is of one TOPIC, or the names of everything.

    TOPIC is one of models, scenarios, control_units, latency, loss, networks, averaging, responses,
    compensation, interventions and costs.

    Models are those of the package `models` on the Python path or in the working directory, scenarios
    those of its folder `scenarios` and the scenario files beside them.  The other topics are kinds that a
    scenario file can name, each with its keys, their defaults and their meanings. Parts of your own are
    found in modules of the working directory and of packages that declare them.
    """
    with refusing():
        found = {name: entries(name) for name in ([topic] if topic else TOPICS)}
    if as_json:
        content = {name: [asdict(entry) for entry in of] for name, of in found.items()}
        say(json.dumps(content, indent=2))
    elif topic:
        _print_topic(topic, found[topic])
    else:
        _print_names(found)


def _print_topic(topic: str, found: list[CatalogEntry]) -> None:
    from aimd_des.cli.terminal_tables import print_table

    title = TOPICS[topic].title
    if not found:
        say(f"{title}: there are none in this folder or on the Python path.")
    elif not any(entry.parameters for entry in found):
        print_table(title, ["name", "meaning"], [[entry.name, _plain(entry.meaning)] for entry in found])
    else:
        rows = []
        for entry in found:
            rows.append([entry.name, "", _plain(entry.meaning)])
            rows += [
                [f"  {key.name}", "required" if key.required else _short(key.default), _plain(key.meaning)]
                for key in entry.parameters
            ]
        print_table(title, ["name and keys", "default", "meaning"], rows)


def _short(default: str) -> str:
    """Shorten a long list; all of it is in the JSON."""
    from aimd_des.utils.formatting import given

    return given(json.loads(default)) if default.startswith("[") else default


def _plain(text: str) -> str:
    """Drop the marks of code, which say nothing in a terminal."""
    return text.replace("`", "")


def _print_names(found: dict[str, list[CatalogEntry]]) -> None:
    from aimd_des.cli.terminal_tables import print_pairs

    names = [(topic, ", ".join(dict.fromkeys(entry.name for entry in of))) for topic, of in found.items()]
    print_pairs("What there is; aimd-des list TOPIC tells more", names)
