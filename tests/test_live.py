"""The live page without a browser: what a page is told is what a run does, and who is let in."""

import asyncio
import json
import struct
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from http.client import HTTPConnection
from itertools import pairwise
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest

from aimd_des import InputError
from aimd_des.live import export_page, html_page, settings
from aimd_des.live.player import Player
from aimd_des.live.server import application
from aimd_des.live.settings import read_state, scenario_of, shown_of
from aimd_des.scenario import Scenario, validate_scenario
from tests.command_line import invoke
from tests.conftest import quietly

TOKEN = "secret"


def base(**changes: Any) -> Scenario:
    """A dozen cameras behind a channel that is late and loses some."""
    data = {**settings.DEFAULT, "parameters": {"n_cameras": 12}, "until": 200.0, **changes}
    return validate_scenario(data, "base")


def unpacked(message: bytes) -> dict[str, Any]:
    """As the page reads a message."""
    (size,) = struct.unpack_from("<I", message)
    head = json.loads(message[4 : 4 + size])
    at, found = 4 + size, dict(head)
    for name, (kind, shape) in head["arrays"].items():
        count = int(np.prod(shape))
        found[name] = np.frombuffer(message, f"<{kind}4", count, at).reshape(shape)
        at += 4 * count
    assert at == len(message)
    return found


def played(scenario: Scenario, *ends: float, since: float = 0.0) -> list[dict[str, Any]]:
    player = Player(scenario)
    player.skip(since)
    return [unpacked(player.chunk(end)) for end in ends]


# -- what is told is what happens ------------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"agents": "process"},
        {"dynamics": "discrete", "control_unit": {"kind": "sampled"}},
        {"dynamics": "discrete", "control_unit": {"kind": "sampled"}, "clocks": {"phase": "random"}},
        {"interventions": [{"kind": "absence", "agents": [1, 2], "at": 30.5, "until": 41.25}]},
    ],
)
def test_a_page_is_told_what_a_run_does(changes: dict[str, Any]) -> None:
    scenario = base(until=60.0, **changes)
    chunks = played(scenario, 20.0, 33.3, 60.0)
    data = {**scenario.spoken(), "recording": {"events": True, "demand": 0.25}}
    result = quietly(validate_scenario(data, "run").run)
    signals = np.concatenate([chunk["from"] + chunk["signal"] for chunk in chunks])
    assert signals == pytest.approx(result.signals["time"].to_numpy(), abs=1e-5)
    lost = sum(int((chunk["arrival"] < -1e8).sum()) for chunk in chunks)
    events = result.events
    assert lost == (events["kind"] == "lost").sum() or "interventions" in changes
    cuts = np.concatenate([chunk["answer"][chunk["answer"][:, 1] > 0, 1] for chunk in chunks])
    assert cuts == pytest.approx(events.loc[events["kind"] == "respond", "value"].to_numpy(), rel=1e-6)
    last = chunks[-1]
    assert last["over"]
    assert last["to"] == 60.0
    assert last["demand"][-1] == pytest.approx(result.demand_at_end.T, rel=1e-6, abs=1e-9)
    assert last["average"][-1] == pytest.approx(result.average_at_end.T, rel=1e-6)


@pytest.mark.parametrize(
    "changes", [{}, {"interventions": [{"kind": "absence", "agents": [1, 2], "at": 30.5, "until": 41.25}]}]
)
def test_the_line_of_total_demand_is_exact(changes: dict[str, Any]) -> None:
    """Between the corners that a page gets, total demand of continuous agents is straight."""
    scenario = base(until=60.0, **changes)
    looks = np.arange(200) * 0.29
    recording = {"demand": looks.tolist(), "overshoot": False}
    result = quietly(validate_scenario({**scenario.spoken(), "recording": recording}, "run").run)
    chunks = played(scenario, 7.0, 30.5, 31.0, 60.0)
    for j, name in enumerate(result.problem.resource_names):
        corners = np.concatenate(
            [
                chunk["total"][chunk["place"][j] : chunk["place"][j + 1]].astype(float)
                + np.array([chunk["from"], 0.0])
                for chunk in chunks
            ]
        )
        wanted = result.demand[(result.demand["resource"] == name)]
        wanted = wanted[wanted["time"].isin(looks)]
        found = np.interp(wanted["time"], *corners.T)
        # Times are told to 1e-5; demand changes by 1.5 a unit of time at most, and by a cut at a corner.
        near = np.abs(corners[:, 0] - wanted["time"].to_numpy()[:, None]).min(axis=1) < 1e-4
        assert (~near).sum() > 150
        assert found[~near] == pytest.approx(wanted["total"].to_numpy()[~near], abs=1e-4)


def test_how_a_run_is_cut_into_pieces_changes_nothing() -> None:
    whole, pieces = played(base(), 50.0)[0], played(base(), 10.0, 10.5, 37.0, 50.0)
    for name in ("sent", "answered"):
        assert np.array_equal(whole[name], np.concatenate([piece[name] for piece in pieces]))
    assert np.array_equal(whole["demand"][-1], pieces[-1]["demand"][-1])
    late = played(base(), 50.0, since=30.0)[0]
    assert np.array_equal(whole["demand"][-1], late["demand"][-1])
    assert len(late["sent"]) < len(whole["sent"])


def test_misallocation_is_that_of_a_run_that_ends_there() -> None:
    player = Player(base())
    player.skip(100.0)
    told = [unpacked(message) for message in player.measured()]
    assert [message["time"] for message in told][:2] == [1.0, pytest.approx(10 ** (1 / 12))]
    assert told[-1]["time"] == 100.0 or told[-1]["time"] == pytest.approx(10 ** (23 / 12))
    ended = told[-1]["time"]
    result = quietly(validate_scenario({**base().spoken(), "until": ended}, "run").run)
    wanted = result.summary()["misallocation"].to_numpy()
    assert told[-1]["misallocation"] == pytest.approx(wanted, rel=1e-6)
    assert "best" in told[-1]
    assert "best" not in told[0]
    assert list(player.measured()) == []


# -- what a page may change ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("start", "keys"),
    [
        ({"latency": 1.5}, {"channel": {"latency": {"kind": "exponential", "mean": 1.5}}}),
        ({"latency_kind": "constant"}, {"channel": {"latency": 0.6}}),
        ({"loss": 0.3}, {"channel": {"loss": 0.3}}),
        (
            {"loss": 0.3, "burst": 5.0},
            {"channel": {"loss": {"kind": "gilbert_elliott", "mean_loss": 0.3, "mean_burst": 5.0}}},
        ),
        ({"hold_off": 0.25}, {"control_unit": {"kind": "crossing", "hold_off": 0.25}}),
        ({"unit": "sampled", "period": 0.5}, {"control_unit": {"kind": "sampled", "period": 0.5}}),
        ({"dynamics": "discrete"}, {"dynamics": "discrete", "control_unit": {"kind": "sampled"}}),
        ({"dynamics": "discrete", "clocks": "random"}, {"clocks": {"phase": "random"}}),
        ({"response": "fractional"}, {"response": {"kind": "derandomised", "full": True}}),
        ({"averaging": "window"}, {"averaging": {"kind": "window", "length": 40.0}}),
        ({"threshold": 0.9}, {"resources": {"0": {"threshold": 0.9}, "2": {"threshold": 0.9}}}),
        ({"count": 20, "seed": 7}, {"parameters": {"n_cameras": 20}, "seed": 7}),
    ],
)
def test_a_control_is_a_key_of_the_scenario(start: dict[str, Any], keys: dict[str, Any]) -> None:
    scenario = scenario_of(base(), read_state({"start": start}))

    def holds(found: Any, wanted: Any) -> bool:
        if isinstance(wanted, dict):
            return isinstance(found, dict) and all(holds(found.get(key), wanted[key]) for key in wanted)
        return bool(found == wanted)

    assert holds(scenario.spoken(), keys)
    # And the controls stand where they were put.
    shown = shown_of(scenario)
    assert {name: shown[name] for name in start} == start


def test_what_no_position_says_stays_as_in_the_file() -> None:
    odd = {"latency": {"kind": "gamma", "shape": 2.0, "scale": 0.2}, "loss": [0.1] * 12}
    scenario = base(channel=odd, averaging={"kind": "window", "length": 33.0})
    shown = shown_of(scenario)
    assert {shown[name] for name in ("latency", "latency_kind", "loss", "burst", "averaging")} == {None}
    changed = scenario_of(scenario, read_state({"start": {"loss": 0.2}})).spoken()
    assert changed["channel"]["latency"]["kind"] == "gamma"
    assert changed["channel"]["loss"] == 0.2
    later = read_state({"changes": [{"at": 5.0, "set": {"loss": 0.2}}]})
    (change,) = scenario_of(scenario, later).spoken()["interventions"]
    assert change["channel"]["latency"]["kind"] == "gamma"


CHANGES = [
    {"at": 30.0, "set": {"latency": 2.0}},
    {"at": 35.5, "set": {"loss": 0.4}},
    {"at": 40.0, "set": {"hold_off": 0.25}},
    {"at": 41.0, "set": {"threshold": 0.9}},
    {"at": 45.0, "do": "capacity", "of": 1, "to": 0.6},
    {"at": 50.0, "do": "leave", "of": 3},
    {"at": 52.0, "do": "partition", "for": 4.0, "of": [0, 2]},
    {"at": 60.0, "do": "failover", "for": 2.0},
]


def test_what_was_played_repeats_to_the_last_bit() -> None:
    """The pieces that a page has seen, each from its own run, are those of one run of the file."""
    state = {"start": {"loss": 0.2}, "changes": CHANGES}
    scenario = scenario_of(base(until=80.0), read_state(state))
    again = validate_scenario(tomllib.loads(scenario.to_toml()), "file")
    fleet = quietly(again.run)
    assert (
        quietly(validate_scenario({**again.spoken(), "agents": "process"}, "file").run).digest == fleet.digest
    )
    signals: list[float] = []
    times = [0.0, *[change["at"] for change in CHANGES], 80.0]
    for number, (since, to) in enumerate(pairwise(times)):
        so_far = scenario_of(base(until=80.0), read_state({**state, "changes": CHANGES[:number]}))
        (chunk,) = played(so_far, to, since=since)
        signals.extend((chunk["from"] + chunk["signal"].astype(float)).tolist())
    assert signals == pytest.approx(fleet.signals["time"].to_numpy(), abs=1e-5)
    kinds = [row["kind"] for row in again.spoken()["interventions"]]
    assert kinds == [
        "channel", "channel", "hold_off", "threshold", "capacity_step", "absence", "partition", "failover",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ([], "state = 'list': must be an object"),
        ({"start": {"model": "os.system"}}, "'model'"),
        ({"start": {"latency": "long"}}, "state.start.latency"),
        ({"start": {"latency_kind": "my.module"}}, "state.start.latency_kind"),
        ({"start": {"loss": 1.5}}, "loss"),
        ({"start": {"count": 2.5}}, "state.start.count"),
        ({"changes": [{"set": {}}]}, "state.changes[0].at"),
        ({"changes": [{"at": 1.0, "set": {"seed": 3}}]}, "'seed'"),
        ({"changes": [{"at": 1.0, "do": "explode"}]}, "state.changes[0].do"),
        ({"changes": [{"at": 1.0, "do": "leave", "of": 99}]}, "99"),
        ({"changes": [{"at": 1.0, "do": "partition", "for": -1.0}]}, "for = -1.0"),
        ({"changes": [{"at": 1.0, "do": "capacity", "of": 0, "to": 0.0}]}, "to = 0.0"),
        ({"changes": [{}] * 1001}, "at most 1000"),
        ({"start": {"unit": "sampled"}, "changes": [{"at": 1.0, "set": {"hold_off": 1.0}}]}, "crossing"),
    ],
)
def test_a_state_that_cannot_be_is_refused(state: Any, words: str) -> None:
    with pytest.raises(InputError) as caught:
        scenario_of(base(), read_state(state))
    assert words in str(caught.value)


# -- the page in one file --------------------------------------------------------------------------------


def test_a_recorded_page_holds_all_and_is_small() -> None:
    scenario = validate_scenario(settings.DEFAULT, "base")
    page = export_page(scenario, read_state({}), 30.0, 70.0)
    assert len(page.encode()) < 700_000
    assert "Content-Security-Policy" in page
    assert "connect-src 'none'" in page
    assert not [place for place in ("%BOOT%", "%SCRIPT%", "%STYLE%", "%POLICY%") if place in page]


def test_texts_of_a_scenario_cannot_end_the_script() -> None:
    page = export_page(base(title="</script><script>alert(1)</script>"), read_state({}), 0.0, 5.0)
    assert page.count("</script>") == 2
    assert "alert(1)" in page


def test_a_page_that_would_be_too_large_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(html_page, "_LARGEST", 10_000)
    with pytest.raises(InputError, match="record a shorter stretch"):
        export_page(base(), read_state({}), 0.0, 5.0)


def test_the_command_exports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "page.html"
    outcome = invoke("live", "--set", "parameters.n_cameras=6", "--to", "45", "--export", str(page))
    assert outcome.exit_code == 0
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")
    again = invoke("live", "--export", str(page))
    assert again.exit_code == 2
    assert "say --overwrite" in again.output
    back = invoke("live", "--from", "50", "--to", "40", "--overwrite", "--export", str(page))
    assert back.exit_code == 2
    assert "to = 40.0" in back.output


def test_the_command_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aimd_des.live.server.find_spec", lambda name: None)
    outcome = invoke("live")
    assert outcome.exit_code == 2
    assert "pip install 'aimd-des[live]'" in outcome.output


# -- who is let in ---------------------------------------------------------------------------------------


@contextmanager
def serving(scenario: Scenario) -> Iterator[int]:
    """Serve in a thread; the port is given."""
    from tornado.httpserver import HTTPServer
    from tornado.netutil import bind_sockets

    sockets = bind_sockets(0, "127.0.0.1")
    port = sockets[0].getsockname()[1]
    loop, servers = asyncio.new_event_loop(), list[HTTPServer]()

    def work() -> None:
        asyncio.set_event_loop(loop)
        with ThreadPoolExecutor(2) as pool:

            async def begin() -> None:
                servers.append(HTTPServer(application(scenario, TOKEN, port, pool)))
                servers[0].add_sockets(sockets)

            loop.run_until_complete(begin())
            loop.run_forever()

    thread = Thread(target=work, daemon=True)
    thread.start()
    try:
        yield port
    finally:
        for server in servers:
            loop.call_soon_threadsafe(server.stop)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(10.0)
        loop.close()


def answer(port: int, path: str, **headers: str) -> tuple[int, dict[str, str], str]:
    connection = HTTPConnection("127.0.0.1", port, timeout=20.0)
    connection.request("GET", path, headers=headers)
    response = connection.getresponse()
    found = response.status, dict(response.getheaders()), response.read().decode()
    connection.close()
    return found


SOCKET = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    "Sec-WebSocket-Version": "13",
}


def test_nobody_is_let_in_without_the_token_or_by_another_name() -> None:
    with serving(base()) as port:
        status, headers, page = answer(port, f"/?token={TOKEN}")
        assert status == 200
        assert "unsafe" not in headers["Content-Security-Policy"]
        assert headers["Referrer-Policy"] == "no-referrer"
        assert "a dozen" not in page
        for path in ("/", "/?token=wrong", "/socket", "/else", f"/else?token={TOKEN}x"):
            assert answer(port, path)[0] == 403, path
        assert answer(port, f"/?token={TOKEN}", Host="evil.example")[0] == 403
        assert answer(port, f"/?token={TOKEN}", Host=f"evil.example:{port}")[0] == 403
        assert answer(port, f"/?token={TOKEN}", Host=f"localhost:{port}")[0] == 200
        for origin in ("http://evil.example", "null", f"http://127.0.0.1:{port + 1}"):
            assert answer(port, f"/socket?token={TOKEN}", Origin=origin, **SOCKET)[0] == 403, origin
        assert answer(port, "/socket?token=wrong", Origin=f"http://127.0.0.1:{port}", **SOCKET)[0] == 403


def test_a_socket_plays_refuses_and_goes_on() -> None:
    from tornado.httpclient import HTTPRequest
    from tornado.websocket import websocket_connect

    async def talk(port: int) -> list[Any]:
        request = HTTPRequest(
            f"ws://127.0.0.1:{port}/socket?token={TOKEN}", headers={"Origin": f"http://127.0.0.1:{port}"}
        )
        socket = await websocket_connect(request, max_message_size=1 << 26)
        told: list[Any] = []

        async def until(kind: str) -> None:
            while True:
                message = await asyncio.wait_for(socket.read_message(), 60.0)
                assert message is not None
                read = unpacked(message) if isinstance(message, bytes) else json.loads(message)
                told.append(read)
                if read["kind"] == kind:
                    return

        def ask(**wish: Any) -> None:
            socket.write_message(json.dumps({"slot": "a", "id": 1, **wish}))

        socket.write_message("no JSON")
        await until("refused")
        ask(do="dance")
        await until("refused")
        ask(do="run", state={"start": {"loss": 7.0}})
        await until("refused")
        ask(do="run", state={}, since=20.0, to=30.0)
        await until("chunk")
        ask(do="more", to=31.0)
        await until("chunk")
        await until("band")
        ask(do="save", state={"start": {"seed": 5}}, to=31.0)
        await until("file")
        socket.close()
        return told

    with serving(base()) as port:
        told = asyncio.run(talk(port))
    kinds = [message["kind"] for message in told if message["kind"] != "measure"]
    assert kinds == ["refused", "refused", "refused", "start", "chunk", "chunk", "band", "file"]
    refusals = [message["text"] for message in told if message["kind"] == "refused"]
    assert "JSON" in refusals[0]
    assert "do = 'dance'" in refusals[1]
    assert "loss" in refusals[2]
    chunks = [message for message in told if message["kind"] == "chunk"]
    assert [(chunk["from"], chunk["to"]) for chunk in chunks] == [(20.0, 30.0), (30.0, 31.0)]
    saved = tomllib.loads(told[-1]["text"])
    assert (saved["seed"], saved["until"]) == (5, 31.0)
    assert "constant" in next(message for message in told if message["kind"] == "band")["text"]


def test_the_page_of_the_documentation_is_the_page_as_it_is_now() -> None:
    page = Path(__file__).parents[1] / "docs" / "_static" / "live.html"
    text = page.read_text(encoding="utf-8")
    assert page.stat().st_size < 2_000_000
    boot = text.partition('type="application/json">')[2].partition("</script>")[0]
    remedy = "write it anew: python docs/_extensions/live_pictures.py"
    assert html_page.render(json.loads(boot)) == text, remedy
