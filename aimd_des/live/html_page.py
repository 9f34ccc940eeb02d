"""The page itself: one HTML file with its style and its script in it, which asks for nothing besides."""

import base64
import json
import zlib
from collections.abc import Mapping
from functools import lru_cache
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any

from aimd_des.live.player import Player
from aimd_des.live.settings import GROUPS, ChoiceControl, PageState, scenario_of, shown_of
from aimd_des.scenario import Scenario
from aimd_des.utils.colours import COLOURS
from aimd_des.utils.errors import InputError
from aimd_des.utils.whole_files import write_file

# In the order in which they need each other.
_SCRIPTS = ("data.js", "scales.js", "ring.js", "score.js", "charts.js", "view.js", "controls.js", "main.js")
# Largest file that is written: it is sent, and shown in the documentation.
_LARGEST = 2_000_000


@lru_cache
def _part(name: str) -> str:
    return (files("aimd_des.live") / "page" / name).read_text(encoding="utf-8")


def _named(text: str) -> str:
    """Name a script or a style in the way in which a content security policy does."""
    return f"'sha256-{base64.b64encode(sha256(text.encode('utf-8')).digest()).decode('ascii')}'"


def policy(connect: str = "'none'") -> str:
    """Say what the page may do, as a content security policy: run its own script, and ask only its server."""
    style, script = _named(_part("live.css")), _named(_script())
    return (
        f"default-src 'none'; script-src {script}; style-src {style}; img-src data: blob:; "
        f"connect-src {connect}; base-uri 'none'; form-action 'none'"
    )


@lru_cache
def _script() -> str:
    return '"use strict";\n' + "\n".join(_part(name) for name in _SCRIPTS)


def render(boot: Mapping[str, Any], *, connect: str = "'none'") -> str:
    """Put the page together; `boot` is what its script begins with."""
    data = json.dumps(boot, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    data = data.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
    page = _part("live.html").replace("%POLICY%", policy(connect)).replace("%STYLE%", _part("live.css"))
    return page.replace("%BOOT%", data).replace("%SCRIPT%", _script())


def description(scenario: Scenario, base: Scenario) -> dict[str, Any]:
    """Say what is played, for JSON: names, numbers, and where the controls stand."""
    problem = scenario.problem()
    resources = [
        {"name": resource.name, "unit": resource.unit, "colour": COLOURS[j % len(COLOURS)]}
        for j, resource in enumerate(problem.resources)
    ]
    return {
        "kind": "start",
        "title": scenario.title or "A system of agents",
        "resources": resources,
        "agents": list(problem.agent_names),
        "until": scenario.until,
        "dynamics": scenario.dynamics,
        "shown": shown_of(scenario if scenario.dynamics != "synchronous" else base),
        "capacity": problem.capacity.tolist(),
    }


def controls() -> list[dict[str, Any]]:
    """Describe the controls in their groups, for JSON."""
    return [
        {
            "title": group.title,
            "controls": [
                {"kind": "choice" if isinstance(control, ChoiceControl) else "slider", **control._asdict()}
                for control in group.controls
            ],
        }
        for group in GROUPS
    ]


def recorded(base: Scenario, state: PageState, since: float, to: float) -> dict[str, Any]:
    """Record a run, or a part of it, for a page without a server."""
    scenario = scenario_of(base, state)
    player = Player(scenario)
    player.skip(since)
    messages = [player.chunk(to)]
    messages[:0] = player.measured()
    packs = [base64.b64encode(zlib.compress(message, 9)).decode("ascii") for message in messages]
    return {
        "mode": "recorded",
        "controls": controls(),
        "start": description(scenario, base),
        "since": since,
        "to": player.time,
        "messages": packs,
    }


def export_page(base: Scenario, state: PageState, since: float, to: float) -> str:
    """Make a page with one recorded run in it, which works without a server and without a network."""
    page = render(recorded(base, state, since, to))
    size = len(page.encode("utf-8"))
    if size > _LARGEST:
        raise InputError.of(
            "size of the page",
            size,
            f"at most {_LARGEST:,} bytes",
            "record a shorter stretch, or fewer agents",
        )
    return page


def write_page(page: str, path: Path) -> None:
    """Write a page, whole or not at all."""
    write_file(path, page.encode("utf-8"))
