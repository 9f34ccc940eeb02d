"""Draw the two pictures of the idea: what the system consists of, and a late beside a lost signal.

`python docs/_extensions/ideas.py` writes them into `docs/images`.
"""

import re
from io import StringIO
from pathlib import Path

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

_IMAGES = Path(__file__).resolve().parent.parent / "images"
_BLUE, _RED, _INK = "#0072B2", "#D55E00", "#222222"


def _box(axes: Axes, place: tuple[float, float], size: tuple[float, float], text: str, edge: str) -> None:
    """Draw a box with its middle at a place."""
    x, y = place[0] - size[0] / 2, place[1] - size[1] / 2
    look = {"boxstyle": "round,pad=0.02,rounding_size=0.12", "facecolor": "white", "edgecolor": edge}
    axes.add_patch(FancyBboxPatch((x, y), *size, linewidth=1.6, **look))
    axes.text(*place, text, ha="center", va="center", fontsize=10, color=_INK)


def _arrow(
    axes: Axes, start: tuple[float, float], end: tuple[float, float], ink: str, line: str = "-"
) -> None:
    look = {
        "arrowstyle": "-|>",
        "color": ink,
        "linewidth": 1.6,
        "linestyle": line,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    axes.annotate("", end, start, arrowprops=look)


def block_diagram() -> Figure:
    """Draw agents, total demand, the control unit and the channel, and what goes from one to the next."""
    figure = Figure(figsize=(9.0, 4.1), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlim=(0.0, 9.0), ylim=(0.0, 4.1))
    axes.set_axis_off()
    heights = (3.45, 2.35, 0.65)
    for y, name in zip(heights, ("agent 1", "agent 2", "agent n"), strict=True):
        _box(axes, (5.6, y), (1.75, 0.8), f"{name}\ngrows; may cut", _BLUE)
        _arrow(axes, (3.55, 2.05), (4.68, y), _RED, "--")
        _arrow(axes, (6.52, y), (7.42, 2.05 + 0.12 * (y - 2.05)), _BLUE)
    axes.text(5.6, 1.5, "⋮", ha="center", va="center", fontsize=16)
    _box(axes, (8.1, 2.05), (1.3, 1.0), "total demand\nagainst\nthe capacity", _BLUE)
    _box(axes, (2.75, 2.05), (1.55, 1.0), "channel\nlate copies,\nlost copies", _RED)
    _box(axes, (0.85, 2.05), (1.4, 1.0), "control unit\nlooks, waits,\nsignals", _INK)
    _arrow(axes, (1.58, 2.05), (1.95, 2.05), _INK)
    axes.text(1.77, 2.2, "1 bit", ha="center", fontsize=9)
    axes.plot([8.1, 8.1, 0.85], [1.52, 0.08, 0.08], color=_BLUE, linewidth=1.6)
    _arrow(axes, (0.85, 0.08), (0.85, 1.52), _BLUE)
    axes.text(3.3, 0.17, "above the capacity, or not", ha="center", fontsize=9)
    axes.text(3.75, 3.35, "a copy for\neach agent", ha="center", fontsize=9, color=_RED)
    axes.text(6.98, 3.35, "demand", ha="center", fontsize=9, color=_BLUE)
    axes.text(5.6, 4.0, "private costs stay here", ha="center", fontsize=9)
    return figure


def late_and_lost() -> Figure:
    """Draw two agents and their total around a signal that is late for one and lost on the other."""
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    total, first, second = figure.subplots(3, 1, sharex=True, height_ratios=[1.5, 1.0, 1.0])
    sent, late, slope, keep = 3.0, 1.2, 0.1, 0.5
    arrived = sent + late
    before, lost = 0.35, 0.35
    times = [0.0, arrived, arrived, 7.0]
    peak = before + slope * arrived
    late_demand = [before, peak, keep * peak, keep * peak + slope * (7.0 - arrived)]
    held = [lost + slope * time for time in times]
    sums = [one + other for one, other in zip(late_demand, held, strict=True)]
    capacity = before + lost + 2.0 * slope * sent
    total.plot(times, sums, color=_INK, linewidth=2.0)
    total.axhline(capacity, color="0.4", linestyle="--", linewidth=1.2)
    total.text(6.95, capacity + 0.02, "capacity", ha="right", va="bottom", fontsize=9)
    over = [capacity, capacity + 2.0 * slope * late]
    total.fill_between([sent, arrived], over, capacity, color=_RED, alpha=0.3, linewidth=0)
    total.annotate(
        "what lateness costs",
        (sent + 0.9 * late, over[1]),
        (0.9, over[1]),
        fontsize=9,
        va="center",
        arrowprops={"arrowstyle": "-", "color": "0.5"},
    )
    first.plot(times, late_demand, color=_BLUE, linewidth=2.0)
    first.annotate(
        "", (arrived, 0.12), (sent, 0.12), arrowprops={"arrowstyle": "-|>", "color": _BLUE, "linewidth": 1.6}
    )
    first.text(0.5 * (sent + arrived), 0.17, "latency", ha="center", fontsize=9, color=_BLUE)
    first.text(arrived + 0.12, 0.62, "the copy arrives: demand is cut", fontsize=9)
    second.plot(times, held, color=_BLUE, linewidth=2.0)
    second.plot([sent], [0.12], "x", color=_RED, markersize=10, markeredgewidth=2.2)
    second.text(sent + 0.15, 0.12, "the copy is lost: demand grows on", fontsize=9, va="center")
    for axes, name in ((total, "total demand"), (first, "agent 1"), (second, "agent 2")):
        axes.axvline(sent, color="0.55", linewidth=1.0, linestyle=":")
        axes.set(ylabel=name, ylim=(0.0, None), xlim=(0.0, 7.0), yticks=[], xticks=[])
        axes.spines[["top", "right"]].set_visible(False)
    total.text(sent, 1.02, "signal", transform=total.get_xaxis_transform(), ha="center", fontsize=9)
    second.set_xlabel("time")
    return figure


def main() -> None:
    """Write the pictures."""
    # Without a date and with fixed names of parts the same picture is the same file.
    with rc_context({"svg.hashsalt": "ideas", "svg.fonttype": "path"}):
        for name, draw in {"block_diagram": block_diagram, "late_and_lost": late_and_lost}.items():
            text = StringIO()
            draw().savefig(text, format="svg", metadata={"Date": None})
            # What it says of itself are addresses of vocabularies alone.
            plain = re.sub(r"\s*<metadata>.*?</metadata>", "", text.getvalue(), flags=re.DOTALL)
            (_IMAGES / f"{name}.svg").write_text(plain, encoding="utf-8")


if __name__ == "__main__":
    main()
