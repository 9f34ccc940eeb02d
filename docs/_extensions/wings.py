"""The wings of the package as a picture, drawn from its imports: `python docs/_extensions/wings.py`.

A wing is a folder of `aimd_des`.  It stands on the floor above the highest wing that it imports.  Only
those arrows are drawn that do not follow from others.
"""

import ast
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PICTURE = ROOT / "docs" / "images" / "wings.svg"

_WIDTH, _HEIGHT = 104, 34  # of a room
_ACROSS, _UP = 128, 66  # from one to the next
_GAP = 30  # for an arrow that passes between wings
_MARGIN = 14
_SWEEPS = 8


def imported(source: str) -> Iterator[str]:
    """Name the wings, or modules at the root, that a file imports."""
    for node in ast.walk(ast.parse(source)):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        yield from (name.split(".")[1] for name in names if name.startswith("aimd_des."))


def arrows(package: Path) -> dict[str, set[str]]:
    """Find for each wing the wings that it imports."""
    wings = {path.parent.name: path.parent for path in package.glob("*/__init__.py")}
    return {
        wing: {
            name
            for path in sorted(folder.rglob("*.py"))
            for name in imported(path.read_text(encoding="utf-8"))
            if name in wings and name != wing
        }
        for wing, folder in sorted(wings.items())
    }


def floors(below: Mapping[str, set[str]]) -> dict[str, int]:
    """Give each wing its floor; a circle of imports is refused."""
    found: dict[str, int] = {}
    while len(found) < len(below):
        free = [wing for wing in below if wing not in found and below[wing] <= set(found)]
        if not free:
            raise ValueError(f"a circle of imports among {sorted(set(below) - set(found))}")
        found |= {wing: 1 + max((found[other] for other in below[wing]), default=0) for wing in free}
    return found


def needed(below: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Leave out the arrows that follow from others."""

    def all_below(wing: str) -> set[str]:
        return below[wing].union(*(all_below(other) for other in below[wing]))

    return {
        wing: others - set().union(*(all_below(other) for other in others)) for wing, others in below.items()
    }


def chains(below: Mapping[str, set[str]]) -> list[list[str]]:
    """Lead each arrow floor by floor: through a gap, which is named after it, where it passes other wings."""
    floor = floors(below)
    return [
        [wing, *(f"{wing}>{other}@{level}" for level in range(floor[wing] - 1, floor[other], -1)), other]
        for wing, others in needed(below).items()
        for other in sorted(others)
    ]


def middles(below: Mapping[str, set[str]]) -> dict[str, tuple[float, float]]:
    """Put wings and gaps of each floor side by side, near what they are joined to; say where they are."""
    floor = floors(below)
    top = max(floor.values())
    rows: list[list[str]] = [
        [wing for wing in sorted(below) if floor[wing] == level] for level in range(1, top + 1)
    ]
    steps = [step for chain in chains(below) for step in pairwise(chain)]
    for chain in chains(below):
        for k, gap in enumerate(chain[1:-1], 1):
            rows[floor[chain[0]] - 1 - k].append(gap)

    def spread(row: list[str]) -> dict[str, float]:
        widths = [_GAP if "@" in node else _ACROSS for node in row]
        return {node: sum(widths[:k]) + widths[k] / 2 - sum(widths) / 2 for k, node in enumerate(row)}

    x = {node: at for row in rows for node, at in spread(row).items()}
    for sweep in range(_SWEEPS):
        for row in rows if sweep % 2 else reversed(rows):
            joined = {node: [x[a if b == node else b] for a, b in steps if node in (a, b)] for node in row}
            row.sort(key=lambda node: (sum(joined[node]) / len(joined[node]), node))
            x |= spread(row)
    left = min(x.values()) - _ACROSS / 2
    return {
        node: (x[node] - left + _MARGIN, _MARGIN + (top - level) * _UP + _HEIGHT / 2)
        for level, row in enumerate(rows, 1)
        for node in row
    }


def picture(below: Mapping[str, set[str]]) -> str:
    """Draw wings and arrows, in SVG."""
    place, lines = middles(below), chains(below)
    width = max(x for x, _ in place.values()) + _ACROSS / 2 + _MARGIN
    height = max(y for _, y in place.values()) + _HEIGHT / 2 + _MARGIN
    drawn = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}"',
        ' font-family="sans-serif" font-size="14" text-anchor="middle">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7"',
        ' orient="auto"><path d="M0 0.5 8 4 0 7.5z" fill="#555"/></marker></defs>',
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="white"/>',
    ]
    for chain in lines:
        # Arrows share the edge of a wing in the order of what is at their other ends.
        leave = sorted(place[line[1]] for line in lines if line[0] == chain[0])
        enter = sorted(place[line[-2]] for line in lines if line[-1] == chain[-1])
        x, y = place[chain[0]]
        x += _WIDTH * ((leave.index(place[chain[1]]) + 1) / (len(leave) + 1) - 0.5)
        path, y = [f"M{x:.1f} {y + _HEIGHT / 2:.1f}"], y + _HEIGHT / 2
        for node in chain[1:]:
            to, down = place[node][0], place[node][1] - _HEIGHT / 2
            if node == chain[-1]:
                to += _WIDTH * ((enter.index(place[chain[-2]]) + 1) / (len(enter) + 1) - 0.5)
            path.append(f"C{x:.1f} {y + 18:.1f} {to:.1f} {down - 18:.1f} {to:.1f} {down:.1f}")
            x, y = to, down
            if node != chain[-1]:
                y += _HEIGHT
                path.append(f"V{y:.1f}")
        drawn.append(f'<path d="{"".join(path)}" fill="none" stroke="#555" marker-end="url(#tip)"/>')
    for wing in sorted(below):
        x, y = place[wing]
        drawn += [
            f'<rect x="{x - _WIDTH / 2:.1f}" y="{y - _HEIGHT / 2:.1f}" width="{_WIDTH}" height="{_HEIGHT}"',
            ' rx="5" fill="#dbe9f6" stroke="#0072B2"/>',
            f'<text x="{x:.1f}" y="{y + 5:.1f}">{wing}</text>',
        ]
    return "\n".join([*drawn, "</svg>"]) + "\n"


if __name__ == "__main__":
    PICTURE.write_text(picture(arrows(ROOT / "aimd_des")), encoding="utf-8")
