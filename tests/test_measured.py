"""Columns of CSV files: which line holds their names, and that no row is ever silently missing."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from aimd_des import interventions, topology
from aimd_des.latency import Empirical
from aimd_des.loss import Trace
from aimd_des.utils.errors import InputError

READERS: dict[str, tuple[Callable[[Path], Any], str]] = {
    "all columns of a trace": (lambda path: Trace.from_csv(path, repeat=True), "1\n0\n0\n1\n"),
    "a trace of agents": (lambda path: Trace.from_csv(path, repeat=True), "1,0\n0,0\n"),
    # Two cells that are the same would be renamed by readers that want every name once.
    "a trace of equal cells": (lambda path: Trace.from_csv(path, repeat=True), "0,0,1\n1,0,1\n"),
    "words": (lambda path: Trace.from_csv(path, repeat=True), "true\nfalse\n"),
    "a named column": (lambda path: Trace.from_csv(path, "1", repeat=True), "1\n0\n0\n1\n"),
    "a cell that is missing": (lambda path: Trace.from_csv(path, repeat=True), "nan\n0\n0\n1\n"),
    "latencies": (lambda path: Empirical.from_csv(path, "12.5"), "12.5\n3\n0.1\n"),
    "a profile": (
        lambda path: interventions.CapacityProfile.from_csv(path, 0, time="0", capacity="9"),
        "0,9\n6,5\n18,7\n",
    ),
    "edges": (
        lambda path: topology.from_edges(path, root="0", source="0", target="1", latency="2", loss="0.5"),
        "0,1,2,0.5\n1,2,3,0.25\n",
    ),
}


@pytest.mark.parametrize("reader", READERS)
def test_a_first_line_of_values_is_refused(reader: str, tmp_path: Path) -> None:
    """Taken for names, it would be one row less: of 1, 0, 0, 1 a share of 1/3 would be lost, not 1/2."""
    read, text = READERS[reader]
    path = tmp_path / "measured.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read(path)
    first = text.partition("\n")[0]
    assert str(refused.value) == (
        f"{path}: first line = {first!r}: must be the names of the columns, and these are values; "
        "put a line with names above it, which are no values themselves"
    )


def test_with_a_line_of_names_every_row_counts(tmp_path: Path) -> None:
    path = tmp_path / "losses.csv"
    path.write_text("lost\n1\n0\n0\n1\n\n", encoding="utf-8")
    assert Trace.from_csv(path, repeat=True).mean == 0.5
    # Agents are called by their numbers unless they have names; 2 is no value of a trace.
    path.write_text("0,1,2\n1,0,0\n0,0,1\n", encoding="utf-8")
    assert Trace.from_csv(path, repeat=True).mean.tolist() == [0.5, 0.0, 0.5]


@pytest.mark.parametrize("separator", [";", "\t"])
def test_another_separator_is_refused_by_name(separator: str, tmp_path: Path) -> None:
    """As a spreadsheet writes it where the decimal point is a comma: the row would have other cells."""
    path = tmp_path / "delays.csv"
    path.write_text(f"time{separator}rtt\n0{separator}41,5\n", encoding="utf-8")
    with pytest.raises(InputError) as refused:
        Empirical.from_csv(path, "rtt")
    assert str(refused.value) == (
        f"{path}: separator of columns = {separator!r}: must be a comma; "
        "save it with commas between columns, and points in numbers"
    )


def test_an_empty_line_within_one_column_is_a_cell_that_is_missing(tmp_path: Path) -> None:
    """Skipped, it would move all later rows to other broadcasts."""
    path = tmp_path / "losses.csv"
    path.write_text("lost\n1\n\n0\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"column 'lost', row 2 = '': must be 0 or 1, false or true$"):
        Trace.from_csv(path, repeat=True)
