"""Draws the two diagrams of the page on the model: `python docs/_extensions/diagrams.py`.

Their colours follow the page, light or dark. The timeline is computed by the rules of the model.
"""

from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

IMAGES = Path(__file__).resolve().parents[1] / "images"
SYSTEM = IMAGES / "model_system.svg"
TIMELINE = IMAGES / "model_timeline.svg"

_STYLE = """<style>
  text { font: 13px system-ui, sans-serif; fill: #1f2328 }
  .small { font-size: 11.5px; fill: #4b535c }
  .middle { text-anchor: middle }
  .right { text-anchor: end }
  .name { font-weight: 600 }
  .box { fill: #eef4fb; stroke: #1f6fb2; stroke-width: 1.3 }
  .line, .axis { fill: none; stroke: #1f2328; stroke-width: 1.6 }
  .axis { stroke: #8a929b; stroke-width: 1 }
  .dash { stroke-dasharray: 5 4 }
  .wait { fill: #8a929b; opacity: 0.16 }
  .signal { fill: none; stroke: #1f6fb2; stroke-width: 1.5 }
  .lost { fill: none; stroke: #c2410c; stroke-width: 1.8 }
  .arrow { fill: #1f2328 } .tip { fill: #1f6fb2 } .bad { fill: #c2410c }
  @media (prefers-color-scheme: dark) {
    text { fill: #e6e9ed } .small { fill: #b4bcc6 }
    .box { fill: #16273a; stroke: #6cb2f0 } .line { stroke: #e6e9ed }
    .signal { stroke: #6cb2f0 } .lost { stroke: #ff9a62 }
    .arrow { fill: #e6e9ed } .tip { fill: #6cb2f0 } .bad { fill: #ff9a62 }
  }
</style>"""


def _svg(width: int, height: int, title: str, body: list[str]) -> str:
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" '
    head += f'width="{width}" height="{height}" aria-label="{title}">'
    return "\n".join([head, _STYLE, *body, "</svg>", ""])


def _text(x: float, y: float, text: str, style: str = "") -> str:
    return f'<text x="{x:g}" y="{y:g}" class="{style}">{text}</text>'


def _path(points: list[tuple[float, float]], style: str) -> str:
    ways = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{ways}" class="{style}"/>'


def _tip(x: float, y: float, way: str, style: str) -> str:
    """Head of an arrow whose point is at (x, y)."""
    dx, dy = {"right": (-9, 0), "left": (9, 0), "down": (0, -9), "up": (0, 9)}[way]
    across = (0, 4.5) if dx else (4.5, 0)
    corners = [(x, y), (x + dx + across[0], y + dy + across[1]), (x + dx - across[0], y + dy - across[1])]
    return f'<polygon points="{" ".join(f"{a:.1f},{b:.1f}" for a, b in corners)}" class="{style}"/>'


def _box(x: float, y: float, width: float, height: float, lines: list[str]) -> list[str]:
    rows = [f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="8" class="box"/>']
    for k, line in enumerate(lines):
        style = "middle name" if k == 0 else "middle small"
        rows.append(_text(x + width / 2, y + 24 + 18.5 * k, line, style))
    return rows


def system() -> str:
    """Draw the loop of control unit, channel and agents."""
    body = [
        *_box(
            10,
            30,
            190,
            92,
            ["Control unit", "observes the total T", "T ≥ γC: broadcasts one bit", "samples or crossing"],
        ),
        *_box(
            285, 30, 170, 92, ["Channel", "a copy for each agent:", "arrives after a latency,", "or is lost"]
        ),
        *_box(
            540,
            30,
            210,
            92,
            [
                "Agent i = 1 … n",
                "demand x grows at rate α",
                "responds: x becomes βx",
                "with probability Γ f′(x̄) / x̄",
            ],
        ),
        _path([(200, 76), (284, 76)], "signal"),
        _tip(285, 76, "right", "tip"),
        _text(242, 66, "signal", "middle small"),
        _path([(455, 76), (539, 76)], "signal"),
        _tip(540, 76, "right", "tip"),
        _text(497, 66, "copies", "middle small"),
        _path([(645, 122), (645, 180), (105, 180), (105, 131)], "line"),
        _tip(105, 122, "up", "arrow"),
        _text(375, 172, "total demand T = x₁ + … + xₙ of each resource", "middle small"),
        _text(645, 205, "private: cost f, average x̄", "middle small"),
        _text(10, 205, "knows no cost and no single demand", "small"),
    ]
    return _svg(760, 216, "Block diagram of the control loop", body)


class _Piece(NamedTuple):
    """Demand of the two agents from `start`, growing at rate 1 each."""

    start: float
    first: float
    second: float


CAPACITY, BETA, HOLD_OFF, END = 10.0, 0.6, 2.0, 7.4


def _pieces() -> tuple[list[_Piece], list[float]]:
    """Follow two agents: latencies are chosen, times of signals follow."""
    pieces = [_Piece(0.0, 3.0, 4.5)]

    def step(until: float, first: float = 1.0, second: float = 1.0) -> None:
        last = pieces[-1]
        grown = until - last.start
        pieces.append(_Piece(until, (last.first + grown) * first, (last.second + grown) * second))

    def crossing() -> float:
        last = pieces[-1]
        return last.start + (CAPACITY - last.first - last.second) / 2.0

    one = crossing()
    step(one + 0.5, first=BETA)
    step(one + 1.6, second=BETA)  # late: demand has crossed again meanwhile, within the hold-off
    two = crossing()
    step(two + 0.5, second=BETA)  # the copy of agent 1 is lost
    three = two + HOLD_OFF  # demand is above the capacity at the end of the hold-off
    step(three + 0.4, first=BETA)
    step(END)
    return pieces, [one, two, three]


def _curve(pieces: list[_Piece], which: int) -> list[tuple[float, float]]:
    """Points of a sawtooth: 0 is the total, 1 and 2 are the agents."""
    points: list[tuple[float, float]] = []
    for piece, after in pairwise(pieces):
        growth = after.start - piece.start
        values = (piece.first + piece.second, piece.first, piece.second)
        rates = (2.0, 1.0, 1.0)
        points.append((piece.start, values[which]))
        points.append((after.start, values[which] + growth * rates[which]))
    return points


def timeline() -> str:
    """Draw total demand and two agents, with a late and a lost copy."""
    pieces, signals = _pieces()
    left, scale = 92.0, 640.0 / END
    rows = {0: (150.0, 11.0), 1: (245.0, 10.5), 2: (345.0, 10.5)}

    def at(which: int, time: float, value: float) -> tuple[float, float]:
        base, unit = rows[which]
        return left + time * scale, base - unit * (value - (6.0 if which == 0 else 2.0))

    body = []
    for time in signals:
        x, _ = at(0, time, 0.0)
        width = min(HOLD_OFF, END - time) * scale
        body.append(f'<rect x="{x:.1f}" y="60" width="{width:.1f}" height="100" class="wait"/>')
    for which, name in enumerate(("total", "agent 1", "agent 2")):
        base = rows[which][0] + 12
        body += [
            _path([(left, base), (left + END * scale, base)], "axis"),
            _text(left - 12, base - 26, name, "right name"),
            _path([at(which, *point) for point in _curve(pieces, which)], "line"),
        ]
    capacity = at(0, 0.0, CAPACITY)[1]
    body += [
        _path([(left, capacity), (left + END * scale, capacity)], "axis dash"),
        _text(left - 12, capacity + 4, "capacity", "right small"),
    ]
    for number, time in enumerate(signals, 1):
        x, y = at(0, time, CAPACITY)
        body += [
            _path([(x, 54), (x, y if number < 3 else 60)], "signal"),
            _text(x, 48, f"signal {number}", "middle"),
        ]
    body += _copies(signals, at(0, 0.0, CAPACITY)[1], left, scale)
    body += [
        _text(at(0, 2.25, 0.0)[0], 30, "hold-off: no signal while demand is above", "middle small"),
        _text(at(0, signals[2], 0.0)[0] + 40, 30, "hold-off over, still above", "middle small"),
        _text(left + END * scale, 378, "time", "right small"),
    ]
    return _svg(760, 388, "Timeline of three signals, one copy late and one lost", body)


def _copies(signals: list[float], top: float, left: float, scale: float) -> list[str]:
    """Draw the ways of the copies, from the signal to the agent's axis."""
    one, two, three = signals
    ends = {1: 257.0, 2: 357.0}
    body = []
    for sent, latency, agent, note in (
        (one, 0.5, 1, ""),
        (one, 1.6, 2, "late: responds"),
        (two, 0.5, 2, ""),
        (three, 0.4, 1, ""),
        (three, 0.6, 2, "holds"),
    ):
        x, end = left + (sent + latency) * scale, ends[agent]
        body += [_path([(left + sent * scale, top), (x, end)], "signal dash"), _tip(x, end, "down", "tip")]
        body.append(_text(x + 8, end + 14, note, "small"))
    x, y = left + (two + 0.35) * scale, 219.0
    body += [
        _path([(left + two * scale, top), (x, y)], "lost dash"),
        _path([(x - 6, y - 6), (x + 6, y + 6)], "lost"),
        _path([(x - 6, y + 6), (x + 6, y - 6)], "lost"),
        _text(x + 14, y + 12, "lost: agent 1", "small"),
        _text(x + 14, y + 27, "goes on growing", "small"),
    ]
    return body


def main() -> None:
    """Write both."""
    SYSTEM.write_text(system(), encoding="utf-8")
    TIMELINE.write_text(timeline(), encoding="utf-8")


if __name__ == "__main__":
    main()
