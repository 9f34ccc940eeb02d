"""Digests of runs that no change of the code may change: each part of a scenario, in every way of running it.

The stored digests are in data/golden_digests.json. `python -m tests.test_golden_digests` adds those of new
configurations and leaves the others as they are; where results were wrong, and only there, a line is
removed by hand first, and the changelog says so under **Results**.
"""

import json
from contextlib import chdir
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from aimd_des.scenario import load_scenario
from tests.conftest import quietly
from tests.scenario_examples import EXAMPLES, inline, write_files

STORED = Path(__file__).parent / "data" / "golden_digests.json"

_CONTINUOUS = 'dynamics = "continuous"'
_CROSSING = '[control_unit]\nkind = "crossing"\nhold_off = 0.5'
_CHANNEL = '[channel]\nlatency = { kind = "exponential", mean = 0.7 }\nloss = 0.2\nduplication = 0.3'

# Beside the catalogue of parts: parts that meet.
_MEETING = {
    "late and lost": inline("", _CHANNEL),
    "late and lost, continuous": inline(_CONTINUOUS, f"{_CROSSING}\n{_CHANNEL}"),
    "late and lost, sampled, continuous": inline(_CONTINUOUS, f"[control_unit]\nperiod = 0.75\n{_CHANNEL}"),
    "links that keep the order": inline(_CONTINUOUS, f"{_CROSSING}\n{_CHANNEL}\nfifo = true"),
    "forgetting of continuous agents": inline(
        _CONTINUOUS, f'{_CROSSING}\n{_CHANNEL}\n[averaging]\nkind = "forgetting"\ntime_constant = 15'
    ),
    "gain of continuous agents": inline(
        _CONTINUOUS, f'{_CROSSING}\n{_CHANNEL}\n[averaging]\nkind = "polynomial"\ngain = 1.75'
    ),
    "event normalised, window of continuous agents": inline(
        _CONTINUOUS,
        f"{_CROSSING}\n{_CHANNEL}\n"
        '[averaging]\nkind = "window"\nlength = 12.5\nparts = 5\n[response]\nkind = "event_normalised"',
    ),
    "full cuts, estimated": inline(
        "",
        f'{_CHANNEL}\n[compensation]\nkind = "estimated"\n'
        '[response]\nkind = "derandomised"\nfull = true\ndivisor = "events"',
    ),
    "estimated, continuous": inline(
        _CONTINUOUS, f'{_CROSSING}\n{_CHANNEL}\n[compensation]\nkind = "estimated"\nnumber_bits = 5'
    ),
    "clocks of their own behind a channel": inline(
        "",
        f'{_CHANNEL}\n[clocks]\nperiod = 0.9\nphase = "random"\ndrift = [0, 0.01, 0, -0.01, 0]\njitter = 0.2',
    ),
}


def _asynchronous() -> dict[str, str]:
    """Event-driven configurations; parts of the catalogue that continuous agents take, with these too."""
    found = {name: text for name, text in EXAMPLES.items() if 'dynamics = "synchronous"' not in text}
    for name, text in list(found.items()):
        if "dynamics" not in text and "[clocks]" not in text and "length = 40" not in text:
            found[f"{name}, continuous"] = f"{_CONTINUOUS}\n{text}"
    return found | _MEETING


def _synchronous() -> dict[str, str]:
    """Configurations of the synchronous algorithm: problems, readings of the lag, averages and seeds."""
    models = {
        "five agents": (inline(), 400),
        "cameras": ('model = "models.smart_cameras"\n[parameters]\nn_cameras = 12\n', 300),
        "coupled": (
            'model = "models.random_convex"\n[parameters]\nn_agents = 6\nn_resources = 2\n',
            300,
        ),
    }
    averages = {
        "all of the past": 'kind = "cumulative"',
        "window": 'kind = "window"\nlength = 40',
        "forgetting": 'kind = "forgetting"\ntime_constant = 20',
    }
    answers = {
        "event normalised": 'kind = "event_normalised"',
        "derandomised": 'kind = "derandomised"\ndivisor = "events"',
        "full cuts": 'kind = "derandomised"\ndivisor = "events"\nfull = true',
    }
    found = {}
    for (problem, (text, steps)), (average, table), lag, seed in product(
        models.items(), averages.items(), (0, 1), (1, 2, 3)
    ):
        head = f'dynamics = "synchronous"\nlag = {lag}\nuntil = {steps}\nseed = {seed}\n'
        body = text.replace("until = 60\nseed = 4\n", "")
        found[f"{problem}, {average}, lag {lag}, seed {seed}"] = f"{head}{body}\n[averaging]\n{table}\n"
    head = 'dynamics = "synchronous"\nlag = 0\nuntil = 300\nseed = 1\n'
    for (problem, (text, _)), (answer, table) in product(models.items(), answers.items()):
        body = text.replace("until = 60\nseed = 4\n", "")
        found[f"{problem}, {answer}"] = f"{head}{body}\n[response]\n{table}\n"
    return found


# What changes no result: the default spelled out, what is kept, how agents are represented.
ALIKE = {
    ("inline", "cumulative"),
    ("model", "recording"),
    ("continuous", "inline, continuous"),
    ("continuous", "cumulative, continuous"),
    ("model, continuous", "recording, continuous"),
}

ASYNCHRONOUS = _asynchronous()
SYNCHRONOUS = _synchronous()


def digest(text: str, folder: Path, **changes: str) -> str:
    """The digest of a run, its event log included where there is one."""
    path = folder / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    scenario = load_scenario(path, **changes)
    if scenario.dynamics != "synchronous":
        # Samples are no part of a digest, and a thousand of them take longer than the run.
        recording = scenario.recording.model_copy(update={"events": True, "allocations": "end"})
        scenario = scenario.model_copy(update={"recording": recording})
    return quietly(scenario.run).digest


@pytest.fixture(scope="module")
def stored() -> dict[str, dict[str, str]]:
    loaded: dict[str, dict[str, str]] = json.loads(STORED.read_text(encoding="utf-8"))
    return loaded


@pytest.fixture
def folder(own_folder: None, tmp_path: Path) -> Path:
    write_files(tmp_path)
    return tmp_path


@pytest.mark.parametrize("agents", ["process", "fleet"])
def test_every_asynchronous_run_has_the_stored_digest(
    agents: str, stored: dict[str, dict[str, str]], folder: Path
) -> None:
    found = {name: digest(text, folder, agents=agents) for name, text in ASYNCHRONOUS.items()}
    assert found == stored["asynchronous"]
    assert len(found) >= 50


def test_every_synchronous_run_has_the_stored_digest(stored: dict[str, dict[str, str]], folder: Path) -> None:
    found = {name: digest(text, folder) for name, text in SYNCHRONOUS.items()}
    assert found == stored["synchronous"]
    assert len(found) >= 50


def test_configurations_are_different_runs(stored: dict[str, dict[str, str]]) -> None:
    """Else a part that is ignored would be seen by nobody."""
    for kind, names in stored.items():
        seen: dict[str, str] = {}
        for name, value in names.items():
            other = seen.setdefault(value, name)
            assert other == name or (other, name) in ALIKE, f"{kind}: {name} and {other}"


def _add_new() -> None:
    """Store the digests of configurations that have none yet, by processes."""
    kept = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else {}
    with TemporaryDirectory() as name, chdir(name):
        write_files(Path(name))
        for kind, texts in (("asynchronous", ASYNCHRONOUS), ("synchronous", SYNCHRONOUS)):
            old = kept.get(kind, {})
            kept[kind] = {key: old.get(key) or digest(text, Path(name)) for key, text in texts.items()}
    STORED.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    _add_new()
