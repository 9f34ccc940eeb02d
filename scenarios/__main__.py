"""List the scenarios, each with the first line of its docstring."""

import ast
from pathlib import Path

import click


def scenarios() -> dict[str, str]:
    """Find the scenarios beside this file.

    Returns
    -------
    dict of str to str
        How to run each, and the first line of its docstring; nothing is imported.
    """
    found = {}
    for path in sorted(Path(__file__).parent.glob("[!_]*.py")):
        text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        found[f"python -m scenarios.{path.stem}"] = text.partition("\n")[0]
    return found


if __name__ == "__main__":
    width = max(map(len, scenarios()))
    for command, line in scenarios().items():
        click.echo(f"{command:{width}}  {line}")
