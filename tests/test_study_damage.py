"""Studies at rest: what is damaged, lost or another's is seen, said and run again."""

import json
import logging
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from aimd_des import InputError, OverloadWarning, Study, load_study
from aimd_des.study import StudyResults, journal, read_study
from aimd_des.study.journal import journals
from aimd_des.study.plan_table import planned
from aimd_des.study.seal import unsealed, write_sealed
from aimd_des.study.store import AGAIN, Store, parquet
from aimd_des.study.stored_rows import put_in_order
from tests.test_study_runs import BASE, contents, design, forget, in_a_thread, leftovers, stored

FLIPS = 200
AXES = [{"name": "latency", "key": "channel.latency", "values": [0, 2]}]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    return in_a_thread(design(axes=AXES), tmp_path_factory.mktemp("whole") / "study")


@pytest.fixture
def copy(whole: StudyResults, tmp_path: Path) -> Path:
    shutil.copytree(whole.folder, tmp_path / "copy")
    return tmp_path / "copy"


@pytest.fixture
def said(caplog: pytest.LogCaptureFixture) -> Callable[[], list[str]]:
    caplog.set_level(logging.WARNING, "aimd_des")
    return lambda: [record.getMessage() for record in caplog.records]


def one_by_one(folder: Path) -> None:
    """Give each run a file of its own, so that damage hits one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("aimd_des.study.stored_rows._RUNS_EACH", 1)
        put_in_order(Store(folder), stored(folder), load_study(folder).plan["key"].tolist())


def read(folder: Path) -> tuple[pd.DataFrame, ...]:
    """Read all that a folder has, and what one makes of it."""
    found = load_study(folder)
    scenarios = pd.DataFrame({"toml": [found.scenario(key).to_toml() for key in found.plan["key"]]})
    about = pd.DataFrame({"study": [str(found.study.spoken())], "versions": [repr(found.versions)]})
    again = pd.DataFrame({"study": [str(read_study(folder / "study.toml").spoken())]})
    frames = [found.frame(name) for name in found.study.keep]
    return (found.plan, found.missing, found.failed, found.runs, *frames, scenarios, about, again)


def equal(one: tuple[pd.DataFrame, ...], other: tuple[pd.DataFrame, ...]) -> bool:
    return all(mine.equals(its) for mine, its in zip(one, other, strict=True))


def _tiny() -> Study:
    """Two runs, of which one fails."""
    broken = {
        "cases": {"well": {}, "ill": {"channel.network": {"kind": "star", "n_agents": 7}}},
        "name": "is",
    }
    return design(keep=["signals"], replications=1, axes=[broken], scenario={**BASE, "until": 5})


# -- one bit ---------------------------------------------------------------------------------------------


def test_a_flipped_bit_never_reads_back_as_another_number(tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    in_a_thread(_tiny(), copy)
    expected = read(copy)
    assert len(expected[2]) == 1
    files = [path for path in sorted(copy.rglob("*")) if path.is_file() and path.stat().st_size]
    assert len(files) == 7
    rng = np.random.default_rng(13)
    silent, refusals = 0, []
    for flip in range(FLIPS):
        path = files[flip % len(files)]
        content = path.read_bytes()
        place = int(rng.integers(8 * len(content)))
        turned = bytearray(content)
        turned[place // 8] ^= 1 << place % 8
        path.write_bytes(turned)
        try:
            found = read(copy)
        except InputError as refusal:
            refusals.append((path.name, str(refusal)))
        else:
            # A bit of the mark itself: nothing that is read has changed, and it is said.
            silent += 1
            assert equal(found, expected), (path, place)
        path.write_bytes(content)
    assert silent < FLIPS / 10
    assert [sentence for name, sentence in refusals if name not in sentence or "\n" in sentence] == []
    assert equal(read(copy), expected)


@pytest.mark.parametrize(
    "kind", ["runs", "signals", "manifest.json", "plan.parquet", "points.parquet", "study.toml"]
)
def test_every_byte_of_a_file_is_covered(whole: StudyResults, kind: str) -> None:
    path = whole.folder / kind
    path = min(path.iterdir()) if path.is_dir() else path
    name, content = str(path.relative_to(whole.folder)), path.read_bytes()
    _, sealed = unsealed(content, name, "it", "")
    assert sealed
    mark = content.find(b"sha256")
    passed = []
    for place in range(len(content)):
        turned = bytearray(content)
        turned[place] ^= 1 << place % 8
        try:
            found = unsealed(bytes(turned), name, "it", "")
        except InputError:
            continue
        assert not found[1]
        passed.append(place)
    # Without its mark a file is one of an earlier version, which is said; nothing else passes.
    assert len(passed) < 20
    assert all(abs(place - mark) < 20 for place in passed)


def test_files_with_checksums_are_for_everybody(whole: StudyResults) -> None:
    key = whole.plan["key"][0]
    table = pq.read_table(whole.folder / "signals" / f"{key}.parquet")
    assert len(table) == whole.frame("signals")["key"].eq(key).sum()
    assert json.loads((whole.folder / "manifest.json").read_text())["runs"] == 4
    assert read_study(whole.folder / "study.toml") == whole.study


# -- journals of sweeps that were killed -----------------------------------------------------------------


def test_rows_are_read_from_journals_and_what_is_torn_or_damaged_is_run_again(
    whole: StudyResults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: Callable[[], list[str]]
) -> None:
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr("aimd_des.study.run.put_in_order", lambda *_: None)  # as if it were killed before
        in_a_thread(whole.study, out)
    (path,) = journals(out / "runs")
    assert not list((out / "runs").glob("*.parquet"))
    content = path.read_bytes()
    found = load_study(out)
    assert found.runs.equals(whole.runs)
    assert found.missing.empty
    done = [record["labels"]["key"] for record in journal.read(content, "", "")[0]]
    # Whatever its last line has lost, it is no line yet, and nothing is said.
    begin = content.rindex(b"\n", 0, -1) + 1
    for torn in (begin, begin + 200, len(content) - 1):
        path.write_bytes(content[:torn])
        assert load_study(out).missing["key"].tolist() == done[-1:]
    turned = bytearray(content)
    turned[content.index(b"utilisation")] ^= 1
    path.write_bytes(turned)
    found = load_study(out)
    assert found.missing["key"].tolist() == done[:1]
    with pytest.raises(InputError, match=f"{path.name}: line 2 does not fit its checksum.*{AGAIN}"):
        _ = found.runs
    in_a_thread(whole.study, out)
    assert [sentence for sentence in said() if path.name in sentence and sentence.endswith("is run again")]
    assert contents(out) == contents(whole.folder)


def test_nothing_is_lost_wherever_putting_in_order_is_stopped(
    whole: StudyResults, copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[str] = []

    def stopping(step: Callable[..., Any], at: int) -> Callable[..., Any]:
        def run(*arguments: Any) -> Any:
            if len(steps) == at:
                raise KeyboardInterrupt
            steps.append(str(arguments))
            return step(*arguments)

        return run

    for at in range(8):
        steps.clear()
        with monkeypatch.context() as patch, suppress(KeyboardInterrupt):
            patch.setattr("aimd_des.study.stored_rows._RUNS_EACH", 1 + at % 2)
            for step in ("write", "forget"):
                patch.setattr(Store, step, stopping(getattr(Store, step), at))
            put_in_order(Store(copy), stored(copy), whole.plan["key"].tolist())
        assert load_study(copy).runs.equals(whole.runs)
    in_a_thread(whole.study, copy)
    assert contents(copy) == contents(whole.folder)


# -- what is lost, cut off or another's ------------------------------------------------------------------


def _emptied(path: Path) -> None:
    path.write_bytes(b"")


def _cut_off(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _another(path: Path) -> None:
    other = next(one for one in sorted(path.parent.iterdir()) if one != path)
    shutil.copyfile(other, path)


@pytest.mark.parametrize("kind", ["runs", "signals", "demand"])
@pytest.mark.parametrize("damage", [Path.unlink, _emptied, _cut_off, _folder, _another])
def test_a_run_that_is_not_whole_is_missing_and_run_again(
    whole: StudyResults,
    copy: Path,
    said: Callable[[], list[str]],
    damage: Callable[[Path], None],
    kind: str,
) -> None:
    key = whole.plan["key"][1]
    one_by_one(copy)
    path = next((copy / kind).glob("00001-*" if kind == "runs" else f"{key}.*"))
    damage(path)
    found = load_study(copy)
    assert found.missing["key"].tolist() == [key]
    assert planned(whole.study, Store(copy))["done"].sum() == 3
    lost = damage is Path.unlink and kind == "runs"  # then it is as if it had never been
    if kind == "runs":
        if lost:
            assert key not in set(found.runs["key"])
        else:
            with pytest.raises(InputError, match=f"{path.name}.*{AGAIN}"):
                _ = found.runs
    else:
        assert key in set(found.runs["key"])
        with pytest.raises(InputError, match=f"{kind}/{key}.*{AGAIN}"):
            found.frame(kind)
    in_a_thread(whole.study, copy)
    assert contents(copy) == contents(whole.folder)
    assert [
        sentence for sentence in said() if path.name in sentence and sentence.endswith("is run again")
    ] or lost


def test_many_damaged_runs_are_not_all_told(
    whole: StudyResults, copy: Path, said: Callable[[], list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("aimd_des.study.runs_left._MOST_TOLD", 2)
    one_by_one(copy)
    for path in (copy / "runs").iterdir():
        path.write_bytes(b"")
    in_a_thread(whole.study, copy)
    assert len(said()) == 3
    assert said()[-1].endswith("more is damaged; it is run again")
    assert contents(copy) == contents(whole.folder)


def test_a_record_of_a_failure_that_is_damaged_is_no_record(copy: Path, whole: StudyResults) -> None:
    key = whole.plan["key"][0]
    forget(copy, key)
    (copy / "failed" / f"{key}.json").write_text('{"message": "')
    found = load_study(copy)
    assert found.missing["key"].tolist() == [key]
    with pytest.raises(InputError, match=f"{key}.json: cannot be read"):
        _ = found.failed
    in_a_thread(whole.study, copy)
    assert contents(copy) == contents(whole.folder)


@pytest.mark.parametrize("name", ["manifest.json", "plan.parquet"])
@pytest.mark.parametrize("damage", [_emptied, _cut_off, _folder])
def test_what_says_which_study_it_is_can_be_made_anew(
    whole: StudyResults, copy: Path, said: Callable[[], list[str]], damage: Callable[[Path], None], name: str
) -> None:
    damage(copy / name)
    with pytest.raises(InputError, match=name):
        load_study(copy)
    if damage is _folder:
        (copy / name).rmdir()
    else:
        with pytest.raises(InputError, match=f"{name}: .*remove it, and sweep again"):
            in_a_thread(whole.study, copy)
        (copy / name).unlink()
    in_a_thread(whole.study, copy)
    assert contents(copy) == contents(whole.folder)


def test_a_study_without_its_manifest_keeps_its_columns(whole: StudyResults, copy: Path) -> None:
    (copy / "manifest.json").unlink()
    before = contents(copy)
    with pytest.raises(InputError, match="measures of the study"):
        in_a_thread(design(axes=AXES, measures=["signals"]), copy)
    with pytest.raises(InputError, match=r"axes of the study = \['latency', 'kind'\]"):
        in_a_thread(design(), copy)
    with pytest.raises(InputError, match="the scenario or the seed at"):
        in_a_thread(design(axes=AXES, seed=1), copy)
    assert contents(copy) == before


def test_a_damaged_study_can_be_removed_and_that_of_others_cannot(whole: StudyResults, copy: Path) -> None:
    (copy / "manifest.json").write_text("{")
    in_a_thread(whole.study, copy, overwrite=True)
    assert contents(copy) == contents(whole.folder)
    pd.DataFrame({"mine": [1.0]}).to_parquet(copy / "plan.parquet")
    (copy / "manifest.json").unlink()
    before = contents(copy)
    for overwrite in (False, True):
        with pytest.raises(InputError, match=r"it has no manifest\.json"):
            in_a_thread(whole.study, copy, overwrite=overwrite)
    assert contents(copy) == before


# -- what earlier versions wrote -------------------------------------------------------------------------

VERSIONS = {"aimd_des": "0.0.9", "python": "3.12.0"}


def _told(table: pa.Table, **metadata: str) -> pa.Table:
    """Put what is known of a run into the metadata of its rows."""
    return table.replace_schema_metadata({f"aimd_des.{name}": text for name, text in metadata.items()})


def _a_file_a_run(folder: Path, write: Callable[[Path, pa.Table, str], Any]) -> None:
    """Write the rows of runs as earlier versions did, and without the file of the points."""
    found, rows = load_study(folder), stored(folder)
    scenarios = {key: found.scenario(key).to_toml() for key in found.plan["key"]}
    for name in (*rows.files, "points.parquet"):
        (folder / name).unlink()
    for key, scenario in scenarios.items():
        table = rows.of([key]).drop_columns(["aimd_des.run_away", "aimd_des.versions"])
        write(folder / "runs" / f"{key}.parquet", table, scenario)


def _as_before(folder: Path) -> None:
    """Make of a folder what the version before checksums and digests wrote."""
    _a_file_a_run(folder, lambda path, table, scenario: pq.write_table(_told(table, scenario=scenario), path))
    for path in folder.rglob("*"):
        if path.is_file() and path.stat().st_size:
            path.write_bytes(unsealed(path.read_bytes(), str(path.relative_to(folder)), "it", "")[0])
    manifest = json.loads((folder / "manifest.json").read_text())
    del manifest["digests"]
    (folder / "manifest.json").write_text(json.dumps({**manifest, "versions": VERSIONS}))


def test_a_study_of_an_earlier_version_is_read_and_goes_on_and_both_are_said(
    whole: StudyResults, copy: Path, said: Callable[[], list[str]]
) -> None:
    _as_before(copy)
    found = load_study(copy)
    assert found.runs.equals(whole.runs)
    assert found.frame("signals").equals(whole.frame("signals"))
    assert found.missing.empty
    assert found.versions == VERSIONS
    assert [sentence.partition(": ")[2] for sentence in said()] == [
        "files of an earlier version have no checksums; whether they are as they were written is not known"
    ]
    results = in_a_thread(design(axes=AXES, replications=3), copy)
    assert any(sentence.startswith(f"{copy}: holds no digests of its problems") for sentence in said())
    assert len(results.runs) == 2 * 3 * 2
    # Versions of both: those of the old runs are kept.
    assert VERSIONS["aimd_des"] in results.versions["aimd_des"]
    assert whole.versions["aimd_des"] in results.versions["aimd_des"]


def test_files_of_one_run_each_are_read_and_go_on_in_files_of_many(
    whole: StudyResults, copy: Path, said: Callable[[], list[str]]
) -> None:
    of_runs = {key: json.dumps(VERSIONS | {"numpy": key}) for key in whole.plan["key"]}

    def write(path: Path, table: pa.Table, scenario: str) -> None:
        away = {"run_away": '["disk"]'} if path.stem == whole.plan["key"][1] else {}
        table = _told(table, scenario=scenario, versions=of_runs[path.stem], **away)
        write_sealed(copy, f"runs/{path.name}", parquet(table))

    _a_file_a_run(copy, write)
    for _ in range(2):
        found = load_study(copy)
        assert found.runs.equals(whole.runs)
        assert found.missing.empty
        assert found.versions == VERSIONS | {"numpy": ", ".join(sorted(of_runs))}
        assert found.run_away[["key", "resources"]].to_numpy().tolist() == [[whole.plan["key"][1], "disk"]]
        for key in whole.plan["key"]:
            assert found.scenario(key).to_toml() == whole.scenario(key).to_toml()
        with pytest.warns(OverloadWarning):
            in_a_thread(whole.study, copy)
        assert contents(copy).keys() == contents(whole.folder).keys()
    assert said() == []


def test_another_run_in_a_file_without_checksum_is_seen(whole: StudyResults, copy: Path) -> None:
    _as_before(copy)
    first, second = whole.plan["key"][:2]
    shutil.copyfile(copy / f"runs/{first}.parquet", copy / f"runs/{second}.parquet")
    found = load_study(copy)
    assert found.missing["key"].tolist() == [second]
    with pytest.raises(InputError, match=f"{second}.parquet: is another run's; {AGAIN}"):
        _ = found.runs


# -- versions --------------------------------------------------------------------------------------------


def test_a_sweep_that_runs_nothing_writes_nothing_and_versions_are_those_of_runs(
    whole: StudyResults, copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {path: path.stat().st_mtime_ns for path in copy.rglob("*") if path.is_file()}
    monkeypatch.setattr("aimd_des.study.worker_task._versions", lambda: VERSIONS)
    assert in_a_thread(whole.study, copy).versions == whole.versions
    assert {path: path.stat().st_mtime_ns for path in copy.rglob("*") if path.is_file()} == before
    grown = in_a_thread(design(axes=AXES, replications=3), copy)
    both = sorted((VERSIONS["aimd_des"], whole.versions["aimd_des"]))
    assert grown.versions["aimd_des"] == ", ".join(both)
    assert grown.versions["numpy"] == whole.versions["numpy"]


# -- workers that are killed -----------------------------------------------------------------------------


def test_what_a_killed_worker_leaves_is_swept_by_the_sweep_that_sees_it(
    whole: StudyResults, copy: Path
) -> None:
    key = whole.plan["key"][0]
    forget(copy, key)
    ours = copy / f"runs/.{key}.parquet.{'0f' * 16}.tmp"
    theirs = copy / "runs" / ".notes.tmp"

    def leave(_: Any) -> None:
        ours.write_bytes(b"half")
        theirs.write_bytes(b"whole")

    in_a_thread(whole.study, copy, watch=leave)
    assert leftovers(copy) == [theirs]
    theirs.unlink()
    assert contents(copy) == contents(whole.folder)


# -- models that have changed ----------------------------------------------------------------------------

MODEL = """
from aimd_des import CustomCosts, Problem, Resource, model

FACTORS = [1.0, 2.0]

def slope(agent, x):
    return 2 * FACTORS[agent] * x

def value(agent, x):
    # the price
    return FACTORS[agent] * float(x[0]) ** 2

@model
def {name}(seed=0):
    return Problem([Resource("memory", 4.0, 0.03, 0.5, 0.02)], CustomCosts(2, 1, value, slope))
"""


def _swept(name: str, text: str, out: Path, monkeypatch: pytest.MonkeyPatch, replications: int = 1) -> Any:
    """Sweep in a process that has just imported the model."""
    import sys

    from aimd_des.utils import parts as registry

    Path(f"{name}.py").write_text(text)
    sys.modules.pop(name, None)
    monkeypatch.delitem(registry.REGISTERED, name, raising=False)
    __import__("importlib").invalidate_caches()
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    study = Study.model_validate(
        {
            "scenario": {"model": name, "until": 5, "agents": "process"},
            "axes": AXES,
            "replications": replications,
        }
    )
    return in_a_thread(study, out)


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ('"memory", 4.0', '"memory", 1.0', "capacity"),
        ("0.02)", "0.01)", "normalization"),
        ("0.03, 0.5", "0.02, 0.4", "increase, decrease"),
        ("FACTORS = [1.0, 2.0]", "FACTORS = [1.0, 3.0]", "costs"),
        ("float(x[0]) ** 2", "float(x[0]) ** 2 + 1", "costs"),
    ],
)
def test_a_model_that_has_changed_is_refused_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, old: str, new: str, parts: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    name = "changing_model"
    text = MODEL.format(name=name)
    assert old in text
    _swept(name, text, tmp_path / "out", monkeypatch)
    before = contents(tmp_path / "out")
    with pytest.raises(InputError) as caught:
        _swept(name, text.replace(old, new), tmp_path / "out", monkeypatch, replications=2)
    assert str(caught.value) == (
        f"the problem at latency = 0 is not that of the runs in the folder ({parts}), since its"
        " model has changed; put the model back as it was, or choose another folder, or say --overwrite"
        " (overwrite=True)"
    )
    assert contents(tmp_path / "out") == before
    # Comments and blanks make no other problem.
    same = text.replace("# the price", "# what it costs\n")
    assert len(_swept(name, same, tmp_path / "out", monkeypatch, replications=2).runs) == 4


def test_points_that_share_a_problem_have_one_digest(whole: StudyResults) -> None:
    digests = json.loads((whole.folder / "manifest.json").read_text())["digests"]
    (only,) = digests["problems"].values()
    assert only["points"] == whole.plan["point"].unique().tolist()
    assert set(only["parts"]) >= {"capacity", "increase", "decrease", "costs"}


def test_a_file_that_is_being_written_is_no_run(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    for name in ("a.parquet", ".b.parquet.0123.tmp"):
        (tmp_path / "runs" / name).touch()
    assert Store(tmp_path).names("runs") == ["a.parquet"]
