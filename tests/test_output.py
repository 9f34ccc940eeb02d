"""The folder of a run is written whole or not at all, and nobody else's is touched."""

import errno
import json
import os
import shutil
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from threading import Barrier
from typing import Any

import pandas as pd
import pytest
from matplotlib.figure import Figure

from aimd_des import InputError, Result
from aimd_des.results.measures import EXPECTED
from aimd_des.scenario import Scenario, load_scenario
from aimd_des.scenario.run_folder import load_run, write_run
from aimd_des.utils.checksums import SUMS, read_checksums, write_checksums
from aimd_des.utils.folders import PROVENANCE, Place, check_folder, new_folder
from tests.conftest import INLINE, quietly

FILES = [
    "SHA256SUMS",
    "allocations.parquet",
    "capacity.parquet",
    "convergence.parquet",
    "demand.parquet",
    "optimum.parquet",
    "run.json",
    "scenario.toml",
    "signals.parquet",
    "summary.csv",
]


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def everything(folder: Path) -> dict[str, bytes]:
    """All files below a folder, hidden ones too, and empty folders."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_file():
            found[name] = path.read_bytes()
        elif not any(path.iterdir()):
            found[f"{name}/"] = b""
    return found


def earlier_results(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / PROVENANCE).write_text("{}", encoding="utf-8")
    (folder / "old.csv").write_text("old", encoding="utf-8")
    return folder


def checked(folder: str, *, overwrite: bool = False) -> Place:
    return check_folder(Path(folder), overwrite=overwrite)


def test_a_new_and_an_empty_folder_are_accepted_and_left_as_they_are() -> None:
    Path("empty").mkdir()
    for overwrite in (False, True):
        check_folder(Path("new"), overwrite=overwrite)
        check_folder(Path("empty"), overwrite=overwrite)
    assert everything(Path()) == {"empty/": b""}


def test_a_folder_with_something_in_it_is_refused_unless_it_may_be_replaced() -> None:
    folder = earlier_results(Path("out"))
    before = everything(Path())
    with pytest.raises(
        InputError, match=r"^output folder = 'out': must be new or empty; choose another, or say --overwrite$"
    ):
        check_folder(folder, overwrite=False)
    check_folder(folder, overwrite=True)
    assert everything(Path()) == before


def test_a_folder_that_is_not_ours_is_never_replaced() -> None:
    Path("precious").mkdir()
    Path("precious/thesis.tex").write_text("years", encoding="utf-8")
    with pytest.raises(
        InputError,
        match=r"^output folder = 'precious': must be one that this program wrote; it has no run\.json; ",
    ):
        check_folder(Path("precious"), overwrite=True)
    with pytest.raises(InputError, match=r"it has no study\.json"):
        check_folder(earlier_results(Path("out")), overwrite=True, mark="study.json")


def test_a_file_is_no_folder() -> None:
    Path("out").write_text("", encoding="utf-8")
    for overwrite in (False, True):
        with pytest.raises(
            InputError, match=r"^output folder = 'out': must be a folder; it is a file; choose"
        ):
            check_folder(Path("out"), overwrite=overwrite)


def test_a_folder_below_a_file_cannot_be_made() -> None:
    Path("file").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match=r"^output folder 'file/out': cannot be written \("):
        check_folder(Path("file/out"), overwrite=False)


def test_a_folder_that_cannot_be_written_is_refused_before_anything_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Who runs tests as root may write everywhere: the system's refusal is made up.
    def refuse(*args: Any, **kwargs: Any) -> Any:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(tempfile, "mkdtemp", refuse)
    with pytest.raises(InputError, match=r"^output folder 'out': cannot be written \(Permission denied\)$"):
        check_folder(Path("out"), overwrite=False)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_refused() -> None:
    Path("closed").mkdir(mode=0o500)
    with pytest.raises(
        InputError, match=r"^output folder 'closed/out': cannot be written \(Permission denied\)$"
    ):
        check_folder(Path("closed/out"), overwrite=False)


@pytest.mark.parametrize("target", ["out", "deep/er/out"])
def test_what_is_written_appears_at_once(target: str) -> None:
    folder = Path(target)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with new_folder(checked(target)) as place:
        (place / "a.txt").write_text("a", encoding="utf-8")
        assert not folder.exists()
    assert everything(Path()) == {f"{target}/a.txt": b"a"}


def test_the_folder_has_the_permissions_of_any_new_folder() -> None:
    Path("other").mkdir()
    with new_folder(checked("out")):
        pass
    assert Path("out").stat().st_mode == Path("other").stat().st_mode


def test_earlier_results_are_replaced_as_a_whole() -> None:
    earlier_results(Path("out"))
    with new_folder(checked("out", overwrite=True)) as place:
        (place / "new.csv").write_text("new", encoding="utf-8")
    assert everything(Path()) == {"out/new.csv": b"new"}


def test_where_writing_fails_earlier_results_stay_and_nothing_else_is_left() -> None:
    earlier_results(Path("out"))
    before = everything(Path())

    def write_half() -> None:
        with new_folder(checked("out", overwrite=True)) as place:
            (place / "half.csv").write_text("half", encoding="utf-8")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_half()
    assert everything(Path()) == before


def test_results_may_lie_behind_a_link() -> None:
    earlier_results(Path("far/out"))
    Path("link").symlink_to("far/out")
    with new_folder(checked("link", overwrite=True)) as place:
        (place / "new.csv").write_text("new", encoding="utf-8")
    assert Path("link").is_symlink()
    assert everything(Path("far")) == {"out/new.csv": b"new"}


# -- what comes to the place while a run goes on -------------------------------------------------------------


def lost(place: Place) -> str:
    """The sentence of a run that comes too late to its place; what it has written is beside it."""
    with pytest.raises(InputError) as refused, new_folder(place) as folder:
        (folder / "new.csv").write_text("new", encoding="utf-8")
    sentence = str(refused.value)
    beside = Path(sentence.split(" is in ")[1].strip("'"))
    assert everything(beside) == {"new.csv": b"new"}
    assert not beside.name.startswith(".")
    shutil.rmtree(beside)
    return sentence


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("begun", ["nothing", "empty"])
def test_what_comes_to_a_new_folder_stays(overwrite: bool, begun: str) -> None:
    if begun == "empty":
        Path("out").mkdir()
    place = checked("out", overwrite=overwrite)
    Path("out").mkdir(exist_ok=True)
    # It even looks like earlier results: they were not there when this run began.
    Path("out", PROVENANCE).write_text("{}", encoding="utf-8")
    before = everything(Path())
    assert lost(place).startswith(
        "output folder 'out': cannot be replaced any more (something has come there)"
    )
    assert everything(Path()) == before


@pytest.mark.parametrize("kind", ["file", "link"])
def test_what_is_no_folder_stays_too(kind: str) -> None:
    place = checked("deep/out")
    Path("deep").mkdir()
    if kind == "file":
        Path("deep/out").write_text("mine", encoding="utf-8")
    else:
        Path("far").mkdir()
        Path("deep/out").symlink_to("../far")
    assert "something has come there" in lost(place)
    assert Path("deep/out").is_symlink() == (kind == "link")
    assert kind == "link" or Path("deep/out").read_text(encoding="utf-8") == "mine"
    assert [path.name for path in Path("deep").iterdir()] == ["out"]


def test_what_is_put_beside_earlier_results_stays() -> None:
    earlier_results(Path("out"))
    Path("out/sub").mkdir()
    Path("out/sub/old.txt").write_text("old", encoding="utf-8")

    def added() -> None:
        Path("out/sub/notes.txt").write_text("mine", encoding="utf-8")

    def written_anew() -> None:
        Path("out/old.csv").write_text("OLD", encoding="utf-8")

    def replaced() -> None:
        shutil.copytree("out", "copy")
        shutil.rmtree("out")
        Path("copy").rename("out")

    for change in (added, written_anew, replaced):
        place = checked("out", overwrite=True)
        change()
        before = everything(Path())
        assert "something has come there" in lost(place)
        assert everything(Path()) == before
    with new_folder(checked("out", overwrite=True)):
        pass  # as long as nothing comes, all of it is replaced
    assert everything(Path()) == {"out/": b""}


def test_earlier_results_that_are_gone_are_no_reason_to_stop_or_to_lose_anything() -> None:
    place = checked(str(earlier_results(Path("out"))), overwrite=True)
    shutil.rmtree("out")
    assert "No such file" in lost(place)
    assert everything(Path()) == {}


def test_what_comes_to_earlier_results_while_they_are_removed_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    place = checked(str(earlier_results(Path("out"))), overwrite=True)
    rename = Path.rename

    def rename_late(self: Path, target: Path) -> Path:
        if target == place.target:  # somebody has stood in the old folder all the time
            (next(Path().glob(".out.old.*")) / "out/late.txt").write_text("mine", encoding="utf-8")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", rename_late)
    with (
        pytest.warns(RuntimeWarning, match="earlier results could not be removed"),
        new_folder(place) as folder,
    ):
        (folder / "new.csv").write_text("new", encoding="utf-8")
    found = everything(Path())
    assert found.pop("out/new.csv") == b"new"
    assert list(found.values()) == [b"mine"]


def test_earlier_results_that_cannot_go_back_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    place = checked(str(earlier_results(Path("out"))), overwrite=True)
    rename = Path.rename

    def rename_late(self: Path, target: Path) -> Path:
        moved = rename(self, target)
        if self == place.target:  # a third comes where the earlier results have just been
            self.mkdir()
            (self / "third.txt").write_text("third", encoding="utf-8")
        return moved

    monkeypatch.setattr(Path, "rename", rename_late)
    with pytest.warns(RuntimeWarning, match="holds what was at out before"):
        assert "something has come there" in lost(place)
    found = everything(Path())
    assert found.pop("out/third.txt") == b"third"
    assert sorted(Path(name).name for name in found) == ["old.csv", PROVENANCE]


@pytest.mark.parametrize("overwrite", [False, True])
def test_of_several_that_end_at_once_one_wins(overwrite: bool) -> None:
    if overwrite:
        earlier_results(Path("out"))
    places = [checked("out", overwrite=overwrite) for _ in range(8)]
    start = Barrier(len(places))

    def race(number: int) -> str:
        with new_folder(places[number]) as folder:
            (folder / "mine.txt").write_text(str(number), encoding="utf-8")
            start.wait()
        return str(number)

    with ThreadPoolExecutor(len(places)) as pool:
        races = [pool.submit(race, number) for number in range(len(places))]
    (winner,) = [done.result() for done in races if done.exception() is None]
    kept = {path.read_text(encoding="utf-8"): path.parent.name for path in Path().glob("out*/mine.txt")}
    assert sorted(kept) == [str(number) for number in range(8)]
    assert kept[winner] == "out"
    for number, done in enumerate(races):
        if str(number) != winner:
            assert isinstance(done.exception(), InputError)
            assert f"is in '{kept[str(number)]}'" in str(done.exception())
    assert not list(Path().glob(".*"))


# -- what is written -----------------------------------------------------------------------------------------


@pytest.fixture
def scenario() -> Scenario:
    Path("five.toml").write_text(INLINE, encoding="utf-8")
    loaded = load_scenario(Path("five.toml"))
    Path("five.toml").unlink()
    return loaded


@pytest.fixture
def result(scenario: Scenario) -> Result:
    return quietly(scenario.run)


def test_a_run_is_written_as_files_that_anybody_can_read(scenario: Scenario, result: Result) -> None:
    write_run(checked("out"), scenario, result, figures=False)
    assert list(everything(Path("out"))) == FILES
    for name in ("signals", "demand", "allocations"):
        pd.testing.assert_frame_equal(pd.read_parquet(f"out/{name}.parquet"), getattr(result, name))
    summary = pd.read_csv("out/summary.csv", index_col="resource")
    pd.testing.assert_frame_equal(summary.drop(columns=EXPECTED), result.summary(), rtol=1e-15)
    again = load_scenario(Path("out/scenario.toml"))
    assert again == scenario.resolved() == load_scenario("out/scenario.toml")
    assert quietly(again.run).digest == result.digest == load_run("out").digest


def test_the_event_log_is_written_if_it_was_kept(scenario: Scenario) -> None:
    asked = scenario.model_copy(update={"recording": scenario.recording.model_copy(update={"events": True})})
    result = asked.run()
    write_run(checked("out"), asked, result, figures=False)
    pd.testing.assert_frame_equal(pd.read_parquet("out/events.parquet"), result.events)
    assert len(result.events) > 100


def test_the_provenance_names_digest_seed_and_versions(scenario: Scenario, result: Result) -> None:
    write_run(checked("out"), scenario, result, figures=False)
    written = json.loads(Path("out", PROVENANCE).read_text(encoding="utf-8"))
    assert (written["digest"], written["seed"]) == (result.digest, 4)
    assert {"aimd_des", "python", "numpy", "scipy", "numba", "simpy", "pandas"} <= set(written["versions"])
    assert all(isinstance(text, str) and text for text in written["versions"].values())


def test_a_run_is_written_whole_or_not_at_all(
    scenario: Scenario, result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*args: Any, **kwargs: Any) -> Any:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(pd.DataFrame, "to_parquet", fail)
    with pytest.raises(OSError, match="No space left on device"):
        write_run(checked("out"), scenario, result, figures=False)
    assert everything(Path()) == {}


# -- figures ---------------------------------------------------------------------------------------------


def broken(*names: str) -> Any:
    """Makers of figures of which some fail, in drawing or when they are rendered."""

    def makers(result: Result) -> dict[str, Any]:
        assert Path("out/summary.csv").is_file(), "numbers come before figures"
        return {f"figure{k}": partial(draw, f"figure{k}") for k in range(1, 4)}

    def draw(name: str) -> Figure:
        figure = Figure()
        if name in names:
            figure.suptitle(r"$\frac{1}{$")  # fails when it is rendered
        return figure

    return makers


def test_a_figure_that_fails_is_told_and_takes_nothing_along(
    scenario: Scenario, result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("aimd_des.plots.paper.figure_makers", broken("figure2"))
    with pytest.warns(
        RuntimeWarning, match=r"(?s)^out/figure2\.png: is missing \(ValueError: .*; all numbers"
    ):
        write_run(checked("out"), scenario, result)
    assert list(everything(Path("out"))) == sorted([*FILES, "figure1.png", "figure3.png"])
    sums = read_checksums(Path("out"), "")
    assert sums is not None
    assert sorted(sums) == sorted({*FILES, "figure1.png", "figure3.png"} - {SUMS})
    assert load_run("out").digest == result.digest


def test_a_figure_whose_checksum_finds_no_place_is_removed(
    scenario: Scenario, result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that is full between both left a figure that the checksums do not know, and no other one."""

    def full(folder: Path, sums: dict[str, str]) -> None:
        if "figure2.png" in sums and "figure3.png" not in sums:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write_checksums(folder, sums)

    monkeypatch.setattr("aimd_des.scenario.run_folder.write_checksums", full)
    monkeypatch.setattr("aimd_des.plots.paper.figure_makers", broken())
    with pytest.warns(
        RuntimeWarning, match=r"^out/figure2\.png: is missing \(No space left on device\); all"
    ):
        write_run(checked("out"), scenario, result)
    assert list(everything(Path("out"))) == sorted([*FILES, "figure1.png", "figure3.png"])
    assert load_run("out").digest == result.digest


def test_no_figure_goes_into_another_runs_folder(
    scenario: Scenario, result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    def taken(result: Result) -> dict[str, Any]:
        shutil.rmtree("out")
        earlier_results(Path("out"))
        return {"figure1": Figure}

    monkeypatch.setattr("aimd_des.plots.paper.figure_makers", taken)
    with pytest.warns(RuntimeWarning, match="the folder is no longer that of this run"):
        write_run(checked("out"), scenario, result)
    assert sorted(everything(Path("out"))) == ["old.csv", PROVENANCE]
