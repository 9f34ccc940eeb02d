"""The options that several commands share: declared once, so that each means the same everywhere."""

from pathlib import Path

import click

seed_option = click.option(
    "--seed", type=int, help="Replaces the seed of the file; decides everything random."
)
out_option = click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=True),
    help="Folder for the results, new or empty.  [default: results/NAME of the file]",
)
overwrite_option = click.option(
    "--overwrite", is_flag=True, help="Replace a folder that an earlier run wrote."
)
