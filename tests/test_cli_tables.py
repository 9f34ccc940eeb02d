"""Tables in the terminal: every number whole, whatever the width and the encoding."""

import io
import math
import sys

import pytest

from aimd_des.cli.terminal_tables import plus_minus, plus_or_minus, print_pairs, print_table
from aimd_des.utils.formatting import given, interval, measured


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (12345, "12,345"),
        (0, "0"),
        (0.0, "0.000"),
        (0.04321, "0.04321"),
        (1.0, "1.000"),
        (-12.3456, "-12.35"),
        (12345.6, "12,346"),
        (0.99996, "1.0000"),
        (1.5e-7, "1.500e-07"),
        (2.5e12, "2.500e+12"),
        (math.nan, "nan"),
        (math.inf, "inf"),
        ("memory", "memory"),
        (None, ""),
    ],
)
def test_what_was_measured_has_four_digits(value: object, text: str) -> None:
    assert measured(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (12345, "12345"),
        (0.5, "0.5"),
        (1.0, "1"),
        (1 / 90, "0.0111111"),
        (True, "true"),
        ("fleet", "fleet"),
        ([1, 2.5], "[1, 2.5]"),
        ([0.1 * k for k in range(60)], "[0, 0.1, ... 5.9] (60 values)"),
        ({"latency": {"kind": "exponential", "mean": 0.5}}, "latency (kind exponential, mean 0.5)"),
        ([{"kind": "common"}], "[(kind common)]"),
    ],
)
def test_what_was_set_is_short(value: object, text: str) -> None:
    assert given(value) == text


@pytest.mark.parametrize(
    ("mean", "half_width", "text"),
    [
        (0.98765, 0.0123, "0.988 ± 0.012"),
        (1234.5, 56.7, "1,234 ± 57"),
        (1234.5, 567.8, "1,234 ± 568"),
        (-0.5, 0.25, "-0.50 ± 0.25"),
        (3.0, 0.0, "3.000 ± 0"),
        (1e-9, 2e-10, "1.000e-09 ± 2.0e-10"),
        (1.0001898, 7.9e-6, "1.0001898 ± 0.0000079"),
        (1.0, 1e-16, "1.000 ± 1.0e-16"),
        (0.5, math.nan, "0.5000"),
        (0.5, math.inf, "0.5000"),
        (math.nan, 0.1, "nan"),
    ],
)
def test_an_interval_has_two_digits_of_its_half_width(mean: float, half_width: float, text: str) -> None:
    assert interval(mean, half_width) == text


COLUMNS = ["measure", *(f"resource {j}" for j in range(12))]
ROWS = [[f"measure {k}", *(1000.0 * k + 2.0 * j + 1.5 for j in range(12))] for k in range(3)]


@pytest.mark.parametrize("width", [30, 80, 200])
def test_a_table_that_is_too_wide_is_shown_in_parts(
    width: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    print_table("Title", COLUMNS, ROWS)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Title"
    assert max(map(len, lines)) <= width
    whole = [word for line in lines for word in line.split()]
    for row in ROWS:
        for value in row[1:]:
            assert whole.count(measured(value)) == 1, value
    heads = sum(line.startswith("measure ") and "resource" in line for line in lines)
    assert heads == {30: 12, 80: 3, 200: 1}[width]


def test_long_texts_go_on_in_the_next_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "50")
    print_table("Title", ["key", "meaning"], [["a", "word " * 30], ["b" * 70, "end"]])
    print_pairs("Title", [("name", "x" * 120)])
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 50
    assert (out.count("word"), out.count("b"), out.count("x")) == (30, 70, 120)


def test_brackets_are_no_markup(capsys: pytest.CaptureFixture[str]) -> None:
    print_table("[bold]Title", ["[red]key"], [["[/red] [0, 1]"]])
    print_pairs("[bold]Pairs", [("loss", "[/x]")])
    out = capsys.readouterr().out
    for text in ("[bold]Title", "[red]key", "[/red] [0, 1]", "[bold]Pairs", "[/x]"):
        assert text in out


def test_a_terminal_that_knows_only_ascii_gets_ascii(monkeypatch: pytest.MonkeyPatch) -> None:
    with io.TextIOWrapper(io.BytesIO(), encoding="ascii") as stdout:
        monkeypatch.setattr(sys, "stdout", stdout)
        assert plus_minus() == "+/-"
        print_table("Title", ["a", "b"], [["x", plus_or_minus(1.0, 0.1)]])
        stdout.flush()
        out = stdout.buffer.getvalue().decode("ascii")  # type: ignore[attr-defined]
    assert "1.00 +/- 0.10" in out
