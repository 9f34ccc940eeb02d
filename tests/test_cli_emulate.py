"""`aimd-des emulate`: a run over sockets, held against its replay; what stops it leaves nothing running."""

import json
import os
import secrets
import shutil
import signal
import socket
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aimd_des import InputError, latency, loss
from aimd_des.emulate import load_emulation, replay
from aimd_des.scenario import load_run
from tests.command_line import TABLES, invoke, refusal, write
from tests.forks import PROGRAM, Fork, forks, until

SCENARIO = """
model = "models.smart_cameras"
dynamics = "continuous"
until = 30.0
seed = 2

[control_unit]
kind = "crossing"
hold_off = 1.0

[channel]
latency = {kind = "exponential", mean = 0.5}
loss = 0.1

[recording]
allocations = 1.0
events = true
"""

# Two processes of each run in parallel here, beside other tests: a unit that leaves room for lateness.
_UNIT = 0.1


def started(*arguments: str, code: str = PROGRAM, cwd: Path | None = None, **environment: str) -> Fork:
    """Start the command as a process of its own, in a group of its own."""
    return forks().start(code, "emulate", *arguments, cwd=cwd, **environment)


def is_gone(group: int, patience: float = 60.0) -> bool:
    """Tell whether no process of a group is left."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


@pytest.fixture(scope="module")
def emulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one emulation, in two processes."""
    folder = tmp_path_factory.mktemp("emulated")
    (folder / "mine.toml").write_text(SCENARIO, encoding="utf-8")
    arguments = ("--unit", str(_UNIT), "--processes", "2", "--out", "real", "--no-figures")
    done = started("mine.toml", *arguments, cwd=folder).wait()
    assert done.returncode == 0, done.stderr
    assert "datagrams received" in done.stdout
    return folder / "real"


@pytest.mark.slow
def test_the_folder_is_that_of_a_run_with_what_was_measured_beside_it(emulated: Path) -> None:
    measured = {"network_delays", "network_losses", "network_counts", "unit_lateness", "agent_lateness"}
    more = {"emulation.json", "records.parquet", "events.parquet", *(f"{name}.csv" for name in measured)}
    assert {path.name for path in emulated.iterdir()} == TABLES | more
    run = load_run(emulated)
    assert set(run.checksums or ()) == (TABLES | more) - {"SHA256SUMS"}
    assert len(run.frame("allocations")) == 31 * 60 * 3
    kinds = run.frame("events")["kind"].value_counts()
    for name, kind in (("signals", "signal"), ("delivered", "deliver"), ("responses", "respond")):
        assert sum(of[name] for of in run.measures.values()) == kinds[kind]
    compared = invoke("compare", str(emulated), str(emulated))
    assert compared.exit_code == 0
    assert "The digests are equal" in compared.stdout


@pytest.mark.slow
def test_what_was_measured_is_read_by_latencies_and_losses(emulated: Path) -> None:
    delays = latency.Empirical.from_csv(emulated / "network_delays.csv", "delay")
    assert 0.0 < float(delays.mean) < 30.0
    lost = loss.Trace.from_csv(emulated / "network_losses.csv", repeat=True)
    signals = len(load_run(emulated).frame("signals"))
    # What leaves in the last moment may be beyond the end.
    assert signals - 2 <= np.shape(lost.lost)[0] <= signals
    assert np.shape(lost.lost)[1] == 60
    counts = pd.read_csv(emulated / "network_counts.csv")
    assert (counts["received"] + counts["lost"] == len(np.asarray(lost.lost))).all()


@pytest.mark.slow
def test_the_simulation_with_the_recorded_arrivals_is_the_emulation(emulated: Path) -> None:
    stored = load_emulation(emulated)
    found = replay(stored)
    real, replayed = found.real, found.replayed
    assert len(real.signals_sent.time) > 20
    assert (real.signals_sent.time == replayed.signals_sent.time).all()
    for name in ("delivered", "lost", "in_flight", "responses", "saturated"):
        assert (getattr(real.account, name) == getattr(replayed.account, name)).all(), name
    # Formulas in another order, over a hundred answers an agent: rounding.
    assert found.distance(replayed).max() < 1e-12
    for name, values in real.measures().items():
        assert values == pytest.approx(replayed.measures()[name], rel=1e-9, nan_ok=True), name
    assert real.observations.total_demand == pytest.approx(replayed.observations.total_demand, rel=1e-9)
    assert found.words()[0].startswith("With the recorded signals and arrivals all answers are the same")


@pytest.mark.slow
def test_as_many_signals_are_sent_as_in_a_simulation(emulated: Path) -> None:
    found = replay(load_emulation(emulated))
    real, plain = (run.signals_sent.counts(3) for run in (found.real, found.plain))
    unit = pd.read_csv(emulated / "unit_lateness.csv")["lateness"].mean()
    late = unit + sum(
        pd.read_csv(emulated / name)[column].mean()
        for name, column in (("network_delays.csv", "delay"), ("agent_lateness.csv", "lateness"))
    )
    # Each of the N cycles of a resource is longer by the lateness; 3 for what parts by chance.
    assert (np.abs(real - plain) <= 3 + plain * (late * plain / 30.0)).all()


@pytest.mark.slow
def test_the_command_tells_what_differs(emulated: Path, tmp_path: Path) -> None:
    folder = tmp_path / "replayed"
    outcome = invoke("emulate", "--replay", str(emulated), "--out", str(folder))
    assert outcome.exit_code == 0
    assert "Real and simulated" in outcome.stdout
    assert "all answers are the same" in outcome.stdout
    assert {path.name for path in folder.iterdir()} == {"replay.csv", "replay.png"}
    table = pd.read_csv(folder / "replay.csv")
    apart = table[table["measure"] == "distance"]
    assert len(apart) == 3
    assert (apart["replayed"] < 1e-12).all()


# Tells when the run has got somewhere; its end is a minute away.
_TOLD = f"""
from pathlib import Path
from aimd_des.utils.progress import RunProgress
update = RunProgress.update
def told(progress, time, events):
    if time > 3.0:
        Path("begun").touch()
    update(progress, time, events)
RunProgress.update = told
{PROGRAM}
"""
_QUICK = ("--unit", "0.1", "--processes", "2", "--out", "real", "--no-figures")
_LONG = ("mine.toml", *_QUICK, "--set", "until=600")


def begun() -> tuple[Fork, list[int]]:
    """Start a long emulation, and wait until it runs; what it has forked, in the order of their start."""
    write(SCENARIO, "mine.toml")
    command = started(*_LONG, code=_TOLD)
    listed = Path(f"/proc/{command.pid}/task/{command.pid}/children")
    if not listed.exists():
        pytest.skip("this system does not list the children of a process")
    until(Path("begun").exists)
    # What watches over shared memory may be a child before them.
    return command, [int(word) for word in listed.read_text(encoding="utf-8").split()][-3:]


@pytest.mark.slow
@pytest.mark.usefixtures("own_folder")
def test_ctrl_c_keeps_what_was_measured_and_leaves_nothing() -> None:
    command, children = begun()
    os.killpg(command.pid, signal.SIGINT)  # as a terminal does
    done = command.wait()
    assert done.returncode == 130
    assert "Stopped: it was interrupted; what was measured up to time" in done.stderr
    assert "Traceback" not in done.stderr
    assert len(children) == 3
    assert is_gone(command.pid)
    assert 0.0 < load_run("real").scenario["until"] < 600.0


@pytest.mark.slow
@pytest.mark.usefixtures("own_folder")
def test_a_process_that_dies_ends_the_run_in_a_sentence() -> None:
    command, (victim, *_) = begun()
    os.kill(victim, signal.SIGKILL)
    done = command.wait()
    assert done.returncode == 1
    said = "Stopped: the process of agents 0 to 29 has ended before the run has; what was measured"
    assert said in done.stderr
    assert is_gone(command.pid)
    assert json.loads(Path("real", "emulation.json").read_text(encoding="utf-8"))["stopped"]


# Each emulation is the work of a forked process with a group of its own.
_KILLS = 6
_KILLED = f"""
import os, random, signal, sys, time
from aimd_des.emulate import Conductor, check_setting
from aimd_des.scenario import load_scenario

setting = check_setting(load_scenario("mine.toml"), unit=0.5, processes=3)
setting.prepare()
moments = random.Random(int(sys.argv[2]))
for _ in range({_KILLS}):
    conductor = os.fork()
    if not conductor:
        os.setsid()
        Conductor(setting).run()
        os._exit(0)
    time.sleep(moments.uniform(0.05, 0.7))
    os.kill(conductor, signal.SIGKILL)
    os.waitpid(conductor, 0)
    print(conductor)
"""


@pytest.mark.slow
@pytest.mark.usefixtures("own_folder")
def test_no_process_is_left_after_kills_at_random_moments() -> None:
    write(SCENARIO, "mine.toml")
    seed = secrets.randbelow(1 << 30)
    done = started(str(seed), code=_KILLED).wait()
    assert done.returncode == 0, done.stderr
    groups = [int(word) for word in done.stdout.split()]
    assert len(groups) == _KILLS
    assert all(is_gone(group) for group in groups), f"seed {seed}"


@pytest.mark.slow
@pytest.mark.usefixtures("own_folder")
def test_processes_that_join_hold_the_agents() -> None:
    write(SCENARIO, "mine.toml")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    known = {"AIMD_DES_TOKEN": "known to both"}
    short = ("--set", "until=15")
    listens = started(
        "mine.toml",
        *short,
        "--listen",
        address,
        *_QUICK,
        **known,
    )
    until(lambda: "Waiting for 2 processes to join" in listens.stderr.read_text(encoding="utf-8"))
    with socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2]))) as stranger:
        stranger.sendall(secrets.token_bytes(200))
        joins = started("mine.toml", *short, "--join", address, "--processes", "2", **known)
        wrong = started("mine.toml", "--join", address, "--processes", "1", **known)
        guesses = started("mine.toml", *short, "--join", address, AIMD_DES_TOKEN="not that one")
        joined, refused, guessed = (of.wait() for of in (joins, wrong, guesses))
    done = listens.wait()
    assert done.returncode == 0, done.stderr
    assert joined.returncode == 0, joined.stderr
    late = ("hung up", "cannot be joined")  # where the others were there first
    if refused.returncode == 2:
        assert "the scenario there is another one" in refused.stderr
    else:
        assert any(words in refused.stderr for words in late)
    assert guessed.returncode == 1
    assert any(words in guessed.stderr for words in late)
    assert all(is_gone(of.pid) for of in (listens, joins, wrong, guesses))
    counts = pd.read_csv("real/network_counts.csv")
    assert len(counts) == 2
    # One machine has one clock: what the round trips say is off by no more than they claim, twice.
    assert (counts["clock_offset_s"].abs() <= 2.0 * counts["clock_uncertainty_s"]).all()
    found = replay(load_emulation(Path("real")))
    # Times of a process that joined are known to the uncertainty of its clock: a draw may go another way.
    assert found.distance(found.replayed).max() < 0.01


@pytest.mark.usefixtures("own_folder")
def test_mistakes_are_refused_in_a_sentence() -> None:
    write(SCENARIO, "mine.toml")
    assert refusal("emulate").startswith("SCENARIO: is missing")
    assert "unit = 0.0: must be a finite number at least 0.001" in refusal(
        "emulate", "mine.toml", "--unit", "0"
    )
    assert "processes = 0" in refusal("emulate", "mine.toml", "--processes", "0")
    refused = refusal("emulate", "mine.toml", "--set", "averaging={kind='window', length=5.0}")
    assert "averaging.kind = 'window': must be 'cumulative'" in refused
    assert "listen = '8.8.8.8:4000'" in refusal("emulate", "mine.toml", "--listen", "8.8.8.8:4000")
    local = ("--listen", "127.0.0.1:4000")
    assert "length of the token = 3" in refusal("emulate", "mine.toml", *local, "--token", "abc")
    assert "--transport: has no meaning with --listen" in refusal(
        "emulate", "mine.toml", *local, "--transport", "auto"
    )
    assert "--unit: has no meaning with --join" in refusal(
        "emulate", "mine.toml", "--join", "127.0.0.1:4000", "--unit", "1"
    )
    Path("empty").mkdir()
    assert "--seed: has no meaning with --replay" in refusal("emulate", "--replay", "empty", "--seed", "1")
    assert "folder = 'empty'" in refusal("emulate", "--replay", "empty")


@pytest.mark.usefixtures("own_folder")
def test_a_port_in_use_is_refused() -> None:
    write(SCENARIO, "mine.toml")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        said = refusal("emulate", "mine.toml", "--listen", address, "--token", "long enough")
    assert said.startswith(f"listen = '{address}': must be a free address of this machine")


@pytest.mark.usefixtures("own_folder")
def test_without_multicast_it_is_refused_only_where_it_was_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    write(SCENARIO, "mine.toml")
    monkeypatch.setattr("aimd_des.emulate.conductor.find_group", lambda: None)
    said = refusal("emulate", "mine.toml", "--transport", "multicast")
    assert said.startswith("transport = 'multicast': must be 'auto' or 'unicast'")
    from aimd_des.emulate import Conductor, check_setting
    from aimd_des.scenario import load_scenario

    setting = check_setting(load_scenario("mine.toml"), unit=0.25, processes=2)
    assert Conductor(setting).group is None


@pytest.mark.slow
def test_a_damaged_folder_is_refused(emulated: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(emulated, tmp_path / "copy")
    (copy / "emulation.json").write_text("{}", encoding="utf-8")
    with pytest.raises(InputError, match="does not have the checksum"):
        load_emulation(copy)
    (copy / "SHA256SUMS").unlink()
    with pytest.warns(UserWarning, match="no SHA256SUMS"), pytest.raises(InputError, match="is damaged"):
        load_emulation(copy)
