"""The page of `aimd-des live` in the documentation: `python docs/_extensions/live_pictures.py`.

It writes a page with one recorded run, and a picture that moves, both from runs of the engine.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from aimd_des import BroadcastChannel, Crossing, Fleet, Recording, Simulation, latency
from aimd_des.engine.delivery import Signal
from aimd_des.live import default_scenario, export_page, write_page
from aimd_des.live.settings import read_state
from models import smart_cameras

DOCS = Path(__file__).resolve().parents[1]
PAGE = DOCS / "_static" / "live.html"
PICTURE = DOCS / "images" / "live.svg"

#: What the recorded page shows: a channel that becomes worse, and a capacity that drops.
PLAYED = {
    "changes": [
        {"at": 52.0, "set": {"latency": 1.6, "loss": 0.3}},
        {"at": 66.0, "set": {"latency": 0.3, "loss": 0.05}},
        {"at": 72.0, "do": "capacity", "of": 0, "to": 0.75},
    ]
}
FROM, TO = 30.0, 84.0

# The picture: a few cameras over a stretch of time, which lasts so many seconds.
_AGENTS, _SINCE, _UNTIL, _LASTS = 24, 80.0, 90.0, 13
_WIDTH, _HEIGHT = 860, 330
_X, _Y, _RING, _UNIT = 170.0, 165.0, 108.0, 25.0  # of the ring
_LEFT, _RIGHT, _TOP, _BOTTOM = 360.0, 836.0, 58.0, 258.0  # of the chart
_STYLE = """
text { font: 13px system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; fill: #1b2027; }
.quiet { fill: #58626d; } .ground { fill: #ffffff; } .rule { stroke: #d5dbe1; fill: none; }
.ink { stroke: #1b2027; fill: none; stroke-width: 1.3; } .demand { fill: #0072b2; }
.cut { fill: #1769d2; } .hold { fill: #8b95a1; } .lost { fill: #cf222e; }
.mark { stroke: #cf222e; stroke-width: 1.8; }
.line { stroke: #0072b2; fill: none; stroke-width: 2; } .pale { stroke: #0072b2; fill: none; opacity: 0.22; }
@media (prefers-color-scheme: dark) {
  text { fill: #e7edf3; } .quiet { fill: #a2adb8; } .ground { fill: #171c22; } .rule { stroke: #333c46; }
  .ink { stroke: #e7edf3; } .demand { fill: #6bacd3; } .line, .pale { stroke: #6bacd3; }
  .cut { fill: #66b0ff; } .hold { fill: #7c8894; } .lost { fill: #ff6b70; } .mark { stroke: #ff6b70; }
}
"""


def _share(time: float) -> float:
    return min(1.0, max(0.0, (time - _SINCE) / (_UNTIL - _SINCE)))


def _animated(attribute: str, times: Any, values: Any, mode: str = "linear") -> str:
    """Let an attribute follow values over the stretch, again and again."""
    keys = [f"{_share(time):.4f}" for time in times]
    shown = ";".join(value if isinstance(value, str) else f"{value:.1f}" for value in values)
    return (
        f'<animate attributeName="{attribute}" dur="{_LASTS}s" repeatCount="indefinite" calcMode="{mode}"'
        f' keyTimes="{";".join(keys)}" values="{shown}"/>'
    )


def _seen(begin: float, end: float) -> str:
    """Show an element from one time to another."""
    times, values = [_SINCE, begin, end], ["0", "1", "0"]
    if begin <= _SINCE:
        times, values = [_SINCE, end], ["1", "0"]
    return _animated("opacity", times, values, "discrete")


class _Record:
    """What has happened to the first resource of a run."""

    def __init__(self) -> None:
        self.copies: list[tuple[float, int, Any]] = []
        channel = BroadcastChannel(latency.ShiftedGamma(2.0, 0.4), 0.15)
        problem = smart_cameras(seed=2, n_cameras=_AGENTS)
        simulation = Simulation(
            problem,
            dynamics="continuous",
            control_unit=Crossing(0.5),
            channel=channel,
            agents=Fleet,
            seed=4,
            recording=Recording(events=True),
        )
        run = simulation.start(_UNTIL + 20.0)
        run.system.transmitter.on_leave.append(self._left)
        self._env = run.system.env
        self.looks, self.demand = np.linspace(_SINCE, _UNTIL, 451), []
        for look in self.looks:
            run.advance(to=look)
            self.demand.append(run.system.allocations()[0][0].copy())
        self.capacity = float(problem.capacity[0])
        run.advance()
        events = run.system.events()
        responses = events[(events["kind"] == "respond") & (events["resource"] == "memory")]
        self.cuts = {
            (int(row["number"]), int(row["agent"])): float(row["time"])
            for row in responses.to_dict("records")
        }

    def _left(self, signal: Signal, arrival: Any) -> None:
        if signal.resource == 0:
            self.copies.append((float(self._env.now), signal.number, arrival.copy()))


def _place(agent: int, distance: float) -> tuple[float, float]:
    angle = 2 * math.pi * agent / _AGENTS - math.pi / 2
    return _X + distance * math.cos(angle), _Y + distance * math.sin(angle)


def _copy(agent: int, number: int, sent: float, arrival: float, mean: float, cuts: bool) -> str:
    """Draw a copy on its way, and a cross where it is lost."""
    lost = not math.isfinite(arrival)
    reach = 0.35 + 0.4 * ((agent * 7 + number * 3) % 10) / 10 if lost else 1.0
    end = sent + reach * mean if lost else arrival
    start = _place(agent, _UNIT)
    goal = _place(agent, _UNIT + reach * (_RING - _UNIT - 10))
    begin, over = max(sent, _SINCE), min(end, _UNTIL)
    if over <= begin:
        return ""
    part = [(time - sent) / (end - sent) for time in (begin, over)]
    (x0, x1), (y0, y1) = ([a + share * (b - a) for share in part] for a, b in zip(start, goal, strict=True))
    kind = "lost" if lost else "cut" if cuts else "hold"
    times = [_SINCE, begin, over, _UNTIL]
    drawn = (
        f'<circle class="{kind}" r="{3.6 if cuts else 3}" opacity="0">{_seen(begin, over)}'
        f"{_animated('cx', times, [x0, x0, x1, x1])}{_animated('cy', times, [y0, y0, y1, y1])}</circle>"
    )
    if lost and end < _UNTIL - 0.2:
        x, y = goal
        drawn += (
            f'<path class="mark" opacity="0" d="M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8">'
            f"{_seen(end, min(end + 0.9, _UNTIL - 0.01))}</path>"
        )
    return drawn


def _disc(agent: int, record: _Record, most: float) -> str:
    """Draw an agent, as large as its demand."""
    demand = np.array([row[agent] for row in record.demand])
    sizes = np.maximum(1.5, 12.5 * np.sqrt(demand / most))
    # Corners only: between them demand is straight.
    bends = np.flatnonzero(np.abs(np.diff(sizes, 2)) > 0.02) + 1
    kept = np.unique(np.concatenate([[0, len(sizes) - 1], bends, bends + 1]))
    kept = kept[kept < len(sizes)]
    x, y = _place(agent, _RING)
    moved = _animated("r", record.looks[kept], sizes[kept])
    return f'<circle class="demand" cx="{x:.1f}" cy="{y:.1f}">{moved}</circle>'


def picture() -> str:
    """Draw the ring, the copies on their way, and total demand, in an SVG that moves."""
    record = _Record()
    totals = np.array([row.sum() for row in record.demand])
    low = min(totals.min(), record.capacity) - 0.02 * record.capacity
    high = max(totals.max(), record.capacity) + 0.02 * record.capacity

    def x(time: float) -> float:
        return _LEFT + _share(time) * (_RIGHT - _LEFT)

    def y(total: float) -> float:
        return _BOTTOM - (total - low) / (high - low) * (_BOTTOM - _TOP)

    line = " ".join(f"{x(look):.1f},{y(total):.1f}" for look, total in zip(record.looks, totals, strict=True))
    sent = [time for time, _, _ in record.copies if _SINCE <= time < _UNTIL]
    ticks = "".join(f"M{x(time):.1f} {_BOTTOM + 2:.0f}v9" for time in sent)
    copies = [drawn for signal in record.copies for drawn in _copies(signal, record.cuts)]
    most = max(float(row.max()) for row in record.demand)
    level = [_Y + _UNIT - min(1.0, total / high) * 2 * _UNIT for total in totals[::15]]
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}">',
            "<title>Copies of signals on their way to the agents, and total demand</title>",
            f"<style>{_STYLE}</style>",
            f'<rect class="ground" width="{_WIDTH}" height="{_HEIGHT}" rx="12"/>',
            f'<circle class="rule" cx="{_X}" cy="{_Y}" r="{_RING}"/>',
            *copies,
            *(_disc(agent, record, most) for agent in range(_AGENTS)),
            f'<clipPath id="unit"><circle cx="{_X}" cy="{_Y}" r="{_UNIT}"/></clipPath>',
            f'<circle class="ground" cx="{_X}" cy="{_Y}" r="{_UNIT}"/>',
            _filled(record, level),
            f'<circle class="line" cx="{_X}" cy="{_Y}" r="{_UNIT}"/>',
            f'<text x="{_LEFT}" y="34">Total demand for memory</text>',
            f'<text class="quiet" x="{_RIGHT - 52}" y="{y(record.capacity) - 6:.1f}">capacity</text>',
            f'<path class="ink" d="M{_LEFT} {y(record.capacity):.1f}H{_RIGHT}"/>',
            f'<path class="rule" d="M{_LEFT} {_BOTTOM + 2}H{_RIGHT}"/>',
            f'<path class="line" d="{ticks}"/>',
            f'<polyline class="pale" points="{line}"/>',
            _past(),
            f'<polyline class="line" clip-path="url(#past)" points="{line}"/>',
            f'<text class="quiet" x="{_LEFT}" y="{_BOTTOM + 26}">each mark a signal of one bit to all</text>',
            *_legend(),
            "</svg>",
            "",
        ]
    )


def _copies(signal: tuple[float, int, Any], cuts: dict[tuple[int, int], float]) -> list[str]:
    """Draw all copies of a signal, as far as they are on their way in the stretch."""
    sent, number, arrival = signal
    if sent >= _UNTIL:
        return []
    mean = float(np.mean(arrival[np.isfinite(arrival)])) - sent
    drawn = (
        _copy(agent, number, sent, when, mean, (number, agent) in cuts)
        for agent, when in enumerate(arrival.tolist())
    )
    return [each for each in drawn if each]


def _filled(record: _Record, level: list[float]) -> str:
    """Fill the control unit as far as the capacity is."""
    place = f'x="{_X - _UNIT}" width="{2 * _UNIT}" height="{2 * _UNIT}"'
    moved = _animated("y", record.looks[::15], level)
    return f'<rect class="demand" opacity="0.35" clip-path="url(#unit)" {place}>{moved}</rect>'


def _past() -> str:
    """Let the line of total demand come forth from left to right."""
    moved = _animated("width", [_SINCE, _UNTIL], [0.0, _RIGHT - _LEFT])
    return f'<clipPath id="past"><rect x="{_LEFT}" y="0" height="{_HEIGHT}">{moved}</rect></clipPath>'


def _legend() -> list[str]:
    items = (
        ("cut", "copy that is answered"),
        ("hold", "copy that changes nothing"),
        ("lost", "copy lost"),
    )
    places = (_LEFT, _LEFT + 172, _LEFT + 372)
    return [
        f'<circle class="{kind}" cx="{at + 5}" cy="{_HEIGHT - 20}" r="4"/>'
        f'<text class="quiet" x="{at + 15}" y="{_HEIGHT - 16}">{words}</text>'
        for at, (kind, words) in zip(places, items, strict=True)
    ]


def page() -> str:
    """Record a run for the page."""
    return export_page(default_scenario(), read_state(PLAYED), FROM, TO)


if __name__ == "__main__":
    write_page(page(), PAGE)
    PICTURE.write_text(picture(), encoding="utf-8")
