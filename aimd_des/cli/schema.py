"""`aimd-des schema`: what files may say, for editors."""

import json
from pathlib import Path
from typing import Any

import click

from aimd_des.cli.errors import refusing, writing
from aimd_des.cli.printing import say

_EPILOG = """\b
Editors that use Taplo, such as VS Code with Even Better TOML, find the schema
by the first line of a file:
  #:schema scenario.schema.json
"""


@click.command("schema", epilog=_EPILOG)
@click.argument("kind", type=click.Choice(["scenario", "study"]), default="scenario")
@click.option(
    "--out", type=click.Path(path_type=Path, dir_okay=False), help="Write to this file, and print nothing."
)
def command(kind: str, out: Path | None) -> None:
    """Print the JSON Schema of scenario files, or of study files.

    An editor that knows it completes keys, shows what they mean, and marks mistakes.
    """
    with refusing():
        schema = schema_of(kind)
    text = json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
    if out is None:
        say(text, end=False)
        return
    from aimd_des.utils.whole_files import write_file

    with writing(out):
        write_file(out, text.encode())


def schema_of(kind: str) -> dict[str, Any]:
    """Give the schema of files of a kind."""
    if kind == "scenario":
        from aimd_des.scenario.schema import scenario_schema

        return scenario_schema()
    from aimd_des.study.schema import study_schema

    return study_schema()
