"""What one open page plays: up to two systems, each a run that is taken forward when the page asks."""

import asyncio
import json
import logging
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from typing import Any

import numpy as np

from aimd_des.live.html_page import description, export_page
from aimd_des.live.player import Player
from aimd_des.live.settings import read_state, scenario_of
from aimd_des.scenario import Scenario, validate_scenario
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError, SimulationError

_LOGGER = logging.getLogger("aimd_des")

_SLOTS = ("a", "b")
_WISHES = ("run", "more", "save", "export")
# Points of the band that theory expects, from the first time on.
_BAND, _FIRST = 48, 1.0

Message = str | bytes
Job = dict[str, Any]
Send = Callable[[Message], None]


class Slot:
    """One of the systems of a page, and what is left to be done for it: the latest wish counts."""

    def __init__(self, base: Scenario, pool: Executor, send: Send) -> None:
        self.base, self._pool, self._send = base, pool, send
        self._player: Player | None = None
        self._unpredicted: Scenario | None = None  # for which theory is still to be asked
        self._job: Job | None = None
        self._working: asyncio.Task[None] | None = None

    def ask(self, job: Job) -> None:
        """Have something done as soon as what is being done has ended."""
        # The rest of a run is of no interest where another one has been asked for.
        if job["do"] == "more" and self._job is not None and self._job["do"] == "run":
            return
        self._job = job
        if self._working is None or self._working.done():
            self._working = asyncio.get_running_loop().create_task(self._work())

    def stop(self) -> None:
        """Do nothing more."""
        self._job, self._player, self._unpredicted = None, None, None

    async def _work(self) -> None:
        loop = asyncio.get_running_loop()
        while (steps := self._next()) is not None:
            while (message := await loop.run_in_executor(self._pool, next, steps, None)) is not None:
                self._send(message)
                # What is measured besides takes its time, and no wish waits for it.
                if self._job is not None:
                    break

    def _next(self) -> Iterator[Message] | None:
        """Find what is to be done next: what the page has asked for, then what is measured besides."""
        if self._job is not None:
            job, self._job = self._job, None
            return told_of(self._run(job) if job["do"] == "run" else self._more(job), job)
        player, scenario = self._player, self._unpredicted
        if player is not None and player.has_looks:
            return player.measured()
        if player is not None and scenario is not None:
            self._unpredicted = None
            return _expected(scenario, player.names)
        return None

    def _run(self, job: Job) -> Iterator[Message]:
        scenario = scenario_of(self.base, read_state(job.get("state", {})))
        since, to = _times(job, scenario.until)
        names = {"slot": job["slot"], "id": job["id"]}
        player = Player(scenario, names)
        told = {**description(scenario, self.base), **names}
        player.skip(since)
        chunk = player.chunk(to)
        self._player, self._unpredicted = player, scenario
        yield json.dumps(told)
        yield chunk

    def _more(self, job: Job) -> Iterator[Message]:
        player = self._player
        if player is not None and player.names["id"] == job["id"]:
            _, to = _times(job, player.run.until)
            if to > player.time:
                yield player.chunk(to)


def told_of(steps: Iterator[Message], job: Job) -> Iterator[Message]:
    """Tell the page where something is refused, and go on."""
    names = {"slot": job.get("slot"), "id": job.get("id"), "kind": "refused", "of": job["do"]}
    try:
        yield from steps
    except (InputError, SimulationError) as refusal:
        yield json.dumps({**names, "text": str(refusal)})
    except Exception:
        _LOGGER.exception("the page has asked for something that ends in an error: %s", job["do"])
        yield json.dumps({**names, "text": "this ends in an error, which the terminal shows"})


def _times(job: Job, until: float) -> tuple[float, float]:
    since = validation.number("since", job.get("since", 0.0), low=0.0)
    to = validation.number("to", job.get("to", since + 1.0), low=0.0)
    return min(since, until), min(max(to, since), until)


def _expected(scenario: Scenario, names: dict[str, Any]) -> Iterator[Message]:
    """Ask theory what misallocation to expect, and over which time."""
    told: dict[str, Any] = {**names, "kind": "band"}
    try:
        theory = scenario.convergence()
        times = np.geomspace(_FIRST, scenario.until, _BAND)
        expected = [theory.misallocation(float(time)) for time in times]
        told["time"] = times.tolist()
        for name in ("mean", "low", "high"):
            told[name] = np.array([getattr(one, name) for one in expected]).T.tolist()
    except (InputError, SimulationError) as refusal:
        told["text"] = str(refusal)
    yield json.dumps(told)


def _saved(base: Scenario, job: Job) -> Iterator[Message]:
    """Write what was played as a scenario file."""
    scenario = scenario_of(base, read_state(job.get("state", {})))
    _, to = _times(job, scenario.until)
    played = validate_scenario({**scenario.spoken(), "until": to}, "what was played")
    yield json.dumps(
        {
            "slot": job["slot"],
            "id": job["id"],
            "kind": "file",
            "name": "played.toml",
            "type": "application/toml",
            "text": played.to_toml(),
            "note": "aimd-des run played.toml repeats this run to the last bit.",
        }
    )


def _exported(base: Scenario, job: Job) -> Iterator[Message]:
    """Write what was played as a page."""
    since, to = _times(job, base.until)
    page = export_page(base, read_state(job.get("state", {})), since, to)
    names = {"slot": job["slot"], "id": job["id"], "kind": "file"}
    note = "it holds the run, and opens without a server."
    yield json.dumps({**names, "name": "played.html", "type": "text/html", "text": page, "note": note})


class Session:
    """One open page; messages to it are sent in the thread of the event loop."""

    def __init__(self, base: Scenario, pool: Executor, send: Send) -> None:
        self._base, self._pool, self._send = base, pool, send
        self._slots = {name: Slot(base, pool, send) for name in _SLOTS}
        self._tasks: set[asyncio.Task[None]] = set()

    def take(self, text: str) -> None:
        """Take in what the page asks for, and refuse what is no wish that there is."""
        try:
            job = json.loads(text)
        except (ValueError, RecursionError):
            raise InputError.of("message", text[:80], "JSON") from None
        if not isinstance(job, dict):
            raise InputError.of("message", type(job).__name__, "an object")
        validation.choice("do", job.get("do"), _WISHES)
        validation.choice("slot", job.get("slot"), _SLOTS)
        job.setdefault("id", 0)
        if job["do"] in ("run", "more"):
            self._slots[job["slot"]].ask(job)
        else:
            task = asyncio.get_running_loop().create_task(self._write(job))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _write(self, job: Job) -> None:
        made = _saved if job["do"] == "save" else _exported
        steps = told_of(made(self._base, job), job)
        loop = asyncio.get_running_loop()
        while (message := await loop.run_in_executor(self._pool, next, steps, None)) is not None:
            self._send(message)

    def stop(self, name: str | None = None) -> None:
        """Do nothing more for one system, or for all."""
        for slot in self._slots:
            if name in (None, slot):
                self._slots[slot].stop()
