"""List the scenarios, each with the first line of its docstring."""

import ast
from pathlib import Path

import click


def scenarios() -> dict[str, str]:
    """Find the scenarios beside this file: modules, and folders that can be run.

    Returns
    -------
    dict of str to str
        How to run each, and the first line of its docstring; nothing is imported.
    """
    here = Path(__file__).parent
    sources = {path.stem: path for path in here.glob("[!_]*.py")}
    sources |= {path.parent.name: path.with_name("__init__.py") for path in here.glob("*/__main__.py")}
    found = {}
    for name, source in sorted(sources.items()):
        text = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""
        found[f"python -m scenarios.{name}"] = text.partition("\n")[0]
    return found


if __name__ == "__main__":
    width = max(map(len, scenarios()))
    for command, line in scenarios().items():
        click.echo(f"{command:{width}}  {line}")
